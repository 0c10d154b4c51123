"""Start of the windowed inversion (theory §4, "Start")."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.pair.bandpass import HALF_WIDTH, band_kernel
from fringeworks.pair.methods.fourier import fourier
from fringeworks.pair.orders import continues, guided_count
from fringeworks.pair.prepared import QUANTISATION_VARIANCE, PreparedPair, fill_nearest
from fringeworks.signal.bands import row_bands
from fringeworks.signal.filters import enlarged, gaussian, reduced
from fringeworks.types import BoolMap, FloatMap

MIN_START_EXPLAINED = 0.15
"""Smallest share of the local contrast that a counted start must explain in gaps of the band-pass.

Counts of noise explain a few per cent of windows of a period. An empirical choice.
"""
MAX_BAND_SLOPE = 0.3
"""Largest slope of the displacement along x up to which the band-pass alone is the start, px/px.

A steeper surface stretches fringes out of the pass band. An empirical choice.
"""
COUNT_THRESHOLD = 0.03
"""Mean difference between counting and band-pass from which counting is used, periods.

At twice that value it replaces the band-pass in full. Below it the difference is mostly scatter of
the counting. An empirical choice.
"""
COUNT_SMOOTHING = 0.25
"""Width of the Gaussian that smooths a counted start, periods.

It reduces the scatter of single pixels and keeps folds. An empirical choice.
"""
TRUNCATION = 3.0
"""Distance at which the Gaussians of the start are cut off, σ."""
BLOCKS_PER_WIDTH = 4
"""Blocks per width of a Gaussian of which only comparisons are made."""
MIN_SHARE_COUNTED = 1e-6
"""Smallest sum of weights in the local mean of counted pixels; it keeps the quotient finite."""
FOLD_THRESHOLD = 0.125
"""Difference between a wide and a narrow smoothing of the start that is kept as a fold, periods.

