"""The χ² distribution with a whole number of degrees of freedom, in closed form, and variances.

SciPy has it for any number, but importing its special functions takes longer than decoding a stack.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from fringeworks import _core
from fringeworks.types import FloatMap, InputError

MOST_STEPS = 200
"""Largest number of steps to a quantile; most take five, and halving alone takes fewer than 100."""
CONVERGED = 1e-14
"""Relative step at which a quantile has converged."""
TRIMMED = 0.9995
"""Share of Gaussian residuals that the variance is computed from; larger ones count as outliers.

The trimming costs next to no precision (0.05 % of the samples) and removes residuals above 3.5
standard deviations, such as those of moving edges. An empirical choice.
"""
TRIMMING_STEPS = 3
"""Steps of the trimmed variance; it starts at the median and changes little after the second."""


def chi_square_above(x: float, freedom: int) -> float:
    """Share of the distribution above ``x`` ≥ 0.

    Γ(k/2, x/2) / Γ(k/2), which is a finite sum for a whole k (Abramowitz & Stegun, Handbook of
    Mathematical Functions, 26.4.4 and 26.4.5).

    Examples
    --------
    >>> round(chi_square_above(3.84, 1), 2)
    0.05
    """
    if x <= 0.0:
        return 1.0
    half = 0.5 * x
    odd = freedom % 2 == 1
    powers = [p + 0.5 * odd for p in range(freedom // 2)]
    terms = [math.exp(p * math.log(half) - half - math.lgamma(p + 1.0)) for p in powers]
    return math.fsum([math.erfc(math.sqrt(half)) if odd else 0.0, *terms])


@lru_cache(maxsize=256)
def chi_square_quantile(share: float, freedom: int) -> float:
    """Quantile of the χ² distribution with ``freedom`` ≥ 1 degrees of freedom; 0 < ``share`` < 1.

    Newton steps for the logarithm of the share above, kept inside a shrinking bracket.

    Examples
    --------
    >>> round(chi_square_quantile(0.95, 1), 2)
    3.84
    """
    if freedom < 1 or not 0.0 < share < 1.0:
        raise InputError(
            f"chi-square: expected a share between 0 and 1 and 1 degree of freedom or more, got "
            f"{share} and {freedom}"
        )
    above = 1.0 - share
    low, high = 0.0, float(freedom)
    while chi_square_above(high, freedom) > above:
        low, high = high, 2.0 * high
    x = 0.5 * (low + high)
    for _ in range(MOST_STEPS):
        seen = chi_square_above(x, freedom)
        low, high = (x, high) if seen > above else (low, x)
        half = 0.5 * x
        log_density = (0.5 * freedom - 1.0) * math.log(half) - half - math.lgamma(0.5 * freedom)
        newton = x + math.log(seen / above) * seen / (0.5 * math.exp(log_density))
        following = newton if low < newton < high else 0.5 * (low + high)
        if abs(following - x) <= CONVERGED * x:
            return following
        x = following
    return x


def residual_variance(square: FloatMap, freedom: int) -> float:
    """Variance of a residual, from sums of squared residuals, insensitive to outliers.

    Parameters
    ----------
    square : (n,) float array, counts²
        Sums of squared residuals.
    freedom : int ≥ 1
        Degrees of freedom of each sum.

    Returns
    -------
    float ≥ 0, counts².

    Notes
    -----
    The mean over all sums below a quantile of χ², corrected for the trimming. It starts from the
    median.
    """
    limit = chi_square_quantile(TRIMMED, freedom)
    share = (1.0 - chi_square_above(limit, freedom + 2)) / TRIMMED
    return _core.trimmed_variance(
        np.ascontiguousarray(square, np.float64),
        median=chi_square_quantile(0.5, freedom),
        limit=limit,
        mean=freedom * share,
        steps=TRIMMING_STEPS,
    )
