"""Hypotheses about a camera or a scene that moves all the time while the frames are taken."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from fringeworks.patterns.plan import PatternPlan
from fringeworks.stack.agreement import LineEvidence
from fringeworks.stack.hypothesis import Hypothesis
from fringeworks.types import Axis
from fringeworks.types.numbers import number

SPEEDS_PX = tuple(0.1 * 1.25**k for k in range(15))
"""Camera px per frame that are tried, up to 2.3. Slower motion is found and taken out in frames
that decode; the speed is looked for between these, which follow closely enough for the finest of
them to be near any other."""
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
    return min(tried, key=cost)
