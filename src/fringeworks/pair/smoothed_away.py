"""What a method smooths away of a curved surface, predicted from its result and its kernels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.pair.registry import Smoothing
from fringeworks.signal.bands import by_bands
from fringeworks.signal.filters import smooth_known
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
ROUGH_PERIODS = (0.4, 0.6)
"""Smallest and largest width of the Gaussian beyond which a filter's result is rough, periods.

It is that of the method's widest kernel between them. A filter about the carrier cannot follow a
surface there: what it shows is mostly leakage from edges. Measured on painted and stepped scenes.
"""
ROUGH_SPREAD_PERIODS = 0.5
"""Width of the Gaussian over which the square of it is averaged, periods."""
MARGIN_WIDTHS = 3.0
"""Width of the border by which the displacement is continued, widths of the widest kernel."""
LEVEL_STEP = 4
"""Every so many rows and columns determine the level that displacements are taken from."""
FREQUENCIES = 96
"""Frequencies along each axis at which the spectrum of the noise is summed."""
LARGEST_FREQUENCY = 3.0
"""Largest of these frequencies, rad over the smallest width; the noise has exp(−9) there."""


@dataclass(frozen=True)
class SmoothedAway:
    """What a method smooths away of a curved surface; see ``smoothed_away``."""

    lost: FloatMap
    """Variance of what the kernels remove, noise included, (h, w), px²."""
    rough: FloatMap
    """Mean square of what changes within a rough result's width, noise included, (h, w), px²."""
    noise_shares: tuple[float, float]
    """Shares of the noise's variance that ``lost`` and ``rough`` contain."""

    def beside(self, noise_px: FloatMap) -> FloatMap:
        """Variance that is smoothed away of the surface alone, (h, w), px².

        Parameters
        ----------
        noise_px : (h, w) float array
            Standard deviation of the displacement's noise, px; NaN where unknown.
        """
        noise = np.where(np.isfinite(noise_px), noise_px, 0.0)
        noise *= noise
        of_lost, of_rough = self.noise_shares
        variance = self.lost - of_lost * noise
        noise *= of_rough
        np.subtract(self.rough, noise, out=noise)
        np.maximum(variance, noise, out=variance)
        return np.asarray(np.maximum(variance, 0.0, out=variance))


def smoothed_away(
    displacement_px: FloatMap,
    known: BoolMap,
    period_px: float,
    smoothing: tuple[Smoothing, ...],
    noise_length_px: tuple[float, float],
) -> SmoothedAway:
    """Predict what a method smooths away of a curved surface.

    Parameters
    ----------
    displacement_px : (h, w) float array
        px.
    known : (h, w) bool array
        True where the displacement and the standard deviation of its noise are finite.
    period_px : float > 0
    smoothing : tuple of Smoothing
    noise_length_px : (float, float)
        Width σ of the Gaussian kernel that correlates the noise along y and x, px.

    Notes
    -----
    With a kernel K, u = K∗t + noise of a surface t, so that t − u = (1 − K)t ≈ (1 − K)(2 − K)u to
    second order. A method that corrects for a curvature averaged by a kernel C leaves
    (1 − K)(1 − C)t. Where the displacement is rough, filters leak from edges, and the mean square
    of u − G∗u is taken if that is larger. The noise passes the same filters; its share is
    subtracted (``SmoothedAway.beside``).
    """
    rough_px = _rough_width(smoothing, period_px)
    shares = _noise_shares(smoothing, noise_length_px, rough_px)
    if not known.any():
        nothing = np.zeros(displacement_px.shape)
        return SmoothedAway(nothing, nothing, shares)
    level = _level(displacement_px, known)
    rough = _single(displacement_px, known, level)
    rough = _roughness(rough, known, rough_px, period_px)
    removed = _removed(_single(displacement_px, known, level), known, smoothing)
    np.abs(removed, out=removed)
    removed[~known] = 0.0
    spread = SPREAD_PERIODS * period_px
    lost = smooth_known(removed, known, (spread, spread))
    del removed
    lost *= MEAN_TO_SIGMA
    lost *= lost
    return SmoothedAway(lost, rough, shares)


