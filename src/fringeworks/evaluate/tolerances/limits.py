"""Points of a surface that stand for all of it: those that can limit a zone, and those of means."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.types import FloatMap

BINS = 20
"""Bins along each side of an area. Of each, the highest and lowest point count: of a smooth surface
no other can limit a zone."""
EVEN_POINTS = 5_000
"""Points of a surface of which a share is left out: 15 of them are 0.3 %."""


def all_over(kept: NDArray[np.intp]) -> tuple[NDArray[np.intp], FloatMap]:
    """Return points all over an area, and the number of pixels that each stands for in means."""
    pixel = kept[:: -(-len(kept) // EVEN_POINTS)]
    return pixel, np.full(len(pixel), len(kept) / len(pixel))


def with_all(
    limits: NDArray[np.intp], even: tuple[NDArray[np.intp], FloatMap]
) -> tuple[NDArray[np.intp], FloatMap]:
    """Return points that can limit a zone beside even ones, which alone count in means.

    Caps and arcs hold their centre or axis by their curvature alone. The middles of bins, of which
    a form has few for each wave, moved centres of balls by up to 3 % of the form.
    """
    pixel, weight = even
    others = np.setdiff1d(limits, pixel)
    return np.concatenate((pixel, others)), np.concatenate((weight, np.zeros(len(others))))


def limiting(
    unit: FloatMap, value: FloatMap, kept: NDArray[np.intp]
) -> tuple[NDArray[np.intp], FloatMap]:
    """Return points that can limit a zone, and the number of pixels that each is for in means."""
    place, height = unit[kept], value[kept]
    row, column = np.minimum((place * BINS).astype(int), BINS - 1).T
    bins = row * BINS + column
    order = np.lexsort((height, bins))
    last = np.append(np.flatnonzero(np.diff(bins[order])), len(order) - 1)
    first = np.append(0, last[:-1] + 1)
    extremes = [order[first], order[last]]
    for strip, along in ((row, place[:, 1]), (column, place[:, 0])):
        ranked = np.lexsort((along, strip))
        end = np.append(np.flatnonzero(np.diff(strip[ranked])), len(ranked) - 1)
        extremes += [ranked[np.append(0, end[:-1] + 1)], ranked[end]]
    # A tilt to a datum makes corners the extremes, whatever the form.
    if (np.ptp(place, axis=0) > 0).all() and len(place) > 3:
        with suppress(scipy.spatial.QhullError):  # places on a line have ends alone
            extremes.append(scipy.spatial.ConvexHull(place).vertices)
    # A point of each bin in the order of the pixels is near its middle.
    by_bin = np.argsort(bins, kind="stable")
    middle = by_bin[(first + last) // 2]
    limits = np.setdiff1d(np.concatenate(extremes), middle)
    weight = np.concatenate((last - first + 1.0, np.zeros(len(limits))))
    return kept[np.concatenate((middle, limits))], weight
