"""Temporal unwrapping: the fringe orders of several periods, proved before anything is projected.

M wrapped phases give a coordinate modulo each of the M periods. An integer combination of the
phases is the phase of another, usually longer, period; the difference of two phases is the beat of
heterodyning. A chain of such combinations starts with one that spans the projector and leads to the
periods themselves. Every step of the chain resolves a fringe order by one rounding. The phase
noise that a chain tolerates follows from the periods alone, so a plan can be checked beforehand.
Hierarchical, heterodyne and number-theoretic periods differ in their chain only (theory §5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from fringeworks.types import Frozen, InputError

TURN = 2.0 * np.pi
"""One turn, rad."""

ORDER_SIGMAS = 5.0
"""Margin that every rounding of a fringe order must have, in standard deviations of its error.

Gaussian errors exceed five standard deviations once in 1.7 million roundings, about once in a frame
of two megapixels. A larger margin would turn more noisy pixels into NaN.
"""

MAX_COMBINATIONS = 20_000
"""Largest number of integer combinations that the search for a chain tries.

It limits the time of the search to a fraction of a second. An empirical choice: it allows
coefficients up to 64 for two periods, 13 for three and 5 for four.
"""

MAX_COEFFICIENT = 64
"""Largest coefficient of a combination.

The error of a combination grows with its coefficients, so larger ones rarely lead to a better
chain. The limit only matters for one or two periods; with more, ``MAX_COMBINATIONS`` is reached
first. An empirical choice.
"""

COMMENSURATE = 1e-6
"""Relative tolerance within which a distance holds a period a whole number of times.

It lies far above the rounding of double precision (1e-16), so that periods such as 1920/59 px
count as exact, and far below any difference that can be measured: 0.002 px over 1920 px.
"""

ROUNDING = 1e-9
"""Relative tolerance for the rounding of double precision in comparisons.

The sums here err by less than 1e-13, and real differences between combinations are larger than
1e-6.
"""

REPEAT_SEARCH = 4.0
"""Repeat distances are searched up to this multiple of the range.

A repeat distance only helps while noise at one end of the range can reach the other end through it;
that is not the case for distances of several ranges. An empirical choice.
"""

GRAY_REACH = 0.6
"""Largest accepted distance of a coordinate from the middle of its Gray-code cell, in cells.

A coordinate lies up to 0.5 cells from the middle of its cell. The other 0.1 allow for the borders
of the cells, which blur and the decision threshold shift a little. An empirical choice: the larger
the reach, the shorter are the cells that a period needs.
"""

MIN_GRAY_TOLERANCE = 0.1
"""Smallest error that the rounding after a Gray code tolerates, turns of the first combination.

