"""Surfaces that are too far from all others for anything to tell their whole periods."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.types import BoolMap

FREE_PERIODS = 1.3
"""Distance from which on a surface does not continue another, periods: across a wider gap a flank
may climb a period. Ray-cast boxes and balls of right orders lie up to 0.7 periods from the surface
around them, the faces of a photographed pyramid less than 1.3, and tops of balls that are off by a
period 1.5 and more."""
FREE_AREA = 1.0
"""Smallest such surface, square periods: smaller ones are scraps on a flank."""

Places = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Rows and columns of pixels."""


def free_surfaces(on: BoolMap, told: Places, period_px: float, least: int) -> BoolMap:
    """Surfaces without a neighbour that tells their order, and the broken places around them.

    Parameters
    ----------
    on : (h, w) bool array
        Where the surface continues.
    told : rows and columns
        Places whose order something else tells.
    period_px : float
    least : int
        Fewest such places that tell the order of a surface.
    """
    place, count = scipy.ndimage.label(on)
    reach = FREE_PERIODS * period_px
    known = np.zeros(count + 1, bool)
    for side in (place[0], place[-1], place[:, 0], place[:, -1]):
        known[side] = True
    known |= np.bincount(place[told].ravel(), minlength=count + 1) >= least
    known[0] = False
    large = np.bincount(place.ravel(), minlength=count + 1) > FREE_AREA * period_px**2
    large[0] = False
    while (large & ~known).any():
        if not known.any():
            return np.zeros(on.shape, bool)  # nothing has an order that could be compared
        near = scipy.ndimage.distance_transform_edt(~known[place]) < reach
        found = known.copy()
        found[place[near & on]] = True
        if (found == known).all():
            break
        known = found
    free: BoolMap = (large & ~known)[place]
    if not free.any():
        return free
    around = scipy.ndimage.distance_transform_edt(~free) < 2.0 * reach
    return np.asarray(around & ~known[place])
