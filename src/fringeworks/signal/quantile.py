"""Quantiles of one array, by a kernel that takes a fraction of the time of NumPy's."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core


def quantile(values: NDArray[Any], share: float) -> float:
    """Quantile of float values, interpolated linearly between neighbours in order.

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
