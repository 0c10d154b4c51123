"""What a scene looks like by itself: frames of a stack that add up to even light."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps, Uniform, step_design
from fringeworks.types import FloatMap, InputError


def texture(
    frames: NDArray[Any] | Sequence[NDArray[Any]], plan: PatternPlan
) -> NDArray[np.float32]:
    """The scene under even light, with as little noise as the stack allows.

    Parameters
    ----------
    frames : (n, h, w) array or sequence of (h, w) arrays
        In the order of the plan.
    plan : PatternPlan

    Returns
    -------
    (h, w) float32, counts: the mean of white frames, of phase steps whose sum is even, and of bits
    with their inverse.

    Raises
    ------
    InputError where nothing in the plan adds up to even light.
    """
    if len(frames) != plan.frames:
        raise InputError(f"frames: the plan has {plan.frames}, got {len(frames)}")
    chosen = [k for first, block in plan.placed for k in _even(first, block)]
    if not chosen:
        raise InputError(
            "plan: expected a white frame, equal phase steps or Gray code with its inverse, to see "
            "the scene by itself; got none"
        )
    total: FloatMap = np.zeros(np.shape(frames[0]), np.float32)
    for k in chosen:
        total += frames[k]
    return np.asarray(total / len(chosen), np.float32)


def _even(first: int, block: PhaseSteps | GrayCode | Uniform) -> range:
    every = range(first, first + block.frames)
    if isinstance(block, Uniform):
        return every if block.kind == "white" else range(0)
    if isinstance(block, GrayCode):
        return every if block.inverse else range(0)
    sums = step_design(block.shifts_rad).sum(axis=0)
    return every if np.hypot(sums[1], sums[2]) < 1e-6 * block.frames else range(0)
