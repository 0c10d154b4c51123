"""Errors of the phases that are no noise: found in a sample, taken out, or added to their floor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.chain_search import ALTERNATIVE_SIGMAS
from fringeworks.patterns.order_chain import GRAY_REACH, TURN
from fringeworks.stack import words
from fringeworks.stack.decoded_sample import decode_by_gray_code, decode_sample
from fringeworks.stack.edge_errors import edge_variance
from fringeworks.stack.edges import (
    FEWEST,
    USUAL_BLUR_PX2,
    Fringes,
    Light,
    beside_steps,
    fringes_of,
    line_shift,
    line_sigma,
    most_blur,
    most_blur_by_contrast,
)
from fringeworks.stack.fits import harmonic_noise
from fringeworks.stack.frame_motion import pairs_apart
from fringeworks.stack.frame_offsets import with_offsets
from fringeworks.stack.gray_frames import GrayFrames
from fringeworks.stack.kernel_settings import SEAM_SIGMAS, Decoding, PhaseFrames, lit_pixels
from fringeworks.stack.line_profile import with_line_floor
from fringeworks.stack.neighbours import ERROR_RATE, UNKNOWN_TURNS, worth_voting
from fringeworks.stack.noise import MIN_JUDGED_PIXELS
from fringeworks.stack.pixel_grid import GridPull, measure_pull
from fringeworks.stack.real_frames import design_rows
from fringeworks.stack.ripple import LINES_NOISE_ALONE, SURE, Ripple
from fringeworks.stack.ripple_removal import line_ripple, without_ripples
from fringeworks.stack.sample import Sample
from fringeworks.stack.set_residuals import Known, phase_variance, set_residuals
from fringeworks.statistics.phase_errors import (
    PhaseErrors,
    order_errors,
    order_spread,
    set_offsets,
    two_parts,
)
from fringeworks.statistics.quantiles import NORMAL_MEDIAN, median, quantile
from fringeworks.statistics.surface_scatter import by_pixel, pixel_excess, scatters
from fringeworks.types import Axis, CameraNoise, Finding, FloatMap

MAX_OFFSET_TURNS = 0.15
"""Largest error of a rounding that constant offsets between the sets may make, turns.

Offsets are known modulo one turn of every rounding only. Up to 0.15 turns, the smallest one is far
likelier than the next; beyond, fringe orders cannot be trusted. Empirical.
"""

DOUBTFUL_OFFSET_TURNS = 0.05
"""The same where the sets disagree by more than noise, beside the spread of the errors from place
to place. Light between surfaces shifts all places by about as much as single ones; a scene or a
device that has moved between the sets shifts them by far more. Empirical."""

OF_ALL_PLACES = 0.6
"""Share of the spread of the errors by which all places may be shifted alike. Light between
surfaces was simulated to shift them by 0.5 to 0.8 of it; what moved by a few periods does, too, by
0.75 in one of 60 stacks."""

MOST_SPREAD_TURNS = 0.2
"""Standard deviation of the errors of a rounding beside noise, turns, from which on a pixel's
phases do not tell its order: errors beyond half a turn look like small ones."""

LOW = 0.1
"""Quantile of the noise of a rounding that its largest remainder is exact at: pixels with more are
judged more strictly than they need."""

DOUBT = -2.0 * float(np.log(ERROR_RATE))
"""By how much χ² of another order must exceed that of the nearest one, for as few wrong orders as
neighbours may vote for."""

RIPPLE_FACTOR = 1.2
"""Standard deviation that stands for a ripple, over its rms value.

A sinusoid spends only half of its phases within its rms value. Within 1.2 times that, it spends
64 %, about as much as a normal distribution within its standard deviation.
"""

OUTLIER_CHI = 20.0
"""Variance of a pixel's residuals, over that of noise, that counts as an outlier. With one degree
of freedom, noise exceeds it in 8 of a million pixels."""

EDGE_SHARE = 0.015
"""Share of outliers above which a part of the scene has errors of its own, such as motion.

