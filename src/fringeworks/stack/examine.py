"""What a sample of the pixels says about a stack: its noise, its order, its real steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.patterns.order_chain import CODE_REACH
from fringeworks.patterns.plan import PatternPlan
from fringeworks.signal.noise import chi_square_quantile
from fringeworks.stack.kernel_settings import Decoding, Limits, empty_maps
from fringeworks.stack.noise import (
    MIN_PIXELS,
    exceeds,
    measure_noise,
    phase_samples,
    set_parts,
    solve,
    usable,
)
from fringeworks.stack.shifts import estimate_shifts
from fringeworks.types import Axis, CameraNoise, FloatMap, InputError, Reason

PLAIN = 1.15
"""Disagreement of the sets, in units of the noise, up to which it is taken for noise."""
SUSPICIOUS = 2.5
"""Disagreement above which it is compared with that of unrelated phases."""
SWAPPED = 0.3
"""Share of the disagreement of unrelated phases above which swapped frames are looked for."""
CHANCE = 0.9
"""The same above which no order can be trusted."""
EXPLAINED = 0.25
"""A swap of two frames is named where it leaves less than this of the misfit."""
PRECISION = 5e-5
"""Error of the kernels' arithmetic, share of the largest count."""
ALIKE = 1.5
"""Swaps that leave up to this many times the misfit of the best one explain as much."""
MAX_NAMED = 2
"""Pairs that are named; where more explain the frames, none does."""
ROUGH = 0.004
"""Residual variance over B² above which swapped frames are looked for."""
MAX_SWAP_FRAMES = 24
SWAP_PIXELS = 2000


