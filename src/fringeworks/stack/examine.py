"""Judgement of a stack by a sample of its pixels: noise, saturation, real steps, disagreement.

The disagreement of the sets is the median χ² of the sample over its expectation. It is 1 where the
phases of the sets, and the Gray code, differ by their noise alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.patterns.order_chain import GRAY_REACH
from fringeworks.patterns.plan import PatternPlan
from fringeworks.signal.noise import NORMAL_MEDIAN, chi_square_quantile
from fringeworks.stack.gray_frames import GrayFrames, refuse_unequal_levels
from fringeworks.stack.kernel_settings import Decoding, Limits, empty_maps
from fringeworks.stack.noise import (
    MIN_JUDGED_PIXELS,
    exceeds,
    measure_noise,
    phase_samples,
    set_parts,
    solve,
    usable,
)
from fringeworks.stack.shifts import estimate_shifts
from fringeworks.stack.swaps import refuse_swap_by_orders, refuse_swap_by_residuals
from fringeworks.types import Axis, CameraNoise, FloatMap, FramesContradictPlan, Reason

NOISE_ALONE = 1.15
"""Disagreement up to which the sets differ by noise alone.

The sample's median χ² scatters by 2 to 3 %, and simulated stacks without errors have 0.99 to 1.02.
The rest of the margin allows for errors of the measured noise. The same factor applies to the
distance between phases and Gray code over its expectation. Empirical.
"""

SUSPICIOUS = 2.5
"""Disagreement above which it is compared with that of unrelated phases.

The comparison takes a second decoding of the sample, so it should be rare. Simulated steps that are
wrong by 2° reach 2.6 and swapped frames more than 100. Empirical.
"""

MAYBE_SWAPPED = 0.3
"""Share of the disagreement of unrelated phases above which swapped frames are searched.

In simulations two swapped frames make 0.56 to 1.02, and a response with γ = 1.6 makes 0.2 to 0.35.
The value keeps the costly search to few stacks. Empirical.
"""

UNRELATED = 0.9
"""Share of the disagreement of unrelated phases above which no fringe order can be trusted.

Frames of another plan make 0.99 to 1.01 in simulations; the sampling error of both numbers is a few
per cent. Empirical.
"""

ARITHMETIC_ERROR = 5e-5
"""Smallest noise, as a share of the largest count, because of the kernels' single precision.

Simulated float frames without noise disagree by 1.0 at 1e-5, but by 3 to 5 at 1e-6, because the
assumed noise is below the rounding. The value keeps a factor of five and is far below the noise of
any camera.
"""

MIN_NOISE = 1e-30
"""Smallest standard deviation of a count, so that weights stay finite even for black frames."""

MIN_VARIANCE_PX2 = 1e-12
"""Smallest variance of a coordinate that divides, px²; it only avoids the division by zero."""

LIT_POWER = 0.25
"""Smallest squared modulation of a pixel that shifts are estimated from.

As a share of the 95th percentile: half of its modulation. Dim pixels add noise but hardly any
information. Empirical.
"""


@dataclass(frozen=True)
class Findings:
    """Results of the judgement, which decoding uses."""

    noise: CameraNoise
    """Noise of the camera, given or measured, not below that of the arithmetic."""
    limits: Limits
    """The limits; the saturation is infinite if samples only touch the sensor's limit."""
    decodings: dict[Axis, Decoding]
    """Decoding of each axis, with its real shifts and the disagreement of its sets."""
    notes: tuple[str, ...] = ()
    """What was measured or decided, for the user."""
    details: dict[str, Any] = field(default_factory=dict)
    """Per axis: ``disagreement``, in standard deviations of the noise, and ``shifts_deg``."""


