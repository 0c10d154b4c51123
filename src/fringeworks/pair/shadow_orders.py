"""Fringe orders of surfaces beside cliffs, by the shadows that the cliffs cast.

Two frames cannot distinguish steps that differ by a whole fringe period. The width of a shadow is
the step that casts it: the ray that grazes the cliff lights both ends a and b of the shadow, so
that a − u(a) = b − u(b).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.pair.order_range import AWAY, SHADOW_TOLERANCE, dark_pixels, shadows_along
from fringeworks.pair.prepared import PreparedPair
from fringeworks.signal.filters import widened
from fringeworks.types import BoolMap, DisplacementMap, FloatMap, Frozen, Reason, sealed
from fringeworks.types.packages import cv2

MIN_SHADOW = 0.5
"""Shortest shadow whose width is read, periods. The dark part of a fringe has 0.2 periods. A step
that is measured in the wrong direction casts a shadow of more than 0.5 periods."""
MIN_LINES = 8
"""Fewest lines through the shadows of a surface by which its order is corrected. Marks and dirt
have fewer."""
LEVEL = 0.12
"""Largest difference of the displacement of a surface from that at its shadows, periods. Where a
surface differs from its surroundings by less, the two are not separated, and are only reported."""
AGREEMENT = 0.8
"""Least share of the lines of a surface that must show the same number of periods."""
FLAT = 0.05
"""Largest range of the displacement over half a period around a cliff, periods. A steeper place may
be the flank of a smooth surface that has the same level by chance."""
FLAT_SHARE = 0.9
"""Least share of a level surface, and of its surroundings, that must be flat or unknown. The
surface then ends at cliffs all around."""
RING = (0.75, 1.25)
"""Smallest and largest distance of these surroundings, periods: filters smear a cliff over about
one period."""
LARGEST = 0.4
"""Largest share of the frame that is moved. A larger surface is the background."""
UNKNOWN_PX = 1e9
"""Value of unknown displacements while surfaces are filled: no level surface reaches it."""
MAX_SURFACES = 64
"""Largest number of surfaces that are examined; it bounds the time."""


@dataclass(frozen=True, eq=False, repr=False)
class ShadowOrders(Frozen):
    """Corrections of the fringe orders by shadows; maps are (h, w), as captured."""

    moved: NDArray[np.int16]
    """Whole periods that were added."""
    refused: BoolMap
    """Surfaces that their shadows contradict, and the edges of those that were moved."""
    open_lines: int
    """Lines whose shadow differs by whole periods from the step, without a surface to move."""


class _Seen(NamedTuple):
    """Shadows along lines, (n,) arrays; rows and columns of the prepared pair."""

    rows: NDArray[np.intp]
    """(n, 2), of the pixels before and beyond the shadow."""
    columns: NDArray[np.intp]
    """(n, 2)"""
    whole: NDArray[np.int16]
    """Whole periods by which the second is further from the first than measured."""


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
    The displacement, and the corrections. A level surface that ends at cliffs all around is moved
    by whole periods where its shadows show the same number of them. Any other level surface that
    its shadows contradict is NaN (``ORDER_AMBIGUOUS``), and so are the edges of both.

    Notes
    -----
    Lines run along the normal of the fringes, at an angle θ to the axis. A shadow of the width ℓ
    along the axis belongs to a step of ℓ/cos²θ along the axis.
    """
    turn, period = prepared.to_capture, found.period_px
    u = np.asarray(turn(found.displacement_px), np.float64)
    seen = _seen(prepared, u, period)
    moved, refused = np.zeros(u.shape, np.int16), np.zeros(u.shape, bool)
    open_lines, steep = 0, _steep(u, period)
    for surface, wholes in _surfaces(u, seen, period):
        whole = int(np.median(wholes))
        agree = float(np.mean(wholes == whole))
        if surface is None or wholes.size < MIN_LINES:
            open_lines += int(np.count_nonzero(wholes))
        elif whole and agree >= AGREEMENT and _ends_at_cliffs(surface, steep, period):
            moved[surface] = whole
            refused |= widened(surface, max(1, round(AWAY * period)))
        elif whole or agree < AGREEMENT:
            refused |= widened(surface, max(1, round(AWAY * period)))
    refused &= moved == 0
    orders = ShadowOrders(sealed(turn(moved)), sealed(turn(refused)), open_lines)
    return _corrected(found, orders), orders


