"""Where a frame shows no fringes at all: holes, gaps and shadows within a lit surface."""

from __future__ import annotations

import numpy as np
import scipy

from fringeworks.signal.bands import row_bands
from fringeworks.signal.filters import box_mean
from fringeworks.types import BoolMap, FloatMap

MIN_LOCAL_SHARE = 0.1
"""Smallest modulation that counts as fringes, as a share of the median modulation around it.

Dark paint reflects a tenth of the light or more; what shines through a hole is weaker. An empirical
choice.
"""
MIN_FRAME_SHARE = 0.05
"""Smallest modulation that counts as fringes, as a share of the frame's median modulation.

It decides in shadows that are wider than the surroundings of ``SURROUNDINGS_PERIODS``. An empirical
choice.
"""
MIN_VARIANCE_RATIO = 4.0
"""Smallest variance of the fringes around a place, over that of the noise, at which a place without
fringes can be recognised.

Fringes that are weaker do not stand out in a box of one period; only methods that average over
larger windows can judge them. An empirical choice.
"""
BOX_PERIODS = 0.25
"""Height of the box in which the contrast is measured, periods; its width is one period.

A box of one period holds a maximum and a minimum; a low one comes close to the rim of a hole.
"""
SURROUNDINGS_PERIODS = 3.0
"""Side of the square over which the median contrast is taken, periods.

A hole of two periods covers less than half of it. An empirical choice.
"""
REACH_PERIODS = 1.5
"""Distance over which a place without fringes is extended to its rim, periods.

The box of one period does not reach the ends of a round hole, nor parts that are lit unevenly. An
empirical choice.
"""
MIN_SHARE = 1e-6
"""Smallest sum of weights in a local mean; it keeps the quotient finite."""


def without_fringes(
    frame: FloatMap, ok: BoolMap, period_px: float, noise_variance: float
) -> BoolMap:
    """Find the places of a frame that show no fringes although the surface around them does.

    Parameters
    ----------
    frame : (h, w) float array
        Finite counts; the fringes vary along x.
    ok : (h, w) bool array
        False for pixels whose counts are no measurement (saturated, filled); boxes with such
        pixels are not judged.
    period_px : float > 0
        Mean period of the fringes.
    noise_variance : float ≥ 0
        Variance of the frame's noise, counts².

    Returns
    -------
    (h, w) bool array, True where there are no fringes.

    Notes
    -----
    A band-pass or a large window reports the fringes around a hole inside it, so the contrast is
    measured in boxes no larger than needed: one period wide, a quarter of a period high. Fringes of
    amplitude B add B²/2 to the variance of such a box. A box whose variance is not above that of
    the noise and of fringes of the smallest modulation has none. Its pixels are marked, and so are
    the pixels between it and the rim.
    """
    side = max(3, round(BOX_PERIODS * period_px))
    wide = (side, max(3, round(period_px)))
    contrast = _box_variance(frame, wide)
    around = _Surroundings(contrast, period_px)
    whole = max(float(np.median(contrast)) - noise_variance, 0.0)
    # In a wide shadow only fringes that would stand out from the noise can be said to be missing.
    in_frame = MIN_FRAME_SHARE**2 * whole
    in_frame = in_frame if in_frame > noise_variance else 0.0
    flat = np.empty(frame.shape, bool)
    for band in row_bands(frame.shape, bytes_per_px=24):
        usual = np.maximum(around.median(band.rows) - noise_variance, 0.0)
        least = np.maximum(MIN_LOCAL_SHARE**2 * usual, in_frame)
        clear = (usual > MIN_VARIANCE_RATIO * noise_variance) | (in_frame > 0.0)
        limit = np.where(clear, noise_variance + least, -1.0)
        flat[band.rows] = contrast[band.rows] <= limit
    del contrast
    if not ok.all():
        flat &= ~scipy.ndimage.maximum_filter(~ok, _odd(wide))
    if not flat.any():
        return np.asarray(flat)
    core = scipy.ndimage.maximum_filter(flat, _odd(wide))
    return _grown_to_rim(frame, core, period_px)


