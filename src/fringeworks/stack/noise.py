"""The noise of a camera, from a sample of a stack's pixels."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import step_design
from fringeworks.signal.noise import noise_of_residuals, noise_variance, residual_variance
from fringeworks.stack.kernel_settings import Decoding, Limits
from fringeworks.types import Axis, BoolMap, CameraNoise, FloatMap, InputError

MIN_PIXELS = 200
"""Pixels that a judgement about the whole stack needs."""
MAX_RESIDUALS = 16_000
"""Residuals, about, that the noise is taken from: its error is half a percent."""
TEXTURE = 4.0
"""Variance over that of the texture above which backgrounds differ by more than noise."""
RARE = 0.01
"""Share of samples at the limit that may exceed it by chance or on a highlight."""
DIM = 0.1
"""Share of the frames' brightness below which a pixel tells little of the noise."""
CLIPPED = 3.0
"""Distance from the sensor's limits, in standard deviations, within which noise is cut off."""


def phase_samples(sample: Sequence[NDArray[Any]], decoding: Decoding) -> FloatMap:
    """Samples of the phase frames, (frames, n), float; the sets one after the other."""
    frames = decoding.phase_frames
    if not frames:
        return np.empty((0, sample[0].size))
    return np.stack([sample[k][0].astype(np.float64) for k in frames])


def set_parts(decoding: Decoding) -> list[slice]:
    ends = np.cumsum([len(phases.frames) for phases in decoding.sets])
    return [
        slice(int(end) - len(s.frames), int(end))
        for s, end in zip(decoding.sets, ends, strict=True)
    ]


def usable(values: FloatMap, limits: Limits) -> BoolMap:
    """Pixels that are finite and nowhere at the sensor's limit, but all where those are few."""
    finite = np.asarray(np.isfinite(values).all(axis=0))
    inner = finite & (values < limits.saturation).all(axis=0)
    return inner if inner.sum() >= MIN_PIXELS else finite


@lru_cache(maxsize=1024)
def fit_matrices(
    shifts_rad: tuple[float, ...], kept: tuple[bool, ...] | None = None
) -> tuple[FloatMap, FloatMap | None]:
    """Design of I = A + c cos δ + s sin δ and its solver, for all frames of a set or for some.

    No solver where the frames do not determine the three.
    """
    design = step_design(shifts_rad)
    if kept is not None:
        design = design[list(kept)]
    known = len(design) >= 3 and np.linalg.cond(design) < 1e3
    return design, np.linalg.pinv(design) if known else None


def _times(matrix: FloatMap, values: FloatMap) -> FloatMap:
    """matrix @ values without BLAS: its threads would spin on while the decoding kernel runs."""
    return np.asarray(np.einsum("ij,jn->in", matrix, values))


def solve(values: FloatMap, shifts_rad: Sequence[float]) -> tuple[FloatMap, FloatMap]:
    """Background, c and s of one set, and the sum of squares that they leave."""
    design, solver = fit_matrices(tuple(shifts_rad))
    if solver is None:
        raise InputError("shifts: expected three or more that differ, got none that do")
    found = _times(solver, values)
    left = values - _times(design, found)
    return found, np.einsum("ns,ns->s", left, left)


