"""Ripple of a response from how the phases of many fringes are spread.

Surfaces that many fringes cross show each phase equally often. A response that is not linear moves
the phases, so that some are seen more often than others: the cumulative share of the phases tells
the error of each. Relief of the surface, which single fringes cannot be told from, cancels.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

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

SMOOTHED = 0.02
"""Share of an amplitude that noise of the phases takes or adds, because it evens out their spread:
0.012 at 0.03 rad of noise on ripple of γ = 2.2 in simulations."""


def with_spread(ripple: Ripple, phase_rad: FloatMap, used: BoolMap, steps: int) -> Ripple:
    """Add what the spread of phases tells of a ripple that lines show at few places.

    Parameters
    ----------
    ripple : Ripple
        As lines show it.
    phase_rad : (r, l) array
        Wrapped phases along r lines across the fringes, rad.
    used : (r, l) bool array
        Pixels whose light does not depend on their phase: none that are saturated at some phases.
    steps : int
        Number of steps of the set.

    Returns
    -------
    Ripple
        Both, weighted by their variances, where the orders that a response makes, multiples of the
        number of steps, are significant by the spread, and the largest one is the same both ways;
        otherwise the one of the lines. Where the surface is rough, relief at few places looks like
        ripple along lines, whatever their errors say: where they contradict it, the spread counts.

    Notes
    -----
    With F the cumulative share of the measured phases φ', the true phase is φ = 2π F(φ') and the
    error φ' − φ, where the true phases are spread evenly. How far they are from that is told by the
    scatter of the mean of e^{ikφ'} over places along the lines: lines next to each other cross the
    same surface, and count once. To first order, an amplitude is 2/k of that mean.
    """
    response = [k for k, order in enumerate(ripple.orders) if order % steps == 0]
    seen, errors, places = _harmonics(phase_rad, used, tuple(ripple.orders[k] for k in response))
    if places < MIN_PLACES:
        return ripple
    lines, of_lines = ripple.phasors_rad[response], ripple.errors_rad[response]
    largest = int(np.argmax(np.abs(seen)))
    off = abs(seen[largest] - lines[largest])
    alike = off < ALIKE * np.hypot(errors[largest], of_lines[largest])
    rough = ripple.excess > LINES_NOISE_ALONE
    if not (abs(seen[largest]) > SIGNIFICANT_AMPLITUDE * errors[largest] and (alike or rough)):
        return ripple
    if not alike:
        of_lines = np.full(len(response), np.inf)
    phasors, all_errors = ripple.phasors_rad.copy(), ripple.errors_rad.copy()
    weights = 1.0 / errors**2, 1.0 / of_lines**2
    phasors[response] = (weights[0] * seen + weights[1] * lines) / sum(weights)
    all_errors[response] = sum(weights) ** -0.5
    found = replace(ripple, phasors_rad=phasors, errors_rad=all_errors, places=places)
    return replace(found, error_rad=_error_rad(found, steps))


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


def _harmonics(
    phase_rad: FloatMap, used: BoolMap, orders: tuple[int, ...]
) -> tuple[NDArray[np.complex128], NDArray[np.float64], int]:
    """Phasors of the error by the spread of the phases, their standard errors, rad, and the number
    of places that they come from."""
    starts = np.linspace(0, used.shape[1], PLACES, endpoint=False).astype(int)
    counts = np.add.reduceat(used.sum(axis=0), starts)
    places = int(np.count_nonzero(counts))
    if places < MIN_PLACES:
        return np.zeros(len(orders), complex), np.ones(len(orders)), places
    measured = np.sort(np.mod(phase_rad[used].astype(np.float64), TURN))
    true = TURN * (np.arange(measured.size) + 0.5) / measured.size
    start = float(np.mean(measured - true))  # the phase that the cumulative share begins with
    error, true = measured - true - start, true + start
    phasors = np.array([2.0 * np.mean(error * np.exp(1j * k * true)) for k in orders])
    turned = np.where(used, np.exp(1j * phase_rad), 0.0)
    uneven = [2.0 / k * abs(np.sum(turned**k)) / measured.size for k in range(1, RESPONSE_ORDER)]
    errors = []
    for order, z in zip(orders, phasors, strict=True):
        sums = np.add.reduceat(np.sum(turned**order, axis=0), starts)
        off = sums - counts * sums.sum() / measured.size
        square = 0.5 * np.sum(np.abs(off) ** 2) * places / (places - 1.0)
        scatter = 2.0 / order * square**0.5 / measured.size
        # The products of what is uneven in low orders look like ripple of higher ones.
        products = 0.5 * order * np.sum(np.square(uneven))
        errors.append(np.sqrt(scatter**2 + products**2 + (SMOOTHED * abs(z)) ** 2))
    return phasors, np.array(errors), places
