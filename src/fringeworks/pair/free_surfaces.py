"""Surfaces that are too far from all others for anything to tell their whole periods."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.types import BoolMap

FREE_PERIODS = 1.0
"""Distance from which on a surface does not continue another, periods: across a wider gap a flank
may climb a period. Ray-cast boxes and balls of right orders lie up to 0.7 periods from the surface
around them, and tops of balls and domes that are off by a period 1.1 and more."""
FREE_AREA = 2.0
"""Smallest such surface, square periods: the creases of a rough surface leave patches of 1.5."""
STEP_AREA = 0.25
"""Smallest surface that may lie between two others as a step, square periods: smaller ones are
scraps on a flank, whose own order is as likely wrong."""
Places = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Rows and columns of pixels."""


def free_surfaces(on: BoolMap, links: Places, period_px: float, least: int) -> BoolMap:
    """Surfaces without a neighbour that tells their order, and the broken places around them.

    Parameters
    ----------
    on : (h, w) bool array
        Where the surface continues.
    links : rows and columns, (n, 2) each
        Pairs of places whose orders are known to fit together.
    period_px : float
    least : int
        Fewest such pairs that join two surfaces.

    Notes
    -----
    The rim of the frame is known; from there on, surfaces are that lie close to known ones, or that
    links join to them.
    """
    place, count = scipy.ndimage.label(on)
    reach = FREE_PERIODS * period_px
    known = np.zeros(count + 1, bool)
    for side in (place[0], place[-1], place[:, 0], place[:, -1]):
        known[side] = True
    known[0] = False
    area = np.bincount(place.ravel(), minlength=count + 1) / period_px**2
    area[0] = 0.0
    large, step = area > FREE_AREA, area > STEP_AREA
    ends = place[links]
    while known.any() and (large & ~known).any():
        near = scipy.ndimage.distance_transform_edt(~known[place]) < reach
        joined = known[ends].any(axis=1)
        found = np.bincount(ends[joined].ravel(), minlength=count + 1) >= least
        found[place[near & on]] = True
        found = known | (found & step)
        if (found == known).all():
            break
        known = found
    free: BoolMap = (large & ~known)[place]
    if not (known.any() and free.any()):
        return np.zeros(on.shape, bool)  # without a known order there is nothing to compare with
    around = scipy.ndimage.distance_transform_edt(~free) < 2.0 * reach
    return np.asarray(around & ~known[place])
