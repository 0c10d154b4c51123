"""Hypotheses about a camera or a scene that moves all the time while the frames are taken."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from fringeworks.patterns.plan import PatternPlan
from fringeworks.stack.agreement import JUMPS, LineEvidence
from fringeworks.stack.hypothesis import Hypothesis, moved_back
from fringeworks.types import Axis
from fringeworks.types.numbers import number

SPEEDS_PX = tuple(0.1 * 1.25**k for k in range(16))
"""Camera px per frame that are tried, up to 2.8. Slower motion moves a capture by less than a cell
or a fringe, which coordinates and standard deviations show."""
FINER = (1.12, 1.06, 1.03)
"""Factors by which the best of them is then changed: places are right to a pixel over 20 frames."""
PATHS: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {
    "steadily": lambda t: t,
    "ever faster": lambda t: t**2,
    "ever slower": lambda t: 2.0 * t - t**2,
}
"""Places along a path, from 0 to 1, by the time from 0 to 1: at one speed, from rest, and to it."""


def moving(
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
        speeds = {axis: _speed(plan, found, places) for axis, found in few.items()}
        size = float(np.hypot.reduce(list(speeds.values())))
        if size == 0.0:
            continue
        words = (
            f"the camera or the scene moved {word}, by about {number(size, 2)} px from frame to "
            "frame"
        )
        moves = {axis: _moves(speed, places) for axis, speed in speeds.items()}
        plain = Hypothesis.of(plan)
        yield Hypothesis(plan, plain.places, "moving", words, moves_px=moves)


def _moves(speed_px: float, places: np.ndarray) -> tuple[float, ...]:
    """Shift of the image in every frame at a mean speed, px."""
    return tuple(speed_px * (len(places) - 1) * float(place) for place in places)


def _speed(plan: PatternPlan, found: LineEvidence, places: np.ndarray) -> float:
    """Mean speed along the lines with which the frames agree best, px per frame."""
    axis, every = found.decoding.axis, Hypothesis.of(plan).places

    def cost(speed: float) -> float:
        moves = {axis: _moves(speed, places)}
        seen = found.cost(Hypothesis(plan, every, "moving", moves_px=moves))
        return np.inf if seen is None or not seen.size else float(np.mean(seen))

    tried = (0.0, *SPEEDS_PX, *(-speed for speed in SPEEDS_PX))
    best, speed = min((cost(speed), speed) for speed in tried)
    for factor in FINER:
        best, speed = min((best, speed), *((cost(s), s) for s in (speed * factor, speed / factor)))
    return speed


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
