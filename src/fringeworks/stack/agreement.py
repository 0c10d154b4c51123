"""How well a sample agrees with its plan: residuals, sets, Gray code and neighbouring pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.patterns.order_chain import GRAY_REACH
from fringeworks.stack.fits import SampleFit
from fringeworks.stack.gray_frames import WIDE_CELL_TURNS, GrayFrames
from fringeworks.stack.kernel_settings import Decoding, Limits, empty_maps, lit_pixels
from fringeworks.stack.noise import MIN_JUDGED_PIXELS
from fringeworks.stack.sample import Sample
from fringeworks.statistics.chi_square import chi_square_quantile
from fringeworks.statistics.quantiles import median, quantile
from fringeworks.types import BoolMap, CameraNoise, FloatMap, Reason

UNRELATED_RESIDUAL = 0.5
"""Variance of the residuals over B² where frames are in no relation: that of a cosine, ½."""

UNRELATED_ASTRAY = 0.4
"""Share of coordinates beyond the reach of their Gray-code cell where phases and Gray code are in
no relation: distances are then uniform up to one cell, and the reach is 0.6 cells."""

MIN_BORDERS = 6
"""Smallest number of borders of a Gray-code bit in the lines for a statement about the bit.

Fewer could all lie at one edge of the scene. An empirical choice.
"""

WRONG_BORDERS = 0.3
"""Share of a bit's borders, less those that lead backwards, that must join neighbouring cells.

Right codes have 0.9 or more, bits in a wrong order 0 or less. Empirical.
"""

ACROSS_BORDERS = 8
"""Distance of the pixels that are compared across the borders of wide cells, px. Empirical."""

JITTER = 0.02
"""Smallest change of the coordinate over a border that has a direction, in cells."""

CONTINUOUS_TURNS = 0.15
"""Change of the phase from pixel to pixel up to which a surface counts as continuous, turns."""

LIT_SPREAD = 0.25
"""Variance of the samples of a lit pixel, over the 95th percentile: half of its modulation."""

RESIDUAL_PIXELS = 4000
"""Approximate largest number of pixels whose residuals are compared with those of unrelated frames;
the median of more only takes time."""

BRIGHT = 0.5
"""Quantile of the modulation above which pixels are asked whether they can be measured."""


@dataclass(frozen=True)
class Agreement:
    """How a sample agrees with its plan along one axis; every value is 0 for perfect agreement and
    about 1 for frames in no relation to the plan."""

    residual: float = 0.0
    """Variance of the residuals of sets with four or more steps, over that of unrelated frames."""
    sets: float = 0.0
    """Disagreement of the sets over that of unrelated phases."""
    astray: float = 0.0
    """Share of pixels whose phases and Gray code contradict each other, over that of unrelated
    ones."""
    borders: float = 0.0
    """Share of the bits of the Gray code whose borders do not join neighbouring cells."""
    unmeasured: float = 0.0
    """Share of bright pixels that cannot be measured."""
    lit: float = 1.0
    """Share of the pixels that show fringes, 0…1; without them the other parts say nothing."""

    @property
    def total(self) -> float:
        """The sum of all parts."""
        return self.residual + self.sets + self.astray + self.borders + self.unmeasured


def disagreement(maps: dict[str, Any], lit: BoolMap) -> float | None:
    """Median χ² of the sets over its expectation; None where too few pixels are lit.

    Parameters
    ----------
    maps : dict
        Those of ``decode_sample``, of two or more sets.
    lit : bool array
        Pixels with fringes.
    """
    square = maps["disagreement"][lit & np.isfinite(maps["disagreement"])]
    if square.size < MIN_JUDGED_PIXELS:
        return None
    return median(square) / chi_square_quantile(0.5, len(maps["phases"]) - 1)


def decode_sample(
    decoding: Decoding, planes: list[NDArray[Any]], noise: CameraNoise, limits: Limits
) -> dict[str, Any]:
    """The kernel's maps for a sample, with phases, modulations and disagreement."""
    maps = empty_maps(planes[0].shape, sets=len(decoding.sets), disagreement=True)
    _core.decode_frames(planes, decoding.kernel(noise, limits), maps)
    return maps


