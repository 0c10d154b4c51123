"""Hypotheses about patterns that differ from the plan's: steps, periods, cells, exposures, rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.order_chain import TURN
from fringeworks.patterns.plan import Block, GrayCode, PatternPlan, PhaseSteps, equal_steps
from fringeworks.stack.agreement import LineEvidence
from fringeworks.stack.hypothesis import Hypothesis, changed, filled, lagged
from fringeworks.stack.set_ratios import SEARCHED, periods_by_ratios
from fringeworks.stack.step_convention import Convention, convention, steps_in_words
from fringeworks.types import Axis, Finding, FloatMap, InputError

Evidence = Mapping[Axis, LineEvidence]
Conventions = Mapping[Axis, Convention | None]

FAR_BETTER = 20.0
"""Smallest gain of another order over the plan, in pixels without a coordinate. Each weighs e^2.4;
the value allows that some ten neighbours vote alike."""

AGAINST = 0.25
"""Largest share of the gain that other pixels may lose."""

SET_STEPS = tuple((s, q / 4.0) for s in (1.0, -1.0) for q in range(4) if (s, q) != (1.0, 0))
"""Signs and starts, in turns, that other programs give the steps of a set."""

STEP_COUNTS = range(3, 9)
"""Numbers of steps that are tried where the plan says another."""

LEAST_EXPOSURE = 0.08
"""Smallest relative change of the exposure of a Gray-code frame that is tried; less moves no bit
that blur leaves a third of its contrast."""

STRIPS = 48
"""Strips of the image, from top to bottom, whose rows are judged together."""

ROUGHER = 0.3
"""Mean cost of a strip over that of the usual one from which on its rows are looked at. Bands cost
0.9 or more in simulations, and clean strips up to 0.25. It selects strips for the test by
likelihood; alone it refuses nothing."""

FEWEST_STRIPS = 2
"""Fewest strips of a band: of one, an object may be the cause."""


def gain_of(planned: FloatMap, cost: FloatMap, against: float) -> float:
    """What an order gains over the plan's; 0 where too many pixels speak against it."""
    gain = planned - cost
    better, worse = float(np.sum(np.fmax(gain, 0.0))), float(-np.sum(np.fmin(gain, 0.0)))
    return better - worse if worse < against * better else 0.0


def conventions(evidence: Evidence) -> Conventions:
    """What the borders of the Gray code of each axis say about its fringes."""
    return {axis: convention(found.decoding, found.lines) for axis, found in evidence.items()}


def other_patterns(
    plan: PatternPlan, evidence: Evidence, by_code: Conventions
) -> Iterator[Hypothesis]:
    """Patterns that differ from the plan's, the likeliest first."""
    yield from _of_periods(plan, evidence, by_code)
    yield from _of_steps(plan, evidence, by_code, clear=False)
    yield from _of_sets(plan, evidence)
    yield from _of_counts(plan)
    yield from _of_cells(plan)
    yield from _of_projector(plan, evidence)
    for found in evidence.values():
        if found.jumps:
            yield from _exposures(plan, found)


def _of_periods(
    plan: PatternPlan, evidence: Evidence, by_code: Conventions
) -> Iterator[Hypothesis]:
    """Fringes whose period is another, by the borders of the Gray code or by the other sets."""
    for axis, found in evidence.items():
        yield from _by_borders(plan, axis, by_code[axis])
        for number, period in periods_by_ratios(found.decoding, found.lines):
            how = "by the turns of all phases from pixel to pixel"
            yield _of_period(plan, axis, plan.phase_sets(axis)[number], period, how)


def _by_borders(plan: PatternPlan, axis: Axis, seen: Convention | None) -> Iterator[Hypothesis]:
    """Fringes whose period is another by the borders of the Gray code."""
    if seen is not None and seen.period_px != seen.planned_px:
        placed = next(s for s in plan.phase_sets(axis) if s[1].period_px == seen.planned_px)
        rate = seen.planned_px / seen.period_px
        if abs(rate - 1.0) > SEARCHED:
            yield _of_other_cells(plan, axis, rate)
        else:
            yield _of_period(plan, axis, placed, seen.period_px, "by the cells of the Gray code")


