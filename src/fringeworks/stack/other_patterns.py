"""Hypotheses about patterns that differ from the plan's: their steps, periods and exposures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from fringeworks.patterns.order_chain import TURN
from fringeworks.patterns.plan import PatternPlan
from fringeworks.stack.agreement import LineEvidence
from fringeworks.stack.hypothesis import Order, OtherPeriod, OtherSteps
from fringeworks.stack.set_ratios import periods_by_ratios
from fringeworks.stack.step_convention import Convention, convention, steps_in_words
from fringeworks.types import Axis, Finding, FloatMap

Evidence = Mapping[Axis, LineEvidence]
Conventions = Mapping[Axis, Convention | None]

FAR_BETTER = 20.0
"""Smallest gain of another order over the plan, in pixels without a coordinate. Each weighs e^2.4;
the value allows that some ten neighbours vote alike."""

AGAINST = 0.25
"""Largest share of the gain that other pixels may lose."""

SET_STEPS = tuple((s, q / 4.0) for s in (1.0, -1.0) for q in range(4) if (s, q) != (1.0, 0))
"""Signs and starts, in turns, that other programs give the steps of a set."""

LEAST_EXPOSURE = 0.08
"""Smallest relative change of the exposure of a Gray-code frame that is tried; less moves no bit
that blur leaves a third of its contrast."""


@dataclass(frozen=True)
class Hypothesis:
    """An order of the frames, and the fault that would make it."""

    order: Order
    kind: str
    words: str
    advice: str = ""
    changes: int = 0
    """Number of conventions that differ from the plan's, for an order of another program."""
    exchanged: bool = False
    """Whether columns and rows change places."""


def gain_of(planned: FloatMap, cost: FloatMap, against: float) -> float:
    """What an order gains over the plan's; 0 where too many pixels speak against it."""
    gain = planned - cost
    better, worse = float(np.sum(np.fmax(gain, 0.0))), float(-np.sum(np.fmin(gain, 0.0)))
    return better - worse if worse < against * better else 0.0


def conventions(evidence: Evidence) -> Conventions:
    """What the borders of the Gray code of each axis say about its fringes."""
    return {axis: convention(found.decoding, found.lines) for axis, found in evidence.items()}


def of_periods(
    plan: PatternPlan, evidence: Evidence, by_code: Conventions, *, clear: bool
) -> Iterator[Hypothesis]:
    """Fringes whose period is another, by the borders of the Gray code or by the other sets."""
    every = tuple(range(plan.frames))
    for axis, found in evidence.items():
        decoding, seen = found.decoding, by_code[axis]
        periods: list[tuple[int, float, str]] = []
        if seen is not None and seen.period_px != seen.planned_px:
            number = [s.period_px for s in decoding.sets].index(seen.planned_px)
            periods.append((number, seen.period_px, "by the cells of the Gray code"))
        by_sets = "by the turns of all phases from pixel to pixel"
        periods += [
            (*one, by_sets) for one in periods_by_ratios(decoding, found.lines, clear=clear)
        ]
        for number, period, how in periods:
            words = (
                f"the fringes of {decoding.sets[number].period_px:.6g} px along {axis} have "
                f"another period than the plan says ({period:.5g} px {how})"
            )
            order = Order(every, period=OtherPeriod(axis, number, period))
            advice = "; a period may be rounded in the plan or in the pictures"
            yield Hypothesis(order, "period", words, advice)


def of_steps(
    plan: PatternPlan, evidence: Evidence, by_code: Conventions, *, clear: bool
) -> Iterator[Hypothesis]:
    """Steps with the sign and start that the borders of the Gray code show: along each axis, and
    along both."""
    every, single = tuple(range(plan.frames)), []
    for axis, found in evidence.items():
        seen = by_code[axis]
        if seen is None or seen.steps == (1.0, 0.0) or (clear and not (seen.clear and seen.usual)):
            continue
        words = steps_in_words(found.decoding, seen, plan.labels())
        order = Order(every, steps=(OtherSteps(axis, *seen.steps),))
        single.append(Hypothesis(order, "steps" if seen.usual else "start", *words))
    if len(single) > 1:
        steps = tuple(other for h in single for other in h.order.steps)
        kind = "steps" if all(h.kind == "steps" for h in single) else "start"
        words = " and ".join(h.words for h in single), "".join(h.advice for h in single)
        yield Hypothesis(Order(every, steps=steps), kind, *words)
    yield from single


