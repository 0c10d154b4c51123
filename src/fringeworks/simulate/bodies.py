"""Bodies of the virtual rig: exact shapes for rays to hit, each in its own coordinates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.types import NUMBERS, FloatMap, Frozen, InputError, unmasked

Albedo = float | Callable[[FloatMap, FloatMap], FloatMap]
"""One reflectance, 0…1, or a function of x and y in the body's coordinates, mm."""
MIN_DISTANCE = 1e-6
"""Smallest distance of a hit from the ray's origin, in lengths of the ray's direction: a nearer hit
is the surface that the ray starts on, to rounding."""


class Shape(Protocol):
    """The shape of a body, as rays see it."""

    def hit(self, origin: FloatMap, directions: FloatMap) -> FloatMap:
        """Return the distance to the first hit of each ray, (n,); ∞ where a ray hits nothing.

        Parameters
        ----------
        origin : (3,) or (n, 3) array, mm
        directions : (n, 3) array
            Of any length; distances count in lengths of the direction.
        """

    def normal(self, points: FloatMap, directions: FloatMap) -> FloatMap:
        """Return the unit normals at points (n, 3) that rays have hit, (n, 3), of either sign.

        ``directions`` are those of the rays, scaled so that they end at the points.
        """


@dataclass(frozen=True, eq=False, repr=False)
class Body(Frozen):
    """A shape with a pose and a reflectance."""

    shape: Shape
    T_world_body: FloatMap = field(default_factory=lambda: np.eye(4))
    """(4, 4), maps the body's coordinates to world coordinates, mm."""
    albedo: Albedo = 0.8
    """Reflectance, 0…1."""

    def hit(self, origin: FloatMap, directions: FloatMap) -> FloatMap:
        """Return distances as ``Shape.hit`` does, for rays in world coordinates."""
        R, t = self.T_world_body[:3, :3], self.T_world_body[:3, 3]
        return self.shape.hit((origin - t) @ R, directions @ R)

    def local(self, points: FloatMap) -> FloatMap:
        """Convert points (n, 3) from world coordinates to the body's, mm."""
        return np.asarray((points - self.T_world_body[:3, 3]) @ self.T_world_body[:3, :3])

    def normal(self, points: FloatMap, directions: FloatMap) -> FloatMap:
        """Return normals as ``Shape.normal`` does, in world coordinates."""
        R = self.T_world_body[:3, :3]
        return np.asarray(self.shape.normal(self.local(points), directions @ R) @ R.T)


def _first(*candidates: FloatMap) -> FloatMap:
    """The nearest of several hits; ∞ where all are behind the origin or NaN."""
    nearest = np.full(candidates[0].shape, np.inf)
    for t in candidates:
        np.minimum(nearest, np.where(t > MIN_DISTANCE, t, np.inf), out=nearest)
    return nearest


def _quadratic(a: FloatMap, b: FloatMap, c: FloatMap) -> tuple[FloatMap, FloatMap]:
    """Both roots of a t² + 2 b t + c, without cancellation; NaN where there are none."""
    root = np.sqrt(b * b - a * c)
    q = -(b + np.where(b >= 0, root, -root))
    return q / a, c / q


@dataclass(frozen=True)
class Plane:
    """The plane z = 0, within a rectangle or everywhere."""

    width_mm: float = np.inf
    """Side along x, mm."""
    height_mm: float = np.inf
    """Side along y, mm."""
    centre_mm: tuple[float, float] = (0.0, 0.0)
    """x and y of the rectangle's centre, mm."""

    def hit(self, origin: FloatMap, directions: FloatMap) -> FloatMap:
        with np.errstate(all="ignore"):
            t = -origin[..., 2] / directions[:, 2]
            x = origin[..., 0] + t * directions[:, 0] - self.centre_mm[0]
            y = origin[..., 1] + t * directions[:, 1] - self.centre_mm[1]
            inside = (np.abs(x) <= 0.5 * self.width_mm) & (np.abs(y) <= 0.5 * self.height_mm)
            return _first(np.where(inside, t, np.nan))

    def normal(self, points: FloatMap, directions: FloatMap) -> FloatMap:
        del directions
        return np.broadcast_to([0.0, 0.0, 1.0], points.shape)


