"""Fringe orders from two independent estimates: the unwrapped phase and fringe counting.

Both give the displacement up to whole periods, and they fail differently. A band-pass loses fringes
that are stretched or compressed out of its band; counting slips where a fringe is hidden. Where the
two differ by whole periods over a region, the estimate that continues the surroundings is correct.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import scipy

from fringeworks.pair.counting import (
    MAX_DISPLACEMENT_PERIODS,
    RowMethod,
    count_fringes,
    invert_rows,
    slips,
)
from fringeworks.pair.prepared import PreparedPair
from fringeworks.pair.registry import Solution
from fringeworks.types import BoolMap, FloatMap, Reason, sealed

WHOLE_TOLERANCE = 0.35
"""Largest deviation of a difference from whole periods at which the orders are compared, periods.

At 0.5 every difference would be near a whole number; a smaller tolerance leaves gaps where one
estimate is noisy. An empirical choice.
"""
MIN_REGION = 0.5
"""Smallest region that is examined, square periods; smaller ones are noise of the counting.

An empirical choice.
"""
MAJORITY = 0.6
"""Smallest share of a region's border that decides its order, 0.5…1.

Between 1 − MAJORITY and MAJORITY the order is undecided. An empirical choice.
"""
MIN_WITNESS = 1.0
"""Smallest region where counting may contradict the band-pass, square periods.

Rows that slip and noise make smaller regions. A band-pass loses fringes over about a period on
either side. An empirical choice.
"""
MIN_JUMPING_WITNESS = 4.0
"""The same for regions that jumps of the counted displacement surround, square periods.

A surface that only the counting follows is smooth; a slipped order begins and ends with a jump. An
empirical choice.
"""
JUMPING = 0.05
"""Smallest share of a region's pixels beside a jump from which it counts as surrounded by jumps.

The border of a round region of four square periods is about a tenth of its pixels. An empirical
choice.
"""
BORDER_PX = 2
"""Margin around a region's bounding box that holds the pixels beyond its border, px; at least 1."""


def settle_orders(
    prepared: PreparedPair, displacement_px: FloatMap, *, suspect: bool
) -> tuple[FloatMap, BoolMap, int]:
    """Check the fringe orders of a displacement against fringe counting.

    Parameters
    ----------
    prepared : PreparedPair
    displacement_px : (h, w) float array
        px; NaN where unknown; not mutated.
    suspect : bool
        Whether the orders may be wrong. The phase of a single region without residues is unwrapped
        unambiguously, and is not checked.

    Returns
    -------
    displacement : (h, w) float array
        px; regions are moved by whole periods where counting continues the surroundings.
    undecided : (h, w) bool array
        True where neither estimate does; the displacement is NaN there.
    moved : int
        Number of pixels that were moved.
    """
    nowhere = np.zeros(displacement_px.shape, bool)
    if not suspect:
        return displacement_px, nowhere, 0
    counted = count_fringes(prepared).displacement_px
    orders, undecided = compare_orders(displacement_px, counted, prepared.period)
    moved = displacement_px + orders * prepared.period
    moved[undecided] = np.nan
    return moved, undecided, int(np.count_nonzero(orders))


def guided_count(
    prepared: PreparedPair,
    band_pass: Callable[[], FloatMap],
    name: RowMethod = "sifa",
    *,
    max_displacement_px: float | None = None,
    **options: Any,
) -> Solution:
    """Measure the displacement by counting, guided by the band-pass where counting slipped.

    Parameters
    ----------
    prepared : PreparedPair
    band_pass : function without arguments
        Returns the displacement of the band-pass, (h, w), px; called only if counting slipped.
    name, max_displacement_px, options
        As in ``invert_rows``.

    Returns
    -------
    Solution
        NaN (``ORDER_AMBIGUOUS``) where the orders stay open in spite of the guide.
    """

    def count(limit_px: float | None, guide: FloatMap | None = None) -> Solution:
        return invert_rows(prepared, name, max_displacement_px=limit_px, guide_px=guide, **options)

    period = prepared.period
    unguided = count(max_displacement_px)
    if not slips(unguided, period):
        return unguided
    band = band_pass()
    orders, undecided = compare_orders(unguided.displacement_px, band, period)
    if not (orders.any() or undecided.any()):
        return _without(unguided, _stray(unguided.displacement_px, band, period))
    guide = unguided.displacement_px + orders * period
    with np.errstate(invalid="ignore"):
        guide[undecided | (np.abs(band - guide) > 0.5 * period)] = np.nan
    limit_px = max_displacement_px
    if limit_px is None and np.isfinite(guide).any():
        largest = float(np.nanmax(np.abs(guide)))
        limit_px = max(MAX_DISPLACEMENT_PERIODS * period, largest + period)
    guided = count(limit_px, guide)
    with np.errstate(invalid="ignore"):
        still_open = undecided | (np.abs(guided.displacement_px - guide) > 0.5 * period)
    return _without(guided, still_open | _stray(guided.displacement_px, band, period))


