"""Standard deviation of a displacement, scaled to the scatter that the displacement shows.

The noise of photographs is not white. JPEG removes the frequencies from which noise is usually
estimated and leaves errors at those of the fringes, and a projector's pixel grid looks like noise
that filters remove. What a method reads of it shows in its result: as scatter about a smooth
surface.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage, special

from fringeworks.signal.third_difference import (
    REACH,
    third_difference,
    third_difference_variance,
)
from fringeworks.types import FloatMap

LAGS_PERIODS = (1.5, 2.0)
"""Distances at which displacements are compared, periods.

Errors of filters are nearly independent at these distances, and most surfaces are smooth over them.
An empirical choice.
"""
MAX_GROWTH = 2.0
"""Largest ratio of the scatters at the two distances; more is the object's shape.

The third differences of a shape grow by (2/1.5)⁶ = 5.6. An empirical choice.
"""
QUANTILE = 0.5
"""Quantile of the differences that the scatter is taken from; edges may disturb the others."""
PIXEL_QUANTILE = 0.68
"""The same for methods that use single pixels.

Their errors are not normal: many are small and some are large. The standard deviation is meant to
cover 68 %.
"""
MIN_DIFFERENCES = 2000
"""Smallest number of differences that determine the scatter. An empirical choice."""
LONG_RANGE = 1.3
"""Ratio of the full error of a filter to that part which differences show.

Errors that extend over several periods cancel in the differences. Measured on simulated JPEG and on
photographed planes.
"""
SMOOTHING_PERIODS = 0.45
"""Width of the Gaussian whose effect on a displacement equals that of the filters, periods.

Measured on simulated curved surfaces: 0.40 to 0.45.
"""
SPREAD_PERIODS = 0.5
"""Width of the Gaussian over which the smoothed-away part is averaged, periods."""
FLAT_QUANTILE = 0.5
"""Share of the frame that is taken to be so flat that filters smooth only noise away there."""


def noise_factor(
    displacement_px: FloatMap,
    sigma_px: FloatMap,
    period_px: float,
    length_px: tuple[float, float],
) -> float | None:
    """Ratio of the scatter of a displacement to its stated standard deviation.

    Parameters
    ----------
    displacement_px, sigma_px : (h, w) float arrays
        px; NaN where unknown.
    period_px : float > 0
    length_px : (float, float)
        Width σ of the Gaussian kernel along y and x that correlates the errors, px; 0 for none.

    Returns
    -------
    float or None
        None where there are too few pixels.

    Notes
    -----
    The variance of a third difference of noise of variance 1 and correlation ρ is
    20 − 30 ρ(L) + 12 ρ(2L) − 2 ρ(3L), with ρ(d) = exp(−d²/4σ²) for a Gaussian kernel of width σ.
    """
    found: list[float] = []
    quantile = QUANTILE if any(length_px) else PIXEL_QUANTILE
    for periods in LAGS_PERIODS:
        lag = max(1, round(periods * period_px))
        if min(displacement_px.shape) <= REACH * lag:
            break
        scatter = _scatter(displacement_px, sigma_px, lag, quantile)
        if scatter is None:
            break
        found.append(scatter / float(np.sqrt(np.prod([_seen(lag, s) for s in length_px]))))
    if not found:
        return None
    if len(found) > 1 and found[1] > MAX_GROWTH * found[0]:
        return found[0]
    return max(found)


def smoothed_away(displacement_px: FloatMap, sigma_px: FloatMap, period_px: float) -> FloatMap:
    """Variance of what a filter smooths away of a curved surface, (h, w), px².

    Notes
    -----
    A filter of width κp reduces the displacement's curvature twice as it would once: what a second
    smoothing removes is about what the first has removed. Noise is removed as well; its share is
    taken from the flatter half of the frame, is at most σ², and is subtracted.
    """
    known = np.isfinite(displacement_px) & np.isfinite(sigma_px)
    if not known.any():
        return np.zeros(displacement_px.shape)
    weight = known.astype(np.float64)
    width = SMOOTHING_PERIODS * period_px
    u = np.where(known, displacement_px, 0.0)
    smooth = _smooth(u, width) / np.maximum(_smooth(weight, width), np.finfo(float).tiny)
    removed = np.where(known, u - smooth, 0.0) ** 2
    spread = SPREAD_PERIODS * period_px
    share = np.maximum(_smooth(weight, spread), np.finfo(float).tiny)
    square = _smooth(removed, spread) / share
    variance = np.where(known, sigma_px, 1.0) ** 2
    noise = float(np.quantile((square / variance)[known], FLAT_QUANTILE))
    return np.asarray(np.maximum(square - min(noise, 1.0) * variance, 0.0))


def _smooth(values: FloatMap, width_px: float) -> FloatMap:
    return np.asarray(ndimage.gaussian_filter(values, width_px, mode="nearest"))


def _seen(lag: int, width_px: float) -> float:
    """Share of the variance of errors with a Gaussian kernel that third differences show."""
    if width_px <= 0:
        return 1.0
    first, second, third = (np.exp(-((k * lag / (2.0 * width_px)) ** 2)) for k in (1, 2, 3))
    return max(float(1.0 - 1.5 * first + 0.6 * second - 0.1 * third), 0.1)


def _scatter(u: FloatMap, sigma: FloatMap, lag: int, quantile: float) -> float | None:
    """Quantile of |third difference| over its stated standard deviation, for normal errors 1."""
    difference, variance = u, np.square(sigma, dtype=np.float64)
    # Along y and then along x: surfaces that are quadratic in either leave nothing.
    for axis in (0, 1):
        difference = third_difference(difference, lag, axis)
        variance = third_difference_variance(variance, lag, axis)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.abs(difference) / np.sqrt(variance)
    ratio = ratio[np.isfinite(ratio)]
    if ratio.size < MIN_DIFFERENCES:
        return None
    normal = float(special.ndtri(0.5 + 0.5 * quantile))
    return float(np.quantile(ratio, quantile)) / normal
