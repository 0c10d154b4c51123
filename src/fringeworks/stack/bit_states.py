"""Bits that no frame shows, along lines: their likeliest states, and what becomes of coordinates.

A bit is dark or bright over whole cells. Each pixel may take the state in which its neighbours
agree best, but every change costs what it is worth: otherwise, noise is explained by chance.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from fringeworks.stack.gray_frames import GrayFrames
from fringeworks.stack.hypothesis import Hypothesis
from fringeworks.stack.kernel_settings import Decoding
from fringeworks.types import BoolMap, FloatMap

STATES = 2
"""Dark and bright."""

CHANGE = (0.46, 0.29)
"""Cost of neighbours that have a missing bit in different states, if it is the finest one, and of
every coarser one more: ln 3, because it changes at one pixel of three, and ln 2, over the 2.4 of a
pixel without a coordinate."""

FOLD_PX = 16
"""Distance along lines over which the direction of the coordinate is seen, camera px: over several
cells, but less than between most edges."""

ROUGH_BIT = 0.6
"""Mean bend where a bit changes from which on other orders are tried: up to 0.5 in order, 0.9 and
more where the bit is in a wrong place."""

MIN_CHANGES = 6
"""Smallest number of changes of a bit for a statement about it."""

STEEP = 2.0
"""Slope up to which the coordinate may change over a gap, over the mean slope of the lines."""

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


def rough_bit(
    gray: GrayFrames,
    x: FloatMap,
    triples: tuple[FloatMap, BoolMap],
    lit: BoolMap,
    jump_px: float,
) -> bool:
    """Whether the coordinate jumps where a bit of the Gray code changes.

    Where the changing bit is blurred, pixels have no coordinate: those on either side of such a gap
    are compared as well.

    Parameters
    ----------
    gray : GrayFrames
        Of two levels.
    x : (r, l) array
        Coordinates along lines, projector px; NaN where they are not known.
    triples : (r, l − 2) arrays
        Cost of the bend of every pixel with its neighbours, and where it counts.
    lit : (r, l) bool array
    jump_px : float
        Smallest jump over a gap, besides what a slope makes.

    Returns
    -------
    bool
    """
    bend, known = triples
    place = (np.nan_to_num(x) + 0.5 - gray.offset_px) / gray.step_px
    cells = np.maximum(place, 0.0).astype(np.int32)
    words = (cells ^ (cells >> 1)).ravel()
    before, after, jump = jumps_over_gaps(x, lit, jump_px)
    gaps = words[before] ^ words[after]
    one = gaps & (gaps - 1) == 0  # several change at the edges of bodies
    near = words.reshape(x.shape)[:, 2:] ^ words.reshape(x.shape)[:, :-2]
    changes = np.concatenate((near[known], gaps[one]))
    bends = np.concatenate((bend[known], jump[one]))
    for bit in range(len(gray.bits)):
        at = bends[(changes >> bit) & 1 != 0]
        if at.size >= MIN_CHANGES and float(np.mean(at)) > ROUGH_BIT:
            return True
    return False


def jumps_over_gaps(
    x: FloatMap, lit: BoolMap, jump_px: float
) -> tuple[NDArray[np.intp], NDArray[np.intp], FloatMap]:
    """Where the coordinate jumps over lit pixels that have none, as those of a blurred border.

    Parameters
    ----------
    x : (r, l) array
        Coordinates along lines, projector px; NaN where they are not known.
    lit : (r, l) bool array
    jump_px : float
        Smallest jump, besides what a slope as steep as any makes.

    Returns
    -------
    before, after : (n,) arrays
        Flat indices of the pixels on either side of every gap.
    jump : (n,) array
        1 where the coordinate jumps, else 0.
    """
    known = np.isfinite(x) & lit
    seen = np.flatnonzero(known)
    before, after = seen[:-1], seen[1:]
    dark = np.cumsum(~lit.ravel())
    gap = (after - before > 1) & (after // x.shape[1] == before // x.shape[1])
    gap &= dark[after] == dark[before]
    before, after, flat = before[gap], after[gap], x.ravel()
    steps = np.fmin(np.abs(np.diff(x, axis=1)), jump_px)[known[:, 1:] & known[:, :-1]]
    steepest = STEEP * float(np.mean(steps)) if steps.size else 0.0
    moved = np.abs(flat[after] - flat[before]) - steepest * (after - before)
    return before, after, (moved > jump_px).astype(float)
