"""The likeliest states of a bit that no frame shows, along lines.

A bit is dark or bright over whole cells. Each pixel may take the state in which its neighbours
agree best, but every change costs what it is worth: otherwise, noise is explained by chance.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from fringeworks.types import FloatMap

STATES = 2
"""Dark and bright."""


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
