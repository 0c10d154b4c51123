"""Meshes of clouds: holes, fewer triangles, files that other programs read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.files.ply import read_ply
from tests.test_clean import H, W, cloud_of

trimesh = pytest.importorskip("trimesh")


def sphere_depth(radius_mm=60.0, centre_mm=560.0):
    """Depths of a sphere on the axis, as the camera of ``cloud_of`` sees them."""
    y, x = np.mgrid[:H, :W]
    square = ((x - W / 2) ** 2 + (y - H / 2) ** 2) / 500**2 + 1
    root = centre_mm**2 - square * (centre_mm**2 - radius_mm**2)
    return np.where(root > 0, (centre_mm - np.sqrt(np.maximum(root, 0))) / square, np.nan)


def test_a_hole_in_a_plane_is_filled_by_the_plane_and_marked():
    y, x = np.mgrid[:H, :W]
    u, v = (x - W / 2) / 500, (y - H / 2) / 500
    depth = 500.0 / (1 + 0.8 * u - 0.3 * v)
    depth[20:27, 30:41] = np.nan
    found = fw.cloud_mesh(cloud_of(depth), fill_px=77)
    assert np.count_nonzero(found.filled) == 77
    points = found.vertices_mm[found.filled]
    # The plane is z + 0.8 x − 0.3 y = 500.
    off = points @ [0.8, -0.3, 1.0] - 500.0
    assert np.abs(off).max() < 1e-3
    assert np.isnan(found.sigma_mm[found.filled]).all()
    assert np.isfinite(found.sigma_mm[~found.filled]).all()
    assert fw.cloud_mesh(cloud_of(depth), fill_px=76).filled is None


def test_holes_in_a_sphere_are_filled_close_to_it():
    depth = sphere_depth()
    depth[25:31, 35:41] = np.nan
    found = fw.cloud_mesh(cloud_of(depth), fill_px=40)
    points = found.vertices_mm[found.filled]
    assert len(points) == 36
    # The membrane over a square of side a = 7 mm lies 0.0737 a² · 2/R below the middle of a sphere
    # of R = 60 mm (Poisson's equation on a square): 0.12 mm.
    off = np.linalg.norm(points - [0, 0, 560.0], axis=1) - 60.0
    assert 0.09 < -off.min() < 0.13
    assert off.max() < 0.0


def test_a_hole_beside_a_step_in_depth_stays_open():
    depth = np.full((H, W), 500.0)
    depth[:, 40:] = 560.0
    depth[20:24, 38:42] = np.nan
    found = fw.cloud_mesh(cloud_of(depth), fill_px=100)
    assert found.filled is None
    z = found.vertices_mm[found.faces][..., 2]
    assert np.ptp(z, axis=1).max() < 1.0


def test_holes_at_the_frames_border_stay_open():
    depth = np.full((H, W), 500.0)
    depth[:5, :5] = np.nan
    assert fw.cloud_mesh(cloud_of(depth), fill_px=100).filled is None


def test_triangles_face_the_camera():
    found = fw.cloud_mesh(cloud_of(sphere_depth()))
    p, q, r = found.vertices_mm[found.faces].transpose(1, 0, 2)
    assert (np.sum(np.cross(q - p, r - p) * p, axis=1) < 0).all()


def test_fewer_triangles_keep_the_surface_within_their_sigma():
    pytest.importorskip("fast_simplification")
    full = fw.cloud_mesh(cloud_of(sphere_depth()))
    few = fw.decimate(full, 500)
    assert 400 < len(few.faces) <= 500
    off = np.abs(np.linalg.norm(few.vertices_mm - [0, 0, 560.0], axis=1) - 60.0)
    assert np.mean(off <= 2 * few.sigma_mm) > 0.9
    assert fw.decimate(full, len(full.faces)) is full
    with pytest.raises(fw.InputError, match="faces: expected 4 or more, got 3"):
        fw.decimate(full, 3)


@pytest.mark.parametrize("suffix", ["stl", "obj", "glb", "ply"])
def test_meshes_come_back_from_files(tmp_path, suffix):
    mesh = fw.cloud_mesh(cloud_of(sphere_depth()))
    brightness = np.linspace(10.0, 200.0, len(mesh.vertices_mm))
    mesh = replace(mesh, colour=np.column_stack((brightness, brightness / 2, brightness / 4)))
    path = tmp_path / f"part.{suffix}"
    fw.write_mesh(path, mesh)
    loaded = trimesh.load(path, force="mesh", process=False)
    wanted = mesh.vertices_mm[mesh.faces]
    if suffix == "glb":
        wanted = wanted * (0.001, -0.001, -0.001)
    np.testing.assert_allclose(loaded.vertices[loaded.faces], wanted, rtol=1e-5, atol=1e-6)
    if suffix != "stl":
        colour = loaded.visual.vertex_colors[:, :3].astype(float)
        # The brightest half percent of all values is white, and cut there.
        below = colour[:, 0] < 255
        assert np.mean(below) > 0.97
        assert np.abs(colour[:, 0] - 2 * colour[:, 1])[below].max() <= 2
        assert np.ptp(colour[:, 0]) > 200


def test_a_ply_keeps_sigma_and_what_was_filled(tmp_path):
    depth = sphere_depth()
    depth[25:31, 35:41] = np.nan
    mesh = fw.cloud_mesh(cloud_of(depth), fill_px=40)
    fw.write_mesh(tmp_path / "part.ply", mesh)
    table, comments = read_ply(tmp_path / "part.ply")
    assert (table["filled"].astype(bool) == mesh.filled).all()
    np.testing.assert_allclose(table["sigma"], mesh.sigma_mm)
    assert "fringeworks; mesh; unit mm" in comments


def test_what_is_no_mesh_is_refused(tmp_path):
    with pytest.raises(fw.InputError, match="expected neighbouring points, got none"):
        fw.cloud_mesh(cloud_of(np.full((H, W), np.nan)))
    with pytest.raises(fw.InputError, match="fill_px: expected 0 or more, got -1"):
        fw.cloud_mesh(cloud_of(np.full((H, W), 500.0)), fill_px=-1)
    mesh = fw.cloud_mesh(cloud_of(np.full((H, W), 500.0)))
    with pytest.raises(fw.FileProblem, match="expected"):
        fw.write_mesh(tmp_path / "part.step", mesh)
    with pytest.raises(fw.InputError, match="expected triangles to write, got none"):
        fw.write_mesh(tmp_path / "part.stl", replace(mesh, faces=np.empty((0, 3), np.uint32)))
    assert not list(tmp_path.iterdir())
