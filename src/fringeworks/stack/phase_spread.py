"""Ripple of a response from how the phases of many fringes are spread.

Surfaces that many fringes cross show each phase equally often. A response that is not linear moves
the phases, so that some are seen more often than others. The cumulative share of the phases gives
the error of each. Relief of the surface, which within one fringe looks like ripple, cancels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.patterns.order_chain import TURN
from fringeworks.stack.ripple import (
    LINES_NOISE_ALONE,
    MIN_PLACES,
    RESPONSE_ORDER,
    SIGNIFICANT_AMPLITUDE,
    Ripple,
    usual_rad,
)
from fringeworks.types import BoolMap, FloatMap

PLACES = 12
"""Number of parts that lines are divided into: the scatter of twelve is known to 20 %."""

ALIKE = 3.0
"""Largest difference of the two ways of measuring a ripple, in standard deviations."""

SELECTED = 0.25
"""Amplitude times order that phases missing near limits make, over the share of pixels there. A
limit amid them leaves out half of the phases at most, which moves the mean by 2/π, and half as much
on average over its place; evenly from zero to twice that, its standard deviation is a quarter."""

MOST_ALIGNED = 0.5
"""Largest modulus of the mean of e^{iφ} along lines: a line that crosses one and a half fringes has
0.2, and one along the fringes has 1. Phases of such lines are no more than the lines are."""

SMOOTHED = 0.02
"""Error of an amplitude, as a share of it, because noise of the phases evens out their spread. In
simulations of γ = 2.2 it is 0.012 at 0.03 rad of noise."""


@dataclass(frozen=True)
class Evidence:
    """Ripple in the orders that a response makes: multiples of the number of steps."""

    phasors_rad: NDArray[np.complex128]
    """As those of a ``Ripple``."""
    errors_rad: NDArray[np.float64]
    """Standard error of every amplitude, rad."""
    places: int
    """Number of places along the lines that show it."""
    clear: bool = True
    """Whether it is seen for certain."""


def spread_of(
    ripple: Ripple, phase_rad: FloatMap, used: BoolMap, steps: int, near_limits: float = 0.0
) -> Evidence | None:
    """Ripple of a response by the spread of the phases.

    Parameters
    ----------
    ripple : Ripple
        Its orders are looked for.
    phase_rad : (r, l) array
        Wrapped phases along r lines across the fringes, rad.
    used : (r, l) bool array
    steps : int
        Number of steps of the set.
    near_limits : float, 0 … 1
        Share of these pixels that would not be used at other phases, because a response moves their
        brightness beyond a limit.

    Returns
    -------
    Evidence; None where phases are at too few places, or lines lie along the fringes.

    Notes
    -----
    With F the cumulative share of the measured phases φ', the true phase is φ = 2π F(φ') and the
    error φ' − φ, where the true phases are spread evenly. The scatter of the mean of e^{ikφ'} over
    places along the lines tells how far they are from an even spread. Lines next to each other
    cross the same surface, and count once. To first order, an amplitude is 2/k of that mean.
    """
    orders = tuple(order for order in ripple.orders if order % steps == 0)
    spread = _Spread.of(phase_rad, used, (*range(1, RESPONSE_ORDER), *orders), near_limits)
    if spread is None:
        return None
    seen = _phasors(phase_rad[used], orders)
    errors = np.hypot([spread.error(k) for k in orders], SMOOTHED * np.abs(seen))
    # A projector's pixel grid makes a higher order, which is then the largest.
    clear = spread.clear(orders[0]) and int(np.argmax(np.abs(seen))) == 0
    return Evidence(seen, errors, spread.places, clear)


def with_spread(ripple: Ripple, spread: Evidence | None, steps: int) -> Ripple:
    """Combine a ripple that lines show at few places with that from the spread of phases.

    Parameters
    ----------
    ripple : Ripple
        As lines show it.
    spread : Evidence, optional
    steps : int
        Number of steps of the set.

    Returns
    -------
    Ripple
        The mean of both, weighted by the inverse of their variances, in the orders that a response
        makes. The ripple of the lines where that of the spread is not clear. Where the two differ,
        that of the spread if the surface is rough: relief at few places looks like ripple along
        lines, whatever their errors say. Otherwise that of the lines.
    """
    if spread is None or not spread.clear:
        return ripple
    response = [k for k, order in enumerate(ripple.orders) if order % steps == 0]
    seen, errors = spread.phasors_rad, spread.errors_rad
    lines, of_lines = ripple.phasors_rad[response], ripple.errors_rad[response]
    alike = abs(seen[0] - lines[0]) < ALIKE * np.hypot(errors[0], of_lines[0])
    if not (alike or ripple.excess > LINES_NOISE_ALONE):
        return ripple
    sources = [Evidence(lines, of_lines, 0), spread] if alike else [spread]
    phasors, all_errors = ripple.phasors_rad.copy(), ripple.errors_rad.copy()
    phasors[response], all_errors[response] = mean_of(sources)
    found = replace(ripple, phasors_rad=phasors, errors_rad=all_errors, places=spread.places)
    return replace(found, error_rad=_error_rad(found, steps))


def mean_of(sources: list[Evidence]) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """The mean of independent evidence, weighted by the inverse of its variances, and its error."""
    weights = [source.errors_rad**-2.0 for source in sources]
    total = np.sum(weights, axis=0)
    pairs = zip(weights, sources, strict=True)
    return sum(w * source.phasors_rad for w, source in pairs) / total, total**-0.5


def _error_rad(ripple: Ripple, steps: int) -> float:
    """Error of the sum over the orders that count, rms, rad.

    Relief along the lines is in the errors of the other ones, which are left as they are: those of
    a response may hide as much as it usually makes.
    """
    unsure = [
        float(error) if ripple.significant(order) != 0 else min(error, usual_rad(order, steps))
        for order, error in zip(ripple.orders, ripple.errors_rad, strict=True)
        if order % steps == 0 or ripple.significant(order) != 0
    ]
    return float(np.hypot.reduce(unsure))


@dataclass(frozen=True)
class _Spread:
    """How uneven phases are, by order k."""

    sizes_rad: dict[int, float]
    """2/k of the modulus of the mean of e^{ikφ'}."""
    scatter_rad: dict[int, float]
    """Its standard deviation, by the scatter over places."""
    places: int
    near_limits: float

    @classmethod
    def of(
        cls, phase_rad: FloatMap, used: BoolMap, orders: tuple[int, ...], near_limits: float
    ) -> _Spread | None:
        """That of some pixels of lines; None where they are at too few places."""
        starts = np.linspace(0, used.shape[1], PLACES, endpoint=False).astype(int)
        counts = np.add.reduceat(np.count_nonzero(used, axis=0), starts)
        places, total = int(np.count_nonzero(counts)), int(counts.sum())
        if places < MIN_PLACES:
            return None
        columns, lines = _core.column_harmonics(np.asarray(phase_rad, np.float32), used, orders)
        if np.hypot(*lines).sum() > MOST_ALIGNED * total:
            return None  # fringes lie along the lines
        sizes, scatter = {}, {}
        waves = np.add.reduceat(columns, starts, axis=1)
        for order, (cosine, sine) in zip(orders, waves.reshape(-1, 2, PLACES), strict=True):
            sums = cosine + 1j * sine
            off = sums - counts * sums.sum() / total
            square = 0.5 * float(np.sum(np.abs(off) ** 2)) * places / (places - 1.0)
            sizes[order] = 2.0 / order * abs(complex(sums.sum())) / total
            scatter[order] = 2.0 / order * square**0.5 / total
        return cls(sizes, scatter, places, near_limits)

    def error(self, order: int) -> float:
        """Standard error of an amplitude, rad. The products of what is uneven in low orders look
        like ripple of higher ones, and so do phases that are missing near limits."""
        uneven = sum(self.sizes_rad[k] ** 2 for k in range(1, RESPONSE_ORDER))
        others = np.hypot(0.5 * order * uneven, SELECTED * self.near_limits / order)
        return float(np.hypot(self.scatter_rad[order], others))

    def clear(self, order: int) -> bool:
        """Whether ripple of an order is seen for certain."""
        return self.sizes_rad[order] > SIGNIFICANT_AMPLITUDE * self.error(order)


def _phasors(measured_rad: FloatMap, orders: tuple[int, ...]) -> NDArray[np.complex128]:
    """Phasors of the error by the spread of the phases, rad."""
    measured = np.sort(np.mod(measured_rad.astype(np.float64), TURN))
    true = TURN * (np.arange(measured.size) + 0.5) / measured.size
    start = float(np.mean(measured - true))  # the phase that the cumulative share begins with
    error, true = measured - true - start, true + start
    return np.array([2.0 * np.mean(error * np.exp(1j * k * true)) for k in orders])
