"""The frames of a Gray code, and how far the kernel trusts its cells."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fringeworks.patterns.order_chain import GRAY_REACH, ORDER_SIGMAS
from fringeworks.patterns.plan import GrayCode, PatternPlan
from fringeworks.types import InputError

GRAY_GUARD = 0.02
"""Distance that a coordinate one period away keeps from a Gray-code cell, besides noise, in cells.

It allows for small systematic errors of the phase at the ends of a cell, 7° with cells of one
period. Larger values discard more pixels there, 4 % with this value where images are sharp;
narrower cells are not affected. An empirical choice.
"""

WIDE_CELL_TURNS = 0.75
"""Width of Gray-code cells, in periods, above which their blurred borders are looked for.

The coordinate of a wide cell is not unique near its ends. Narrower cells tolerate that the border
of the code lies up to an eighth of a period beside that of the fringes. An empirical choice.
"""

BORDER_CONTRAST = 0.5
"""Share of its full contrast below which a bit of a wide cell lies on the border of two cells.

A pixel on the blurred border of two cells may show either bit. The value must be well above the
error of the threshold, and below the contrast that indirect light leaves to narrow stripes. At 0.5
a pixel counts as border within 0.7 standard deviations of a Gaussian blur. An empirical choice.
"""


@dataclass(frozen=True)
class GrayFrames:
    """A Gray code: the indices of its frames in the plan, and of those that decide its bits."""

    bits: tuple[int, ...]
    """Index of every bit's frame, the most significant bit first."""
    inverse: tuple[int, ...]
    """Index of every inverse bit's frame; empty where there are none."""
    white_black: tuple[int, int] | None
    """Indices of the white and the black frame; None where they are missing or not needed."""
    step_px: float
    """Width of a cell, projector px."""
    cells: int
    """Number of cells."""
    offset_px: float = 0.0
    """Start of the first cell, projector px from the projector's edge."""
    levels: int = 2
    """Number of levels of brightness."""

    def kernel(
        self, place: dict[int, int], period_px: float, reach_px: float | None
    ) -> dict[str, Any]:
        """Settings for the kernel.

        Parameters
        ----------
        place : dict
            Place of every frame of the plan in the kernel's order.
        period_px : float
            Range over which the phases determine the coordinate, projector px.
        reach_px : float, optional
            Largest distance of a coordinate from the middle of its cell, projector px;
            ``GRAY_REACH`` cells where not given.
        """
        usual = GRAY_REACH * self.step_px
        reach = usual if reach_px is None else reach_px
        wide = self.step_px > WIDE_CELL_TURNS * period_px
        white_black = self.white_black
        return {
            "bits": [place[k] for k in self.bits],
            "inverse": [place[k] for k in self.inverse],
            "white_black": white_black and (place[white_black[0]], place[white_black[1]]),
            "levels": self.levels,
            "step": self.step_px,
            "offset": self.offset_px,
            "cells": self.cells,
            "doubt_share": BORDER_CONTRAST if wide or self.levels > 2 else 0.0,
            "slack": reach - 0.5 * self.step_px,
            # Without a limit of the reach, any coordinate is accepted.
            "guard": GRAY_GUARD * self.step_px if np.isfinite(reach) else -reach,
            "confidence": ORDER_SIGMAS,
        }


def gray_frames(plan: PatternPlan, first: int, block: GrayCode, *, phases: bool) -> GrayFrames:
    """The frames of a Gray code, and of the light that its bits are compared with."""
    white, black = plan.uniform("white"), plan.uniform("black")
    white_black = None if white is None or black is None else (white, black)
    frames = range(first, first + block.frames)
    if block.inverse:
        bits, inverse, white_black = tuple(frames[::2]), tuple(frames[1::2]), None
    else:
        bits, inverse = tuple(frames), ()
    if white_black is None and block.levels > 2:
        raise InputError(
            f"Gray code: expected a white and a black frame to tell its {block.levels} levels of "
            "brightness apart, got none"
        )
    if white_black is None and not inverse and not phases:
        raise InputError(
            "Gray code: expected inverse bits, a white and a black frame, or fringes along the "
            "same axis to compare the bits with, got none of them"
        )
    return GrayFrames(
        bits, inverse, white_black, block.step_px, block.cells, block.offset_px, block.levels
    )
