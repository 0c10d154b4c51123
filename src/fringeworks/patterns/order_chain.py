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

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.chain_search import (
    ALTERNATIVE_SIGMAS,
    COMMENSURATE,
    ORDER_SIGMAS,
    binding,
    combinations,
    roundings,
    undominated,
    widest_path,
)
from fringeworks.types import Frozen, InputError

TURN = 2.0 * np.pi
"""One turn, rad."""

ORDER_VARIANCE = (25.0 / 3.0, 111.0)
"""Coefficients of u² and u³ in the phase variance that roundings are judged by, over that of u.

u is the variance of a phase, rad², with the measured modulation in place of the true one. It is too
small where noise has made the modulation larger, and such pixels pass a test more often. The phase
of a weak fringe is not Gaussian either. If all true modulations are equally likely, the sine of the
error is Gaussian with the variance u. Five standard deviations of it are an error of asin(5 √u),
and (asin(5 √u) / 5)² = u + 25/3 u² + 111 u³ + … The first three terms
raise the variance by half at a modulation of five standard deviations and by 1 % at thirty.
"""

CODED_ORDER_VARIANCE = (1.0, 0.0)
"""The same with a Gray code: the variance is right on average.

A Gray code refuses a coordinate in a neighbouring period by its own cell, so nothing is added.
"""

MAX_END_LOSS = 0.01
"""Share of the range in which the first combination may wrap at the smallest accepted margin.

Noise wraps the first combination from one end of its period to the other. If its period is little
longer than the range, pixels near both ends of the range are ambiguous. The margin of the first
combination is stated for this loss: 1 % of the range, half of it at each end. A smaller loss would
refuse plans that measure nearly the whole projector. An empirical choice.
"""

SEARCH_END_LOSS = 0.25
"""Share of the range that the search for a chain gives up at its ends, at the same margin.

A first combination with a longer period wraps farther outside the range, but it has larger
coefficients, and then all pixels need more light. Of periods such as 13.81 and 14.38 px on 640 px,
it would need 2.4 times as much; at 25 %, the search accepts the loss there. An empirical choice.
"""

END_SIGMAS = ALTERNATIVE_SIGMAS + 2.0
"""Distance from the next alternative at which few estimates are refused, in standard deviations.

The decoder refuses estimates within ``ALTERNATIVE_SIGMAS``. The estimates scatter themselves: 2 %
of them by more than two standard deviations towards the alternative.
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

It holds for cells of 0.67 periods or more, and says how much noise a plan bears. The decoder judges
each pixel by itself: it asks the neighbours of those near the ends of their cell that noise could
move by a period, at this error a fifth of all, with cells of one period. An empirical choice.
"""