def of_sets(plan: PatternPlan, evidence: Evidence) -> Iterator[Hypothesis]:
    """Steps of one of several sets that run backwards, or start at a quarter of a turn; and of all
    sets, where no Gray code tells them."""
    every, labels = tuple(range(plan.frames)), plan.labels()
    several = {a: f.decoding for a, f in evidence.items() if len(f.decoding.sets) > 1}
    free = [axis for axis, decoding in several.items() if decoding.gray is None]
    for sign, start in SET_STEPS:
        for axes in {tuple(free), *((axis,) for axis in free)} - {()}:
            order = Order(every, steps=tuple(OtherSteps(axis, sign, start) for axis in axes))
            first = several[axes[0]].sets[0]
            words = (
                f"all sets along {' and '.join(axes)} have another sign or start of their steps "
                f"than the plan says ({_fitting(first.shifts_rad, sign, start)} fit the frames "
                f"from {labels[first.frames[0]]} on)"
            )
            yield Hypothesis(order, "sets", words)
    for axis, decoding in several.items():
        for k, phases in enumerate(decoding.sets):
            for sign, start in SET_STEPS:
                steps = _fitting(phases.shifts_rad, sign, start)
                words = (
                    f"the set from {labels[phases.frames[0]]} on has another sign or start of its "
                    f"steps than the plan says (they fit {steps})"
                )
                order = Order(every, steps=(OtherSteps(axis, sign, start, k),))
                yield Hypothesis(order, "set", words)


def _fitting(shifts_rad: tuple[float, ...], sign: float, start: float) -> str:
    """Steps of another sign and start, in words."""
    steps = [np.degrees(sign * (d - TURN * start)) % 360.0 for d in shifts_rad]
    return ", ".join(f"{d:.0f}°" for d in steps)


def other_exposures(plan: PatternPlan, evidence: Evidence) -> Iterator[Finding]:
    """Exposures that differ and cost pixels their coordinate, but mislead hardly any."""
    labels = plan.labels()
    for axis, found in evidence.items():
        planned = found.cost(Order(tuple(range(plan.frames))))
        for order, factor in _of_exposures(plan, found):
            cost = found.cost(order)
            if planned is None or cost is None or gain_of(planned, cost, AGAINST) < FAR_BETTER:
                continue
            assert order.exposure is not None
            label = labels[order.exposure[0]]
            yield Finding(
                "exposure",
                f"frame {label} has another exposure than the others along {axis} ({factor:.2f} "
                "times): its bits are in doubt at many pixels",
                ("automatic exposure", "a projector that was not yet bright"),
                "fix the exposure, and take the frames again",
                axis,
                (label,),
                {"exposure": factor},
            )


def _of_exposures(plan: PatternPlan, found: LineEvidence) -> Iterator[tuple[Order, float]]:
    """Frames of a Gray code, and of the light that its bits are compared with, whose exposure is
    another than that of the others."""
    gray = found.decoding.gray
    if gray is None:
        return
    shown = (*gray.bits, *gray.inverse, *(gray.white_black or ())[:1])
    for k in shown:
        factor = found.exposure(k, tuple(j for j in shown if j != k))
        if abs(factor - 1.0) > LEAST_EXPOSURE:
            yield Order(tuple(range(plan.frames)), exposure=(k, factor)), factor


def misleading_exposures(plan: PatternPlan, evidence: Evidence) -> Iterator[Hypothesis]:
    """Frames whose exposure is another, where coordinates jump."""
    labels = plan.labels()
    for axis, found in evidence.items():
        if not found.jumps:
            continue
        for order, factor in _of_exposures(plan, found):
            assert order.exposure is not None
            words = (
                f"frame {labels[order.exposure[0]]} has another exposure than the others along "
                f"{axis} ({factor:.2f} times)"
            )
            yield Hypothesis(order, "exposure", words)