Edges of a scene alone hold up to one in a hundred pixels. Empirical.
"""

NOTABLE_RATIO = 1.2
"""χ² of the sets over its expectation from which on their disagreement is reported, and variance of
the coordinates with the pull of the pixel grid over that without it. Empirical."""

CLEAR_VARIANCE = 4.0
"""Variance of an error beside an edge, over that of the noise, that single pixels show clearly. On
smooth scenes with shadows four of 16,000 pixels on lines exceed it, on scenes of boxes 500."""

SHIFTED_REACH = 1.15
"""Median distance of coordinates from the middles of their Gray-code cells, over its expectation,
up to which borders of cells count as where they should be. Empirical."""


WITHIN_FRINGE = 0.5
"""Distance of the pixels whose phases are compared, at most, in fringes: errors once per fringe
differ most over half of one, errors twice per fringe over a quarter."""

TINY = 1e-12
"""Divides instead of a slope of zero, px per px."""


ON_BORDERS = 0.1
"""Quantile of σ of a Gray code's coordinates that is that of pixels on borders of cells, which are
known best: motion matters there first. At usual blur, a fifth of the pixels lies on some."""

SLOPE_PX = 16
"""Distance along lines over which the slope of a Gray code's coordinates is taken, camera px: over
several cells, and less than between most edges."""


@dataclass(frozen=True)
class Refined:
    """The decoding of an axis with the errors of its phases, and what was found."""

    decoding: Decoding
    findings: tuple[Finding, ...] = ()
    ratio: float = 1.0
    """Median χ² of the sets over its expectation for noise alone."""
    uneven: bool = False
    """Whether errors differ over the scene by more than noise does."""
    scatters: bool = False
    """Whether neighbouring coordinates may differ by more than their standard deviations."""
    blurred: bool = False
    """Whether blur shifts coordinates at edges of brightness."""
    most_blur_px2: float = 0.0
    """Largest variance of the camera's blur that edges of brightness allow, px²; 0 where brightness
    changes so little that blur shifts nothing."""
    edges: bool = False
    """Whether pixels beside edges may have errors of their own."""
    response_seen: bool = False
    """Whether the phases of a set at least show whether the response is linear."""
    votes: bool = False
    """Whether so many fringe orders are ambiguous that neighbours vote on them."""
    pull_px: float = 0.0
    """Standard deviation that stands for the pull of the projector's pixel grid, px."""


def refined(decoding: Decoding, sample: Sample, known: Known) -> Refined:
    """Find the errors of the phases that are no noise, and take them out or into account.

    Parameters
    ----------
    decoding : Decoding
    sample : Sample
    known : Known

    Returns
    -------
    Refined
    """
    lines = [sample.lines[decoding.axis][k] for k in decoding.frames]
    if not decoding.sets:
        return _of_code(decoding, lines, known)
    planes = [sample.points[k] for k in decoding.frames]
    plain = decoding
    decoding, ripples = _without_frame_errors(decoding, lines, planes, known)
    findings: list[Finding] = words.own_response(plain, decoding)
    pairs = zip(decoding.sets, ripples, strict=True)
    left = [_with_harmonics(phases, ripple, decoding.axis) for phases, ripple in pairs]
    findings += [finding for _, _, found in left for finding in found]
    sets = [
        floored if ripple is not None and ripple.sure else with_line_floor(floored, sample, known)
        for (floored, _, _), ripple in zip(left, ripples, strict=True)
    ]
    decoding = replace(decoding, sets=tuple(sets))
    known = replace(known, peaks_rad=tuple(peak for _, peak, _ in left))
    agreeing, errors = _with_agreeing_sets(decoding, planes, known)
    # Where the sets agree within their noise, it is the surface that is rough.
    agree = len(left) > 1 and errors.by_noise
    bent = bool(findings) or any(phases.table_turns for phases in decoding.sets)
    # Of orders that a Gray code guards, the sets tell the noise themselves.
    guarded = len(left) > 1 and decoding.gray is not None
    start, told = (agreeing, errors) if guarded else (decoding, None)
    scatter = partial(_with_line_scatter, start, lines, known, ripples, told, bent=bent)
    decoding, factor = (agreeing, 1.0) if agree else scatter()
    raised = replace(known, noise=scaled(known.noise, factor))
    if factor > 1.0:
        findings.append(words.correlated_noise(factor, decoding.axis))
    if not (agree or guarded):
        decoding, errors = _with_agreeing_sets(decoding, planes, raised)
    notable = not errors.by_noise and errors.ratio > NOTABLE_RATIO
    if notable or errors.offset_turns > 0:
        findings.append(words.disagreement(errors, decoding.axis))
    if decoding.gray is not None:
        decoding = _with_reach(decoding, decoding.gray, planes, raised)
    uneven = factor > 1.0 or not errors.by_noise or _uneven_residuals(decoding, sample, raised)
    decoding = replace(decoding, noise_factor=factor * errors.noise_factor)
    seen = any(ripple is not None and ripple.repeated for ripple in ripples)
    found = Refined(decoding, tuple(findings), errors.ratio, uneven, response_seen=seen)
    return _compared(found, decode_sample(decoding, lines, known.noise, known.limits), lines, known)