It holds for cells of 0.67 periods or more. The decoder refuses pixels near the ends of their cell
that noise could move by a period: at this error a fifth of all, with cells of one period. A smaller
value would refuse more noisy pixels as a whole. An empirical choice.
"""


@dataclass(frozen=True, eq=False, repr=False)
class OrderChain(Frozen):
    """A sequence of roundings that resolves the fringe orders of several periods.

    The first combination, or the Gray code, gives the coordinate over the whole range. Every
    further combination refines it: x ← x + wrap(c·t − g x) / g. Here t are the phases in turns, c
    the coefficients of the combination and g = c·f its frequency.
    """

    periods_px: tuple[float, ...]
    """Periods p_m of the M phases, projector px; their frequencies are f = 1/p."""
    low_px: float
    """Smallest coordinate, projector px."""
    high_px: float
    """Largest coordinate, projector px."""
    repeats_px: float
    """Distance after which all phases repeat, projector px; infinity where there is none."""
    combinations: NDArray[np.float64]
    """Integer coefficients c, (K, M), from the longest period to the shortest."""
    amplification: NDArray[np.float64]
    """Error of every rounding per phase error, (R, M), turns per turn."""
    tolerance: NDArray[np.float64]
    """Largest error of every rounding that still gives the right order, (R,), turns."""

    @property
    def frequencies(self) -> NDArray[np.float64]:
        """Frequencies g of the combinations, (K,), turns per px."""
        frequencies: NDArray[np.float64] = self.combinations @ (1.0 / np.asarray(self.periods_px))
        return frequencies

    def margin(self, sigma_rad: Sequence[float] | float) -> float:
        """Smallest margin of all roundings, in standard deviations of their error.

        Parameters
        ----------
        sigma_rad : float or (M,) floats
            Standard deviation of the phases, rad.

        Returns
        -------
        float ≥ 0; infinity where no rounding is needed.
        """
        sigma = np.broadcast_to(np.asarray(sigma_rad, float) / TURN, len(self.periods_px))
        spread = np.sqrt((self.amplification**2) @ sigma**2)
        with np.errstate(divide="ignore"):
            return float(np.min(self.tolerance / spread, initial=np.inf))

    @property
    def largest_sigma_rad(self) -> float:
        """Phase noise at which the smallest margin is ``ORDER_SIGMAS``, rad."""
        return self.margin(1.0) / ORDER_SIGMAS


def repeat_distance(periods_px: Sequence[float], up_to_px: float) -> float:
    """Shortest distance that holds every period a whole number of times, projector px.

    Parameters
    ----------
    periods_px : (M,) floats > 0
    up_to_px : float > 0
        Length of the range, projector px.

    Returns
    -------
    float; infinity where no distance up to four times ``up_to_px`` does.

    Examples
    --------
    >>> repeat_distance([30.0, 40.0], 1920.0)
    120.0
    """
    first = max(periods_px)
    count = np.arange(1, max(int(REPEAT_SEARCH * up_to_px / first), 1) + 1)
    turns = first * count[:, None] / np.asarray(periods_px)
    off = np.abs(turns - np.rint(turns)) / np.maximum(turns, 1.0)
    whole = np.flatnonzero((off < COMMENSURATE).all(axis=1))
    return float(first * count[whole[0]]) if whole.size else float("inf")


def order_chain(
    periods_px: Sequence[float],
    range_px: tuple[float, float],
    *,
    weights: Sequence[float] | None = None,
    gray_step_px: float | None = None,
) -> OrderChain:
    """Find the chain of combinations that tolerates the most phase noise.

    Parameters
    ----------
    periods_px : (M,) floats > 0
        Periods of the fringes, projector px.
    range_px : (low, high)
        Range in which coordinates must be unambiguous, projector px.
    weights : (M,) floats > 0, optional
        Relative inverse variances of the phases; equal where not given.
    gray_step_px : float > 0, optional
        Width of the cells of a Gray code over the range, projector px.

    Returns
    -------
    OrderChain

    Raises
    ------
    InputError
        If the periods do not determine the coordinate in the range.

    Notes
    -----
    A combination c of the phases t has the frequency g = c·f and the error c·ε, with ε the phase
    errors in turns. The step to a finer combination c' is a rounding. Its error is
    (c' − (g'/g) c)·ε and must stay below half a turn. The chain with the largest smallest margin is
    a widest path through the combinations; a combination is left out if another one is both longer
    and more accurate. Theory §5; heterodyne beats: Reich, Ritter & Thesing, SPIE 3100, 1997; number
    theory: Gushov & Solodkin, Opt. Lasers Eng. 14:311, 1991.

    Examples
    --------
    >>> chain = order_chain([960.0, 120.0, 15.0], (-0.5, 959.5))
    >>> [round(1.0 / g) for g in chain.frequencies]
    [960, 120]
    """
    low, high = (float(v) for v in range_px)
    length = high - low
    frequency = 1.0 / np.asarray(periods_px, float)
    sigma = 1.0 / np.sqrt(np.ones(len(periods_px)) if weights is None else np.asarray(weights))
    repeats = repeat_distance(periods_px, length)
    if gray_step_px is None and repeats < length * (1.0 - COMMENSURATE):
        raise InputError(
            f"periods: {_list(periods_px)} px repeat after {repeats:g} px, but the projector "
            f"has {length:g} px: expected another period or a Gray code"
        )
    c, g = _combinations(frequency)
    if gray_step_px is None:
        starts = g * length <= 1.0 + COMMENSURATE
        start_tolerance = np.full(g.size, np.inf)
    else:
        reach = GRAY_REACH * gray_step_px
        starts = g * gray_step_px <= 1.0 + COMMENSURATE
        start_tolerance = np.maximum(0.5 - g * reach, MIN_GRAY_TOLERANCE)
    if not starts.any():
        raise InputError(_too_short(periods_px, g, length, gray_step_px))
    path = _widest_path(c, g, sigma, starts, start_tolerance, frequency)
    rows, tolerance = _roundings(c[path], g[path], start_tolerance[path[0]], frequency)
    if gray_step_px is None:
        rows, tolerance = rows[1:], tolerance[1:]
    used = _binding(rows, tolerance)
    return OrderChain(
        periods_px=tuple(float(p) for p in periods_px),
        low_px=low,
        high_px=high,
        repeats_px=repeats,
        combinations=c[path],
        amplification=rows[used],
        tolerance=tolerance[used],
    )


def _too_short(
    periods_px: Sequence[float],
    g: NDArray[np.float64],
    length: float,
    gray_step_px: float | None,
) -> str:
    """Message for periods of which no combination can start a chain."""
    longest = f"{1.0 / g.min():g}" if g.size else "0"
    message = f"periods: {_list(periods_px)} px and their beats span {longest} px, expected "
    if gray_step_px is None:
        return message + f"the projector's {length:g} px or more"
    return message + (
        f"{gray_step_px:g} px or more for Gray-code cells of {gray_step_px:g} px "
        f"(recommended: {2.0 * gray_step_px:g} px)"
    )


def _binding(rows: NDArray[np.float64], tolerance: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mark the roundings that can fail while all other roundings are right."""
    load = np.abs(rows) / tolerance[:, None]
    kept = np.asarray(np.abs(rows).sum(axis=1) > 0)
    for k in range(len(rows)):
        others = kept.copy()
        others[k] = False
        if kept[k] and np.any(np.all(load[others] >= load[k], axis=1)):
            kept[k] = False
    return kept


def _list(periods_px: Sequence[float]) -> str:
    return ", ".join(f"{p:g}" for p in periods_px)


