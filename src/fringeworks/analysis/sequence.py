"""What a sample of the pixels says about a stack: its noise, its order, its real steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.analysis.kernel import Decoding, Limits, empty_maps
from fringeworks.analysis.steps import estimate_shifts
from fringeworks.noise import (
    chi_square_quantile,
    noise_of_residuals,
    noise_variance,
    residual_variance,
)
from fringeworks.patterns import PatternPlan
from fringeworks.types import Axis, CameraNoise, FloatMap, InputError, Reason

MIN_PIXELS = 200
"""Pixels that a judgement about the whole stack needs."""
PLAIN = 1.15
"""Disagreement of the sets, in units of the noise, up to which it is taken for noise."""
SUSPICIOUS = 2.5
"""Disagreement above which it is compared with that of unrelated phases."""
CHANCE = 0.3
"""Share of the disagreement of unrelated phases above which the order of the frames is wrong."""
EXPLAINED = 0.25
"""A swap of two frames is named where it leaves less than this of the misfit."""
ROUGH = 0.004
"""Residual variance over B² above which swapped frames are looked for."""
CLIPPED = 3.0
"""Distance from the sensor's limits, in standard deviations, within which noise is cut off."""
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
    notes: list[str] = []
    details: dict[str, Any] = {}
    values = {axis: _values(sample, decoding) for axis, decoding in decodings.items()}
    if estimate_steps:
        for axis, decoding in decodings.items():
            decodings[axis], said = _real_steps(decoding, values[axis], limits)
            notes += said
    for axis, decoding in decodings.items():
        _refuse_swapped_in_sets(decoding, values[axis], limits, plan)
    if noise is None:
        noise, source = _measure_noise(decodings, values, limits, patch)
        shot = f", {noise.gain:.3g} counts² per count" if noise.gain else ""
        notes.append(f"noise of {noise.read_counts:.3g} counts{shot}, from {source}")
    if sample[0].dtype.kind == "u" and noise.read_counts < 12.0**-0.5:
        noise = replace(noise, read_counts=12.0**-0.5)
    elif noise.read_counts == 0.0 and noise.gain == 0.0:
        # Single precision is all that the kernels have.
        largest = max((float(np.abs(v).max(initial=0.0)) for v in values.values()), default=1.0)
        noise = CameraNoise(max(largest, 1.0) * 1e-6)
    for axis, decoding in decodings.items():
        scale = _disagreement(decoding, sample, noise, limits, plan)
        details[axis] = {
            "disagreement": scale**0.5,
            "shifts_deg": [np.degrees(s.shifts_rad).round(3).tolist() for s in decoding.sets],
        }
        if scale > PLAIN:
            notes.append(
                f"the phases along {axis} disagree by {scale**0.5:.1f} times their noise: "
                "standard deviations are raised by that"
            )
            decodings[axis] = replace(decoding, scale=scale)
    return Findings(noise, limits, decodings, tuple(notes), details)


def _values(sample: Sequence[NDArray[Any]], decoding: Decoding) -> FloatMap:
    """Samples of the phase frames, (frames, n), float; the sets one after the other."""
    frames = [k for phases in decoding.sets for k in phases.frames]
    if not frames:
        return np.empty((0, sample[0].size))
    return np.stack([sample[k][0].astype(np.float64) for k in frames])


def _parts(decoding: Decoding) -> list[slice]:
    ends = np.cumsum([len(phases.frames) for phases in decoding.sets])
    return [slice(int(end) - len(s.frames), int(end)) for s, end in zip(decoding.sets, ends, strict=True)]


def _usable(values: FloatMap, limits: Limits) -> NDArray[np.bool_]:
    """Pixels that are finite and nowhere at the sensor's upper limit, but all where those are few."""
    finite = np.isfinite(values).all(axis=0)
    inner = finite & (values < limits.saturation).all(axis=0)
    return inner if inner.sum() >= MIN_PIXELS else finite


