"""Running envelopes of frames, for their decomposition into two-dimensional modes."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.signal.bands import row_bands
from fringeworks.types import FloatMap

GROWTH = 1.5
"""Smallest ratio of the windows of successive modes of a frame.

Without it, successive modes could use the same window and hold the same waves. An empirical choice.
"""

MIN_EXTREMA = 8
"""Smallest number of maxima and of minima in a frame that has another mode.

With fewer, their mean distance does not determine a window. An empirical choice.
"""


def most_modes(shape: tuple[int, ...], max_imfs: int) -> int:
    """Largest number of modes of a frame, whose windows grow from 3 px to its shorter side."""
    growing = np.log(max(min(shape), 3) / 3.0) / np.log(GROWTH)
    return min(max_imfs, 1 + int(growing))


def odd(width: float) -> int:
    """The smallest odd whole number that is not below a width."""
    return 2 * int(np.ceil(0.5 * (width - 1.0))) + 1


def spacing(frame: FloatMap) -> int | None:
    """Mean distance of extrema as an odd number of px; None where there are too few."""
    if min(frame.shape) < 3 or float(np.ptp(frame)) == 0.0:
        return None
    counts = [0, 0]
    for band in row_bands(frame.shape, bytes_per_px=32, halo=1):
        part = frame[band.seen]
        ends = scipy.ndimage.maximum_filter(part, 3), scipy.ndimage.minimum_filter(part, 3)
        varying = ends[0] > ends[1]
        for k, end in enumerate(ends):
            counts[k] += int(np.count_nonzero(((part == end) & varying)[band.inner]))
    count = min(counts)
    if count < MIN_EXTREMA:
        return None
    return max(3, odd(float(np.sqrt(frame.size / count))))


def envelope_mean(frame: FloatMap, window: int) -> NDArray[np.float64]:
    """Mean of the upper and the lower running envelope."""
    mean = np.empty(frame.shape)
    for band in row_bands(frame.shape, bytes_per_px=32, halo=window, least=4 * window):
        part = frame[band.seen]
        upper = scipy.ndimage.uniform_filter(scipy.ndimage.maximum_filter(part, window), window)
        lower = scipy.ndimage.uniform_filter(scipy.ndimage.minimum_filter(part, window), window)
        upper += lower
        del lower
        upper *= 0.5
        mean[band.rows] = upper[band.inner]
    return mean
