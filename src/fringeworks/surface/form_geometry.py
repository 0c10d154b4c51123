"""Geometry of planes, spheres and cylinders: through a few points, distances, parameters in mm.

Bodies are fitted in scaled coordinates: the mean of the points is the origin, and the root mean
square distance from it, "the size of the cloud", is 1. A body is a vector of numbers there:

- plane: normal (3), offset
- sphere: centre (3), radius
- cylinder: a point of the axis (3), direction of the axis (3), radius
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from fringeworks.types import FloatMap

BodyKind = Literal["plane", "sphere", "cylinder"]
MAX_RADIUS = 5.0
"""Largest radius of a sphere or cylinder, in sizes of the cloud. With a noisy cloud, a larger
one cannot be distinguished from a plane. Empirical."""
DEGENERATE = 1e-9
"""Determinant or cross product below which a few points do not determine a body, in scaled
coordinates: points on a line or a plane, to rounding."""
CYLINDER_AXES = 60
"""Number of axis directions that are tried for a cylinder through a few points, evenly over the
half sphere: 18° apart. The fit afterwards converges from such a start."""
GOLDEN_ANGLE_RAD = 2.399963
"""Angle between consecutive points of a Fibonacci lattice, π (3 − √5): it spreads them evenly."""


@dataclass(frozen=True, eq=False)
class FormGeometry:
    """What a fit needs to know about a kind of body."""

    points: int
    """Number of points through which a trial body is laid."""
    trials: int
    """Number of trial bodies for a start. With 30 % of the nearby points on the body, a plane or
    sphere is hit eight times on average. A cylinder needs 60 % for that: its trials are slow,
    because each compares 60 axes."""
    through: Callable[[FloatMap], FloatMap | None]
    """The body through points (k, 3); None where they do not determine one."""
    distance: Callable[[FloatMap, FloatMap], FloatMap]
    """Signed distances of points (n, 3) from a body, (n,): out of a sphere or cylinder, along the
    normal of a plane."""
    parameters: Callable[[FloatMap, FloatMap, float], dict[str, Any]]
    """A body's parameters in mm, from the mean and the size of the cloud."""
    free: int
    """Number of its values that do not change the body: lengths of directions, a place along an
    axis."""
    direction: slice | None
    """Where the direction of the normal or axis is among the values."""
    has_radius: bool
    """Whether the last value is a radius."""


def _plane_through(p: FloatMap) -> FloatMap | None:
    n = np.cross(p[1] - p[0], p[2] - p[0])
    size = np.linalg.norm(n)
    return None if size < DEGENERATE else np.array([*(n / size), n @ p[0] / size])


def _plane_distance(q: FloatMap, p: FloatMap) -> FloatMap:
    size = np.linalg.norm(q[:3])
    return np.asarray((p @ q[:3] - q[3]) / size)


def _plane_parameters(q: FloatMap, mean: FloatMap, scale: float) -> dict[str, Any]:
    n = q[:3] / np.linalg.norm(q[:3])
    if n[2] > 0:
        n = -n  # towards the camera
        q = -q
    offset = q[3] / np.linalg.norm(q[:3])
    return {
        "point_mm": [float(v) for v in mean + scale * offset * n],
        "normal": [float(v) for v in n],
    }


def _sphere_through(p: FloatMap) -> FloatMap | None:
    A = np.column_stack((2.0 * p, np.ones(4)))
    if abs(np.linalg.det(A)) < DEGENERATE:
        return None
    s = np.linalg.solve(A, np.sum(p * p, axis=1))
    square = s[3] + s[:3] @ s[:3]
    return None if square <= 0 or square > MAX_RADIUS**2 else np.array([*s[:3], np.sqrt(square)])


def _sphere_distance(q: FloatMap, p: FloatMap) -> FloatMap:
    return np.asarray(np.linalg.norm(p - q[:3], axis=1) - q[3])


def _sphere_parameters(q: FloatMap, mean: FloatMap, scale: float) -> dict[str, Any]:
    return {
        "centre_mm": [float(v) for v in mean + scale * q[:3]],
        "radius_mm": float(scale * abs(q[3])),
    }


def _cylinder_through(p: FloatMap) -> FloatMap | None:
    """Of many axis directions, the one along which six points lie best on a circle."""
    best: tuple[float, FloatMap] | None = None
    for k in range(CYLINDER_AXES):
        z = (k + 0.5) / CYLINDER_AXES
        r, a = np.sqrt(1 - z * z), k * GOLDEN_ANGLE_RAD
        q = _circle_along(p, np.array([r * np.cos(a), r * np.sin(a), z]))
        if q is None:
            continue
        largest = float(np.abs(_cylinder_distance(q, p)).max())
        if best is None or largest < best[0]:
            best = (largest, q)
    return None if best is None else best[1]


def _circle_along(p: FloatMap, axis: FloatMap) -> FloatMap | None:
    """The cylinder with this axis direction through points, by least squares; None if too large."""
    x = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    x /= np.linalg.norm(x)
    y = np.cross(axis, x)
    u, v = p @ x, p @ y
    A = np.column_stack((2 * u, 2 * v, np.ones(len(p))))
    s, _, rank, _ = np.linalg.lstsq(A, u * u + v * v, rcond=None)
    square = s[2] + s[0] ** 2 + s[1] ** 2
    if rank < 3 or square <= 0 or square > MAX_RADIUS**2:
        return None
    return np.array([*(s[0] * x + s[1] * y), *axis, np.sqrt(square)])


def _cylinder_distance(q: FloatMap, p: FloatMap) -> FloatMap:
    axis = q[3:6] / np.linalg.norm(q[3:6])
    return np.asarray(np.linalg.norm(np.cross(p - q[:3], axis), axis=1) - q[6])


def _cylinder_parameters(q: FloatMap, mean: FloatMap, scale: float) -> dict[str, Any]:
    axis = q[3:6] / np.linalg.norm(q[3:6])
    foot = q[:3] - (q[:3] @ axis) * axis
    return {
        "point_mm": [float(v) for v in mean + scale * foot],
        "axis": [float(v) for v in axis],
        "radius_mm": float(scale * abs(q[6])),
    }


GEOMETRIES: dict[str, FormGeometry] = {
    "plane": FormGeometry(
        3, 300, _plane_through, _plane_distance, _plane_parameters, 1, slice(0, 3), False
    ),
    "sphere": FormGeometry(
        4, 1000, _sphere_through, _sphere_distance, _sphere_parameters, 0, None, True
    ),
    "cylinder": FormGeometry(
        6, 200, _cylinder_through, _cylinder_distance, _cylinder_parameters, 2, slice(3, 6), True
    ),
}
"""The kinds of bodies that can be fitted, by name."""
