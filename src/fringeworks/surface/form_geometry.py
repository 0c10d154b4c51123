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
from functools import cache
from typing import Any, Literal

import numpy as np

from fringeworks.types import BoolMap, FloatMap

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

    kind: BodyKind
    """The name that kernels know the body by."""
    points: int
    """Number of points through which a trial body is laid."""
    trials: int
    """Number of trial bodies for a start. With 30 % of the nearby points on the body, a plane or
    sphere is hit eight times on average. A cylinder needs 60 % for that: its trials are slow,
    because each compares 60 axes."""
    through: Callable[[FloatMap], FloatMap]
    """The bodies through points (t, k, 3), (m, values); m ≤ t, without those that the points do not
    determine."""
    parameters: Callable[[FloatMap, FloatMap, float], dict[str, Any]]
    """A body's parameters in mm, from the mean and the size of the cloud."""
    free: Callable[[FloatMap], FloatMap]
    """Orthogonal changes of a body's values that do not change the body, (k, values): lengths of
    directions, a place along an axis."""
    direction: slice | None
    """Where the direction of the normal or axis is among the values."""
    has_radius: bool
    """Whether the last value is a radius."""


def _squares(vectors: FloatMap) -> FloatMap:
    """Squared lengths of vectors (..., 3), (...)."""
    return np.asarray(np.einsum("...c,...c->...", vectors, vectors))


def _planes_through(p: FloatMap) -> FloatMap:
    n = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    size = np.linalg.norm(n, axis=1)
    good = size >= DEGENERATE
    n = n[good] / size[good, None]
    return np.column_stack((n, np.sum(n * p[good, 0], axis=1)))


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


def _plane_free(q: FloatMap) -> FloatMap:
    return q[None]


def _spheres_through(p: FloatMap) -> FloatMap:
    # From the first point, the centre has the same component along each other one as its half.
    sides = p[:, 1:] - p[:, :1]
    across = np.cross(sides[:, [1, 2, 0]], sides[:, [2, 0, 1]])
    volume = np.einsum("tc,tc->t", sides[:, 0], across[:, 0])
    # The determinant of the four equations for the centre and the radius is eight times as large.
    good = 8.0 * np.abs(volume) >= DEGENERATE
    sides, across, p = sides[good], across[good], p[good]
    centre = 0.5 * np.einsum("tk,tkc->tc", _squares(sides), across) / volume[good, None]
    square = _squares(centre)
    small = (square > 0) & (square <= MAX_RADIUS**2)
    return np.column_stack((p[small, 0] + centre[small], np.sqrt(square[small])))


def _sphere_parameters(q: FloatMap, mean: FloatMap, scale: float) -> dict[str, Any]:
    return {
        "centre_mm": [float(v) for v in mean + scale * q[:3]],
        "radius_mm": float(scale * abs(q[3])),
    }


def _sphere_free(q: FloatMap) -> FloatMap:
    return np.zeros((0, q.size))


@cache
def _axes() -> tuple[FloatMap, FloatMap, FloatMap]:
    """Directions that are tried for the axis of a cylinder, and two across each, (axes, 3)."""
    k = np.arange(CYLINDER_AXES)
    z = (k + 0.5) / CYLINDER_AXES
    r, a = np.sqrt(1 - z * z), k * GOLDEN_ANGLE_RAD
    axes = np.stack((r * np.cos(a), r * np.sin(a), z), axis=1)
    x = np.cross(axes, np.eye(3)[np.argmin(np.abs(axes), axis=1)])
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return axes, x, np.cross(axes, x)


def _cylinders_through(p: FloatMap) -> FloatMap:
    """Of many axis directions, the one along which six points lie best on a circle."""
    axes, x, y = _axes()
    seen = p @ x.T, p @ y.T
    u, v = (np.swapaxes(one, 1, 2) for one in seen)
    along_u, along_v, radius, good = _circles(u, v)
    off = np.hypot(u - along_u[..., None], v - along_v[..., None]) - radius[..., None]
    largest = np.where(good, np.abs(off).max(axis=2), np.inf)
    trial, axis = np.arange(len(p)), np.argmin(largest, axis=1)
    found = np.isfinite(largest[trial, axis])
    trial, axis = trial[found], axis[found]
    at = (trial, axis)
    foot = along_u[at][:, None] * x[axis] + along_v[at][:, None] * y[axis]
    return np.column_stack((foot, axes[axis], radius[at]))


def _circles(u: FloatMap, v: FloatMap) -> tuple[FloatMap, FloatMap, FloatMap, BoolMap]:
    """Centres and radii of the circles through points (..., k) by least squares of u² + v², and
    which of them are determined and not too large, (...)."""
    mean_u, mean_v = u.mean(axis=-1), v.mean(axis=-1)
    u, v = u - mean_u[..., None], v - mean_v[..., None]
    square = u * u + v * v
    uu, uv, vv = np.sum(u * u, axis=-1), np.sum(u * v, axis=-1), np.sum(v * v, axis=-1)
    right_u, right_v = 0.5 * np.sum(u * square, axis=-1), 0.5 * np.sum(v * square, axis=-1)
    determinant = uu * vv - uv * uv
    good = determinant >= DEGENERATE
    determinant = np.where(good, determinant, 1.0)
    x = (vv * right_u - uv * right_v) / determinant
    y = (uu * right_v - uv * right_u) / determinant
    # The points' mean is the origin here: mean square distances are those of the mean, and more.
    radius = np.sqrt(square.mean(axis=-1) + x * x + y * y)
    return x + mean_u, y + mean_v, radius, good & (radius <= MAX_RADIUS)


def _cylinder_parameters(q: FloatMap, mean: FloatMap, scale: float) -> dict[str, Any]:
    axis = q[3:6] / np.linalg.norm(q[3:6])
    foot = q[:3] - (q[:3] @ axis) * axis
    return {
        "point_mm": [float(v) for v in mean + scale * foot],
        "axis": [float(v) for v in axis],
        "radius_mm": float(scale * abs(q[6])),
    }


def _cylinder_free(q: FloatMap) -> FloatMap:
    still = np.zeros((2, 7))
    still[0, :3] = still[1, 3:6] = q[3:6]
    return still


GEOMETRIES: dict[str, FormGeometry] = {
    "plane": FormGeometry(
        kind="plane",
        points=3,
        trials=300,
        through=_planes_through,
        parameters=_plane_parameters,
        free=_plane_free,
        direction=slice(0, 3),
        has_radius=False,
    ),
    "sphere": FormGeometry(
        kind="sphere",
        points=4,
        trials=1000,
        through=_spheres_through,
        parameters=_sphere_parameters,
        free=_sphere_free,
        direction=None,
        has_radius=True,
    ),
    "cylinder": FormGeometry(
        kind="cylinder",
        points=6,
        trials=200,
        through=_cylinders_through,
        parameters=_cylinder_parameters,
        free=_cylinder_free,
        direction=slice(3, 6),
        has_radius=True,
    ),
}
"""The kinds of bodies that can be fitted, by name."""
