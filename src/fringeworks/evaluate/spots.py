"""Dents and bumps: places where a part surely deviates from its model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.evaluate.deviation import Deviation
from fringeworks.statistics.quantiles import robust_sigma
from fringeworks.types import FloatMap, Frozen, InputError, Reason

CELL_SPACINGS = 3.0
"""Side of a cell, in distances of neighbouring points: about nine points average the noise."""
LEAST_POINTS = 4
"""Smallest number of points of a cell: fewer have no median that a single outlier cannot move."""
SURE_SIGMAS = 5.0
"""Median of a cell, in its standard deviations, from which on it surely deviates: of normal errors
one cell in two million does."""
SIGMAS_OF_MEDIAN = 1.2533
"""Standard deviation of a median over that of a mean, for normal errors: √(π/2)."""
LEAST_CELLS = 3
"""Smallest number of neighbouring cells of a spot: mixtures on edges make single ones."""
PEAK_RADIUS = 0.7
"""Radius within which the depth is fitted, over that of a disc with the area of the spot."""
LEAST_FITTED = 12
"""Smallest number of points for the depth: three times the parameters of the fit."""
BLUR_SPACINGS = 1.0
"""Standard deviation of the blur of camera and projector, in distances of neighbouring points. A
small dent is measured shallower by twice its curvature times the square of this, which counts as
its uncertainty. On the virtual rig, a dent of 0.1 mm and ten pixels lost 0.007 mm."""
FAR_SIGMAS = 4.0
"""Residual, in robust standard deviations, from which on a point does not count for the depth."""


@dataclass(frozen=True, eq=False, repr=False)
class Spot(Frozen):
    """A place where a part surely deviates from its model."""

    place_mm: FloatMap
    """(3,), where it is deepest or highest, in the model's coordinates, mm."""
    depth_mm: float
    """Deviation there, mm: negative for a dent, positive for a bump."""
    sigma_mm: float
    """Standard deviation of the depth, mm: scatter of the points, errors in common, and blur."""
    area_mm2: float
    """Area of the spot, mm², as far as it surely deviates."""
    points: int
    """Number of points on it."""


def find_spots(
    found: Deviation, *, least_mm: float = 0.0, cell_mm: float | None = None
) -> tuple[Spot, ...]:
    """Find dents and bumps of a part.

    Parameters
    ----------
    found : Deviation
        With σ.
    least_mm : float ≥ 0
        Smallest deviation of a spot, mm.
    cell_mm : float > 0, optional
        Side of the cells in which distances are averaged, mm; by default three distances of
        neighbouring points. A spot covers three cells or more.

    Returns
    -------
    tuple of Spot, the deepest or highest first; empty where there is none.

    Raises
    ------
    InputError for a deviation without σ, and limits out of their range.

    Notes
    -----
    The median of a cell has the standard deviation √(π/2) s/√n of its noise s, and the errors in
    common of its points. Neighbouring cells that deviate by five of these to one side are a spot.
    Its depth is the extreme of a + b u + c v + d (u² + v²), fitted to the points near its middle.
    """
    if not least_mm >= 0 or (cell_mm is not None and not cell_mm > 0):
        raise InputError(
            f"spots: expected a least deviation ≥ 0 and a cell > 0 mm, got {least_mm} and {cell_mm}"
        )
    ok = found.reason == Reason.OK
    distance, sigma, noise = (
        np.asarray(v[ok], np.float64) for v in (found.distance_mm, found.sigma_mm, found.noise_mm)
    )
    if not np.isfinite(sigma).all():
        raise InputError("spots: expected distances with σ, got points without")
    points, normals = (np.asarray(v[ok], np.float64) for v in (found.points_mm, found.normals))
    common = np.sqrt(np.maximum(sigma**2 - noise**2, 0.0))
    spacing = _spacing(points)
    side = cell_mm or CELL_SPACINGS * spacing
    cells, number = np.unique(np.floor(points / side).astype(int), axis=0, return_inverse=True)
    number = number.reshape(-1)
    middle, spread, count = _medians(number, distance, noise, len(cells))
    shared = np.sqrt(np.bincount(number, common**2) / count)
    sure = (count >= LEAST_POINTS) & (np.abs(middle) > least_mm)
    sure &= np.abs(middle) > SURE_SIGMAS * np.hypot(spread, shared)
    spots = []
    for sign in (-1.0, 1.0):
        for group in _groups(cells, np.flatnonzero(sure & (np.sign(middle) == sign))):
            inside = np.isin(number, group)
            area = float(len(group)) * side**2
            spot = _spot(points, normals, distance, common, inside, sign, area, spacing)
            spots.append(spot)
    return tuple(sorted(spots, key=lambda spot: -abs(spot.depth_mm)))