def _combinations(
    frequency: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Coefficients and frequencies of combinations with a positive frequency, none above the
    highest of the phases."""
    m = frequency.size
    sizes = range(MAX_COEFFICIENT, 0, -1)
    largest = next((r for r in sizes if (2 * r + 1) ** m <= MAX_COMBINATIONS), 0)
    if largest:
        c = np.array(list(product(range(-largest, largest + 1), repeat=m)), float)
    else:  # too many periods for a full search: only the phases and their differences
        unit = (*np.eye(m), np.zeros(m))
        c = np.array([a - b for a in unit for b in unit])
    g = c @ frequency
    wanted = (g > COMMENSURATE * frequency.max()) & (g <= frequency.max() * (1.0 + ROUNDING))
    return c[wanted], g[wanted]


def _widest_path(
    c: NDArray[np.float64],
    g: NDArray[np.float64],
    sigma: NDArray[np.float64],
    starts: NDArray[np.bool_],
    start_tolerance: NDArray[np.float64],
    frequency: NDArray[np.float64],
) -> NDArray[np.intp]:
    """Indices of the combinations of the chain with the largest smallest margin."""
    spread = np.sqrt((c**2) @ sigma**2)
    nodes = _undominated(g, spread)
    c, g = c[nodes], g[nodes]
    margin = np.where(starts[nodes], start_tolerance[nodes] / spread[nodes], 0.0)
    before = np.full(nodes.size, -1)
    # By rising frequency, so that all predecessors of a combination are final.
    for j in range(1, nodes.size):
        step = c[j] - (g[j] / g[:j])[:, None] * c[:j]
        with np.errstate(divide="ignore"):
            reached = np.minimum(margin[:j], 0.5 / np.sqrt((step**2) @ sigma**2))
        i = int(np.argmax(reached))
        if reached[i] > margin[j]:
            margin[j], before[j] = reached[i], i
    final = np.empty(nodes.size)
    for j in range(nodes.size):
        step = np.eye(frequency.size) - (frequency / g[j])[:, None] * c[j]
        with np.errstate(divide="ignore"):
            final[j] = min(margin[j], float(np.min(0.5 / np.sqrt((step**2) @ sigma**2))))
    path = [int(np.argmax(final))]
    while before[path[-1]] >= 0:
        path.append(int(before[path[-1]]))
    return nodes[path[::-1]]


def _undominated(g: NDArray[np.float64], spread: NDArray[np.float64]) -> NDArray[np.intp]:
    """Indices of combinations that no longer one beats in accuracy, by rising frequency."""
    kept: list[int] = []
    least = np.inf
    for k in np.lexsort((spread, g)):
        if spread[k] / g[k] < least * (1.0 - ROUNDING):
            least = spread[k] / g[k]
            kept.append(int(k))
    return np.array(kept)


def _roundings(
    c: NDArray[np.float64],
    g: NDArray[np.float64],
    start_tolerance: float,
    frequency: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Amplification of the phase errors by every rounding of a chain, and its tolerance."""
    rows, tolerance = [c[0]], [start_tolerance]
    for k in range(1, g.size):
        rows.append(c[k] - (g[k] / g[k - 1]) * c[k - 1])
        tolerance.append(0.5)
    for m in range(frequency.size):
        rows.append(np.eye(frequency.size)[m] - (frequency[m] / g[-1]) * c[-1])
        tolerance.append(0.5)
    amplification = np.array(rows)
    amplification[np.abs(amplification) < ROUNDING] = 0.0
    return amplification, np.array(tolerance)


def separation(
    periods_px: Sequence[float], length_px: float, weights: Sequence[float] | None = None
) -> float:
    """Smallest distance between the phases of two coordinates whose fringe orders differ.

    Parameters
    ----------
    periods_px : (M,) floats > 0
        Periods of the fringes, projector px.
    length_px : float > 0
        Length of the range, projector px.
    weights : (M,) floats > 0, optional
        Inverse variances of the phases in turns; 1 where not given.

    Returns
    -------
    float ≥ 0, in standard deviations of the phases, or in turns where no weights are given;
    infinity where the range is shorter than every period.

    Notes
    -----
    Maximum likelihood chooses the wrong order where the noise exceeds half of this distance. No
    chain of roundings tolerates more (theory §5).

    Examples
    --------
    >>> round(separation([30.0, 40.0], 60.0), 2)
    0.2
    """
    frequency = 1.0 / np.asarray(periods_px, float)
    weight = np.ones(frequency.size) if weights is None else np.asarray(weights, float)
    # Phases over the coordinate are parallel lines modulo one turn. Two of them come closest where
    # one phase has made a whole number of turns.
    at = np.concatenate(
        [p * np.arange(1, int(length_px / p * (1.0 - COMMENSURATE)) + 1) for p in periods_px]
    )
    if at.size == 0:
        return float("inf")
    turns = frequency[:, None] * at
    off = turns - np.rint(turns)
    along = (weight * frequency) @ off / np.sqrt(weight @ frequency**2)
    across = weight @ off**2 - along**2
    return float(np.sqrt(max(across.min(), 0.0)))
