"""Fringe orders of two frames: what a range of depths, and the shadows, tell of them.

Two frames cannot distinguish steps that differ by a whole fringe period. A range of depths excludes
orders, and the width of a shadow is the displacement of the step that casts it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.pair.plane_evidence import TINY_PERIODS, periods_at
from fringeworks.pair.prepared import PreparedPair
from fringeworks.pair.reference_phase import REJECTED_MADS, phase_nodes
from fringeworks.rig.depth_range import DepthRange
from fringeworks.types import (
    BoolMap,
    CoordinateMap,
    DisplacementMap,
    FloatMap,
    Frozen,
    Reason,
    sealed,
)

HELD_SHARE = 0.99
"""Least share of the pixels in a range of depths that holds the surface: noise and rims put fewer
than 1 % of the pixels outside."""
MIN_SHADOW = 0.6
"""Shortest shadow that is compared, periods: a step of a whole period casts a longer one, and the
dark part of a fringe is shorter (0.4 periods with a response of γ = 2.2, see ``DARK``)."""
DARK = 0.1
"""Largest brightness in a shadow, as a share of that of the fringes around it, from their darkest
to their brightest. A sinusoidal fringe is that dark over a fifth of its period."""
DARK_SIGMAS = 3.0
"""Standard deviations by which noise lowers the darkest of some hundred pixels."""
SURROUNDINGS = 3.0
"""Distance up to which the fringes around a pixel are looked at, periods: shadows up to twice as
wide have lit fringes on one side at least."""
AWAY = 0.5
"""Distance from the ends of a shadow at which the displacement is read, periods: filters and
windows mix what is closer."""
SHADOW_TOLERANCE = 0.3
"""Largest deviation of a shadow from whole periods more than the step, periods: a filter sees both
of its ends to a few px only. An empirical choice."""


@dataclass(frozen=True, eq=False, repr=False)
class OrderCheck(Frozen):
    """What a range of depths says of the fringe orders."""

    moved: BoolMap
    """Pixels that were moved by whole periods, (h, w)."""
    lost: BoolMap
    """Pixels without an order in the range, or with several of which theirs is none, (h, w)."""
    open: BoolMap
    """Pixels for which the range holds further orders, (h, w): theirs continues the rim's."""


def projector_period(prepared: PreparedPair, known: CoordinateMap) -> float | None:
    """Period of the reference's fringes in the projector, px; None where it cannot be measured.

    The phase of nodes is compared with the coordinates of the plane, by a line, twice.
    """
    nodes = phase_nodes(prepared)
    if nodes is None:
        return None
    phase = periods_at(prepared, nodes)
    turned = known.coordinate_px if prepared.carrier.axis == "x" else known.coordinate_px.T
    rows, columns = (np.rint(v).astype(np.intp) for v in (nodes.rows, nodes.columns))
    q = np.asarray(turned[rows, columns], np.float64)
    keep = np.isfinite(q)
    for _ in range(2):
        if np.count_nonzero(keep) < 2:
            return None
        line = np.polynomial.Polynomial.fit(q[keep], phase[keep], 1).convert()
        left = np.abs(phase - line(q))
        keep = left <= REJECTED_MADS * max(float(np.median(left[keep])), TINY_PERIODS)
    return float(abs(1.0 / line.coef[1]))


def orders_in_range(
    found: CoordinateMap, depth: DepthRange, period_px: float
) -> tuple[CoordinateMap, OrderCheck]:
    """Correct fringe orders that lead out of a range of depths.

    Parameters
    ----------
    found : CoordinateMap
        Coordinates of the object.
    depth : DepthRange
    period_px : float
        Period of the fringes in the projector, px.

    Returns
    -------
    The coordinates, moved by whole periods where exactly one order leads into the range; NaN
    (``OUTSIDE_DEPTH``) where none does, or where most of the scene would have to be moved, and
    (``ORDER_AMBIGUOUS``) where others than the pixel's own do. And what was done.
    """
    fewest, most = depth.orders(found, period_px)
    with np.errstate(invalid="ignore"):
        measured = np.isfinite(found.coordinate_px)
        none = measured & ~(fewest <= most)
        own = measured & (fewest <= 0) & (most >= 0)
        moved = measured & ~own & (fewest == most)
        several = measured & ~own & (fewest < most)
    if np.count_nonzero(moved) > np.count_nonzero(own):
        # The range holds less than half of the scene: it is wrong, and so is what fits by chance.
        none, moved = none | moved, np.zeros_like(moved)
    reason = found.reason.copy()
    reason[none], reason[several] = Reason.OUTSIDE_DEPTH, Reason.ORDER_AMBIGUOUS
    lost = none | several
    x = found.coordinate_px + np.where(moved, period_px * np.nan_to_num(fewest), 0.0)
    corrected = replace(
        found,
        coordinate_px=sealed(np.where(lost, np.nan, x)),
        sigma_px=sealed(np.where(lost, np.nan, found.sigma_px)),
        reason=sealed(reason),
    )
    return corrected, OrderCheck(moved, lost, own & (fewest < most))


