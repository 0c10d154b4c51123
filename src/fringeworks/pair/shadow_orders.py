"""Fringe orders of surfaces beside cliffs, by the shadows that the cliffs cast.

Two frames cannot distinguish steps that differ by a whole fringe period. The width of a shadow is
the step that casts it: the ray that grazes the cliff lights both ends a and b of the shadow, so
that a − u(a) = b − u(b).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.pair.free_surfaces import free_surfaces
from fringeworks.pair.order_range import AWAY, SHADOW_TOLERANCE, dark_places, shadows_along
from fringeworks.pair.order_regions import Links, Orders, continuity, likely_orders
from fringeworks.pair.prepared import PreparedPair
from fringeworks.pair.reference_phase import moved_by_periods
from fringeworks.types import BoolMap, DisplacementMap, FloatMap, Frozen, Reason, sealed

MIN_SHADOW = 0.5
"""Shortest shadow whose width is read, periods. The dark part of a fringe has 0.2 periods. A step
that is measured in the wrong direction casts a shadow of more than 0.5 periods."""
MIN_LINES = 8
"""Fewest lines through shadows that tell of a surface, or that are reported where no order explains
them. Marks and dirt have fewer."""
CONTINUES = 0.5
"""Continuity from which on a pixel belongs to a surface: a cliff is less likely than none."""
BORDER = 0.1
"""Least share of the border of a surface without links that lies at lost places, for it to be lost,
too. With 0.25, two to six times as many pixels of ray-cast boxes and stairs stay wrong by a period,
and as many of photographs are lost."""
REACH = 1.0
"""Distance from the ends of a shadow within which the surfaces beside it must begin, periods:
filters smear a cliff over about one period. Two surfaces have twice that between them."""


@dataclass(frozen=True, eq=False, repr=False)
class ShadowOrders(Frozen):
    """Corrections of the fringe orders by shadows; maps are (h, w), as captured."""

    moved: NDArray[np.int16]
    """Whole periods that were added."""
    refused: BoolMap
    """Surfaces whose order the shadows leave open, and the edges of those that were moved."""
    doubt: NDArray[np.int16]
    """Whole periods by which surfaces beside such lines, and free ones, may be off, which σ
    holds."""
    free: BoolMap
    """Surfaces whose order neither fringes nor shadows tell, and broken places around them."""
    open_lines: int
    """Lines whose shadow differs by whole periods from the step, and whose order stays open."""


def by_shadows(
    prepared: PreparedPair, found: DisplacementMap
) -> tuple[DisplacementMap, ShadowOrders]:
    """Correct the fringe orders of surfaces beside cliffs by the shadows that these cast.

    Parameters
    ----------
    prepared : PreparedPair
    found : DisplacementMap
        Of that pair.

    Returns
    -------
    The displacement, and the corrections. Surfaces are moved by the whole periods that are the most
    likely by all shadows and by where the fringes continue (``likely_orders``). Surfaces whose
    order depends on the weight of the evidence are NaN (``ORDER_AMBIGUOUS``), and so are broken
    places beside both, and surfaces there that no shadow reaches. Where lines stay open, σ holds
    the periods: a box whose height is close to a period has no border that could be seen. So does σ
    of surfaces beside which the fringes fit other orders as well (``free_surfaces``).

    Notes
    -----
    Lines run along the normal of the fringes, at an angle θ to the axis. A shadow of the width ℓ
    along the axis belongs to a step of ℓ/cos²θ along the axis.
    """
    turn, period = prepared.to_capture, found.period_px
    u = np.asarray(turn(found.displacement_px), np.float64)
    if min(u.shape) < MIN_LINES:  # nothing could be told
        zero, nowhere = turn(np.zeros(u.shape, np.int16)), turn(np.zeros(u.shape, bool))
        return found, ShadowOrders(zero, nowhere, zero, nowhere, 0)
    seen = _seen(prepared, u, period)
    continues = continuity(prepared, u)
    on = continues >= CONTINUES
    links, unused = _linked(seen, on, REACH * period)
    whole, refused, still = np.zeros(u.shape, np.int16), np.zeros(u.shape, bool), 0
    doubt, open_links = whole, links.whole != 0
    if seen.whole.any():
        orders = _told(likely_orders(continues, links, period), links, REACH * period)
        ends = orders.whole[links.rows, links.columns].astype(np.int64)
        open_links = links.whole != np.diff(ends, axis=1)[:, 0]
        refused = _undecided(orders, on, links, open_links, unused, 2.0 * REACH * period)
        whole = np.where(refused, 0, orders.whole).astype(np.int16)
        # A line that no surface was found beside, and one that is open, leave an order open.
        undecided = orders.undecided[links.rows, links.columns].any(axis=1)
        still = int(np.count_nonzero(open_links | undecided)) + len(unused.whole)
        left = links._replace(whole=links.whole - np.diff(ends, axis=1)[:, 0])
        cut = _chosen(links, ~open_links & _cut_off(on, refused, links))
        lines = _both(_both(_chosen(left, open_links), cut), unused)
        doubt = _doubt(lines, u.shape, REACH * period)
    closed = (links.rows[~open_links], links.columns[~open_links])
    free = free_surfaces(prepared, u, on, closed, MIN_LINES)
    maps = [sealed(turn(values)) for values in (whole, refused, np.maximum(doubt, free), free)]
    corrections = ShadowOrders(maps[0], maps[1], maps[2], maps[3], still)
    return _corrected(prepared, found, corrections), corrections


def _undecided(
    orders: Orders,
    on: BoolMap,
    links: Links,
    open_links: BoolMap,
    unused: Links,
    reach_px: float,
) -> BoolMap:
    """Pixels whose order stays open, (h, w).

    These are surfaces that the evidence leaves undecided, or that most of their links contradict;
    broken places within reach of them, or of a surface that was moved, or of shadows which no
    surface was found beside; and surfaces without links that have ``BORDER`` of their border at
    such places: nothing tells their order. What lies further on keeps its order. The creases of a
    rough surface are connected over the whole frame, and tell nothing of each other.
    """
    place, count = scipy.ndimage.label(on)
    rim = np.zeros(count + 1, bool)
    for side in (place[0], place[-1], place[:, 0], place[:, -1]):
        rim[side] = True
    ends = place[links.rows, links.columns]
    links_of = np.bincount(ends.ravel(), minlength=count + 1)
    against = np.bincount(ends[open_links].ravel(), minlength=count + 1)
    alone = np.bincount(place[unused.rows, unused.columns].ravel(), minlength=count + 1)
    links_of, against = links_of + alone, against + alone
    lost = ~rim & (2 * against > links_of) & (against >= MIN_LINES)
    free = ~rim & (links_of == 0)
    around = _sides(place, ~on)
    touched = (orders.whole != 0) | orders.undecided
    broken = np.zeros(on.shape, bool)
    before = -1
    while before != (before := int(np.count_nonzero(broken)) + int(np.count_nonzero(lost))):
        broken = _reached(touched | (on & lost[place]), ~on, reach_px)
        lost |= free & (_sides(place, broken) > BORDER * around)
    broken |= _contradicted(unused, on, reach_px)
    return np.asarray(orders.undecided | np.where(on, lost[place], broken))


def _doubt(lines: Links, shape: tuple[int, ...], reach_px: float) -> NDArray[np.int16]:
    """Periods that the surfaces on both sides of open lines may be off by, (h, w), up to the border
    of the frame: nothing says on which side the body stands, nor where it ends."""
    doubt = np.zeros(shape, np.int16)
    if len(lines.whole) < MIN_LINES:
        return doubt
    for rows, columns, whole in zip(*lines, strict=True):
        for row, column, way in zip(rows, columns, (-1, 1), strict=True):
            side = doubt[row, column::way]
            np.maximum(side, np.int16(abs(whole)), out=side)
    # The ends of a shadow are too short to be read.
    return np.asarray(scipy.ndimage.maximum_filter1d(doubt, round(reach_px) | 1, axis=0))


def _cut_off(on: BoolMap, refused: BoolMap, links: Links) -> BoolMap:
    """Lines at whose ends a part of a surface is not measured, while its other parts are, (n,)."""
    place, count = scipy.ndimage.label(on)
    rest = np.bincount(place[~refused], minlength=count + 1) > 0
    rest[0] = False
    ends = links.rows, links.columns
    return np.asarray((refused[ends] & rest[place[ends]]).any(axis=1) & (links.whole != 0))


def _chosen(links: Links, chosen: BoolMap) -> Links:
    """Some of the links."""
    return Links(links.rows[chosen], links.columns[chosen], links.whole[chosen])


def _both(one: Links, two: Links) -> Links:
    """The links of both."""
    rows, columns, whole = (np.concatenate(parts) for parts in zip(one, two, strict=True))
    return Links(rows, columns, whole)


def _told(orders: Orders, links: Links, least_px: float = 0.0) -> Orders:
    """The same orders, but for those that fewer than ``MIN_LINES`` lines tell, and for strips that
    are no wider than ``least_px``: these are cut off beside a shadow where no border is seen."""
    changed = (orders.whole != 0) | orders.undecided
    region, count = scipy.ndimage.label(changed)
    ends = region[links.rows, links.columns]
    # A line tells of a region if its shadow differs from the step, or if it leads to another one.
    telling = (links.whole != 0) | ((ends > 0).all(axis=1) & (ends[:, 0] != ends[:, 1]))
    lines = np.bincount(ends[telling].ravel(), minlength=count + 1)
    wide = np.bincount(region.ravel(), minlength=count + 1) > least_px * lines
    kept = ((lines >= MIN_LINES) & wide)[region] & changed
    return Orders(np.where(kept, orders.whole, 0).astype(np.int16), orders.undecided & kept)


def _contradicted(unused: Links, on: BoolMap, reach_px: float) -> BoolMap:
    """Broken places around shadows that no surface was found beside, (h, w)."""
    start = np.zeros(on.shape, bool)
    for rows, columns in zip(unused.rows, unused.columns, strict=True):
        start[rows[0], columns[0] : columns[1] + 1] = True
        start[rows[1], columns[1]] = True
    near = _reached(start & ~on, ~on, reach_px)
    region, count = scipy.ndimage.label(near, np.ones((3, 3)))
    lines = np.bincount(region[unused.rows, unused.columns].max(axis=1), minlength=count + 1)
    lines[0] = 0
    return np.asarray((lines >= MIN_LINES)[region])


def _reached(start: BoolMap, broken: BoolMap, reach_px: float) -> BoolMap:
    """Broken places within a distance of some pixels, along broken places, (h, w)."""
    if not start.any():
        return np.zeros(start.shape, bool)
    steps, around = max(1, round(reach_px)), np.ones((3, 3), bool)
    return np.asarray(scipy.ndimage.binary_dilation(start, around, steps, broken) & broken)


def _sides(place: NDArray[np.int32], marks: BoolMap) -> NDArray[np.intp]:
    """Number of sides of pixels that each place has in common with marked pixels."""
    count = int(place.max()) + 1
    pairs = (
        (place[:-1], marks[1:]),
        (place[1:], marks[:-1]),
        (place[:, :-1], marks[:, 1:]),
        (place[:, 1:], marks[:, :-1]),
    )
    return np.asarray(sum(np.bincount(near[far], minlength=count) for near, far in pairs))


def _corrected(
    prepared: PreparedPair, found: DisplacementMap, orders: ShadowOrders
) -> DisplacementMap:
    """The displacement with other orders."""
    if not (orders.moved.any() or orders.refused.any() or orders.doubt.any()):
        return found
    reason = found.reason.copy()
    lost = orders.refused & np.isfinite(found.displacement_px)
    reason[lost] = Reason.ORDER_AMBIGUOUS

    def blank(values: FloatMap, kind: np.dtype[np.floating]) -> FloatMap:
        return sealed(np.where(lost, np.nan, values).astype(kind, copy=False))

    u, turn = found.displacement_px, prepared.to_capture
    change, sigma = map(turn, moved_by_periods(prepared, turn(u), turn(orders.moved)))
    sigma = np.hypot(sigma, found.period_px * orders.doubt)
    return replace(
        found,
        displacement_px=blank(u + change, u.dtype),
        sigma_px=blank(np.hypot(found.sigma_px, sigma), found.sigma_px.dtype),
        modulation_ratio=blank(found.modulation_ratio, found.modulation_ratio.dtype),
        reason=sealed(reason),
    )


def _seen(prepared: PreparedPair, u: FloatMap, period_px: float) -> Links:
    """Shadows along lines across the fringes, the direction in which projectors are set up."""
    h, w = u.shape
    slope = prepared.frequency[1] / prepared.frequency[0]
    climb = (np.arange(w) - 0.5 * (w - 1)) * slope
    more = int(np.ceil(abs(climb[0])))
    rows = np.rint(np.arange(-more, h + more)[:, None] + climb).astype(np.intp)
    inside = (rows >= 0) & (rows < h)
    rows = np.clip(rows, 0, h - 1)

    def taken(values: np.ndarray) -> np.ndarray:
        return np.asarray(np.take_along_axis(values, rows, axis=0))

    dark, painted = (taken(places) for places in dark_places(prepared))
    away = max(1, round(AWAY * period_px))
    line, first, last = shadows_along(dark * inside, painted, MIN_SHADOW * period_px, away)
    before, beyond = first - away, last - 1 + away
    displacement = taken(u)
    step = displacement[line, beyond] - displacement[line, before]
    periods = ((last - first) * (1.0 + slope**2) - step) / period_px
    sure = np.abs(periods - np.round(periods)) < SHADOW_TOLERANCE  # not where a step is unknown
    line, before, beyond = line[sure], before[sure], beyond[sure]
    return Links(
        np.stack((rows[line, before], rows[line, beyond]), axis=1),
        np.stack((before, beyond), axis=1),
        np.round(periods[sure]).astype(np.int64),
    )


def _linked(seen: Links, on: BoolMap, reach_px: float) -> tuple[Links, Links]:
    """The same shadows between the surfaces beside them, and those beside none that contradict
    their step.

    Both ends go on along their row to the first pixel of a surface.
    """
    columns = np.arange(on.shape[1])
    before = np.maximum.accumulate(np.where(on, columns, -1), axis=1)
    beyond = np.minimum.accumulate(np.where(on, columns, columns.size)[:, ::-1], axis=1)[:, ::-1]
    first = before[seen.rows[:, 0], seen.columns[:, 0]]
    last = beyond[seen.rows[:, 1], seen.columns[:, 1]]
    near = np.stack(
        (
            (first >= 0) & (seen.columns[:, 0] - first < reach_px),
            (last < columns.size) & (last - seen.columns[:, 1] < reach_px),
        ),
        axis=1,
    )
    places = np.where(near, np.stack((first, last), axis=1), seen.columns)
    used = np.asarray(near.all(axis=1))
    unused = ~used & (seen.whole != 0)
    there = seen._replace(columns=places)
    return _chosen(there, used), _chosen(there, unused)
