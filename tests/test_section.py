"""Profiles between two pixels, and differences of two surfaces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.rig.pinhole import rays
from fringeworks.simulate import standard_rig


def plane_cloud(shift_mm=0.0, tilt=0.3):
    """A tilted plane, z = 500 + tilt x + shift, seen by a small camera."""
    camera = standard_rig(scale=0.05).camera
    h, w = camera.shape
    row, column = np.indices((h, w)).astype(float)
    directions = rays(camera, np.stack((column, row), axis=-1))
    z = (500.0 + shift_mm) / (1.0 - tilt * directions[..., 0])
    sigma = np.full((h, w), 0.02, np.float32)
    xyz = (directions * z[..., None]).astype(np.float32)
    return fw.PointCloud(xyz, sigma, sigma, np.zeros((h, w), np.uint8))


def test_a_plane_has_a_straight_profile_of_its_true_length():
    cloud = plane_cloud()
    found = fw.profile(cloud, (3, 40), (60, 5))
    ends = cloud.xyz_mm[40, 3].astype(float), cloud.xyz_mm[5, 60].astype(float)
    assert found.length_mm == pytest.approx(np.linalg.norm(ends[1] - ends[0]), abs=1e-9)
    assert len(found.along_mm) == 58
    assert found.along_mm[0] == pytest.approx(0, abs=1e-9)
    assert found.along_mm[-1] == pytest.approx(found.length_mm, abs=1e-9)
    # Pixels lie up to half a pixel beside the line; on a plane that moves them along it only.
    assert np.abs(found.height_mm).max() < 1e-3 + 0.3 * 1.6


def test_heights_count_towards_the_camera_and_gaps_stay_gaps():
    cloud = plane_cloud(tilt=0.0)
    xyz, reason = cloud.xyz_mm.copy(), cloud.reason.copy()
    xyz[20, 30] *= 499.0 / 500.0
    reason[20, 40] = fw.Reason.SHADOW
    found = fw.profile(replace(cloud, xyz_mm=xyz, reason=reason), (10, 20), (50, 20))
    assert found.height_mm[20] == pytest.approx(1.0, abs=1e-3)
    assert np.isnan(found.height_mm[30])
    assert np.isnan(found.sigma_mm[30])
    assert np.isfinite(np.delete(found.height_mm, 30)).all()
    assert found.sigma_mm[0] == np.float32(0.02)


@pytest.mark.parametrize(
    ("start", "stop", "message"),
    [
        ((3, 4), (3, 4), "two different points"),
        ((-1, 4), (3, 4), "start: expected a pixel of 64 × 51"),
        ((3, 4), (64, 4), "stop: expected a pixel"),
        ((40, 20), (3, 4), "start: expected a measured pixel"),
    ],
)
def test_a_profile_refuses(start, stop, message):
    cloud = plane_cloud()
    reason = cloud.reason.copy()
    reason[20, 40] = fw.Reason.SHADOW
    with pytest.raises(fw.InputError, match=message):
        fw.profile(replace(cloud, reason=reason), start, stop)


def test_a_line_along_the_heights_has_no_profile():
    values = np.array([[0.0, 5.0]])
    # The pupil straight above: both pixels stand on one ray.
    surface = fw.HeightMap(values, values + 0.1, np.zeros((1, 2), np.uint8), "height", "mm", 1e-9)
    with pytest.raises(fw.InputError, match="across the direction of heights"):
        fw.profile(surface, (0, 0), (1, 0))


def test_differences_of_clouds_are_along_the_rays():
    one, other = plane_cloud(tilt=0.0), plane_cloud(2.0, tilt=0.0)
    values, sigma = fw.difference(one, other)
    ray = np.linalg.norm(one.xyz_mm, axis=-1) / one.xyz_mm[..., 2]
    np.testing.assert_allclose(values, 2.0 * ray, atol=1e-4)
    np.testing.assert_allclose(sigma, np.hypot(0.02, 0.02), rtol=1e-6)


def test_differences_of_heights_and_refusals():
    values = np.array([[1.0, 2.0], [np.nan, 4.0]])
    reason = np.array([[0, 0], [9, 0]], np.uint8)
    one = fw.HeightMap(values, np.full((2, 2), 0.3), reason, "height", "mm", 1.0)
    other = replace(one, values=values + 1.0, sigma=np.full((2, 2), 0.4))
    found, sigma = fw.difference(one, other)
    np.testing.assert_array_equal(found, [[1, 1], [np.nan, 1]])
    np.testing.assert_allclose(sigma, [[0.5, 0.5], [np.nan, 0.5]])
    with pytest.raises(fw.InputError, match="same pitch twice, got 1.0 and 2.0"):
        fw.difference(one, replace(one, pitch=2.0))
    with pytest.raises(fw.InputError, match="two point clouds or two height maps"):
        fw.difference(one, plane_cloud())
