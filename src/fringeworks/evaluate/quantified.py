"""A quantity of a part with its uncertainty, and what noise adds to ranges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from fringeworks.surface.form import DISCARDED
from fringeworks.types import FloatMap

HALF_SIGMAS = 4.0
"""Upper end of the search for half of a range, standard deviations: 0.006 % of normal errors lie
beyond, which is less than the discarded 0.3 %."""
MOST_SIGMAS = 10_000
"""Approximate number of points, evenly thinned, from which the range of the noise is computed. All
points would change it by less than 1 %."""


@dataclass(frozen=True)
class Quantified:
    """A quantity that was measured."""

    value: float
    sigma: float
    """Standard deviation, of noise and of calibration."""
    unit: str
    noise: float = 0.0
    """By how much noise alone may have raised the value; 0 where it does not."""


def noise_range(sigma: FloatMap) -> float:
    """Return the range that holds 99.7 % of normal errors with these standard deviations."""
    step = max(1, len(sigma) // MOST_SIGMAS)
    known = np.maximum(sigma[::step], np.finfo(np.float64).tiny)

    def beyond(half: float) -> float:
        return float(np.mean(2.0 * scipy.special.ndtr(-half / known))) - DISCARDED

    return 2.0 * float(scipy.optimize.brentq(beyond, 0.0, HALF_SIGMAS * float(known.max())))


def narrowest_range(values: FloatMap) -> tuple[float, int, int]:
    """Return the narrowest range that holds 99.7 % of the values, and where its ends lie.

    Returns
    -------
    range, index of the largest and of the smallest value in it
    """
    order = np.argsort(values)
    kept = max(int(np.ceil((1.0 - DISCARDED) * order.size)), 1)
    ranges = values[order[kept - 1 :]] - values[order[: order.size - kept + 1]]
    first = int(np.argmin(ranges))
    return float(ranges[first]), int(order[first + kept - 1]), int(order[first])


def raised(value: float, noise: float) -> float:
    """Return by how much noise has raised a value: squares of noise and true value add up."""
    return value - float(np.sqrt(max(value**2 - noise**2, 0.0)))
