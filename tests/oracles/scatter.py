"""Mean χ² of third differences around every pixel, with the filters of SciPy."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from fringeworks.statistics.third_difference import third_difference, third_difference_variance


def mean_chi(coordinate, sigma, scale, most_px, excess, shared) -> np.ndarray:
    """The mean where it is significant, otherwise 1; (h, w)."""
    step, side = scale
    square, count = np.zeros(coordinate.shape), np.zeros(coordinate.shape)
    for x, variance, total, number in (
        (coordinate, sigma**2, square, count),
        (coordinate.T, (sigma**2).T, square.T, count.T),
    ):
        difference = third_difference(x, step)
        known = np.abs(difference) < most_px
        with np.errstate(invalid="ignore"):
            chi = difference**2 / third_difference_variance(variance, step)
        for place in (step, 2 * step):  # the two middle pixels, which weigh most
            part = np.s_[:, place : place + chi.shape[1]]
            total[part] += np.where(known, chi, 0.0)
            number[part] += known
    square = side**2 * ndimage.uniform_filter(square, side)
    count = np.rint(side**2 * ndimage.uniform_filter(count, side))
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = square / count
        significant = mean > 1.0 + excess * np.sqrt(2.0 * shared / count)
    return np.where((count > 0.5) & significant, mean, 1.0)