def examine(
    plan: PatternPlan,
    sample: Sequence[NDArray[Any]],
    decodings: dict[Axis, Decoding],
    limits: Limits,
    *,
    noise: CameraNoise | None,
    patch: Sequence[FloatMap],
    estimate_steps: bool,
) -> Findings:
    """Judge a stack by a sample of its pixels.

    Parameters
    ----------
    plan : PatternPlan
    sample : (1, n) arrays, one per frame of the plan, counts
    decodings : nominal decoding of each axis
    limits : Limits
    noise : CameraNoise, optional
        Known noise; measured where not given.
    patch : (h, w) float arrays, counts
        Connected pixels of some frames, for measuring spatial noise.
    estimate_steps : bool
        Whether to estimate the real shifts from the frames.

    Returns
    -------
    Findings

    Raises
    ------
    InputError
        If the frames contradict the plan, for example because two of them are swapped.
    """
    notes: list[str] = []
    values = {axis: phase_samples(sample, decoding) for axis, decoding in decodings.items()}
    if estimate_steps:
        decodings, notes = _with_real_steps(decodings, values, limits)
    for axis, decoding in decodings.items():
        refuse_swap_by_residuals(decoding, values[axis], limits, plan)
    if noise is None:
        noise, source = measure_noise(decodings, values, limits, patch)
        shot = f", {noise.gain:.3g} counts² per count" if noise.gain else ""
        notes.append(f"noise of {noise.read_counts:.3g} counts{shot}, from {source}")
    noise = _with_floor(noise, sample)
    if not limits.given and np.isfinite(limits.saturation):
        exceeded = [exceeds(d, values[axis], limits, noise) for axis, d in decodings.items()]
        if not any(exceeded):
            limits = replace(limits, saturation=float("inf"))
    judged: dict[Axis, Decoding] = {}
    details: dict[str, Any] = {}
    for axis, decoding in decodings.items():
        judged[axis], disagreement = _judged(decoding, sample, noise, limits, plan)
        details[axis] = {
            "disagreement": disagreement**0.5,
            "shifts_deg": [np.degrees(s.shifts_rad).round(3).tolist() for s in decoding.sets],
        }
        if disagreement > NOISE_ALONE:
            what = "phases and Gray code" if decoding.gray is not None else "phases"
            notes.append(
                f"{what} along {axis} disagree by {disagreement**0.5:.1f} times their noise: "
                "standard deviations are raised by this factor"
            )
    return Findings(noise, limits, judged, tuple(notes), details)


def _with_floor(noise: CameraNoise, sample: Sequence[NDArray[Any]]) -> CameraNoise:
    """The noise, not below that of rounding to whole counts and of the kernels' arithmetic."""
    largest = max((float(np.abs(s[np.isfinite(s)]).max(initial=0.0)) for s in sample), default=0.0)
    rounding = 12.0**-0.5 if sample[0].dtype.kind == "u" else 0.0
    floor = max(rounding, ARITHMETIC_ERROR * largest, MIN_NOISE)
    return replace(noise, read_counts=floor) if noise.read_counts < floor else noise


def _with_real_steps(
    decodings: dict[Axis, Decoding], values: dict[Axis, FloatMap], limits: Limits
) -> tuple[dict[Axis, Decoding], list[str]]:
    """The decodings with shifts that are estimated from the frames, and notes about them."""
    real: dict[Axis, Decoding] = {}
    notes: list[str] = []
    for axis, decoding in decodings.items():
        real[axis], axis_notes = _real_steps(decoding, values[axis], limits)
        notes += axis_notes
    return real, notes


def _real_steps(decoding: Decoding, values: FloatMap, limits: Limits) -> tuple[Decoding, list[str]]:
    """The decoding of one axis with estimated shifts, and a note about each set."""
    sets, notes = [], []
    for part, phases in zip(set_parts(decoding), decoding.sets, strict=True):
        data = values[part]
        (_, c, s), _ = solve(data, phases.shifts_rad)
        power = c**2 + s**2
        lit = usable(data, limits) & (power > LIT_POWER * np.percentile(power, 95))
        shifts = estimate_shifts(data[:, lit], phases.shifts_rad)
        off = np.degrees(np.abs(shifts - np.asarray(phases.shifts_rad)).max())
        notes.append(
            f"steps of {phases.period_px:g} px along {decoding.axis}: "
            f"{', '.join(f'{d:.1f}' for d in np.degrees(shifts))}°, off by up to {off:.1f}°"
        )
        sets.append(replace(phases, shifts_rad=tuple(float(d) for d in shifts)))
    return replace(decoding, sets=tuple(sets)), notes


def _judged(
    decoding: Decoding,
    sample: Sequence[NDArray[Any]],
    noise: CameraNoise,
    limits: Limits,
    plan: PatternPlan,
) -> tuple[Decoding, float]:
    """The decoding with the disagreement of its sets and Gray code, and that disagreement."""
    if decoding.gray is not None:
        refuse_unequal_levels(decoding.gray, sample, noise)
    planes = [sample[k] for k in decoding.frames]
    limits = replace(limits, max_disagreement=float("inf"))
    disagreement = 1.0
    if len(decoding.sets) > 1:
        disagreement = _sets_disagreement(decoding, planes, noise, limits, plan)
    if decoding.sets and decoding.gray is not None:
        decoding, of_gray = _judged_gray(decoding, decoding.gray, planes, noise, limits)
        disagreement = max(disagreement, of_gray)
    if disagreement > NOISE_ALONE:
        decoding = replace(decoding, disagreement=disagreement)
    return decoding, disagreement