def _of_other_cells(plan: PatternPlan, axis: Axis, rate: float) -> Hypothesis:
    """Cells of a Gray code whose width over the plan's is ``rate``, by the phases at borders."""
    placed = plan.gray_code(axis)
    assert placed is not None  # borders are those of a code
    first, block = placed
    step = float(f"{rate * block.step_px:.3g}")
    words = (
        f"the Gray code along {axis} has cells of {step:g} px, {block.step_px:g} px in the plan, "
        "by the phases of the fringes at their borders"
    )
    sets = plan.phase_sets(axis)
    advice = f"; the frames fit this plan if step_px = {step:g} in the Gray code along {axis}"
    if len(sets) == 1:
        period = sets[0][1].period_px
        advice += f", or if the fringes have period_px = {period / rate:.3g}"
    try:
        other = changed(plan, {first: replace(block, step_px=step)})
    except InputError:
        other = plan
    return replace(filled(other, plan.frames, "cells", words), advice=advice)


def _of_period(
    plan: PatternPlan, axis: Axis, placed: tuple[int, PhaseSteps], period: float, how: str
) -> Hypothesis:
    first, block = placed
    words = (
        f"the fringes of {block.period_px:.6g} px along {axis} have another period than the plan "
        f"says ({period:.5g} px {how})"
    )
    advice = "; a period may be rounded in the plan or in the pictures"
    other = changed(plan, {first: replace(block, period_px=period)})
    return replace(Hypothesis.of(other), kind="period", words=words, advice=advice)


def clear_conventions(
    plan: PatternPlan, evidence: Evidence, by_code: Conventions
) -> Iterator[Hypothesis]:
    """Other periods and steps that the borders of a Gray code show beyond doubt: coordinates are
    smooth all the same where cells are narrower than the fringes."""
    for axis, seen in by_code.items():
        yield from _by_borders(plan, axis, seen)
    yield from _of_steps(plan, evidence, by_code, clear=True)


def _of_steps(
    plan: PatternPlan, evidence: Evidence, by_code: Conventions, *, clear: bool
) -> Iterator[Hypothesis]:
    """Steps with the sign and start that the borders of the Gray code show: along each axis, and
    along both."""
    single, both = [], plan
    for axis, found in evidence.items():
        seen = by_code[axis]
        if seen is None or seen.steps == (1.0, 0.0) or (clear and not (seen.clear and seen.usual)):
            continue
        words, advice = steps_in_words(found.decoding, seen, plan.labels())
        kind = "steps" if seen.usual else "start"
        other, both = _stepped(plan, axis, *seen.steps), _stepped(both, axis, *seen.steps)
        single.append(replace(Hypothesis.of(other), kind=kind, words=words, advice=advice))
    if len(single) > 1:
        kind = "steps" if all(h.kind == "steps" for h in single) else "start"
        words, advice = " and ".join(h.words for h in single), "".join(h.advice for h in single)
        yield replace(Hypothesis.of(both), kind=kind, words=words, advice=advice)
    yield from single


def _of_sets(plan: PatternPlan, evidence: Evidence) -> Iterator[Hypothesis]:
    """Steps of one of several sets that run backwards, or start at a quarter of a turn; and of all
    sets, where no Gray code tells them."""
    labels = plan.labels()
    several = [axis for axis, found in evidence.items() if len(found.decoding.sets) > 1]
    free = tuple(axis for axis in several if evidence[axis].decoding.gray is None)
    groups: list[tuple[tuple[Axis, ...], int | None]] = [(free, None)] if len(free) > 1 else []
    groups += [((axis,), None) for axis in free]
    groups += [((axis,), k) for axis in several for k, _ in enumerate(plan.phase_sets(axis))]
    for (axes, k), (sign, start) in product(groups, SET_STEPS):
        first, block = plan.phase_sets(axes[0])[k or 0]
        fit, other = _fitting(block, sign, start), plan
        words = (
            f"all sets along {' and '.join(axes)} have another sign or start of their steps than "
            f"the plan says ({fit} fit the frames from {labels[first]} on)"
            if k is None
            else f"the set from {labels[first]} on has another sign or start of its steps than the "
            f"plan says (they fit {fit})"
        )
        for axis in axes:
            other = _stepped(other, axis, sign, start, k)
        kind = "sets" if k is None else "set"
        yield replace(Hypothesis.of(other), kind=kind, words=words)