def _grown_to_rim(frame: FloatMap, core: BoolMap, period_px: float) -> BoolMap:
    """Extend places without fringes up to their rim, where the brightness changes.

    Pixels within reach are added where they are connected with the place, and closer in brightness
    to it than to the darkest (or brightest) fringes of the surface around it.
    """
    near = scipy.ndimage.distance_transform_edt(~core) <= REACH_PERIODS * period_px
    surroundings = ~near
    # Sums of small numbers keep their digits in single precision.
    centred = np.subtract(frame, frame.mean(dtype=np.float64), dtype=np.float32)
    inside = _local_mean(centred, core, period_px)
    surface = _local_mean(centred, surroundings, period_px)
    square = (centred - surface) ** 2
    amplitude = np.sqrt(2.0 * np.maximum(_local_mean(square, surroundings, period_px), 0.0))
    dark, bright = surface - amplitude, surface + amplitude
    alike = (inside < dark) & (centred < 0.5 * (inside + dark))
    alike |= (inside > bright) & (centred > 0.5 * (inside + bright))
    return np.asarray(scipy.ndimage.binary_propagation(core, mask=core | (near & alike)))


def _local_mean(values: FloatMap, where: BoolMap, sigma_px: float) -> FloatMap:
    """Means of some pixels around every one, (h, w) float32, with the weights of three moving means
    that together have the variance of a Gaussian of ``sigma_px``.

    They take the same time for any width. A moving mean over s pixels has the variance
    (s² − 1)/12.
    """
    side = round((4.0 * sigma_px**2 + 1.0) ** 0.5) | 1
    share = where.astype(np.float32)
    total = np.where(where, values, np.float32(0.0))
    for _ in range(3):
        share, total = box_mean(share, side), box_mean(total, side)
    return np.asarray(total / np.maximum(share, np.float32(MIN_SHARE)))


def _odd(sides: tuple[int, int]) -> tuple[int, int]:
    """Sides of the smallest symmetric box that stays within a box of ``sides``, px."""
    return sides[0] - 1 + sides[0] % 2, sides[1] - 1 + sides[1] % 2


def _box_variance(frame: FloatMap, sides: tuple[int, int]) -> FloatMap:
    """Variance of a frame in boxes of ``sides`` (rows, columns) around every pixel, counts²."""
    variance = np.empty(frame.shape, np.float32)
    mean_counts = frame.mean(dtype=np.float64)
    for band in row_bands(frame.shape, bytes_per_px=16, halo=sides[0]):
        centred = np.empty(frame[band.seen].shape, np.float32)
        np.subtract(frame[band.seen], mean_counts, out=centred, casting="same_kind")
        mean = scipy.ndimage.uniform_filter(centred, sides, mode="nearest")
        centred *= centred
        square = scipy.ndimage.uniform_filter(centred, sides, mode="nearest")
        mean *= mean
        square -= mean
        variance[band.rows] = np.maximum(square, 0.0, out=square)[band.inner]
    return variance


class _Surroundings:
    """Median of a map over squares of ``SURROUNDINGS_PERIODS``, computed on a coarser lattice."""

    def __init__(self, values: FloatMap, period_px: float) -> None:
        step = max(1, round(BOX_PERIODS * period_px))
        side = max(3, round(SURROUNDINGS_PERIODS * period_px / step))
        self._coarse = scipy.ndimage.median_filter(values[::step, ::step], side, mode="nearest")
        self._rows, self._columns = (
            np.minimum(np.arange(n) // step, -(-n // step) - 1) for n in values.shape
        )

    def median(self, rows: slice) -> FloatMap:
        """Median around the pixels of some rows, (r, w)."""
        return np.asarray(self._coarse[np.ix_(self._rows[rows], self._columns)])
