"""Judgement of a stack by a sample of its pixels: order, real frames, noise and phase errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.order_chain import TURN, coded_chains
from fringeworks.patterns.plan import PatternPlan
from fringeworks.stack import words
from fringeworks.stack.agreement import LineEvidence
from fringeworks.stack.beside_code import apart_px
from fringeworks.stack.decoded_sample import decode_sample
from fringeworks.stack.frame_motion import by_motion, moved_rather, pairs_apart
from fringeworks.stack.gray_frames import refuse_unequal_levels, resolution
from fringeworks.stack.kernel_settings import Decoding, Limits, PhaseFrames, lit_pixels
from fringeworks.stack.noise import measure_noise, neighbour_noise, spatial_noise, usable
from fringeworks.stack.order_faults import refuse_order_faults, refuse_unrelated, repeats_in_words
from fringeworks.stack.other_patterns import other_exposures
from fringeworks.stack.real_frames import RealFrames, design_rows, fit_frames, real_step_errors
from fringeworks.stack.refine import RIPPLE_FACTOR, Refined, refined
from fringeworks.stack.refusal import causes_first
from fringeworks.stack.ripple_removal import without_ripples
from fringeworks.stack.sample import Sample
from fringeworks.stack.saturation import known_limits, saturation_level
from fringeworks.stack.set_residuals import Known
from fringeworks.stack.shifts import step_errors
from fringeworks.stack.step_convention import convention
from fringeworks.statistics.quantiles import quantile
from fringeworks.types import (
    Axis,
    CameraNoise,
    Finding,
    FramesContradictPlan,
    InputError,
    Reason,
)
from fringeworks.types.computed import cached_property

ARITHMETIC_ERROR = 5e-5
"""Smallest noise, as a share of the largest count, because of the kernels' single precision.

Simulated float frames without noise disagree by 1.0 at 1e-5, but by 3 to 5 at 1e-6, because the
assumed noise is below the rounding. The value keeps a factor of five and is far below the noise of
any camera.
"""

HARDLY_CUT = 0.1
"""Share of the lit pixels by which a Gray code agrees worse, if white is taken to be cut off, from
which on it is not. Of real captures, twice as bright, those of which a fifth is cut off lose 0.3;
those of which four fifths are agree better by 0.2 to 0.6."""

NEARLY_ALL = 0.99
"""Share of the lit pixels with a certain fringe order from which on no other chain of roundings is
tried: it could hardly measure more, and trying one takes as long as the judgement of an axis."""

MIN_NOISE = 1e-30
"""Smallest standard deviation of a count, so that weights stay finite even for black frames."""

MOST_STEP_ERROR_RAD = 1.0
"""Largest error of a phase step that is taken into account, rad; beyond, it is another pattern."""

SAME_STEP_RAD = 0.02
"""Largest step between two frames that are the same, rad: noise makes 0.002 in samples of usual
size, and motion comes as near to a step of zero at one frame of fifty."""

MOST_LIGHT_CHANGE = 0.6
"""Largest change of the light of a frame that is taken into account, as a share of the mean. A lamp
that warms up changes it by less; a frame without light by 1."""

REAL_FRAME_PIXELS = 8000
"""Largest number of pixels that real frames are estimated from. Steps are found to a hundredth of
the noise of a pixel; more only take time."""

WIDEST_CELL_TURNS = 0.5
"""Widest Gray-code cells beside fringes that take the place of unresolved ones, in ranges of the
phases: with half a range, a cell and its reach hold one fringe order."""

STEP_DIGITS = 6
"""Digits of a step, in turns, that must agree for the same step."""

LIT_POWER = 0.25
"""Smallest squared modulation of a pixel that real frames and ripple are estimated from.

