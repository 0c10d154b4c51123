"""Scatter of the coordinates about smooth surfaces, beyond their standard deviations.

Compression, vibration, and light that a lens mixes at printed edges, shift all sets of a pixel
alike. Neither the residuals of the fits nor the agreement of the sets shows it, but neighbouring
pixels do: along a smooth surface, the third difference of the coordinate is noise.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from fringeworks import _core
from fringeworks.statistics.chi_square import chi_square_above, chi_square_quantile
from fringeworks.statistics.quantiles import median
from fringeworks.statistics.third_difference import third_difference, third_difference_variance
from fringeworks.types import FloatMap

SCALES = ((1, 3), (2, 5), (2, 13))
"""Distance of the pixels of a difference, and side of the square that differences are averaged in,
both in px.

Printed edges make errors of one or two pixels, the blocks of a compression longer ones. A wide
square shows small excesses that hold all over a region, without making single pixels of plain noise
stand out. On the faults of the tests the three cover more than any one alone. Empirical.
"""

SIGNIFICANT_EXCESS = 4.0
"""Excess of a mean χ² from which on σ is raised, in standard deviations. At 3, single pixels of
plain noise stand out of maps of σ."""

SHARED = 4.6
"""Differences that share what one independent one says: each counts at two pixels, and the squares
of overlapping third differences have a summed correlation of 2.3."""

TYPICAL = 1.4
"""Median χ² of the differences of neighbours, over its expectation, from which on every pixel is
examined. Noise alone scatters by a tenth in a sample; the rest is for relief. Empirical."""

OUTLIER_CHI = 20.0
"""χ² of a difference that counts as an outlier; noise exceeds it in 8 of a million."""

OUTLIER_SHARE = 5e-4
"""Share of outliers from which on every pixel is examined. Simulated scenes with noise alone have
less than a tenth of it, sharp printed edges before a lens five times as much. Empirical."""

SHARE_SIGMAS = 2.0
"""Share of errors of single pixels that is significant, in standard deviations of counting."""

MIN_DIFFERENCES = 2000
"""Smallest number of differences for a statement: one outlier in them is the share above."""

SAMPLED = 300_000
"""Approximate number of pixels per direction that errors at edges are measured from."""

STRONG_EDGES = (0.97, 0.99, 0.995)
"""Quantiles of the differences from which on edges of brightness count as strong.

The largest of the three results is used, because few scenes have many edges, and at the strongest
ones the error saturates. Empirical.
"""

MOST = 100.0
"""Largest χ² of a difference that counts, so that single ones do not decide."""


DISTANCES = (1, 2, 4, 8, 16)
"""Distances of the samples of third differences that tell errors of pixels from a surface, px.

