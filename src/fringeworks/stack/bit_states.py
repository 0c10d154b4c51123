"""Bits that no frame shows, along lines: their likeliest states, and what becomes of coordinates.

A bit is dark or bright over whole cells. Each pixel may take the state in which its neighbours
agree best, but every change costs what it is worth: otherwise, noise is explained by chance.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from fringeworks.stack.hypothesis import Hypothesis
from fringeworks.stack.kernel_settings import Decoding
from fringeworks.types import FloatMap

STATES = 2
"""Dark and bright."""

CHANGE = (0.46, 0.29)
"""Cost of neighbours that have a missing bit in different states, if it is the finest one, and of
every coarser one more: ln 3, because it changes at one pixel of three, and ln 2, over the 2.4 of a
pixel without a coordinate."""

FOLD_PX = 16
"""Distance along lines over which the direction of the coordinate is seen, camera px: over several
cells, but less than between most edges."""

FOLDED = 0.2
"""Share of the view whose coordinate runs against the rest from which on other orders are tried.
Where a frame shows a bit of the other axis, it is 0.3 to 0.5."""


def change_of(order: Hypothesis, decoding: Decoding) -> float:
    """Cost of a change of the bit that is missing: coarse bits change at few pixels."""
    bits = () if decoding.gray is None else decoding.gray.bits
    coarser = [len(bits) - 1 - n for n, k in enumerate(bits) if order.places[k : k + 1] == (None,)]
    return CHANGE[0] + CHANGE[1] * min(coarser, default=0)


def folded(coordinate: FloatMap, decoding: Decoding) -> bool:
    """Whether the coordinate of a Gray code runs both ways along lines.

    Behind the place where a bit should have changed, all finer bits run backwards: the coordinate
    is folded, and as smooth as that of a surface.

    Parameters
    ----------
    coordinate : (r, l) array
        Along lines, projector px; NaN where unknown.
    decoding : Decoding
        With a Gray code.
    """
    assert decoding.gray is not None
    steps = coordinate[:, FOLD_PX:] - coordinate[:, :-FOLD_PX]
    steps = steps[np.abs(steps) > 2.0 * decoding.gray.step_px]
    back = np.count_nonzero(steps < 0.0)
    return bool(min(back, steps.size - back) > FOLDED * steps.size)


def cost_of_states(triples: FloatMap, change: float) -> FloatMap:
    """Cost of every triple of neighbours under the likeliest states of their line.

    Parameters
    ----------
    triples : (2, 2, 2, r, l − 2) array
        Cost of three neighbours by the states of the left one, the middle and the right one.
    change : float
        Cost of neighbours in different states.

    Returns
    -------
    (r, l − 2) array
        The costs, with those of the changes.

    Notes
    -----
    Dynamic programming over pairs of neighbouring pixels (Viterbi), from the left to the right.
    """
    changed = change * (1.0 - np.eye(STATES))
    triples = triples + changed[:, :, None, None]  # of the middle one and the right one
    length = triples.shape[-1]
    score = np.broadcast_to(changed[:, :, None], (STATES, STATES, triples.shape[3])).copy()
    before = np.empty((length, *score.shape), np.int8)
    for k in range(length):
        total = score[:, :, None] + triples[..., k]
        before[k] = np.argmin(total, axis=0)
        score = np.min(total, axis=0)
    return _along_path(triples, score, before)


def _along_path(triples: FloatMap, score: FloatMap, before: NDArray[np.int8]) -> FloatMap:
    """The costs along the best path, from its end."""
    lines = np.arange(score.shape[2])
    pairs = np.array(list(product(range(STATES), repeat=2)))
    middle, right = pairs[np.argmin(score.reshape(STATES**2, -1), axis=0)].T
    out = np.empty((lines.size, len(before)))
    for k in reversed(range(len(before))):
        left = before[k, middle, right, lines].astype(np.intp)
        out[:, k] = triples[left, middle, right, lines, k]
        middle, right = left, middle
    return out