@dataclass(frozen=True)
class Sphere:
    """A sphere about the origin."""

    radius_mm: float

    def hit(self, origin: FloatMap, directions: FloatMap) -> FloatMap:
        a = np.einsum("nk,nk->n", directions, directions)
        b = np.sum(origin * directions, axis=-1)
        c = np.sum(origin * origin, axis=-1) - self.radius_mm**2
        with np.errstate(all="ignore"):
            return _first(*_quadratic(a, b, np.asarray(c)))

    def normal(self, points: FloatMap, directions: FloatMap) -> FloatMap:
        del directions
        return np.asarray(points / np.linalg.norm(points, axis=-1, keepdims=True))


@dataclass(frozen=True)
class Cylinder:
    """A cylinder about the y axis, centred at the origin and closed by two discs."""

    radius_mm: float
    length_mm: float
    """Along y, mm."""

    def hit(self, origin: FloatMap, directions: FloatMap) -> FloatMap:
        half = 0.5 * self.length_mm
        dx, dy, dz = directions.T
        ox, oy, oz = origin[..., 0], origin[..., 1], origin[..., 2]
        with np.errstate(all="ignore"):
            c = np.asarray(ox * ox + oz * oz - self.radius_mm**2)
            sides = _quadratic(dx * dx + dz * dz, ox * dx + oz * dz, c)
            hits = [np.where(np.abs(oy + t * dy) <= half, t, np.nan) for t in sides]
            for end in (-half, half):
                t = (end - oy) / dy
                on_disc = (ox + t * dx) ** 2 + (oz + t * dz) ** 2 <= self.radius_mm**2
                hits.append(np.where(on_disc, t, np.nan))
            return _first(*hits)

    def normal(self, points: FloatMap, directions: FloatMap) -> FloatMap:
        del directions
        half = 0.5 * self.length_mm
        radial = np.hypot(points[:, 0], points[:, 2])
        on_disc = half - np.abs(points[:, 1]) < np.abs(self.radius_mm - radial)
        side = points * [1.0, 0.0, 1.0] / np.maximum(radial, 1e-12)[:, None]
        end = np.sign(points) * [0.0, 1.0, 0.0]
        return np.where(on_disc[:, None], end, side)


@dataclass(frozen=True)
class Box:
    """A box about the origin, with its sides along the axes."""

    size_mm: tuple[float, float, float]
    """Sides along x, y and z, mm."""

    def hit(self, origin: FloatMap, directions: FloatMap) -> FloatMap:
        half = 0.5 * np.asarray(self.size_mm)
        with np.errstate(all="ignore"):
            low, high = (-half - origin) / directions, (half - origin) / directions
            enter = np.minimum(low, high).max(axis=1)
            leave = np.maximum(low, high).min(axis=1)
            crossed = enter <= leave
            return _first(np.where(crossed, enter, np.nan), np.where(crossed, leave, np.nan))

    def normal(self, points: FloatMap, directions: FloatMap) -> FloatMap:
        del directions
        depth = np.abs(points) / (0.5 * np.asarray(self.size_mm))
        face = np.eye(3)[np.argmax(depth, axis=1)]
        return np.asarray(face * np.sign(points))


@dataclass(frozen=True)
class Paraboloid:
    """An open cap: z = h (1 − (x² + y²)/R²) for z ≥ 0."""

    radius_mm: float
    """R, radius of the rim at z = 0, mm."""
    height_mm: float
    """h, mm."""

    def hit(self, origin: FloatMap, directions: FloatMap) -> FloatMap:
        k = self.height_mm / self.radius_mm**2
        dx, dy, dz = directions.T
        ox, oy, oz = origin[..., 0], origin[..., 1], origin[..., 2]
        with np.errstate(all="ignore"):
            a = k * (dx * dx + dy * dy)
            b = k * (ox * dx + oy * dy) + 0.5 * dz
            c = np.asarray(k * (ox * ox + oy * oy) + oz - self.height_mm)
            # A ray along the axis meets the cap once, and the equation is linear.
            hits = [*_quadratic(a, b, c), np.where(a == 0, -0.5 * c / b, np.nan)]
            return _first(*(np.where(oz + t * dz >= 0, t, np.nan) for t in hits))

    def normal(self, points: FloatMap, directions: FloatMap) -> FloatMap:
        del directions
        slope = 2.0 * self.height_mm / self.radius_mm**2
        n = np.column_stack((slope * points[:, :2], np.ones(len(points))))
        return np.asarray(n / np.linalg.norm(n, axis=1, keepdims=True))


