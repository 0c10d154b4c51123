"""Frames in a wrong order: swapped, late, lost, dark or taken twice. They are refused by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps
from fringeworks.stack.agreement import Agreement
from fringeworks.stack.sample import Sample
from fringeworks.types import Axis, BoolMap, FloatMap, FramesContradictPlan

SUSPICIOUS = Agreement(residual=0.02, sets=0.3, astray=0.25, borders=0.15, unmeasured=0.5)
"""Agreement from which on the order of the frames is examined, part by part.

In simulations of captures in order, with noise, steps that are wrong by 5°, motion of 0.2 rad per
frame or γ = 2.2, parts stay below, or the search takes a second or more and finds nothing.
Swapped or late frames exceed at least one part by far. Empirical.
"""

CONTRADICTION = Agreement(residual=0.4, sets=0.9, astray=0.5, borders=0.25, unmeasured=2.0)
"""Agreement from which on no coordinate can be trusted, whatever the cause.

Unrelated frames make 1 in each part; ``unmeasured`` alone contradicts nothing. Empirical.
"""

EXPLAINED = 0.3
"""Share of the total disagreement below which another order explains it.

In simulations the right order leaves less than 0.05, and the best of the wrong ones 0.4 or more
where the cause is another, such as a wrong plan. Empirical.
"""

EQUALLY_GOOD = 1.5
"""Total disagreement over that of the best order up to which another order is as good.

Some swaps cannot be distinguished, such as the two pairs of opposite frames of four steps.
"""

SMALL = 0.03
"""Difference of total disagreements that noise makes. Empirical."""

MAX_CANDIDATES = 2
"""At most this many swaps are reported; with more, the evidence is inconclusive.

Two, because equal steps often have a second swap that leaves the same residuals.
"""

MAX_SWAP_FRAMES = 30
"""Largest number of frames for which swaps are searched. The time grows with the square of it: 30
frames have 435 pairs and take several seconds. Empirical."""

LAGS = (1, -1, 2, -2, 3, -3)
"""Numbers of frames by which a whole stack may be late or early, the likeliest first."""

PATTERN_SHARE = 0.25
"""Distance of a sample from the middle between its darkest and its brightest frame from which on it
counts as bright or dark, as a share of their difference."""

LIT_COUNTS = 0.2
"""Smallest difference between the darkest and the brightest frame of a pixel that counts as lit, as
a share of the 95th percentile."""

SAME_PATTERN = 0.35
"""Largest misfit of numbers of borders, as |log₂| of their ratio, for frames of the same pattern.

Numbers of neighbouring bits of a Gray code differ by 1. Empirical.
"""

MIN_EXPECTED = 4.0
"""Smallest number of expected borders per line for a statement that a frame shows no pattern."""

NO_PATTERN = 0.1
"""Share of the expected borders below which a frame shows no pattern. Empirical."""

REPEATED = 0.15
"""Difference between two phase frames, over that between other frames of their set, below which one
repeats the other. Noise of a tenth of the modulation makes 0.15. Empirical."""


MIN_MISFITS = 3
"""Smallest number of frames with other borders than expected for a statement that all are shifted;
more than half of the frames must have them, too. Numbers of few borders scatter. Empirical."""

LEAST_LIT = 0.5
"""Smallest number of lit pixels of an order that is tried, over the largest of all orders.