Errors of compression and smoothing are those of pixels next to each other, and errors that follow
the fringes show within half of one, which is up to 16 px in usual captures.
"""

FEWEST = 300
"""Smallest number of differences whose median tells their variance: it scatters by a tenth."""

ROUNDS = 8
"""Rounds in which the share of outliers and the variance of the others settle, to 1 %."""

MOST_CROSSING = 0.45
"""Share of the differences that cross creases, from which on the median says nothing of noise."""


def scatters(coordinate: FloatMap, sigma: FloatMap, most_px: float) -> bool:
    """Whether coordinates along lines scatter by more than their standard deviations.

    Parameters
    ----------
    coordinate, sigma : (r, l) float arrays, projector px
        NaN where a coordinate is unknown.
    most_px : float > 0
        Largest third difference on one surface, projector px; larger ones are depth steps.
    """
    values = _chi_of_lines((coordinate, sigma), most_px)
    if values.size < MIN_DIFFERENCES:
        return False
    typical = median(values) / chi_square_quantile(0.5, 1)
    return bool(typical > TYPICAL or np.mean(values > OUTLIER_CHI) > OUTLIER_SHARE)


def by_pixel(coordinate: FloatMap, sigma: FloatMap, most_px: float) -> bool:
    """Whether the scatter of coordinates that ``scatters`` shows is that of single pixels.

    Creases, steep relief and edges of depth make third differences as well, on scenes without any
    fault. The parameters are those of ``scatters``.

    Notes
    -----
    Errors of single pixels make the same differences at any distance of the samples. A crease is
    crossed by twice as many differences of the double distance, and smooth relief makes them eight
    times as large. So twice the share of outliers at the single distance, less that at the double
    one, is a lower bound of the share of errors of single pixels. The same holds for the excess of
    the median.
    """
    near = _chi_of_lines((coordinate, sigma), most_px)
    halves = [(coordinate[:, k::2], sigma[:, k::2]) for k in (0, 1)]
    far = np.concatenate([_chi_of_lines(half, most_px) for half in halves])
    if min(near.size, far.size) < MIN_DIFFERENCES:
        return False
    typical = 2.0 * median(near) - median(far)
    shares = float(np.mean(near > OUTLIER_CHI)), float(np.mean(far > OUTLIER_CHI))
    share = 2.0 * shares[0] - shares[1]
    error = ((4.0 * shares[0] + shares[1]) / near.size) ** 0.5
    many = share > max(OUTLIER_SHARE, SHARE_SIGMAS * error)
    return bool(many or typical > TYPICAL * chi_square_quantile(0.5, 1))


def pixel_excess(values: FloatMap, sigma: FloatMap, most: float, reach_px: float) -> float:
    """Lower bound of the variance along lines, over that of noise, without the surface's part.

    Parameters
    ----------
    values, sigma : (r, l) float arrays, in one unit
        NaN where a value is unknown.
    most : float > 0
        Largest third difference on one surface, in that unit; larger ones are depth steps.
    reach_px : float > 0
        Largest distance of samples whose differences are judged, by those of twice the distance.

    Returns
    -------
    The largest bound over distances within the reach; infinite where the lines hold too few
    differences to tell.

    Notes
    -----
    As for ``by_pixel``: noise makes the same differences at distances d and 2 d, while creases,
    relief and edges of depth make more at 2 d, or outliers. With variances v over the expectation,
    the smaller one of v(d) and 2 v(d) − v(2d) belongs to errors that are noise at the distance d:
    errors of single pixels do at every distance, blocks of a compression and errors that follow
    the fringes at some.
    """
    excess: list[float] = []
    crossing = 0.0
    for d in DISTANCES[: 1 + int(np.searchsorted(DISTANCES, max(reach_px, 1.0), side="right"))]:
        found = _excess_at(values, sigma, most, d) if crossing < MOST_CROSSING else None
        if found is None:
            break
        excess.append(found[0])
        # Twice as many differences of the next distance cross a crease.
        crossing = 2.0 * max(crossing, found[1])
    bounds = [min(near, 2.0 * near - far) for near, far in pairwise(excess)]
    return max(bounds, default=float("inf"))


def _excess_at(
    values: FloatMap, sigma: FloatMap, most: float, distance: int
) -> tuple[float, float] | None:
    """Variance of the third differences at a distance over that of noise, besides a share of them
    that are outliers, and this share; None where they are too few."""
    parts = [(values[:, k::distance], sigma[:, k::distance]) for k in range(distance)]
    chi = np.concatenate([_chi_of_lines(part, most) for part in parts])
    if chi.size < FEWEST:
        return None
    middle, beyond, outliers = median(chi), float(np.mean(chi > OUTLIER_CHI)), 0.0
    for _ in range(ROUNDS):
        # All outliers are above the median: of the others, more than half are below it.
        excess = middle / chi_square_quantile(0.5 / (1.0 - min(outliers, MOST_CROSSING)), 1)
        by_noise = chi_square_above(OUTLIER_CHI / max(excess, 1.0), 1)
        outliers = max(0.0, (beyond - by_noise) / (1.0 - by_noise))
    return excess, outliers


def _chi_of_lines(lines: tuple[FloatMap, FloatMap], most_px: float) -> FloatMap:
    """χ² of the third differences of coordinates along lines with their standard deviations."""
    coordinate, sigma = (np.ascontiguousarray(values, np.float32) for values in lines)
    return _core.third_chi_squares(coordinate, sigma, most=most_px)


def cover_scatter(
    coordinate: FloatMap, sigma: FloatMap, background: FloatMap, most_px: float
) -> None:
    """Raise standard deviations, in place, so that they cover what neighbouring pixels show.

    Parameters
    ----------
    coordinate, sigma : (h, w) float32 arrays, projector px
        NaN where a coordinate is unknown.
    background : (h, w) float32 array, counts
    most_px : float > 0
        Largest third difference on one surface, projector px; larger ones are depth steps.

    Notes
    -----
    First the errors at edges of brightness are added, in proportion to the relative change of the
    background: light of neighbours reaches a pixel by vibration, the lens or compression, and
    counts by its share. Then σ is raised where the differences around a pixel are still larger.
    """
    change = _squared_change(background)
    per_change = _error_per_change(coordinate, sigma**2, change, most_px)
    np.sqrt(sigma**2 + per_change * change, out=sigma)
    factors = np.ones(coordinate.shape, np.float32)
    for step, side in SCALES:
        _core.raise_factors(
            coordinate,
            sigma,
            factors,
            {"step": step, "side": side},
            {"most": most_px, "excess": SIGNIFICANT_EXCESS, "shared": SHARED},
        )
    sigma *= np.sqrt(factors)


def _squared_change(background: FloatMap) -> FloatMap:
    """Square of the largest change of the background among a pixel and its neighbours, relative to
    that of the pixel."""
    change = _of_neighbours(np.fmax, background) - _of_neighbours(np.fmin, background)
    with np.errstate(divide="ignore", invalid="ignore"):
        change /= background
    change *= change
    change[~np.isfinite(change)] = 0.0
    return change


def _of_neighbours(extreme: np.ufunc, values: FloatMap) -> FloatMap:
    """Largest or smallest value among every pixel and its eight neighbours.

    By shifted maps, a tenth of the time of SciPy's filters.
    """
    down = values.copy()
    extreme(down[1:], values[:-1], out=down[1:])
    extreme(down[:-1], values[1:], out=down[:-1])
    both = down.copy()
    extreme(both[:, 1:], down[:, :-1], out=both[:, 1:])
    extreme(both[:, :-1], down[:, 1:], out=both[:, :-1])
    return both


def _error_per_change(
    coordinate: FloatMap, variance: FloatMap, change: FloatMap, most_px: float
) -> float:
    """Squared error of the coordinate per squared relative change of the background, px²."""
    stride = -(-coordinate.size // SAMPLED)
    excesses, leverages = [], []
    for x, v, g in ((coordinate, variance, change), (coordinate.T, variance.T, change.T)):
        x, v, g = x[::stride], v[::stride], g[::stride]
        difference = third_difference(x, 1)
        known = np.isfinite(difference) & (np.abs(difference) < most_px)
        expected = third_difference_variance(v, 1)[known]
        with np.errstate(divide="ignore", invalid="ignore"):
            excesses.append(np.minimum(difference[known] ** 2 / expected, MOST) - 1.0)
            leverages.append(third_difference_variance(g, 1)[known] / expected)
    excess, leverage = np.concatenate(excesses), np.concatenate(leverages)
    if excess.size < MIN_DIFFERENCES:
        return 0.0
    found = 0.0
    for least in np.quantile(leverage, STRONG_EDGES):
        strong = leverage >= max(least, 1e-12)
        if strong.any():
            found = max(found, float(excess[strong].mean() / leverage[strong].mean()))
    return found
