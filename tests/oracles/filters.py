"""Readable twins of the filters of images, in NumPy and SciPy."""

from __future__ import annotations

import numpy as np
import scipy

MODES = {"edge": "nearest", "mirror": "mirror", "zero": "constant"}
"""SciPy's names of what lies beyond the border."""


def box_means(values, side, border):
    """Means of squares."""
    return scipy.ndimage.uniform_filter(values.astype(np.float64), side, mode=MODES[border])


def weighted_sums(values, weights_y, weights_x, border, step=1):
    """Weighted sums along y, then along x, of every ``step``-th pixel."""
    sums = values.astype(np.float64)
    for axis, weights in enumerate((weights_y, weights_x)):
        sums = scipy.ndimage.correlate1d(sums, weights, axis, mode=MODES[border])
    return sums[::step, ::step]


def median_of_nine(values):
    """Medians of squares of 3 px; NaN where one is."""
    padded = np.pad(values, 1, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3))
    return np.median(windows.reshape(*values.shape, 9), axis=-1)


def widen(marks, reach):
    """What is within a distance of a mark."""
    return scipy.ndimage.maximum_filter(marks, 2 * reach + 1, mode="constant", cval=False)


def area_means(values, rows, columns):
    """Means of areas: differences of the integral of the map at their borders."""
    for axis, count in enumerate((rows, columns)):
        n = values.shape[axis]
        integral = np.insert(np.cumsum(values, axis, dtype=np.float64), 0, 0.0, axis)
        borders = np.arange(count + 1) * (n / count)
        at = scipy.interpolate.make_interp_spline(np.arange(n + 1), integral, 1, axis=axis)
        values = np.diff(at(borders), axis=axis) * (count / n)
    return values


def interpolate_linear(values, rows, columns):
    """Values between pixels."""
    h, w = values.shape
    y, x = np.clip(rows, 0, h - 1), np.clip(columns, 0, w - 1)
    places = np.meshgrid(y, x, indexing="ij")
    return scipy.ndimage.map_coordinates(values.astype(np.float64), places, order=1, mode="nearest")