def unrelated(decoding: Decoding, planes: list[NDArray[Any]]) -> list[NDArray[Any]]:
    """The sample with the pixels of every set shuffled, so that the sets are unrelated."""
    rng = np.random.default_rng(0)
    shuffled = list(planes)
    for phases in decoding.sets:
        order = rng.permutation(planes[0].size)
        for k in phases.frames:
            place = decoding.frames.index(k)
            shuffled[place] = np.ascontiguousarray(planes[place][:, order])
    return shuffled


def agreement(
    decoding: Decoding,
    sample: Sample,
    noise: CameraNoise,
    limits: Limits,
    unrelated_sets: float,
    maps: dict[str, Any] | None = None,
) -> Agreement:
    """Measure how a sample agrees with its plan along one axis.

    Parameters
    ----------
    decoding : Decoding
    sample : Sample
    noise : CameraNoise
    limits : Limits
    unrelated_sets : float
        Disagreement of the sets for unrelated phases.
    maps : dict, optional
        The decoded points of the sample, with open limits, where they are there already.
    """
    planes = [sample.points[k] for k in decoding.frames]
    open_limits = limits.open
    maps = maps or decode_sample(decoding, planes, noise, open_limits)
    lit = lit_pixels(maps)
    parts: dict[str, float] = {
        "residual": _residual(decoding, sample, noise, limits),
        "lit": float(np.mean(lit)),
    }
    if len(decoding.sets) > 1 and unrelated_sets > 1.0:
        parts["sets"] = (disagreement(maps, lit) or 0.0) / unrelated_sets
    bright = lit & (maps["modulation"] >= _usual_modulation(maps["modulation"][lit]))
    if np.count_nonzero(bright) >= MIN_JUDGED_PIXELS:
        parts["unmeasured"] = float(np.mean(maps["reason"][bright] != Reason.OK))
    if decoding.gray is not None:
        if decoding.sets and decoding.gray.step_px < WIDE_CELL_TURNS * decoding.longest_px:
            parts["astray"] = _astray(decoding, planes, bright, maps, (noise, open_limits))
        line_planes = [sample.lines[decoding.axis][k] for k in decoding.frames]
        along = decode_sample(decoding, line_planes, noise, open_limits)
        turns = along["phases"][0] / (2.0 * np.pi) if decoding.sets else None
        coordinate = along["coordinate"]
        if decoding.gray.step_px >= WIDE_CELL_TURNS * decoding.longest_px:
            # Pixels next to the borders of wide cells are ambiguous: steps reach across them.
            coordinate, turns = coordinate[:, ::ACROSS_BORDERS], None
        parts["borders"] = wrong_borders(coordinate, turns, decoding.gray)
    return Agreement(**parts)


def _usual_modulation(modulation: FloatMap) -> float:
    """Quantile ``BRIGHT`` of the known modulations; NaN where there are none."""
    return quantile(modulation[~np.isnan(modulation)], BRIGHT)