@dataclass(frozen=True, eq=False, repr=False)
class OrderChain(Frozen):
    """A sequence of roundings that resolves the fringe orders of several periods.

    The first combination, or the Gray code, gives the coordinate over the whole range. Every
    further combination refines it: x ← x + wrap(c·t − g x) / g. Here t are the phases in turns, c
    the coefficients of the combination and g = c·f its frequency. The wrapped difference is the
    remainder of the rounding; the remainders of the phases themselves come last.
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
    """Largest error of every rounding that still gives the right order, (R,), turns.

    For the first combination without a Gray code: the error at which 1 % of the range is lost,
    because noise could wrap the combination there.
    """
    largest_sigma: NDArray[np.float64]
    """Largest standard deviation of the error of every rounding, (R,), turns: ``ORDER_SIGMAS`` of
    it are tolerated. With a Gray code, whose cell refuses most wrong orders, up to which those are
    safe that need no test of their own beside it; infinite where there is none. Without, errors
    that are no noise count where the fringes are weak."""
    remainder: NDArray[np.intp]
    """Index of the remainder of every rounding, (R,): 0 … K − 1 for the combinations, then the M
    phases."""
    alternative: NDArray[np.float64]
    """Distance from a remainder of zero to the nearest one of another coordinate in the range,
    (R,), turns: 1, and less where the first combination wraps little beyond the range."""
    order_variance: tuple[float, float]
    """Coefficients of σ⁴ and σ⁶ in the phase variance that roundings are judged by."""

    @property
    def wraps(self) -> NDArray[np.bool_]:
        """Roundings, (R,), that fail near the ends of the range only: that of the first combination
        without a Gray code."""
        return self.alternative < 1.0

    @property
    def frequencies(self) -> NDArray[np.float64]:
        """Frequencies g of the combinations, (K,), turns per px."""
        frequencies: NDArray[np.float64] = self.combinations @ (1.0 / np.asarray(self.periods_px))
        return frequencies

    def margin(self, sigma_rad: Sequence[float] | NDArray[np.float64] | float) -> float:
        """Smallest margin of all roundings, in standard deviations of their error.

        The margin of the first combination, which noise may wrap from one end of the range to the
        other, is stated so that at most 1 % of the range is lost at a margin of ``ORDER_SIGMAS``.

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

    def judged_sigma(self, sigma_rad: Sequence[float]) -> NDArray[np.float64]:
        """Standard deviations that the decoder judges roundings by, (M,), rad.

        They exceed those of the phases where fringes are weak.

        Parameters
        ----------
        sigma_rad : (M,) floats
            Standard deviation of the phases, rad.
        """
        sigma = np.asarray(sigma_rad, np.float64)
        second, third = self.order_variance
        return sigma * np.sqrt(1.0 + sigma**2 * (second + third * sigma**2))


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
    circular: bool = False,
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
    circular : bool
        True where both ends of the range are the same place, so that none of it is lost there.

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
    return _chains(periods_px, range_px, weights, gray_step_px, circular)[0]


def coded_chains(
    periods_px: Sequence[float],
    range_px: tuple[float, float],
    *,
    weights: Sequence[float] | None = None,
    gray_step_px: float,
) -> tuple[OrderChain, ...]:
    """The chain that tolerates the most phase noise, and the best one from every other phase that
    may start from the Gray code.

    Parameters
    ----------
    periods_px, range_px, weights, gray_step_px : as for ``order_chain``

    Returns
    -------
    tuple of OrderChain, that of ``order_chain`` first

    Raises
    ------
    InputError
        As ``order_chain``.

    Notes
    -----
    A beat that spans several cells bears borders of the code that lie anywhere, but has the noise
    of all its phases at every pixel. A phase that spans one cell has its own noise only, and asks
    neighbours beside the borders. Which loses less depends on the noise of the frames.

    Examples
    --------
    >>> chains = coded_chains([200 / 3, 100.0], (-0.5, 1919.5), gray_step_px=100.0)
    >>> [[round(1.0 / g) for g in chain.frequencies] for chain in chains]
    [[200], [100]]
    """
    return _chains(periods_px, range_px, weights, gray_step_px, circular=False, all_starts=True)


def _chains(
    periods_px: Sequence[float],
    range_px: tuple[float, float],
    weights: Sequence[float] | None,
    gray_step_px: float | None,
    circular: bool,
    *,
    all_starts: bool = False,
) -> tuple[OrderChain, ...]:
    """The chain with the largest margin; with ``all_starts``, the best one from every other phase
    that may start as well."""
    low, high = (float(v) for v in range_px)
    length = high - low
    frequency = 1.0 / np.asarray(periods_px, float)
    sigma = 1.0 / np.sqrt(np.ones(len(periods_px)) if weights is None else np.asarray(weights))
    repeats = repeat_distance(periods_px, length)
    if gray_step_px is None and repeats < length * (1.0 - COMMENSURATE):
        raise InputError(
            f"periods: {_list(periods_px)} px repeat after {repeats:g} px, but the projector "
            f"has {length:g} px: expected another period, a Gray code, or a rig and a depth range"
        )
    c, g = combinations(frequency)
    starts, start_tolerance = _starts(g, length, repeats, gray_step_px, circular)
    if not starts.any():
        raise InputError(_too_short(periods_px, g, length, gray_step_px))
    paths = [widest_path(c, g, sigma, starts, start_tolerance, frequency)]
    if all_starts:
        kept = undominated(g, np.sqrt((c**2) @ sigma**2))
        phases = kept[starts[kept] & (np.abs(c[kept]).sum(axis=1) == 1)]
        for start in phases[phases != paths[0][0]]:
            only = np.arange(g.size) == start
            paths.append(widest_path(c, g, sigma, only, start_tolerance, frequency))
    return tuple(
        _chain_of(
            periods_px,
            (low, high),
            c[path],
            g[path],
            start_tolerance[path[0]],
            gray_step_px,
            circular,
        )
        for path in paths
    )


