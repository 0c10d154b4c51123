"""Standard deviation of methods that measure every pixel by itself, from the scatter they show."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fringeworks.signal.filters import smooth
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
SAMPLES = 60_000
"""Number of pixels that determine the factors; each quantile of a class then errs by about 1 %."""
ROWS_PER_WIDTH = 4.0
"""Smallest number of rows per width of that Gaussian; more rows cost time and add little."""
MIN_ROWS = 16
"""Smallest number of rows that are left; with fewer every row is used."""
MIN_PIXELS = 2000
"""Smallest number of pixels from which the factors are determined. An empirical choice."""


@dataclass(frozen=True)
class PixelFactor:
    """Ratio of the scatter of single pixels to their stated standard deviation."""

    stated_px: list[float]
    """Stated σ in the middle of every class, px, rising."""
    factors: list[float]
    """Factor ≥ 1 of every class."""

    def at(self, sigma_px: FloatMap) -> FloatMap:
        """Factor of pixels with a stated σ; it is linear between the classes."""
        return np.interp(sigma_px, self.stated_px, self.factors)


def pixel_factor(
    displacement_px: FloatMap, sigma_px: FloatMap, period_px: float
) -> PixelFactor | None:
    """Compare the scatter of single pixels with their stated standard deviation.

    Parameters
    ----------
    displacement_px, sigma_px : (h, w) float arrays
        px; NaN where unknown.
    period_px : float > 0

    Returns
    -------
    PixelFactor, or None where there are too few pixels.
    """
    width = SMOOTHING_PERIODS * period_px
    # An odd step meets all rows of the blocks of 8 px that JPEG has.
    step = int(width / ROWS_PER_WIDTH / 2.0) * 2 + 1 if width > ROWS_PER_WIDTH else 1
    step = step if displacement_px.shape[0] > MIN_ROWS * step else 1
    u, sigma = displacement_px[::step], sigma_px[::step]
    error = np.abs(_about_surface(u, sigma, (width / step, width)))
    at = np.flatnonzero(np.isfinite(error) & (sigma > 0))
    if at.size * step < MIN_PIXELS:
        return None
    if at.size > SAMPLES:
        at = at[np.random.default_rng(0).integers(at.size, size=SAMPLES)]
    return _factors(sigma.flat[at], error.flat[at])


def _factors(stated: FloatMap, error: FloatMap) -> PixelFactor:
    """Median stated σ and factor of every class, in rising order of σ."""
    order = np.argsort(stated)
    stated, error = stated[order], error[order]
    edges = stated[stated.size * np.arange(1, CLASSES) // CLASSES]
    # Pixels of the same σ belong to the same class.
    starts = [0, *np.unique(np.searchsorted(stated, edges, side="right")), stated.size]
    centres, factors = [], []
    for first, end in pairwise(starts):
        if end > first:
            one, two = np.quantile(error[first:end] / stated[first:end], QUANTILES)
            centres.append(float(stated[(first + end) // 2]))
            factors.append(float(max(one, 0.5 * two, 1.0)))
    return PixelFactor(centres, factors)


def _about_surface(u: FloatMap, sigma: FloatMap, width: tuple[float, float]) -> FloatMap:
    """Difference from a smooth surface, to which precise pixels contribute most, px."""
    known = np.isfinite(u) & (sigma > 0)
    weight = np.where(known, sigma, 1.0)
    weight **= 2
    np.divide(1.0, weight, out=weight)
    weight[~known] = 0.0
    weight /= max(float(weight.max(initial=0.0)), np.finfo(float).tiny)
    total = smooth(weight, width)
    np.maximum(total, np.finfo(total.dtype).tiny, out=total)
    values = np.where(known, u, 0.0)
    once = smooth(weight * values, width)
    once /= total
    # The second pass gives back what the first one removes from a curved surface.
    values -= once
    values *= weight
    removed = smooth(values, width)
    removed /= total
    np.subtract(u, once, out=once)
    once -= removed
    return np.asarray(once)