def measure_noise(
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
    texture = [noise_variance(frame, np.asarray(np.isfinite(frame))) for frame in patch]
    plain = CameraNoise(float(np.sqrt(np.mean(texture))) if texture else 0.0)
    for axis, decoding in decodings.items():
        found = _background_noise(decoding, values[axis], limits)
        if found is None:
            continue
        level = max(float(np.mean(values[axis])), 0.0)
        variance = found.read_counts**2 + found.gain * level
        if texture and variance > TEXTURE * max(plain.read_counts**2, 1.0 / 12.0):
            return plain, "the frames' texture: backgrounds of the sets differ by more"
        return found, "the backgrounds of the sets"
    return plain, "the frames' texture"


def _residual_noise(decoding: Decoding, values: FloatMap, limits: Limits) -> CameraNoise | None:
    """Noise from what the fits of four and more steps leave; None where there are none.

    Samples near the sensor's limits have less noise than others, and those that noise kept off the
    limits more light than they should: samples are chosen by the fitted light, and left out of
    the fit, not by their own value.
    """
    rich = [
        (part, phases)
        for part, phases in zip(set_parts(decoding), decoding.sets, strict=True)
        if len(phases.frames) > 3
    ]
    if not rich:
        return None
    finite = np.isfinite(values).all(axis=0)
    if finite.sum() < MIN_PIXELS:
        return None
    # Where it is dark, noise is cut off: with enough light elsewhere, that is where to look.
    light = np.where(finite, values, 0.0).mean(axis=0)
    lit = finite & (light > DIM * np.percentile(light[finite], 99))
    data = values[:, lit if lit.sum() >= MIN_PIXELS else finite]
    data = data[:, :: max(1, data.shape[1] * len(rich) // MAX_RESIDUALS)]
    levels, squares, freedoms = [], [], []
    for part, phases in rich:
        found, left = solve(data[part], phases.shifts_rad)
        count = np.full(left.shape, len(phases.frames))
        rough = residual_variance(left[::4], len(phases.frames) - 3) ** 0.5
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
    if not np.isfinite(limits.saturation) or (
        values.min() > 0 and values.max() < limits.saturation
    ):
        return np.ones(values.shape, bool)
    light = _times(fit_matrices(tuple(shifts))[0], found)
    return np.asarray((light > margin) & (light < limits.saturation - margin))


def _solve_some(
    values: FloatMap, shifts: Sequence[float], inside: NDArray[np.bool_]
) -> tuple[FloatMap, NDArray[np.intp]]:
    """Sum of squares that fits of some samples of every pixel leave, and how many those were."""
    count = np.where(inside.sum(axis=0) > 3, inside.sum(axis=0), 0)
    left = np.zeros(values.shape[1])
    # Pixels that lack the same samples share a fit.
    bits = np.int64(1) << np.arange(len(shifts), dtype=np.int64)
    _, first, group = np.unique(bits @ inside, return_index=True, return_inverse=True)
    for k, place in enumerate(first):
        pattern = inside[:, place]
        some, solver = fit_matrices(tuple(shifts), tuple(pattern.tolist()))
        if len(some) <= 3 or solver is None:
            count[group == k] = 0
            continue
        own = np.flatnonzero(group == k)
        data = values[np.ix_(pattern, own)]
        left[own] = np.sum((data - _times(some, _times(solver, data))) ** 2, axis=0)
    return left, count


def _background_noise(decoding: Decoding, values: FloatMap, limits: Limits) -> CameraNoise | None:
    """Noise from how the backgrounds of several sets differ."""
    if len(decoding.sets) < 2:
        return None
    finite = np.isfinite(values).all(axis=0)
    data = values[:, finite]
    parts = set_parts(decoding)
    fits = [solve(data[p], s.shifts_rad)[0] for p, s in zip(parts, decoding.sets, strict=True)]
    steps = np.array([len(s.frames) for s in decoding.sets], float)[:, None]
    middle = np.sum(steps * np.stack([f[0] for f in fits]), axis=0) / steps.sum()
    chosen = np.ones(data.shape[1], bool)
    for _ in range(2):
        if chosen.sum() < MIN_PIXELS:
            return None
        mean = middle[chosen]
        square = sum(n * (f[0][chosen] - mean) ** 2 for n, f in zip(steps[:, 0], fits, strict=True))
        found = noise_of_residuals(mean, square, len(fits) - 1)
        rough = residual_variance(square, len(fits) - 1) ** 0.5
        # By the mean background: how backgrounds differ does not depend on it, while three
        # samples are their own fit and would choose themselves.
        inside = [
            _inside(data[p], s.shifts_rad, np.stack((middle, f[1], f[2])), limits, CLIPPED * rough)
            for p, s, f in zip(parts, decoding.sets, fits, strict=True)
        ]
        inner = np.logical_and.reduce([part.all(axis=0) for part in inside])
        if inner.all() or inner.sum() < MIN_PIXELS:
            break
        chosen = inner
    return found


def exceeds(decoding: Decoding, values: FloatMap, limits: Limits, noise: CameraNoise) -> bool:
    """Whether light exceeds the sensor's limit, or samples only touch it.

    A sample at the limit is compared with what the others say it should be: the fit of its set
    without it, or, of three steps, the background of the other sets. True where nothing tells.
    """
    at_limit = values >= limits.saturation
    if not at_limit.any():
        return False
    parts = set_parts(decoding)
    clear = np.stack([~at_limit[part].any(axis=0) for part in parts])
    means = np.stack([values[part].mean(axis=0) for part in parts])
    found: list[FloatMap] = []
    for part, phases in zip(parts, decoding.sets, strict=True):
        data, at, n = values[part], at_limit[part], len(phases.frames)
        if np.mean(at.sum(axis=0) > max(1, n // 4)) > RARE:
            return True
        single = at.sum(axis=0) == 1
        if n == 3:
            others = clear.sum(axis=0)
            known = single & (others > 0)
            background = np.sum(np.where(clear, means, 0.0), axis=0)[known] / others[known]
            should = 3.0 * background - np.sum(np.where(at, 0.0, data), axis=0)[known]
            found.append((should - limits.saturation) / np.sqrt(2.0 + 3.0 / others[known]))
            continue
        design, _ = fit_matrices(phases.shifts_rad)
        for step in range(n):
            rest = np.arange(n) != step
            own = np.flatnonzero(single & at[step])
            _, solver = fit_matrices(phases.shifts_rad, tuple(rest.tolist()))
            if solver is None or own.size == 0:
                continue
            weights = design[step] @ solver
            should = _times(weights[None], data[np.ix_(rest, own)])[0]
            found.append((should - limits.saturation) / np.linalg.norm(weights))
    tested = np.concatenate(found) if found else np.empty(0)
    if tested.size == 0:
        return True
    spread = np.sqrt(noise.read_counts**2 + noise.gain * limits.saturation)
    return bool(np.mean(tested > 4.0 * spread) > RARE)
