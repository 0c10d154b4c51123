"""Judgement of a stack by a sample of its pixels: order, real frames, noise and phase errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.order_chain import GRAY_REACH, TURN
from fringeworks.patterns.plan import PatternPlan
from fringeworks.signal.noise import NORMAL_MEDIAN
from fringeworks.stack import words
from fringeworks.stack.agreement import (
    Agreement,
    agreement,
    decode_sample,
    disagreement,
    unrelated,
)
from fringeworks.stack.kernel_settings import Decoding, GrayFrames, Limits, PhaseFrames
from fringeworks.stack.noise import (
    MIN_JUDGED_PIXELS,
    bit_sums,
    exceeds,
    measure_noise,
    phase_samples,
    set_parts,
    solve,
    spatial_noise,
    usable,
)
from fringeworks.stack.order_faults import refuse_order_faults
from fringeworks.stack.phase_errors import (
    PhaseErrors,
    order_errors,
    set_offsets,
    two_parts,
)
from fringeworks.stack.real_frames import RealFrames, real_frames
from fringeworks.stack.ripple import NOISE_ALONE, Ripple, measure_ripple
from fringeworks.stack.sample import Sample
from fringeworks.types import Axis, CameraNoise, Finding, FloatMap, Reason

RELATED = 2.5
"""Disagreement of the sets above which it is compared with that of unrelated phases.

The comparison takes a second decoding of the sample, so it should be rare. Simulated steps that are
wrong by 2° reach 2.6 and swapped frames more than 100. Empirical.
"""

ARITHMETIC_ERROR = 5e-5
"""Smallest noise, as a share of the largest count, because of the kernels' single precision.

Simulated float frames without noise disagree by 1.0 at 1e-5, but by 3 to 5 at 1e-6, because the
assumed noise is below the rounding. The value keeps a factor of five and is far below the noise of
any camera.
"""

MIN_NOISE = 1e-30
"""Smallest standard deviation of a count, so that weights stay finite even for black frames."""

LIT_POWER = 0.25
"""Smallest squared modulation of a pixel that real frames and ripple are estimated from.

As a share of the 95th percentile: half of its modulation. Dim pixels add noise but hardly any
information. Empirical.
"""


MAX_ORDER = 8
"""Highest order of a ripple that is looked for, periods per fringe; higher ones are weak."""

MAX_OFFSET_TURNS = 0.15
"""Largest error of a rounding that constant offsets between the sets may make, turns.

Offsets are known modulo one turn of every rounding only. Up to 0.15 turns, the smallest one is far
likelier than the next; beyond, fringe orders cannot be trusted. Empirical.
"""

RIPPLE_FACTOR = 1.2
"""Standard deviation that stands for a ripple, over its rms value.

A sinusoid spends only half of its phases within its rms value; within 1.2 times that, it spends 64
%, about as much as a normal distribution within its standard deviation.
"""

MAX_RIPPLE_NOISE_RAD = 0.2
"""Largest phase noise of a pixel that a ripple is measured from, rad. Noisier pixels only add noise.
An empirical choice."""


@dataclass(frozen=True)
class Judgement:
    """Results of the judgement, which decoding uses."""

    noise: CameraNoise
    """Noise of the camera, given or measured, not below that of the arithmetic."""
    limits: Limits
    """The limits; the saturation is infinite if samples only touch the sensor's limit."""
    decodings: dict[Axis, Decoding]
    """Decoding of each axis, with its real frames and the floor of its phase errors."""
    findings: tuple[Finding, ...]
    """What was measured or decided, for the user."""
    details: dict[str, Any]
    """Per axis: ``disagreement``, in standard deviations of the noise, and ``shifts_deg``."""


