"""Solids of one view that a slicer takes: closed, z up, on the plate."""

from __future__ import annotations

import numpy as np
import pytest

import fringeworks as fw
from tests.commands import run
from tests.surfaces import H, W, cloud_of

trimesh = pytest.importorskip("trimesh")


def dome_depth(height_mm=20.0, back_mm=500.0):
    """Depths of a dome before a plane; its right half lies in the dark."""
    y, x = np.mgrid[:H, :W]
    off = ((x - W / 2) ** 2 + (y - H / 2) ** 2) / (0.4 * H) ** 2
    depth = back_mm - height_mm * np.sqrt(np.maximum(1.0 - off, 0.0))
    depth[: H // 3, W // 2 :] = np.nan
    return depth


def read(path):
    return trimesh.load(path, process=True)


@pytest.mark.parametrize("fill_px", [0, 40])
def test_a_solid_is_closed_and_stands_on_its_plate(tmp_path, fill_px):
    depth = dome_depth()
    depth[H // 2 : H // 2 + 5, 20:25] = np.nan
    solid = fw.surface.solid_relief(cloud_of(depth), plate_mm=3.0, fill_px=fill_px)
    fw.files.write_mesh(tmp_path / "part.stl", solid)
    mesh = read(tmp_path / "part.stl")
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.body_count == 1
    assert mesh.volume > 0
    assert mesh.bounds[0, 2] == 0.0
    assert mesh.bounds[:, :2].sum(axis=0) == pytest.approx([0, 0], abs=1e-3)
    assert mesh.bounds[1, 2] == pytest.approx(23.0, abs=0.2)


def test_the_solid_shows_the_part_as_the_camera_saw_it():
    """Up in the frame is +y, right is +x: printed text can be read."""
    depth = np.full((H, W), 500.0)
    depth[5:12, 5:20] = 480.0  # in the upper left of the frame
    solid = fw.surface.solid_relief(cloud_of(depth))
    top = solid.vertices_mm[solid.vertices_mm[:, 2] > 15.0]
    assert top[:, 0].max() < 0 < top[:, 1].min()
    measured = solid.vertices_mm[~solid.filled]
    assert np.ptp(measured[:, 2]) == pytest.approx(20.0, abs=1e-3)
    assert np.isnan(solid.sigma_mm[solid.filled]).all()
    assert np.isfinite(solid.sigma_mm[~solid.filled]).all()


def test_points_in_other_coordinates_give_the_same_solid():
    cloud = cloud_of(dome_depth())
    T = np.array([[0.0, -1, 0, 30], [1, 0, 0, -7], [0, 0, 1, 900], [0, 0, 0, 1]])
    one, other = (fw.surface.solid_relief(c) for c in (cloud, cloud.transformed(T, frame="base")))
    assert np.allclose(one.vertices_mm, other.vertices_mm, atol=1e-3)


def test_what_is_no_relief_is_refused():
    cloud = cloud_of(dome_depth())
    with pytest.raises(fw.InputError, match="plate_mm: expected a thickness above 0, got 0"):
        fw.surface.solid_relief(cloud, plate_mm=0)
    few = np.full((H, W), np.nan)
    few[3:6, 3:6] = 500.0
    with pytest.raises(fw.InputError, match="expected 100 points or more, got 9"):
        fw.surface.solid_relief(cloud_of(few))


def test_the_command_writes_a_solid(tmp_path):
    fw.files.write_points(tmp_path / "part.npz", cloud_of(dome_depth()))
    said = run("mesh", tmp_path / "part.npz", "--plate", "2", "--out", tmp_path / "part.stl").stdout
    assert "not measured: the plate" in said
    assert read(tmp_path / "part.stl").is_watertight