As a share of the 95th percentile: half of its modulation. Dim pixels add noise but hardly any
information. Empirical.
"""


@dataclass(frozen=True)
class Judgement:
    """Results of the judgement, which decoding uses."""

    noise: CameraNoise
    """Noise of the camera, given or measured, not below that of the arithmetic."""
    limits: Limits
    """The limits; the saturation is infinite if samples only touch the sensor's limit."""
    axes: dict[Axis, Refined]
    """Decoding of each axis, with its real frames and the floor of its phase errors."""
    findings: tuple[Finding, ...]
    """What was measured or decided, for the user."""

    @cached_property
    def details(self) -> dict[str, Any]:
        """Per axis: ``disagreement``, in standard deviations of the noise, and ``shifts_deg``."""
        return {axis: _details(found) for axis, found in self.axes.items()}


def examine(
    plan: PatternPlan,
    sample: Sample,
    decodings: dict[Axis, Decoding],
    limits: Limits,
    *,
    noise: CameraNoise | None,
    count_step: float | None,
    estimate_steps: bool,
    estimate_response: bool,
    moves: bool = False,
) -> Judgement:
    """Judge a stack by a sample of its pixels.

    Parameters
    ----------
    plan : PatternPlan
    sample : Sample
    decodings : nominal decoding of each axis
    limits : Limits
    noise : CameraNoise, optional
        Known noise; measured where not given.
    count_step : float > 0, optional
        Smallest difference between two counts of the camera; found from the sample where not given.
    estimate_steps, estimate_response : bool
        As for ``decode``.
    moves : bool
        Whether the scene may move: the fringes then lie beside the Gray code, whatever their start.

    Returns
    -------
    Judgement

    Raises
    ------
    InputError
        If the frames contradict the plan, for example because two of them are swapped.
    """
    _refuse_all_equal(plan, sample.points)
    # A response was measured with the real steps: it contains the ripple that they make.
    estimate_steps &= not any(s.table_turns for d in decodings.values() for s in d.sets)
    level = limits.saturation if limits.given else saturation_level(decodings, sample)
    start = noise or spatial_noise(sample.patch, below=level)
    floor = _noise_floor(sample.points, count_step)
    rough = _with_floor(start, floor)
    unknown, limits = limits, _limits(decodings, sample, limits, rough, level)
    known = Known(rough, limits, estimate_steps)
    told = unknown.given or limits.saturation == unknown.saturation
    findings = [*words.saturated(sample.points, limits, rough, plan.labels(), told)]
    with causes_first(findings):
        decodings = _ordered(plan, sample, decodings, known, findings, moves=moves)
        planned = decodings
        decodings = _with_real_frames(decodings, sample, limits, steps=estimate_steps)
        if noise is None:
            noise, source = measure_noise(decodings, sample, limits, start)
            if noise is start:
                noise = neighbour_noise(sample.patch, limits, start)
            findings.append(words.noise(noise, source, floor))
        noise = _with_floor(noise, floor)
        limits = _limits(decodings, sample, unknown, noise, level)
        known = Known(noise, limits, estimate_steps)
        found = {a: _refined(d, planned[a], sample, known) for a, d in decodings.items()}
        beside: list[Finding] = []
        if not moves:
            found = {a: _beside_code(a, f, sample, known, beside) for a, f in found.items()}
        if estimate_response:
            _refuse_unknown_response(found)
        moved = _moved_rather(found, sample)
        for axis_found in found.values():
            _refuse_unlike(axis_found.decoding, plan, moved)
            findings += _of_steps(axis_found.decoding, plan, moved)
        found = {axis: _with_unknown_rest(f, moved) for axis, f in found.items()}
        # Motion and vibration move the fringes as well: they are named first. What the fringes
        # then lack in agreement looks like noise.
        findings += beside
        for axis_found in found.values():
            findings += axis_found.findings
    return Judgement(noise, limits, found, tuple(findings))


def _refuse_all_equal(plan: PatternPlan, points: Sequence[NDArray[Any]]) -> None:
    """Refuse frames that are all equal in every count of a sample, but show something."""
    first = points[0]
    if np.nanmin(first) < np.nanmax(first) and all(np.array_equal(first, p) for p in points[1:]):
        raise FramesContradictPlan(
            f"frames: all {plan.frames} are equal in every count; expected the patterns of the "
            "plan (one file was copied, the camera sent the same frame again, or the projector did "
            "not change)"
        )


