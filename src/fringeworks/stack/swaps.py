"""Detection of two swapped frames in a stack."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import PatternPlan
from fringeworks.stack.kernel_settings import Decoding, Limits
from fringeworks.stack.noise import MIN_JUDGED_PIXELS, set_parts, solve, usable
from fringeworks.types import FloatMap, FramesContradictPlan

EXPLAINED = 0.25
"""Share of the misfit below which a swap of two frames explains it.

In simulations the right swap leaves less than 0.02. With other errors, such as a wrong plan,
response or steps, the best swap leaves 0.29 or more. Empirical.
"""

EQUALLY_GOOD = 1.5
"""Misfit of a swap over that of the best one up to which both explain the frames equally well.

In simulations the ratio is below 1.03 for swaps that cannot be distinguished, such as the two pairs
of opposite frames of four steps, and above 100 for wrong swaps. Empirical.
"""

MAX_CANDIDATES = 2
"""At most this many candidate swaps are reported; with more, the evidence is inconclusive.

Two, because equal steps often have a second swap that leaves the same residuals.
"""

ROUGH = 0.004
"""Residual variance over B² above which swapped frames are searched.

Noise of 2 counts at B = 100 counts leaves 0.0004, a swap within three sets of eight steps 0.07, and
within sets of fewer steps more. The value only saves the time of the search. Empirical.
"""

MAX_SWAP_FRAMES = 24
"""Largest number of phase frames along an axis for which swaps are searched.

The time grows with the square of it: 24 frames have 276 pairs. Empirical.
"""

SWAP_PIXELS = 2_000
"""Approximate number of pixels of the sample that every trial of a swap uses.

Misfits of right and wrong swaps differ by a factor of 100, which so few pixels show. Empirical.
"""

FramePair = tuple[int, int]
"""Places of two frames among the phase frames of an axis."""


def refuse_swap_by_residuals(
    decoding: Decoding, values: FloatMap, limits: Limits, plan: PatternPlan
) -> None:
    """Refuse frames if swapping two of them removes the residuals of sets with four or more steps.

    Parameters
    ----------
    decoding : Decoding
    values : (frames, n) float array, counts
        ``phase_samples`` of the axis.
    limits : Limits
    plan : PatternPlan

    Raises
    ------
    InputError
        If one or two swaps explain the residuals. The message names the frames.
    """
    places = np.flatnonzero(usable(values, limits)) if values.size else np.empty(0, int)
    freedom = sum(len(s.frames) - 3 for s in decoding.sets)
    if places.size < MIN_JUDGED_PIXELS or freedom == 0 or len(values) > MAX_SWAP_FRAMES:
        return
    data = values[:, places[:: max(1, places.size // SWAP_PIXELS)]]
    parts = set_parts(decoding)

    def misfit(order: NDArray[np.intp]) -> float:
        total = 0.0
        for part, phases in zip(parts, decoding.sets, strict=True):
            if len(phases.frames) > 3:
                _, square = solve(data[order[part]], phases.shifts_rad)
                total += float(np.mean(square))
        return total

    unswapped = np.arange(len(data))
    before = misfit(unswapped)
    power = [
        float(np.median(np.sum(solve(data[p], s.shifts_rad)[0][1:] ** 2, axis=0)))
        for p, s in zip(parts, decoding.sets, strict=True)
    ]
    if before / freedom < ROUGH * float(np.mean(power)):
        return
    pairs = list(combinations(range(len(data)), 2))
    after = np.array([misfit(_swapped(unswapped, pair)) for pair in pairs])
    _refuse_explained(decoding, plan, pairs, after, before, "the residuals of their sets")


def refuse_swap_by_orders(
    decoding: Decoding,
    planes: list[NDArray[Any]],
    plan: PatternPlan,
    before: float,
    disagreement: Callable[[list[NDArray[Any]]], float | None],
) -> None:
    """Refuse frames if swapping two of them makes the fringe orders of the sets agree.

    Parameters
    ----------
    decoding : Decoding
    planes : (1, n) arrays, counts
        Sample of the frames in the decoding's order.
    plan : PatternPlan
    before : float
        Disagreement of the sets as they are.
    disagreement : function
        Disagreement of the sets for such a sample; None where too few pixels are lit.

    Raises
    ------
    InputError
        If one or two swaps explain the disagreement. The message names the frames.
    """
    count = len(decoding.phase_frames)
    if count > MAX_SWAP_FRAMES:
        return
    step = max(1, planes[0].size // SWAP_PIXELS)
    few = [np.ascontiguousarray(plane[:, ::step]) for plane in planes]
    pairs = list(combinations(range(count), 2))
    after = np.full(len(pairs), np.inf)
    for k, pair in enumerate(pairs):
        order = _swapped(np.arange(len(few)), pair)
        value = disagreement([few[place] for place in order])
        after[k] = np.inf if value is None else value
    _refuse_explained(decoding, plan, pairs, after, before, "the fringe orders")


def _swapped(order: NDArray[np.intp], pair: FramePair) -> NDArray[np.intp]:
    """The order with two frames exchanged."""
    swapped = order.copy()
    swapped[list(pair)] = swapped[list(pair[::-1])]
    return swapped


def _refuse_explained(
    decoding: Decoding,
    plan: PatternPlan,
    pairs: list[FramePair],
    after: NDArray[np.float64],
    before: float,
    evidence: str,
) -> None:
    """Raise if one or two swaps explain the misfit, and name their frames."""
    order = np.argsort(after)
    candidates = [pairs[k] for k in order if after[k] <= EQUALLY_GOOD * after[order[0]]]
    explained = after.min() < EXPLAINED * before
    if not explained or len(candidates) > MAX_CANDIDATES:
        return
    frames, labels = decoding.phase_frames, plan.labels()
    named = [
        f"{frames[first]} and {frames[second]} ({labels[frames[first]]}, {labels[frames[second]]})"
        for first, second in sorted(candidates)
    ]
    raise FramesContradictPlan(
        f"frames {' or '.join(named)} seem to be swapped, judging by {evidence}; expected the "
        "order of the plan"
    )
