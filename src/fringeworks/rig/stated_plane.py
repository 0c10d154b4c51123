"""A plane that a caller states, and how it may differ from the one that the camera sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fringeworks.rig.pinhole import project, rays, transform
from fringeworks.rig.point_errors import places_share, root_of
from fringeworks.rig.ray_depth import (
    PRINCIPAL_POINTS,
    field_sigmas,
    has_structure,
    projector_by_parameters,
)
from fringeworks.types import Axis, FloatMap, InputError, Rig

PLANE_NUMBERS = 4
"""a, b, c and d of a x + b y + c z = d."""
MODES = 6
"""Ways in which the real surface may differ: an offset, two tilts, and three bows of degree 2. A
sheet or board that is taken for a plane is bent, too, and a bow looks like an offset where
perspective alone tells the distance."""


@dataclass(frozen=True, eq=False)
class StatedPlane:
    """A plane in front of a rig, as a surface that a few modes displace along its normal.

    A mode of 1 mm displaces the surface by 1 mm in its middle (offset) or at the edges of what the
    camera sees of it (tilts and bows).
    """

    rig: Rig
    axis: Axis
    """Axis of the projector."""
    normal: FloatMap
    """Unit normal that points away from the camera, (3,)."""
    distance_mm: float
    """Distance of the plane from the camera's pupil, > 0, mm."""
    middle_mm: FloatMap
    """Middle of what the camera sees of the plane, (3,), mm."""
    along: FloatMap
    """Unit vectors in the plane, along the camera's x and y, (2, 3)."""
    half_mm: FloatMap
    """Distances from the middle to the edges along these, (2,), mm."""

    @classmethod
    def of(cls, rig: Rig, plane: Sequence[float], axis: Axis) -> StatedPlane:
        """Build it from a, b, c, d; ``InputError`` for what is no plane before the camera."""
        a, b, c, d = checked_plane(plane)
        size = np.sign(d) * float(np.linalg.norm((a, b, c)))
        normal, distance = np.array((a, b, c)) / size, d / size
        x = np.array([1.0, 0.0, 0.0]) - normal[0] * normal
        if np.linalg.norm(x) < np.sqrt(0.5):  # the camera's x is closer to the normal than 45°
            x = np.array([0.0, 0.0, 1.0]) - normal[2] * normal
        x = x / np.linalg.norm(x)
        along = np.stack((x, np.cross(normal, x)))
        h, w = rig.camera.shape
        corners = np.array([(0, 0), (w - 1, 0), (0, h - 1), (w - 1, h - 1)], np.float64)
        ray = rays(rig.camera, np.vstack((corners, corners.mean(axis=0))))
        with np.errstate(all="ignore"):
            points = ray * (distance / (ray @ normal))[:, None]
        if not (np.isfinite(points).all() and (points[:, 2] > 0).all()):
            # The camera sees the plane's horizon: the distance is the only length there is.
            points = np.vstack((distance * (normal + along), distance * normal))
        middle = points[-1]
        half = np.abs((points - middle) @ along.T).max(axis=0)
        return cls(rig, axis, normal, distance, middle, along, half)

    def shapes(self, pixels: FloatMap) -> FloatMap:
        """Displacement along the normal by 1 mm of each mode, (n, MODES), at pixels (n, 2)."""
        points = self._points(pixels, 0.0)
        x, y = ((points - self.middle_mm) @ self.along.T / self.half_mm).T
        return np.stack((np.ones_like(x), x, y, x * x, x * y, y * y), axis=-1)

    def _points(self, pixels: FloatMap, moved_mm: FloatMap | float) -> FloatMap:
        """Points of the surface on the rays of pixels, (n, 3), mm; NaN behind the camera."""
        ray = rays(self.rig.camera, pixels)
        with np.errstate(all="ignore"):
            depth = (self.distance_mm + moved_mm) / (ray @ self.normal)
            return np.asarray(ray * np.where(depth > 0, depth, np.nan)[:, None])

    def coordinates(self, pixels: FloatMap, modes_mm: FloatMap | None = None) -> FloatMap:
        """Projector coordinates that light the surface at pixels (n, 2), both axes, (n, 2), px."""
        moved = 0.0 if modes_mm is None else self.shapes(pixels) @ modes_mm
        with np.errstate(all="ignore"):
            points = self._points(pixels, moved)
            return project(self.rig.projector, transform(self.rig.T_projector_camera, points))

    def along_axis(self, pixels: FloatMap, modes_mm: FloatMap | None = None) -> FloatMap:
        """The coordinates along the axis, (n,), px."""
        return self.coordinates(pixels, modes_mm)[:, 0 if self.axis == "x" else 1]

    def per_mm(self, pixels: FloatMap, modes_mm: FloatMap) -> FloatMap:
        """Derivative of these by a displacement along the normal, (n,), px/mm."""
        step = 1e-4 * self.distance_mm
        offset = step * np.eye(MODES)[0]
        ends = [self.along_axis(pixels, modes_mm + sign * offset) for sign in (1.0, -1.0)]
        return np.asarray((ends[0] - ends[1]) / (2.0 * step))

    def rig_errors(self, pixels: FloatMap) -> FloatMap:
        """Errors of these by the rig's calibration, as independent parts of variance 1, (n, k)."""
        if self.rig.covariance is None:
            return np.zeros((len(pixels), 0))
        w = 1.0 / self._points(pixels, 0.0)[:, 2]
        by = projector_by_parameters(self.rig, pixels, w)[1][:, 0 if self.axis == "x" else 1]
        parts = by @ root_of(self.rig.covariance)
        if has_structure(self.rig) and len(pixels):
            variance = np.full(len(pixels), self.rig.structure_px**2)
            sigmas = field_sigmas(self.rig, pixels, w)
            for columns, sigma in zip(PRINCIPAL_POINTS, sigmas, strict=True):
                variance += np.sum((by[:, columns] * sigma) ** 2, axis=1)
            parts = np.hstack((parts, np.sqrt(variance)[:, None] * places_share(pixels)))
        return np.asarray(parts)

    def tilt_deg(self, modes_mm: FloatMap) -> float:
        """Angle by which modes turn the plane, degrees."""
        return float(np.degrees(np.arctan(np.linalg.norm(modes_mm[1:3] / self.half_mm))))


def checked_plane(plane: Sequence[float]) -> list[float]:
    """Four numbers that are a plane; ``InputError`` otherwise."""
    values = [float(v) for v in plane]
    good = len(values) == PLANE_NUMBERS and bool(np.isfinite(values).all())
    if not good or not any(values[:3]) or values[3] == 0:
        raise InputError(
            "plane: expected four numbers a, b, c, d of a x + b y + c z = d that is not through "
            f"the camera, got {list(plane)}"
        )
    return values
