"""Fringe orders from two independent estimates: the unwrapped phase and fringe counting.

Both give the displacement up to whole periods, and they fail differently. A band-pass loses fringes
that are stretched or compressed out of its band; counting slips where a fringe is hidden. Where the
two differ by whole periods over a region, the estimate that continues the surroundings is correct.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.pair.counting import (
    Inverted,
    RowInversion,
    RowMethod,
    count_fringes,
    slips,
)
from fringeworks.pair.prepared import PreparedPair
from fringeworks.pair.registry import Solution
from fringeworks.signal.bands import by_bands, row_bands
from fringeworks.types import BoolMap, FloatMap, Reason

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
MAX_ORDER = 10_000
"""Largest difference of two fringe orders that is compared: more than any frame has periods."""
JUDGED_ROWS = 3
"""Rows on either side that the kernel compares the orders of a row with; twice as many at the ends
of the frame."""
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
    counted = count_fringes(prepared)
    orders, undecided = compare_orders(displacement_px, counted, prepared.period)
    period = prepared.period
    moved = by_bands(lambda u, n: u + n * period, displacement_px, orders, dtype=np.float64)
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
        As in ``RowInversion`` and its ``limit_px``.

    Returns
    -------
    Solution
        NaN (``ORDER_AMBIGUOUS``) where the orders stay open in spite of the guide.
    """
    counting, period = RowInversion(prepared, name, **options), prepared.period
    limit_px = counting.limit_px(max_displacement_px)
    found = counting.rows(slice(None), limit_px)
    if not slips(found, period):
        return counting.solution(found)
    band = band_pass()
    orders, undecided = compare_orders(found.displacement_px, band, period)
    # Rows are counted from their own extrema; the band-pass is continuous up to the frame's rim.
    orders += common_order(found.displacement_px + orders * period, band, period)
    wrong = np.any((orders != 0) | undecided, axis=1)
    if wrong.any():
        guide = by_bands(
            lambda u, n: u + n * period, found.displacement_px, orders, dtype=np.float32
        )
        with np.errstate(invalid="ignore"):
            guide[undecided | (np.abs(band - guide) > 0.5 * period)] = np.nan
        further_px = limit_px
        if max_displacement_px is None and np.isfinite(guide).any():
            largest = max(float(np.nanmax(guide)), -float(np.nanmin(guide)))
            further_px = max(limit_px, largest + period)
        if further_px > limit_px:
            # A wider search may change rows that were right.
            wrong[:] = True
        invert_again(counting, found, wrong, further_px, guide)
        with np.errstate(invalid="ignore"):
            undecided |= np.abs(found.displacement_px - guide) > 0.5 * period
        del guide
    undecided |= _stray(found.displacement_px, band, period)
    found.displacement_px[undecided] = np.nan
    found.reason[undecided & (found.reason == Reason.OK)] = Reason.ORDER_AMBIGUOUS
    return counting.solution(found)


def invert_again(
    counting: RowInversion, found: Inverted, wrong: BoolMap, limit_px: float, guide_px: FloatMap
) -> None:
    """Invert the rows again that had wrong orders, in place, guided.

    ``wrong`` is True for these rows, (h,). The other rows would come out the same: the guide is
    their own displacement. Those nearby were judged by the wrong ones, and are judged again.
    """
    judged = _near(wrong, JUDGED_ROWS)
    for seen in _runs(_near(judged, 2 * JUDGED_ROWS)):
        again = counting.rows(seen, limit_px, guide_px)
        rows = judged[seen]
        found.displacement_px[seen][rows] = again.displacement_px[rows]
        found.sigma_px[seen][rows] = again.sigma_px[rows]
        found.modulation_ratio[seen][rows] = again.modulation_ratio[rows]
        found.reason[seen][rows] = again.reason[rows]


def common_order(first: FloatMap, second: FloatMap, period_px: float) -> int:
    """Whole periods to add to ``first`` so that most of the frame, and most of its rim, agree with
    ``second``; 0 where frame and rim differ in that."""
    order, comparable = _whole_periods(first, second, period_px)
    if not comparable.any():
        return 0
    depth = max(1, round(period_px))
    rim = comparable.copy()
    rim[depth:-depth, depth:-depth] = False
    whole = _middle(order[comparable])
    return whole if not rim.any() or _middle(order[rim]) == whole else 0