def examine(
    plan: PatternPlan,
    sample: Sample,
    decodings: dict[Axis, Decoding],
    limits: Limits,
    *,
    noise: CameraNoise | None,
    count_step: float | None,
    estimate_steps: bool,
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
    estimate_steps : bool
        Whether to estimate the real steps and gains of the frames.

    Returns
    -------
    Judgement

    Raises
    ------
    InputError
        If the frames contradict the plan, for example because two of them are swapped.
    """
    rough = _with_floor(noise or spatial_noise(sample.patch), sample.points, count_step)
    _check_order(plan, sample, decodings, limits, rough)
    findings: list[Finding] = []
    values = {axis: phase_samples(sample.points, d) for axis, d in decodings.items()}
    if estimate_steps:
        decodings, found = _with_real_frames(plan, decodings, values, limits)
        findings += found
    if noise is None:
        bits = {axis: bit_sums(sample.points, d) for axis, d in decodings.items()}
        noise, source = measure_noise(decodings, values, bits, limits, sample.patch)
        findings.append(words.noise(noise, source))
    noise = _with_floor(noise, sample.points, count_step)
    if not limits.given and np.isfinite(limits.saturation):
        exceeded = [exceeds(d, values[axis], limits, noise) for axis, d in decodings.items()]
        if not any(exceeded):
            limits = replace(limits, saturation=float("inf"))
    judged: dict[Axis, Decoding] = {}
    details: dict[str, Any] = {}
    factor = 1.0
    for axis, decoding in decodings.items():
        judged[axis], errors, found = _judged(decoding, sample, noise, limits, estimate_steps)
        findings += found
        factor = max(factor, errors.noise_factor)
        details[axis] = {
            "disagreement": errors.ratio**0.5,
            "shifts_deg": [_degrees(s) for s in judged[axis].sets],
        }
    if factor > 1.0:
        noise = scaled(noise, factor)
    return Judgement(noise, limits, judged, tuple(findings), details)


def scaled(noise: CameraNoise, factor: float) -> CameraNoise:
    """The noise with a variance that is larger by a factor."""
    return CameraNoise(noise.read_counts * factor**0.5, noise.gain * factor)


def _degrees(phases: PhaseFrames) -> list[float]:
    real = RealFrames(np.array(phases.rows), 0.0).shifts_rad
    planned = np.asarray(phases.shifts_rad)
    off = np.angle(np.exp(1j * (real - planned)))
    return [float(d) for d in np.degrees(planned + off - off.mean()).round(3)]


def _check_order(
    plan: PatternPlan,
    sample: Sample,
    decodings: dict[Axis, Decoding],
    limits: Limits,
    noise: CameraNoise,
) -> None:
    """Refuse frames in a wrong order."""
    unrelated_sets = {}
    for axis, decoding in decodings.items():
        planes = [sample.points[k] for k in decoding.frames]
        unrelated_sets[axis] = _unrelated_sets(decoding, planes, noise, limits)

    def agreements_of(sample: Sample) -> dict[Axis, Agreement]:
        return {
            axis: agreement(
                decoding, sample.points, sample.lines[axis], noise, limits, unrelated_sets[axis]
            )
            for axis, decoding in decodings.items()
        }

    refuse_order_faults(plan, sample, agreements_of(sample), agreements_of)


def _unrelated_sets(
    decoding: Decoding, planes: list[NDArray[Any]], noise: CameraNoise, limits: Limits
) -> float:
    """Disagreement of the sets for unrelated phases; infinite where that of the sample is small."""
    if len(decoding.sets) < 2:
        return float("inf")
    present = disagreement(decoding, planes, noise, limits)
    if present is None or present < RELATED:
        return float("inf")
    return disagreement(decoding, unrelated(decoding, planes), noise, limits) or float("inf")


def _with_floor(
    noise: CameraNoise, sample: Sequence[NDArray[Any]], count_step: float | None
) -> CameraNoise:
    """The noise, not below that of rounding to the steps of the counts and of the arithmetic."""
    largest = max((float(np.abs(s[np.isfinite(s)]).max(initial=0.0)) for s in sample), default=0.0)
    if count_step is None:
        # Floats that are 0 and 1 alone are shares of light, not counts.
        whole = largest > 1.0 and all(np.all(s[np.isfinite(s)] % 1 == 0) for s in sample)
        count_step = 1.0 if sample[0].dtype.kind == "u" or whole else 0.0
    rounding = count_step / 12.0**0.5
    floor = max(rounding, ARITHMETIC_ERROR * largest, MIN_NOISE)
    return replace(noise, read_counts=floor) if noise.read_counts < floor else noise


def _with_real_frames(
    plan: PatternPlan,
    decodings: dict[Axis, Decoding],
    values: dict[Axis, FloatMap],
    limits: Limits,
) -> tuple[dict[Axis, Decoding], list[Finding]]:
    """The decodings with what the frames really show, where it differs from the plan."""
    real: dict[Axis, Decoding] = {}
    findings: list[Finding] = []
    for axis, decoding in decodings.items():
        sets = []
        for part, phases in zip(set_parts(decoding), decoding.sets, strict=True):
            data = values[axis][part]
            (_, c, s), _ = solve(data, phases.rows)
            power = c**2 + s**2
            lit = usable(data, limits)
            lit &= power > LIT_POWER * np.percentile(power[np.isfinite(power)], 95)
            found = real_frames(data[:, lit], np.array(phases.rows))
            if found is not None:
                findings.append(words.real_frames(found, phases, axis, plan.labels()))
                phases = replace(phases, design=_rows(found.design))
            sets.append(phases)
        real[axis] = replace(decoding, sets=tuple(sets))
    return real, findings


def _rows(design: NDArray[np.float64]) -> tuple[tuple[float, float, float], ...]:
    return tuple((float(a), float(c), float(s)) for a, c, s in design)


def _judged(
    decoding: Decoding,
    sample: Sample,
    noise: CameraNoise,
    limits: Limits,
    estimate_steps: bool,
) -> tuple[Decoding, PhaseErrors, list[Finding]]:
    """The decoding with the floor of its phase errors, those errors, and what was found."""
    findings: list[Finding] = []
    errors, factor = PhaseErrors(), 1.0
    if decoding.sets:
        lines = [sample.lines[decoding.axis][k] for k in decoding.frames]
        decoding, found, factor = _with_ripple(decoding, lines, noise, limits, estimate_steps)
        findings += found
        if factor > 1.0:
            findings.append(words.correlated_noise(factor, decoding.axis))
            noise = scaled(noise, factor)
    planes = [sample.points[k] for k in decoding.frames]
    if len(decoding.sets) > 1:
        decoding, errors = _with_agreeing_sets(decoding, planes, noise, limits)
        if not errors.by_noise:
            findings.append(words.disagreement(errors, decoding.axis))
    if decoding.sets and decoding.gray is not None:
        decoding = _with_reach(decoding, decoding.gray, planes, noise, limits)
    return decoding, replace(errors, noise_factor=factor * errors.noise_factor), findings


def _with_agreeing_sets(
    decoding: Decoding, planes: list[NDArray[Any]], noise: CameraNoise, limits: Limits
) -> tuple[Decoding, PhaseErrors]:
    """The decoding with the errors that the disagreement of its sets shows, and these errors."""
    residuals, variances, maps = _residuals(decoding, planes, noise, limits)
    if residuals.shape[1] < MIN_JUDGED_PIXELS:
        return decoding, PhaseErrors()
    offsets = set_offsets(residuals, variances)
    shifted = 0.0 if decoding.chain is None else np.abs(decoding.chain.amplification @ offsets).max()
    if offsets.any() and shifted < MAX_OFFSET_TURNS:
        sets = [_turned(s, o) for s, o in zip(decoding.sets, offsets, strict=True)]
        decoding = replace(decoding, sets=tuple(sets))
        residuals, variances, maps = _residuals(decoding, planes, noise, limits)
    square = maps["disagreement"][maps["used"]]
    errors = two_parts(square, variances.mean(axis=0) * TURN**2, len(decoding.sets) - 1)
    if errors.by_noise or decoding.chain is None:
        return decoding, errors
    factor = errors.noise_factor
    bounds = order_errors(decoding.chain.amplification, residuals, factor * variances)
    return replace(with_floor(decoding, errors.floor_rad), order_errors=bounds), errors


def _residuals(
    decoding: Decoding, planes: list[NDArray[Any]], noise: CameraNoise, limits: Limits
) -> tuple[FloatMap, FloatMap, dict[str, Any]]:
    """Residuals of the phases of a sample and their variances by noise, (M, n), turns and turns²,
    and the kernel's maps with the pixels that were used."""
    free = replace(decoding, reach_px=float("inf"))
    maps = decode_sample(free, planes, noise, replace(limits, max_disagreement=float("inf")))
    used = (maps["reason"] == Reason.OK) | (maps["reason"] == Reason.ORDER_AMBIGUOUS)
    # A coordinate that is not written is that of the phases nearest to it: the residuals are those
    # of the nearest fringe orders.
    used &= np.isfinite(maps["disagreement"]) & np.isfinite(maps["coordinate"])
    maps["used"] = used
    x = maps["coordinate"][used].astype(np.float64)
    off, variance = [], []
    for phases, turns, modulation in zip(
        decoding.sets, maps["phases"], maps["modulations"], strict=True
    ):
        rest = turns[used] / TURN - x / phases.period_px
        off.append(rest - np.rint(rest))
        by_noise = phase_variance(phases, modulation, maps["background"], noise)
        variance.append(by_noise[used] / TURN**2)
    return np.stack(off), np.stack(variance), maps


def _turned(phases: PhaseFrames, turns: float) -> PhaseFrames:
    """The set with phases that are smaller by a constant."""
    c, s = np.cos(TURN * turns), np.sin(TURN * turns)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    return replace(phases, design=_rows(np.array(phases.rows) @ turn.T))


def phase_variance(
    phases: PhaseFrames, modulation: FloatMap, background: FloatMap, noise: CameraNoise
) -> FloatMap:
    """Variance of the phase by camera noise, rad²: that of equal steps."""
    variance = noise.read_counts**2 + noise.gain * np.maximum(background, 0.0)
    return np.asarray(2.0 / len(phases.frames) * variance / np.maximum(modulation, 1e-6) ** 2)


def with_floor(decoding: Decoding, floor_rad: float) -> Decoding:
    """The decoding with a floor added to the phase errors of all its sets."""
    sets = tuple(replace(s, floor_rad=float(np.hypot(s.floor_rad, floor_rad))) for s in decoding.sets)
    return replace(decoding, sets=sets)


def _with_ripple(
    decoding: Decoding,
    lines: list[NDArray[Any]],
    noise: CameraNoise,
    limits: Limits,
    estimate_steps: bool,
) -> tuple[Decoding, list[Finding], float]:
    """The decoding without the ripple that steps and gains make, and with the rest as a floor; what
    was found; and the variance of the finest phase along the lines over that of the noise."""
    findings: list[Finding] = []
    factor, finest = 1.0, min(s.period_px for s in decoding.sets)
    maps = decode_sample(decoding, lines, noise, replace(limits, max_disagreement=float("inf")))
    lit = (maps["reason"] == Reason.OK) | (maps["reason"] == Reason.ORDER_AMBIGUOUS)
    sets = []
    for phases, turns, modulation in zip(
        decoding.sets, maps["phases"], maps["modulations"], strict=True
    ):
        sigma = np.sqrt(phase_variance(phases, modulation, maps["background"], noise))
        bright = lit & (sigma < MAX_RIPPLE_NOISE_RAD)
        steps = len(phases.frames)
        orders = tuple(sorted({1, 2, 3, 4, steps, min(2 * steps, MAX_ORDER)}))
        ripple = measure_ripple(turns / (2 * np.pi), bright, sigma, orders)
        if ripple is None:
            sets.append(phases)
            continue
        if estimate_steps:
            ratio = float(np.median(maps["background"][bright] / modulation[bright]))
            phases = replace(phases, design=_without_ripple(phases, ripple, ratio))
        phases, found = _with_harmonics(phases, ripple, decoding.axis, estimate_steps)
        sets.append(phases)
        findings += found
        if phases.period_px == finest and ripple.excess > NOISE_ALONE:
            factor = ripple.excess
    return replace(decoding, sets=tuple(sets)), findings, factor


def _without_ripple(
    phases: PhaseFrames, ripple: Ripple, background_ratio: float
) -> tuple[tuple[float, float, float], ...]:
    """The design whose fits do not have the ripple of one and two per fringe.

    A fit that mixes A, c and s shifts the phase by (A/B)(ν cos φ − μ sin φ) + ζ cos 2φ − γ sin 2φ,
    where μ and ν are the shares of A in c and s, and (γ, ζ; ζ, −γ) mixes c and s.
    """
    once, twice = ripple.significant(1), ripple.significant(2)
    if once == 0 and twice == 0:
        return phases.design
    nu, mu = once.real / background_ratio, -once.imag / background_ratio
    zeta, gamma = twice.real, -twice.imag
    mixing = np.array([[1.0, 0.0, 0.0], [mu, 1.0 + gamma, zeta], [nu, zeta, 1.0 - gamma]])
    return _rows(np.array(phases.rows) @ mixing)


def _with_harmonics(
    phases: PhaseFrames, ripple: Ripple, axis: Axis, removed: bool
) -> tuple[PhaseFrames, list[Finding]]:
    """The set with the remaining ripple in its floor, and what was found."""
    harmonics = {k: ripple.significant(k) for k in ripple.orders if not (removed and k <= 2)}
    power = 0.5 * sum(abs(z) ** 2 for z in harmonics.values())
    if power == 0:
        return phases, []
    floor = float(np.hypot(phases.floor_rad, RIPPLE_FACTOR * power**0.5))
    finding = words.ripple(harmonics, phases, axis, float(power**0.5))
    return replace(phases, floor_rad=floor), [] if finding is None else [finding]


def _with_reach(
    decoding: Decoding,
    gray: GrayFrames,
    planes: list[NDArray[Any]],
    noise: CameraNoise,
    limits: Limits,
) -> Decoding:
    """The decoding with the reach that its Gray code needs where its borders are shifted."""
    off, sigma = _distance_from_gray(decoding, gray, planes, noise, limits)
    # Distances that are uniform up to half a cell have a median of a quarter.
    expected = float(np.hypot(gray.step_px / 4.0, sigma))
    if off <= 1.15 * expected:
        return decoding
    usual = GRAY_REACH * gray.step_px
    return replace(decoding, reach_px=max(min(usual * off / expected, decoding.longest_px / 4.0), usual))


def _distance_from_gray(
    decoding: Decoding,
    gray: GrayFrames,
    planes: list[NDArray[Any]],
    noise: CameraNoise,
    limits: Limits,
) -> tuple[float, float]:
    """Median distance of coordinates from the middles of their Gray-code cells, and that of their
    noise alone; projector px. Both are 0 where the Gray code cannot be decoded alone."""
    if not gray.inverse and gray.white_black is None:
        return 0.0, 0.0  # its bits are compared with the phases' background
    free = replace(decoding, reach_px=float("inf"))
    by_phases = decode_sample(free, planes, noise, limits)
    alone = replace(decoding, sets=(), chain=None)
    gray_planes = [planes[decoding.frames.index(k)] for k in alone.frames]
    by_gray = decode_sample(alone, gray_planes, noise, limits)
    both = np.isfinite(by_phases["coordinate"]) & np.isfinite(by_gray["coordinate"])
    if both.sum() < MIN_JUDGED_PIXELS:
        return 0.0, 0.0
    off = np.abs(by_phases["coordinate"] - by_gray["coordinate"])[both]
    sigma = NORMAL_MEDIAN * float(np.median(by_phases["sigma"][both]))
    return float(np.median(off)), sigma