def _chain_of(
    periods_px: Sequence[float],
    range_px: tuple[float, float],
    c: NDArray[np.float64],
    g: NDArray[np.float64],
    start_tolerance: float,
    gray_step_px: float | None,
    circular: bool,
) -> OrderChain:
    """The chain of some combinations, with the roundings that can fail."""
    low, high = range_px
    length, repeats = high - low, repeat_distance(periods_px, high - low)
    rows, tolerance = roundings(c, g, start_tolerance, 1.0 / np.asarray(periods_px, float))
    (used, largest), alternative = binding(rows, tolerance), np.ones(tolerance.size)
    if gray_step_px is None:
        # The first combination fails by wrapping only, unless all phases repeat with it.
        used[1:], _ = binding(rows[1:], tolerance[1:])
        used[0] = abs(repeats * g[0] - 1.0) >= COMMENSURATE
        alternative[0] = 0.5 if circular else 1.0 - 0.5 * min(length * g[0], 1.0)
        if not circular:
            tolerance[:1] = _end_tolerance(g[:1], length, repeats, MAX_END_LOSS)
    return OrderChain(
        periods_px=tuple(float(p) for p in periods_px),
        low_px=low,
        high_px=high,
        repeats_px=repeats,
        combinations=c,
        amplification=rows[used],
        tolerance=tolerance[used],
        largest_sigma=tolerance[used] / ORDER_SIGMAS if gray_step_px is None else largest[used],
        remainder=np.flatnonzero(used),
        alternative=alternative[used],
        order_variance=ORDER_VARIANCE if gray_step_px is None else CODED_ORDER_VARIANCE,
    )


def _starts(
    g: NDArray[np.float64],
    length: float,
    repeats: float,
    gray_step_px: float | None,
    circular: bool,
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Combinations that can start a chain, and their tolerance, turns."""
    if gray_step_px is not None:
        reach = GRAY_REACH * gray_step_px
        starts = g * gray_step_px <= 1.0 + COMMENSURATE
        return starts, np.maximum(0.5 - g * reach, MIN_GRAY_TOLERANCE)
    starts = g * length <= 1.0 + COMMENSURATE
    if circular:
        return starts, np.full(g.size, np.inf)
    return starts, _end_tolerance(g, length, repeats, SEARCH_END_LOSS)


def _end_tolerance(
    g: NDArray[np.float64], length: float, repeats: float, loss: float
) -> NDArray[np.float64]:
    """Errors of first combinations at which the ends of the range lose a share ``loss``, turns.

    An estimate at the distance d from one end of the range is right if its error is smaller than
    1/g − L + d, because the coordinate would lie beyond the other end otherwise. Infinite where all
    phases repeat with the combination: a wrapped coordinate is then moved back by that distance.
    """
    kept = (1.0 - 0.5 * loss) * np.minimum(length * g, 1.0)
    tolerance = (1.0 - kept) * ORDER_SIGMAS / END_SIGMAS
    whole = np.abs(repeats * g - 1.0) < COMMENSURATE
    return np.asarray(np.where(whole, np.inf, tolerance))


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


def _list(periods_px: Sequence[float]) -> str:
    return ", ".join(f"{p:g}" for p in periods_px)


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