@dataclass(frozen=True)
class Findings:
    """What decoding goes by."""

    noise: CameraNoise
    limits: Limits
    decodings: dict[Axis, Decoding]
    """How each axis is decoded, with its real shifts and the disagreement of its sets."""
    notes: tuple[str, ...] = ()
    details: dict[str, Any] = field(default_factory=dict)


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
    decodings : how each axis would be decoded
    limits : Limits
    noise : CameraNoise, optional
        Known noise; measured where left out.
    patch : (h, w) float arrays
        Connected pixels of some frames, for the noise where nothing else tells it.
    estimate_steps : bool
        Whether shifts are taken from the frames.

    Raises
    ------
    InputError where frames contradict the plan, such as two that are swapped.
    """
    decodings = dict(decodings)
    notes: list[str] = []
    details: dict[str, Any] = {}
    values = {axis: phase_samples(sample, decoding) for axis, decoding in decodings.items()}
    if estimate_steps:
        for axis, decoding in decodings.items():
            decodings[axis], said = _real_steps(decoding, values[axis], limits)
            notes += said
    for axis, decoding in decodings.items():
        _refuse_swapped_in_sets(decoding, values[axis], limits, plan)
    if noise is None:
        noise, source = measure_noise(decodings, values, limits, patch)
        shot = f", {noise.gain:.3g} counts² per count" if noise.gain else ""
        notes.append(f"noise of {noise.read_counts:.3g} counts{shot}, from {source}")
    largest = max((float(np.abs(s[np.isfinite(s)]).max(initial=0.0)) for s in sample), default=0.0)
    # Rounding to whole counts, and that of the kernels' single precision.
    floor = max(12.0**-0.5 if sample[0].dtype.kind == "u" else 0.0, PRECISION * largest, 1e-30)
    if noise.read_counts < floor:
        noise = replace(noise, read_counts=floor)
    if not limits.given and np.isfinite(limits.saturation):
        exceeded = [exceeds(d, values[axis], limits, noise) for axis, d in decodings.items()]
        if not any(exceeded):
            limits = replace(limits, saturation=float("inf"))
    for axis, decoding in decodings.items():
        open_limits = replace(limits, max_disagreement=float("inf"))
        decodings[axis], scale = _judged(decoding, sample, noise, open_limits, plan)
        details[axis] = {
            "disagreement": scale**0.5,
            "shifts_deg": [np.degrees(s.shifts_rad).round(3).tolist() for s in decoding.sets],
        }
        if scale > PLAIN:
            notes.append(
                f"phases (and code) along {axis} disagree by {scale**0.5:.1f} times their noise: "
                "standard deviations are raised by that"
            )
    return Findings(noise, limits, decodings, tuple(notes), details)


def _real_steps(decoding: Decoding, values: FloatMap, limits: Limits) -> tuple[Decoding, list[str]]:
    """The decoding with shifts as the frames show them."""
    sets, notes = [], []
    for part, phases in zip(set_parts(decoding), decoding.sets, strict=True):
        data = values[part]
        found, _ = solve(data, phases.shifts_rad)
        power = found[1] ** 2 + found[2] ** 2
        lit = usable(data, limits) & (power > 0.25 * np.percentile(power, 95))
        shifts = estimate_shifts(data[:, lit], phases.shifts_rad)
        off = np.degrees(np.abs(shifts - np.asarray(phases.shifts_rad)).max())
        notes.append(
            f"steps of {phases.period_px:g} px along {decoding.axis}: "
            f"{', '.join(f'{d:.1f}' for d in np.degrees(shifts))}°, off by up to {off:.1f}°"
        )
        sets.append(replace(phases, shifts_rad=tuple(float(d) for d in shifts)))
    return replace(decoding, sets=tuple(sets)), notes


def _refuse_swapped_in_sets(
    decoding: Decoding, values: FloatMap, limits: Limits, plan: PatternPlan
) -> None:
    """Refuse frames whose residuals say that two of them are swapped."""
    places = np.flatnonzero(usable(values, limits)) if values.size else np.empty(0, int)
    if places.size < MIN_PIXELS:
        return
    data = values[:, places[:: max(1, places.size // SWAP_PIXELS)]]
    parts = set_parts(decoding)

    def misfit(order: NDArray[np.intp]) -> float:
        total = 0.0
        for part, phases in zip(parts, decoding.sets, strict=True):
            if len(phases.frames) > 3:
                _, left = solve(data[order[part]], phases.shifts_rad)
                total += float(np.mean(left))
        return total

    freedom = sum(len(s.frames) - 3 for s in decoding.sets)
    if freedom == 0 or len(data) > MAX_SWAP_FRAMES:
        return
    plain = np.arange(len(data))
    before = misfit(plain)
    power = [
        float(np.median(np.sum(solve(data[p], s.shifts_rad)[0][1:] ** 2, axis=0)))
        for p, s in zip(parts, decoding.sets, strict=True)
    ]
    if before / freedom < ROUGH * float(np.mean(power)):
        return
    pairs = list(combinations(range(len(data)), 2))
    after = np.array([misfit(_swapped(plain, pair)) for pair in pairs])
    alike = _alike(pairs, after)
    if after.min() < EXPLAINED * before and len(alike) <= MAX_NAMED:
        _refuse_swap(decoding, plan, alike, "their residuals")


def _swapped(order: NDArray[np.intp], pair: tuple[int, int]) -> NDArray[np.intp]:
    out = order.copy()
    out[list(pair)] = out[list(pair[::-1])]
    return out


def _alike(pairs: list[tuple[int, int]], misfit: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Pairs whose swap explains the frames as well as the best one's, which comes first."""
    order = np.argsort(misfit)
    return [pairs[k] for k in order if misfit[k] <= ALIKE * misfit[order[0]]]


def _refuse_swap(
    decoding: Decoding, plan: PatternPlan, pairs: list[tuple[int, int]], why: str
) -> None:
    frames = decoding.phase_frames
    labels = plan.labels()
    named = [
        f"{frames[first]} and {frames[second]} ({labels[frames[first]]}, {labels[frames[second]]})"
        for first, second in sorted(pairs)
    ]
    raise InputError(
        f"frames {' or '.join(named)} seem to be swapped: {why} say so; expected the order of the "
        "plan"
    )