def _solve(values: FloatMap, shifts: Sequence[float]) -> tuple[FloatMap, FloatMap]:
    """Background, c and s of one set, and the sum of squares that they leave."""
    design = np.column_stack((np.ones(len(shifts)), np.cos(shifts), np.sin(shifts)))
    found = np.linalg.pinv(design) @ values
    left = values - design @ found
    return found, np.sum(left**2, axis=0)


def _measure_noise(
    decodings: dict[Axis, Decoding],
    values: dict[Axis, FloatMap],
    limits: Limits,
    patch: Sequence[FloatMap],
) -> tuple[CameraNoise, str]:
    """Noise from the residuals of the fits; else from how backgrounds differ; else from texture."""
    for axis, decoding in decodings.items():
        found = _residual_noise(decoding, values[axis], limits)
        if found is not None:
            return found, "the residuals of the fits"
    for axis, decoding in decodings.items():
        found = _background_noise(decoding, values[axis], limits)
        if found is not None:
            return found, "the backgrounds of the sets"
    texture = [noise_variance(frame, np.isfinite(frame)) for frame in patch]
    return CameraNoise(float(np.sqrt(np.mean(texture))) if texture else 0.0), "the frames' texture"


def _residual_noise(
    decoding: Decoding, values: FloatMap, limits: Limits
) -> CameraNoise | None:
    """Noise from what the fits of four and more steps leave; None where there are none.

    Samples near the sensor's limits have less noise than others, and those that noise kept off the
    limits more light than they should: samples are chosen by the fitted light, and left out of
    the fit, not by their own value.
    """
    rich = [
        (part, phases)
        for part, phases in zip(_parts(decoding), decoding.sets, strict=True)
        if len(phases.frames) > 3
    ]
    if not rich:
        return None
    finite = np.isfinite(values).all(axis=0)
    if finite.sum() < MIN_PIXELS:
        return None
    data = values[:, finite]
    levels, squares, freedoms = [], [], []
    for part, phases in rich:
        found, left = _solve(data[part], phases.shifts_rad)
        count = np.full(left.shape, len(phases.frames))
        rough = residual_variance(left, len(phases.frames) - 3) ** 0.5
        inside = _inside(data[part], phases.shifts_rad, found, limits, CLIPPED * rough)
        if not inside.all():
            left, count = _solve_some(data[part], phases.shifts_rad, inside)
        levels.append(found[0])
        squares.append(left)
        freedoms.append(count - 3)
    freedom = np.concatenate(freedoms)
    usual = np.bincount(np.maximum(freedom, 0))[1:]
    if usual.size == 0 or usual.max() < MIN_PIXELS:
        return None
    most = int(np.argmax(usual * np.arange(1, usual.size + 1))) + 1
    chosen = freedom == most
    level, square = np.concatenate(levels)[chosen], np.concatenate(squares)[chosen]
    return noise_of_residuals(level, square, most)


def _inside(
    values: FloatMap,
    shifts: Sequence[float],
    found: FloatMap,
    limits: Limits,
    margin: float,
) -> NDArray[np.bool_]:
    """Samples whose fitted light is away from both ends of the sensor's range."""
    if not np.isfinite(limits.saturation) or values.min() > 0 and values.max() < limits.saturation:
        return np.ones(values.shape, bool)
    design = np.column_stack((np.ones(len(shifts)), np.cos(shifts), np.sin(shifts)))
    light = design @ found
    return np.asarray((light > margin) & (light < limits.saturation - margin))


def _solve_some(
    values: FloatMap, shifts: Sequence[float], inside: NDArray[np.bool_]
) -> tuple[FloatMap, NDArray[np.intp]]:
    """Sum of squares that fits of some samples of every pixel leave, and how many those were."""
    design = np.column_stack((np.ones(len(shifts)), np.cos(shifts), np.sin(shifts)))
    count = inside.sum(axis=0)
    weight = np.where(count > 3, inside, True).astype(float)
    normal = np.einsum("ns,ni,nj->sij", weight, design, design)
    right = np.einsum("ns,ni->si", weight * values, design)
    known = np.linalg.cond(normal) < 1e6
    normal[~known] = np.eye(3)
    fitted = design @ np.linalg.solve(normal, right[..., None])[..., 0].T
    left = np.sum(weight * (values - fitted) ** 2, axis=0)
    return left, np.where(known, count, 0)