def _without_frame_errors(
    plain: Decoding, lines: list[NDArray[Any]], planes: list[NDArray[Any]], known: Known
) -> tuple[Decoding, list[Ripple | None]]:
    """The decoding without what wrong frames and a response do to the phases, and what is left."""
    found, ripples = without_ripples(plain, lines, planes, known)
    if not known.estimate_steps or not _light_differs(plain, found, ripples):
        return found, ripples
    # Offsets are looked for without the gains that they may have been taken for.
    pairs = zip(plain.sets, found.sets, strict=True)
    start = [replace(f, design=p.design, unsure=p.unsure) for p, f in pairs]
    even = with_offsets(replace(found, sets=tuple(start)), planes, known).sets
    if not any(phases.offsets for phases in even):
        return found, ripples
    pairs = zip(plain.sets, even, strict=True)
    sets = tuple(replace(p, offsets=e.offsets) for p, e in pairs)
    return without_ripples(replace(plain, sets=sets), lines, planes, known)


def _light_differs(plain: Decoding, found: Decoding, ripples: list[Ripple | None]) -> bool:
    """Whether phases have, or had, a ripple of one per fringe, as light that differs makes."""
    pairs = zip(plain.sets, found.sets, strict=True)
    taken_out = any(before.design != after.design for before, after in pairs)
    return taken_out or any(r is not None and r.significant(1) != 0 for r in ripples)


def _by_finest(decoding: Decoding, maps: dict[str, Any], known: Known) -> tuple[FloatMap, FloatMap]:
    """Coordinates along lines by the finest phases, from an unknown fringe on, and their σ."""
    k = min(range(len(decoding.sets)), key=lambda k: decoding.sets[k].period_px)
    phases = decoding.sets[k]
    variance = phase_variance(phases, maps["modulations"][k], maps["background"], known.noise)
    lit = lit_pixels(maps)
    turns = np.where(lit, maps["phases"][k] / TURN, 0.0)
    steps = np.diff(turns, axis=1, prepend=turns[:, :1])
    unwrapped = np.cumsum(steps - np.rint(steps), axis=1, dtype=np.float64)
    coordinate = np.where(lit, phases.period_px * unwrapped, np.nan)
    sigma = phases.period_px / TURN * np.sqrt(np.where(lit, variance + phases.floor_rad**2, np.nan))
    return coordinate.astype(np.float32), sigma.astype(np.float32)


def _compared(
    found: Refined, maps: dict[str, Any], lines: list[NDArray[Any]], known: Known
) -> Refined:
    """What was found, with what neighbours along the lines show."""
    decoding, findings, light = found.decoding, found.findings, Light.of(maps)
    coordinate, sigma, votes = maps["coordinate"], maps["sigma"], worth_voting(decoding, maps)
    if votes and decoding.gray is None:  # neighbours are compared by the finest phases alone
        coordinate, sigma = _by_finest(decoding, maps, known)
    fringes = fringes_of(decoding)
    steps = beside_steps(coordinate, **fringes)
    most_blur_px2 = _most_blur(decoding, maps, lines, coordinate, sigma)
    blur = line_shift(coordinate, sigma, light, **fringes)
    pull = _pull(decoding, coordinate if blur is None else coordinate - blur)
    pull_px = 0.0 if pull is None else RIPPLE_FACTOR * pull.rms_px
    usual = sigma[np.isfinite(sigma)]
    if pull is not None and pull_px**2 > (NOTABLE_RATIO - 1.0) * median(usual) ** 2:
        # What is left of it, as it differs from place to place, looks like correlated noise.
        findings = (words.pixel_grid(decoding.axis, pull.rms_px), *findings)
    edges = _have_edges(coordinate, sigma, maps["modulation"], blur, fringes)
    if blur is not None:
        # Higher orders of the blur are left of large shifts: they say nothing of the scatter.
        coordinate = np.where(np.abs(blur) < sigma, coordinate - blur, np.float32(np.nan))
    elif most_blur_px2 > 0.0:
        sigma = line_sigma(coordinate, sigma, light, most_blur_px2, **fringes)
    # What neighbours share is told from what edges do: by pixels away from depth steps.
    coordinate = np.where(steps, np.float32(np.nan), coordinate)
    seen = (coordinate, np.hypot(sigma, np.float32(pull_px)), decoding.most_scatter_px)
    rough = scatters(*seen)
    if rough and by_pixel(*seen):
        findings = (*findings, words.scatter(decoding.axis))
    return replace(
        found,
        findings=findings,
        pull_px=pull_px,
        scatters=found.uneven or rough,
        blurred=blur is not None,
        most_blur_px2=most_blur_px2,
        edges=edges,
        votes=votes,
    )


