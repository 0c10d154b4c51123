"""Quantiles of one array, and robust standard deviations from them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core

NORMAL_MEDIAN = 0.6745
"""Median of |z| for a standard normal variable z."""
MAD_TO_SIGMA = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation: the reciprocal of
``NORMAL_MEDIAN``. The two are rounded by themselves."""


def quantile(values: NDArray[Any], share: float) -> float:
    """Quantile of float values, interpolated linearly between neighbours in order.

    The kernel takes a fraction of the time of NumPy's.

    Parameters
    ----------
    values : (n,) float32 or float64 array
    share : float, 0…1

    Returns
    -------
    float; NaN where a value is NaN, or where there are none.

    Examples
    --------
    >>> quantile(np.array([4.0, 1.0, 2.0]), 0.75)
    3.0
    """
    return _core.quantiles(np.ascontiguousarray(values), [share])[0]


def median(values: NDArray[Any]) -> float:
    """Median of float values; see ``quantile``."""
    return quantile(values, 0.5)


def robust_sigma(deviations: NDArray[Any]) -> float:
    """Standard deviation of normal deviations, from the median of their magnitudes."""
    return MAD_TO_SIGMA * float(np.median(np.abs(deviations)))
