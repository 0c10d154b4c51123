"""Cliffs: walls that no window may see through, from a pair of frames (theory §4, "Cliffs")."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.pair.windows import Fitted, Windows, mean_square, unexplained, usual_noise
from fringeworks.signal.filters import box_mean, median_of_nine, widened
from fringeworks.types import BoolMap

SLOPE_STEPS, SLOPE_AWAY_PX = 5, 8
"""Number of steps between neighbours whose median is a slope, and their distance from a jump, which
windows and lenses spread over some pixels."""
CREASE_PX = 4.5
"""Smallest typical ratio of a jump to the change of the slope across it, px. That of a crease is by
how much it is misplaced: 2 to 4 px on a photographed pyramid; cliffs have 5 and more."""
TINY_SLOPE = 1e-3
"""Smallest change of a slope, px per px, that a jump is divided by."""
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
"""Slope of the displacement beyond that of its surroundings, px per px, from which it may be a
cliff that windows have smeared; and how far these reach, in widths of the window."""
PAINT_EDGE = 0.3
"""Price of an edge of the albedo below which its surface is not offered."""
REACH_WIDTHS, REACH_PX = 4, 8
"""Largest distance of a surface that is offered: so many widths of the window, and px."""
MARGINS_PX, BASES_PX = (6, 3), (8, 5)
"""Distance behind the first explained pixel at which a surface is taken, and base of its slopes,
px: when the windows have smeared the cliff, and when they know where it is."""
MAX_CHANGE_PERIODS = 0.5
"""Largest correction of a displacement: a larger one would change the fringe order."""
SAME_PERIODS = 1.0 / 300.0
"""Difference up to which two surfaces at a pixel count as the same one."""
SMEAR_WIDTHS = 2
"""Distance from a cliff up to which a window smears it, widths of the window."""
WALL_PERIODS = 1.0 / 30.0
"""Difference between neighbours that makes a wall: less does not harm a window."""
KEPT_SHARE = 0.25
"""Share of it from which a wall that was found before stays one."""
SAMPLE_STEPS = (4, 2)
"""Every so many rows and columns are tried first, in large places and in small ones, to tell cliffs
from other places."""
SMALL_PLACE_PX = 4000
"""Number of pixels up to which a place is small."""
MIN_MOVED_SHARE = 0.08
"""Share of the pixels of a place that must find another surface. At cliffs, 0.1 to 0.5 of them do;
at edges of paint, up to 0.06."""
CERTAIN_SHARE = 0.3
"""The same in all such places together, for cliffs that are certain: steps of the paint every few
fringes reach 0.24."""
CHANCE_SIGMAS = 2.0
"""By so many standard deviations such a share may be larger by chance."""
NEAR_WALL_PX = 4
"""Distance from a wall up to which pixels are mixed and tell nothing about the rest."""
NEAR_WIDTHS = 2.5
"""Distance from a wall up to which windows that do not know it see past it, widths."""


class Jumps:
    """Differences between the neighbours of a displacement, along both axes.

    Parameters
    ----------
    u : (h, w) float32 array
        Displacement, px; finite.
    """

    def __init__(self, u: NDArray[np.float32]) -> None:
        self._shape = u.shape
        self._along = [_jump_and_bend(u, axis) for axis in (0, 1)]

    def beyond(self, limit_px: float) -> BoolMap:
        """Pixels on either side of a jump of more than a limit, (h, w)."""
        walls = np.zeros(self._shape, bool)
        for axis, (jump, _) in enumerate(self._along):
            for side in _sides(axis):
                walls[side] |= jump > limit_px
        return walls

    def without_creases(self, walls: BoolMap, zone: BoolMap) -> BoolMap:
        """Without the walls of places where they jump little against the change of the slope."""
        if not walls.any():
            return walls
        jump, bend = np.zeros(self._shape, np.float32), np.zeros(self._shape, np.float32)
        for axis, (here, change) in enumerate(self._along):
            first, _ = _sides(axis)
            larger = here > jump[first]
            jump[first] = np.where(larger, here, jump[first])
            bend[first] = np.where(larger, change, bend[first])
        places, count = scipy.ndimage.label(zone)
        ratio = jump[walls] / np.maximum(bend[walls], np.float32(TINY_SLOPE))
        typical = scipy.ndimage.median(ratio, places[walls], np.arange(count + 1))
        is_cliff = np.nan_to_num(typical) > CREASE_PX
        return np.asarray(walls & is_cliff[places])


def _jump_and_bend(
    u: NDArray[np.float32], axis: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Differences of neighbours beyond the slope on either side, and the change of that slope."""
    step = np.diff(u, axis=axis)
    size = (SLOPE_STEPS, 1) if axis == 0 else (1, SLOPE_STEPS)
    slope = scipy.ndimage.median_filter(step, size=size, mode="nearest")
    at = np.arange(step.shape[axis])
    before = np.take(slope, np.maximum(at - SLOPE_AWAY_PX, 0), axis)
    after = np.take(slope, np.minimum(at + SLOPE_AWAY_PX, at[-1]), axis)
    return np.minimum(np.abs(step - before), np.abs(step - after)), np.abs(after - before)


