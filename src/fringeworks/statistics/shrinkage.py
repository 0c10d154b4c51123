"""Errors of single values from residuals that contain noise, by an empirical prior."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fringeworks.types import FloatMap

VARIANCES = np.concatenate([[0.0], 4.0 ** np.arange(-1, 10)])
"""Variances of the errors that the prior is a mixture of, over the usual noise: a factor of two in
the standard deviation from one to the next leaves gaps that the mixture fills (Stephens,
Biostatistics 18, 2017, doi:10.1093/biostatistics/kxw041)."""

FREE = 10.0
"""Values without an error that the prior holds beforehand, so that few values do not seem to have
small errors that their noise hides (as in Stephens, 2017)."""

ROUNDS = 50
"""Rounds of expectation and maximisation: the mean square settles to some per cent, less than it
scatters by."""

TINY = 1e-300
"""Divides instead of a likelihood that underflows."""


def mean_square_errors(
    residuals: NDArray[np.float64], noise: NDArray[np.float64]
) -> tuple[FloatMap, float]:
    """Mean square of the error of every value, given a residual that is this error and noise.

    Parameters
    ----------
    residuals : (n,) array
    noise : (n,) array
        Variances of the residuals by noise alone, > 0, in the square of their unit.

    Returns
    -------
    second : (n,) array
        Expected squares of the errors. Where few values have errors, it is far below the mean of
        all for the others.
    mean : float
        The same for a value without a residual.

    Notes
    -----
    The prior of the errors is a mixture of normal distributions around zero, whose shares are those
    of the largest likelihood (empirical Bayes).

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> errors = np.where(np.arange(4000) < 40, 1.0, 0.0)
    >>> seen = errors + 0.1 * rng.standard_normal(4000)
    >>> second, mean = mean_square_errors(seen, np.full(4000, 0.01))
    >>> bool(second[:40].min() > 0.3), bool(np.median(second) < 0.001), round(mean, 2)
    (True, True, 0.01)
    """
    variances = (np.median(noise) * VARIANCES)[:, None]
    total = variances + noise
    likelihood = np.exp(-0.5 * residuals**2 / total) / np.sqrt(total)
    shares = np.full(len(variances), 1.0 / len(variances))
    for _ in range(ROUNDS):
        # The sums of the posteriors, without an array of them.
        counts = shares * (likelihood @ (1.0 / np.maximum(shares @ likelihood, TINY)))
        counts[0] += FREE
        shares = counts / counts.sum()
    posterior, gain = _posterior(shares, likelihood), variances / total
    second = np.sum(posterior * (gain * noise + (gain * residuals) ** 2), axis=0)
    return np.asarray(second), float(shares @ variances[:, 0])


def _posterior(shares: NDArray[np.float64], likelihood: FloatMap) -> FloatMap:
    """Probability of every part of the mixture, for every value."""
    weighed = shares[:, None] * likelihood
    return np.asarray(weighed / np.maximum(weighed.sum(axis=0), TINY))
