"""Differences of two surfaces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.rig.pinhole import rays
from fringeworks.simulate.standard import standard_rig


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


def test_differences_of_clouds_are_along_the_rays():
    one, other = plane_cloud(tilt=0.0), plane_cloud(2.0, tilt=0.0)
    values, sigma = fw.surface.difference(one, other)
    ray = np.linalg.norm(one.xyz_mm, axis=-1) / one.xyz_mm[..., 2]
    np.testing.assert_allclose(values, 2.0 * ray, atol=1e-4)
    np.testing.assert_allclose(sigma, np.hypot(0.02, 0.02), rtol=1e-6)


def test_differences_of_heights_and_refusals():
    values = np.array([[1.0, 2.0], [np.nan, 4.0]])
    reason = np.array([[0, 0], [9, 0]], np.uint8)
    one = fw.HeightMap(values, np.full((2, 2), 0.3), reason, "height", "mm", 1.0)
    other = replace(one, values=values + 1.0, sigma=np.full((2, 2), 0.4))
    found, sigma = fw.surface.difference(one, other)
    np.testing.assert_array_equal(found, [[1, 1], [np.nan, 1]])
    np.testing.assert_allclose(sigma, [[0.5, 0.5], [np.nan, 0.5]])
    with pytest.raises(fw.InputError, match="same pitch twice, got 1.0 and 2.0"):
        fw.surface.difference(one, replace(one, pitch=2.0))
    with pytest.raises(fw.InputError, match="two point clouds or two height maps"):
        fw.surface.difference(one, plane_cloud())