def _background_noise(
    decoding: Decoding, values: FloatMap, limits: Limits
) -> CameraNoise | None:
    """Noise from how the backgrounds of several sets differ."""
    if len(decoding.sets) < 2:
        return None
    finite = np.isfinite(values).all(axis=0)
    data = values[:, finite]
    parts = _parts(decoding)
    fits = [_solve(data[p], s.shifts_rad)[0] for p, s in zip(parts, decoding.sets, strict=True)]
    steps = np.array([len(s.frames) for s in decoding.sets], float)[:, None]
    chosen = np.ones(data.shape[1], bool)
    for _ in range(2):
        if chosen.sum() < MIN_PIXELS:
            return None
        stack = np.stack([f[0] for f in fits])[:, chosen]
        mean = np.sum(steps * stack, axis=0) / steps.sum()
        square = np.sum(steps * (stack - mean) ** 2, axis=0)
        found = noise_of_residuals(mean, square, len(fits) - 1)
        rough = residual_variance(square, len(fits) - 1) ** 0.5
        inside = [
            _inside(data[p], s.shifts_rad, f, limits, CLIPPED * rough).all(axis=0)
            for p, s, f in zip(parts, decoding.sets, fits, strict=True)
        ]
        inner = np.logical_and.reduce(inside)
        if inner.all() or inner.sum() < MIN_PIXELS:
            break
        chosen = inner
    return found


def _real_steps(
    decoding: Decoding, values: FloatMap, limits: Limits
) -> tuple[Decoding, list[str]]:
    """The decoding with shifts as the frames show them."""
    sets, notes = [], []
    for part, phases in zip(_parts(decoding), decoding.sets, strict=True):
        data = values[part]
        found, left = _solve(data, phases.shifts_rad)
        power = found[1] ** 2 + found[2] ** 2
        lit = _usable(data, limits) & (power > 0.25 * np.percentile(power, 95))
        shifts = estimate_shifts(data[:, lit], phases.shifts_rad)
        off = np.degrees(np.abs(shifts - np.asarray(phases.shifts_rad)).max())
        notes.append(
            f"steps of {phases.period_px:g} px along {decoding.axis}: "
            f"{', '.join(f'{d:.1f}' for d in np.degrees(shifts))}°, off by up to {off:.1f}°"
        )
        sets.append(replace(phases, shifts_rad=tuple(float(d) for d in shifts)))
        del left
    return replace(decoding, sets=tuple(sets)), notes