Frames in a wrong order may show next to no fringes, and then nothing contradicts anything.
"""


@dataclass(frozen=True)
class _Trial:
    """How a stack in another order agrees with its plan."""

    total: float
    """The sum of all disagreements."""
    lit: float
    """Share of the pixels that show fringes."""


@dataclass(frozen=True)
class _Signature:
    """Numbers of borders between bright and dark along the lines of an axis."""

    seen: NDArray[np.float64]
    """Borders of every frame of the stack."""
    lines: int
    """Number of lines."""
    per_px: NDArray[np.float64]
    """Borders per projector px of every frame of the plan; NaN for frames without a pattern along
    the axis."""

    def fits(self, places: dict[int, int]) -> tuple[BoolMap, FloatMap]:
        """Which frames of the plan have their borders, if they are at some places of the stack, and
        the borders that are expected of every frame of the plan."""
        frames = np.array(list(places), np.intp)
        at = np.array([places[k] for k in frames], np.intp)
        seen, per_px = self.seen[at], self.per_px[frames]
        with np.errstate(invalid="ignore", divide="ignore"):
            crossed = np.nanmedian(np.where(seen > 0, seen / per_px, np.nan))
        expected = crossed * self.per_px
        fits = np.zeros(self.per_px.size, bool)
        off = np.abs(np.log2((seen + 1.0) / (expected[frames] + 1.0)))
        fits[frames] = off < SAME_PATTERN
        return fits, expected


def exceeded(found: Agreement, limits: Agreement) -> bool:
    """Whether any part of an agreement exceeds its limit."""
    return (
        found.residual > limits.residual
        or found.sets > limits.sets
        or found.astray > limits.astray
        or found.borders > limits.borders
        or found.unmeasured > limits.unmeasured
    )


def refuse_order_faults(
    plan: PatternPlan,
    sample: Sample,
    agreements: dict[Axis, Agreement],
    agreements_of: Callable[[Sample], dict[Axis, Agreement]],
) -> None:
    """Refuse frames that contradict their plan, and name the frames and the likely fault.

    Parameters
    ----------
    plan : PatternPlan
    sample : Sample
    agreements : dict
        Agreement of the sample with the plan along every axis.
    agreements_of : function
        Agreements of a sample in another order.

    Raises
    ------
    FramesContradictPlan
        If a frame shows no pattern or repeats another, if another order of the frames agrees with
        the plan, or if the frames contradict the plan whatever their order.
    """
    if not any(exceeded(found, SUSPICIOUS) for found in agreements.values()):
        return
    labels = plan.labels()
    before = sum(found.total for found in agreements.values())

    def trial(order: tuple[int, ...]) -> _Trial:
        found = agreements_of(sample.reordered(order)).values()
        return _Trial(sum(f.total for f in found), min(f.lit for f in found))

    _refuse_other_order(plan, labels, before, trial)
    evident = replace(SUSPICIOUS, unmeasured=float("inf"))
    if not any(exceeded(found, evident) for found in agreements.values()):
        return  # dim scenes have pixels that cannot be measured, too
    signatures = [_signature(plan, sample, axis) for axis in plan.axes]
    _refuse_shifted(signatures, labels)
    _refuse_no_pattern(signatures, labels)
    _refuse_repeated(plan, sample, labels)
    for axis, found in agreements.items():
        if exceeded(found, CONTRADICTION):
            raise FramesContradictPlan(_contradiction(axis, found))


def _contradiction(axis: Axis, found: Agreement) -> str:
    seen = []
    if found.residual > CONTRADICTION.residual:
        seen.append("the steps of its sets do not fit any fringe")
    if found.sets > CONTRADICTION.sets:
        seen.append("fringe orders contradict each other all over the image")
    if found.astray > CONTRADICTION.astray:
        seen.append("phases and Gray code are apart, like unrelated ones")
    if found.borders > CONTRADICTION.borders:
        seen.append("borders of the Gray code do not join neighbouring cells")
    return (
        f"frames along {axis}: {', and '.join(seen)}; expected frames in the order of the plan, "
        "with its periods, steps and Gray-code cells, all of one scene at rest"
    )


def _refuse_repeated(plan: PatternPlan, sample: Sample, labels: list[str]) -> None:
    """Refuse a phase frame that repeats the frame before it."""
    for first, block in plan.placed:
        if not isinstance(block, PhaseSteps):
            continue
        frames = [sample.points[first + k][0].astype(np.float64) for k in range(block.frames)]
        spread = np.std(np.stack(frames), axis=0)
        lit = spread >= np.median(spread)
        after = first + block.frames
        if after < plan.frames:
            frames.append(sample.points[after][0].astype(np.float64))
        steps = [np.median(np.abs(b - a)[lit]) for a, b in pairwise(frames)]
        usual = float(np.median(steps))
        for k, step in enumerate(steps):
            if step < REPEATED * usual:
                raise FramesContradictPlan(
                    f"frame {labels[first + k + 1]}: it repeats frame {labels[first + k]}; "
                    "expected another pattern (a frame was taken twice, or the projector did not "
                    "change)"
                )


def _lit(sample: Sample, axis: Axis) -> tuple[FloatMap, FloatMap, BoolMap]:
    """Middle and half difference of the darkest and brightest frame of the lines; lit pixels."""
    frames = sample.lines[axis]
    dark = np.minimum.reduce(frames).astype(np.float64)
    bright = np.maximum.reduce(frames).astype(np.float64)
    half = 0.5 * (bright - dark)
    return 0.5 * (bright + dark), half, np.asarray(half > LIT_COUNTS * np.nanpercentile(half, 95))


def _signature(plan: PatternPlan, sample: Sample, axis: Axis) -> _Signature:
    """Numbers of borders of every frame along the lines of an axis."""
    middle, half, lit = _lit(sample, axis)
    seen = np.array([_borders(frame, middle, half, lit) for frame in sample.lines[axis]])
    per_px = np.full(plan.frames, np.nan)
    for first, block in plan.placed:
        if isinstance(block, PhaseSteps | GrayCode) and block.axis == axis:
            per_px[first : first + block.frames] = [
                _borders_per_px(block, k) for k in range(block.frames)
            ]
    return _Signature(seen, len(middle), per_px)


def _borders_per_px(block: PhaseSteps | GrayCode, frame: int) -> float:
    """Borders between bright and dark per projector px of a frame."""
    if isinstance(block, PhaseSteps):
        return 2.0 / block.period_px
    if block.levels > 2:
        return float("nan")  # its frames have borders between more than two levels
    bit = frame // 2 if block.inverse else frame
    return float(2.0 ** (bit - block.bits) / block.step_px)


def _borders(frame: NDArray[Any], middle: FloatMap, half: FloatMap, lit: BoolMap) -> float:
    """Number of borders between bright and dark along lines."""
    off = frame - middle
    clear = lit & (np.abs(off) > 2.0 * PATTERN_SHARE * half)
    place = np.where(clear, np.arange(frame.shape[1]), 0)
    last = np.maximum.accumulate(place, axis=1)
    sign = np.take_along_axis(np.where(clear, np.sign(off), 0.0), last, axis=1)
    return float(np.sum(sign[:, 1:] * sign[:, :-1] < 0))


def _refuse_no_pattern(signatures: list[_Signature], labels: list[str]) -> None:
    """Refuse frames without the pattern that their plan expects."""
    for found in signatures:
        _, expected = found.fits({k: k for k in range(len(labels))})
        empty = (expected >= MIN_EXPECTED * found.lines) & (found.seen < NO_PATTERN * expected)
        if 0 < empty.sum() <= MAX_CANDIDATES:
            named = ", ".join(labels[k] for k in np.flatnonzero(empty))
            raise FramesContradictPlan(
                f"frame {named}: it shows no pattern, expected one; the projector was dark or "
                "showed something else when it was taken, or the stack begins too early or too late"
            )


def _refuse_other_order(
    plan: PatternPlan,
    labels: list[str],
    before: float,
    trial: Callable[[tuple[int, ...]], _Trial],
) -> None:
    """Refuse frames if two that are swapped, or a shift of all, make them agree with the plan."""
    n = plan.frames
    lags = [lag for lag in LAGS if abs(lag) < n]
    pairs = list(combinations(range(n), 2)) if n <= MAX_SWAP_FRAMES else []
    orders = [tuple((k + lag) % n for k in range(n)) for lag in lags]
    trials = [trial(order) for order in (*orders, *(_swapped(n, pair) for pair in pairs))]
    most = max(t.lit for t in trials)
    totals = [t.total if t.lit >= LEAST_LIT * most else float("inf") for t in trials]
    best = min(totals)
    if best > EXPLAINED * before:
        return
    as_good = max(EQUALLY_GOOD * best, best + SMALL)
    late = [lag for lag, value in zip(lags, totals, strict=False) if value <= as_good]
    if late:
        raise FramesContradictPlan(_late(late[0], labels))
    good = [p for p, value in zip(pairs, totals[len(lags) :], strict=True) if value <= as_good]
    if len(good) <= MAX_CANDIDATES:
        named = " or ".join(f"{a} and {b} ({labels[a]}, {labels[b]})" for a, b in sorted(good))
        raise FramesContradictPlan(
            f"frames {named} seem to be swapped, judging by how all frames agree; expected the "
            "order of the plan"
        )


def _swapped(count: int, pair: tuple[int, int]) -> tuple[int, ...]:
    order = list(range(count))
    order[pair[0]], order[pair[1]] = pair[1], pair[0]
    return tuple(order)


def _late(lag: int, labels: list[str]) -> str:
    count = "one frame" if abs(lag) == 1 else f"{abs(lag)} frames"
    word, place = ("late", lag) if lag > 0 else ("early", 0)
    shown = f"frame {place} of the stack shows {labels[place - lag]}"
    return (
        f"frames: the stack is {count} {word} ({shown}); expected the frames of the plan, "
        f"the first one {labels[0]}"
    )


def _alignments(count: int) -> Iterator[tuple[str, int, dict[int, int]]]:
    """Kinds of shifts: name, frame or lag, and the place in the stack of the plan's frames."""
    for lag in LAGS:
        yield "late", lag, {k: k + lag for k in range(count) if 0 <= k + lag < count}
    for lost in range(count):
        yield "lost", lost, {k: k if k < lost else k - 1 for k in range(count) if k != lost}


def _refuse_shifted(signatures: list[_Signature], labels: list[str]) -> None:
    """Refuse a stack whose patterns are the plan's, shifted as a whole or from a frame on."""
    count = len(labels)

    def explained(places: dict[int, int]) -> int:
        return sum(int(found.fits(places)[0].sum()) for found in signatures)

    present = explained({k: k for k in range(count)})
    options = [(explained(places), kind, k) for kind, k, places in _alignments(count)]
    best = max(options, key=lambda option: option[0])
    known = sum(int(np.isfinite(found.per_px).sum()) for found in signatures)
    missing = abs(best[2]) if best[1] == "late" else 1
    if known - present < max(MIN_MISFITS, known // 2 + 1) or known - best[0] > missing:
        return
    equal = [k for fits, kind, k in options if kind == "lost" and fits == best[0]]
    if not equal:
        raise FramesContradictPlan(_late(best[2], labels))
    named = labels[equal[0]] if len(equal) == 1 else f"{labels[equal[0]]} to {labels[equal[-1]]}"
    raise FramesContradictPlan(
        f"frames: one seems to be lost, {named}, because later frames show the pattern of the next "
        "one; expected every frame of the plan once"
    )
