"""Profiles of maps along a line of pixels, and differences of two surfaces."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fringeworks.surface.height_map import height_map_points
from fringeworks.types import (
    CoordinateMap,
    DisplacementMap,
    FloatMap,
    HeightMap,
    InputError,
    Line,
    PointCloud,
    Profile,
    Reason,
    finite,
)

MIN_LATERAL_SINE = 1e-6
"""Smallest sine of the angle between a profile's line and the direction of heights. Below it,
rounding would determine the direction along which distances count."""


@dataclass(frozen=True)
class Spatial:
    """Places of pixels in space, and how they move with what was measured."""

    points: FloatMap
    """Points, (n, 3), mm; NaN where unmeasured."""
    by_value: FloatMap
    """Change of a point with its measured value, (n, 3): the direction of its ray."""
    sigma: FloatMap
    """Standard deviation of that value, (n,), mm."""
    up: FloatMap
    """Direction in which heights count, (3,)."""


@dataclass(frozen=True)
class _Samples:
    """Values of a map at pixels of a line, (n,)."""

    values: FloatMap
    sigma: FloatMap
    quantity: str
    unit: Literal["mm", "px"]
    spatial: Spatial | None = None


def profile(
    surface: HeightMap | PointCloud | DisplacementMap | CoordinateMap,
    line: Line,
    *,
    level: bool = False,
) -> Profile:
    """Sample a map along a straight line of its pixels.

    Parameters
    ----------
    surface : HeightMap, PointCloud, DisplacementMap or CoordinateMap
    line : ((x0, y0), (x1, y1))
        Column and row of the first and the last pixel, whole numbers.
    level : bool
        Count heights over the straight line in space from the first to the last measured sample,
        and distances along it.

    Returns
    -------
    Profile. Values are heights, displacements or coordinates as in the map; of points, the depth
    z. A sample is the pixel nearest to the line, halves rounded up.

    Raises
    ------
    InputError for pixels outside the map, one pixel twice, and a line that cannot be levelled.

    Notes
    -----
    Bilinear values would mix the two sides of a cliff, and their σ would depend on how neighbouring
    errors are correlated, which no map states. A point's σ along the ray is projected to the
    direction of heights. Levelling is a rotation in the plane of the line and that direction.

    Examples
    --------
    >>> values = np.array([[0.0, 2.0, 1.0]], np.float32)
    >>> flat = np.full((1, 3), 0.01, np.float32)
    >>> surface = HeightMap(values, flat, np.zeros((1, 3), np.uint8), "height", "mm", 2.0)
    >>> found = profile(surface, ((0, 0), (2, 0)))
    >>> found.along_mm.tolist(), found.values.tolist()
    ([0.0, 2.0, 4.0], [0.0, 2.0, 1.0])
    """
    if not isinstance(surface, (HeightMap, PointCloud, DisplacementMap, CoordinateMap)):
        raise InputError(f"profile: expected a map of pixels, got {type(surface).__name__}")
    pixels = pixels_on_line(line, surface.reason.shape)
    column, row = pixels.T
    direction = (pixels[-1] - pixels[0]) / np.linalg.norm(pixels[-1] - pixels[0])
    known = _samples(surface, row, column)
    reason = surface.reason[row, column]
    found: dict[str, Any] = {
        "values": np.where(reason == Reason.OK, known.values, np.nan).astype(np.float64),
        "sigma": np.where(reason == Reason.OK, known.sigma, np.nan).astype(np.float64),
        "along_mm": None,
        "quantity": known.quantity,
        "unit": known.unit,
    }
    if known.spatial is not None:
        found |= _in_space(known.spatial, level)
    elif level:
        raise InputError(
            f"level: expected points, or heights in mm with a known pitch, got {known.quantity}"
        )
    along_px = (pixels - pixels[0]) @ direction
    return Profile(pixels=pixels, along_px=along_px, reason=reason, levelled=level, **found)


def pixels_on_line(line: Line, shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Return the pixels nearest to a line, one per column or row, whichever are more.

    Parameters
    ----------
    line : ((x0, y0), (x1, y1))
        Column and row of the first and the last pixel.
    shape : (rows, columns)

    Returns
    -------
    (n, 2) int64 array of columns and rows; halves are rounded up.

    Raises
    ------
    InputError for anything but two different pixels of the frame.
    """
    ends: FloatMap = np.empty(0)
    with suppress(TypeError, ValueError):  # no pairs, or no numbers
        ends = np.array([[float(v) for v in end] for end in line])
    if ends.shape != (2, 2) or not finite(*ends.flat) or not (ends == np.floor(ends)).all():
        raise InputError(f"line: expected ((x0, y0), (x1, y1)) in whole pixels, got {line}")
    rows, columns = shape[:2]
    for x, y in ends:
        if not (0 <= x < columns and 0 <= y < rows):
            raise InputError(
                f"line: expected pixels of a frame of {columns} × {rows}, got ({x:g}, {y:g})"
            )
    a, b = ends.astype(np.float64)
    n = int(np.abs(b - a).max())
    if n == 0:
        raise InputError(f"line: expected two different pixels, got {line[0]} twice")
    place = np.arange(n + 1)[:, None] / n
    pixels: NDArray[np.int64] = np.floor(a + place * (b - a) + 0.5).astype(np.int64)
    return pixels


