"""How far surfaces have moved between two cycles, by the cells of a Gray code."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fringeworks.patterns.gray_code import GrayCode
from fringeworks.patterns.plan import PatternPlan
from fringeworks.stack.motion import phase_sets
from fringeworks.types import Axis, FloatMap
from fringeworks.types.packages import cv2

AROUND_PX = 15
"""Side of the median filter on the distances, px: cells are wrong at single pixels, where a bit
changes between two frames or noise exceeds a weak contrast."""
MIDDLE = 128
"""Count that stands for no motion in an image of 8 bits, which the filter needs; distances of more
than 127 cells are cut off there. Velocities are taken up to a few cells a cycle."""


def code_of(plan: PatternPlan, axis: Axis) -> tuple[int, GrayCode] | None:
    """The Gray code of two levels along an axis that has fringes too, and its first frame."""
    for first, block in plan.placed:
        if isinstance(block, GrayCode) and block.axis == axis and block.levels == 2:
            return (first, block.used) if plan.phase_sets(axis) else None
    return None


def code_distance(
    one: Sequence[FloatMap], other: Sequence[FloatMap], plan: PatternPlan, axis: Axis
) -> FloatMap | None:
    """Return the distance between two cycles by a Gray code, px; None without one.

    Parameters
    ----------
    one, other : (h, w) arrays in the order of the plan, counts
    plan : PatternPlan
    axis : "x" or "y"

    Notes
    -----
    Bits are taken at other times than the fringes, and at different ones each. Both cycles do so
    alike, so that the difference of their cells belongs to the time between them. It is wrong by
    about a cell, which tells the period.
    """
    found = code_of(plan, axis)
    if found is None:
        return None
    first, code = found
    change = _cells(other, first, code, plan) - _cells(one, first, code, plan)
    image = np.clip(change + MIDDLE, 0, 2 * MIDDLE - 1).astype(np.uint8)
    median = cv2.medianBlur(image, AROUND_PX).astype(np.float32) - np.float32(MIDDLE)
    return np.asarray(median * np.float32(code.step_px), np.float32)


def _cells(planes: Sequence[FloatMap], first: int, code: GrayCode, plan: PatternPlan) -> FloatMap:
    """The cell of every pixel: a bit is lit where it is brighter than the mean of the fringes."""
    start, block = min(phase_sets(plan), key=lambda one: one[1].period_px)
    level = np.mean([planes[start + k] for k in range(block.frames)], axis=0)
    cell = np.zeros(level.shape, np.int64)
    bit = np.zeros(level.shape, bool)
    for k in range(code.bits):
        frame = first + (2 * k if code.inverse else k)
        lit = planes[frame] > (planes[frame + 1] if code.inverse else level)
        # A bit of a Gray code tells whether that of the cell's number changes.
        bit = bit ^ lit ^ (k in code.inverted_bits)
        cell = 2 * cell + bit
    return np.asarray(cell)