@dataclass(frozen=True, eq=False, repr=False)
class Mesh(Frozen):
    """A surface of triangles, as from a file or a height map.

    Raises
    ------
    InputError for vertices or faces of a wrong shape, vertices that are not finite, and faces with
    missing vertices.
    """

    vertices_mm: FloatMap
    """(n, 3), mm."""
    faces: NDArray[np.integer]
    """(m, 3), rows of ``vertices_mm``."""
    _tree: _core.Triangles = field(init=False, repr=False)

    def __post_init__(self) -> None:
        kinds = (
            unmasked(self.vertices_mm, "mesh").dtype.kind,
            unmasked(self.faces, "mesh").dtype.kind,
        )
        if kinds[0] not in NUMBERS or kinds[1] not in "ui":
            raise InputError("mesh: expected real vertices and faces of whole numbers, got others")
        vertices = np.ascontiguousarray(self.vertices_mm, np.float64)
        faces = np.ascontiguousarray(self.faces, np.uint32)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.isfinite(vertices).all():
            raise InputError(f"mesh: expected finite vertices (n, 3), got shape {vertices.shape}")
        if faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
            raise InputError(f"mesh: expected triangles (m ≥ 1, 3), got shape {faces.shape}")
        if faces.max() >= len(vertices):
            raise InputError(f"mesh: expected corners below {len(vertices)}, got {faces.max()}")
        object.__setattr__(self, "vertices_mm", vertices)
        object.__setattr__(self, "faces", faces)
        object.__setattr__(self, "_tree", _core.Triangles(vertices, faces))

    def hit(self, origin: FloatMap, directions: FloatMap) -> FloatMap:
        origins = np.broadcast_to(origin, directions.shape)
        distance, _ = self._tree.hit(
            np.ascontiguousarray(origins), np.ascontiguousarray(directions), MIN_DISTANCE
        )
        return np.asarray(distance)

    def normal(self, points: FloatMap, directions: FloatMap) -> FloatMap:
        # A ray that starts one length of the direction before the point hits the face it lies on;
        # hits nearer than half a length are other faces.
        face = self._tree.hit(points - directions, np.ascontiguousarray(directions), 0.5)[1]
        corners = self.vertices_mm[self.faces[np.maximum(face, 0)]]
        n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return np.asarray(n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-300))


def height_field(height_mm: FloatMap, pitch_mm: float) -> Mesh:
    """Make a mesh of a height map.

    Parameters
    ----------
    height_mm : (h, w) array
        Heights over z = 0, mm; no surface where NaN.
    pitch_mm : float > 0
        Distance of neighbouring pixels, mm.

    Returns
    -------
    Mesh centred at the origin, x along columns, y along rows.

    Raises
    ------
    InputError for a map smaller than 2 × 2, or a pitch that is not above 0.
    """
    height = np.asarray(height_mm, np.float64)
    if height.ndim != 2 or min(height.shape) < 2 or not pitch_mm > 0:
        raise InputError(
            f"height field: expected shape (h ≥ 2, w ≥ 2) and a pitch > 0 mm, got shape "
            f"{height.shape} and {pitch_mm} mm"
        )
    h, w = height.shape
    y, x = np.mgrid[:h, :w] - np.array([(h - 1) / 2.0, (w - 1) / 2.0])[:, None, None]
    index = np.arange(h * w).reshape(h, w)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    faces = np.vstack([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (b, d, c))])
    flat = height.ravel()
    faces = faces[np.isfinite(flat[faces]).all(axis=1)]
    vertices = np.column_stack((x.ravel() * pitch_mm, y.ravel() * pitch_mm, np.nan_to_num(flat)))
    return Mesh(vertices, faces)