def _near(rows: BoolMap, reach: int) -> BoolMap:
    """Rows within a distance of those that are marked, (h,)."""
    return np.asarray(scipy.ndimage.maximum_filter1d(rows, 2 * reach + 1, mode="constant"))


def _runs(rows: BoolMap) -> list[slice]:
    """Stretches of neighbouring rows that are marked."""
    ends = np.flatnonzero(np.diff(rows.astype(np.int8), prepend=0, append=0))
    return [slice(int(a), int(b)) for a, b in ends.reshape(-1, 2)]


def _stray(counted: FloatMap, band: FloatMap, period_px: float) -> BoolMap:
    """Find the small regions where counting strays from the band-pass."""
    limit = WHOLE_TOLERANCE * period_px
    with np.errstate(invalid="ignore"):
        strays = by_bands(lambda a, b: np.abs(a - b) > limit, counted, band, dtype=bool)
    if not strays.any():
        return strays
    label, count = scipy.ndimage.label(strays)
    sizes, jumps = np.zeros(count + 1, np.int64), np.zeros(count + 1, np.int64)
    for part in row_bands(label.shape, bytes_per_px=48, halo=1):
        labels, beside = label[part.rows], _beside_jumps(counted[part.seen], limit)[part.inner]
        sizes += np.bincount(labels.ravel(), minlength=count + 1)
        jumps += np.bincount(labels[beside], minlength=count + 1)
    surrounded = jumps >= JUMPING * sizes
    small = sizes < np.where(surrounded, MIN_JUMPING_WITNESS, MIN_WITNESS) * period_px**2
    small[0] = False
    return np.asarray(small[label])


def _beside_jumps(u: FloatMap, limit_px: float) -> BoolMap:
    """Pixels that differ from a neighbour by more than a limit, (r, w)."""
    beside = np.zeros(u.shape, bool)
    for here, there in ((np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1])):
        with np.errstate(invalid="ignore"):
            jump = np.abs(u[here] - u[there]) > limit_px
        beside[here] |= jump
        beside[there] |= jump
    return beside


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


def _whole_periods(
    first: FloatMap, second: FloatMap, period_px: float
) -> tuple[NDArray[np.int16], BoolMap]:
    """Whole periods between two estimates, (h, w), and where they differ by about that."""
    whole = np.zeros(first.shape, np.int16)
    comparable = np.zeros(first.shape, bool)
    for band in row_bands(first.shape, bytes_per_px=40):
        difference = (second[band.rows] - first[band.rows]) / period_px
        nearest = np.round(difference)
        with np.errstate(invalid="ignore"):
            near = np.abs(difference - nearest) <= WHOLE_TOLERANCE
            near &= np.abs(nearest) <= MAX_ORDER
        comparable[band.rows] = near
        whole[band.rows][near] = nearest[near]
    return whole, comparable


def _middle(orders: NDArray[np.int16]) -> int:
    """Median of whole numbers; the lower of the two in the middle where these differ."""
    counts = np.bincount(orders.astype(np.int32) + MAX_ORDER)
    return int(np.searchsorted(np.cumsum(counts), (orders.size + 1) // 2)) - MAX_ORDER


def compare_orders(
    first: FloatMap, second: FloatMap, period_px: float
) -> tuple[NDArray[np.int16], BoolMap]:
    """Find the whole periods to add where ``second`` continues the surroundings better.

    Parameters
    ----------
    first, second : (h, w) float arrays
        Two estimates of the displacement, px; NaN where unknown.
    period_px : float > 0

    Returns
    -------
    orders : (h, w) int16 array
        Whole numbers of periods, 0 where ``first`` is right or the two cannot be compared.
    undecided : (h, w) bool array
        True in regions whose border supports neither estimate.
    """
    orders: NDArray[np.int16] = np.zeros(first.shape, np.int16)
    undecided = np.zeros(first.shape, bool)
    order, comparable = _whole_periods(first, second, period_px)
    if not comparable.any():
        return orders, undecided
    # A common offset is no disagreement, because the two estimates are anchored independently.
    order -= _middle(order[comparable])
    order[~comparable] = 0
    trusted = comparable & (order == 0)
    smallest = MIN_REGION * period_px**2
    for value in np.unique(order[order != 0]).tolist():
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
