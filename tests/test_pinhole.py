"""The pinhole model with lens distortion: against OpenCV, derivatives against differences."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from fringeworks import InputError
from fringeworks.rig.pinhole import (
    inverse,
    look_at,
    pose,
    project,
    project_with_derivatives,
    rays,
    rotation,
    skew,
    transform,
)
from fringeworks.types import Pinhole

DEVICE = Pinhole(640, 480, (700.0, 690.0), (320.0, 236.0), (-0.2, 0.1, 1e-3, -2e-3, 0.05))
K = np.array([[700.0, 0, 320.0], [0, 690.0, 236.0], [0, 0, 1]])
POINTS = np.random.default_rng(0).uniform([-150, -100, 400], [150, 100, 600], (50, 3))


def test_projection_equals_opencv():
    theirs, _ = cv2.projectPoints(POINTS, np.zeros(3), np.zeros(3), K, np.array(DEVICE.distortion))
    np.testing.assert_allclose(project(DEVICE, POINTS), theirs[:, 0], atol=1e-9)


def test_rays_come_back_to_their_pixels():
    pixels = np.random.default_rng(1).uniform([0, 0], [639, 479], (200, 2))
    np.testing.assert_allclose(project(DEVICE, 300.0 * rays(DEVICE, pixels)), pixels, atol=1e-7)


def test_points_behind_have_no_pixel():
    assert np.isnan(project(DEVICE, np.array([[0.0, 0.0, -5.0], [0.0, 0.0, 0.0]]))).all()


def test_folded_distortion_has_no_ray():
    folded = Pinhole(640, 480, (300.0, 300.0), (320.0, 240.0), (-0.9, 0.0, 0.0, 0.0, 0.0))
    found = rays(folded, np.array([[320.0, 240.0], [0.0, 0.0]]))
    assert np.isfinite(found[0]).all()
    assert np.isnan(found[1, :2]).all()


def test_derivatives_equal_differences():
    pixels, by_point, by_device = project_with_derivatives(DEVICE, POINTS)
    np.testing.assert_allclose(pixels, project(DEVICE, POINTS))
    for k in range(3):
        step = 1e-4 * np.eye(3)[k]
        slope = (project(DEVICE, POINTS + step) - project(DEVICE, POINTS - step)) / 2e-4
        np.testing.assert_allclose(by_point[:, :, k], slope, atol=1e-6)
    values = DEVICE.parameters
    for k in range(9):
        h = 1e-5
        sides = []
        for sign in (1, -1):
            v = values.copy()
            v[k] += sign * h
            moved = Pinhole(640, 480, tuple(v[:2]), tuple(v[2:4]), tuple(v[4:]))
            sides.append(project(moved, POINTS))
        np.testing.assert_allclose(by_device[:, :, k], (sides[0] - sides[1]) / (2 * h), atol=1e-5)


def test_rotations_equal_opencv():
    for vector in ([0.3, -0.2, 0.9], [0.0, 0.0, 1e-10], [np.pi - 1e-6, 0.0, 0.0]):
        np.testing.assert_allclose(
            rotation(np.array(vector)), cv2.Rodrigues(np.array(vector))[0], atol=1e-9
        )
    v, w = np.array([1.0, 2.0, 3.0]), np.array([-1.0, 0.5, 2.0])
    np.testing.assert_allclose(skew(v) @ w, np.cross(v, w))


def test_look_at_looks_at_the_target():
    eye, target = np.array([100.0, 5.0, 0.0]), np.array([0.0, 0.0, 500.0])
    T = look_at(eye, target)
    np.testing.assert_allclose(transform(T, eye), 0.0, atol=1e-9)
    seen = transform(T, target)
    np.testing.assert_allclose(seen[:2], 0.0, atol=1e-9)
    assert seen[2] > 0
    np.testing.assert_allclose(inverse(T) @ T, np.eye(4), atol=1e-12)
    with pytest.raises(InputError, match="not along down"):
        look_at(np.zeros(3), np.array([0.0, 1.0, 0.0]))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"width_px": 1}, "2 × 2 px"),
        ({"focal_px": (0.0, 1.0)}, "focal lengths > 0"),
        ({"principal_px": (np.nan, 1.0)}, "finite"),
    ],
)
def test_invalid_devices_are_refused(change, message):
    good = {"width_px": 64, "height_px": 48, "focal_px": (70.0, 70.0), "principal_px": (32.0, 24.0)}
    with pytest.raises(InputError, match=message):
        Pinhole(**(good | change))


def test_poses_compose():
    a, b = (
        pose(rotation(np.array([0.1, 0.2, 0.3])), np.array([1.0, 2, 3])),
        pose(np.eye(3), np.array([4.0, 5, 6])),
    )
    np.testing.assert_allclose(transform(a, transform(b, POINTS)), transform(a @ b, POINTS))
