"""Frames in a wrong order, as hypotheses: the likeliest is named where it beats the plan by far."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain, combinations

import numpy as np

from fringeworks.patterns.plan import Block, GrayCode, PatternPlan, PhaseSteps, Uniform
from fringeworks.stack.agreement import DARK, SAME, UNEXPLAINED, LineEvidence
from fringeworks.stack.explanations import (
    CONSISTENT,
    EXPLAINED,
    FITS,
    MAX_NAMED,
    MOVES,
    Explanation,
    best_first,
    in_words,
    near,
    unfit,
    with_one_start,
    with_own_axes,
)
from fringeworks.stack.hypothesis import Hypothesis, changed, decoding_under, lagged
from fringeworks.stack.moving_scene import at_rest, misled, moved, moving_all_the_time
from fringeworks.stack.other_orders import orders_of_other_programs
from fringeworks.stack.other_patterns import (
    AGAINST,
    FAR_BETTER,
    Conventions,
    Evidence,
    clear_conventions,
    conventions,
    gain_of,
    late_rows,
    other_patterns,
)
from fringeworks.stack.refusal import causes_first
from fringeworks.stack.words import flat_in_words, moving_scene
from fringeworks.statistics.quantiles import quantile
from fringeworks.types import Axis, FloatMap, FramesContradictPlan

LAGS = (1, -1, 2, -2, 3, -3)
"""Numbers of frames by which a whole stack may be late or early; the likeliest first."""

WORTH = 0.1
"""Smallest gain of faults that leave most coordinates nearly right, as a share of the pixels."""

SMOOTH = ("moved", "start", "band")
"""Kinds of these faults: a scene that moved, steps with an unusual start, and bands of rows."""

AGAINST_UNSEEN = 0.5
"""The same for orders in which no frame shows a pattern: a bit that is tried dark and bright
costs all pixels a little."""

CHANGED = 0.02
"""Difference of the costs of a vote from which on a hypothesis changes it."""

REPEATED = 0.3
"""Share of the difference of two patterns that blur leaves."""

MANY = 20
"""Number of frames from which on swapped pairs, 190 and more, are first tried at few lines."""

FEW_LINES = 4
"""Every so many lines are those few."""

AGAINST_AT_FEW = 0.5
"""The same as ``AGAINST`` for pairs that are then tried at all lines: twice, as few lines tell it
less well."""

AGAINST_ONE = 0.1
"""The same for a bit that no frame shows, in the order of the plan: pixels gain by its other state,
or stay as they are. Dark bits of simulated captures lose 0.04; a dark one that the scene does not
change, 0.25 or more, because a response that is not linear makes its orders rough."""


@dataclass(frozen=True)
class Doubt:
    """What speaks against frames that are not refused."""

    suspicious: bool = False
    """Whether the frames look as if something were wrong, although no fault explains it."""
    moving: str = ""
    """How the camera or the scene moved, where that alone explains the frames."""


def refuse_order_faults(plan: PatternPlan, evidence: Evidence, *, moves: bool = False) -> Doubt:
    """Refuse frames that contradict their plan, and name the likeliest fault.

    Parameters
    ----------
    plan : PatternPlan
    evidence : dict
        The lines of every axis.
    moves : bool
        Whether the scene may move, so that faults which explain little are none.

    Returns
    -------
    Doubt

    Raises
    ------
    FramesContradictPlan
        If another order of the frames, or other patterns, explain the lines far better than the
        plan, or a frame shows nothing or repeats another.
    """
    suspicious = any(found.suspicious() for found in evidence.values())
    planned = _costs(plan, Hypothesis.of(plan), evidence)
    by_code = conventions(evidence)
    if suspicious:
        _refuse_blurred(plan, evidence)
    # A repeated step bends the coordinate so smoothly that nothing else looks wrong.
    _refuse_equal(plan, evidence)
    repeated = _repeated(plan, evidence)
    also = repeats_in_words(plan, repeated[0]) if repeated else ""
    if repeated and repeated[0] < plan.frames - 1:
        raise FramesContradictPlan(also)
    candidates = late_rows(plan, evidence, planned) if planned else iter(())
    if suspicious:
        likely = _likely(plan, _hypotheses(plan, evidence, by_code), evidence)
        candidates = chain(likely, candidates)
    still = _still(plan, evidence, planned) if suspicious else planned
    gains = [_gain(plan, h, evidence, still if h.moves_px else planned) for h in candidates]
    fitting = [one for one in gains if near(one, planned)]
    if repeated:
        # A last bit that repeats the one before is no code of one bit less.
        fitting = [one for one in fitting if one[1].kind != "bits"]
    fitting = with_own_axes(with_one_start(fitting))
    best = best_first(fitting)[:1]
    drift = next((h for _, h in best if h.kind == MOVES and not moves), None)
    # Frames of a scene that moves may decode all the same.
    named = any(h.kind != MOVES for _, h in fitting) or (drift and misled(evidence, drift))
    if named and not _told_by_code(fitting, evidence):
        told = best[0][1].kind in CONSISTENT or best[0][1].explained > EXPLAINED
        if told or not moves:
            raise FramesContradictPlan(in_words(fitting, vague=not told) + (also and f"; {also}"))
    if repeated:
        raise FramesContradictPlan(also)
    moving = drift.words if drift else ""
    with causes_first([moving_scene(moving)] if moving else []):
        for hypothesis in clear_conventions(plan, evidence, by_code):
            raise FramesContradictPlan(in_words([(0.0, hypothesis)]))
        if suspicious and unfit(planned):
            _refuse_unfit(plan, evidence)
    return Doubt(suspicious, moving)


def _refuse_unfit(plan: PatternPlan, evidence: Evidence) -> None:
    """Refuse frames without a pattern at an end, and a Gray code alone, that no order explains."""
    if any(found.rough for found in evidence.values()):
        _refuse_dark_end(plan, evidence)
    if not any(plan.phase_sets(axis) for axis in plan.axes):
        raise FramesContradictPlan(
            "frames: the bits of the Gray code contradict each other all over the image, and no "
            "order of these frames fits; expected the bits of the plan in its order, of one scene "
            "at rest (likely the plan is another)"
        )


def _likely(
    plan: PatternPlan, candidates: Iterator[Hypothesis], evidence: Evidence
) -> Iterator[Hypothesis]:
    """The candidates without swapped pairs of many frames that gain nothing at few lines."""
    if plan.frames < MANY:
        yield from candidates
        return
    few = _few_lines(evidence)
    planned = _costs(plan, Hypothesis.of(plan), few)
    for h in candidates:
        if h.kind == "swapped":
            costs = _costs(plan, h, few)
            if costs.keys() != planned.keys():
                continue
            old, new = (np.concatenate([c[axis] for axis in few]) for c in (planned, costs))
            if gain_of(old, new, AGAINST_AT_FEW) <= 0.0:
                continue
        yield h


def _few_lines(evidence: Evidence) -> Evidence:
    """Some of the lines of every axis."""
    return {
        axis: replace(
            found,
            lines=tuple(np.ascontiguousarray(a[::FEW_LINES]) for a in found.lines),
            _seen={},
            _kept={},
        )
        for axis, found in evidence.items()
    }


def _still(
    plan: PatternPlan, evidence: Evidence, planned: Mapping[Axis, FloatMap]
) -> Mapping[Axis, FloatMap]:
    """What the plan costs beside frames that are moved back: as smooth as these, where that is
    less."""
    smooth = _costs(plan, at_rest(plan, evidence), evidence)
    return min(planned, smooth, key=lambda costs: sum(float(np.sum(c)) for c in costs.values()))


def _gain(
    plan: PatternPlan, h: Hypothesis, evidence: Evidence, planned: Mapping[Axis, FloatMap]
) -> Explanation:
    """What a hypothesis gains over the plan; 0 where it does not explain the frames. And the
    hypothesis, with the share that it explains of the cost of the votes that it changes."""
    axes = h.band or evidence
    costs = _costs(plan, h, {axis: evidence[axis] for axis in axes})
    if any(axis not in costs or costs[axis].size != planned[axis].size for axis in axes):
        return 0.0, h
    votes = {axis: h.band.get(axis, slice(None)) for axis in axes}
    old = np.concatenate([planned[axis][votes[axis]] for axis in axes])
    new = np.concatenate([costs[axis][votes[axis]] for axis in axes])
    if not h.band and float(np.mean(new)) > FITS:
        return 0.0, h
    against = AGAINST if None not in h.places else AGAINST_UNSEEN
    against = AGAINST_ONE if h.lacks_one and h.plan is plan else against
    gain = gain_of(old, new, against)
    least = WORTH * old.size if h.kind in SMOOTH else 0.0
    if gain <= max(least, FAR_BETTER):
        return 0.0, h
    changed = float(np.sum(old[np.abs(old - new) > CHANGED]))
    explained = gain / max(changed, gain)
    # Of orders that explain the code, the one counts that has white and black in place.
    planned_light, light = (_patterns_for_light(one, evidence) for one in (Hypothesis.of(plan), h))
    gain += UNEXPLAINED * old.size * (planned_light - light)
    return gain, replace(h, explained=explained)


def _patterns_for_light(h: Hypothesis, evidence: Evidence) -> int:
    """Number of white and black frames that show a pattern."""
    places = [h.places[k] for k, block in h.plan.placed if isinstance(block, Uniform)]
    seen = next(iter(evidence.values()))
    return sum(k is not None and seen.shows_pattern(k) for k in places)


def _told_by_code(found: list[Explanation], evidence: Evidence) -> bool:
    """Whether the best explanation is a projector of another size, which cells beyond it show: a
    finding names it, and the coordinates inside of it are right."""
    _, h = max(found, key=lambda one: one[0])
    codes = [found.decoding.gray for found in evidence.values()]
    return h.kind == "size" and any(gray is not None and gray.farthest_px > 0.0 for gray in codes)


def refuse_unrelated(evidence: Evidence) -> None:
    """Refuse frames that contradict each other, whatever their order.

    Raises
    ------
    FramesContradictPlan
    """
    for axis, lines in evidence.items():
        if lines.unrelated:
            raise FramesContradictPlan(
                f"frames along {axis}: {lines.unrelated}, and no order of these frames fits; "
                "expected frames with the periods, steps and Gray-code cells of the plan, all of "
                "one scene at rest (likely the plan is another, or something moved between frames)"
            )


def _costs(plan: PatternPlan, h: Hypothesis, evidence: Evidence) -> dict[Axis, FloatMap]:
    """Cost of a hypothesis along every axis; nothing for those of which too few frames are left."""
    costs = {axis: _axis_cost(plan, h, axis, found) for axis, found in evidence.items()}
    return {axis: cost for axis, cost in costs.items() if cost is not None}


def _axis_cost(
    plan: PatternPlan, h: Hypothesis, axis: Axis, evidence: LineEvidence
) -> FloatMap | None:
    """Cost along an axis; of the other sets where hardly a step of a set is left."""
    along: Axis = axis
    if axis not in h.plan.axes:
        (along,) = h.plan.axes
    lost = [
        first
        for first, block in h.plan.phase_sets(along)
        if sum(h.places[first + k] is not None for k in range(block.frames)) < 2
    ]
    if lost:
        kept = [(first, b) for first, b in h.plan.placed if first not in lost]
        blocks: list[Block] = [b for _, b in kept]
        places = [p for k, b in kept for p in h.places[k : k + b.frames]]
        gray = h.plan.gray_code(along)
        if gray is not None and not gray[1].inverse and h.plan.uniform("white") is None:
            blocks, places = [*blocks, Uniform("white"), Uniform("black")], [*places, None, None]
        if not any(getattr(b, "axis", None) == along for b in blocks):
            return None
        h = replace(h, plan=replace(h.plan, blocks=tuple(blocks)), places=tuple(places))
    if _alike(h.plan, plan, axis):
        return evidence.cost(h)
    decoding = decoding_under(h.plan, along, evidence.decoding)
    return None if decoding is None else evidence.cost(h, decoding)


def _alike(one: PatternPlan, other: PatternPlan, axis: Axis) -> bool:
    """Whether two plans have the same patterns along an axis."""
    parts = [
        [(k, b) for k, b in plan.placed if getattr(b, "axis", axis) == axis]
        for plan in (one, other)
    ]
    return parts[0] == parts[1] and one.length_px(axis) == other.length_px(axis)


def _hypotheses(
    plan: PatternPlan, evidence: Evidence, by_code: Conventions
) -> Iterator[Hypothesis]:
    """What a fault of the capture makes of a stack, the likeliest first."""
    labels = plan.labels()
    every = tuple(range(plan.frames))
    yield from other_patterns(plan, evidence, by_code)
    for a, b in combinations(every, 2):
        if _same_light(evidence, a, b):
            continue
        places = list(every)
        places[a], places[b] = b, a
        words = f"{a} and {b} ({labels[a]}, {labels[b]}) are swapped"
        yield Hypothesis(plan, tuple(places), "swapped", words)
    yield from _late(plan, labels)
    words, both = "the last frame comes first, and so on", len(plan.axes) > 1
    yield Hypothesis(plan, every[::-1], "reversed", words, exchanged=both)
    for k in range(plan.frames - 1 + _next_scan(plan, evidence)):
        words = f"{labels[k]} seems to be lost, or was never shown"
        yield Hypothesis(plan, (*every[:k], None, *every[k:-1]), "lost", words)
    yield from _codes(plan)
    inverted = _inverted(plan, [first for first, _ in plan.placed])
    for other in orders_of_other_programs(plan):
        shown = inverted if other.inverted else plan
        yield Hypothesis(
            shown, other.places, "order", other.words, other.advice, other.changes, other.exchanged
        )
    for dark in _dark_or_bright(plan, evidence):
        words = f"frame {_no_pattern_in_words(', '.join(labels[k] for k in dark))}"
        unseen: list[int | None] = [None if k in dark else k for k in every]
        yield Hypothesis(plan, tuple(unseen), "empty", words)
    few = _few_lines(evidence)
    yield from moved(plan, evidence, few)
    yield from moving_all_the_time(plan, evidence, few)


def _same_light(evidence: Evidence, frame: int, other: int) -> bool:
    """Whether two frames are both dark, or both bright, all over the lines, and differ by less than
    patterns do, as coarse bits in a small view: nothing tells which is which. In light that
    changes, one of them may be the better reference."""
    return all(
        _side(found, frame) == _side(found, other) != 0
        and found.difference(frame, other) < REPEATED
        for found in evidence.values()
    )


def _side(found: LineEvidence, frame: int) -> int:
    """1 for a frame that is in the upper half of the range of its pixels all over the lines, -1 for
    the lower half, 0 for a pattern."""
    shares = found.shares(frame)
    return int(quantile(shares, 0.05) > 0.5) - int(quantile(shares, 0.95) < 0.5)


def _dark_or_bright(plan: PatternPlan, evidence: Evidence) -> Iterator[list[int]]:
    """Bits, and steps of one set, that are dark or bright all over the lines; or white."""
    for first, block in plan.placed:
        frames = range(first, first + block.frames)
        if block == Uniform("white") and all(
            quantile(found.shares(first), 0.95) < DARK for found in evidence.values()
        ):
            yield [first]
        empty = [k for k in frames if _empty(evidence, k)]
        if isinstance(block, PhaseSteps) and empty:
            yield empty
        for k in empty if isinstance(block, GrayCode) else ():
            # Of a bit and its inverse, both are where the scene lies in one of its stripes.
            paired = isinstance(block, GrayCode) and block.inverse
            if not paired or not _opposite(evidence, k, first + ((k - first) ^ 1)):
                yield [k]


def _late(plan: PatternPlan, labels: list[str]) -> Iterator[Hypothesis]:
    """Stacks that begin early or late; their ends show the scan before or after, or no pattern."""
    for lag in LAGS:
        for places in lagged(plan.frames, lag) if abs(lag) < plan.frames else ():
            yield Hypothesis(plan, places, f"lag {lag}", _late_in_words(lag, labels))


def _late_in_words(lag: int, labels: list[str]) -> str:
    count = "one frame" if abs(lag) == 1 else f"{abs(lag)} frames"
    word, place = ("late", lag) if lag > 0 else ("early", 0)
    return f"the stack is {count} {word} (frame {place} of the stack shows {labels[place - lag]})"


def _codes(plan: PatternPlan) -> Iterator[Hypothesis]:
    """Gray codes with their least significant bit first, or with light and dark exchanged."""
    every = tuple(range(plan.frames))
    for first, block in plan.placed:
        if isinstance(block, GrayCode):
            frames = every[first : first + block.frames]
            size = 2 if block.inverse else 1
            back = [k for at in frames[::size][::-1] for k in range(at, at + size)]
            places = (*every[:first], *back, *every[first + block.frames :])
            words = f"the Gray code along {block.axis} begins with its least significant bit"
            yield Hypothesis(plan, places, "code", words)
            words = f"the Gray code along {block.axis} is inverted, light for dark"
            advice = "" if block.inverted else "; a plan says so by inverted = true"
            yield Hypothesis(_inverted(plan, [first]), every, "code", words, advice)
            # With inverses, such a bit is swapped with its own.
            for bit in range(0 if block.inverse else block.bits):
                inverted = tuple(sorted({*block.inverted_bits} ^ {bit}))
                words = f"the bit {block.labels()[bit]} is inverted, light for dark"
                advice = f"; a plan says so by inverted = {list(inverted)}"
                other = changed(plan, {first: replace(block, inverted=inverted)})
                yield Hypothesis(other, every, "code", words, advice)


def _inverted(plan: PatternPlan, firsts: list[int]) -> PatternPlan:
    """The plan with light and dark exchanged in the Gray codes that begin at some frames."""
    codes = [(k, b) for k, b in plan.placed if isinstance(b, GrayCode) and k in firsts]
    bits = {k: tuple(bit for bit in range(b.bits) if bit not in b.inverted_bits) for k, b in codes}
    return changed(plan, {k: replace(b, inverted=bits[k]) for k, b in codes})


def _next_scan(plan: PatternPlan, evidence: Evidence) -> bool:
    """Whether the last frame shows the first pattern, because a frame was lost."""
    last = plan.frames - 1
    return all(f.shows_pattern(last) and f.difference(last, 0) < SAME for f in evidence.values())


def _refuse_dark_end(plan: PatternPlan, evidence: Evidence) -> None:
    """Refuse unrelated frames of which several first or last ones show no pattern."""
    n, labels = plan.frames, plan.labels()
    empty = [k for k in range(n) if _empty(evidence, k)]
    light, count = (plan.uniform("white"), plan.uniform("black")), len(empty)
    if not 1 < count < n or all(k in light for k in empty):
        return
    for lag, ends in ((count, range(count)), (-count, range(n - count, n))):
        if empty == list(ends):
            raise FramesContradictPlan(f"frames: {_late_in_words(lag, labels)}")


def _refuse_blurred(plan: PatternPlan, evidence: Evidence) -> None:
    """Refuse a suspicious stack of which a set shows no fringes: nothing tells its order."""
    labels = plan.labels()
    for axis, found in evidence.items():
        for phases in found.decoding.sets:
            if found.flat(phases):
                raise FramesContradictPlan(
                    f"frames from {labels[phases.frames[0]]} on: {flat_in_words(phases, axis)}; "
                    "expected fringes that the camera resolves (a camera or a projector out of "
                    "focus, fringes too fine for it, or motion during the exposure)"
                )


def _empty(evidence: Evidence, frame: int) -> bool:
    return all(found.uniform(frame) for found in evidence.values())


def _opposite(evidence: Evidence, frame: int, other: int) -> bool:
    """Whether one of two frames is dark, the other bright, all over the lines."""
    bright = [{quantile(f.shares(k), 0.5) > 0.5 for f in evidence.values()} for k in (frame, other)]
    return _empty(evidence, other) and bright[0] != bright[1]


def _no_pattern_in_words(label: str) -> str:
    return (
        f"{label}: it shows no pattern, expected one; the projector was dark or showed something "
        "else when it was taken"
    )


def _repeated(plan: PatternPlan, evidence: Evidence) -> list[int]:
    """Frames that repeat the one before, which the plan says is different."""
    return [
        k
        for k in range(1, plan.frames)
        if not _same_light(evidence, k, k - 1)
        and all(
            found.shows_pattern(k)
            and found.difference(k, k - 1) < SAME < REPEATED * _planned_difference(plan, k, k - 1)
            for found in evidence.values()
        )
    ]


def _refuse_equal(plan: PatternPlan, evidence: Evidence) -> None:
    """Refuse frames that are equal to an earlier one in every count, which noise never makes.

    A last frame like the first may belong to the next scan, after a frame was lost.
    """
    labels, equal = plan.labels(), []
    for k, j in combinations(range(plan.frames), 2):
        copied = k + 1 < j < k + plan.frames - 1 and all(
            np.array_equal(f.lines[k], f.lines[j]) and f.shows_pattern(k) for f in evidence.values()
        )
        if copied and REPEATED * _planned_difference(plan, k, j) > SAME:
            equal.append(f"frame {labels[j]} has the counts of frame {labels[k]}")
    if equal:
        more = f", and {len(equal) - MAX_NAMED} more" if len(equal) > MAX_NAMED else ""
        raise FramesContradictPlan(
            f"{'; '.join(equal[:MAX_NAMED])}{more}; expected another pattern (a file was copied, "
            "or a frame was taken twice)"
        )


def repeats_in_words(plan: PatternPlan, frame: int) -> str:
    """That a frame repeats the one before it."""
    labels = plan.labels()
    return (
        f"frame {labels[frame]}: it repeats frame {labels[frame - 1]}; expected another pattern (a "
        "frame was taken twice, or the projector did not change)"
    )


def _planned_difference(plan: PatternPlan, frame: int, other: int) -> float:
    """Mean difference of two patterns over the projector, as a share of the light."""
    position = np.arange(float(max(plan.width_px, plan.height_px)))
    values = []
    for k in (frame, other):
        first, block = next((f, b) for f, b in plan.placed if f <= k < f + b.frames)
        down = getattr(block, "axis", "x") == "y"
        at = position[: plan.height_px if down else plan.width_px]
        pattern = block.values(at, k - first)
        values.append(pattern[:, None] if down else pattern[None, :])
    return float(np.mean(np.abs(values[0] - values[1])))
