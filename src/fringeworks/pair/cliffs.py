"""Cliffs: walls that no window may see through, from a pair of frames (theory §4, "Cliffs")."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringeworks import _core
from fringeworks.pair.misfit import (
    MIN_MISFIT_SHARE,
    mean_square,
    unexplained,
    usual_noise,
    widened,
)
from fringeworks.pair.windows import Fitted, Windows
from fringeworks.types import BoolMap, ByteMap

IMPROVEMENT = 0.6
"""Share of the present misfit of a patch that another surface must stay below. An empirical choice:
nearer to 1, noise would move pixels."""
CLEAN_NOISE = 2.0
"""Mean squared misfit up to which a place is explained, in variances of the usual noise."""
CLEAN_SHARE = 1e-4
"""The same as a share of the squared modulation, on frames without noise."""
CLEAN_PX = 11
"""Side of the squares that must be explained around a pixel whose surface is offered."""
STEEP, STEEP_WIDTHS = 0.4, 3
"""Slope of the displacement beyond that of its surroundings, px per px, from which it may be a cliff
that windows have smeared; and how far these reach, in widths of the window."""
PAINT_EDGE = 0.3
"""Price of an edge of the albedo below which its surface is not offered."""
SMEAR_WIDTHS = 2
"""Distance from a cliff up to which a window smears it, widths of the window."""
REACH_WIDTHS, REACH_PX = 4, 8
"""Largest distance of a surface that is offered: so many widths of the window, and px."""
FIRST, NEXT = {"margin": 6, "base": 8}, {"margin": 3, "base": 5}
"""Distance behind the first explained pixel at which a surface is taken, and base of its slopes, px:
when the windows have smeared the cliff, and when they know where it is."""
MAX_CHANGE_PERIODS = 0.5
"""Largest correction of a displacement: a larger one would change the fringe order."""
SAME_PERIODS = 1.0 / 300.0
"""Difference up to which two surfaces at a pixel count as the same one."""
WALL_PERIODS = 1.0 / 30.0
"""Difference between neighbours that makes a wall: less does not harm a window."""
SLOPE_STEPS, SLOPE_AWAY_PX = 5, 8
"""Number of steps between neighbours whose median is a slope, and their distance from a jump, which
windows and lenses spread over some pixels."""
CREASE_PX = 4.5
"""Smallest typical ratio of a jump to the change of the slope across it, px. The ratio at a crease is
by how much it is misplaced: 2 to 4 px on a photographed pyramid; cliffs have 5 and more."""
TINY_SLOPE = 1e-3
"""Smallest change of a slope, px per px, that a jump is divided by."""
KEPT_SHARE = 0.25
"""Share of it from which a wall that was found before stays one."""
MEDIAN_PX = 5
"""Side of the squares whose median removes single wrong surfaces."""
SAMPLE_STEP = 4
"""Every so many rows and columns are tried first, to tell cliffs from other places."""
MIN_MOVED_SHARE = 0.1
"""Share of the pixels of a place that must find another surface. At cliffs, 0.24 to 0.37 of them
do; at edges of paint, up to 0.02."""
CERTAIN_SHARE = 0.25
"""The same for cliffs that are certain: steps of the paint every few fringes reach 0.24."""
MIN_SAMPLES = 50
"""Smallest number of pixels that such a share is taken from."""
NEAR_WALL_PX = 4
"""Distance from a wall up to which pixels are mixed and tell nothing about the rest."""
TIED = 1.0
"""Price of an edge of the albedo near a cliff, whose errors it would imitate otherwise."""


class Cliffs(NamedTuple):
    """Where the displacement jumps, or bends; (h, w) maps."""

    displacement_px: NDArray[np.float32]
    """With the surfaces on either side continued up to the cliff."""
    walls: BoolMap
    """Pixels on either side of a jump; none where all places are creases."""
    zone: BoolMap
    """Where windows may have smeared a cliff."""
    near: BoolMap
    """Where ``displacement_px`` is better than what windows find that do not know the walls."""
    certain: bool
    """Whether edges of paint alone never look like this."""
    left: NDArray[np.float32]
    """What those surfaces leave of the object, in modulations; 0 on and beside walls."""

    def start_from(
        self, start_px: NDArray[np.float32], width_px: float
    ) -> NDArray[np.float32]:
        """Displacement to start windows of a width from: smooth, but not across walls."""
        wide = widened(self.walls, int(3 * width_px))
        within = _core.smooth_within_walls(
            self.displacement_px, self.walls.astype(np.uint8), 0.5 * width_px
        )
        return np.where(wide, within, start_px)


class _Model(NamedTuple):
    """u, and offset and gain with the albedo in them, of every pixel."""

    u: NDArray[np.float32]
    offset: NDArray[np.float32]
    gain: NDArray[np.float32]

    def left(self, windows: Windows) -> NDArray[np.float32]:
        """What the model leaves of the object, (h, w); NaN without data."""
        value, _, known = windows.warp(self.u)
        left = windows.object - self.offset - self.gain * value
        return np.where(known > 0, left, np.float32(np.nan))


def find_cliffs(
    windows: Windows,
    found: Fitted,
    start_px: NDArray[np.float32],
    width_px: float,
    *,
    albedo: NDArray[np.float32] | None = None,
    edge_weight: NDArray[np.float32] | None = None,
    before: Cliffs | None = None,
) -> Cliffs | None:
    """Find walls: where surfaces of either side explain the object, but no smooth one does.

    Parameters
    ----------
    windows : Windows
    found : Fitted
        What windows of about half a period found.
    start_px : (h, w) float32 array
        Displacement where they found none, px.
    width_px : float
        Width σ of these windows.
    albedo, edge_weight : (h, w) float32 arrays, optional
        What is known of the albedo, and the price of its edges.
    before : Cliffs, optional
        What an earlier search found, whose walls the windows knew.

    Returns
    -------
    Cliffs, or None where surfaces of either side explain no more than the windows do.
    """
    model = _model(found, start_px, albedo)
    left = model.left(windows)
    patches, wide = mean_square(left), mean_square(left, CLEAN_PX)
    usual = usual_noise(patches, windows.object_noise)
    floor = CLEAN_NOISE * usual + CLEAN_SHARE
    rough = _steep(model.u, width_px)
    if edge_weight is not None:
        rough |= edge_weight < PAINT_EDGE
    how = FIRST if before is None else NEXT
    clean = (wide < floor) & np.isfinite(left)
    clean &= ~widened(rough, 3 if before is None else 1)
    bar = IMPROVEMENT * np.maximum(patches, floor / IMPROVEMENT)

    def moved(where: BoolMap) -> _Model:
        present = np.where(where & ~clean, bar, np.float32(0))
        return _Model(
            *_core.relocate_surfaces(
                windows.spline,
                windows.object,
                windows.reference_ok,
                windows.object_ok,
                *model,
                clean=clean.astype(np.uint8),
                present=present,
                reach=int(REACH_WIDTHS * width_px) + REACH_PX,
                max_change=MAX_CHANGE_PERIODS * windows.period_px,
                same=SAME_PERIODS * windows.period_px,
                **how,
            )
        )

    limit = WALL_PERIODS * windows.period_px
    poor = unexplained(left, windows.object_noise)
    if before is None:
        poor, certain = _places_of_cliffs(poor, model.u, moved, limit)
        if not poor.any():
            return None
    else:
        poor &= before.zone
        certain = before.certain
    zone = widened(poor, int(SMEAR_WIDTHS * width_px))
    if before is not None:
        zone |= before.zone
    better = moved(zone)
    changed = zone & ~clean
    u = np.where(changed, cv2.medianBlur(better.u, MEDIAN_PX), better.u)
    walls = _jumps(u, limit) & zone
    if before is not None:
        walls |= before.walls & _jumps(u, KEPT_SHARE * limit)
        walls = _without_creases(walls, zone, u)
    left = better._replace(u=u).left(windows)
    left = np.where(widened(walls, NEAR_WALL_PX), np.float32(0), left)
    near = widened(walls, int(2.5 * width_px))
    return Cliffs(u, walls, zone, near, certain, left)


def _model(
    found: Fitted, start_px: NDArray[np.float32], albedo: NDArray[np.float32] | None
) -> _Model:
    known = np.isfinite(found.displacement_px)
    offset = np.where(known, found.offset, np.float32(0))
    gain = np.where(known, found.modulation_ratio, np.float32(1))
    if albedo is not None:
        offset, gain = albedo * offset, albedo * gain
    return _Model(np.where(known, found.displacement_px, start_px), offset, gain)


def _places_of_cliffs(
    poor: BoolMap,
    u: NDArray[np.float32],
    moved: Callable[[BoolMap], _Model],
    limit_px: float,
) -> tuple[BoolMap, bool]:
    """Of the places that are poorly explained, those where many pixels find another surface, and
    whether they are certain to be cliffs."""
    sampled = np.zeros_like(poor)
    sampled[::SAMPLE_STEP, ::SAMPLE_STEP] = poor[::SAMPLE_STEP, ::SAMPLE_STEP]
    far = sampled & (np.abs(moved(sampled).u - u) > limit_px)
    places, count = ndimage.label(poor)
    tried, found = (np.bincount(places[where], minlength=count + 1) for where in (sampled, far))
    enough = tried >= MIN_SAMPLES
    is_cliff = enough & (found > MIN_MOVED_SHARE * tried)
    certain = bool((enough & (found > CERTAIN_SHARE * tried)).any())
    return is_cliff[places] & poor, certain


def _steep(u: NDArray[np.float32], width_px: float) -> BoolMap:
    """Where the displacement is much steeper than around."""
    side = 2 * int(STEEP_WIDTHS * width_px) + 1
    steeper = [
        np.abs(slope - cv2.blur(slope, (side, side), borderType=cv2.BORDER_REPLICATE))
        for slope in np.gradient(u)
    ]
    return np.maximum(*steeper) > STEEP


def _jumps(u: NDArray[np.float32], limit_px: float) -> BoolMap:
    """Pixels on either side of a jump."""
    walls = np.zeros(u.shape, bool)
    for axis in (0, 1):
        jump, _ = _jump_and_bend(u, axis)
        for side in _sides(axis):
            walls[side] |= jump > limit_px
    return walls


def _without_creases(walls: BoolMap, zone: BoolMap, u: NDArray[np.float32]) -> BoolMap:
    """Without the walls of places where they jump little against the change of the slope."""
    jump, bend = np.zeros(u.shape, np.float32), np.zeros(u.shape, np.float32)
    for axis in (0, 1):
        here, change = _jump_and_bend(u, axis)
        first, _ = _sides(axis)
        larger = here > jump[first]
        jump[first] = np.where(larger, here, jump[first])
        bend[first] = np.where(larger, change, bend[first])
    places, count = ndimage.label(zone)
    ratio = jump[walls] / np.maximum(bend[walls], np.float32(TINY_SLOPE))
    typical = ndimage.median(ratio, places[walls], np.arange(count + 1))
    is_cliff = np.nan_to_num(typical) > CREASE_PX
    return walls & is_cliff[places]


def _jump_and_bend(
    u: NDArray[np.float32], axis: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Differences of neighbours beyond the slope on either side, and the change of that slope."""
    step = np.diff(u, axis=axis)
    size = (SLOPE_STEPS, 1) if axis == 0 else (1, SLOPE_STEPS)
    slope = ndimage.median_filter(step, size=size, mode="nearest")
    at = np.arange(step.shape[axis])
    before = np.take(slope, np.maximum(at - SLOPE_AWAY_PX, 0), axis)
    after = np.take(slope, np.minimum(at + SLOPE_AWAY_PX, at[-1]), axis)
    return np.minimum(np.abs(step - before), np.abs(step - after)), np.abs(after - before)


def _sides(axis: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """The pixels before, and those after, the differences along an axis."""
    if axis == 0:
        return np.s_[:-1, :], np.s_[1:, :]
    return np.s_[:, :-1], np.s_[:, 1:]