def _stepped(
    plan: PatternPlan, axis: Axis, sign: float, start: float, of_set: int | None = None
) -> PatternPlan:
    """The plan with another sign and start, in turns, of the steps of one set or of all."""
    return changed(
        plan,
        {
            first: replace(b, shifts_rad=tuple(sign * (d - TURN * start) for d in b.shifts_rad))
            for k, (first, b) in enumerate(plan.phase_sets(axis))
            if of_set in (None, k)
        },
    )


def _fitting(block: PhaseSteps, sign: float, start: float) -> str:
    """Steps of another sign and start, in words."""
    steps = [np.degrees(sign * (d - TURN * start)) % 360.0 for d in block.shifts_rad]
    return ", ".join(f"{d:.0f}°" for d in steps)


def _of_counts(plan: PatternPlan) -> Iterator[Hypothesis]:
    """Sets of another number of equal steps: one of them, or all."""
    labels = plan.labels()
    sets = [
        (first, b) for first, b in plan.placed if isinstance(b, PhaseSteps) and b.line_px is None
    ]
    for count in STEP_COUNTS:
        others: dict[int, Block] = {
            first: replace(b, shifts_rad=equal_steps(count, start_rad=b.shifts_rad[0]))
            for first, b in sets
            if b.frames != count
        }
        for first, block in others.items():
            planned = next(b.frames for f, b in sets if f == first)
            words = f"the set from {labels[first]} on has {count} steps, {planned} in the plan"
            yield filled(changed(plan, {first: block}), plan.frames, "count", words)
        if len(others) > 1:
            words = f"all sets have {count} steps, other numbers in the plan"
            yield filled(changed(plan, others), plan.frames, "count", words)


def _of_cells(plan: PatternPlan) -> Iterator[Hypothesis]:
    """Gray codes of one bit more or less."""
    for first, block in plan.placed:
        if not isinstance(block, GrayCode):
            continue
        for step in (2.0 * block.step_px, 0.5 * block.step_px):
            try:
                other = replace(block, step_px=step)
            except InputError:
                continue
            words = (
                f"the Gray code along {block.axis} has {other.bits} bits, {block.bits} in the plan"
                f" (cells of {step:g} px, {block.step_px:g} px in the plan)"
            )
            yield filled(changed(plan, {first: other}), plan.frames, "bits", words)


def _of_projector(plan: PatternPlan, evidence: Evidence) -> Iterator[Hypothesis]:
    """Columns and rows that are exchanged: of the projector, or of the patterns."""
    across = any(found.across for found in evidence.values())
    width, height = plan.width_px, plan.height_px
    try:
        blocks = tuple(_exchanged(plan, block, across=across) for block in plan.blocks)
        if across:
            words = "the patterns along x and y are exchanged in the plan"
            yield filled(replace(plan, blocks=blocks), plan.frames, "axis", words)
        elif width != height and any(isinstance(block, GrayCode) for block in blocks):
            # Fringes are the same for any size: a smaller one only has fewer orders to confuse.
            words = (
                f"width and height of the projector are exchanged in the plan ({height} columns "
                f"and {width} rows fit)"
            )
            other = replace(plan, blocks=blocks, width_px=height, height_px=width)
            yield filled(other, plan.frames, "size", words)
    except InputError:
        return