def _limits(
    decodings: dict[Axis, Decoding],
    sample: Sample,
    unknown: Limits,
    noise: CameraNoise,
    level: float | None,
) -> Limits:
    """The limits with the saturation that the samples show.

    Of Gray codes alone, it is left out where it costs more pixels than it is worth: those whose
    light is hardly cut off show the same bits as ever.
    """
    limits = known_limits(decodings, sample, unknown, noise, level)
    alone = not any(decoding.sets for decoding in decodings.values())
    if unknown.given or not alone or not np.isfinite(limits.saturation):
        return limits

    def disagreement(tried: Limits) -> float:
        clear = sample.below(tried.saturation)
        resolved = {axis: _resolved(d, clear, noise) for axis, d in decodings.items()}
        evidence = _evidence(resolved, sample, noise, tried)
        return max(found.disagreement for found in evidence.values())

    plain = replace(limits, saturation=float("inf"))
    return plain if disagreement(plain) < disagreement(limits) - HARDLY_CUT else limits


def _ordered(
    plan: PatternPlan,
    sample: Sample,
    decodings: dict[Axis, Decoding],
    known: Known,
    findings: list[Finding],
    *,
    moves: bool,
) -> dict[Axis, Decoding]:
    """The decodings with the cells that the camera resolves, of frames in the order of the plan."""
    clear = sample.below(known.limits.saturation)
    for decoding in decodings.values():
        if decoding.gray is not None:
            refuse_unequal_levels(decoding.gray, clear, known.noise)
    coarse = {axis: _resolved(decoding, clear, known.noise) for axis, decoding in decodings.items()}
    for axis, decoding in decodings.items():
        findings += words.unresolved(decoding, coarse[axis], plan.labels())
    findings += _check_order(plan, sample, coarse, known, moves)
    # Frames in another order, or of another polarity, show codes beyond the projector as well.
    for found in coarse.values():
        findings += words.beyond_projector(found, plan)
    return {axis: _by_resolved_cells(d, coarse[axis]) for axis, d in decodings.items()}


def _resolved(decoding: Decoding, points: Sequence[NDArray[Any]], noise: CameraNoise) -> Decoding:
    """The decoding without the finest bits of its Gray code that the camera does not resolve.

    With fringes, cells stay as narrow as half of the range of the phases, which they must tell.
    """
    gray = decoding.gray
    if gray is None:
        return decoding
    found = resolution(gray, points, noise)
    count = found.unresolved
    if decoding.sets:
        widest = WIDEST_CELL_TURNS * decoding.longest_px / gray.step_px
        count = min(count, max(0, int(np.floor(np.log2(max(widest, 1.0))))))
    coarse = replace(
        gray.without_finest(count),
        blurred_px=found.blurred_px,
        farthest_px=found.farthest_px,
        beyond_share=found.beyond_share,
        doubt_share=found.doubt_share,
    )
    coarse = replace(coarse, resolved_px=coarse.step_px if count else None)
    return replace(decoding, gray=coarse)


def _by_resolved_cells(planned: Decoding, coarse: Decoding) -> Decoding:
    """The decoding with the cells that the camera resolves, where fringes tell the rest; without
    fringes, every pixel decodes as many bits as it shows."""
    if planned.sets or planned.gray is None or coarse.gray is None:
        return coarse
    seen = coarse.gray
    gray = replace(
        planned.gray,
        resolved_px=seen.step_px,
        blurred_px=seen.blurred_px,
        doubt_share=seen.doubt_share,
    )
    return replace(planned, gray=gray)


def _refined(decoding: Decoding, planned: Decoding, sample: Sample, known: Known) -> Refined:
    """What neighbours and sets show; with the steps of the plan, where no fringe order is certain
    with those that the frames seem to show.

    Little of a wide fringe does not tell its steps, and what the model lacks looks like some.
    """
    found = _by_best_chain(decoding, sample, known)
    if not known.estimate_steps or np.inf not in found.decoding.order_errors:
        return found
    plain = _by_best_chain(planned, sample, replace(known, estimate_steps=False))
    return found if np.inf in plain.decoding.order_errors else plain