def _sets_disagreement(
    decoding: Decoding,
    planes: list[NDArray[Any]],
    noise: CameraNoise,
    limits: Limits,
    plan: PatternPlan,
) -> float:
    """Disagreement of the sets, ≥ 1; refuses sets that are as far apart as unrelated phases."""

    def disagreement_of(planes: list[NDArray[Any]]) -> float | None:
        return _disagreement(decoding, planes, noise, limits)

    disagreement = disagreement_of(planes)
    if disagreement is not None and disagreement > SUSPICIOUS:
        unrelated = disagreement_of(_unrelated(decoding, planes))
        if unrelated is not None and disagreement > MAYBE_SWAPPED * unrelated:
            refuse_swap_by_orders(decoding, planes, plan, disagreement, disagreement_of)
        if unrelated is not None and disagreement > UNRELATED * unrelated:
            raise FramesContradictPlan(
                f"frames along {decoding.axis}: fringe orders contradict each other all over the "
                f"image, by {disagreement**0.5:.0f} times the noise; expected frames in the order "
                "of the plan, with its periods and steps, and a response that keeps their fringe "
                "orders distinct"
            )
    return max(1.0, disagreement or 1.0)


def _judged_gray(
    decoding: Decoding,
    gray: GrayFrames,
    planes: list[NDArray[Any]],
    noise: CameraNoise,
    limits: Limits,
) -> tuple[Decoding, float]:
    """The decoding with the reach that its Gray code needs, and the disagreement with the phases.

    Refuses a Gray code that is as far from the phases as an unrelated one.
    """
    off, sigma = _distance_from_gray(decoding, gray, planes, noise, limits)
    step, longest = gray.step_px, decoding.longest_px
    # Distances that are uniform up to half a cell, or half a period, have a median of a quarter.
    expected = float(np.hypot(step / 4.0, sigma))
    unrelated = longest / 4.0
    # With cells of one period, unrelated codes and fringes have the same median distance.
    distinct = unrelated > NOISE_ALONE * expected
    if distinct and off > 0.5 * (expected + unrelated):
        raise FramesContradictPlan(
            f"frames along {decoding.axis}: phases and Gray code are {off:.0f} px apart, like "
            "unrelated ones; expected frames in the order of the plan, with its periods, steps and "
            "Gray-code cells"
        )
    if off <= NOISE_ALONE * expected:
        return decoding, 1.0
    usual = GRAY_REACH * step
    reach = min(usual * off / expected, longest / 4.0)
    disagreement = (off**2 - (step / 4.0) ** 2) / max(sigma**2, MIN_VARIANCE_PX2)
    return replace(decoding, reach_px=max(reach, usual)), disagreement


def _disagreement(
    decoding: Decoding, planes: list[NDArray[Any]], noise: CameraNoise, limits: Limits
) -> float | None:
    """Median χ² of the sets over its expectation; None where too few pixels are lit."""
    maps = empty_maps((1, planes[0].size), disagreement=True)
    kernel = replace(decoding, reach_px=float("inf")).kernel(noise, limits)
    _core.decode_frames(planes, kernel, maps)
    lit = (maps["reason"] == Reason.OK) | (maps["reason"] == Reason.ORDER_AMBIGUOUS)
    square = maps["disagreement"][lit & np.isfinite(maps["disagreement"])]
    if square.size < MIN_JUDGED_PIXELS:
        return None
    return float(np.median(square)) / chi_square_quantile(0.5, len(decoding.sets) - 1)


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
    by_phases, by_gray = (empty_maps((1, planes[0].size)) for _ in range(2))
    unlimited = replace(decoding, reach_px=float("inf"))
    _core.decode_frames(planes, unlimited.kernel(noise, limits), by_phases)
    alone = replace(decoding, sets=(), chain=None)
    gray_planes = [planes[decoding.frames.index(k)] for k in alone.frames]
    _core.decode_frames(gray_planes, alone.kernel(noise, limits), by_gray)
    both = np.isfinite(by_phases["coordinate"]) & np.isfinite(by_gray["coordinate"])
    if both.sum() < MIN_JUDGED_PIXELS:
        return 0.0, 0.0
    off = np.abs(by_phases["coordinate"] - by_gray["coordinate"])[both]
    sigma = NORMAL_MEDIAN * float(np.median(by_phases["sigma"][both]))
    return float(np.median(off)), sigma


def _unrelated(decoding: Decoding, planes: list[NDArray[Any]]) -> list[NDArray[Any]]:
    """The sample with the pixels of every set shuffled, so that the sets are unrelated."""
    rng = np.random.default_rng(0)
    shuffled = list(planes)
    for phases in decoding.sets:
        order = rng.permutation(planes[0].size)
        for k in phases.frames:
            place = decoding.frames.index(k)
            shuffled[place] = np.ascontiguousarray(planes[place][:, order])
    return shuffled