def _exchanged(plan: PatternPlan, block: Block, *, across: bool) -> Block:
    """A block of a projector whose columns and rows are exchanged, or, ``across``, of patterns
    along the other axis."""
    flip: dict[Axis, Axis] = {"x": "y", "y": "x"}
    if isinstance(block, GrayCode):
        length = plan.length_px(flip[block.axis])
        return replace(block, length_px=length, axis=flip[block.axis] if across else block.axis)
    if isinstance(block, PhaseSteps) and across:
        return replace(block, axis=flip[block.axis])
    return block


def other_exposures(plan: PatternPlan, evidence: Evidence) -> Iterator[Finding]:
    """Exposures that differ and cost pixels their coordinate, but mislead hardly any."""
    for axis, found in evidence.items():
        planned = found.cost(Hypothesis.of(plan))
        for h in _exposures(plan, found):
            cost = found.cost(h)
            if planned is None or cost is None or gain_of(planned, cost, AGAINST) < FAR_BETTER:
                continue
            frame, factor = h.exposure or (0, 1.0)
            yield Finding(
                "exposure",
                f"{h.words}: its bits are in doubt at many pixels",
                ("automatic exposure", "a projector that was not yet bright"),
                "fix the exposure, and take the frames again",
                axis,
                (plan.labels()[frame],),
                {"exposure": factor},
            )


def _exposures(plan: PatternPlan, found: LineEvidence) -> Iterator[Hypothesis]:
    """Frames of a Gray code, and of the light that its bits are compared with, whose exposure is
    another than that of the others."""
    gray, axis = found.decoding.gray, found.decoding.axis
    if gray is None:
        return
    shown = (*gray.bits, *gray.inverse, *(gray.white_black or ())[:1])
    for k in shown:
        factor = found.exposure(k, tuple(j for j in shown if j != k))
        if abs(factor - 1.0) > LEAST_EXPOSURE:
            words = (
                f"frame {plan.labels()[k]} has another exposure than the others along {axis} "
                f"({factor:.2f} times)"
            )
            plain = Hypothesis.of(plan)
            yield replace(plain, kind="exposure", words=words, exposure=(k, factor))


def late_rows(
    plan: PatternPlan, evidence: Evidence, planned: Mapping[Axis, FloatMap]
) -> Iterator[Hypothesis]:
    """Rows of the image that show the pattern before or after that of their frame.

    A camera that reads its rows one after another, or a projector that changes its picture during
    the exposure, makes such a band. The other rows fit the plan.
    """
    for axis, found in evidence.items():
        strip = _strips(found)
        band = _rough_band(planned[axis], strip)
        if not band.size:
            continue
        first, last = 100.0 * band[0] / STRIPS, 100.0 * (band[-1] + 1) / STRIPS
        for lag in (-1, 1):
            words = (
                f"a band of rows, from {first:.0f} % to {last:.0f} % of the height, shows the "
                f"pattern {'after' if lag < 0 else 'before'} that of its frame along {axis} (a "
                "rolling shutter, or a projector that changed during the exposure: trigger the "
                "camera, or expose for whole pictures of the projector)"
            )
            for places in lagged(plan.frames, lag):
                yield Hypothesis(plan, places, "band", words, band={axis: np.isin(strip, band)})


def _strips(found: LineEvidence) -> NDArray[np.intp]:
    """Strip of every triple of voters."""
    line, place = np.nonzero(found.triples)
    row, height = (place + 1, found.low.shape[1]) if found.down else (line, found.low.shape[0])
    return np.asarray(row * min(STRIPS, height) // height)


def _rough_band(planned: FloatMap, strip: NDArray[np.intp]) -> NDArray[np.intp]:
    """The run of strips that costs most over the usual one; empty where there is none."""
    number = np.bincount(strip)
    if not number.any():
        return np.arange(0)
    mean = np.bincount(strip, planned) / np.maximum(number, 1)
    excess = np.where(number > 0, mean - np.median(mean[number > 0]), 0.0)
    rough = excess > ROUGHER
    runs = np.split(np.arange(rough.size), np.flatnonzero(np.diff(rough)) + 1)
    runs = [run for run in runs if rough[run[0]] and len(run) >= FEWEST_STRIPS]
    return max(runs, key=lambda run: float(excess[run].sum()), default=np.arange(0))