def _corrected(found: DisplacementMap, orders: ShadowOrders) -> DisplacementMap:
    """The displacement with other orders."""
    if not (orders.moved.any() or orders.refused.any()):
        return found
    reason = found.reason.copy()
    lost = orders.refused & np.isfinite(found.displacement_px)
    reason[lost] = Reason.ORDER_AMBIGUOUS

    def blank(values: FloatMap, kind: np.dtype[np.floating]) -> FloatMap:
        return sealed(np.where(lost, np.nan, values).astype(kind, copy=False))

    u = found.displacement_px
    return replace(
        found,
        displacement_px=blank(u + found.period_px * orders.moved, u.dtype),
        sigma_px=blank(found.sigma_px, found.sigma_px.dtype),
        modulation_ratio=blank(found.modulation_ratio, found.modulation_ratio.dtype),
        reason=sealed(reason),
    )


def _seen(prepared: PreparedPair, u: FloatMap, period_px: float) -> _Seen:
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

    dark = taken(dark_pixels(prepared.object, period_px)) * inside
    away = max(1, round(AWAY * period_px))
    painted = taken(dark_pixels(prepared.reference, period_px))
    line, first, last = shadows_along(dark, painted, MIN_SHADOW * period_px, away)
    before, beyond = first - away, last - 1 + away
    displacement = taken(u)
    step = displacement[line, beyond] - displacement[line, before]
    periods = ((last - first) * (1.0 + slope**2) - step) / period_px
    sure = np.abs(periods - np.round(periods)) < SHADOW_TOLERANCE  # not where a step is unknown
    line, before, beyond = line[sure], before[sure], beyond[sure]
    return _Seen(
        np.stack((rows[line, before], rows[line, beyond]), axis=1),
        np.stack((before, beyond), axis=1),
        np.round(periods[sure]).astype(np.int16),
    )


def _surfaces(
    u: FloatMap, seen: _Seen, period_px: float
) -> list[tuple[BoolMap | None, NDArray[np.int16]]]:
    """Level surfaces beside shadows, and the whole periods that each of their lines adds to them;
    None for what cannot be separated from the background."""
    found: list[tuple[BoolMap | None, NDArray[np.int16]]] = []
    todo = seen.whole != 0
    known = np.nan_to_num(u, nan=UNKNOWN_PX).astype(np.float32)
    while todo.any() and len(found) < MAX_SURFACES:
        first = int(np.flatnonzero(todo)[0])
        sides = [
            _level(known, seen.rows[first, k], seen.columns[first, k], period_px) for k in (0, 1)
        ]
        sizes = [surface.mean() for surface in sides]
        side = int(np.argmin(sizes))
        surface = sides[side]
        ends = [surface[seen.rows[:, k], seen.columns[:, k]] for k in (0, 1)]
        separate = ends[0] != ends[1]
        separate[first] &= sizes[side] <= LARGEST
        wholes = np.where(ends[1], seen.whole, -seen.whole)[separate]
        if separate[first]:
            found.append((surface, wholes))
            todo &= ~separate
        else:
            found.append((None, seen.whole[first : first + 1]))
        todo[first] = False
    return found


def _steep(u: FloatMap, period_px: float) -> BoolMap:
    """Pixels around which the displacement is not flat, (h, w)."""
    side = 2 * max(1, round(0.25 * period_px)) + 1
    high = scipy.ndimage.maximum_filter(np.nan_to_num(u, nan=-np.inf), side)
    low = scipy.ndimage.minimum_filter(np.nan_to_num(u, nan=np.inf), side)
    return np.asarray(np.isfinite(u) & (high - low > FLAT * period_px))


def _ends_at_cliffs(surface: BoolMap, steep: BoolMap, period_px: float) -> bool:
    """Whether a level surface is flat, and its surroundings too: it ends at cliffs then."""
    near, far = (widened(surface, max(1, round(d * period_px))) for d in RING)
    inside = ~widened(~surface, max(1, round(AWAY * period_px)))
    parts = (far & ~near, inside)
    return all(part.any() and float(np.mean(~steep[part])) >= FLAT_SHARE for part in parts)


def _level(u: NDArray[np.float32], row: int, column: int, period_px: float) -> BoolMap:
    """The connected pixels whose displacement is about that of one of them, (h, w)."""
    filled = np.zeros((u.shape[0] + 2, u.shape[1] + 2), np.uint8)
    range_px = LEVEL * period_px
    flags = cv2.FLOODFILL_FIXED_RANGE | cv2.FLOODFILL_MASK_ONLY | 4
    cv2.floodFill(u, filled, (int(column), int(row)), 0.0, range_px, range_px, flags)
    return np.asarray(filled[1:-1, 1:-1] > 0)
