"""Where surfaces are at every frame: the path that all that is known of their motion determines.

The place of a surface along the projector is a random function of time. Its spectrum is not known:
straight motion, motion that changes within some frames, and vibrations of every frequency are
hypotheses, each weighed by its likelihood at each part of the image. What no observation
determines, such as a vibration that repeats with the cycles of the plan, stays in the path's
standard deviation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.order_chain import TURN
from fringeworks.stack.motion_evidence import Evidence
from fringeworks.types import BoolMap, FloatMap
from fringeworks.types.packages import cv2

SIZES_PX = (0.02, 0.06, 0.2, 0.6, 2.0, 6.0)
"""Standard deviations of the motion beside a straight one that are tried, projector px."""
STAYS_CYCLES = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Times after which the velocity is another one that are tried, cycles of the plan."""
SHORTEST_FRAMES = 1.1
"""Shortest period of a vibration that is tried, frames: faster ones are averaged out within an
exposure and the frames of a set."""
LONGEST_CYCLES = 8.0
"""Longest period of a vibration that is tried, cycles: slower ones are a changing velocity."""
COHERENCE_CYCLES = 8.0
"""Time over which a vibration keeps its phase, cycles: longer than the cycles that are kept."""
UNSURE = (1.0, 9.0)
"""Factors on the variance of the observations that are tried: their noise, and three times it."""
STEP_ERROR_RAD = 0.005
"""Standard deviation of the errors of phase steps, rad, 0.3°: the same in all cycles, they look
like a velocity."""
LEAST_WEIGHT = 1e-3
"""Largest probability over the image below which a hypothesis is left out."""
LEAST_SHARE = 1e-6
"""Probability at a block below which a hypothesis is left out there. All that are left out together
move the place at a block by less than 1e-4 of its motion beside a straight one."""
FACTORS = 8
"""Variances that are multiplied before a logarithm is taken: up to 1e30 each, none overflows."""
POOLED = 3
"""Blocks along each side whose mean logarithm of the likelihood weighs the hypotheses: neighbours
move alike, and so are no independent evidence."""
STRAIGHT = 0.9
"""Probability beforehand that nothing moves but straight on: with less, small vibrations that sets
of three steps cannot see would widen every σ."""
SEEN_CYCLES = 2.0
"""Shortest time in which motion may change that sets of three steps alone show, cycles: they leave
no residuals, and everything faster would look alike."""
UNSEEN = 1e-30
"""Probability beforehand of faster motion, where only such sets are there."""
LIKELY = 0.5
"""Probability of vibrations of any period from which on those that look alike count."""
ALIKE = 6.0
"""Difference of χ² up to which vibrations look alike: the 95 % quantile for two unknowns."""
ALIKE_MARGIN = 1.25
"""Factor on the distance of vibrations that look alike: the place may be at the farthest one, where
the noise of the coordinates must fit into two standard deviations as well."""
MOST_AVERAGED = 1.0
"""Largest standard deviation of a vibration by what an exposure averages out, over its size in the
frames: that of a period of 1.6 frames in exposures as long as a frame."""
LEAST_AVERAGED = 0.01
"""Smallest such share that counts: that of a period of 9 frames. Slower vibrations move as the
frames show."""
WITHIN = 0.95
"""Share of what the hypotheses say that two standard deviations contain."""
JITTER = 1e-9
"""Added to variances so that matrices stay positive, px²."""


@dataclass(frozen=True)
class Observed:
    """All observations along an axis, as a matrix over the frames from ``first`` on."""

    first: int
    """Index of the first frame of the sequence that they depend on."""
    weights: NDArray[np.float64]
    """(m, T): weights of the places at T frames in each of m observations."""
    seen: FloatMap
    """(m, rows, columns) of blocks."""
    variance: FloatMap
    """(m, rows, columns)."""
    steps: NDArray[np.float64]
    """(m, m): covariance by errors of phase steps."""


