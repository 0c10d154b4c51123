"""Profiles between two pixels of a surface, and differences of two surfaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.surface.height_map import height_map_points
from fringeworks.types import FloatMap, Frozen, HeightMap, InputError, PointCloud, Reason

MIN_UPWARD_SINE = 1e-6
"""Smallest sine of the angle between a profile's line and the direction of heights. Below it,
rounding would determine the direction in which the profile's heights count."""


@dataclass(frozen=True, eq=False, repr=False)
class Profile(Frozen):
    """Heights of a surface over the straight line between two of its points."""

    pixels: FloatMap
    """Column and row of every sample, (n, 2), whole numbers."""
    along_mm: FloatMap
    """Distance of every sample from the first one along the line, (n,), mm; NaN: unmeasured."""
    height_mm: FloatMap
    """Height over the line, towards the camera, (n,), mm; 0 at both ends, NaN: unmeasured."""
    sigma_mm: FloatMap
    """Standard deviation of the samples along the camera's ray, (n,), mm; NaN where unmeasured."""
    length_mm: float
    """Distance of the two end points, mm."""


def organised_points(surface: PointCloud | HeightMap) -> FloatMap:
    """Return the points of a surface in the order of its pixels, (h, w, 3) float64.

    Unmeasured pixels are NaN. Points of a ``HeightMap`` are those of its files: x right, y up,
    z towards the camera. Raises InputError for heights whose pitch is unknown.
    """
    if isinstance(surface, PointCloud):
        measured = (surface.reason == Reason.OK)[..., None]
        return np.where(measured, surface.xyz_mm, np.nan).astype(np.float64)
    points = np.full((*surface.shape, 3), np.nan)
    found, _, index = height_map_points(surface)
    points[index >= 0] = found
    return points


def profile(
    surface: PointCloud | HeightMap, start_px: tuple[int, int], stop_px: tuple[int, int]
) -> Profile:
    """Sample a surface along the straight line between two measured pixels.

    Parameters
    ----------
    surface : PointCloud or HeightMap
        Heights need a known pitch.
    start_px, stop_px : (int, int)
        Column and row of the first and the last sample; both measured, and not the same.

    Returns
    -------
    Profile with one sample per column or row, whichever are more. A sample is the pixel that is
    nearest to the line. Heights count perpendicular to the line, in the plane that the line spans
    with the direction towards the camera (−z of a cloud, z of a height map).

    Raises
    ------
    InputError for pixels outside the surface or without a value, for one pixel twice, and for a
    line along the direction of heights.

    Examples
    --------
    >>> values = np.array([[0.0, 1.0, 0.0]], np.float32)
    >>> flat = np.full((1, 3), 0.01, np.float32)
    >>> surface = HeightMap(values, flat, np.zeros((1, 3), np.uint8), "height", "mm", 2.0)
    >>> found = profile(surface, (0, 0), (2, 0))
    >>> found.along_mm.tolist(), found.height_mm.tolist()
    ([0.0, 2.0, 4.0], [0.0, 1.0, 0.0])
    """
    points = organised_points(surface)
    sigma = surface.sigma_mm if isinstance(surface, PointCloud) else surface.sigma
    upward = np.array([0.0, 0.0, -1.0 if isinstance(surface, PointCloud) else 1.0])
    first, last = (
        _end(points, name, end) for name, end in (("start", start_px), ("stop", stop_px))
    )
    length = float(np.linalg.norm(last - first))
    if not length > 0:
        raise InputError(f"profile: expected two different points, got {start_px} and {stop_px}")
    along = (last - first) / length
    up = upward - (upward @ along) * along
    if np.linalg.norm(up) < MIN_UPWARD_SINE:
        raise InputError("profile: expected a line across the direction of heights, got one along")
    up /= np.linalg.norm(up)
    pixels = _line(start_px, stop_px)
    sampled = points[pixels[:, 1], pixels[:, 0]]
    found = np.where(np.isfinite(sampled[:, 0]), sigma[pixels[:, 1], pixels[:, 0]], np.nan)
    offset = sampled - first
    return Profile(pixels.astype(np.float64), offset @ along, offset @ up, found, length)


def difference(
    one: PointCloud | HeightMap, other: PointCloud | HeightMap
) -> tuple[FloatMap, FloatMap]:
    """Return the signed distances from one surface to another one, pixel by pixel.

    Parameters
    ----------
    one, other : two PointCloud or two HeightMap of one shape
        Taken with one camera in one place.

    Returns
    -------
    values : (h, w) float64
        Other minus one, in their unit: along the camera's ray for clouds (positive where the other
        lies farther away), in height for height maps. NaN where either has no value.
    sigma : (h, w) float64
        Standard deviation, with both surfaces taken as independent. Where they share a calibration
        their common error cancels, and this is an upper bound.

    Raises
    ------
    InputError for surfaces of two kinds, shapes, units or pitches.
    """
    if isinstance(one, PointCloud) and isinstance(other, PointCloud):
        _check_alike("shape", one.shape, other.shape)
        a, b = organised_points(one), organised_points(other)
        values = np.einsum("hwk,hwk->hw", b - a, a) / np.linalg.norm(a, axis=-1)
        sigmas = one.sigma_mm, other.sigma_mm
    elif isinstance(one, HeightMap) and isinstance(other, HeightMap):
        for name in ("shape", "unit", "quantity", "pitch"):
            _check_alike(name, getattr(one, name), getattr(other, name))
        values = other.values.astype(np.float64) - one.values
        sigmas = one.sigma, other.sigma
    else:
        raise InputError(
            "difference: expected two point clouds or two height maps, got "
            f"{type(one).__name__} and {type(other).__name__}"
        )
    sigma = np.hypot(sigmas[0].astype(np.float64), sigmas[1])
    return values, np.where(np.isfinite(values), sigma, np.nan)


def _check_alike(name: str, one: object, other: object) -> None:
    if one != other:
        raise InputError(f"difference: expected the same {name} twice, got {one} and {other}")


def _end(points: FloatMap, name: str, pixel: tuple[int, int]) -> FloatMap:
    column, row = pixel
    rows, columns = points.shape[:2]
    if not (0 <= column < columns and 0 <= row < rows):
        raise InputError(f"{name}: expected a pixel of {columns} × {rows}, got {pixel}")
    point = points[row, column]
    if not np.isfinite(point).all():
        raise InputError(f"{name}: expected a measured pixel, got {pixel}, which has no value")
    return np.asarray(point)


def _line(
    start: tuple[int, int], stop: tuple[int, int]
) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
    """The pixels nearest to a line, (n, 2); halves are rounded up."""
    a, b = np.array(start, np.float64), np.array(stop, np.float64)
    n = int(np.abs(b - a).max())
    place = np.arange(n + 1)[:, None] / n
    return np.floor(a + place * (b - a) + 0.5).astype(np.int64)