def _of_code(decoding: Decoding, lines: list[NDArray[Any]], known: Known) -> Refined:
    """What neighbours show of a Gray code alone.

    A bit in grey beside an edge is not on the border of two cells, but holds the light of two
    depths; and borders lie where the scene was in that frame.
    """
    maps = decode_sample(decoding, lines, known.noise, known.limits)
    coordinate, code = maps["coordinate"], decoding.gray
    assert code is not None
    edges = bool(beside_steps(coordinate, **fringes_of(decoding)).any())
    apart_px = pairs_apart(code, dict(zip(decoding.frames, lines, strict=True)))
    slope = np.abs(coordinate[:, SLOPE_PX:] - coordinate[:, :-SLOPE_PX]) / SLOPE_PX
    if not apart_px or not np.isfinite(slope).any():
        return Refined(decoding, edges=edges)
    pull_px = apart_px * median(slope[np.isfinite(slope)])
    best = quantile(maps["sigma"][np.isfinite(maps["sigma"])], ON_BORDERS)
    notable = pull_px**2 > (NOTABLE_RATIO - 1.0) * best**2
    told = (words.moved_pairs(decoding.axis, apart_px, pull_px),) if notable else ()
    return Refined(decoding, told, edges=edges, pull_px=pull_px)


def _have_edges(
    coordinate: FloatMap,
    sigma: FloatMap,
    modulation: FloatMap,
    blur: FloatMap | None,
    fringes: Fringes,
) -> bool:
    """Whether errors beside edges exceed the noise of single pixels at many of them."""
    exact = coordinate if blur is None else coordinate - blur
    beside = edge_variance(exact, sigma, modulation, blur, lines=True, **fringes)
    if beside is None:
        return False
    with np.errstate(invalid="ignore"):
        return int(np.count_nonzero(beside > CLEAR_VARIANCE * sigma**2)) >= FEWEST


def _most_blur(
    decoding: Decoding,
    maps: dict[str, Any],
    lines: list[NDArray[Any]],
    coordinate: FloatMap,
    sigma: FloatMap,
) -> float:
    """Largest variance of the blur, px²; 0 where brightness changes too little for it to matter."""
    light, fringes = Light.of(maps), fringes_of(decoding)
    by_contrast = most_blur_by_contrast(coordinate, *_contrasts(decoding, maps, lines))
    by_edges = most_blur(light, sigma, **fringes)
    if np.isfinite(by_edges):
        return min(by_edges, by_contrast)
    most_px2 = by_contrast if np.isfinite(by_contrast) else USUAL_BLUR_PX2
    shifted = line_sigma(coordinate, sigma, light, most_px2, clear=True, **fringes)
    with np.errstate(invalid="ignore"):
        raised = np.count_nonzero(shifted**2 > NOTABLE_RATIO * sigma**2)
    return most_px2 if raised > EDGE_SHARE * np.count_nonzero(np.isfinite(sigma)) else 0.0


