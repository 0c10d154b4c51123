"""The frames of a Gray code, and how far the kernel trusts its cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.patterns.chain_search import ORDER_SIGMAS
from fringeworks.patterns.gray_code import (
    DOUBT_SIGMAS,
    FRAME_MINUS_MEAN,
    NARROW_CONTRAST,
    RESOLVED_SHARE,
)
from fringeworks.patterns.order_chain import GRAY_REACH
from fringeworks.patterns.plan import GrayCode, PatternPlan
from fringeworks.types import BoolMap, CameraNoise, FloatMap, FramesContradictPlan, InputError

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

ALIEN_SHARE = 1.75
"""Largest distance of a bit from its threshold, in contrasts of white and black frames or of a bit
and its inverse, besides noise. Beyond it, light was added or taken away between the frames.

Light between surfaces makes up to 1.3. An empirical choice.
"""

ALIEN_SHARE_OF_FRINGES = 3.0
"""The same in modulations of the fringes, which blur makes smaller than those of the code.

An empirical choice: with blur that halves the modulation, 1.5 times the code's contrast.
"""

NARROW_CELL_TURNS = 0.25
"""Width of Gray-code cells, in periods, below which their bits may have any contrast. Empirical."""

HALF_DIFFERENCE = 0.5
"""Variance of half the difference of a bit and its inverse, in variances of one frame."""

WIDEST_CELLS = 2.0
"""Largest half width of the range that the bits of a pixel without fringes may leave, in cells that
most pixels resolve. On the border of two cells it is one cell, and two where the pixel resolves a
bit less. A pixel that resolves far less than the others does not see the projector's light blurred,
but light of other surfaces, and the range would not hold its coordinate."""

BLUR_FLOOR = 0.05
"""Smallest blur of a border, in cells, so that its width stays above zero where no bit is in
doubt."""

MIN_LEVEL_PIXELS = 200
"""Smallest number of pixels for a statement about the levels of brightness. An empirical choice."""

ONE_SIDED = 0.1
"""Share of the pixels on which a bit must be firmly dark, and firmly bright, to count as resolved.

Cameras that code light by sRGB show stripes that they do not resolve at 0.7 of white, so that all
pixels would be firmly bright. Stripes as fine as those that matter show both halves. In two
simulated photographs, unresolved bits had 0.00 and resolved ones 0.25 and more.
"""

ALIEN_PAIR = 0.5
"""Distance of the mean of a bit and its inverse from that of all pairs, in contrasts, from which on
the frames are no pair: half of what two bright or two dark frames have."""

ALIEN_PAIRS = 0.1
"""Share of such pixels from which on a bit is not called unresolved: two frames that are
independent of each other have half, and noise none."""

CLEAR_SHARE = 0.75
"""Distance of a bit from its threshold, in contrasts, from which on its sign is beyond doubt."""

BEYOND_SHARE = 0.02
"""Share of clear pixels with a cell that the plan does not have, from which on the plan is doubted:
indirect light and motion make single ones. Empirical."""

CLEAR_LEVELS = 12.0
"""Smallest distance of two levels of brightness in a sample that is judged, in standard deviations.

Noise then moves a sample by up to a tenth of that distance. An empirical choice.
"""

MAX_OFF_LEVEL = 0.2
"""Largest median distance of the samples from the nearest level, in distances of two levels.

Linear responses reach 0.1, because of noise and blur. With four levels γ = 1.5 makes 0.4 and
γ = 2.2 makes 0.25. Empirical.
"""

MIN_LEVEL_SHARE = 0.02
"""Smallest share of the samples that every level of brightness has.

