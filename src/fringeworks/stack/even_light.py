"""The texture image of a scene, from frames whose light adds up to even light."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps, Uniform, step_design
from fringeworks.stack.frames import check_frames
from fringeworks.types import FloatMap, InputError

EVEN = 1e-6
"""Largest mean of e^{iδ} over the steps of a set whose fringes cancel in the sum.

It lies far above the rounding of double precision and far below any deliberate shift.
"""


def texture(
    frames: NDArray[Any] | Sequence[NDArray[Any]], plan: PatternPlan
) -> NDArray[np.float32]:
    """Compute the texture image: the scene under even light, with little noise.

    Parameters
    ----------
    frames : (n, h, w) array or sequence of (h, w) arrays, counts
        uint8, uint16, float32 or float64 in the order of the plan, with any byte order and strides.
    plan : PatternPlan

    Returns
    -------
    (h, w) float32 array, counts
        The mean of all white frames, sets of equal steps, and Gray codes with their inverse.

    Raises
    ------
    InputError
        If the number of frames is not the plan's, a frame differs in size or type, or the plan has
        no such frames.
    """
    planes = check_frames(frames, plan)
    chosen = [k for first, block in plan.placed for k in _even(first, block)]
    if not chosen:
        raise InputError(
            "plan: expected a white frame, equal phase steps or a Gray code with its inverse to "
            "compute the texture image, got none of them"
        )
    total: FloatMap = np.zeros(planes[0].shape, np.float32)
    for k in chosen:
        total += planes[k]
    return np.asarray(total / len(chosen), np.float32)


def _even(first: int, block: PhaseSteps | GrayCode | Uniform) -> range:
    """Indices of a block's frames if their light adds up to even light; otherwise none."""
    frames = range(first, first + block.frames)
    if isinstance(block, Uniform):
        return frames if block.kind == "white" else range(0)
    if isinstance(block, GrayCode):
        return frames if block.inverse else range(0)
    sums = step_design(block.shifts_rad).sum(axis=0)
    return frames if np.hypot(sums[1], sums[2]) < EVEN * block.frames else range(0)