def _in_space(spatial: Spatial, level: bool) -> dict[str, Any]:
    """Distances in mm and, where levelled, heights over the line and their σ."""
    points = spatial.points
    measured = np.flatnonzero(np.isfinite(points[:, 0]))
    if len(measured) < 2:
        if level:
            raise InputError("level: expected two or more measured pixels on the line, got fewer")
        return {"along_mm": np.where(np.isfinite(points[:, 0]), 0.0, np.nan)}
    offset = points - points[measured[0]]
    chord = offset[measured[-1]]
    lateral = chord - (chord @ spatial.up) * spatial.up
    length = float(np.linalg.norm(lateral))
    if not length > MIN_LATERAL_SINE * np.linalg.norm(chord):
        raise InputError("line: expected ends side by side, got one behind the other")
    if not level:
        return {"along_mm": offset @ (lateral / length)}
    along = chord / np.linalg.norm(chord)
    up = spatial.up - (spatial.up @ along) * along
    up /= np.linalg.norm(up)
    return {
        "along_mm": offset @ along,
        "values": offset @ up,
        "sigma": np.abs(spatial.by_value @ up) * spatial.sigma,
        "quantity": "height over the line",
        "unit": "mm",
    }


def places(
    surface: HeightMap | PointCloud, row: NDArray[np.int64], column: NDArray[np.int64]
) -> Spatial:
    """Return the places of pixels in space.

    Parameters
    ----------
    surface : HeightMap or PointCloud
    row, column : (n,) int64 arrays

    Raises
    ------
    InputError for anything else, for displacements, and for heights whose pitch is unknown.
    """
    found = None
    if isinstance(surface, HeightMap | PointCloud):
        found = _samples(surface, row, column).spatial
    if found is None:
        got = getattr(surface, "quantity", type(surface).__name__)
        raise InputError(
            f"surface: expected points, or heights in mm with a known pitch, got {got}"
        )
    return found


def _samples(
    surface: HeightMap | PointCloud | DisplacementMap | CoordinateMap,
    row: NDArray[np.int64],
    column: NDArray[np.int64],
) -> _Samples:
    """Values, σ and places of pixels."""
    if isinstance(surface, PointCloud):
        # Rows of three are taken by one index in a third of the time.
        index = np.ravel_multi_index((row, column), surface.reason.shape)
        points = surface.xyz_mm.reshape(-1, 3).take(index, axis=0).astype(np.float64)
        points[surface.reason.take(index) != Reason.OK] = np.nan
        ray = points / np.sqrt(np.einsum("nc,nc->n", points, points))[:, None]
        along_ray = surface.sigma_mm.take(index).astype(np.float64)
        spatial = Spatial(points, ray, along_ray, np.array([0.0, 0.0, -1.0]))
        return _Samples(points[:, 2], along_ray * np.abs(ray[:, 2]), "depth z", "mm", spatial)
    if isinstance(surface, HeightMap):
        heights, sigma = surface.values[row, column], surface.sigma[row, column]
        places = _of_heights(surface, row, column)
        return _Samples(heights, sigma, surface.quantity, surface.unit, places)
    if isinstance(surface, DisplacementMap):
        values, sigma = surface.displacement_px, surface.sigma_px
        quantity = f"displacement along {surface.axis}"
    else:
        values, sigma = surface.coordinate_px, surface.sigma_px
        quantity = f"projector coordinate {surface.axis}"
    return _Samples(values[row, column], sigma[row, column], quantity, "px")


def _of_heights(
    surface: HeightMap, row: NDArray[np.int64], column: NDArray[np.int64]
) -> Spatial | None:
    """Places of pixels of a height map; None where it has no lateral scale in mm."""
    if surface.unit != "mm" or surface.pitch is None:
        return None
    by_height = np.zeros((len(row), 3))
    by_height[:, 2] = 1.0
    if surface.pupil is not None:
        foot_x, foot_y, distance = surface.pupil
        by_height[:, 0] = -(column - foot_x) * surface.pitch / distance
        by_height[:, 1] = (row - foot_y) * surface.pitch / distance
    points = organised_points(surface)[row, column]
    sigma = surface.sigma[row, column].astype(np.float64)
    return Spatial(points, by_height, sigma, np.array([0.0, 0.0, 1.0]))


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
    InputError for surfaces of two kinds, shapes, units, pitches or coordinates.

    Examples
    --------
    >>> flat = np.zeros((1, 2), np.float32)
    >>> ok = np.zeros((1, 2), np.uint8)
    >>> one = HeightMap(flat, flat + 3, ok, "height", "mm", 1.0)
    >>> other = HeightMap(flat + 1, flat + 4, ok, "height", "mm", 1.0)
    >>> values, sigma = difference(one, other)
    >>> values.tolist(), sigma.tolist()
    ([[1.0, 1.0]], [[5.0, 5.0]])
    """
    if isinstance(one, PointCloud) and isinstance(other, PointCloud):
        _check_alike("shape", one.shape, other.shape)
        _check_alike("frame", one.frame, other.frame)
        a, b = organised_points(one), organised_points(other)
        eye = np.zeros(3) if one.placement is None else one.placement.T_frame_camera[:3, 3]
        with np.errstate(all="ignore"):
            sight = a - eye
            values = np.einsum("hwk,hwk->hw", b - a, sight) / np.linalg.norm(sight, axis=-1)
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