def _by_best_chain(decoding: Decoding, sample: Sample, known: Known) -> Refined:
    """What neighbours and sets show, by the chain of roundings that resolves most of the sample."""
    found = refined(decoding, sample, known)
    chain, gray = decoding.chain, decoding.gray
    if chain is None or gray is None or len(decoding.sets) < 2:
        return found
    share = _resolved_share(found.decoding, sample, known)
    if share > NEARLY_ALL:
        return found
    weights = [len(phases.frames) for phases in decoding.sets]
    bounds = chain.low_px, chain.high_px
    chains = coded_chains(chain.periods_px, bounds, weights=weights, gray_step_px=gray.step_px)
    for other in chains:
        if other.combinations.tolist() == chain.combinations.tolist():
            continue
        tried = refined(replace(decoding, chain=other), sample, known)
        resolved = _resolved_share(tried.decoding, sample, known)
        if resolved > share:
            found, share = tried, resolved
    return found


def _resolved_share(decoding: Decoding, sample: Sample, known: Known) -> float:
    """Share of the lit pixels of the sample whose fringe orders are certain."""
    planes = [sample.points[k] for k in decoding.frames]
    maps = decode_sample(decoding, planes, known.noise, known.limits)
    lit = np.count_nonzero(lit_pixels(maps))
    return np.count_nonzero(maps["reason"] == Reason.OK) / lit if lit else 1.0


def _beside_code(
    axis: Axis, found: Refined, sample: Sample, known: Known, findings: list[Finding]
) -> Refined:
    """With the distance of the fringes from where the Gray code has them in σ, if it is clear."""
    lines = sample.lines[axis]
    seen = convention(found.decoding, lines)
    if seen is not None and seen.clear:
        findings.append(words.apart(axis, seen))
        found = replace(found, pull_px=float(np.hypot(found.pull_px, seen.offset_px)))
    bent_px = apart_px(found.decoding, [lines[k] for k in found.decoding.frames], known)
    if RIPPLE_FACTOR * bent_px > found.pull_px:
        findings.append(words.bent(axis, bent_px))
        found = replace(found, pull_px=RIPPLE_FACTOR * bent_px)
    return found


def _moved_rather(found: Mapping[Axis, Refined], sample: Sample) -> float:
    """Logarithm of the likelihood of motion between frames over that of other steps, by all sets
    whose steps are not those of the plan."""
    told, apart = 0.0, 0.0
    for axis, one in found.items():
        lines = dict(enumerate(sample.lines[axis]))
        turned = [phases for phases in one.decoding.sets if phases.design]
        told += sum(moved_rather(s, [lines[k] for k in s.frames]) for s in turned)
        if turned and one.decoding.gray is not None:
            apart += pairs_apart(one.decoding.gray, lines)
    return told or apart


def _with_unknown_rest(found: Refined, moved: float) -> Refined:
    """With what motion between the frames leaves open in σ: their mean place is that of the scene
    at rest up to the scatter of the frames over √N."""
    finest = min(found.decoding.sets, key=lambda phases: phases.period_px, default=None)
    if finest is None or not finest.design:
        return found
    off = real_step_errors(finest)
    if not by_motion(moved, off):
        return found
    frames = len(off)
    scatter_px = finest.period_px / TURN * (float(np.sum(off**2)) / (frames - 1)) ** 0.5
    return replace(found, pull_px=float(np.hypot(found.pull_px, scatter_px / frames**0.5)))


