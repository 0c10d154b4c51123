"""Colours between the filters of a mosaic, by the line on which the colours around a pixel lie."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from fringeworks._lazy import scipy
from fringeworks.signal.bands import row_bands
from fringeworks.types import CameraNoise, FloatMap

COLOURS = 3
"""Red, green and blue."""
PASSES = 5
"""Number of passes, each with the spread of the colours that the last one gave. Three leave 1.6
times the error at edges that are parallel to the columns; eight change nothing."""
HALO = PASSES + 1
"""Rows on either side that the result of a row depends on: one for each pass, and for the
interpolation before."""
BYTES_PER_PX = 200
"""Memory of a band, bytes per pixel: 25 arrays of float64, which keep small variances of large
counts."""
LEAST_ROWS = 32
"""Smallest number of rows of a band, so that the rows on either side take little time."""
SAMPLED_PX = 200_000
"""Approximate number of pixels of a channel that its noise is measured by."""
MEDIAN_OF_SMALLEST = 0.550
"""Median of the smallest of four second differences of independent noise, over its standard
deviation: of four million simulated ones."""
DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1))
"""Rows and columns from a pixel to the next one in each direction."""
LIT_SHARE = 0.1
"""Brightness of a pixel, as a share of the 99th percentile, from which on it tells the noise."""
LEVELS = 4
"""Number of levels of brightness at which the noise is measured."""
FEWEST = 64
"""Smallest number of lit pixels that tell the noise of a channel."""
LEAST = 1e-12
"""Smallest variance, counts², so that black without noise divides by something."""
LEAST_NOISE = 1e-6
"""Smallest noise, as a share of the counts: ten times the rounding of float32, in which they were
added up."""


def colours_of_mosaic(
    own: NDArray[np.float32], channels: NDArray[np.intp], noise: Sequence[CameraNoise]
) -> NDArray[np.float32]:
    """Red, green and blue of every pixel behind a mosaic, (h, w, 3).

    Parameters
    ----------
    own : (h, w) float32 array
        What each pixel shows through its own filter.
    channels : (2, 2) array
        Channel of the filters of the first two rows and columns: 0, 1 or 2.
    noise : of each channel

    Notes
    -----
    Beside an edge, colours are mixtures of two paints: they lie on a line. So does the pixel's, at
    the place that its own filter shows. With the mean m and the covariance C of the colours around
    a pixel, and its own count v of channel o, the colour is m + C[:, o] (v − m[o]) / (C[o, o] +
    σ²), the most likely one of normal colours. Red may fall where blue rises, and noise alone moves
    nothing, other than with interpolation along edges. The colours around a pixel are first
    interpolated linearly, and then those of the pass before.
    """
    found = np.empty((*own.shape, COLOURS), np.float32)
    for band in row_bands(own.shape, BYTES_PER_PX, halo=HALO, least=LEAST_ROWS):
        v = np.arange(band.seen.start, band.seen.stop) % 2
        part = own[band.seen].astype(np.float64)
        channel = channels[np.ix_(v, np.arange(own.shape[1]) % 2)]
        found[band.rows] = np.moveaxis(_planes(part, channel, noise)[:, band.inner], 0, -1)
    return found


def _planes(own: FloatMap, channel: NDArray[np.intp], noise: Sequence[CameraNoise]) -> FloatMap:
    """The colours of a band, (3, h, w), whose outermost rows are less exact."""
    behind = [channel == c for c in range(COLOURS)]
    known = [spread(own * here) / spread(here.astype(np.float64)) for here in behind]
    planes = np.stack([np.where(here, own, p) for here, p in zip(behind, known, strict=True)])
    weight = 1.0 / spread(np.ones(own.shape))
    variance = np.select(behind, [one.variance(own) for one in noise])
    np.maximum(variance, np.maximum((LEAST_NOISE * own) ** 2, LEAST), out=variance)
    for _ in range(PASSES):
        mean = np.stack([spread(plane) * weight for plane in planes])
        off = own - np.select(behind, list(mean))
        gain, square = np.empty_like(planes), variance.copy()
        for c, d in combinations_with_replacement(range(COLOURS), 2):
            both = spread(planes[c] * planes[d])
            both *= weight
            both -= mean[c] * mean[d]
            np.copyto(gain[d], both, where=behind[c])
            np.copyto(gain[c], both, where=behind[d])
            if c == d:
                np.add(square, np.maximum(both, 0.0), out=square, where=behind[c])
        np.multiply(gain, off / square, out=planes)
        planes += mean
        for plane, here in zip(planes, behind, strict=True):
            np.copyto(plane, own, where=here)
    return planes


def spread(values: FloatMap) -> FloatMap:
    """Sum over 3 × 3 pixels with the weights of linear interpolation, 1, 2, 1 along both axes, and
    0 beyond the border."""
    for axis in (0, 1):
        total = 2.0 * values
        rows = np.moveaxis(total, axis, 0), np.moveaxis(values, axis, 0)
        rows[0][1:] += rows[1][:-1]
        rows[0][:-1] += rows[1][1:]
        values = total
    return values


def noise_of_mosaic(
    own: NDArray[np.float32], channels: NDArray[np.intp]
) -> tuple[CameraNoise, CameraNoise, CameraNoise]:
    """Noise of what each pixel shows through its own filter, by channel.

    Second differences between neighbouring pixels of one filter tell it, at several levels of
    brightness. The median is taken of the smallest one of four directions, which runs along edges.
    """
    red, green, blue = (_noise(own, channels, c) for c in range(COLOURS))
    return red, green, blue


def _noise(own: NDArray[np.float32], channels: NDArray[np.intp], number: int) -> CameraNoise:
    row, column = np.argwhere(channels == number)[0]
    plane = own[row::2, column::2]
    if min(plane.shape) < 3:
        return CameraNoise(0.0, 0.0)
    step = max(1, plane.size // SAMPLED_PX)
    middle = plane[1:-1:step, 1:-1].astype(np.float64)
    height, width = plane.shape
    second, light = np.full(middle.shape, np.inf), middle.copy()
    for v, u in DIRECTIONS:
        one = plane[1 + v : height - 1 + v : step, 1 + u : width - 1 + u]
        other = plane[1 - v : height - 1 - v : step, 1 - u : width - 1 - u]
        np.minimum(second, np.abs(one + other - 2.0 * middle), out=second)
        light += one
        light += other
    # The mean of nine pixels: the count of one alone would order them by its noise.
    light /= 1 + 2 * len(DIRECTIONS)
    lit = light > LIT_SHARE * np.quantile(light, 0.99)
    if np.count_nonzero(lit) < FEWEST:
        return CameraNoise(0.0, 0.0)
    light, second = light[lit], second[lit]
    levels = np.array_split(np.argsort(light), LEVELS)
    design = np.array([(1.0, np.mean(light[k])) for k in levels])
    found = np.array([np.median(second[k]) / MEDIAN_OF_SMALLEST for k in levels]) ** 2
    scale = np.maximum(found, LEAST)
    read, gain = scipy.optimize.nnls(design / scale[:, None], found / scale)[0]
    return CameraNoise(float(np.sqrt(read)), float(gain))