def _contrasts(
    decoding: Decoding, maps: dict[str, Any], lines: list[NDArray[Any]]
) -> tuple[list[float], list[FloatMap]]:
    """Periods of the sets, and the contrast of each along lines; an infinite one stands for the
    cells of a Gray code, most of which are wider than any blur."""
    periods, contrasts = [s.period_px for s in decoding.sets], [*maps["modulations"]]
    if decoding.gray is not None:
        gray = [
            lines[decoding.frames.index(k)] for k in (*decoding.gray.bits, *decoding.gray.inverse)
        ]
        swing = np.max(gray, axis=0).astype(np.float32) - np.min(gray, axis=0)
        periods, contrasts = [*periods, float("inf")], [*contrasts, 0.5 * swing]
    return periods, contrasts


def _with_line_scatter(
    decoding: Decoding,
    lines: list[NDArray[Any]],
    known: Known,
    ripples: list[Ripple | None],
    told: PhaseErrors | None,
    *,
    bent: bool,
) -> tuple[Decoding, float]:
    """The scatter of the phases along smooth lines: as a factor on the variance of the noise, or in
    the decoding's floor, where the response is ``bent`` or the sets have ``told`` the noise.

    What sets do not have against each other moves the coordinate, but spoils no fringe order.
    """
    k = min(range(len(ripples)), key=lambda k: decoding.sets[k].period_px)
    finest, errors = ripples[k], told or PhaseErrors()
    if finest is not None and finest.excess > LINES_NOISE_ALONE:
        maps = decode_sample(decoding, lines, known.noise, known.limits.open)
        bent &= not finest.told  # its brightness tells all harmonics of a response
        finest = _without_shifts(decoding, maps, known, k) or finest
        if not bent:
            # Creases of the surface lie within windows as well.
            by_pixels = _of_pixels(decoding, maps, known, k)
            finest = replace(finest, excess=min(finest.excess, by_pixels))
    if finest is None or finest.excess <= LINES_NOISE_ALONE:
        return decoding, 1.0
    if bent or told is not None:
        # A response that is not linear has harmonics beyond those of the ripple. They do not
        # shrink with the modulation.
        rest = finest.noise_rad**2 * (finest.excess - errors.noise_factor) - errors.floor_rad**2
        return with_floor(decoding, max(rest, 0.0) ** 0.5), 1.0
    return decoding, finest.excess


def _of_pixels(decoding: Decoding, maps: dict[str, Any], known: Known, k: int) -> float:
    """Variance of a set's phases over that of the camera's noise, by neighbouring pixels alone."""
    period = decoding.sets[k].period_px
    turns = maps["phases"][k] / TURN - maps["coordinate"] / period
    coordinate = maps["coordinate"] + period * (turns - np.rint(turns))
    seen = maps["modulations"][k], maps["background"]
    with np.errstate(invalid="ignore"):  # pixels that are not finite
        sigma = np.sqrt(phase_variance(decoding.sets[k], *seen, known.noise)) * (period / TURN)
    # Pixels beside depth steps hold the light of two places: that is no noise of single pixels.
    apart = beside_steps(coordinate, **fringes_of(decoding))
    coordinate = np.where(apart, np.float32(np.nan), coordinate)
    slope = np.abs(np.diff(coordinate))
    usual = median(slope[np.isfinite(slope)]) if np.isfinite(slope).any() else 0.0
    reach_px = WITHIN_FRINGE * period / max(usual, TINY)
    return pixel_excess(coordinate, sigma, decoding.most_scatter_px, reach_px)


def _without_shifts(
    decoding: Decoding, maps: dict[str, Any], known: Known, k: int
) -> Ripple | None:
    """The ripple of a set along lines without the shifts by blur and by the pixel grid, which are
    parts of σ by themselves and are taken out of the maps' phases; None where there are none."""
    seen = (maps["coordinate"], maps["sigma"], Light.of(maps))
    shift = line_shift(*seen, **fringes_of(decoding))
    coordinate = maps["coordinate"] if shift is None else maps["coordinate"] - shift
    pull = _pull(decoding, coordinate)
    if pull is not None and pull.rms_px > 0.0:
        shift = pull.at(coordinate) if shift is None else shift + pull.at(coordinate)
    if shift is None:
        return None
    maps["phases"][k] -= np.nan_to_num(TURN / decoding.sets[k].period_px * shift)
    return line_ripple(decoding.sets[k], maps, k, known)


def _pull(decoding: Decoding, coordinate: FloatMap) -> GridPull | None:
    """The pull of the pixel grid; None where coordinates repeat, and so do not count its pixels."""
    return None if np.isfinite(decoding.repeats_px) else measure_pull(coordinate)


