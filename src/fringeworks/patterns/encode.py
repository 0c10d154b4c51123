"""The pictures of a plan, as counts to send to the projector."""

from __future__ import annotations

from collections.abc import Iterator
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.binary import diffused
from fringeworks.patterns.plan import (
    COLOURS,
    SOLID,
    LightColour,
    PatternPlan,
    Uniform,
    check_is_plan,
)
from fringeworks.types import FloatMap, InputError

DITHER_THRESHOLDS = 8
"""Number of thresholds of the ordered dither, and its period along both axes, px.

The mean over 8 pixels errs by at most 1/16 count instead of 1/2. More thresholds would be more
exact but need a longer stretch, over which defocus no longer averages. An empirical choice.
"""

SHARE_DECIMALS = 11
"""Decimals to which a share of full scale is rounded before it becomes a count.

A share of exactly ½ lies half-way between two counts, but the computed cosine misses it by up to
2e-12, in a direction that depends on the machine's mathematical library. Without the rounding, such
a pixel would be 127 on one machine and 128 on another. Rounded, it always becomes 128. The rounding
moves other values by less than 4e-7 counts even at 16 bits.
"""


def encode(plan: PatternPlan) -> Iterator[NDArray[np.unsignedinteger]]:
    """Draw the pictures of a plan, one after the other.

    Parameters
    ----------
    plan : PatternPlan

    Yields
    ------
    (height, width) arrays of counts 0 … 2^bits − 1: uint8 up to 8 bits, uint16 for more. With
    ``colours``, (height, width, 3) arrays with red, green and blue, and solid ones at the end;
    with a ``channel``, such arrays that are dark in the other two.

    Notes
    -----
    A value v becomes the count (2^bits − 1) v^(1/γ). It is rounded to the nearest whole count, with
    halves rounded up, or dithered. Pictures of 1 bit are drawn by error diffusion.

    Examples
    --------
    >>> from fringeworks.patterns.plan import PhaseSteps, equal_steps
    >>> plan = PatternPlan(64, 4, (PhaseSteps("x", 16.0, equal_steps(4)),))
    >>> [int(picture[0, 0]) for picture in encode(plan)]
    [255, 128, 0, 128]
    """
    check_is_plan(plan)
    if plan.channel is not None:
        for grey in _grey(plan):
            picture = np.zeros((*grey.shape, COLOURS), np.uint8)
            picture[..., get_args(LightColour).index(plan.channel)] = grey
            yield picture
        return
    if not plan.colours:
        yield from _grey(plan)
        return
    for three in _threes(_grey(plan)):
        yield np.stack(three, axis=-1)
    for name in SOLID:
        solid = np.zeros((plan.height_px, plan.width_px, COLOURS), np.uint8)
        if name != "black":
            solid[..., SOLID.index(name)] = 255
        yield solid


def _threes(
    frames: Iterator[NDArray[np.unsignedinteger]],
) -> Iterator[tuple[NDArray[np.unsignedinteger], ...]]:
    """Three frames at a time."""
    return zip(frames, frames, frames, strict=True)


def _grey(plan: PatternPlan) -> Iterator[NDArray[np.unsignedinteger]]:
    """Draw the frames of a plan in grey."""
    top = 2**plan.bits - 1
    kind = np.uint8 if plan.bits <= 8 else np.uint16
    shape = (plan.height_px, plan.width_px)
    patterns = [(block, n) for block in plan.blocks for n in range(block.frames)]
    for block, n in (patterns[k] for k in plan.order):
        down = not isinstance(block, Uniform) and block.axis == "y"
        position = np.arange(shape[0] if down else shape[1], dtype=np.float64)
        share = block.values(position, n) ** (1.0 / plan.gamma)
        line = top * np.round(share, SHARE_DECIMALS)
        picture = np.empty(shape, kind)
        if plan.bits == 1:
            lines = diffused(np.round(share, SHARE_DECIMALS), shape[1] if down else shape[0])
            picture[...] = lines.T if down else lines
        elif plan.dither:
            across = line[:, None] if down else line
            picture[...] = np.minimum(np.floor(across + _dither_thresholds(shape)), top)
        else:
            # One line is rounded, and repeated.
            counts = np.minimum(np.floor(line + 0.5), top)
            picture[...] = counts[:, None] if down else counts
        yield picture


def grey_pictures(plan: PatternPlan) -> Iterator[NDArray[np.unsignedinteger]]:
    """The pictures of a plan in grey, for what shows or sees no colours, or one alone.

    Raises
    ------
    InputError for a plan with colours.
    """
    refuse_colours(plan)
    return _grey(plan)


def refuse_colours(plan: PatternPlan) -> None:
    """Refuse a plan with colours where frames are shown or taken in grey."""
    if plan.colours:
        raise InputError(
            "plan: expected grey pictures here, got colours; capture and live take them with "
            "devices that show and see colours, and write_patterns draws them for other programs"
        )


def thrown(plan: PatternPlan) -> Iterator[NDArray[np.unsignedinteger]]:
    """The pictures of a plan as they leave the projector, mirrored where the plan says so.

    With ``colours`` or a ``channel``, as those of ``encode``.
    """
    rows, columns = (slice(None, None, -1 if axis in plan.mirrored else 1) for axis in ("y", "x"))
    for picture in encode(plan):
        yield picture[rows, columns]


def _dither_thresholds(shape: tuple[int, int]) -> FloatMap:
    """Thresholds of the ordered dither, (h, w), 0…1.

    They form a Latin square: every 8 pixels of a row or of a column hold all eight thresholds. The
    mean along fringes, where the pattern is constant, is therefore right.
    """
    y, x = np.ogrid[: shape[0], : shape[1]]
    return np.asarray(((5 * y + 3 * x) % DITHER_THRESHOLDS + 0.5) / DITHER_THRESHOLDS)
