"""Rows of the image that show the pattern before or after that of their frame.

A camera that reads its rows one after another, or a projector that changes its picture during the
exposure, makes such a band. The other rows fit the plan.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import PatternPlan
from fringeworks.stack.agreement import LineEvidence
from fringeworks.stack.hypothesis import Order
from fringeworks.stack.other_patterns import AGAINST, FAR_BETTER, Evidence, gain_of
from fringeworks.types import Axis, FloatMap, FramesContradictPlan

STRIPS = 48
"""Strips of the image, from top to bottom, whose rows are judged together."""

ROUGHER = 0.3
"""Mean cost of a strip over that of the usual one from which on its rows are looked at. Bands cost
0.9 or more in simulations, and clean strips up to 0.25. It selects strips for the test by
likelihood; alone it refuses nothing."""

FEWEST_STRIPS = 2
"""Fewest strips of a band: of one, an object may be the cause."""

GAIN_PER_PIXEL = 0.1
"""Smallest mean gain of the neighbouring frames over a band: below, most orders are right."""


def refuse_late_rows(plan: PatternPlan, evidence: Evidence) -> None:
    """Refuse frames of which a band of rows shows the pattern before or after their own.

    Raises
    ------
    FramesContradictPlan
        If the neighbouring frames explain these rows far better.
    """
    every = tuple(range(plan.frames))
    for axis, found in evidence.items():
        planned = found.cost(Order(every))
        if planned is None or not planned.size:
            continue
        strip = _strips(axis, found)
        band = _rough_band(planned, strip)
        inside = np.isin(strip, band)
        if not inside.any():
            continue
        for lag, order in _neighbouring(plan.frames):
            cost = found.cost(order)
            if cost is None or cost.size != planned.size:
                continue
            gain = gain_of(planned[inside], cost[inside], AGAINST)
            if gain > max(FAR_BETTER, GAIN_PER_PIXEL * np.count_nonzero(inside)):
                raise FramesContradictPlan(_words(axis, band, lag))


def _strips(axis: Axis, found: LineEvidence) -> NDArray[np.intp]:
    """Strip of every triple of voters: lines along x are rows, those along y are columns."""
    line, place = np.nonzero(found.triples)
    row, height = (line, found.low.shape[0]) if axis == "x" else (place + 1, found.low.shape[1])
    return np.asarray(row * min(STRIPS, height) // height)


def _rough_band(planned: FloatMap, strip: NDArray[np.intp]) -> NDArray[np.intp]:
    """The run of strips that costs most over the usual one; empty where there is none."""
    number = np.bincount(strip)
    mean = np.bincount(strip, planned) / np.maximum(number, 1)
    excess = np.where(number > 0, mean - np.median(mean[number > 0]), 0.0)
    rough = excess > ROUGHER
    runs = np.split(np.arange(rough.size), np.flatnonzero(np.diff(rough)) + 1)
    runs = [run for run in runs if rough[run[0]] and len(run) >= FEWEST_STRIPS]
    return max(runs, key=lambda run: float(excess[run].sum()), default=np.arange(0))


def _neighbouring(n: int) -> Iterator[tuple[int, Order]]:
    """Orders one frame late or early, whose end shows the next scan or nothing."""
    for lag in (-1, 1):
        yield lag, Order(tuple((k + lag) % n for k in range(n)))
        places = tuple(k + lag if 0 <= k + lag < n else None for k in range(n))
        yield lag, Order(places)


def _words(axis: Axis, band: NDArray[np.intp], lag: int) -> str:
    first, last = 100.0 * band[0] / STRIPS, 100.0 * (band[-1] + 1) / STRIPS
    return (
        f"frames along {axis}: a band of rows, from {first:.0f} % to {last:.0f} % of the height, "
        f"shows the pattern {'after' if lag < 0 else 'before'} that of its frame; expected one "
        "pattern in all rows of a frame (a rolling shutter, or a projector that changed during the "
        "exposure: trigger the camera, or expose for whole pictures of the projector)"
    )
