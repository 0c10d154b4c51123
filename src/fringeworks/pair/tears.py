"""Surfaces of a displacement that jumps, and tears between them: jumps by whole periods."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.pair.prepared import PreparedPair
from fringeworks.pair.reference_phase import moved_by_periods
from fringeworks.types import BoolMap, DisplacementMap, FloatMap, sealed

JUMP = 0.2
"""Difference of two neighbouring pixels at which a surface ends between them, periods. Fringes of
such a slope are not resolved."""
MIN_AREA = 2.0
"""Smallest surface that is examined, square periods. Smaller ones are single windows."""
GAP = 0.25
"""Largest distance between two surfaces that count as touching, periods: windows on either side of
a jump end at this distance from each other."""
WHOLE = 0.1
"""Largest deviation of a tear from whole periods, periods. A step of any other height is as close
by chance in one of five cases."""
TEAR_SHARE = 0.8
"""Least share of the places where two surfaces touch that must jump by the same number of periods.
Steps of other heights have a smaller share."""
TEAR_LENGTH = 2.0
"""Least length of a tear, periods."""

Surfaces = NDArray[np.int32]


def surfaces_of(u_px: FloatMap, walls: BoolMap | None, period_px: float) -> Surfaces:
    """Surfaces without jumps.

    Parameters
    ----------
    u_px : (h, w) array
        Displacement, px; NaN where unknown.
    walls : (h, w) bool array, optional
        Pixels on cliffs, which belong to none.
    period_px : float > 0

    Returns
    -------
    (h, w) int32 array: 1 on the largest surface, then 2 and so on, 0 on none.
    """
    on = np.isfinite(u_px)
    with np.errstate(invalid="ignore"):
        for axis in (0, 1):
            jump = np.abs(np.diff(u_px, axis=axis)) > JUMP * period_px
            for side in _sides(axis):
                on[side] &= ~jump
    if walls is not None:
        on &= ~walls
    label, count = scipy.ndimage.label(on)
    sizes = np.bincount(label.ravel(), minlength=count + 1)
    sizes[0] = 0
    rank = np.zeros(count + 1, np.int32)
    rank[np.argsort(-sizes, kind="stable")] = np.arange(1, count + 2)
    rank[sizes < MIN_AREA * period_px**2] = 0
    return np.asarray(rank[label])


def _sides(axis: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """The pixels before, and those after, differences along an axis."""
    if axis == 0:
        return np.s_[:-1, :], np.s_[1:, :]
    return np.s_[:, :-1], np.s_[:, 1:]


def without_tears(prepared: PreparedPair, found: DisplacementMap) -> tuple[DisplacementMap, int]:
    """Move surfaces that differ from a larger one beside them by whole periods all along.

    Parameters
    ----------
    prepared : PreparedPair
    found : DisplacementMap
        Of that pair.

    Returns
    -------
    The displacement, and how many pixels were moved.

    Notes
    -----
    The fringes continue across such a tear. A step of exactly that height would look the same, but
    a continuous surface is far more likely than a step that is a whole number of periods along its
    whole edge.
    """
    turn, period = prepared.to_capture, found.period_px
    u = np.asarray(turn(found.displacement_px), np.float64)
    walls = None if found.walls is None else turn(found.walls) > 0
    surface = surfaces_of(u, walls, period)
    if surface.max(initial=0) < 2:
        return found, 0
    reach = max(2.0, GAP * period)
    distance, nearest = scipy.ndimage.distance_transform_edt(surface == 0, return_indices=True)
    near = np.where(distance <= reach, surface[tuple(nearest)], 0)
    orders = _tears(*_touching(u[tuple(nearest)], near), period)
    moved = np.zeros(int(surface.max()) + 1, np.int64)
    for number in sorted(orders):  # larger ones first: a surface may follow one that was moved
        beside, whole = orders[number]
        moved[number] = moved[beside] + whole
    if not moved.any():
        return found, 0
    periods = moved[np.where(np.isfinite(u), near, 0)]
    change, sigma = map(turn, moved_by_periods(prepared, u, periods))
    shifted = found.displacement_px + change
    return replace(
        found,
        displacement_px=sealed(shifted.astype(found.displacement_px.dtype)),
        sigma_px=sealed(np.hypot(found.sigma_px, sigma).astype(found.sigma_px.dtype)),
    ), int(np.count_nonzero(periods))


def _touching(
    there: FloatMap, near: Surfaces
) -> tuple[NDArray[np.int32], NDArray[np.int32], FloatMap]:
    """Pairs of surfaces at the places where they touch, (n,), the larger one first, and how much
    the first is displaced further than the second, px, by the displacement ``there`` of the nearest
    pixel of a surface."""
    parts = []
    for axis in (0, 1):
        one, two = _sides(axis)
        edge = (near[one] > 0) & (near[two] > 0) & (near[one] != near[two])
        swap = near[one][edge] > near[two][edge]
        further = there[one][edge] - there[two][edge]
        first, second = near[one][edge], near[two][edge]
        larger, smaller = np.minimum(first, second), np.maximum(first, second)
        parts.append((larger, smaller, np.where(swap, -further, further)))
    larger, smaller, jumps = (np.concatenate(part) for part in zip(*parts, strict=True))
    return larger, smaller, jumps


def _tears(
    larger: NDArray[np.int32], smaller: NDArray[np.int32], jumps_px: FloatMap, period_px: float
) -> dict[int, tuple[int, int]]:
    """For surfaces that are torn off: the surface that they belong to, and the whole periods to
    add."""
    found: dict[int, tuple[int, int]] = {}
    length: dict[int, int] = {}
    jumps = jumps_px / period_px
    for a, b in np.unique(np.stack((larger, smaller), axis=1), axis=0).tolist():
        here = jumps[(larger == a) & (smaller == b)]
        whole = int(np.round(np.median(here)))
        share = float(np.mean(np.abs(here - whole) < WHOLE))
        long_enough = here.size >= max(TEAR_LENGTH * period_px, length.get(b, 0))
        if share >= TEAR_SHARE and long_enough:
            found[b], length[b] = (a, whole), here.size
    return found
