"""What two successive cycles of a plan tell of the motion of each part of the image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.order_chain import TURN
from fringeworks.patterns.plan import PatternPlan, PhaseSteps, step_design
from fringeworks.stack.frames import Planes
from fringeworks.stack.motion import Motion, fit_moving, moved_back, phase_sets
from fringeworks.stack.motion_ripple import STEPS_SHARE, ripple_weights, ripples
from fringeworks.types import Axis, FloatMap
from fringeworks.types.packages import cv2

BLOCK = 12
"""Side of the blocks of the image whose motion is told from one another, px. Single pixels would
carry noise and edges on to other moments. Empirical."""
AROUND = 3
"""Blocks along each side that the residuals of one are averaged over: a block alone may hold too
little of a period of the fringes to tell a motion from their shape."""
PHASES = 64
"""Phases that the response of a set to motion is averaged over; the sums are exact from 2 N on."""
PASSES = 3
"""Regressions of a velocity: each is wrong by a tenth of what it adds."""
SURE = 3.0
"""Median of what a regression adds, in standard deviations, below which it was the last one."""
LIT_SWING = 0.15
"""Smallest difference of a pixel's samples that counts as light, as a share of its 95th percentile:
a third of the modulation that decoding judges by."""
SHAPES = 2
"""Terms of the motion within a set: velocity and curvature."""
RIPPLES = 1000
"""Number from which on kinds of observations are ripples: plans have fewer sets."""
FRAME_ERROR_RAD = 0.002
"""Standard deviation of the velocity and curvature that light which flickers by 0.3 % from frame to
frame makes, rad."""
ALIKE_PX = 4
"""Distance over which residuals of paint in motion are alike, px: the blur of an edge, and the
error of the motion across the image."""
ROUNDING = 1.0 / 12.0
"""Smallest variance of a sample, that of rounding to whole counts, counts²."""
SMALLEST = 1e-6
"""Divides instead of the power of blocks without fringes, counts²."""


@dataclass(frozen=True)
class Evidence:
    """One kind of observation of how far surfaces move, at every block of the image."""

    weights: dict[int, float]
    """Weight of the place at each frame, from the first one of the pair: the observation is
    the sum of the places of the surface, projector px, times these weights."""
    seen: FloatMap
    """What was observed, (rows, columns) of blocks."""
    variance: FloatMap
    """Its variance by the residuals of the fits."""
    unit_px: float = 0.0
    """What an error of the phase steps makes of it, projector px per rad."""
    name: tuple[int, int] = (-1, 0)
    """Its kind, and the cycle of the pair."""


def evidence_of(
    one: Planes,
    other: Planes,
    plan: PatternPlan,
    motion: Motion,
    at_pixels: dict[Axis, FloatMap],
    noise: float,
) -> dict[Axis, list[Evidence]]:
    """Return what the frames of two cycles tell of the motion at every block.

    Parameters
    ----------
    one, other : (h, w) arrays in the order of the plan, counts
    plan : PatternPlan
    motion, at_pixels
        Of ``motion_between``.
    noise : float > 0
        Standard deviation of a sample, counts.

    Notes
    -----
    The phases of every set tell how far surfaces move from one cycle to the next. Within a set of
    four steps or more, a phase that turns otherwise than by the known motion leaves residuals:
    their regression on those of small turns is the velocity and curvature that is missing. It
    belongs to the frames of the set, and tells motion that all cycles repeat. The ripple of the
    phases of the finest set tells a part that residuals do not: of four steps, motion to and fro
    from frame to frame.
    """
    found: dict[Axis, list[Evidence]] = {}
    lit = lit_by(one, plan)
    for axis in plan.axes:
        steady = lit_medians(at_pixels[axis], lit)
        off = motion.velocity_px[axis] - at_pixels[axis] + whole(steady, lit.shape)
        found[axis] = []
        finest = min(block.period_px for _, block in plan.phase_sets(axis))
        for number, (first, block) in enumerate(phase_sets(plan)):
            if block.axis == axis:
                seen = _Set(number, first, block, plan.frames, noise**2)
                fits = [
                    seen.fit(frames, cycle, motion) for cycle, frames in enumerate((one, other))
                ]
                found[axis] += [e for fit in fits for e in fit.evidence(steady)]
                if block.period_px == finest:
                    found[axis] += [e for fit in fits for e in fit.ripple(steady)]
                found[axis].append(seen.travelled(fits[0].wave, fits[1].wave, off, steady))
    return found


@dataclass(frozen=True)
class _Fit:
    """A set of one cycle, fitted with the known motion."""

    wave: NDArray[np.complex64]
    """Modulation and phase, c + i s, counts."""
    missing: list[FloatMap]
    variances: list[FloatMap]
    samples: list[FloatMap]
    turned_rad: list[FloatMap]
    """Angles by which the phase turns by the known motion."""
    frames: range
    block: PhaseSteps
    name: tuple[int, int]

    def evidence(self, steady: FloatMap) -> list[Evidence]:
        """What its residuals tell beside a steady velocity; nothing of three steps."""
        if self.block.frames < 4:
            return []
        found = []
        number, cycle = self.name
        for term, weights in enumerate(turn_weights(self.block.shifts_rad)):
            placed = {k: float(w) for k, w in zip(self.frames, weights, strict=True)}
            seen = self.missing[term] + (steady if term == 0 else 0.0)
            unit, name = self.block.period_px / TURN, (SHAPES * number + term, cycle)
            found.append(Evidence(placed, seen, self.variances[term], unit, name))
        return found

    def ripple(self, steady: FloatMap) -> list[Evidence]:
        """What the ripple of its phases tells; nothing of three steps, whose ripple comes from
        light that flickers as well."""
        if self.block.frames < 4:
            return []
        unit = self.block.period_px / TURN
        times = _shapes(self.block.frames)
        steps = [whole(one, self.wave.shape) / np.float32(unit) for one in self.missing]
        turned = [
            known + _weighed(part, steps)
            for known, part in zip(self.turned_rad, times.T, strict=True)
        ]
        _, c, s, _ = fit_moving(self.samples, self.block.shifts_rad, turned)
        left, variance = ripples(c + np.complex64(1j) * s, self.block.shifts_rad, BLOCK)
        variance = unit**2 * (variance + np.float32(FRAME_ERROR_RAD**2))
        moves = [self.missing[0] + steady, self.missing[1]]
        found = []
        for row, (weights, one) in enumerate(
            zip(ripple_weights(self.block.shifts_rad), left, strict=True)
        ):
            placed = {k: float(w) for k, w in zip(self.frames, weights, strict=True)}
            seen = unit * one + _weighed(times @ weights, moves)
            name = (RIPPLES + SHAPES * self.name[0] + row, self.name[1])
            found.append(Evidence(placed, seen, variance, STEPS_SHARE * unit, name))
        return found


@dataclass(frozen=True)
class _Set:
    """A set of steps of a plan, in two cycles."""

    number: int
    first: int
    block: PhaseSteps
    cycle: int
    """Frames of a cycle."""
    noise: float
    """Variance of a sample, counts²."""

    def fit(self, frames: Planes, cycle: int, motion: Motion) -> _Fit:
        """Fit its frames of a cycle."""
        block = self.block
        part = range(self.first, self.first + block.frames)
        times = [cycle * self.cycle + k - (self.cycle - 0.5) for k in part]
        samples = [moved_back(frames[k], motion, t) for k, t in zip(part, times, strict=True)]
        there = motion.moved_px(block.axis, float(np.mean(times)))
        per_px = np.float32(TURN / block.period_px)
        turned: list[FloatMap] = [(motion.moved_px(block.axis, t) - there) * per_px for t in times]
        wave, missing, variances = missing_turns(samples, block, turned, self.noise)
        placed = range(cycle * self.cycle + self.first, cycle * self.cycle + part.stop)
        name = self.number, cycle
        return _Fit(wave, missing, variances, samples, turned, placed, block, name)

    def travelled(
        self,
        before: NDArray[np.complex64],
        after: NDArray[np.complex64],
        velocity_px: FloatMap,
        steady: FloatMap,
    ) -> Evidence:
        """Distance from one cycle to the next, by the mean turn of the phase of every block beside
        a known velocity. Its variance follows from the length of the mean of the turns."""
        unit, n = self.block.period_px / TURN, self.block.frames
        turns = np.nan_to_num(after * before.conj())
        turns *= np.exp(-1j * np.float32(self.cycle / unit) * velocity_px)
        size, square = np.abs(turns), np.abs(turns) ** 2
        count = np.asarray(size > 0, np.float32)
        parts = [_around(_sums(one)) for one in (turns.real, turns.imag, size, square, count)]
        total = np.maximum(parts[2], SMALLEST)
        length = np.clip(np.hypot(parts[0], parts[1]) / total, SMALLEST, 1.0)
        share = np.minimum(parts[3] / total**2, 1.0)
        scatter = -2.0 * np.log(length)
        by_noise = np.minimum(scatter, 4.0 / n * self.noise * parts[4] / total)
        scatter = share * (by_noise + BLOCK**2 * (scatter - by_noise))
        variance = unit**2 * (scatter + FRAME_ERROR_RAD**2)
        seen = self.cycle * steady + unit * np.arctan2(parts[1], parts[0])
        weights = {}
        for k in range(self.first, self.first + n):
            weights[k], weights[k + self.cycle] = -1.0 / n, 1.0 / n
        return Evidence(weights, seen, variance, name=(-1 - self.number, 0))


def missing_turns(
    samples: Sequence[FloatMap],
    block: PhaseSteps,
    turned_rad: Sequence[FloatMap],
    noise: float,
) -> tuple[NDArray[np.complex64], list[FloatMap], list[FloatMap]]:
    """Return the velocity and curvature that the residuals of a set show beyond the known motion.

    Parameters
    ----------
    samples : N (h, w) arrays, counts
    block : PhaseSteps
    turned_rad : N (h, w) arrays
        Angles by which the phase turns by the known motion, rad.
    noise : float > 0
        Variance of a sample, counts². Larger residuals, as paint in motion makes them, are alike at
        neighbouring pixels.

    Returns
    -------
    wave : (h, w) array
        Modulation and phase of the fit, c + i s, counts.
    missing, variances : two arrays of blocks each
        Of the terms of ``_shapes``, projector px, and their variances; empty for three steps, which
        leave no residuals.
    """
    unit = block.period_px / TURN
    shape = samples[0].shape
    turned = list(turned_rad)
    blocks = _grid(shape)
    missing = [np.zeros(blocks, np.float32) for _ in range(SHAPES)]
    for _ in range(PASSES):
        wave, more, variances = _regressed(samples, block, turned, noise)
        if not more:
            return wave, [], []
        missing = [known + unit * one for known, one in zip(missing, more, strict=True)]
        if max(np.median(m**2 / v) for m, v in zip(more, variances, strict=True)) < SURE**2:
            break
        steps = [whole(one, shape) for one in more]
        for k, times in enumerate(_shapes(block.frames).T):
            turned[k] = turned[k] + _weighed(times, steps)
    return wave, missing, [unit**2 * v for v in variances]


def _regressed(
    samples: Sequence[FloatMap],
    block: PhaseSteps,
    turned_rad: Sequence[FloatMap],
    noise: float,
) -> tuple[NDArray[np.complex64], list[FloatMap], list[FloatMap]]:
    """As ``missing_turns`` to first order, in rad."""
    n = block.frames
    background, c, s, square = fit_moving(samples, block.shifts_rad, turned_rad)
    wave = c + np.complex64(1j) * s
    if n < 4:
        return wave, [], []
    left, turning = [], []
    for sample, shift, angle in zip(samples, block.shifts_rad, turned_rad, strict=True):
        cosine, sine = np.cos(np.float32(shift) - angle), np.sin(np.float32(shift) - angle)
        left.append(sample - background - c * cosine - s * sine)
        turning.append(c * sine - s * cosine)
    patterns = [
        [_weighed(row * times, turning) for row in _residual_projector(block.shifts_rad)]
        for times in _shapes(n)
    ]
    first, second = patterns
    own = [_products(a, b) for a, b in ((first, first), (first, second), (second, second))]
    own += [_products(a, left) for a in patterns]
    sums = [_around(one) for one in own]
    slopes, inverse = _solved(sums)
    explained = slopes[0] * sums[3] + slopes[1] * sums[4]
    rest = np.maximum(_around(_sums(np.nan_to_num(square))) - explained, 0.0)
    seen = rest / ((BLOCK * AROUND) ** 2 * (n - 3)) + ROUNDING
    alike = np.minimum(seen, noise) + ALIKE_PX**2 * np.maximum(seen - noise, 0.0)
    variances = [
        np.maximum(alike * one, other) + FRAME_ERROR_RAD**2
        for one, other in zip((inverse[0], inverse[2]), _scatter(own, slopes, inverse), strict=True)
    ]
    return wave, slopes, variances


def _solved(sums: list[FloatMap]) -> tuple[list[FloatMap], list[FloatMap]]:
    """Solutions of the normal equations of two unknowns, and the inverse of their matrix."""
    first, both, second = sums[0] + SMALLEST, sums[1], sums[2] + SMALLEST
    determinant = np.maximum(first * second - both**2, SMALLEST * first * second)
    inverse: list[FloatMap] = [second / determinant, -both / determinant, first / determinant]
    one = inverse[0] * sums[3] + inverse[1] * sums[4]
    other = inverse[1] * sums[3] + inverse[2] * sums[4]
    return [one, other], inverse


def _scatter(
    own: list[FloatMap], slopes: list[FloatMap], inverse: list[FloatMap]
) -> tuple[FloatMap, FloatMap]:
    """Variances of the slopes by how the blocks differ that they come from: residuals of paint in
    motion are alike at neighbouring pixels (White, Econometrica 48, 1980)."""
    one = own[3] - own[0] * slopes[0] - own[1] * slopes[1]
    other = own[4] - own[1] * slopes[0] - own[2] * slopes[1]
    return (
        _around((inverse[0] * one + inverse[1] * other) ** 2),
        _around((inverse[1] * one + inverse[2] * other) ** 2),
    )


def _weighed(weights: NDArray[np.float64], maps: Sequence[FloatMap]) -> FloatMap:
    return np.asarray(sum(np.float32(w) * one for w, one in zip(weights, maps, strict=True)))


def _products(ones: Sequence[FloatMap], others: Sequence[FloatMap]) -> FloatMap:
    """Sums over the blocks of the products of maps."""
    products = sum(a * b for a, b in zip(ones, others, strict=True))
    return _sums(np.nan_to_num(np.asarray(products)))


def _shapes(frames: int) -> NDArray[np.float64]:
    """How a phase turns along the frames of a set for each unit of velocity and curvature."""
    times = np.arange(frames) - 0.5 * (frames - 1)
    return np.stack((times, times**2 - np.mean(times**2)))


@lru_cache(maxsize=64)
def turn_weights(shifts_rad: tuple[float, ...]) -> NDArray[np.float64]:
    """Weights of the places at the frames of a set in what its residuals show, (2, N).

    Three steps leave no residuals: these are the weights in the slope of a line and in a parabola.
    """
    shapes = _shapes(len(shifts_rad))
    if len(shifts_rad) < 4:
        return np.asarray(np.linalg.pinv(shapes.T))
    phases = TURN * np.arange(PHASES) / PHASES
    slopes = -np.sin(phases[:, None] - np.asarray(shifts_rad))
    seen = (slopes * shapes[:, None]) @ _residual_projector(shifts_rad)
    weights = np.mean(seen * slopes, axis=1)
    return np.asarray(np.linalg.solve(np.einsum("apn,bpn->ab", seen, seen) / PHASES, weights))


def _residual_projector(shifts_rad: tuple[float, ...]) -> NDArray[np.float64]:
    """What a fit of A, c and s leaves of N samples, (N, N)."""
    design = step_design(shifts_rad)
    return np.asarray(np.eye(len(design)) - design @ np.linalg.pinv(design))


def _blocks(values: FloatMap) -> FloatMap:
    """The pixels of each block along a last axis. What is left of the image at its end belongs to
    none: the repeated pixels of an edge, which motion may have left behind, would outweigh it."""
    rows, columns = _grid(values.shape)
    inside = _sized(values, (rows * BLOCK, columns * BLOCK))
    blocks = inside.reshape(rows, BLOCK, columns, BLOCK).swapaxes(1, 2)
    return np.asarray(blocks.reshape(rows, columns, -1))


def _grid(shape: tuple[int, ...]) -> tuple[int, int]:
    """Rows and columns of whole blocks, one at least."""
    return max(1, shape[0] // BLOCK), max(1, shape[1] // BLOCK)


def _sized(values: FloatMap, shape: tuple[int, int]) -> FloatMap:
    """A map that is cut, or goes on with its last rows and columns."""
    inside = values[: shape[0], : shape[1]]
    missing = ((0, shape[0] - inside.shape[0]), (0, shape[1] - inside.shape[1]))
    return np.pad(inside, missing, mode="edge") if np.any(missing) else inside


def lit_by(frames: Planes, plan: PatternPlan) -> FloatMap:
    """Weight of every pixel, 1 where the finest fringes have light and 0 elsewhere."""
    first, block = min(phase_sets(plan), key=lambda one: one[1].period_px)
    part = np.stack([frames[first + k] for k in range(block.frames)]).astype(np.float32)
    swing = np.nan_to_num(part.max(axis=0) - part.min(axis=0))
    return np.asarray(swing > LIT_SWING * np.percentile(swing, 95), np.float32)


def lit_medians(values: FloatMap, lit: FloatMap) -> FloatMap:
    """Median of the lit pixels of every block; blocks without them take those around."""
    mean = whole(_averages(values, lit), (values.shape[0], values.shape[1]))
    blocks = _blocks(np.where(lit > 0, values, mean))
    return np.asarray(cv2.medianBlur(np.median(blocks, axis=-1).astype(np.float32), 3))


def _averages(values: FloatMap, lit: FloatMap) -> FloatMap:
    """Mean of the lit pixels of every block and the blocks around it."""
    count = np.mean(_blocks(lit), axis=-1)
    total = np.mean(_blocks(values * lit), axis=-1)
    size = (AROUND, AROUND)
    while (near := cv2.blur(count, size, borderType=cv2.BORDER_REFLECT_101)).min() == 0.0:
        total = np.where(count > 0, total, cv2.blur(total, size))
        count = np.where(count > 0, count, cv2.blur(count, size))
        if not count.any():
            return np.zeros_like(count)
    return np.asarray(cv2.blur(total, size, borderType=cv2.BORDER_REFLECT_101) / near)


def _sums(values: FloatMap) -> FloatMap:
    return np.asarray(np.sum(_blocks(values), axis=-1), np.float32)


def _around(blocks: FloatMap) -> FloatMap:
    """Sums of blocks and those around them."""
    size = (AROUND, AROUND)
    mean = cv2.blur(blocks, size, borderType=cv2.BORDER_REFLECT_101)
    return np.asarray(mean * np.float32(AROUND**2))


def whole(blocks: FloatMap, shape: tuple[int, int]) -> FloatMap:
    """A map of the image from one of its blocks, linear between their middles."""
    rows, columns = blocks.shape
    size = (columns * BLOCK, rows * BLOCK)
    large = cv2.resize(blocks.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
    return _sized(np.asarray(large), shape)
