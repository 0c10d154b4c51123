"""Standard deviation of a displacement as its own scatter shows it; all methods pass here.

The noise of photographs is not white. JPEG removes the frequencies from which noise is usually
estimated and leaves errors at those of the fringes, and a projector's pixel grid looks like noise
that filters remove. What a method reads of it shows in its result: as scatter about a smooth
surface.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fringeworks.pair.pixel_scatter import pixel_factor
from fringeworks.pair.registry import Solution
from fringeworks.pair.smooth import smooth_known
from fringeworks.pair.smoothed_away import smoothed_away
from fringeworks.signal.third_difference import (
    REACH,
    third_difference,
    third_difference_variance,
)
from fringeworks.types import FloatMap

LAG_PERIODS = 1.5
"""Smallest distance at which displacements are compared, periods.

Errors of filters are nearly independent at this distance, and most surfaces are smooth over it. An
empirical choice.
"""
LAG_LENGTHS = 2.0
"""The same in widths of the kernel that correlates the errors.

A third of their variance is shared at this distance, which ``_seen`` accounts for.
"""
LONGER = 1.5
"""Ratio of the second distance, at which shape is told from noise, to the first."""
MAX_GROWTH = 1.7
"""Largest ratio of the scatters at the two distances; more is the object's shape.

The third differences of a shape grow by 1.5³ = 3.4 for every axis, those of noise do not. An
empirical choice.
"""
DIRECTIONS = ((0, 1), (0,), (1,))
"""Axes along which differences are taken: along both, and along one.

Differences along both remove most of the shape, but also errors that are constant along one axis:
those of compressed fringes that run along the blocks, and those of a lamp that flickers.
"""
MAX_AXIS_RATIO = 4.0
"""Largest ratio of the scatter along one axis to that along both.

It is up to 2 in simulated frames of JPEG quality 50 and 3.1 on a photographed plane. Waves of the
surface, whose differences stop growing at half their length, reach 20 and more.
"""
MIN_DIFFERENCES = 2000
"""Smallest number of differences that determine the scatter. An empirical choice."""
SAMPLES_PER_LAG = 8
"""Samples per distance; errors of filters are smooth, so that more hold the same information."""
NORMAL_MEDIAN = 0.6745
"""Median of |z| for a standard normal variable z."""
MIN_FILTER_FACTOR = 0.05
"""Smallest factor of a filter's σ; a visible pixel grid is taken for noise of 10 times the true."""
MIN_WINDOW_FACTOR = 0.5
"""Smallest factor of a window's σ, which comes from the residuals of its own fit.

The bands of a flickering lamp enlarge these residuals two to three times. An empirical choice.
"""
UNKNOWN_WINDOW_FACTOR = 1.2
"""Largest factor of a window's σ where the shape hides its scatter.

On planes, it is 0.9 to 1.6 for white noise, because one step leaves noise of the start.
"""
WINDOW_TAIL = 1.2
"""Ratio of the full error of a window to that of a Gaussian kernel with the same differences.

Scales of several widths are mixed in a frame. Measured on simulated planes: 1.05 to 1.3.
"""
MIN_RATIO = 1e-3
"""Smallest modulation ratio whose logarithm is taken; it keeps that finite."""


def with_measured_sigma(solution: Solution, period_px: float) -> Solution:
    """Bring σ of a solution to the scatter that it shows, and add what is smoothed away.

    Parameters
    ----------
    solution : Solution
    period_px : float > 0

    Returns
    -------
    Solution
        ``details["noise_factor"]`` is the median ratio of the measured σ of the noise to the stated
        one; 1 where there are too few pixels to measure it.
    """
    u, stated = solution.displacement_px, solution.sigma_px
    if any(solution.noise_length_px):
        factor: float | FloatMap | None = noise_factor(solution, period_px)
    else:
        factor = pixel_factor(u, stated, period_px)
    if factor is None:
        factor = 1.0
    sigma = stated * factor
    if solution.smoothing:
        lost = smoothed_away(u, sigma, period_px, solution.smoothing, solution.noise_length_px)
        sigma = np.sqrt(sigma**2 + lost)
    return replace(
        solution,
        sigma_px=sigma.astype(stated.dtype, copy=False),
        details={**solution.details, "noise_factor": _median(factor)},
    )