def moved_into_range(
    found: CoordinateMap, depth: DepthRange, period_px: float
) -> tuple[CoordinateMap, int, float | None]:
    """Move a surface whose whole periods are unknown into a range of depths.

    Parameters
    ----------
    found : CoordinateMap
        Coordinates of an object that fills the frame.
    depth : DepthRange
    period_px : float
        Period of the fringes in the projector, px.

    Returns
    -------
    The coordinates, moved; the whole periods, those in the range that are the fewest; and their
    standard deviation, from all orders in the range. None where none holds the surface: it is not
    moved then.
    """
    fewest, most = depth.orders(found, period_px)
    measured = np.isfinite(found.coordinate_px)
    fewest, most = fewest[measured], most[measured]
    if not fewest.size:
        return found, 0, None
    ends = (fewest.min(), most.max())
    if not np.isfinite(ends).all():
        return found, 0, None
    # Noise and rims put a few pixels outside; another order puts a part of the surface there.
    orders = np.arange(ends[0], ends[1] + 1.0)
    inside = [float(np.mean((fewest <= n) & (most >= n))) for n in orders]
    held = orders[np.array(inside) >= HELD_SHARE]
    if not held.size:
        return found, 0, None
    order = int(held[np.argmin(np.abs(held))])
    x = found.coordinate_px + period_px * order
    spread = float(np.sqrt(np.mean((held - order) ** 2)))
    return replace(found, coordinate_px=sealed(x)), order, spread


def shadows_without_step(prepared: PreparedPair, found: DisplacementMap) -> BoolMap:
    """Find shadows that are wider by whole periods than the steps beside them.

    Parameters
    ----------
    prepared : PreparedPair
    found : DisplacementMap
        Of that pair.

    Returns
    -------
    (h, w) bool array: the pixels without fringes in such shadows.

    Notes
    -----
    The ray that grazes a step lights both ends a and b of its shadow, so that a − u(a) = b − u(b).
    """
    turn, period = prepared.to_capture, found.period_px
    u = turn(found.displacement_px)
    away = max(1, round(AWAY * period))
    marked = np.zeros(u.shape, bool)
    dark, painted = dark_places(prepared)
    row, first, last = shadows_along(dark, painted, MIN_SHADOW * period, away)
    step = u[row, last - 1 + away] - u[row, first - away]
    more = (last - first - step) / period
    wide = (np.abs(more) > 0.5) & (np.abs(more - np.round(more)) < SHADOW_TOLERANCE)
    for line, start, end in zip(row[wide], first[wide], last[wide], strict=True):
        marked[line, start:end] = True
    return turn(marked)


def shadows_along(
    dark: NDArray[np.int8], painted: NDArray[np.int8], least_px: float, away: int
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Find the shadows along lines.

    Parameters
    ----------
    dark, painted : (r, l) arrays
        1 where the object, and where the reference, is dark.
    least_px : float
        Length of the shortest shadow.
    away : int
        Pixels that a line must go on for before and beyond a shadow.

    Returns
    -------
    line, first, last : (n,) arrays
        The last is the first pixel beyond. What is as dark on the reference is paint, or a hole.
    """
    ends = np.diff(np.pad(dark, ((0, 0), (1, 1))), axis=1)
    (line, first), (_, last) = np.nonzero(ends > 0), np.nonzero(ends < 0)
    sums = np.pad(np.cumsum(painted, axis=1, dtype=np.int32), ((0, 0), (1, 0)))
    kept = (last - first >= least_px) & (first >= away) & (last - 1 + away < dark.shape[1])
    kept &= 2 * (sums[line, last] - sums[line, first]) <= last - first
    return line[kept], first[kept], last[kept]


def dark_places(prepared: PreparedPair) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
    """1 where the object, and where the reference, is dark, (h, w) each.

    Notes
    -----
    ``DARK`` of the fringes' contrast must exceed the noise of pixels by ``DARK_SIGMAS`` on either
    side. Where it does not, frames are averaged along the fringes.
    """
    found = []
    for frame, noise in zip(
        (prepared.object, prepared.reference), prepared.noise[::-1], strict=True
    ):
        spread = DARK_SIGMAS * float(np.sqrt(noise)) / (DARK * prepared.modulation)
        rows = int(np.clip(np.ceil(spread**2), 1, max(1, prepared.period)))
        counts = np.asarray(frame, np.float64)
        averaged = scipy.ndimage.uniform_filter1d(counts, rows, axis=0) if rows > 1 else counts
        found.append(dark_pixels(averaged, prepared.period))
    return found[0], found[1]


def dark_pixels(frame: FloatMap, period_px: float) -> NDArray[np.int8]:
    """1 where a frame is about as dark as its darkest pixel nearby, (h, w)."""
    size = (1, 2 * round(SURROUNDINGS * period_px) + 1)
    low = scipy.ndimage.minimum_filter(frame, size)
    high = scipy.ndimage.maximum_filter(frame, size)
    return np.asarray(frame < low + DARK * (high - low), np.int8)