At twice that value the narrow one replaces the wide one in full. Below it the difference may be
ripple: steep faces and edges of paint leak into the band. An empirical choice.
"""


class Start(NamedTuple):
    """The displacement that the windowed inversion starts from."""

    displacement_px: NDArray[np.float32]
    """(h, w), px; finite everywhere."""
    removed_px: NDArray[np.float32]
    """What its smoothing has removed, (h, w), px."""
    kept: NDArray[np.float32]
    """Share of the details that it has kept, (h, w), 0…1."""
    fine_px: float
    """Width σ of the kernel that fringes are seen through with all details, px."""
    wide_px: float
    """The same without any, px."""


def start_field(prepared: PreparedPair, width_px: float) -> Start:
    """Estimate the displacement that the windowed inversion starts from.

    Parameters
    ----------
    prepared : PreparedPair
    width_px : float > 0
        Width σ of the smoothing, px.

    Notes
    -----
    Theory §4, "Start". The band-pass alone is used where it has no gaps and no steep slopes.
    Otherwise it may have rounded off or lost what fringe counting still measures. Counting then
    replaces it where the two differ on average over a period. The first window cannot correct what
    varies faster than itself, so only folds that exceed the start's own ripple are kept sharp.
    """
    fine = min(width_px, COUNT_SMOOTHING * prepared.period)
    band_px = float(band_kernel(prepared.frequency, HALF_WIDTH, 2)[1])
    kernels = float(np.hypot(fine, band_px)), float(np.hypot(width_px, band_px))
    start = _with_orders(prepared, fourier(prepared).displacement_px, fine)
    wide = smoothed(start, width_px)
    details = smoothed(start, fine) - wide
    kept = _ramp(details, FOLD_THRESHOLD * prepared.period)
    maps = (wide + kept * details, (1.0 - kept) * details, kept)
    displacement, removed, share = (np.asarray(values, np.float32) for values in maps)
    return Start(displacement, removed, share, *kernels)


def _with_orders(prepared: PreparedPair, band: FloatMap, fine_px: float) -> FloatMap:
    """The band-pass, with counted fringes where it has gaps or is steep; finite everywhere."""
    known = np.isfinite(band)
    if not known.any():
        return np.zeros(band.shape)
    band = fill_nearest(band, known)
    if known.all() and np.abs(np.diff(band, axis=1)).max() <= MAX_BAND_SLOPE:
        return band
    counted = guided_count(prepared, lambda: np.where(known, band, np.nan)).displacement_px
    start = _with_counts(band, known, counted, prepared.period)
    # Counting can slip. Near the band-pass it is kept where it explains the object better.
    better = _explained(prepared, smoothed(start, fine_px)) > _explained(prepared, band)
    if not known.all():
        # Slipped counts fit the noise of single pixels, but not when they are smoothed.
        coarse = smoothed(start, 0.5 * prepared.period)
        better &= known | (_explained(prepared, coarse, 1.0) > MIN_START_EXPLAINED)
    return np.where(better, start, band)


def _with_counts(band: FloatMap, known: BoolMap, counted: FloatMap, period_px: float) -> FloatMap:
    """Band-pass, moved to the counted displacement where the two differ over half a period.

    Whole periods fit everywhere, so in gaps of the band-pass counting must continue its rim.
    """
    half_period = 0.5 * period_px
    with np.errstate(invalid="ignore"):
        usable = np.abs(counted - band) < half_period
    usable &= np.isfinite(counted)
    usable |= continues(counted, np.where(known, band, np.nan), period_px)
    difference = np.where(usable, counted - band, 0.0)
    share = smoothed(usable.astype(float), half_period)
    mean = smoothed(difference, half_period) / np.maximum(share, MIN_SHARE_COUNTED)
    trust = _ramp(mean, COUNT_THRESHOLD * period_px)
    trust[~known] = 1.0
    return band + trust * np.where(usable, difference, mean)


def _explained(
    prepared: PreparedPair, displacement_px: FloatMap, window_periods: float = 0.5
) -> FloatMap:
    """Share of the object's local contrast that the reference, moved by a displacement, explains.

    The object is compared with offset and modulation ratio times the moved reference over a
    Gaussian window of ``window_periods``; 0…1. A negative ratio explains nothing.
    """
    d, s = (np.empty(displacement_px.shape, np.float32) for _ in range(2))
    for band in row_bands(d.shape, bytes_per_px=48):
        u = displacement_px[band.rows]
        rows, columns = (np.asarray(at) for at in np.indices(u.shape, dtype=np.float64))
        columns = columns - u
        counts = prepared.reference[band.rows].astype(np.float64)
        moved = scipy.ndimage.map_coordinates(counts, (rows, columns), order=1, mode="nearest")
        s[band.rows] = moved - prepared.mean_brightness
        d[band.rows] = prepared.object[band.rows] - prepared.mean_brightness
    width = window_periods * prepared.period
    mean_d, mean_s = _local_mean(d, width), _local_mean(s, width)
    covariance = np.maximum(_local_mean(d * s, width) - mean_d * mean_s, 0.0)
    variance_s = np.maximum(_local_mean(s * s, width) - mean_s**2, QUANTISATION_VARIANCE)
    variance_d = np.maximum(_local_mean(d * d, width) - mean_d**2, QUANTISATION_VARIANCE)
    share: FloatMap = covariance**2 / (variance_s * variance_d)
    return share


def _ramp(values: FloatMap, threshold: float) -> FloatMap:
    """Weight that rises from 0 at |value| = threshold to 1 at twice the threshold."""
    return np.clip(np.abs(values) / threshold - 1.0, 0.0, 1.0)


def smoothed(values: FloatMap, width_px: float) -> FloatMap:
    """Smooth a map with a Gaussian of σ = ``width_px``."""
    return gaussian(values, width_px, int(TRUNCATION * width_px + 0.5))


def _local_mean(values: FloatMap, width_px: float) -> FloatMap:
    """About the same, fast for large widths: on blocks of a quarter of the width."""
    h, w = values.shape
    block = min(max(1, int(width_px / BLOCKS_PER_WIDTH)), h, w)
    blocks = reduced(values, (h // block, w // block))
    return enlarged(smoothed(blocks, width_px / block), (h, w))