def _stray(counted: FloatMap, band: FloatMap, period_px: float) -> BoolMap:
    """Find the small regions where counting strays from the band-pass."""
    limit = WHOLE_TOLERANCE * period_px
    with np.errstate(invalid="ignore"):
        label, count = scipy.ndimage.label(np.abs(counted - band) > limit)
        beside = np.zeros(counted.shape, bool)
        for here, there in ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1])):
            jump = np.abs(counted[here] - counted[there]) > limit
            beside[here] |= jump
            beside[there] |= jump
    sizes = np.bincount(label.ravel(), minlength=count + 1)
    jumps = np.bincount(label.ravel(), beside.ravel(), minlength=count + 1)
    surrounded = jumps >= JUMPING * sizes
    small = sizes < np.where(surrounded, MIN_JUMPING_WITNESS, MIN_WITNESS) * period_px**2
    small[0] = False
    return np.asarray(small[label])


def _without(solution: Solution, ambiguous: BoolMap) -> Solution:
    """The solution without the pixels whose fringe order is ambiguous."""
    displacement, reason = solution.displacement_px.copy(), solution.reason.copy()
    displacement[ambiguous] = np.nan
    reason[ambiguous & (reason == Reason.OK)] = Reason.ORDER_AMBIGUOUS
    return replace(solution, displacement_px=sealed(displacement), reason=sealed(reason))


def continues(counted: FloatMap, band: FloatMap, period_px: float) -> BoolMap:
    """Find where a counted displacement fills gaps of the band-pass and continues its surroundings.

    Parameters
    ----------
    counted, band : (h, w) float arrays
        Two estimates of the displacement, px; NaN where unknown.
    period_px : float > 0

    Returns
    -------
    (h, w) bool array
        True in the connected regions without jumps that the band-pass has no value for, and on most
        of whose border the two differ by less than half a period.
    """
    known = np.isfinite(band)
    with np.errstate(invalid="ignore"):
        smooth = np.isfinite(counted) & ~known
        for axis in (0, 1):
            jump = np.abs(np.diff(counted, axis=axis)) > 0.5 * period_px
            ahead = [(0, 0), (0, 0)]
            ahead[axis] = (1, 0)
            behind = [(0, 0), (0, 0)]
            behind[axis] = (0, 1)
            smooth &= ~(np.pad(jump, ahead) | np.pad(jump, behind))
    label, count = scipy.ndimage.label(smooth)
    if not count:
        return np.asarray(smooth)
    distance, nearest = scipy.ndimage.distance_transform_edt(label == 0, return_indices=True)
    border = known & (distance <= BORDER_PX)
    beside = tuple(axis[border] for axis in nearest)
    agrees = np.abs(counted[beside] - band[border]) < 0.5 * period_px
    of_region = label[beside]
    total = np.bincount(of_region, minlength=count + 1)
    share = np.bincount(of_region, agrees, minlength=count + 1) / np.maximum(total, 1)
    right = share > MAJORITY
    right[0] = False
    return np.asarray(right[label])


def compare_orders(first: FloatMap, second: FloatMap, period_px: float) -> tuple[FloatMap, BoolMap]:
    """Find the whole periods to add where ``second`` continues the surroundings better.

    Parameters
    ----------
    first, second : (h, w) float arrays
        Two estimates of the displacement, px; NaN where unknown.
    period_px : float > 0

    Returns
    -------
    orders : (h, w) float array
        Whole numbers of periods, 0 where ``first`` is right or the two cannot be compared.
    undecided : (h, w) bool array
        True in regions whose border supports neither estimate.
    """
    difference = (second - first) / period_px
    orders = np.zeros(first.shape)
    undecided = np.zeros(first.shape, bool)
    whole = np.round(difference)
    with np.errstate(invalid="ignore"):
        comparable = np.abs(difference - whole) <= WHOLE_TOLERANCE
    if not comparable.any():
        return orders, undecided
    # A common offset is no disagreement, because the two estimates are anchored independently.
    order = np.where(comparable, whole - np.median(whole[comparable]), 0.0)
    trusted = comparable & (order == 0)
    smallest = MIN_REGION * period_px**2
    for value in np.unique(order[order != 0]):
        label, count = scipy.ndimage.label(order == value)
        sizes = np.bincount(label.ravel(), minlength=count + 1)
        boxes = scipy.ndimage.find_objects(label)
        for k in range(1, count + 1):
            if sizes[k] < smallest:
                continue
            box = tuple(
                slice(max(0, s.start - BORDER_PX), s.stop + BORDER_PX) for s in boxes[k - 1]
            )
            region = label[box] == k
            moved = first[box] + value * period_px
            share = _smoother_share(region, trusted[box], first[box], moved)
            if share > MAJORITY:
                orders[box][region] = value
            elif share > 1.0 - MAJORITY:
                undecided[box] |= region
    return orders, undecided


def _smoother_share(region: BoolMap, trusted: BoolMap, first: FloatMap, second: FloatMap) -> float:
    """Share of the region's border where ``second`` is closer to the trusted pixel beyond it."""
    closer = total = 0
    ahead, behind = slice(1, None), slice(None, -1)
    for here, there in (
        ((slice(None), ahead), (slice(None), behind)),
        ((slice(None), behind), (slice(None), ahead)),
        ((ahead, slice(None)), (behind, slice(None))),
        ((behind, slice(None)), (ahead, slice(None))),
    ):
        edge = region[here] & trusted[there]
        outside = first[there][edge]
        a, b = np.abs(first[here][edge] - outside), np.abs(second[here][edge] - outside)
        closer += int(np.count_nonzero(b < a))
        total += edge.sum()
    return closer / total if total else 0.0