def _roughness(rough: FloatMap, known: BoolMap, rough_px: float, period_px: float) -> FloatMap:
    """Mean square of what changes within a width, (h, w), px²; overwrites the displacement."""
    spread = ROUGH_SPREAD_PERIODS * period_px
    rough -= smooth_known(rough, known, (rough_px, rough_px))
    rough[~known] = 0.0
    rough *= rough
    return smooth_known(rough, known, (spread, spread))


def _widest(smoothing: tuple[Smoothing, ...]) -> float:
    return max(max(s.width_px) for s in smoothing)


def _rough_width(smoothing: tuple[Smoothing, ...], period_px: float) -> float:
    least, most = ROUGH_PERIODS
    return min(max(_widest(smoothing), least * period_px), most * period_px)


def without(values: FloatMap, known: BoolMap, width_px: tuple[float, float]) -> FloatMap:
    """What a Gaussian of these widths along y and x removes of a map; 0 where unknown."""
    rest = smooth_known(values, known, width_px)
    np.subtract(values, rest, out=rest)
    rest[~known] = 0.0
    return rest


def _removed(u: FloatMap, known: BoolMap, smoothing: tuple[Smoothing, ...]) -> FloatMap:
    """What the kernels remove, (h, w), px; the surface goes on with its slope at the border."""
    margin = [(min(int(MARGIN_WIDTHS * _widest(smoothing)) + 1, n - 1),) * 2 for n in u.shape]
    padded = np.pad(u, margin, mode="reflect", reflect_type="odd")
    del u
    where = np.pad(known, margin, mode="reflect")

    total: FloatMap | None = None
    for kernel in smoothing:
        once = without(padded, where, kernel.width_px)
        if kernel is smoothing[-1]:
            del padded
        over = kernel.corrected_over_px
        part = without(once, where, kernel.width_px if over is None else over)
        if over is None:
            part += once
        del once
        part *= np.float32(kernel.share)
        if total is not None:
            part += total
        total = part
    assert total is not None
    inner = tuple(slice(a, n - b) for (a, b), n in zip(margin, total.shape, strict=True))
    return np.ascontiguousarray(total[inner])


def _level(u: FloatMap, known: BoolMap) -> float:
    """Median of some of the known pixels, px; any level near them keeps single precision."""
    some = u[::LEVEL_STEP, ::LEVEL_STEP][known[::LEVEL_STEP, ::LEVEL_STEP]]
    return float(np.median(some)) if some.size else 0.0


def _single(u: FloatMap, known: BoolMap, level: float) -> FloatMap:
    """Values above a level in single precision, 0 where unknown."""
    return by_bands(lambda v, ok: np.where(ok, v - level, 0), u, known, dtype=np.float32)


def _noise_shares(
    smoothing: tuple[Smoothing, ...], noise_length_px: tuple[float, float], rough_px: float
) -> tuple[float, float]:
    """Variance that the kernels remove from noise, and that of its roughness, over its variance."""
    widths = (rough_px, *noise_length_px, *(w for s in smoothing for w in s.width_px))
    k = np.linspace(0.0, LARGEST_FREQUENCY / min(w for w in widths if w > 0), FREQUENCIES)

    def response(width_px: tuple[float, float]) -> FloatMap:
        return np.exp(-0.5 * ((k[:, None] * width_px[0]) ** 2 + (k * width_px[1]) ** 2))

    removed = np.zeros((FREQUENCIES, FREQUENCIES))
    for kernel in smoothing:
        passed = response(kernel.width_px)
        over = kernel.corrected_over_px
        removed += (
            kernel.share * (1 - passed) * (2 - passed if over is None else 1 - response(over))
        )
    noise = response(noise_length_px) ** 2
    rough = 1 - response((rough_px, rough_px))
    total = float(np.sum(noise))
    return float(np.sum(noise * removed**2)) / total, float(np.sum(noise * rough**2)) / total