def _spacing(points: FloatMap) -> float:
    some = points[:: max(1, len(points) // 2000)]
    return float(np.median(scipy.spatial.cKDTree(points).query(some, k=2)[0][:, 1]))


def _medians(
    number: NDArray[np.intp], distance: FloatMap, noise: FloatMap, cells: int
) -> tuple[FloatMap, FloatMap, NDArray[np.intp]]:
    """Median of every cell, its standard deviation by noise, and the number of its points."""
    order = np.lexsort((distance, number))
    count = np.bincount(number, minlength=cells)
    first = np.cumsum(count) - count
    ordered = distance[order]
    middle = 0.5 * (ordered[first + (count - 1) // 2] + ordered[first + count // 2])
    spread = np.sqrt(np.bincount(number, noise**2, cells)) / count
    return middle, SIGMAS_OF_MEDIAN * spread, count


def _groups(cells: NDArray[np.intp], some: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Groups of neighbouring cells, three or more each."""
    if not some.size:
        return []
    tree = scipy.spatial.cKDTree(cells[some].astype(np.float64))
    pairs = tree.query_pairs(1.8, output_type="ndarray")  # √3 across a corner
    graph = scipy.sparse.coo_matrix(
        (np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(some.size, some.size)
    )
    count, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    groups = [some[label == k] for k in range(count)]
    return [group for group in groups if len(group) >= LEAST_CELLS]


def _spot(
    points: FloatMap,
    normals: FloatMap,
    distance: FloatMap,
    common: FloatMap,
    inside: NDArray[np.bool_],
    sign: float,
    area: float,
    spacing: float,
) -> Spot:
    weight = np.maximum(sign * distance[inside], 0.0)
    middle = weight @ points[inside] / weight.sum()
    normal = normals[inside].mean(axis=0)
    across = np.linalg.svd(normal[None, :])[2][1:]
    radius = PEAK_RADIUS * float(np.sqrt(area / np.pi))
    away = np.linalg.norm(points - middle, axis=1)
    # Points of another surface nearby, such as the other side of a wall, do not count.
    facing = normals @ normal > 0.7 * np.linalg.norm(normal)
    near = np.flatnonzero(facing & (away < max(radius, np.sort(away[facing])[LEAST_FITTED - 1])))
    at = (points[near] - middle) @ across.T
    depth, sigma, curvature, top = _peak(at, distance[near], sign, radius)
    blur = 2.0 * abs(curvature) * (BLUR_SPACINGS * spacing) ** 2
    variance = sigma**2 + float(np.mean(common[near] ** 2)) + blur**2
    place = middle + top @ across
    return Spot(place, depth, float(np.sqrt(variance)), area, int(inside.sum()))


def _peak(
    at: FloatMap, distance: FloatMap, sign: float, radius: float
) -> tuple[float, float, float, FloatMap]:
    """Extreme of a paraboloid through the points, its standard deviation, the factor d of the
    squares, and its place."""
    rows = np.column_stack((np.ones(len(at)), at, np.sum(at**2, axis=1)))
    used = np.ones(len(at), bool)
    for _ in range(3):
        values = np.linalg.lstsq(rows[used], distance[used], rcond=None)[0]
        left = distance - rows @ values
        scatter = robust_sigma(left[used])
        used = np.abs(left) <= FAR_SIGMAS * max(scatter, 1e-12)
        if used.sum() < LEAST_FITTED:
            used[:] = True
            break
    top = np.zeros(2)
    if sign * values[3] < 0:
        wanted = -0.5 * values[1:3] / values[3]
        top = wanted * min(1.0, 0.5 * radius / max(float(np.linalg.norm(wanted)), 1e-12))
    row = np.array([1.0, *top, top @ top])
    cost = np.linalg.pinv(rows[used].T @ rows[used])
    scatter2 = float(np.sum((distance[used] - rows[used] @ values) ** 2)) / (used.sum() - 4)
    sigma = float(np.sqrt(scatter2 * (row @ cost @ row)))
    return float(row @ values), sigma, float(values[3]), top