def _judged(
    decoding: Decoding,
    sample: Sequence[NDArray[Any]],
    noise: CameraNoise,
    limits: Limits,
    plan: PatternPlan,
) -> tuple[Decoding, float]:
    """The decoding with what its sets, and its code, disagree by; and that in units of the noise.

    Raises where they disagree as if they had nothing to do with each other.
    """
    planes = [sample[k] for k in decoding.frames]
    scale = 1.0
    if len(decoding.sets) > 1:
        score = _score(decoding, planes, noise, limits)
        if score is not None and score > SUSPICIOUS:
            chance = _score(decoding, _unrelated(decoding, planes), noise, limits)
            if chance is not None and score > SWAPPED * chance:
                _refuse_swapped(decoding, planes, noise, limits, plan, score)
            if chance is not None and score > CHANCE * chance:
                raise InputError(
                    f"frames along {decoding.axis}: fringe orders contradict each other all over "
                    f"the image ({score**0.5:.0f} times the noise): expected the frames in the "
                    "order of the plan, with its periods and steps, and a response that leaves "
                    "their orders apart"
                )
        scale = max(scale, score or 1.0)
    if decoding.sets and decoding.code is not None:
        off, own = _off_code(decoding, planes, noise, limits)
        step, longest = decoding.code.step_px, decoding.longest_px
        expected = float(np.hypot(step / 4.0, own))
        if off > 0.5 * (expected + longest / 4.0):
            raise InputError(
                f"frames along {decoding.axis}: phases and Gray code are {off:.0f} px apart, as "
                "far as by chance: expected the frames in the order of the plan, with its periods, "
                "steps and cells"
            )
        if off > PLAIN * expected:
            usual = CODE_REACH * step
            reach = min(usual * off / expected, longest / 4.0)
            decoding = replace(decoding, reach_px=max(reach, usual))
            scale = max(scale, (off**2 - (step / 4.0) ** 2) / max(own**2, 1e-12))
    return (replace(decoding, scale=scale) if scale > PLAIN else decoding), scale


def _score(
    decoding: Decoding, planes: list[NDArray[Any]], noise: CameraNoise, limits: Limits
) -> float | None:
    """Median χ² of lit pixels over its expectation; None where too few are lit."""
    maps = empty_maps((1, planes[0].size), disagreement=True)
    kernel = replace(decoding, reach_px=float("inf")).kernel(noise, limits)
    _core.decode_frames(planes, kernel, maps)
    judged = (maps["reason"] == Reason.OK) | (maps["reason"] == Reason.ORDER_AMBIGUOUS)
    square = maps["disagreement"][judged & np.isfinite(maps["disagreement"])]
    if square.size < MIN_PIXELS:
        return None
    return float(np.median(square)) / chi_square_quantile(0.5, len(decoding.sets) - 1)


def _off_code(
    decoding: Decoding, planes: list[NDArray[Any]], noise: CameraNoise, limits: Limits
) -> tuple[float, float]:
    """Median distance of coordinates from their code cell's middle, and of their noise, px."""
    if decoding.code is not None and not decoding.code.inverse and decoding.code.levels is None:
        return 0.0, 0.0  # read against the phases: there is no code by itself
    maps, code = (empty_maps((1, planes[0].size)) for _ in range(2))
    free = replace(decoding, reach_px=float("inf"))
    _core.decode_frames(planes, free.kernel(noise, limits), maps)
    alone = replace(decoding, sets=(), chain=None)
    some = [planes[decoding.frames.index(k)] for k in alone.frames]
    _core.decode_frames(some, alone.kernel(noise, limits), code)
    both = np.isfinite(maps["coordinate"]) & np.isfinite(code["coordinate"])
    if both.sum() < MIN_PIXELS:
        return 0.0, 0.0
    off = np.abs(maps["coordinate"] - code["coordinate"])[both]
    return float(np.median(off)), 0.6745 * float(np.median(maps["sigma"][both]))


def _unrelated(decoding: Decoding, planes: list[NDArray[Any]]) -> list[NDArray[Any]]:
    """The sample with the pixels of every set in another order: no sets belong together."""
    rng = np.random.default_rng(0)
    out = list(planes)
    for phases in decoding.sets:
        order = rng.permutation(planes[0].size)
        for k in phases.frames:
            place = decoding.frames.index(k)
            out[place] = np.ascontiguousarray(planes[place][:, order])
    return out


def _refuse_swapped(
    decoding: Decoding,
    planes: list[NDArray[Any]],
    noise: CameraNoise,
    limits: Limits,
    plan: PatternPlan,
    score: float,
) -> None:
    """Refuse frames where the swap of two of them would make the sets agree."""
    count = len(decoding.phase_frames)
    if count <= MAX_SWAP_FRAMES:
        step = max(1, planes[0].size // SWAP_PIXELS)
        few = [np.ascontiguousarray(plane[:, ::step]) for plane in planes]
        pairs = list(combinations(range(count), 2))
        after = np.full(len(pairs), np.inf)
        for k, pair in enumerate(pairs):
            places = _swapped(np.arange(len(few)), pair)
            found = _score(decoding, [few[p] for p in places], noise, limits)
            after[k] = np.inf if found is None else found
        alike = _alike(pairs, after)
        if after.min() < EXPLAINED * score and len(alike) <= MAX_NAMED:
            _refuse_swap(decoding, plan, alike, "the fringe orders")