def _refuse_swapped_in_sets(
    decoding: Decoding, values: FloatMap, limits: Limits, plan: PatternPlan
) -> None:
    """Refuse frames whose residuals say that two of them are swapped."""
    usable = np.flatnonzero(_usable(values, limits)) if values.size else np.empty(0, int)
    if usable.size < MIN_PIXELS:
        return
    data = values[:, usable[:: max(1, usable.size // SWAP_PIXELS)]]
    parts = _parts(decoding)

    def misfit(order: NDArray[np.intp]) -> float:
        total = 0.0
        for part, phases in zip(parts, decoding.sets, strict=True):
            if len(phases.frames) > 3:
                _, left = _solve(data[order[part]], phases.shifts_rad)
                total += float(np.mean(left))
        return total

    freedom = sum(len(s.frames) - 3 for s in decoding.sets)
    if freedom == 0 or len(data) > MAX_SWAP_FRAMES:
        return
    plain = np.arange(len(data))
    before = misfit(plain)
    power = [float(np.median(np.sum(_solve(data[p], s.shifts_rad)[0][1:] ** 2, axis=0)))
             for p, s in zip(parts, decoding.sets, strict=True)]
    if before / freedom < ROUGH * float(np.mean(power)):
        return
    swap, after = min(
        ((pair, misfit(_swapped(plain, pair))) for pair in combinations(range(len(data)), 2)),
        key=lambda item: item[1],
    )
    if after < EXPLAINED * before:
        _refuse_swap(decoding, plan, swap, "their residuals")


def _swapped(order: NDArray[np.intp], pair: tuple[int, int]) -> NDArray[np.intp]:
    out = order.copy()
    out[list(pair)] = out[list(pair[::-1])]
    return out


def _refuse_swap(
    decoding: Decoding, plan: PatternPlan, pair: tuple[int, int], why: str
) -> None:
    frames = [k for phases in decoding.sets for k in phases.frames]
    first, second = (frames[k] for k in pair)
    labels = plan.labels()
    raise InputError(
        f"frames {first} ({labels[first]}) and {second} ({labels[second]}) seem to be swapped: "
        f"{why} say so; expected the order of the plan"
    )


def _disagreement(
    decoding: Decoding,
    sample: Sequence[NDArray[Any]],
    noise: CameraNoise,
    limits: Limits,
    plan: PatternPlan,
) -> float:
    """Variance of the sets' disagreement over what the noise explains, ≥ 1."""
    if not decoding.sets:
        return 1.0
    open_limits = replace(limits, max_disagreement=float("inf"))
    planes = [sample[k] for k in decoding.frames]
    score = _score(decoding, planes, noise, open_limits)
    if score is None:
        return 1.0
    related = len(decoding.sets) > 1 or decoding.code is not None
    if related and score > SUSPICIOUS:
        chance = _score(decoding, _unrelated(decoding, planes), noise, open_limits)
        if chance is not None and score > CHANCE * chance:
            _explain(decoding, planes, noise, open_limits, plan, score)
    return max(1.0, score) if len(decoding.sets) > 1 else 1.0


def _score(
    decoding: Decoding, planes: list[NDArray[Any]], noise: CameraNoise, limits: Limits
) -> float | None:
    """Median χ² of lit pixels over its expectation; with one set, the share that fits no code."""
    maps = empty_maps((1, planes[0].size), disagreement=True)
    _core.decode_frames(planes, decoding.kernel(noise, limits), maps)
    judged = (maps["reason"] == Reason.OK) | (maps["reason"] == Reason.ORDER_AMBIGUOUS)
    if judged.sum() < MIN_PIXELS:
        return None
    if len(decoding.sets) == 1:
        # Half of unrelated pixels fit by chance: a quarter that does not is suspicious.
        return 4.0 * SUSPICIOUS * float(np.mean(maps["reason"][judged] == Reason.ORDER_AMBIGUOUS))
    freedom = len(decoding.sets) - 1
    return residual_median(maps["disagreement"][judged], freedom)


def residual_median(square: FloatMap, freedom: int) -> float:
    """Median of sums of squares over the median of χ²."""
    finite = square[np.isfinite(square)]
    return float(np.median(finite)) / chi_square_quantile(0.5, freedom) if finite.size else 1.0


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


def _explain(
    decoding: Decoding,
    planes: list[NDArray[Any]],
    noise: CameraNoise,
    limits: Limits,
    plan: PatternPlan,
    score: float,
) -> None:
    """Raise, with the swap of two frames that would make the sets agree, where there is one."""
    count = sum(len(phases.frames) for phases in decoding.sets)
    if count <= MAX_SWAP_FRAMES:
        step = max(1, planes[0].size // SWAP_PIXELS)
        few = [np.ascontiguousarray(plane[:, ::step]) for plane in planes]
        best, least = (0, 1), np.inf
        for pair in combinations(range(count), 2):
            places = _swapped(np.arange(len(few)), pair)
            found = _score(decoding, [few[k] for k in places], noise, limits)
            if found is not None and found < least:
                best, least = pair, found
        if least < EXPLAINED * score:
            _refuse_swap(decoding, plan, best, "the fringe orders")
    raise InputError(
        f"frames along {decoding.axis}: fringe orders contradict each other all over the image "
        f"({score**0.5:.0f} times the noise): expected the frames in the order of the plan, with "
        "its periods and steps"
    )