def _sides(axis: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """The pixels before, and those after, the differences along an axis."""
    if axis == 0:
        return np.s_[:-1, :], np.s_[1:, :]
    return np.s_[:, :-1], np.s_[:, 1:]


class Surfaces(NamedTuple):
    """A model of the object frame; (h, w) maps. It shows offset + gain · s(x − u)."""

    u: NDArray[np.float32]
    """Displacement, px; finite."""
    offset: NDArray[np.float32]
    gain: NDArray[np.float32]

    @staticmethod
    def of(
        found: Fitted, start_px: NDArray[np.float32], albedo: NDArray[np.float32] | None
    ) -> Surfaces:
        """What windows found, and a start where they found nothing."""
        known = np.isfinite(found.displacement_px)
        offset = np.where(known, found.offset, np.float32(0))
        gain = np.where(known, found.modulation_ratio, np.float32(1))
        if albedo is not None:
            offset, gain = albedo * offset, albedo * gain
        return Surfaces(np.where(known, found.displacement_px, start_px), offset, gain)

    def left(self, windows: Windows) -> NDArray[np.float32]:
        """What the model leaves of the object, (h, w), in modulations; NaN without data."""
        value, _, known = windows.warp(self.u)
        left = windows.object - self.offset - self.gain * value
        return np.where(known > 0, left, np.float32(np.nan))


@dataclass(frozen=True, eq=False)
class Offers:
    """The surfaces that are explained, and what a pixel must gain to take one of them."""

    windows: Windows
    surfaces: Surfaces
    clean: BoolMap
    """Where a surface is explained, and offered to others."""
    most: NDArray[np.float32]
    """Mean squared misfit of a patch that an offer must stay below."""
    width_px: float
    """Width of the windows that found the surfaces."""
    is_first: bool
    """Whether these windows did not know where cliffs are."""

    @staticmethod
    def of(
        windows: Windows,
        surfaces: Surfaces,
        left: NDArray[np.float32],
        width_px: float,
        edge_weight: NDArray[np.float32] | None,
        is_first: bool,
    ) -> Offers:
        """Find what is explained by what the surfaces leave; edges of the albedo are not."""
        patches = mean_square(left)
        noise = CLEAN_NOISE * usual_noise(patches, windows.object_noise) + CLEAN_SHARE
        rough = _steep(surfaces.u, width_px)
        if edge_weight is not None:
            rough |= edge_weight < PAINT_EDGE
        clean = (mean_square(left, CLEAN_PX) < noise) & np.isfinite(left)
        clean &= ~widened(rough, 3 if is_first else 1)
        most = np.maximum(np.float32(IMPROVEMENT) * patches, np.float32(noise))
        return Offers(windows, surfaces, clean, most, width_px, is_first)

    def taken(self, where: BoolMap) -> Surfaces:
        """The surfaces after pixels that are not clean have taken the best offers."""
        windows = self.windows
        return Surfaces(
            *_core.relocate_surfaces(
                windows.pair,
                {
                    "displacement": self.surfaces.u,
                    "offset": self.surfaces.offset,
                    "gain": self.surfaces.gain,
                },
                {
                    "clean": self.clean.astype(np.uint8),
                    "present": np.where(where & ~self.clean, self.most, np.float32(0)),
                    "reach": int(REACH_WIDTHS * self.width_px) + REACH_PX,
                    "margin": MARGINS_PX[0 if self.is_first else 1],
                    "base": BASES_PX[0 if self.is_first else 1],
                    "max_change": MAX_CHANGE_PERIODS * windows.period_px,
                    "same": SAME_PERIODS * windows.period_px,
                },
            )
        )

    def continued(self, where: BoolMap) -> Surfaces:
        """The same without single pixels that took another surface than those around them."""
        taken = self.taken(where)
        median = median_of_nine(taken.u)
        return taken._replace(u=np.where(where & ~self.clean, median, taken.u))


def _steep(u: NDArray[np.float32], width_px: float) -> BoolMap:
    """Where the displacement is much steeper than around."""
    side = 2 * int(STEEP_WIDTHS * width_px) + 1
    steep = np.zeros(u.shape, bool)
    for axis in (0, 1):
        slope: NDArray[np.float32] = np.gradient(u, axis=axis)
        around = box_mean(slope, side, "edge")
        steep |= np.abs(slope - around) > STEEP
    return steep


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

    def start_from(self, start_px: NDArray[np.float32], width_px: float) -> NDArray[np.float32]:
        """Displacement to start windows of a width from: smooth, but not across walls."""
        wide = widened(self.walls, int(3 * width_px))
        within = _core.smooth_within_walls(
            self.displacement_px, self.walls.astype(np.uint8), 0.5 * width_px
        )
        return np.where(wide, within, start_px)


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
    surfaces = Surfaces.of(found, start_px, albedo)
    left = surfaces.left(windows)
    offers = Offers.of(windows, surfaces, left, width_px, edge_weight, before is None)
    poor = unexplained(left, windows.object_noise)
    if before is None:
        poor, certain = _places_of_cliffs(poor, offers, WALL_PERIODS * windows.period_px)
    else:
        poor, certain = poor & before.zone, before.certain
    if before is None and not poor.any():
        return None
    zone = widened(poor, int(SMEAR_WIDTHS * width_px))
    if before is not None:
        zone |= before.zone
    better = offers.continued(zone)
    walls = _walls(better.u, zone, WALL_PERIODS * windows.period_px, before)
    left = np.where(widened(walls, NEAR_WALL_PX), np.float32(0), better.left(windows))
    near = widened(walls, int(NEAR_WIDTHS * width_px))
    return Cliffs(better.u, walls, zone, near, certain, left)


def _walls(
    u: NDArray[np.float32], zone: BoolMap, limit_px: float, before: Cliffs | None
) -> BoolMap:
    jumps = Jumps(u)
    walls = jumps.beyond(limit_px) & zone
    if before is None:
        return walls
    walls |= before.walls & jumps.beyond(KEPT_SHARE * limit_px)
    return jumps.without_creases(walls, zone)


def _places_of_cliffs(
    poor: BoolMap,
    offers: Offers,
    limit_px: float,
) -> tuple[BoolMap, bool]:
    """Of the places that are poorly explained, those where many pixels find another surface, and
    whether they are certain to be cliffs."""
    places, count = scipy.ndimage.label(poor)
    small = (np.bincount(places.ravel()) <= SMALL_PLACE_PX)[places]
    sampled = np.zeros_like(poor)
    for step, where in zip(SAMPLE_STEPS, (poor, poor & small), strict=True):
        sampled[::step, ::step] |= where[::step, ::step]
    far = sampled & (np.abs(offers.taken(sampled).u - offers.surfaces.u) > limit_px)
    tried, found = (np.bincount(places[where], minlength=count + 1) for where in (sampled, far))
    least = found - CHANCE_SIGMAS * np.sqrt(found + 1)
    is_cliff = least > MIN_MOVED_SHARE * tried
    certain = bool(found[is_cliff].sum() > CERTAIN_SHARE * tried[is_cliff].sum())
    return is_cliff[places] & poor, certain
