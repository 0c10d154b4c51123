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


TINY_LENGTH = 1e-300


def _plane_rows(q: FloatMap, p: FloatMap) -> FloatMap:
    size = np.linalg.norm(q[:3])
    n = q[:3] / size
    rows = np.empty((len(p), 5))
    rows[:, 4] = p @ n - q[3] / size
    rows[:, :3] = (p - rows[:, 4:] * n) / size
    rows[:, 3] = -1.0 / size
    return rows


def _sphere_rows(q: FloatMap, p: FloatMap) -> FloatMap:
    to_centre = q[:3] - p
    size = np.sqrt(squares(to_centre))
    rows = np.empty((len(p), 5))
    np.divide(to_centre, np.maximum(size, TINY_LENGTH)[:, None], out=rows[:, :3])
    rows[:, 3] = -1.0
    rows[:, 4] = size - q[3]
    return rows


def _cylinder_rows(q: FloatMap, p: FloatMap) -> FloatMap:
    length = np.linalg.norm(q[3:6])
    axis = q[3:6] / length
    inwards = q[:3] - p
    along = inwards @ axis
    inwards -= along[:, None] * axis
    size = np.sqrt(squares(inwards))
    rows = np.empty((len(p), 8))
    np.divide(inwards, np.maximum(size, TINY_LENGTH)[:, None], out=rows[:, :3])
    np.multiply(rows[:, :3], (along / -length)[:, None], out=rows[:, 3:6])
    rows[:, 6] = -1.0
    rows[:, 7] = size - q[6]
    return rows


ROWS = {"plane": _plane_rows, "sphere": _sphere_rows, "cylinder": _cylinder_rows}
"""Derivatives of the distances from points (n, 3) by a body's values, and the distances as the last
column, (n, values + 1)."""


def squares(vectors):
    """Squared lengths of vectors."""
    return np.sum(vectors**2, axis=-1)


def moments(body, q, points, weight):
    """Sums of the products of all pairs of columns of the weighted rows."""
    rows = ROWS[body](q, points) * weight[:, None]
    return rows.T @ rows
