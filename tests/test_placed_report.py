"""Pictures, reports and meshes say in which coordinates points are."""

from __future__ import annotations

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.report.kinds.surface import cloud_sheet
from fringeworks.report.page.report import write_report
from fringeworks.report.viewer.content import content_of
from fringeworks.report.viewer.pack import pack_surface
from fringeworks.rig.pinhole import pose, rotation
from tests.commands import run
from tests.surfaces import H, W, cloud_of

PLACE = pose(rotation(np.array([0.4, -1.1, 0.3])), np.array([700.0, -200.0, 900.0]))


@pytest.fixture(scope="module")
def clouds():
    """A ball before the camera, and in the coordinates of a base."""
    y, x = np.mgrid[:H, :W]
    r2 = (x - 0.5 * W) ** 2 + (y - 0.5 * H) ** 2
    cloud = cloud_of(np.where(r2 < 25**2, 520.0 - np.sqrt(np.maximum(26.0**2 - r2, 0.0)), np.nan))
    return cloud, cloud.transformed(PLACE, frame="base")


def test_a_picture_names_the_coordinates_and_keeps_its_lamp(clouds):
    before, placed = (cloud_sheet(cloud, None) for cloud in clouds)
    assert "before the camera" in before.title
    assert "in coordinates of base" in placed.title
    assert before.panels[0].title == "depth z from the camera"
    assert placed.panels[0].title == "z in coordinates of base"
    # The camera sees the same shape, whatever the coordinates of its points are.
    np.testing.assert_allclose(placed.panels[1].values, before.panels[1].values, atol=1e-3)


def test_a_report_names_the_coordinates(clouds, tmp_path):
    for cloud, there in zip(clouds, (False, True), strict=True):
        write_report(tmp_path / "report.html", cloud)
        text = (tmp_path / "report.html").read_text(encoding="utf-8")
        assert (">coordinates<" in text and ">base<" in text) == there
        assert ("and reasons, in camera coordinates." in text) == there


def test_a_mesh_names_the_coordinates(clouds, tmp_path):
    for cloud, words in zip(clouds, ("camera coordinates", "coordinates of base"), strict=True):
        fw.files.write_points(tmp_path / "a.npz", cloud)
        done = run("mesh", "a.npz", "--out", "a.stl", cwd=tmp_path)
        assert f"the mesh is open, in {words};" in done.stdout


def test_a_viewer_looks_from_the_camera_and_says_so(clouds):
    """σ, edges and normals follow the rays of the camera, wherever the points are."""
    before, placed = (content_of(cloud, None, 1) for cloud in clouds)
    np.testing.assert_allclose(placed.points, before.points, atol=3e-4)
    assert placed.lattice is not None
    assert before.notes == ()
    (said,) = placed.notes
    assert said == "shown in camera coordinates; the points are in coordinates of base"
    headers = [pack_surface(cloud).header for cloud in clouds]
    assert "placed" not in headers[0]
    name, T = headers[1]["placed"]
    assert name == "base"
    np.testing.assert_allclose(np.reshape(T, (4, 4)), PLACE)
