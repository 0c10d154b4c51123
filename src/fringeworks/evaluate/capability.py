"""How well a process keeps a tolerance: its spread, Cp and Cpk, with their confidence intervals."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
import scipy

from fringeworks.types import FloatMap, Frozen

RANGE_TO_SIGMA = 1.128
"""Mean difference of neighbours over their standard deviation, for normal numbers (d₂ of two)."""
RANGE_FREEDOM = 0.62
"""Degrees of freedom of a standard deviation from differences of neighbours, per part: what a
standard deviation of all parts would have 1 of (Wheeler, Advanced Topics in Statistical Process
Control, 1995)."""
CONTROL_SIGMAS = 3.0
"""Distance of control limits from the mean, and half of the spread that Cp counts, in standard
deviations of the process (ISO 7870-2, ISO 22514-2)."""
CONFIDENCE = 0.95
"""Probability that a confidence interval holds the process's own index."""
FEWEST = 2
"""Parts from which a spread can be estimated."""

Interval = tuple[float, float]


@dataclass(frozen=True, eq=False, repr=False)
class Capability(Frozen):
    """Spread of a process, and how it fits between the limits of a tolerance.

    Cp and Cpk use the differences of neighbouring parts (spread at short term), Pp and Ppk the
    standard deviation of all parts. NaN where an index needs a limit that the tolerance lacks, or
    more parts.
    """

    count: int
    """Parts with a value."""
    mean: float
    within: float
    """Standard deviation at short term, from the differences of neighbours."""
    overall: float
    """Standard deviation of all parts."""
    cp: float
    cp_interval: Interval
    cpk: float
    cpk_interval: Interval
    pp: float
    pp_interval: Interval
    ppk: float
    ppk_interval: Interval


def control_limits(values: FloatMap) -> tuple[float, float, float]:
    """Return mean and control limits of a process, from the differences of neighbours.

    Notes
    -----
    A drift hardly changes the differences, and therefore not the limits: it leaves them (Shewhart's
    chart of individuals; ISO 7870-2).
    """
    known = values[np.isfinite(values)]
    if known.size < FEWEST:
        return np.nan, np.nan, np.nan
    sigma, mean = _within(known), float(known.mean())
    return mean, mean - CONTROL_SIGMAS * sigma, mean + CONTROL_SIGMAS * sigma


def capability(values: FloatMap, low: float | None, high: float | None) -> Capability:
    """Estimate spread and indices of a process from its parts, in their order.

    Parameters
    ----------
    values : (n,) array
        NaN where a part was not measured.
    low, high : float, optional
        Limits of the tolerance.

    Notes
    -----
    Intervals hold the index with a probability of 95 % for normal values: that of Cp follows from
    the chi-square distribution, that of Cpk is Bissell's (Applied Statistics 39, 1990, 331–340).
    The spread contains the scatter of the measurement, so that the process itself is better.
    """
    known = np.asarray(values, np.float64)[np.isfinite(values)]
    if known.size < FEWEST:
        nothing = (np.nan, (np.nan, np.nan))
        mean = float(known.mean()) if known.size else np.nan
        return Capability(known.size, mean, np.nan, np.nan, *(2 * nothing), *(2 * nothing))
    mean, n = float(known.mean()), int(known.size)
    within, overall = _within(known), float(known.std(ddof=1))
    short = _indices(mean, within, n, RANGE_FREEDOM * (n - 1), (low, high))
    long = _indices(mean, overall, n, float(n - 1), (low, high))
    return Capability(n, mean, within, overall, *short, *long)


def _within(known: FloatMap) -> float:
    return float(np.mean(np.abs(np.diff(known)))) / RANGE_TO_SIGMA


def _indices(
    mean: float, sigma: float, n: int, freedom: float, limits: tuple[float | None, float | None]
) -> tuple[float, Interval, float, Interval]:
    """Cp and Cpk of a spread with their intervals; Cp needs both limits."""
    low, high = limits
    reach = CONTROL_SIGMAS * sigma
    sides = [*([] if low is None else [mean - low]), *([] if high is None else [high - mean])]
    if not sides or not reach > 0:
        return np.nan, (np.nan, np.nan), np.nan, (np.nan, np.nan)
    tail = 0.5 * (1.0 - CONFIDENCE)
    cp = np.nan if low is None or high is None else (high - low) / (2 * reach)
    chi = [2.0 * float(scipy.special.gammaincinv(0.5 * freedom, p)) for p in (tail, 1.0 - tail)]
    cpk = min(sides) / reach
    half = NormalDist().inv_cdf(1.0 - tail) * float(
        np.sqrt(1.0 / (CONTROL_SIGMAS**2 * n) + cpk**2 / (2.0 * freedom))
    )
    return (
        cp,
        (cp * float(np.sqrt(chi[0] / freedom)), cp * float(np.sqrt(chi[1] / freedom))),
        cpk,
        (cpk - half, cpk + half),
    )
