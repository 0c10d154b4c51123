"""The frames that are decoded, with white and black light from Gray codes where it is missing."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import GrayCode, PatternPlan, Uniform
from fringeworks.stack.frames import Planes
from fringeworks.types import FloatMap

FULLY_LIT = 0.75
"""Brightness between the darkest (0) and the brightest bit (1) of a pixel, from which on a bit
counts as fully lit. Of the bits of a Gray code only one is on a border between two cells at a
place, and blurred bits lie lower. Empirical."""


def plan_with_light(plan: PatternPlan) -> PatternPlan:
    """The plan of the frames that are decoded, in the projector's own pixels, with a white and a
    black frame where a Gray code has nothing to be compared with."""
    plan, _ = plan.used
    missing = _missing(plan)
    return replace(plan, blocks=(*plan.blocks, *missing)) if missing else plan


def with_light(planes: Planes, plan: PatternPlan) -> tuple[Planes, PatternPlan]:
    """The frames that are decoded, with computed white and black frames where a Gray code has
    nothing to be compared with.

    Parameters
    ----------
    planes : (h, w) arrays in the order of the plan, counts
    plan : PatternPlan

    Returns
    -------
    planes, plan
        Those that are used. The brightest and the darkest sample of every pixel among all bits are
        the white and the black frame that the plan lacks.

    Notes
    -----
    A pixel whose bits are all dark, or all lit, has no contrast and counts as shadow. With Gray
    codes along both axes, that is one place of the projector each. With one axis it would be the
    whole first cell, so such a code is not completed.
    """
    plan, used = plan.used
    planes = [planes[k] for k in used]
    missing = _missing(plan)
    if not missing:
        return planes, plan
    darkest, brightest = _range(planes, plan)
    computed = [brightest if block.kind == "white" else darkest for block in missing]
    return [*planes, *computed], plan_with_light(plan)


def light_of_bits(planes: Planes, plan: PatternPlan) -> FloatMap | None:
    """The scene under full light, from Gray codes of two levels; None where the plan has none.

    Returns
    -------
    (h, w) float32 array, counts
        The mean of the fully lit bits of every pixel; dark where all bits are dark.
    """
    bits = _bits(plan)
    if not bits:
        return None
    darkest, brightest = (frame.astype(np.float32) for frame in _range(planes, plan))
    least = darkest + np.float32(FULLY_LIT) * (brightest - darkest)
    total, count = np.zeros_like(least), np.zeros_like(least)
    for k in bits:
        lit = planes[k] >= least
        total += np.where(lit, planes[k], 0)
        count += lit
    return np.asarray(total / np.maximum(count, 1), np.float32)


def _bits(plan: PatternPlan) -> list[int]:
    """Indices of the frames of all Gray codes with two levels of brightness."""
    codes = codes_of_two_levels(plan)
    return [plan.places[k] for first, code in codes for k in range(first, first + code.frames)]


def codes_of_two_levels(plan: PatternPlan) -> list[tuple[int, GrayCode]]:
    """The Gray codes with two levels of brightness, each with the number of its first pattern."""
    codes = [(first, block) for first, block in plan.placed if isinstance(block, GrayCode)]
    return [(first, code) for first, code in codes if code.levels == 2]


def _missing(plan: PatternPlan) -> list[Uniform]:
    """The uniform frames that a Gray code needs and the plan does not have.

    They can be computed where there is a Gray code along both axes: a pixel then sees dark and lit
    bits nearly everywhere.
    """
    codes = [block for block in plan.blocks if isinstance(block, GrayCode) and block.levels == 2]
    alone = [code for code in codes if not code.inverse and not plan.phase_sets(code.axis)]
    if not alone or len(codes) < 2:
        return []
    return [Uniform(kind) for kind in ("white", "black") if plan.uniform(kind) is None]


def _range(planes: Planes, plan: PatternPlan) -> tuple[NDArray[Any], NDArray[Any]]:
    """The darkest and the brightest bit of every pixel, (h, w), counts."""
    bits = _bits(plan)
    darkest, brightest = planes[bits[0]].copy(), planes[bits[0]].copy()
    for k in bits[1:]:
        np.minimum(darkest, planes[k], out=darkest)
        np.maximum(brightest, planes[k], out=brightest)
    return darkest, brightest
