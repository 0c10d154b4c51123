"""The texture image of a scene: how it looks under even light."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps, Uniform, step_design
from fringeworks.stack.frames import check_frames
from fringeworks.stack.gray_light import light_of_bits
from fringeworks.types import FloatMap, InputError

ROWS = 32
"""Rows of the frames that are added up together: 250 kB of sums for 1920 columns."""

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
        Without any of them, the mean of the backgrounds of unequal steps. Without fringes, the mean
        of the fully lit bits of Gray codes; places that no bit lights stay dark.

    Raises
    ------
    InputError
        If the number of frames is not the plan's, a frame differs in size or type, or the plan has
        a Gray code with several levels of brightness only.
    """
    planes = check_frames(frames, plan)
    weights = texture_weights(plan)
    if not weights:
        lit = light_of_bits(planes, plan)
        if lit is None:
            raise InputError(
                "plan: expected a white frame, phase steps, or a Gray code with two levels of "
                "brightness to compute the texture image, got none of them"
            )
        return np.asarray(lit, np.float32)
    total: FloatMap = np.zeros(planes[0].shape, np.float32)
    # Some rows of all frames after one another, so that their sums stay in the processor's cache.
    for start in range(0, len(total), ROWS):
        rows = slice(start, start + ROWS)
        for k, weight in weights.items():
            part = planes[k][rows]
            total[rows] += part if weight == 1.0 else np.float32(weight) * part
    return np.asarray(total / sum(weights.values()), np.float32)


def texture_weights(plan: PatternPlan) -> dict[int, float]:
    """Weights of the frames whose mean shows the scene under even light; empty where none do so."""
    weights = {k: 1.0 for first, block in plan.placed for k in _even(first, block)}
    return {plan.places[k]: w for k, w in (weights or _background_weights(plan)).items()}


def _background_weights(plan: PatternPlan) -> dict[int, float]:
    """Weights of the frames of unequal steps whose sum is the background, without fringes.

    The least-squares fit of I_n = A + c cos δ_n + s sin δ_n gives A as a weighted sum of the
    frames, for steps of any size.
    """
    weights: dict[int, float] = {}
    for first, block in plan.placed:
        if isinstance(block, PhaseSteps):
            background = np.linalg.pinv(step_design(block.shifts_rad))[0]
            # A set counts by the inverse variance of its background.
            share = 1.0 / float(background @ background)
            weights |= {first + n: share * float(w) for n, w in enumerate(background)}
    return weights


def _even(first: int, block: PhaseSteps | GrayCode | Uniform) -> range:
    """Indices of a block's frames if their light adds up to even light; otherwise none."""
    frames = range(first, first + block.frames)
    if isinstance(block, Uniform):
        return frames if block.kind == "white" else range(0)
    if isinstance(block, GrayCode):
        return frames if block.inverse else range(0)
    sums = step_design(block.shifts_rad).sum(axis=0)
    return frames if np.hypot(sums[1], sums[2]) < EVEN * block.frames else range(0)