def _uneven_residuals(decoding: Decoding, sample: Sample, known: Known) -> bool:
    """Whether the residuals of the fits hold more than noise, or more outliers than edges explain.

    Light that changes from row to row while the frames are taken leaves more everywhere; noise that
    was measured in short stretches does not contain it.
    """
    for phases in decoding.sets:
        freedom = len(phases.frames) - 3
        if freedom < 1:
            continue
        fit = sample.fits.of(phases)
        fit = fit.at(np.flatnonzero(fit.finite & (fit.largest < known.limits.saturation)))
        factor = harmonic_noise(phases.harmonics) if phases.harmonics else 1.0
        variance = factor * known.noise.variance(fit.fitted[0])
        variance = variance + 0.5 * phases.floor_rad**2 * fit.power  # as ``local_errors`` has it
        chi = fit.square / (freedom * variance)
        outliers = chi > OUTLIER_CHI
        if np.count_nonzero(outliers) > EDGE_SHARE * outliers.size:
            return True
        usual = chi[~outliers]
        if usual.size and np.mean(usual) > NOTABLE_RATIO:
            return True
    return False


def scaled(noise: CameraNoise, factor: float) -> CameraNoise:
    """The noise with a variance that is larger by a factor."""
    return CameraNoise(noise.read_counts * factor**0.5, noise.gain * factor)


def _with_harmonics(
    phases: PhaseFrames, ripple: Ripple | None, axis: Axis
) -> tuple[PhaseFrames, float, list[Finding]]:
    """The set with the remaining ripple in its floor, its peak in rad, and what was found.

    What was taken out remains within its errors.
    """
    if ripple is None:
        return phases, 0.0, []
    removed = bool(phases.table_turns or phases.design)
    unsure = ripple.error_rad if removed else ripple.told_rad or ripple.unknown_rad
    clear = ripple.rms_rad > SURE * ripple.error_rad
    left = {k: z for k in ripple.orders if clear and (z := ripple.significant(k)) != 0}
    rms = ripple.rms_rad if clear or ripple.told else 0.0
    floor = float(np.sqrt(phases.floor_rad**2 + (RIPPLE_FACTOR * rms) ** 2 + unsure**2))
    # Errors of what was taken out that the sets do not show cancel in the roundings.
    peak = sum(abs(z) for z in left.values())
    notable = rms > words.NOTABLE_RIPPLE_RAD if ripple.told else bool(left)
    found = [words.ripple(left, phases, axis, rms)] if left and notable else []
    return replace(phases, floor_rad=floor), float(peak), found


def _with_agreeing_sets(
    decoding: Decoding, planes: list[NDArray[Any]], known: Known
) -> tuple[Decoding, PhaseErrors]:
    """The decoding with the errors that the disagreement of its sets shows, and these errors."""
    if len(decoding.sets) < 2:
        return decoding, PhaseErrors()
    residuals, variances, maps = set_residuals(decoding, planes, known)
    chain = decoding.chain
    if residuals.shape[1] < MIN_JUDGED_PIXELS or chain is None:
        return decoding, PhaseErrors()
    offsets = set_offsets(residuals, variances)
    off = np.abs(chain.amplification @ offsets)
    shifted = float(off.max(initial=0.0))
    spread = order_spread(chain.amplification, residuals - offsets[:, None], variances)
    likely = (off < np.hypot(DOUBTFUL_OFFSET_TURNS, OF_ALL_PLACES * spread)).all()
    if known.estimate_steps and shifted > 0.0 and (likely or shifted < MAX_OFFSET_TURNS):
        sets = [_turned(s, o) for s, o in zip(decoding.sets, offsets, strict=True)]
        decoding = replace(decoding, sets=tuple(sets))
        residuals, variances, maps = set_residuals(decoding, planes, known)
    square = maps["disagreement"][maps["used"]]
    errors = two_parts(square, variances.mean(axis=0) * TURN**2, len(decoding.sets) - 1)
    # Ripple that is left moves all phases at once: sets may agree on a wrong order.
    ripple = np.abs(chain.amplification) @ np.array(known.peaks_rad or 0.0 * offsets) / TURN
    if not likely and (shifted >= MAX_OFFSET_TURNS or not errors.by_noise):
        # The offsets may be larger by a whole turn of a rounding: no fringe order is certain.
        unknown = (float("inf"),) * len(chain.tolerance)
        return replace(decoding, order_errors=unknown), replace(errors, offset_turns=shifted)
    if errors.by_noise:
        return replace(decoding, order_errors=tuple(map(float, ripple))), errors
    largest: tuple[float, ...] = ()
    if decoding.gray is None:
        bounds = np.where(spread >= MOST_SPREAD_TURNS, UNKNOWN_TURNS, ripple)
        largest = _largest_remainders(chain.amplification, spread, variances)
    else:
        seen = order_errors(chain.amplification, residuals, errors.noise_factor * variances)
        bounds = np.maximum(seen, ripple)
    decoding = replace(decoding, order_errors=tuple(map(float, bounds)), largest_remainders=largest)
    return with_floor(decoding, errors.floor_rad), errors


