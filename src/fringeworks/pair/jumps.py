"""Jumps of a displacement, and creases, which only look like them (theory §4, "Cliffs")."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.types import BoolMap

SLOPE_STEPS, SLOPE_AWAY_PX = 5, 8
"""Number of steps between neighbours whose median is a slope, and their distance from a jump, which
windows and lenses spread over some pixels."""
CREASE_PX = 4.5
"""Smallest typical ratio of a jump to the change of the slope across it, px. That of a crease is by
how much it is misplaced: 2 to 4 px on a photographed pyramid; cliffs have 5 and more."""
TINY_SLOPE = 1e-3
"""Smallest change of a slope, px per px, that a jump is divided by."""


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
