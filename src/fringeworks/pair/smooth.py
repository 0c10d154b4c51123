"""Smoothing of maps by Gaussian kernels of any width, at a cost that does not grow with it."""

from __future__ import annotations

import numpy as np
import scipy

from fringeworks import _core
from fringeworks.types import BoolMap, FloatMap

WIDE_PX = 4.0
"""Smallest width σ of a kernel that moving means replace, px.

Three of them then have the variance of the Gaussian within 7 %; below, the direct sum is as fast.
"""
PASSES = 3
"""Moving means in a row that replace a Gaussian; the usual choice."""
REACH_WIDTHS = 3.0
"""Distance at which the direct sum is cut off, widths; 0.3 % of the Gaussian lie beyond."""
MIN_WEIGHT = 1e-6
"""Smallest share of known pixels in a kernel; it keeps the quotient finite."""


def smooth(values: FloatMap, width_px: tuple[float, float]) -> FloatMap:
    """Smooth a map by a Gaussian of width σ along y and x, px, into a new map.

    The border's values go on beyond it.
    """
    sides: list[list[int]] = [[], []]
    smoothed = False
    for axis, width in enumerate(width_px):
        if width >= WIDE_PX:
            sides[axis] = _sides(width)
        elif width > 0:
            smoothed = True
            values = scipy.ndimage.gaussian_filter1d(
                values, width, axis, mode="nearest", truncate=REACH_WIDTHS
            )
    if not any(sides):
        return values if smoothed else values.copy()
    whole = np.ascontiguousarray(values)
    return _core.moving_means(whole, sides_y=sides[0], sides_x=sides[1])


def smooth_known(values: FloatMap, known: BoolMap, width_px: tuple[float, float]) -> FloatMap:
    """Smooth the known values of a map, 0 elsewhere; unknown pixels get the mean around them."""
    if known.all():
        return smooth(values, width_px)
    weight = smooth(known.astype(values.dtype), width_px)
    np.maximum(weight, MIN_WEIGHT, out=weight)
    mean = smooth(np.where(known, values, 0), width_px)
    mean /= weight
    return mean


def _sides(width_px: float) -> list[int]:
    """Odd sides of the moving means whose variances (n² − 1)/12 add up to that of the Gaussian."""
    ideal = np.sqrt(12.0 * width_px**2 / PASSES + 1.0)
    small = int((ideal - 1.0) // 2.0) * 2 + 1
    missing = 12.0 * width_px**2 - PASSES * (small**2 - 1.0)
    larger = round(missing / (4.0 * (small + 1.0)))
    return [small + 2] * larger + [small] * (PASSES - larger)
