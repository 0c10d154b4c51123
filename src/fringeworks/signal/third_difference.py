"""Third differences: what is left of a map beyond smooth shape, and the variance of that."""

from __future__ import annotations

import numpy as np

from fringeworks.types import FloatMap

THIRD = (1.0, -3.0, 3.0, -1.0)
"""Weights of a third difference: it vanishes on parabolas."""
REACH = len(THIRD) - 1
"""Distance between its outermost samples, in steps."""


def third_difference(values: FloatMap, step: int, axis: int = 1) -> FloatMap:
    """Third differences of samples ``step`` apart along an axis of a map.

    Parameters
    ----------
    values : (h, w) float array
    step : int ≥ 1
    axis : 0 or 1

    Returns
    -------
    (h, w) float array, shorter by three steps along the axis; empty where the map is shorter.

    Examples
    --------
    >>> third_difference(np.arange(6.0)[None] ** 3, 1)
    array([[-6., -6., -6.]])
    """
    return _weighted(values, step, axis, THIRD)


def third_difference_variance(variance: FloatMap, step: int, axis: int = 1) -> FloatMap:
    """Variances of the third differences of independent samples with given variances."""
    return _weighted(variance, step, axis, tuple(w**2 for w in THIRD))


def _weighted(values: FloatMap, step: int, axis: int, weights: tuple[float, ...]) -> FloatMap:
    along = np.moveaxis(values, axis, 1)
    length = max(0, along.shape[1] - REACH * step)
    parts = (w * along[:, k * step : k * step + length] for k, w in enumerate(weights))
    return np.moveaxis(np.asarray(sum(parts)), 1, axis)
