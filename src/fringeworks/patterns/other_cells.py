"""Cells of Gray codes with which a plan would have another number of frames."""

from __future__ import annotations

import math
from dataclasses import replace

from fringeworks.patterns.gray_code import GrayCode
from fringeworks.patterns.plan import PatternPlan
from fringeworks.types import InputError

FACTORS = (2.0, 0.5, 4.0, 0.25)
"""Widths of cells that are tried, over those of the plan: up to two bits more or less."""


def cells_for_count(plan: PatternPlan, count: int) -> str:
    """What a plan with as many frames as there are would say, as the end of a message.

    Width and height of the projector may be exchanged, or cells have another width, by few factors;
    empty where neither does it. Where two axes have a code, both change first.

    Examples
    --------
    >>> plan = PatternPlan(64, 48, (GrayCode("x", 4.0, 64, inverse=True),))
    >>> plan.frames, cells_for_count(plan, 6).partition("has ")[2]
    (8, 'step_px = 8, or others from 8 to 16')
    """
    codes = [block for block in plan.blocks if isinstance(block, GrayCode)]
    groups = [codes, *([code] for code in codes if len(codes) > 1)]
    fitting = []
    # Projectors are wider than high: only then may the plan have them exchanged.
    if codes and plan.width_px < plan.height_px and _exchanged(plan) == count:
        size = f"{plan.height_px} columns and {plan.width_px} rows"
        fitting.append(f"width and height of the projector are exchanged ({size})")
    cells = (
        " and ".join(_told(group, factor))
        for group in groups
        for factor in FACTORS
        if group and _frames(plan, group, factor) == count
    )
    fitting += [text for text in (next(cells, ""),) if text]
    return f"; the number fits this plan if {', or if '.join(fitting)}" if fitting else ""


def _exchanged(plan: PatternPlan) -> int | None:
    """Number of frames with width and height of the projector exchanged; None where there is no
    such plan."""
    other = {"x": plan.height_px, "y": plan.width_px}
    try:
        blocks = tuple(
            replace(block, length_px=other[block.axis]) if isinstance(block, GrayCode) else block
            for block in plan.blocks
        )
        exchanged = replace(plan, width_px=plan.height_px, height_px=plan.width_px, blocks=blocks)
        return exchanged.frames
    except InputError:
        return None


def _told(codes: list[GrayCode], factor: float) -> list[str]:
    """Cells of codes in words: any number of cells up to a power of two takes as many frames."""
    said = []
    for code in codes:
        length = code.length_px - code.offset_px
        bits = code.bits - round(math.log(factor, code.levels)) if code.levels == 2 else None
        step = f"the Gray code along {code.axis} has step_px = {factor * code.step_px:g}"
        least, most = (length / 2 ** ((bits or 1) - k) for k in (0, 1))
        said.append(f"{step}, or others from {least:.4g} to {most:.4g}" if bits else step)
    return said


def _frames(plan: PatternPlan, group: list[GrayCode], factor: float) -> int | None:
    """Number of frames with other cells of some codes; None where there is no such plan."""
    try:
        blocks = [
            replace(block, step_px=factor * block.step_px)
            if isinstance(block, GrayCode) and any(block is code for code in group)
            else block
            for block in plan.blocks
        ]
        return replace(plan, blocks=tuple(blocks)).frames
    except InputError:
        return None
