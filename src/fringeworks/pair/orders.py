"""Fringe orders by two witnesses: the unwrapped phase, and the counting of fringes along rows.

Both know the displacement up to whole periods, and fail differently: a band-pass loses fringes
that are stretched or compressed out of its band, counting slips where a fringe is hidden. Where
they differ by whole periods over a region, the one that joins its surroundings is right.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import ndimage

from fringeworks.pair.counting import MAX_PERIODS, Name, count_fringes, invert_rows, slips
from fringeworks.pair.prepared import PreparedPair
from fringeworks.pair.registry import Solution
from fringeworks.types import BoolMap, FloatMap, Reason

AGREE = 0.35
"""Displacements whose difference is this close to whole periods (share of one) may be compared."""
MIN_REGION = 0.5
"""Smallest region that is looked at, square periods; smaller ones are noise of the counting."""
MAJORITY = 0.6
"""Share of the border that must speak for one order."""


def settle_orders(
    pair: PreparedPair, displacement_px: FloatMap, *, suspect: bool
) -> tuple[FloatMap, BoolMap, int]:
    """Check the orders of a displacement against fringe counting.

    Parameters
    ----------
    pair : PreparedPair
    displacement_px : (h, w) float array, NaN where unknown; not mutated
    suspect : bool
        Whether there is cause for doubt: a phase without residues in one region has one order.

    Returns
    -------
    displacement : with regions moved by whole periods where counting joins the surroundings
    open : True where neither does; NaN there
    moved : number of pixels that were moved
    """
    nowhere = np.zeros(displacement_px.shape, bool)
    if not suspect:
        return displacement_px, nowhere, 0
    counted = count_fringes(pair).displacement_px
    orders, undecided = compare_orders(displacement_px, counted, pair.period)
    moved = displacement_px + orders * pair.period
    moved[undecided] = np.nan
    return moved, undecided, int(np.count_nonzero(orders))


def guided_count(
    pair: PreparedPair,
    band_pass: Callable[[], FloatMap],
    name: Name = "sifa",
    *,
    max_displacement_px: float | None = None,
    **options: int,
) -> Solution:
    """Displacement by counting; with the band-pass as a guide where counting slipped.

    Parameters
    ----------
    pair : PreparedPair
    band_pass : function without arguments
        Gives the displacement of the band-pass, (h, w), px; called only if rows disagree.
    name, max_displacement_px, options : as ``invert_rows`` has them
    """

    def run(limit_px: float | None, guide: FloatMap | None = None) -> Solution:
        return invert_rows(pair, name, max_displacement_px=limit_px, guide_px=guide, **options)

    first = run(max_displacement_px)
    if not slips(first, pair.period):
        return first
    band = band_pass()
    orders, undecided = compare_orders(first.displacement_px, band, pair.period)
    if not (orders.any() or undecided.any()):
        return first
    guide = first.displacement_px + orders * pair.period
    with np.errstate(invalid="ignore"):
        guide[undecided | (np.abs(band - guide) > 0.5 * pair.period)] = np.nan
    limit_px = max_displacement_px
    if limit_px is None and np.isfinite(guide).any():
        limit_px = max(MAX_PERIODS * pair.period, float(np.nanmax(np.abs(guide))) + pair.period)
    second = run(limit_px, guide)
    # What the guide could not mend stays open.
    with np.errstate(invalid="ignore"):
        lost = undecided | (np.abs(second.displacement_px - guide) > 0.5 * pair.period)
    second.displacement_px[lost] = np.nan
    second.reason[lost & (second.reason == Reason.OK)] = Reason.ORDER_AMBIGUOUS
    return second


def compare_orders(first: FloatMap, second: FloatMap, period_px: float) -> tuple[FloatMap, BoolMap]:
    """Whole periods to add to ``first`` where ``second`` joins the surroundings better.

    Returns
    -------
    orders : (h, w) float array of whole numbers
    undecided : (h, w) bool array, where a region's border speaks for neither
    """
    difference = (second - first) / period_px
    orders = np.zeros(first.shape)
    undecided = np.zeros(first.shape, bool)
    whole = np.round(difference)
    with np.errstate(invalid="ignore"):
        comparable = np.abs(difference - whole) <= AGREE
    if not comparable.any():
        return orders, undecided
    # A global offset is no disagreement: the two are anchored independently.
    order = np.where(comparable, whole - np.median(whole[comparable]), 0.0)
    trusted = comparable & (order == 0)
    smallest = MIN_REGION * period_px**2
    for value in np.unique(order[order != 0]):
        label, count = ndimage.label(order == value)
        sizes = np.bincount(label.ravel(), minlength=count + 1)
        places = ndimage.find_objects(label)
        for k in range(1, count + 1):
            if sizes[k] < smallest:
                continue
            window = tuple(slice(max(0, s.start - 2), s.stop + 2) for s in places[k - 1])
            region = label[window] == k
            votes = _votes(
                region, trusted[window], first[window], first[window] + value * period_px
            )
            if votes > MAJORITY:
                orders[window][region] = value
            elif votes > 1.0 - MAJORITY:
                undecided[window] |= region
    return orders, undecided


def _votes(region: BoolMap, trusted: BoolMap, first: FloatMap, second: FloatMap) -> float:
    """Share of the region's border that ``second`` crosses more smoothly than ``first``."""
    better = total = 0
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
        better += int(np.count_nonzero(b < a))
        total += edge.sum()
    return better / total if total else 0.0
