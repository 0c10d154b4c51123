"""Third differences: what is left of a map beyond smooth shape, and its scatter against σ."""

from __future__ import annotations

import numpy as np

from fringeworks.statistics.quantiles import NORMAL_MEDIAN
from fringeworks.types import BoolMap, ByteMap, FloatMap

THIRD = (1.0, -3.0, 3.0, -1.0)
"""Weights of a third difference: it vanishes on parabolas."""
REACH = len(THIRD) - 1
"""Distance between its outermost samples, in steps."""
MIN_DIFFERENCES = 2000
"""Smallest number of differences that determine the scatter. An empirical choice."""
MIN_INDEPENDENT = 30
"""The same in squares of the distance, over which differences share their errors."""
SAMPLES_PER_LAG = 8
"""Samples per distance; errors of filters are smooth, so that more hold the same information."""
QUIET = 0.5
"""Share of the pixels, those of the smallest stated σ, whose scatter is taken."""


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


def scatter_ratio(
    values: FloatMap,
    sigma: FloatMap,
    lag_px: float,
    lengths: tuple[float, float],
    axes: tuple[int, ...],
    walls: ByteMap | None = None,
) -> float | None:
    """Median of |third difference| over its stated standard deviation; 1 for normal errors.

    Parameters
    ----------
    values, sigma : (h, w) float arrays
        NaN where unknown.
    lag_px : float > 0
        Distance between the samples of a difference, px.
    lengths : (float, float)
        Widths of the Gaussian kernel that correlates the errors along y and x, px.
    axes : tuple of 0 and 1
        Axes along which differences are taken, one after the other.
    walls : (h, w) uint8 array, optional
        Pixels on cliffs; differences across them are left out.

    Returns
    -------
    float or None
        None where there are too few differences.

    Notes
    -----
    The variance of a third difference of noise of variance 1 and correlation ρ is
    20 − 30 ρ(L) + 12 ρ(2L) − 2 ρ(3L), with ρ(d) = exp(−d²/4σ²) for a Gaussian kernel of width σ.
    """
    step = max(1, int(lag_px / SAMPLES_PER_LAG))
    lag = max(1, round(lag_px / step))
    if any(values.shape[axis] <= REACH * lag * step for axis in axes):
        return None
    difference: FloatMap = values[::step, ::step]
    variance: FloatMap = sigma[::step, ::step].astype(np.float64) ** 2
    for axis in axes:
        difference = third_difference(difference, lag, axis)
        variance = third_difference_variance(variance, lag, axis)
    if walls is not None:
        difference = np.where(_crossed(walls, step, lag, axes), np.nan, difference)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.abs(difference) / np.sqrt(variance)
    known = np.isfinite(ratio)
    least = max(MIN_DIFFERENCES, MIN_INDEPENDENT * (lag * step) ** 2)
    if np.count_nonzero(known) * step**2 < least:
        return None
    ratio = ratio[known & (variance <= np.quantile(variance[known], QUIET))]
    seen = float(np.prod([_seen(lag * step, lengths[axis]) for axis in axes]))
    return float(np.median(ratio)) / NORMAL_MEDIAN / float(np.sqrt(seen))


def _crossed(walls: ByteMap, step: int, lag: int, axes: tuple[int, ...]) -> BoolMap:
    """Where a third difference of every ``step``-th pixel compares two sides of a wall."""
    crossed: FloatMap = np.zeros(())
    for axis in axes:
        count = np.moveaxis(np.cumsum(walls, axis, dtype=np.int32)[::step, ::step], axis, 0)
        apart = (count[REACH * lag :] != count[: -REACH * lag]).astype(np.float64)
        along = np.moveaxis(apart, 0, axis)
        for other in axes:
            if other != axis:
                along = third_difference_variance(along, lag, other)
        crossed = crossed + along
    return crossed > 0


def _seen(lag: int, width_px: float) -> float:
    """Share of the variance of errors with a Gaussian kernel that third differences show."""
    if width_px <= 0:
        return 1.0
    first, second, third = (np.exp(-((k * lag / (2.0 * width_px)) ** 2)) for k in (1, 2, 3))
    return max(float(1.0 - 1.5 * first + 0.6 * second - 0.1 * third), 0.1)
