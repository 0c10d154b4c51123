"""Hypotheses about a camera or a scene that moves, once or all the time, while frames are taken."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from fringeworks.patterns.plan import PatternPlan, Uniform
from fringeworks.stack.agreement import JUMPS, LineEvidence
from fringeworks.stack.explanations import MOVES
from fringeworks.stack.hypothesis import Hypothesis, moved_back
from fringeworks.types import Axis
from fringeworks.types.numbers import number

SPEEDS_PX = tuple(0.1 * 1.25**k for k in range(16))
"""Camera px per frame that are tried, up to 2.8. Slower motion moves a capture by less than a cell
or a fringe, which coordinates and standard deviations show."""
FINER = (1.12, 1.06, 1.03)
"""Factors by which the best of them is then changed: places are right to a pixel over 20 frames."""
BUMPS_PX = tuple(float(px) for px in (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 16))
"""Camera px by which the image may move between two blocks."""
ASIDE_PX = 0.5 - 12.0**-0.5
"""Shift by which means of two neighbours have ⅔ of the variance of a pixel, px, as those of frames
that are moved back by any part of a pixel have on average."""
PATHS: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {
    "steadily": lambda t: t,
    "ever faster": lambda t: t**2,
    "ever slower": lambda t: 2.0 * t - t**2,
}
"""Places along a path, from 0 to 1, by the time from 0 to 1: at one speed, from rest, and to it."""


def moving_all_the_time(
    plan: PatternPlan, evidence: Mapping[Axis, LineEvidence], few: Mapping[Axis, LineEvidence]
) -> Iterator[Hypothesis]:
    """Paths of the image along the lines of each axis, each at the speed that fits best.

    ``few`` are some of the lines, which the speed is looked for with.
    """
    frames = len(next(iter(evidence.values())).lines)
    if frames < 2:
        return
    times = np.linspace(0.0, 1.0, frames)
    for word, path in PATHS.items():
        places = path(times) - float(np.mean(path(times)))
        places *= frames - 1
        speeds = {axis: _fitting(plan, found, places, SPEEDS_PX) for axis, found in few.items()}
        size = float(np.hypot.reduce(list(speeds.values())))
        if size == 0.0:
            continue
        words = (
            f"the camera or the scene moved {word}, by about {number(size, 2)} px from frame to "
            "frame"
        )
        yield _along(plan, MOVES, words, {axis: v * places for axis, v in speeds.items()})


def moved(
    plan: PatternPlan, evidence: Mapping[Axis, LineEvidence], few: Mapping[Axis, LineEvidence]
) -> Iterator[Hypothesis]:
    """An image that moved between two blocks of patterns along the lines of each axis, by the
    distance that fits best. ``few`` as for ``moving_all_the_time``."""
    frames = len(next(iter(evidence.values())).lines)
    patterns = [first for first, block in plan.placed if not isinstance(block, Uniform)]
    for first in patterns[1:]:
        after = (np.arange(frames) >= first).astype(float)
        sizes = {axis: _fitting(plan, found, after, BUMPS_PX) for axis, found in few.items()}
        size = float(np.hypot.reduce(list(sizes.values())))
        words = (
            f"the camera or the scene moved by about {number(size, 2)} px before "
            f"{plan.labels()[first]}"
        )
        if size > 0.0:
            yield _along(plan, "moved", words, {axis: px * after for axis, px in sizes.items()})


def at_rest(plan: PatternPlan, evidence: Mapping[Axis, LineEvidence]) -> Hypothesis:
    """Frames as planned, a part of a pixel aside: as smooth as those that are moved back, whose
    pixels are means of two neighbours and have less noise."""
    aside = {axis: np.full(len(found.lines), ASIDE_PX) for axis, found in evidence.items()}
    return _along(plan, MOVES, "", aside)


def _along(
    plan: PatternPlan, kind: str, words: str, moves_px: Mapping[Axis, np.ndarray]
) -> Hypothesis:
    moves = {axis: tuple(float(px) for px in part) for axis, part in moves_px.items()}
    return Hypothesis(plan, Hypothesis.of(plan).places, kind, words, moves_px=moves)


def _fitting(
    plan: PatternPlan, found: LineEvidence, path: np.ndarray, sizes: Sequence[float]
) -> float:
    """Size of a path along the lines, of either sign, with which the frames agree best."""
    axis = found.decoding.axis

    def cost(size: float) -> float:
        still = at_rest(plan, {axis: found})
        seen = found.cost(_along(plan, MOVES, "", {axis: size * path}) if size else still)
        return np.inf if seen is None or not seen.size else float(np.mean(seen))

    tried = (0.0, *sizes, *(-size for size in sizes))
    best, size = min((cost(size), size) for size in tried)
    for factor in FINER if size else ():
        best, size = min((best, size), *((cost(s), s) for s in (size * factor, size / factor)))
    return size


def misled(evidence: Mapping[Axis, LineEvidence], h: Hypothesis) -> bool:
    """Whether the frames as planned have wrong fringe orders, at more places than depth edges make,
    if the image moved as a hypothesis says."""
    return any(_misled(found, h) > JUMPS for found in evidence.values())


def _misled(found: LineEvidence, h: Hypothesis) -> float:
    """Share of the triples with another fringe order; 0 for frames without fringes."""
    planned, moved = found.coordinate(Hypothesis.of(h.plan)), found.coordinate(h)
    if planned is None or moved is None or not found.decoding.sets:
        return 0.0
    finest = min(found.decoding.sets, key=lambda phases: phases.period_px)
    # The coordinates of frames as planned belong to the time of their fringes.
    there = float(np.mean([h.moves_px[found.decoding.axis][k] for k in finest.frames]))
    apart = moved - moved_back(planned, there)
    if np.isfinite(found.decoding.repeats_px):
        apart -= found.decoding.repeats_px * np.rint(apart / found.decoding.repeats_px)
    apart = np.abs(apart[:, 1:-1][found.triples])
    known = np.isfinite(apart)
    wrong = apart[known] > 0.5 * finest.period_px
    return float(np.mean(wrong)) if wrong.size else 0.0
