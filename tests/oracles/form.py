"""Fits of bodies by SciPy's least squares, with differences as derivatives: the correct twin."""

from __future__ import annotations

import numpy as np
import scipy

from fringeworks.types import FloatMap


def distances(body: str, q: FloatMap, points: FloatMap) -> FloatMap:
    """Signed distances of points from a body of these values, straight from their definition."""
    if body == "plane":
        return np.asarray((points @ q[:3] - q[3]) / np.linalg.norm(q[:3]))
    if body == "sphere":
        return np.asarray(np.linalg.norm(points - q[:3], axis=1) - q[3])
    axis = q[3:6] / np.linalg.norm(q[3:6])
    return np.asarray(np.linalg.norm(np.cross(points - q[:3], axis), axis=1) - q[6])


def refined(
    body: str, start: FloatMap, points: FloatMap, weight: FloatMap
) -> tuple[FloatMap, FloatMap]:
    """Values of least squares, and their covariance where points err by 1."""
    solved = scipy.optimize.least_squares(
        lambda q: distances(body, q, points) * weight,
        start,
        jac="3-point",
        x_scale="jac",
        ftol=1e-14,
        xtol=1e-14,
        gtol=1e-14,
    )
    free = {"plane": 1, "sphere": 0, "cylinder": 2}[body]
    _, singular, rows = np.linalg.svd(solved.jac, full_matrices=False)
    basis = rows[: start.size - free] / singular[: start.size - free, None]
    return solved.x, basis.T @ basis
