"""Cliffs: walls that no window may see through, from a pair of frames (theory §4, "Cliffs")."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.pair.jumps import Jumps
from fringeworks.pair.misfit import unexplained
from fringeworks.pair.surfaces import Offers, Surfaces
from fringeworks.pair.windows import Fitted, Windows
from fringeworks.signal.filters import widened
from fringeworks.types import BoolMap

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