def _largest_remainders(
    amplification: FloatMap, spread: FloatMap, variances: FloatMap
) -> tuple[float, ...]:
    """Remainders up to which another order is unlikely, plus six standard deviations of the noise:
    at errors of this ``spread`` beside noise."""
    noise = np.array([quantile(row, LOW) for row in amplification**2 @ variances])
    largest = 0.5 - 0.5 * DOUBT * (spread**2 + noise) + ALTERNATIVE_SIGMAS * np.sqrt(noise)
    return tuple(float(v) for v in np.where(spread > 0.0, largest, np.inf))


def _turned(phases: PhaseFrames, turns: float) -> PhaseFrames:
    """The set with phases that are smaller by a constant."""
    c, s = np.cos(TURN * turns), np.sin(TURN * turns)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    return replace(phases, design=design_rows(np.array(phases.rows) @ turn.T))


def with_floor(decoding: Decoding, floor_rad: float) -> Decoding:
    """The decoding with a floor added to the phase errors of all its sets."""
    floors = [float(np.hypot(phases.floor_rad, floor_rad)) for phases in decoding.sets]
    pairs = zip(decoding.sets, floors, strict=True)
    return replace(decoding, sets=tuple(replace(s, floor_rad=floor) for s, floor in pairs))


def _with_reach(
    decoding: Decoding, gray: GrayFrames, planes: list[NDArray[Any]], known: Known
) -> Decoding:
    """The decoding with the reach that its Gray code needs where its borders are shifted."""
    reach = GRAY_REACH * gray.step_px
    needed = reach
    # Errors of the phases that are no noise count besides those of the noise.
    if decoding.chain is not None:
        floors = decoding.chain.combinations[0] * [phases.floor_rad for phases in decoding.sets]
        needed += SEAM_SIGMAS * decoding.longest_px / TURN * float(np.hypot.reduce(floors))
    off, sigma = _distance_from_gray(decoding, gray, planes, known)
    # Distances that are uniform up to half a cell have a median of a quarter.
    expected = float(np.hypot(gray.step_px / 4.0, sigma))
    if off > SHIFTED_REACH * expected:
        needed = max(needed, reach * off / expected)
    return replace(decoding, reach_px=max(min(needed, decoding.longest_px / 4.0), reach))


def _distance_from_gray(
    decoding: Decoding, gray: GrayFrames, planes: list[NDArray[Any]], known: Known
) -> tuple[float, float]:
    """Median distance of coordinates from the middles of their Gray-code cells, and that of their
    noise alone; projector px. Both are 0 where the Gray code cannot be decoded alone."""
    if not gray.inverse and gray.white_black is None:
        return 0.0, 0.0  # its bits are compared with the phases' background
    # Errors beyond noise count as distance.
    by_noise = tuple(replace(phases, floor_rad=0.0) for phases in decoding.sets)
    free = replace(decoding.free, sets=by_noise)
    by_phases = decode_sample(free, planes, known.noise, known.limits)
    by_gray = decode_by_gray_code(decoding, planes, known.noise, known.limits)
    both = np.isfinite(by_phases["coordinate"]) & np.isfinite(by_gray["coordinate"])
    if both.sum() < MIN_JUDGED_PIXELS:
        return 0.0, 0.0
    off = np.abs(by_phases["coordinate"] - by_gray["coordinate"])[both]
    sigma = NORMAL_MEDIAN * median(by_phases["sigma"][both])
    return median(off), sigma
