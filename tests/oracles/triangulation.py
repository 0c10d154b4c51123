"""Triangulation of one pixel by a general minimiser: slow, but without derivatives of our own."""

from __future__ import annotations

import numpy as np
from scipy import optimize

from fringeworks.rig.pinhole import project, rays, transform
from fringeworks.types import Rig


def point_of(rig: Rig, pixel, coordinate, sigma) -> np.ndarray:
    """The point on a camera pixel's ray whose projector pixel fits best, (3,), mm.

    ``coordinate`` and ``sigma`` are (2,), px; an axis with NaN does not count.
    """
    ray = rays(rig.camera, np.asarray(pixel, float))
    used = np.isfinite(coordinate)

    def miss(depth):
        seen = project(rig.projector, transform(rig.T_projector_camera, depth[0] * ray))
        return ((seen - coordinate) / sigma)[used]

    starts = [
        optimize.least_squares(miss, [z], x_scale=100.0, xtol=1e-15, ftol=1e-15)
        for z in (350.0, 700.0)
    ]
    return min(starts, key=lambda s: s.cost).x[0] * ray


def sigma_of(rig: Rig, pixel, coordinate, sigma, covariance=None) -> tuple[float, float]:
    """Standard deviation along the ray by differences: from pixel noise alone, and in all, mm."""
    base = point_of(rig, pixel, coordinate, sigma)
    along = base / np.linalg.norm(base)
    noise = 0.0
    for k in range(2):
        if np.isfinite(coordinate[k]):
            step = np.zeros(2)
            step[k] = 1e-3
            ends = [point_of(rig, pixel, coordinate + s * step, sigma) for s in (1, -1)]
            noise += ((ends[0] - ends[1]) @ along / 2e-3 * sigma[k]) ** 2
    if covariance is None:
        return float(np.sqrt(noise)), float(np.sqrt(noise))
    by_parameter = np.empty(24)
    steps = np.sqrt(np.diag(covariance))
    for k in range(24):
        ends = [point_of(moved(rig, k, s * steps[k]), pixel, coordinate, sigma) for s in (1, -1)]
        by_parameter[k] = np.linalg.norm(ends[0]) - np.linalg.norm(ends[1])
        by_parameter[k] /= 2 * steps[k]
    calibration = by_parameter @ covariance @ by_parameter
    return float(np.sqrt(noise)), float(np.sqrt(noise + calibration))


def moved(rig: Rig, k: int, step: float) -> Rig:
    """A rig with one of its 24 parameters changed; those of ``RIG_PARAMETERS``."""
    from fringeworks.rig.calibration.parameters import pinhole_of
    from fringeworks.rig.pinhole import pose, rotation

    devices = [rig.camera, rig.projector]
    T = rig.T_projector_camera.copy()
    if k < 18:
        values = devices[k // 9].parameters
        values[k % 9] += step
        devices[k // 9] = pinhole_of(values, devices[k // 9])
    elif k < 21:
        turn = np.zeros(3)
        turn[k - 18] = step
        T = pose(rotation(turn) @ T[:3, :3], T[:3, 3])
    else:
        T[k - 21, 3] += step
    return Rig(devices[0], devices[1], T, rig.covariance, rig.residual_px)
