"""How well the lines of a sample agree with an order of its frames: one cost per pixel."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product
from operator import is_
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.order_chain import TURN
from fringeworks.stack.bit_states import change_of, cost_of_states, folded, rough_bit
from fringeworks.stack.decoded_sample import decode_sample
from fringeworks.stack.fits import SampleFit, fit_matrices, fit_samples, times
from fringeworks.stack.hypothesis import Hypothesis, moved_back
from fringeworks.stack.kernel_settings import Decoding, Limits, PhaseFrames
from fringeworks.stack.line_profile import sharpest
from fringeworks.stack.noise import MIN_JUDGED_PIXELS
from fringeworks.stack.sample import Lines
from fringeworks.stack.set_residuals import phase_variance
from fringeworks.statistics.quantiles import quantile
from fringeworks.types import BoolMap, CameraNoise, FloatMap
from fringeworks.types.computed import cached_property

LIT = 0.3
"""Smallest range of the samples of a pixel that votes, as a share of the 95th percentile. Indirect
light in shadows makes less."""

FINE_SHARE = 0.05
"""Bend of the coordinate between neighbours that begins to cost, in shortest periods: the noise of
phases at a modulation of ten standard deviations."""

SETS_APART = 0.02
"""Disagreement of the sets that begins to cost, turns: that of a response that is not corrected."""

UNRELATED_PHASES = 1.0 / 12.0
"""Variance of unrelated phases, turns²: they are uniform over one turn."""

SIGMAS = 2.5
"""The same in standard deviations of a coordinate: the bend has √6 of them."""

JUMP_SHARE = 0.5
"""Bend that costs as much as a pixel without a coordinate, in shortest periods: smaller errors are
none of the fringe order."""

JUMP_CELLS = 4.0
"""The same for a Gray code without fringes, in cells."""

CELL_BEND = 1.0
"""Bend between neighbours that costs nothing, in cells of a code without fringes: whole cells of an
even slope make it wherever a cell ends, so that it says nothing of an order."""

RELATIVE_RESIDUAL = 1e-3
"""Variance of a residual that begins to cost, over B², besides the noise: steps that are wrong by
2°."""

NOISE_RESIDUAL = 4.0
"""Variance of a residual that begins to cost, over that of the noise: two standard deviations."""

FEWEST_BRIGHT = 2
"""Fewest other bright frames of a pixel that the light of one is compared with."""

UNEXPLAINED = 1.0
"""Cost of a frame of the stack that an order has no use for and that shows light: that of a pixel
without a coordinate."""

DARK = 0.2
"""Largest share of the range of a pixel that a dark frame shows, and by which the frames of a
blurred set differ."""

CONTRAST = 0.3
"""Smallest contrast of a frame with a pattern, as a share of the range."""

NOISY = 0.1
"""Mean difference that noise makes, as a share of the range, from which on nothing is said of equal
frames."""

SAME = 0.01
"""Largest mean difference of two frames that show the same pattern, as a share of the range: those
that repeat differ by 0.002, and by 0.012 to 0.021 where the scene happened to move back by a step
of the fringes."""

JUMPS = 0.02
"""Share of known triples with a jump from which on other orders are tried. Depth edges of a bust
make 0.013, and the fault that is hardest to see 0.03."""

ROUGH = 0.25
"""Mean cost, or share of coordinates that their cell refuses, from which on other orders are tried:
0.05 to 0.3 in order, 0.2 and more otherwise."""

FEW = 0.05
"""Share of the triples below which coordinates are too few to show that the plan is right."""

UNRELATED_ASTRAY = 0.3
"""Share of coordinates that their cell refuses, from which on they are unrelated;
four in ten do where they are in no relation."""

UNRELATED_JUMPS = 0.1
"""Share of jumps from which on coordinates contradict each other; depth edges make 0.02."""

UNRELATED_SETS = 0.9
"""Disagreement of the sets, over that of the sets of different pixels, above which they are in
no relation: another plan has 0.98, a response of 2.2 that is not corrected up to 0.75."""

LEAST_APART = 0.1
"""Smallest mean cost of the disagreement for that statement, and from which on other orders are
tried: another plan has 0.28, a set that starts elsewhere 0.15, noise 0.01."""

ASTRAY = 0.2
"""Cost of a coordinate that its Gray-code cell refuses: six in ten lie inside by chance, and
-ln 0.6 is 0.5, over 2.4."""

ASTRAY_BY_CHANCE = 0.4
"""Share of coordinates that their cell refuses where they are in no relation. From there on, as
where a response bends the phases by more than a cell, a single refusal says nothing."""


def _finite(counts: NDArray[Any]) -> FloatMap:
    """Counts in single precision, 0 where they are not finite."""
    if counts.dtype.kind == "u":
        return counts.astype(np.float32)
    return np.nan_to_num(counts.astype(np.float32), nan=0.0, posinf=0.0, neginf=0.0)


def _log1p(ratio: FloatMap) -> FloatMap:
    """ln(1 + ratio) to 1e-7, for ratios ≥ 0, in single precision."""
    return np.asarray(np.log((1.0 + ratio).astype(np.float32, copy=False)))


def _three(pixels: BoolMap) -> BoolMap:
    """Pixels of lines that are marked like both of their neighbours, (r, l − 2)."""
    return np.asarray(pixels[:, 2:] & pixels[:, 1:-1] & pixels[:, :-2])


def _jumps(bends: FloatMap) -> bool:
    """Whether more of the known bends are jumps than depth edges make."""
    return bool(np.count_nonzero(bends >= 1.0) > JUMPS * bends.size)


@dataclass(frozen=True)
class LineEvidence:
    """The lines of one axis, and what an order of the frames costs there."""

    decoding: Decoding
    lines: Lines
    noise: CameraNoise
    limits: Limits
    down: bool = False
    """Whether the lines are columns of the image."""
    _seen: dict[int, bool] = field(default_factory=dict)
    _kept: dict[PhaseFrames, FloatMap] = field(default_factory=dict)
    _planned_cost: list[tuple[FloatMap, dict[str, Any]]] = field(default_factory=list, init=False)

    @cached_property
    def low(self) -> FloatMap:
        """Darkest sample of every pixel, counts."""
        return _finite(np.minimum.reduce(self.lines))

    @cached_property
    def high(self) -> FloatMap:
        """Brightest sample of every pixel, counts."""
        return _finite(np.maximum.reduce(self.lines))

    @cached_property
    def voters(self) -> BoolMap:
        """(r, l) array: pixels that the projector lights and that are not saturated."""
        spread = self.high - self.low
        voters = spread > LIT * quantile(spread.ravel(), 0.95)
        unsaturated = self.high < self.limits.saturation
        if self.limits.given or np.count_nonzero(voters & unsaturated) >= MIN_JUDGED_PIXELS:
            # Saturated pixels say nothing of the light that unsaturated ones need.
            voters = unsaturated & (spread > LIT * quantile(spread[unsaturated], 0.95))
        if self.lines[0].dtype.kind == "f":
            voters = voters & np.logical_and.reduce([np.isfinite(line) for line in self.lines])
        return np.asarray(voters)

    @cached_property
    def triples(self) -> BoolMap:
        """(r, l − 2) array: pixels that vote, like both of their neighbours; all that are lit where
        most are saturated and fit the plan: indirect light may show others another pattern."""
        votes, lit = _three(self.voters), self._lit
        few = 2 * np.count_nonzero(votes & lit) < np.count_nonzero(lit)
        return lit if few and not self._rough(lit) else votes

    @property
    def _lit(self) -> BoolMap:
        """(r, l − 2) array: pixels that the projector lights, like both of their neighbours."""
        spread = self.high - self.low
        return _three(spread > LIT * quantile(spread.ravel(), 0.95))

    @property
    def disagreement(self) -> float:
        """Mean cost of the frames as planned at all lit pixels."""
        return float(np.mean(self._cost(self.decoding, [self._planned])[0][self._lit]))

    def uniform(self, frame: int) -> bool:
        """Whether a frame is as dark, or as bright, as any all over the lines."""
        shares = self.shares(frame)
        return quantile(shares, 0.95) < DARK or quantile(shares, 0.05) > 1.0 - DARK

    def shows_pattern(self, frame: int) -> bool:
        """Whether a frame has contrast along the lines."""
        shares = self.shares(frame)
        return quantile(shares, 0.95) - quantile(shares, 0.05) > CONTRAST

    def exposure(self, frame: int, others: tuple[int, ...]) -> float:
        """Light of a frame over that of others, where all of these are bright; NaN where no pixels
        show it."""
        middle = 0.5 * (self.low + self.high)
        lines = np.stack([_finite(self.lines[k]) for k in others])
        bright = np.where(lines > middle, lines, np.nan)
        seen = self.voters & (_finite(self.lines[frame]) > middle)
        seen &= np.count_nonzero(lines > middle, axis=0) >= FEWEST_BRIGHT
        if np.count_nonzero(seen) < MIN_JUDGED_PIXELS:
            return float("nan")
        usual = np.nanmedian(bright[:, seen], axis=0)
        return quantile(_finite(self.lines[frame])[seen] / usual, 0.5)

    def flat(self, phases: PhaseFrames) -> bool:
        """Whether the frames of a set hardly differ, though no cosine is dark or bright everywhere:
        their fringes are blurred."""
        lines = [_finite(self.lines[k])[self.voters] for k in phases.frames]
        swing = np.maximum.reduce(lines) - np.minimum.reduce(lines)
        if quantile(swing / (self.high - self.low)[self.voters], 0.5) > DARK:
            return False
        return phases.line_px is not None or not any(self.uniform(k) for k in phases.frames)

    @property
    def across(self) -> bool:
        """Whether patterns change the other way than in a camera that stands upright."""
        return self.down == (self.decoding.axis == "x")

    def difference(self, frame: int, other: int) -> float:
        """Mean difference of two frames beyond noise, over the range of the pixels; infinite where
        noise hides it."""
        v = self.voters
        a, b, spread = self.lines[frame][v], self.lines[other][v], (self.high - self.low)[v]
        apart = float(np.mean(np.abs(a.astype(np.float32) - b)))
        variance = float(np.mean(self.noise.variance(self.low[v] + 0.5 * spread)))
        noise, usual = 2.0 * (variance / np.pi) ** 0.5, float(np.mean(spread))
        return (apart - noise) / usual if noise < NOISY * usual else float("inf")

    def shares(self, frame: int) -> FloatMap:
        """Samples of the voters, from the darkest to the brightest of their pixel, 0…1."""
        low, high, v = self.low, self.high, self.voters
        return np.asarray(((self.lines[frame] - low) / np.maximum(high - low, 1e-12))[v])

    def suspicious(self) -> bool:
        """Whether another order can be much better than the plan's: where frames are in order, the
        coordinate is known and smooth nearly everywhere, also where a bit of the code changes."""
        votes = self.triples
        return bool(np.count_nonzero(votes) >= MIN_JUDGED_PIXELS) and self._rough(votes)

    def _rough(self, votes: BoolMap) -> bool:
        """Whether coordinates of frames as planned contradict each other at some triples."""
        cost, maps = self._cost(self.decoding, [self._planned])
        known, bend = _three(np.isfinite(maps["coordinate"])) & votes, self._bend(maps)
        seen = np.where(self.voters, maps["coordinate"], np.nan)
        if _jumps(bend[known]) or (not self.decoding.sets and folded(seen, self.decoding)):
            return True
        if "apart" in maps and float(np.mean(maps["apart"][votes])) > LEAST_APART:
            return True
        rough = [float(np.mean(part[votes])) for part in (cost, maps.get("astray", cost))]
        if max(rough) > ROUGH:
            return True
        sets, gray = self.decoding.sets, self.decoding.gray
        if gray is None or gray.levels > 2:
            return False
        periods = [JUMP_SHARE * phases.period_px for phases in sets]
        jump_px = min(periods, default=JUMP_CELLS * gray.step_px)
        return rough_bit(gray, maps["coordinate"], (bend, known), self.voters, jump_px)

    @property
    def jumps(self) -> bool:
        """Whether coordinates of frames as planned jump at more places than depth edges make."""
        _, maps = self._cost(self.decoding, [self._planned])
        return _jumps(self._bend(maps)[self._known(maps)])

    @property
    def rough(self) -> bool:
        """Whether the coordinates of frames as planned are unknown or not smooth in much of the
        view. Residuals say nothing of it: a response that is not linear makes them everywhere."""
        _, maps = self._cost(self.decoding, [self._planned])
        return float(np.mean(self._bend(maps)[self.triples])) > ROUGH

    @property
    def unrelated(self) -> str:
        """What contradicts all over the lines when frames are taken as planned; empty where the
        coordinates of most pixels that have one are smooth."""
        _, maps = self._cost(self.decoding, [self._planned])
        known = self._known(maps)
        if np.count_nonzero(known) < FEW * np.count_nonzero(self.triples):
            return ""
        jumps = float(np.mean(self._bend(maps)[known] >= 1.0))
        sets = len(self.decoding.sets)
        jumpy = self.decoding.gray is None and sets > 1 and jumps > JUMPS
        if jumpy and self._sets_unrelated(maps):
            return "fringe orders contradict each other all over the image"
        if "astray" in maps:
            astray = float(np.mean(maps["astray"][known])) - self._astray_by_noise(maps, known)
            if astray > UNRELATED_ASTRAY and jumps > UNRELATED_JUMPS:
                return "phases and Gray code are apart, like unrelated ones"
        return ""

    def _astray_by_noise(self, maps: dict[str, Any], known: BoolMap) -> float:
        """Share of the coordinates that their cell refuses because noise might take them over its
        end: of cells of a whole period, a part at both ends."""
        gray = self.decoding.gray
        assert gray is not None
        place = {frame: k for k, frame in enumerate(self.decoding.frames)}
        code = gray.kernel(place, self.decoding.longest_px, self.decoding.reach_px)
        sigma = quantile(maps["sigma"][:, 1:-1][known], 0.5)
        end = code["step"] + code["guard"] + code["confidence"] * sigma - self.decoding.longest_px
        return float(np.clip(2.0 * end / code["step"], 0.0, 1.0))

    def _sets_unrelated(self, maps: dict[str, Any]) -> bool:
        """Whether sets disagree like those of different pixels."""
        rng = np.random.default_rng(0)
        shuffled = {}
        for phases in self.decoding.sets:
            order = rng.permutation(self.low.size)
            for k in phases.frames:
                shuffled[k] = self.lines[k].reshape(-1)[order].reshape(self.low.shape)
        planes = [
            np.ascontiguousarray(shuffled.get(k, self.lines[k])) for k in self.decoding.frames
        ]
        others = decode_sample(self.decoding.free, planes, self.noise, self.limits.open)
        present = float(np.mean(maps["apart"][self.triples]))
        unrelated = float(np.mean(self._apart(self.decoding, others)))
        return present > max(UNRELATED_SETS * unrelated, LEAST_APART)

    @cached_property
    def _planned(self) -> list[NDArray[Any]]:
        return [self.lines[k] for k in self.decoding.frames]

    def _known(self, maps: dict[str, Any]) -> BoolMap:
        """Triples of voters with a coordinate, (r, l − 2)."""
        return self.triples & _three(np.isfinite(maps["coordinate"]))

    def cost(self, order: Hypothesis, decoding: Decoding | None = None) -> FloatMap | None:
        """Cost of an order at every triple of voters, (n,); None where it cannot be decoded.
        ``decoding`` is that of its patterns, where they are others than the plan's.

        Notes
        -----
        The cost is the negative logarithm of a heavy-tailed likelihood of the bend of the
        coordinate between three neighbours, and of the residuals of every set of steps, each
        over that of unrelated frames: 0 for perfect agreement, 1 for none.
        """
        decoding = decoding or self.decoding
        options = self._planes(order, decoding)
        if options is None:
            return None
        cost, maps = self._cost(decoding, options, change_of(order, decoding))
        if len(options) > 1 and order.lacks_one and decoding is self.decoding:
            # A bit without its noise costs less as well: only its other state speaks for a fault.
            planned, _ = self._cost(self.decoding, [self._planned])
            cost = planned - maps["gain"]
        return cost[self.triples] + UNEXPLAINED * self._unexplained(order)

    def coordinate(self, order: Hypothesis) -> FloatMap | None:
        """Coordinates by an order of the frames, (r, l), px; None where it cannot be decoded."""
        options = self._planes(order, self.decoding)
        return None if options is None else self._cost(self.decoding, options)[1]["coordinate"]

    def _cost(
        self, decoding: Decoding, options: list[list[NDArray[Any]]], change: float = 0.0
    ) -> tuple[FloatMap, dict[str, Any]]:
        """Cost of every triple, (r, l − 2), and the maps of the first option.

        Coordinates may be at any distance from their cell, so that contradictions show as bends;
        those that their cell refuses cost a little. Most orders change one axis only: the cost of
        the plan's order is kept for the other.
        """
        (first, *others), planned = options, self._planned
        if decoding is not self.decoding or others or not all(map(is_, first, planned)):
            return self._cost_of(decoding, options, change)
        # No cached_property: its lock is held while it computes, and a fork would inherit it.
        if not self._planned_cost:
            self._planned_cost.append(self._cost_of(decoding, options, 0.0))
        return self._planned_cost[0]

    def _cost_of(
        self, decoding: Decoding, options: list[list[NDArray[Any]]], change: float
    ) -> tuple[FloatMap, dict[str, Any]]:
        open_limits = self.limits.open
        maps = [decode_sample(decoding.free, p, self.noise, open_limits) for p in options]
        states = self._bends(decoding, maps)
        if decoding.gray is not None and decoding.sets:
            bound = [decode_sample(decoding, p, self.noise, open_limits) for p in options]
            for k, (found, free) in enumerate(zip(bound, maps, strict=True)):
                astray = np.isnan(found["coordinate"]) & np.isfinite(free["coordinate"])
                free["astray"] = astray[:, 1:-1]
                states[:, k] += ASTRAY * self._refused(free)
        cost = states[0, 0, 0]
        if len(states) > 1:
            changing = cost_of_states(np.where(self.triples, states, 0.0), change)
            maps[0]["gain"], cost = self._constant(states) - changing, changing
        if len(decoding.sets) > 1:
            maps[0]["apart"] = self._apart(decoding, maps[0])
            cost = cost + maps[0]["apart"]
        start = 0
        for phases in decoding.sets:
            planes = options[0][start : start + len(phases.frames)]
            start += len(phases.frames)
            if len(planes) > 3:
                cost = cost + self._residual(phases, planes)
        return cost, maps[0]

    def _refused(self, maps: dict[str, Any]) -> FloatMap:
        """1 where a cell refuses its coordinate, (r, l − 2); their share everywhere, at most that
        by chance, where single ones say nothing."""
        known = _three(self.voters & np.isfinite(maps["coordinate"]))
        share = float(np.mean(maps["astray"][known])) if known.any() else 0.0
        if share < ASTRAY_BY_CHANCE:
            return np.asarray(maps["astray"], float)
        return np.full(maps["astray"].shape, ASTRAY_BY_CHANCE)

    def _unexplained(self, order: Hypothesis) -> int:
        """Frames of the stack that an order has no use for, unless they show no pattern or that of
        another frame."""
        unused = set(range(len(self.lines))) - set(order.places)
        return sum(not self._explained(k) for k in unused)

    def _explained(self, frame: int) -> bool:
        if frame not in self._seen:
            others = (k for k in range(len(self.lines)) if k != frame)
            self._seen[frame] = self.uniform(frame) or any(
                self.difference(frame, k) < SAME for k in others
            )
        return self._seen[frame]

    def _bend(self, maps: dict[str, Any]) -> FloatMap:
        """Cost of the second difference along the lines, (r, l − 2)."""
        return np.asarray(self._bends(self.decoding, [maps])[0, 0, 0])

    def _constant(self, states: FloatMap) -> FloatMap:
        """Cost of every triple by the likelier state of a bit, the same along all lines."""
        every = [states[k, k, k] for k in range(len(states))]
        return np.asarray(min(every, key=lambda cost: float(np.sum(cost[self.triples]))))

    def _bends(self, decoding: Decoding, options: list[dict[str, Any]]) -> FloatMap:
        """Cost of the second difference along the lines, by the options of the three neighbours,
        (n, n, n, r, l − 2)."""
        fine: Any
        if decoding.sets:
            finest = min(decoding.sets, key=lambda s: s.period_px)
            period, even = finest.period_px, 0.0
            ripple = SIGMAS * period / TURN * sharpest(finest)[0]
            sigma = options[0]["sigma"][:, 1:-1]
            fine, jump = FINE_SHARE * period + ripple, JUMP_SHARE * period
            fine = fine + SIGMAS * np.where(np.isfinite(sigma), sigma, 0.0)
        else:
            assert decoding.gray is not None
            fine = decoding.gray.step_px
            even, jump = CELL_BEND * fine, (JUMP_CELLS - CELL_BEND) * fine
        maps = [found["coordinate"] for found in options]
        costs = np.empty((len(maps),) * 3 + maps[0][:, 1:-1].shape)
        for i, j, k in product(range(len(maps)), repeat=3):
            bend = maps[i][:, :-2] + maps[k][:, 2:] - 2.0 * maps[j][:, 1:-1]
            if np.isfinite(decoding.repeats_px):
                bend -= decoding.repeats_px * np.rint(bend / decoding.repeats_px)
            excess = np.fmin(np.abs(bend) - even, np.float32(jump))
            costs[i, j, k] = np.log1p(np.fmax(excess, 0.0) / fine)
        return np.asarray(costs / np.log1p(jump / fine))

    def _apart(self, decoding: Decoding, maps: dict[str, Any]) -> FloatMap:
        """Cost of the disagreement of the sets, (r, l − 2)."""
        variances = [
            phase_variance(phases, modulation, maps["background"], self.noise) / TURN**2
            for phases, modulation in zip(decoding.sets, maps["modulations"], strict=True)
        ]
        noise = np.fmin(np.mean(variances, axis=0), UNRELATED_PHASES)
        # Pixels without phases have no disagreement.
        square = np.where(np.isfinite(maps["sigma"]), maps["disagreement"], 0.0) * noise
        square = np.fmax(square, 0.0) / (len(variances) - 1)
        floor = NOISE_RESIDUAL * noise + SETS_APART**2
        cost = np.log1p(square / floor) / np.log1p(np.maximum(UNRELATED_PHASES / floor, 1.0))
        return np.where(np.isfinite(cost), np.fmin(cost, 1.0), 0.0)[:, 1:-1]

    def _residual(self, phases: PhaseFrames, planes: list[NDArray[Any]]) -> FloatMap:
        """Cost of the residuals of a set, (r, l − 2); kept for frames in the order of the plan."""
        of_plan = [self.lines[k] for k in phases.frames if k < len(self.lines)]
        if len(of_plan) < len(planes) or not all(map(is_, planes, of_plan)):
            return self._residual_of(phases, planes)
        if phases not in self._kept:
            self._kept[phases] = self._residual_of(phases, planes)
        return self._kept[phases]

    def _residual_of(self, phases: PhaseFrames, planes: list[NDArray[Any]]) -> FloatMap:
        flat = [np.ascontiguousarray(p).reshape(1, -1) for p in planes]
        rows = fit_samples(flat, phases.rows).rows
        # Whole numbers are finite, and their squares hold in single precision, which is quicker.
        whole = flat[0].dtype.kind == "u"
        fit = SampleFit(rows.astype(np.float32) if whole else np.nan_to_num(rows, posinf=0.0))
        power = 2.0 * fit.variance
        floor = NOISE_RESIDUAL * self.noise.variance(fit.mean) + RELATIVE_RESIDUAL * power
        floor = np.maximum(floor, np.finfo(np.float32).tiny)
        free = len(phases.frames) - 3
        square = np.fmax(fit.square - np.float32(sharpest(phases)[1]) * power, 0.0) / free
        most = _log1p(0.5 * power / floor)
        cost = _log1p(square / floor) / np.maximum(most, np.float32(1.0))
        return np.asarray(np.fmin(cost, 1.0).reshape(self.low.shape)[:, 1:-1])

    def _planes(self, order: Hypothesis, decoding: Decoding) -> list[list[NDArray[Any]]] | None:
        """Planes in the kernel's order, with those that are missing predicted by the others.

        A bit that nothing predicts is tried dark and bright. None where fewer than two steps of a
        set are there.
        """
        shown = {k: self._plane(order, k) for k in decoding.frames}
        for phases in decoding.sets:
            if any(shown[k] is None for k in phases.frames) and not self._predict(
                phases, decoding, shown
            ):
                return None
        gray = decoding.gray
        unknown = None
        if gray is not None:
            pairs = dict(zip(gray.bits, gray.inverse, strict=False))
            for a, b in [*pairs.items(), *((b, a) for a, b in pairs.items())]:
                other = shown[b]
                if shown[a] is None and other is not None:
                    shown[a] = self.low + self.high - other
            for k, light in zip(gray.white_black or (), (self.high, self.low), strict=False):
                shown[k] = light if shown[k] is None else shown[k]
            missing = [k for k in gray.bits if shown[k] is None]
            unknown = missing[0] if len(missing) == 1 else None
            if len(missing) > 1:
                return None
        options = []
        for light in (self.low,) if unknown is None else (self.low, self.high):
            if unknown is not None:
                shown[unknown] = light
                if gray is not None and gray.inverse:
                    shown[pairs[unknown]] = self.low + self.high - light
            options.append([self._stored(shown[k]) for k in decoding.frames])
        return options

    def _plane(self, order: Hypothesis, pattern: int) -> NDArray[Any] | None:
        place = order.places[pattern]
        if place is None:
            return None
        plane = self.lines[place]
        moves = order.moves_px.get(self.decoding.axis)
        if moves is not None:
            plane = moved_back(plane, moves[place])
        if order.exposure is not None and place == order.exposure[0]:
            plane = plane / order.exposure[1]
        return plane

    def _predict(
        self, phases: PhaseFrames, decoding: Decoding, shown: dict[int, NDArray[Any] | None]
    ) -> bool:
        """Predict the missing steps of a set by the others; False where there are too few."""
        kept = [n for n, k in enumerate(phases.frames) if shown[k] is not None]
        rows = np.array(phases.rows)
        solver: Any
        if len(kept) < 2:
            return False
        seen = [np.asarray(shown[phases.frames[n]], np.float32) for n in kept]
        data = np.stack([_finite(plane).ravel() for plane in seen])
        if len(kept) == 2:
            middle = self._middle(phases, decoding, shown)
            solver = np.linalg.pinv(rows[kept][:, 1:])
            wave = times(solver, data - middle)
            fitted = np.stack([middle, *wave])
        else:
            _, solver = fit_matrices(phases.rows, tuple(n in kept for n in range(len(rows))))
            if solver is None:
                return False
            fitted = times(solver, data)
        for n, k in enumerate(phases.frames):
            if n not in kept:
                shown[k] = (rows[n] @ fitted).reshape(self.low.shape)
        return True

    def _middle(
        self, phases: PhaseFrames, decoding: Decoding, shown: dict[int, NDArray[Any] | None]
    ) -> FloatMap:
        """Background of the pixels, (r l,): of the complete sets, or else from the range."""
        found = []
        for other in decoding.sets:
            if other is not phases and all(shown[k] is not None for k in other.frames):
                solver: Any = fit_matrices(other.rows)[1]
                planes = [np.asarray(shown[k], np.float32).ravel() for k in other.frames]
                found.append(times(solver[:1], np.stack(planes))[0])
        return np.mean(found, axis=0) if found else 0.5 * (self.low + self.high).ravel()

    def _stored(self, plane: NDArray[Any] | None) -> NDArray[Any]:
        """A plane in the type of the sample."""
        assert plane is not None
        kind = self.lines[0].dtype
        if plane.dtype == kind:
            return np.ascontiguousarray(plane)
        if kind.kind == "u":
            plane = np.clip(np.rint(plane), 0, np.iinfo(kind).max)
        return np.ascontiguousarray(plane.astype(kind))
