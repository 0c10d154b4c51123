"""Standard deviation of a displacement as its own scatter shows it; all methods pass here.

The noise of photographs is not white. JPEG removes the frequencies from which noise is usually
estimated and leaves errors at those of the fringes, and a projector's pixel grid looks like noise
that filters remove. What a method reads of it shows in its result: as scatter about a smooth
surface.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from fringeworks.pair.albedo import paint_edges
from fringeworks.pair.registry import Solution
from fringeworks.pair.smoothed_away import SmoothedAway, smoothed_away
from fringeworks.signal.bands import by_bands
from fringeworks.signal.filters import smooth, widened
from fringeworks.statistics.third_difference import scatter_ratio
from fringeworks.types import BoolMap, FloatMap, sealed

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
MAX_FILTER_GROWTH = 1.7
"""Largest ratio of a filter's scatters at the two distances; more is the object's shape.

The third differences of a shape grow by 1.5³ = 3.4 for every axis, those of noise do not. An
empirical choice.
"""
MAX_WINDOW_GROWTH = 1.25
"""The same for windows: the scatter of noise grows by up to 1.15 in compressed frames, and theirs
follows the shape more closely."""
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
MEDIAN_PIXELS = 60_000
"""Approximate number of pixels that a median factor is taken of; it is then known to 1 %."""
EDGE_PERIODS = 0.5
"""Distance from cliffs and edges of paint within which scatter is not counted, periods:
errors of the model are larger there, and σ contains them."""
FILTER_FACTORS = (0.05, 20.0)
"""Smallest and largest factor of a filter's σ: a visible pixel grid is taken for noise of 10 times
the true, and compression leaves 18 times the camera's noise in the band of the fringes."""
WINDOW_FACTORS = (1.0, 3.0)
"""The same of a window's σ, which comes from the residuals of its own fit."""
FILTER_TAIL = 1.08
"""Ratio of the full error of a filter to that of a Gaussian kernel with the same differences.

Errors of several widths are mixed in a frame. Measured on simulated planes: 1.05 to 1.3.
"""
WINDOW_TAIL = 1.2
"""The same of windows, whose sizes differ from pixel to pixel."""


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
    if not any(solution.noise_length_px):
        factor = pixel_factor(u, stated, period_px)
        if factor is None:
            return _with_sigma(solution, stated, 1.0)
        sigma = by_bands(lambda s: s * factor.at(s), stated, dtype=stated.dtype)
        return _with_sigma(solution, sigma, _median(factor.at(_sampled(stated))))
    lost = _lost(solution, period_px)
    if not solution.is_filter:
        more = noise_factor(solution, period_px) or 1.0
        return _with_sigma(solution, _with_lost(stated, lost, factor=more), more)
    less = min(noise_factor(solution, period_px) or 1.0, 1.0)
    noise = stated if less == 1.0 else less * stated
    sigma = sealed(_with_lost(noise, lost))
    more = max(noise_factor(replace(solution, sigma_px=sigma), period_px) or 1.0, 1.0)
    if more > 1.0:
        # A filter's noise is the same all over the frame: its excess is added everywhere.
        excess = (more**2 - 1.0) * np.nanmedian(sigma) ** 2
        noise = by_bands(lambda s: np.sqrt(s**2 + excess), noise, dtype=noise.dtype)
        sigma = _with_lost(noise, lost)
    return _with_sigma(solution, sigma, less * more)


def _lost(solution: Solution, period_px: float) -> SmoothedAway | None:
    """What the method smooths away, or None where it has no kernels."""
    if not solution.smoothing:
        return None
    u, lengths = solution.displacement_px, solution.noise_length_px
    known = np.isfinite(u) & np.isfinite(solution.sigma_px)
    return smoothed_away(u, known, period_px, solution.smoothing, lengths)


def _with_lost(noise_px: FloatMap, lost: SmoothedAway | None, *, factor: float = 1.0) -> FloatMap:
    """σ of noise together with what is smoothed away, times a factor, (h, w), px."""
    if lost is None:
        return noise_px if factor == 1.0 else factor * noise_px

    def together(noise: FloatMap, removed: FloatMap, rough: FloatMap) -> FloatMap:
        variance = SmoothedAway(removed, rough, lost.noise_shares).beside(noise)
        variance += noise**2
        np.sqrt(variance, out=variance)
        variance *= factor
        return variance

    return by_bands(together, noise_px, lost.lost, lost.rough, dtype=noise_px.dtype)


def _with_sigma(solution: Solution, sigma_px: FloatMap, factor: float) -> Solution:
    return replace(
        solution,
        sigma_px=sealed(sigma_px.astype(solution.sigma_px.dtype, copy=False)),
        details={**solution.details, "noise_factor": factor},
    )


def _sampled(values: FloatMap) -> FloatMap:
    """Some pixels of a map, enough for a median."""
    step = max(1, round((values.size / MEDIAN_PIXELS) ** 0.5))
    return values[::step, ::step]


def _median(factor: FloatMap) -> float:
    """Median of the finite factors."""
    known = factor[np.isfinite(factor)]
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
    other, it is shape, which tells nothing of noise: the factor is 1 then.
    """
    lengths = solution.noise_length_px
    lag = LAG_LENGTHS * max(lengths)
    if solution.is_filter:
        lag = max(LAG_PERIODS * period_px, lag)
    # Filters have larger errors near the frame's border.
    margin = [min(int(period_px), side // 8) for side in solution.sigma_px.shape]
    inner = tuple(slice(m, -m if m else None) for m in margin)
    u = _away_from_edges(solution, period_px)[inner]
    sigma = solution.sigma_px[inner]
    walls = None if solution.walls is None else solution.walls[inner]
    most_growth = MAX_FILTER_GROWTH if solution.is_filter else MAX_WINDOW_GROWTH
    found: list[float] = []
    for axes in DIRECTIONS:
        near, far = (
            scatter_ratio(u, sigma, at, lengths, axes, walls) for at in (lag, LONGER * lag)
        )
        if near is None or far is None:
            continue
        if far <= most_growth * near:
            found.append(min([near, *(MAX_AXIS_RATIO * f for f in found[:1])]))
        elif len(axes) > 1:
            if not solution.is_filter:
                # What changes along both axes is shape: so is what changes along one.
                return 1.0
            found.append(min(near, 1.0))
    if not found:
        return None
    if solution.is_filter:
        return float(np.clip(FILTER_TAIL * max(found), *FILTER_FACTORS))
    return float(np.clip(WINDOW_TAIL * max(found), *WINDOW_FACTORS))


def _away_from_edges(solution: Solution, period_px: float) -> FloatMap:
    """The displacement, (h, w), NaN near cliffs and edges of paint that the method has found."""
    edges: BoolMap = np.zeros((), bool)
    if solution.walls is not None:
        edges = edges | (solution.walls > 0)
    if solution.albedo is not None:
        edges = edges | paint_edges(solution.albedo)
    if not edges.any():
        return solution.displacement_px
    near = widened(edges, int(EDGE_PERIODS * period_px))
    return np.where(near, np.nan, solution.displacement_px)