def observed(pairs: Sequence[tuple[int, Sequence[Evidence]]], frames: int) -> Observed:
    """Put the observations of successive pairs of cycles together.

    Parameters
    ----------
    pairs : (first frame, observations) of each pair
        A cycle belongs to two pairs: what the later one saw of it counts.
    frames : int
        Of a cycle.
    """
    first = pairs[0][0]
    kept: dict[tuple[int, int], tuple[int, Evidence]] = {}
    for start, evidence in pairs:
        for one in evidence:
            kept[one.name[0], start // frames + one.name[1]] = start, one
    total = pairs[-1][0] - first + 2 * frames
    weights = np.zeros((len(kept), total))
    for row, (start, one) in enumerate(kept.values()):
        for frame, weight in one.weights.items():
            weights[row, start - first + frame] += weight
    kinds = np.array([kind for kind, _ in kept])
    by_steps = STEP_ERROR_RAD * np.array([one.unit_px for _, one in kept.values()])
    shared = np.where(kinds[:, None] == kinds, np.outer(by_steps, by_steps), 0.0)
    return Observed(
        first,
        weights,
        np.stack([one.seen for _, one in kept.values()]),
        np.stack([one.variance for _, one in kept.values()]),
        shared,
    )


@dataclass(frozen=True)
class _Kind:
    """How motion beside a straight one changes with time."""

    size_px: float
    """Its standard deviation, projector px."""
    period: float = 0.0
    """Period of a vibration, frames; 0 for none."""
    stays: float = 0.0
    """Time after which the velocity is another one, frames; 0 for a vibration."""

    @property
    def averaged(self) -> float:
        """Standard deviation by what an exposure of unknown length averages out of a vibration,
        over its size in the frames: half of what an exposure as long as a frame does."""
        if not self.period:
            return 0.0
        left = abs(float(np.sinc(1.0 / self.period)))
        return min(0.5 * (1.0 / max(left, JITTER) - 1.0), MOST_AVERAGED)

    def kernel(self, apart: NDArray[np.float64], cycle: int) -> NDArray[np.float64]:
        """Correlation of places at distances in time, frames."""
        if not self.size_px:
            return np.zeros_like(apart)
        if self.period:
            fade = np.exp(-0.5 * (apart / (COHERENCE_CYCLES * cycle)) ** 2)
            return np.asarray(np.cos(TURN * apart / self.period) * fade)
        scaled = 3.0**0.5 * np.abs(apart) / self.stays
        return np.asarray((1.0 + scaled) * np.exp(-scaled))


@lru_cache(maxsize=16)
def _kinds(cycle: int) -> tuple[tuple[_Kind, ...], NDArray[np.float64]]:
    """The hypotheses for cycles of some frames, and their probabilities beforehand.

    Motion is the likelier the slower, as the square of the period of a vibration, or of the time
    that a velocity stays: of vibrations that look alike in the frames, the slow ones move farthest,
    and matter most.
    """
    lines = int(LONGEST_CYCLES * cycle / SHORTEST_FRAMES)
    periods = [LONGEST_CYCLES * cycle / k for k in range(1, lines + 1)]
    bent = [_Kind(size, stays=cycle * stays) for stays in STAYS_CYCLES for size in SIZES_PX]
    vibrating = [_Kind(size, period) for period in periods for size in SIZES_PX]
    share = np.square([kind.period for kind in vibrating])
    rest = 0.5 * (1.0 - STRAIGHT)
    steady = np.square([kind.stays for kind in bent])
    before = [[STRAIGHT], rest * steady / steady.sum(), rest * share / share.sum()]
    return (_Kind(0.0), *bent, *vibrating), np.concatenate(before)


@dataclass(frozen=True)
class _Hypothesis:
    """One kind of motion, and what the observations make of it."""

    kind: _Kind
    weight: FloatMap
    """(blocks,): its probability."""
    alike: BoolMap
    """(blocks,): whether the frames look as with a vibration of its period."""
    at: NDArray[np.intp]
    """(n,): the blocks where it matters."""
    solved: FloatMap
    """(m, n): inverse covariance of the observations times the observations."""
    basis: NDArray[np.float64]
    """(m, m): eigenvectors of the covariance over the noise's."""
    spread: FloatMap
    """(m, n): eigenvalues of the inverse covariance."""


class MotionPath:
    """The path of surfaces along one axis, at every block.

    Parameters
    ----------
    found : Observed
    frames : int
        Of a cycle of the plan.
    fastest_px : float
        Standard deviation of a straight motion, projector px per frame.
    """

    def __init__(self, found: Observed, frames: int, fastest_px: float) -> None:
        self._found, self._cycle, self._fastest = found, frames, fastest_px
        self._times = found.first + np.arange(found.weights.shape[1], dtype=float)
        self._middle = float(self._times.mean())
        self._shape = (found.seen.shape[1], found.seen.shape[2])
        self._seen = found.seen.reshape(len(found.seen), -1).astype(np.float64)
        variance = found.variance.reshape(len(found.seen), -1)
        self._usual = np.median(variance, axis=1) + JITTER
        self._noisy = np.median(variance / self._usual[:, None], axis=0)
        self._kept = self._weighed()
        blocks = self._seen.shape[1]
        self._slots: list[NDArray[np.intp]] = []
        """Place of each hypothesis among those of each block where it matters."""
        used = np.zeros(blocks, np.intp)
        for one in self._kept:
            self._slots.append(used[one.at].copy())
            used[one.at] += 1
        self._weight = np.zeros((blocks, used.max()))
        """Probabilities of the hypotheses of each block; their sum is 1."""
        self._alike = np.zeros(self._weight.shape, bool)
        for one, slot in zip(self._kept, self._slots, strict=True):
            self._weight[one.at, slot] = one.weight[one.at]
            self._alike[one.at, slot] = one.alike[one.at]
        self._weight /= self._weight.sum(axis=1, keepdims=True)

    def _straight(
        self, one: NDArray[np.float64], other: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Covariance of the places at times by a straight motion."""
        return np.asarray(self._fastest**2 * np.outer(one - self._middle, other - self._middle))

    def _weighed(self) -> list[_Hypothesis]:
        """The hypotheses that matter, with their probabilities."""
        kinds, before = _kinds(self._cycle)
        if not self._found.steps.any():
            slowest = SEEN_CYCLES * self._cycle
            fast = [kind.size_px > 0 and kind.period + kind.stays < slowest for kind in kinds]
            before = np.where(fast, UNSEEN, before)
        found = [self._likelihoods(kind) for kind in kinds]
        logs = np.stack([self._pooled(log) for one in found for log, _ in one])
        misfits = np.stack([self._pooled(misfit) for one in found for _, misfit in one])
        chance = logs + np.repeat(np.log(before), len(UNSURE))[:, None]
        chance = np.exp(chance - chance.max(axis=0))
        chance /= chance.sum(axis=0)
        vibrating = np.repeat([kind.period > 0.0 for kind in kinds], len(UNSURE))
        alike = _alike(kinds, logs, misfits) & (chance[vibrating].sum(axis=0) > LIKELY)
        # Sets of three steps see no motion of their own: with them alone, everything looks alike.
        alike &= bool(self._found.steps.any())
        matter = (chance.max(axis=1) >= LEAST_WEIGHT) | alike.any(axis=1)
        return [
            self._hypothesis(kinds[k // len(UNSURE)], UNSURE[k % len(UNSURE)], chance[k], alike[k])
            for k in np.flatnonzero(matter)
        ]

    def _eigen(self, kind: _Kind) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Eigenvalues and eigenvectors of the observations' covariance over that of their noise."""
        weights, scale, times = self._found.weights, self._usual**-0.5, self._times
        kernel = kind.kernel(times[:, None] - times[None, :], self._cycle)
        places = self._straight(times, times) + kind.size_px**2 * kernel
        total = weights @ places @ weights.T + self._found.steps
        values, vectors = np.linalg.eigh(scale[:, None] * total * scale)
        return np.maximum(values, 0.0), scale[:, None] * vectors

    def _likelihoods(self, kind: _Kind) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Logarithm of the likelihood and χ² of each block, for every factor on the noise."""
        values, basis = self._eigen(kind)
        square = (basis.T @ self._seen) ** 2
        found = []
        for unsure in UNSURE:
            spread = values[:, None] + unsure * self._noisy
            misfit = np.sum(square / spread, axis=0)
            # Logarithms take longer than everything else: one of each product is enough.
            starts = np.arange(0, len(values), FACTORS)
            products = np.multiply.reduceat(spread, starts, axis=0)
            found.append((-0.5 * (misfit + np.sum(np.log(products), axis=0)), misfit))
        return found

    def _pooled(self, log: NDArray[np.float64]) -> NDArray[np.float64]:
        """The mean of every block and those around it."""
        size = (POOLED, POOLED)
        mean = cv2.blur(log.reshape(self._shape), size, borderType=cv2.BORDER_REFLECT_101)
        return np.asarray(mean.ravel())

    def _hypothesis(
        self, kind: _Kind, unsure: float, weight: NDArray[np.float64], alike: BoolMap
    ) -> _Hypothesis:
        values, basis = self._eigen(kind)
        at = np.flatnonzero((weight > LEAST_SHARE) | alike)
        spread = 1.0 / (values[:, None] + unsure * self._noisy[at])
        solved = basis @ (spread * (basis.T @ self._seen[:, at]))
        return _Hypothesis(kind, weight, alike, at, solved, basis, spread)

    def of(
        self, rows: NDArray[np.float64], times: NDArray[np.float64], unsure: int
    ) -> tuple[FloatMap, FloatMap]:
        """Return sums of places, (q, rows, columns) of blocks, and the last ones' deviations.

        Parameters
        ----------
        rows : (q, t) array
            Weights of the places at each of the times; the sum of each row is zero.
        times : (t,) array, frames
        unsure : int
            Number of the last rows whose standard deviations are asked for.

        Notes
        -----
        Two standard deviations contain 95 % of what the hypotheses together say, and every
        vibration that looks alike in the frames: how likely one of them is depends on what was
        assumed beforehand. A vibration is smaller in the frames than at a moment, by what their
        exposure averages out. How long that is, is not known; this is contained as well.
        """
        mean = np.zeros((len(rows), self._seen.shape[1]))
        places, variances = np.zeros((2, unsure, *self._weight.shape))
        averaged = np.zeros((unsure, self._seen.shape[1]))
        sums = self._covariances(rows, times)
        for one, slot in zip(self._kept, self._slots, strict=True):
            if not one.at.size:
                continue
            to_seen, bent, own = sums(one.kind)
            weight = self._weight[one.at, slot]
            place = to_seen @ one.solved
            mean[:, one.at] += weight * place
            told = (to_seen[-unsure:] @ one.basis) ** 2 @ one.spread
            places[:, one.at, slot] = place[-unsure:]
            variances[:, one.at, slot] = np.maximum(own[-unsure:, None] - told, 0.0)
            if one.kind.averaged >= LEAST_AVERAGED:
                # What exposures average out of a vibration.
                less = one.kind.averaged * (bent[-unsure:] @ one.solved)
                averaged[:, one.at] += weight * less**2
        sigma = self._deviations(places - mean[-unsure:, :, None], variances)
        sigma = np.sqrt(sigma**2 + averaged)
        return mean.reshape(-1, *self._shape), sigma.reshape(-1, *self._shape)

    def _covariances(
        self, rows: NDArray[np.float64], times: NDArray[np.float64]
    ) -> Callable[[_Kind], tuple[NDArray[np.float64], ...]]:
        """Covariances of sums of places with the observations, the part of them that is not by a
        straight motion, and the variances of the sums, for each kind of motion."""
        every = np.concatenate((self._times, times))
        count, apart = len(self._times), times[:, None] - every

        def parts(covariance: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
            summed = rows @ covariance
            return summed[:, :count] @ self._found.weights.T, np.sum(summed[:, count:] * rows, 1)

        straight, own = parts(self._straight(times, every))
        courses: dict[tuple[float, float], tuple[NDArray[np.float64], ...]] = {}

        def of(kind: _Kind) -> tuple[NDArray[np.float64], ...]:
            course = kind.period, kind.stays
            if course not in courses:
                courses[course] = parts(kind.kernel(apart, self._cycle))
            bent, more = (kind.size_px**2 * part for part in courses[course])
            return straight + bent, bent, own + more

        return of

    def _deviations(
        self, off: NDArray[np.float64], variance: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Standard deviations of places, from each hypothesis's distance to their mean and
        variance, (q, blocks, hypotheses)."""
        square = variance + off**2
        second = np.sum(self._weight * square, axis=-1)
        far = _quantile(np.sqrt(square), self._weight)
        if self._alike.any():
            reach = ALIKE_MARGIN * np.abs(off) + 2.0 * np.sqrt(variance)
            far = np.maximum(far, np.max(np.where(self._alike, reach, 0.0), axis=-1))
        return np.asarray(np.maximum(np.sqrt(second), 0.5 * far))

    @property
    def vibrations(self) -> dict[float, FloatMap]:
        """Probability of a vibration of each period, frames, (rows, columns) of blocks."""
        found: dict[float, FloatMap] = {}
        for one in self._kept:
            if one.kind.period:
                weight = one.weight.reshape(self._shape)
                found[one.kind.period] = found.get(one.kind.period, 0.0) + weight
        return found


def _alike(
    kinds: Sequence[_Kind], logs: NDArray[np.float64], misfits: NDArray[np.float64]
) -> BoolMap:
    """Mark the likeliest vibration of every period where it fits as well as the best one.

    Fits are compared at the noise of the likeliest vibration: with more noise, everything fits.
    """
    periods = np.array([kind.period for kind in kinds])
    shape = (len(kinds), len(UNSURE), logs.shape[1])
    marked, best = np.zeros(shape, bool), np.full(shape[1:], np.inf)
    likeliest = np.full(shape[1:], -np.inf)
    log, misfit = logs.reshape(shape), misfits.reshape(shape)
    places = np.ogrid[: shape[1], : shape[2]]
    for period in np.unique(periods[periods > 0.0]):
        rows = np.flatnonzero(periods == period)
        chosen = rows[np.argmax(log[rows], axis=0)]
        marked[chosen, *places] = True
        best = np.minimum(best, misfit[chosen, *places])
        likeliest = np.maximum(likeliest, log[chosen, *places])
    marked &= misfit - best < ALIKE
    marked &= likeliest == likeliest.max(axis=0)
    return marked.reshape(logs.shape)


def _quantile(far: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance within which ``WITHIN`` of the weight along the last axis is."""
    order = np.argsort(far, axis=-1)
    own = np.broadcast_to(weight, far.shape)
    sums = np.cumsum(np.take_along_axis(own, order, axis=-1), axis=-1)
    place = np.argmax(sums >= WITHIN, axis=-1)[..., None]
    nearest = np.take_along_axis(order, place, axis=-1)
    return np.asarray(np.take_along_axis(far, nearest, axis=-1)[..., 0])