def _refuse_unlike(decoding: Decoding, plan: PatternPlan, moved: float) -> None:
    """Refuse sets whose frames are so different from the plan that they must be others, or taken
    of a scene that moved."""
    labels = plan.labels()
    for phases in decoding.sets:
        found = RealFrames(np.array(phases.rows))
        off = step_errors(found.shifts_rad, phases.shifts_rad)
        light = found.light_gains - 1.0
        _refuse_repeated(phases, found, plan)
        turned, other = np.abs(off) > MOST_STEP_ERROR_RAD, np.abs(light) > MOST_LIGHT_CHANGE
        if not (turned | other).any():
            continue
        named = ", ".join(labels[phases.frames[k]] for k in np.flatnonzero(turned | other))
        angle, share = np.degrees(np.abs(off).max()), 100 * np.abs(light).max()
        if moved >= 0.0 and not other.any():
            raise FramesContradictPlan(
                f"frame {named}: the camera or the scene moved between the frames, so that phase "
                f"steps are off by up to {angle:.0f}°, or they are not those of the plan; expected "
                "everything at rest"
            )
        raise FramesContradictPlan(
            f"frame {named}: its phase step or its light is not that of the plan, by up to "
            f"{angle:.0f}° and {share:.0f} %; expected the steps of the plan, under the same light"
        )


def _refuse_repeated(phases: PhaseFrames, found: RealFrames, plan: PatternPlan) -> None:
    """Refuse a set of which a frame shows the same step as the one before it."""
    step = np.angle(np.exp(1j * np.diff(found.shifts_rad)))
    for k in np.flatnonzero(np.abs(step) < SAME_STEP_RAD):
        if abs(np.angle(np.exp(1j * np.diff(phases.shifts_rad)[k]))) > 0.5 * MOST_STEP_ERROR_RAD:
            raise FramesContradictPlan(repeats_in_words(plan, phases.frames[k + 1]))


def _refuse_unknown_response(found: dict[Axis, Refined]) -> None:
    """Refuse a stack whose fringes do not show whether the response is linear."""
    for axis, axis_found in found.items():
        if axis_found.decoding.sets and not axis_found.response_seen:
            raise InputError(
                f"response along {axis}: expected lines across several fringes of a smooth surface "
                "to measure it from, got none"
            )


def _of_steps(decoding: Decoding, plan: PatternPlan, moved: float) -> list[Finding]:
    """Findings about steps and gains that differ from the plan."""
    found = [words.real_frames(s, decoding.axis, plan.labels(), moved) for s in decoding.sets]
    found += [words.offsets(s, decoding.axis, plan.labels()) for s in decoding.sets]
    return [finding for finding in found if finding is not None]


def _details(found: Refined) -> dict[str, Any]:
    """Figures of an axis: the disagreement of its sets, and its real steps."""
    shifts = [_degrees(phases) for phases in found.decoding.sets]
    return {"disagreement": found.ratio**0.5, "shifts_deg": shifts}


def _degrees(phases: PhaseFrames) -> list[float]:
    real = np.asarray(phases.shifts_rad) + real_step_errors(phases)
    return [float(d) for d in np.degrees(real).round(3)]


def _evidence(
    decodings: dict[Axis, Decoding], sample: Sample, noise: CameraNoise, limits: Limits
) -> dict[Axis, LineEvidence]:
    """What the lines of every axis show."""
    return {
        axis: LineEvidence(decoding, sample.lines[axis], noise, limits, axis in sample.down)
        for axis, decoding in decodings.items()
    }


def _check_order(
    plan: PatternPlan, sample: Sample, decodings: dict[Axis, Decoding], known: Known, moves: bool
) -> list[Finding]:
    """Refuse frames in a wrong order; blurred sets and exposures that differ are findings.

    A response that is not linear may bend the phases so far that orders contradict each other, too:
    where no fault explains that, the frames are judged without it.
    """
    planned = _evidence(decodings, sample, known.noise, known.limits)
    doubt = refuse_order_faults(plan, planned, moves=moves)
    findings = [words.moving_scene(doubt.moving)] if doubt.moving else []
    findings += [
        words.flat(phases, axis)
        for axis, found in planned.items()
        for phases in found.decoding.sets
        if found.flat(phases)
    ]
    if not doubt.suspicious:
        return findings
    findings += other_exposures(plan, planned)
    if known.estimate_steps:
        decodings = {
            axis: _straight(decoding, sample, known) for axis, decoding in decodings.items()
        }
    with causes_first(findings):
        refuse_unrelated(_evidence(decodings, sample, known.noise, known.limits))
    return findings