def _median(factor: float | FloatMap) -> float:
    known = np.asarray(factor)[np.isfinite(factor)]
    return float(np.median(known)) if known.size else 1.0


def noise_factor(solution: Solution, period_px: float) -> float | None:
    """Ratio of the scatter of a displacement with correlated errors to its stated σ.

    Parameters
    ----------
    solution : Solution
        With a ``noise_length_px`` above 0.
    period_px : float > 0

    Returns
    -------
    float or None
        None where there are too few pixels.

    Notes
    -----
    The scatter along every direction is taken at two distances. Where it grows from one to the
    other, the surface is not smooth over the distance, and the scatter is only an upper limit. The
    noise of a filter is then taken from the modulation, whose relative error is that of the phase:
    the surface's shape hardly affects it.
    """
    lengths = solution.noise_length_px
    lag = max(LAG_PERIODS * period_px, LAG_LENGTHS * max(lengths))
    # Filters have larger errors near the frame's border.
    margin = [min(int(period_px), side // 8) for side in solution.sigma_px.shape]
    inner = tuple(slice(m, -m if m else None) for m in margin)
    u, sigma = solution.displacement_px[inner], solution.sigma_px[inner]
    found: list[float] = []
    for axes in DIRECTIONS:
        near = _scatter(u, sigma, lag, lengths, axes)
        if near is None:
            continue
        far = _scatter(u, sigma, LONGER * lag, lengths, axes)
        if far is None or far <= MAX_GROWTH * near:
            found.append(min([near, *(MAX_AXIS_RATIO * f for f in found[:1])]))
        elif len(axes) > 1:
            limit = UNKNOWN_WINDOW_FACTOR
            if solution.is_filter:
                modulation = _modulation(solution, period_px)[inner]
                limit = _scatter(modulation, sigma, lag, lengths, axes) or near
            found.append(min(near, limit))
    if not found:
        return None
    if solution.is_filter:
        return max(*found, MIN_FILTER_FACTOR)
    return max(WINDOW_TAIL * max(found), MIN_WINDOW_FACTOR)


def _modulation(solution: Solution, period_px: float) -> FloatMap:
    """Logarithm of the modulation ratio, scaled so that its noise is that of the displacement."""
    ratio = np.log(np.maximum(solution.modulation_ratio, MIN_RATIO))
    for kernel in solution.smoothing[1:]:
        known = np.isfinite(ratio)
        # The reference's modulation has not passed this kernel yet.
        ratio = np.where(known, smooth_known(ratio, known, kernel.width_px), np.nan)
    return np.asarray(ratio * period_px / (2.0 * np.pi))


def _scatter(
    u: FloatMap, sigma: FloatMap, lag_px: float, lengths: tuple[float, float], axes: tuple[int, ...]
) -> float | None:
    """Median of |third difference| over its stated standard deviation, for normal errors 1.

    The variance of a third difference of noise of variance 1 and correlation ρ is
    20 − 30 ρ(L) + 12 ρ(2L) − 2 ρ(3L), with ρ(d) = exp(−d²/4σ²) for a Gaussian kernel of width σ.
    """
    step = max(1, int(lag_px / SAMPLES_PER_LAG))
    lag = max(1, round(lag_px / step))
    if any(u.shape[axis] <= REACH * lag * step for axis in axes):
        return None
    difference: FloatMap = u[::step, ::step]
    variance: FloatMap = sigma[::step, ::step].astype(np.float64) ** 2
    for axis in axes:
        difference = third_difference(difference, lag, axis)
        variance = third_difference_variance(variance, lag, axis)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.abs(difference) / np.sqrt(variance)
    ratio = ratio[np.isfinite(ratio)]
    if ratio.size * step**2 < MIN_DIFFERENCES:
        return None
    seen = float(np.prod([_seen(lag * step, lengths[axis]) for axis in axes]))
    return float(np.median(ratio)) / NORMAL_MEDIAN / float(np.sqrt(seen))


def _seen(lag: int, width_px: float) -> float:
    """Share of the variance of errors with a Gaussian kernel that third differences show."""
    if width_px <= 0:
        return 1.0
    first, second, third = (np.exp(-((k * lag / (2.0 * width_px)) ** 2)) for k in (1, 2, 3))
    return max(float(1.0 - 1.5 * first + 0.6 * second - 0.1 * third), 0.1)