The finest digit shows all levels nearly equally often, so that each has several per cent with up to
16 levels and few digits. A strong response moves a level onto the next one. Empirical.
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
    inverted: frozenset[int] = frozenset()
    """Bits that show light for dark, 0 being the most significant one."""
    resolved_px: float | None = None
    """Width of the narrowest cells that the camera resolves at most pixels, projector px; None for
    ``step_px``."""
    farthest_px: float = 0.0
    """Largest coordinate that many pixels show beyond the plan's cells, projector px; or 0."""
    beyond_share: float = 0.0
    """Share of the pixels with clear bits that show cells beyond the plan's, if there are many."""
    blurred_px: float = float("inf")
    """Distance from the border of two cells within which blur leaves its bit in doubt, projector
    px; infinite where unknown."""
    doubt_share: float = NARROW_CONTRAST
    """Share of its contrast below which a bit of a code without fringes is in doubt."""

    def without_finest(self, count: int) -> GrayFrames:
        """The code without its finest bits: fewer and wider cells."""
        if count == 0:
            return self
        return replace(
            self,
            bits=self.bits[:-count],
            inverse=self.inverse[:-count],
            step_px=self.step_px * 2**count,
            cells=-(-self.cells // 2**count),
            inverted=frozenset(bit for bit in self.inverted if bit < len(self.bits) - count),
        )

    def _alien_share(self) -> float:
        if self.inverse or self.white_black is not None:
            return ALIEN_SHARE
        return ALIEN_SHARE_OF_FRINGES

    def kernel(
        self,
        place: dict[int, int],
        period_px: float,
        reach_px: float | None,
        shifted_px: float = 0.0,
    ) -> _core._GrayCode:
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
        shifted_px : float
            Error of the phases that is no noise, projector px: a coordinate one period away must
            keep it from the cell, too.
        """
        usual = GRAY_REACH * self.step_px
        reach = usual if reach_px is None else reach_px
        wide = self.step_px > WIDE_CELL_TURNS * period_px
        share = BORDER_CONTRAST if wide or self.levels > 2 else NARROW_CONTRAST
        if np.isfinite(period_px) and self.step_px < NARROW_CELL_TURNS * period_px:
            # Blur takes the contrast of fine bits everywhere.
            share = 0.0
        elif not np.isfinite(period_px):
            share = max(share, self.doubt_share)
        white_black = self.white_black
        return {
            "bits": [place[k] for k in self.bits],
            "inverse": [place[k] for k in self.inverse],
            "white_black": white_black and (place[white_black[0]], place[white_black[1]]),
            "levels": self.levels,
            "inverted": sum(1 << (len(self.bits) - 1 - bit) for bit in self.inverted),
            "step": self.step_px,
            "offset": self.offset_px,
            "cells": self.cells,
            "doubt_share": share,
            "alien_share": self._alien_share(),
            "widest": WIDEST_CELLS * (self.resolved_px or self.step_px),
            "blurred": max(self.blurred_px, BLUR_FLOOR * self.step_px),
            "slack": reach - 0.5 * self.step_px,
            # Without a limit of the reach, any coordinate is accepted.
            "guard": GRAY_GUARD * self.step_px + shifted_px if np.isfinite(reach) else -reach,
            "confidence": ORDER_SIGMAS,
        }


def gray_frames(plan: PatternPlan, first: int, block: GrayCode, *, phases: bool) -> GrayFrames:
    """The frames of a Gray code, and of the light that its bits are compared with."""
    white, black = plan.uniform("white"), plan.uniform("black")
    white_black = None if white is None or black is None else (white, black)
    frames = range(first, first + block.frames)
    inverted = block.inverted_bits
    if block.inverse:
        # An inverted bit and its inverse take the place of each other.
        pairs = list(zip(frames[::2], frames[1::2], strict=True))
        pairs = [pair[::-1] if k in inverted else pair for k, pair in enumerate(pairs)]
        bits, inverse = tuple(a for a, _ in pairs), tuple(b for _, b in pairs)
        white_black, inverted = None, frozenset()
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
    shares = [steps.even_share for _, steps in plan.phase_sets(block.axis)]
    if white_black is None and not inverse and any(share != 0.5 for share in shares):
        raise InputError(
            "Gray code: expected inverse bits, or a white and a black frame, to compare the bits "
            "with, got lines, whose mean light is not half of white"
        )
    return GrayFrames(
        bits,
        inverse,
        white_black,
        block.step_px,
        block.cells,
        block.offset_px,
        block.levels,
        inverted,
    )


@dataclass(frozen=True)
class Resolution:
    """What the camera resolves of a Gray code."""

    unresolved: int = 0
    """Number of finest bits whose stripes blur: they are in doubt at most lit pixels."""
    blurred_px: float = float("inf")
    """Distance from a border within which blur leaves a bit in doubt, projector px; infinite where
    unknown."""
    farthest_px: float = 0.0
    """Largest coordinate that many pixels show, projector px, also beyond the plan's; 0 where it is
    unknown or within the plan's cells."""
    beyond_share: float = 0.0
    """Share of the clear pixels beyond them, if they are many."""
    doubt_share: float = NARROW_CONTRAST
    """Share of its contrast below which a bit is in doubt: more where half of the light is not half
    of the counts."""


def resolution(gray: GrayFrames, sample: Sequence[NDArray[Any]], noise: CameraNoise) -> Resolution:
    """What the camera resolves of a Gray code.

    Parameters
    ----------
    gray : GrayFrames
    sample : (1, n) arrays, one per frame of the plan, counts
    noise : CameraNoise

    Returns
    -------
    Resolution
        Unknown for codes of more than two levels, and for those that are compared with fringes.

    Notes
    -----
    A bit is in doubt as for the kernel. The finest bit that is resolved has stripes of 2w cells: it
    is in doubt at a share 2z / 2w of the pixels, where z is the distance from a border within which
    blur leaves it in doubt.
    """
    if gray.levels > 2 or not (gray.inverse or gray.white_black):
        return Resolution()
    others = gray.inverse or gray.white_black or ()
    frames = np.stack([sample[k][0].astype(np.float64) for k in (*gray.bits, *others)])
    frames = frames[:, np.isfinite(frames).all(axis=0)]
    bits, rest = frames[: len(gray.bits)], frames[len(gray.bits) :]
    if gray.inverse:
        off, per_frame = 0.5 * (bits - rest), HALF_DIFFERENCE
        contrast, pairs = np.abs(off).max(axis=0), 0.5 * (bits + rest)
        light = np.median(pairs, axis=0)
        alien = np.abs(pairs - light) > ALIEN_PAIR * contrast
    else:
        contrast, light, per_frame = 0.5 * (rest[0] - rest[1]), rest.mean(axis=0), FRAME_MINUS_MEAN
        off, alien = bits - light, np.zeros(bits.shape, bool)
    sigma = np.sqrt(per_frame * noise.variance(light))
    lit = contrast > CLEAR_LEVELS * sigma
    if np.count_nonzero(lit) < MIN_LEVEL_PIXELS:
        return Resolution()
    share, both = _doubt_share(off[:, lit], contrast[lit], sigma[lit])
    limit = np.maximum(DOUBT_SIGMAS * sigma, share * contrast)[lit]
    firm = np.mean(np.abs(off[:, lit]) > limit, axis=1)
    # Frames that are no bit and its inverse are in a wrong order, and blurred no more than others.
    strange = np.mean(alien[:, lit], axis=1) > ALIEN_PAIRS
    firm[strange] = 1.0
    resolved = np.flatnonzero((firm >= RESOLVED_SHARE) & (both | strange))
    if not resolved.size:
        return Resolution(len(firm) - 1)
    unresolved = len(firm) - 1 - int(resolved[-1])
    width = gray.step_px * 2**unresolved
    # Where half of the light is not half of the counts, or a bit and its inverse do not add up to
    # it, brightness tells no place within a border.
    unknown = share > NARROW_CONTRAST or strange[resolved[-1]]
    blurred = float("inf") if unknown else float(1.0 - firm[resolved[-1]]) * width
    kept = len(firm) - unresolved
    clear = lit & (np.abs(off[:kept]) > CLEAR_SHARE * contrast).all(axis=0)
    beyond = _beyond(gray, off[:kept, clear] > 0.0, width)
    return Resolution(unresolved, blurred, *beyond, share)


def _doubt_share(off: FloatMap, contrast: FloatMap, sigma: FloatMap) -> tuple[float, BoolMap]:
    """Share of the contrast below which bits are in doubt, and which bits may be resolved.

    ``off`` is the distance of every bit, (bits, n), from its threshold, counts. Finest bits of
    which no pixel is firm on one side show half of the light everywhere. How far that is from the
    threshold, other bits may be, too, before they are firm.
    """
    limit = np.maximum(DOUBT_SIGMAS * sigma, NARROW_CONTRAST * contrast)
    dark, bright = np.mean(off < -limit, axis=1), np.mean(off > limit, axis=1)
    both = np.minimum(dark, bright) >= ONE_SIDED
    last = int(np.flatnonzero(both)[-1]) if both.any() else len(off) - 1
    allowed = np.arange(len(off)) <= last
    one_sided = ~allowed & (np.maximum(dark, bright) >= RESOLVED_SHARE)
    level = np.abs(np.median(off / contrast, axis=1))
    # A wide stripe that covers the view, as in frames of another order, is as bright as white.
    if not one_sided.any() or level[one_sided].max() > CLEAR_SHARE:
        return NARROW_CONTRAST, np.ones(len(off), bool)
    half = float(level[-1])
    return half + NARROW_CONTRAST * (1.0 - half), np.asarray(allowed)


def _beyond(gray: GrayFrames, lit: BoolMap, width_px: float) -> tuple[float, float]:
    """Largest coordinate of clear bits, (bits, n), projector px, and the share of pixels beyond the
    cells; 0 where they are few."""
    flipped = np.isin(np.arange(len(lit)), sorted(gray.inverted))
    binary = np.bitwise_xor.accumulate(lit ^ flipped[:, None], axis=0)
    cell = (1 << np.arange(len(lit))[::-1]) @ binary
    cells = -(-gray.cells * gray.step_px // width_px)
    beyond = float(np.mean(cell >= cells)) if cell.size >= MIN_LEVEL_PIXELS else 0.0
    if not beyond > BEYOND_SHARE:
        return 0.0, 0.0
    farthest = float(np.quantile(cell, 1.0 - 0.5 * BEYOND_SHARE) + 1) * width_px + gray.offset_px
    return farthest, beyond


def refuse_unequal_levels(
    gray: GrayFrames, sample: Sequence[NDArray[Any]], noise: CameraNoise
) -> None:
    """Refuse a Gray code whose levels of brightness are not equally spaced.

    Parameters
    ----------
    gray : GrayFrames
    sample : (1, n) arrays, one per frame of the plan, counts
    noise : CameraNoise
    """
    if gray.levels == 2 or gray.white_black is None:
        return
    frames = [sample[k].astype(np.float64) for k in gray.white_black]
    white, black = (np.where(np.isfinite(frame), frame, np.nan) for frame in frames)
    spacing = (white - black) / (gray.levels - 1)
    lit = np.isfinite(spacing) & (spacing > CLEAR_LEVELS * np.sqrt(noise.variance(white)))
    if lit.sum() < MIN_LEVEL_PIXELS:
        return
    digits = [sample[k].astype(np.float64)[lit] for k in gray.bits]
    level = np.stack([(digit - black[lit]) / spacing[lit] for digit in digits])
    level = level[np.isfinite(level)]
    nearest = np.clip(np.rint(level), 0, gray.levels - 1)
    # The darkest and the brightest level are right by definition.
    inner = (level > MAX_OFF_LEVEL) & (level < gray.levels - 1 - MAX_OFF_LEVEL)
    off = float(np.median(np.abs(level - nearest)[inner])) if inner.any() else 0.0
    shares = [float(np.mean(nearest == k)) for k in range(gray.levels)]
    if off > MAX_OFF_LEVEL or min(shares) < MIN_LEVEL_SHARE:
        raise FramesContradictPlan(
            f"Gray code: expected {gray.levels} equally spaced levels of brightness, got samples "
            f"between them; correct the projector's response (gamma of the plan)"
        )