def _residual(decoding: Decoding, sample: Sample, noise: CameraNoise, limits: Limits) -> float:
    """Variance of the residuals beyond noise over B², of the lit pixels, relative to unrelated
    frames."""
    worst = 0.0
    for phases in decoding.sets:
        steps = len(phases.frames)
        if steps < 4:
            continue
        stride = max(1, sample.points[0].size // RESIDUAL_PIXELS)
        fit = SampleFit(sample.fits.of(phases).rows[:, ::stride])
        fit = fit.at(np.flatnonzero(fit.finite))
        bright = fit.variance >= LIT_SPREAD * quantile(fit.variance, 0.95)
        # Samples that are cut off fit no fringe, whatever the order of the frames.
        clear = bright & (fit.largest < limits.saturation)
        if limits.given or np.count_nonzero(clear) >= MIN_JUDGED_PIXELS:
            bright = clear
        fit = fit.at(np.flatnonzero(bright))
        if fit.square.size:
            excess = fit.square / (steps - 3) - noise.variance(fit.fitted[0])
            power = fit.power + fit.square / steps
            worst = max(worst, median(excess / np.maximum(power, 1e-12)))
    return worst / UNRELATED_RESIDUAL


def _astray(
    decoding: Decoding,
    planes: list[NDArray[Any]],
    bright: BoolMap,
    maps: dict[str, Any],
    known: tuple[CameraNoise, Limits],
) -> float:
    """Share of bright pixels that only the reach of the Gray-code cells rejects."""
    noise, limits = known
    free = decode_sample(decoding.free, planes, noise, limits)
    open_ = bright & (free["reason"] == Reason.OK)
    if open_.sum() < MIN_JUDGED_PIXELS:
        return 0.0
    assert decoding.gray is not None
    quarter = 0.25 * decoding.longest_px
    if quarter > GRAY_REACH * decoding.gray.step_px:
        # Cells are so narrow that errors of the phase leave them: a quarter of a period counts.
        maps = decode_sample(replace(decoding, reach_px=quarter), planes, noise, limits)
    return float(np.mean(maps["reason"][open_] != Reason.OK)) / UNRELATED_ASTRAY


def wrong_borders(coordinate: FloatMap, turns: FloatMap | None, gray: GrayFrames) -> float:
    """Share of the bits of a Gray code whose borders do not join neighbouring cells.

    Parameters
    ----------
    coordinate : (r, l) float array, projector px
        Along lines across the fringes; NaN where unknown.
    turns : (r, l) float array, optional
        A wrapped phase along the same lines, turns. It shows where the surface is continuous.
    gray : GrayFrames

    Returns
    -------
    float, 0…1

    Notes
    -----
    Along a line over a smooth surface, cells follow one another in one direction, and each border
    changes one bit. Bits of frames in a wrong order still change one at a time, but lead to cells
    that are no neighbours, or backwards.
    """
    if gray.levels > 2:
        return 0.0  # digits change one by one as well, but not by one bit
    known = np.isfinite(coordinate)
    place = np.where(known, coordinate, 0.0) + 0.5 - gray.offset_px
    cells = np.maximum(np.floor(place / gray.step_px), 0.0).astype(np.int64)
    pair = known[:, 1:] & known[:, :-1]
    if turns is not None:
        slope = np.diff(np.where(known, turns, 0.0), axis=1)
        slope = np.abs(slope - np.rint(slope))
        if not pair.any() or np.median(slope[pair]) > CONTINUOUS_TURNS:
            return 0.0  # neighbouring pixels see different fringes: nothing is known of borders
        pair &= slope < CONTINUOUS_TURNS
    change = np.diff(cells, axis=1)
    words = cells ^ (cells >> 1)
    flipped = words[:, 1:] ^ words[:, :-1]
    single = pair & (flipped > 0) & ((flipped & (flipped - 1)) == 0)
    # Noise on a border makes steps back and forth that are small.
    apart = np.abs(np.diff(np.where(known, coordinate, 0.0), axis=1)) >= JITTER * gray.step_px
    single &= apart | (np.abs(change) > 1) | (turns is None)
    flipped, change = flipped[single], change[single]
    direction = np.sign(np.sum(np.sign(change[np.abs(change) == 1]))) or 1
    bit = np.log2(flipped).astype(np.intp)
    ahead = np.where(change == direction, 1, np.where(change == -direction, -1, 0))
    total = np.bincount(bit, minlength=len(gray.bits))
    good = np.bincount(bit, weights=ahead, minlength=len(gray.bits))
    judged = total >= MIN_BORDERS
    wrong = int(np.sum(good[judged] < WRONG_BORDERS * total[judged]))
    # Without phases, a single bit may change at an edge of the scene only.
    if wrong < (1 if turns is not None else 2):
        return 0.0
    return max(WRONG_BORDERS, wrong / float(judged.sum()))
