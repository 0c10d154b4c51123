"""What a method smooths away of a curved surface, predicted from its result and its kernels."""

from __future__ import annotations

import numpy as np

from fringeworks.pair.registry import Smoothing
from fringeworks.pair.smooth import smooth_known
from fringeworks.types import BoolMap, FloatMap

SPREAD_PERIODS = 1.0
"""Width of the Gaussian over which the magnitude of the smoothed-away part is averaged, periods.

Where the part changes its sign, its magnitude is not that of its surroundings. An empirical choice.
"""
MEAN_TO_SIGMA = 1.18
"""Standard deviation over mean magnitude of the smoothed-away part.

It is 1 for a constant and 1.25 for a normal distribution; the part is between the two. The mean
magnitude is used because the large values at edges would reach further in a mean of squares.
"""
MARGIN_WIDTHS = 3.0
"""Width of the border by which the displacement is continued, widths of the widest kernel."""
FREQUENCIES = 96
"""Frequencies along each axis at which the spectrum of the noise is summed."""
LARGEST_FREQUENCY = 3.0
"""Largest of these frequencies, rad over the smallest width; the noise has exp(−9) there."""


def smoothed_away(
    displacement_px: FloatMap,
    noise_px: FloatMap,
    period_px: float,
    smoothing: tuple[Smoothing, ...],
    noise_length_px: tuple[float, float],
) -> FloatMap:
    """Variance of what a method smooths away of a curved surface, (h, w), px².

    Parameters
    ----------
    displacement_px, noise_px : (h, w) float arrays
        Displacement and the standard deviation of its noise, px; NaN where unknown.
    period_px : float > 0
    smoothing : tuple of Smoothing
    noise_length_px : (float, float)
        Width σ of the Gaussian kernel that correlates the noise along y and x, px.

    Notes
    -----
    With a kernel K, u = K∗t + noise of a surface t, so that t − u = (1 − K)t ≈ (1 − K)(2 − K)u to
    second order. A method that corrects for a curvature averaged by a kernel C leaves
    (1 − K)(1 − C)t. The noise passes the same filters; its share is subtracted.
    """
    known = np.isfinite(displacement_px) & np.isfinite(noise_px)
    if not known.any():
        return np.zeros(displacement_px.shape)
    removed = np.abs(_removed(displacement_px, known, smoothing))
    spread = SPREAD_PERIODS * period_px
    magnitude = smooth_known(np.where(known, removed, 0), known, (spread, spread))
    noise = _noise_share(smoothing, noise_length_px) * np.where(known, noise_px, 0.0) ** 2
    return np.asarray(np.maximum((MEAN_TO_SIGMA * magnitude) ** 2 - noise, 0.0))


def _removed(u: FloatMap, known: BoolMap, smoothing: tuple[Smoothing, ...]) -> FloatMap:
    """What the kernels remove, (h, w), px; the surface goes on with its slope at the border."""
    widest = max(max(s.width_px) for s in smoothing)
    margin = [(min(int(MARGIN_WIDTHS * widest) + 1, n - 1),) * 2 for n in u.shape]
    # Without their median the values keep single precision.
    values = np.where(known, u - np.median(u[known]), 0).astype(np.float32)
    padded = np.pad(values, margin, mode="reflect", reflect_type="odd")
    where = np.pad(known, margin, mode="reflect")

    def without(v: FloatMap, width_px: tuple[float, float]) -> FloatMap:
        return np.where(where, v - smooth_known(v, where, width_px), 0)

    total = np.zeros_like(padded)
    for kernel in smoothing:
        once = without(padded, kernel.width_px)
        over = kernel.corrected_over_px
        part = once + without(once, kernel.width_px) if over is None else without(once, over)
        total += np.float32(kernel.share) * part
    inner = tuple(slice(a, n - b) for (a, b), n in zip(margin, padded.shape, strict=True))
    return np.asarray(total[inner])


def _noise_share(smoothing: tuple[Smoothing, ...], noise_length_px: tuple[float, float]) -> float:
    """Variance of what the kernels remove from noise, over the variance of the noise."""
    least = min(w for s in smoothing for w in (*s.width_px, *noise_length_px) if w > 0)
    k = np.linspace(0.0, LARGEST_FREQUENCY / least, FREQUENCIES)

    def response(width_px: tuple[float, float]) -> FloatMap:
        return np.exp(-0.5 * ((k[:, None] * width_px[0]) ** 2 + (k * width_px[1]) ** 2))

    total = np.zeros((FREQUENCIES, FREQUENCIES))
    for kernel in smoothing:
        passed = response(kernel.width_px)
        over = kernel.corrected_over_px
        total += kernel.share * (1 - passed) * (2 - passed if over is None else 1 - response(over))
    noise = response(noise_length_px) ** 2
    return float(np.sum(noise * total**2) / np.sum(noise))
