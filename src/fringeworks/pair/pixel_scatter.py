"""Standard deviation of methods that measure every pixel by itself, from the scatter they show."""

from __future__ import annotations

import numpy as np

from fringeworks.pair.smooth import smooth
from fringeworks.types import FloatMap

SMOOTHING_PERIODS = 0.5
"""Width of the Gaussian that the surface is estimated with, periods.

It removes errors that repeat with the fringes (0.7 % remain) and keeps the surface.
"""
CLASSES = 12
"""Number of classes of stated σ, of equal numbers of pixels.

The stated σ follows the slope of the fringe. Errors of compression, of flicker and of the fits near
the extrema do not, so each class has a factor of its own.
"""
QUANTILES = (0.66, 0.92)
"""Shares of a class's errors that are to lie within 1 σ and 2 σ, at least.

A normal distribution has 0.68 and 0.95. These errors have longer tails, so that both cannot be met;
the larger of the two factors is taken.
"""
MIN_PIXELS = 2000
"""Smallest number of pixels from which the factors are determined. An empirical choice."""


def pixel_factor(
    displacement_px: FloatMap, sigma_px: FloatMap, period_px: float
) -> FloatMap | None:
    """Ratio of the scatter of single pixels to their stated standard deviation, (h, w).

    Parameters
    ----------
    displacement_px, sigma_px : (h, w) float arrays
        px; NaN where unknown.
    period_px : float > 0

    Returns
    -------
    (h, w) float array ≥ 1, or None where there are too few pixels.
    """
    known = np.isfinite(displacement_px) & (sigma_px > 0)
    if np.count_nonzero(known) < MIN_PIXELS:
        return None
    error = np.abs(_about_surface(displacement_px, sigma_px, period_px)[known])
    stated = np.log(sigma_px[known])
    edges = np.unique(np.quantile(stated, np.linspace(0.0, 1.0, CLASSES + 1)[1:-1]))
    member = np.searchsorted(edges, stated)
    centres, factors = [], []
    for k in range(edges.size + 1):
        of_class = member == k
        if of_class.any():
            centres.append(np.median(stated[of_class]))
            ratio = error[of_class] / np.exp(stated[of_class])
            one, two = np.quantile(ratio, QUANTILES)
            factors.append(max(one, 0.5 * two, 1.0))
    result = np.ones(displacement_px.shape)
    result[known] = np.interp(stated, centres, factors)
    return result


def _about_surface(u: FloatMap, sigma: FloatMap, period_px: float) -> FloatMap:
    """Difference from a smooth surface, to which precise pixels contribute most, px."""
    known = np.isfinite(u) & (sigma > 0)
    weight = np.where(known, 1.0 / np.where(known, sigma, 1.0) ** 2, 0.0)
    weight /= weight.max()
    width = (SMOOTHING_PERIODS * period_px,) * 2
    total = np.maximum(smooth(weight, width), np.finfo(float).tiny)
    values = np.where(known, u, 0.0)
    once = smooth(weight * values, width) / total
    # The second pass gives back what the first one removes from a curved surface.
    removed = smooth(weight * (values - once), width) / total
    return np.asarray(u - once - removed)