def _straight(decoding: Decoding, sample: Sample, known: Known) -> Decoding:
    """The decoding with the response of its sets subtracted, where they show one."""
    if not decoding.sets:
        return decoding
    lines = [sample.lines[decoding.axis][k] for k in decoding.frames]
    planes = [sample.points[k] for k in decoding.frames]
    found, _ = without_ripples(decoding, lines, planes, known, steps=False)
    sets = (
        replace(planned, table_turns=s.table_turns, brightness=s.brightness)
        for planned, s in zip(decoding.sets, found.sets, strict=True)
    )
    return replace(decoding, sets=tuple(sets))


def _noise_floor(points: Sequence[NDArray[Any]], count_step: float | None) -> float:
    """Smallest noise, counts: that of rounding to steps of the counts, and of the arithmetic."""
    whole = points[0].dtype.kind == "u"
    if whole:
        largest = float(max(s.max() for s in points))
    else:
        finite = [s[np.isfinite(s)] for s in points]
        largest = max((float(np.abs(s).max(initial=0.0)) for s in finite), default=0.0)
        # Floats that are 0 and 1 alone are shares of light, not counts.
        whole = largest > 1.0 and all(np.all(s % 1 == 0) for s in finite)
    if count_step is None:
        count_step = 1.0 if whole else 0.0
    return float(max(count_step / 12.0**0.5, ARITHMETIC_ERROR * largest, MIN_NOISE))


def _with_floor(noise: CameraNoise, floor: float) -> CameraNoise:
    """The noise, in the dark not below a floor in counts."""
    return replace(noise, read_counts=floor) if noise.read_counts < floor else noise


def _with_real_frames(
    decodings: dict[Axis, Decoding], sample: Sample, limits: Limits, *, steps: bool
) -> dict[Axis, Decoding]:
    """The decodings with what the frames really show, where the frames determine it: harmonics of
    the fringes and, if wanted, ``steps`` and gains."""
    real: dict[Axis, Decoding] = {}
    for axis, decoding in decodings.items():
        sets: dict[int, PhaseFrames] = {}
        response: dict[tuple[float, ...], NDArray[np.float64]] = {}
        finest_first = sorted(range(len(decoding.sets)), key=lambda k: decoding.sets[k].period_px)
        for k in finest_first:
            phases = decoding.sets[k]
            planes, pixels = sample.fits.planes(phases), _judged_pixels(phases, sample, limits)
            places, order = _on_the_circle(phases.shifts_rad)
            rows, finer = np.array(phases.rows), response.get(places)
            known = None if finer is None else finer[np.argsort(order)]
            found = fit_frames(planes, pixels, rows, known)
            if found.harmonics is not None:
                response.setdefault(places, found.harmonics[order])
                shares = tuple(tuple(float(v) for v in row) for row in found.harmonics)
                phases = replace(phases, harmonics=shares)
            if steps and found.design is not None:
                phases = replace(phases, design=design_rows(found.design))
            sets[k] = phases
        real[axis] = replace(decoding, sets=tuple(sets[k] for k in sorted(sets)))
    return real


def _on_the_circle(shifts_rad: tuple[float, ...]) -> tuple[tuple[float, ...], NDArray[np.intp]]:
    """Steps in rising order from 0 to a turn, and the frames in that order: sets that take the same
    steps one after another, or from another one on, show a response alike."""
    turns = np.round(np.asarray(shifts_rad) / TURN, STEP_DIGITS) % 1.0
    order = np.argsort(turns, kind="stable")
    return tuple(float(t) for t in turns[order]), order


def _judged_pixels(phases: PhaseFrames, sample: Sample, limits: Limits) -> NDArray[np.intp]:
    """Pixels of a sample that say what the frames of a set show."""
    fit = sample.fits.of(phases)
    pixels = np.flatnonzero(usable(fit, limits))
    power = fit.power[pixels]
    pixels = pixels[power > LIT_POWER * quantile(power, 0.95)]
    pixels = pixels[:: max(1, -(-pixels.size // REAL_FRAME_PIXELS))]
    return np.ascontiguousarray(pixels)
