"""Filters of images: means over boxes, smoothing, medians, widened marks, saturated squares, sizes.

The kernels check types and layout; these functions bring maps into them.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks._lazy import scipy
from fringeworks.types import BoolMap, FloatMap

SATURATED_PX = 3
"""Side of the smallest square of samples at the sensor's limit that counts as saturated, px.

Smaller groups are usually peaks of the noise, whose neighbours still carry the fringe. An
empirical choice.
"""
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
Border = Literal["edge", "mirror", "zero"]
"""What a filter takes for the values beyond the border: those at the border go on, the map is
mirrored at them, or zeros."""


def saturated_squares(frame: NDArray[Any]) -> BoolMap:
    """True where a frame is at the limit of its counts over 3 × 3 px.

    Parameters
    ----------
    frame : (h, w) array as captured
        Counts; floats have no limit.

    Returns
    -------
    (h, w) bool array
    """
    if frame.dtype.kind != "u":
        return np.zeros(frame.shape, bool)
    at_limit = frame == np.iinfo(frame.dtype).max
    return np.asarray(scipy.ndimage.binary_opening(at_limit, np.ones((SATURATED_PX, SATURATED_PX))))


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


def box_mean(values: NDArray[Any], side_px: int, border: Border = "mirror") -> NDArray[Any]:
    """Mean of the square of an odd side around every pixel.

    Parameters
    ----------
    values : (h, w) float array
        Finite; a value that is not finite spoils the rest of its column.
    side_px : int
        Odd, px.
    border : str

    Returns
    -------
    (h, w) float array; float32 where ``values`` is, else float64.
    """
    kind = np.float32 if values.dtype == np.float32 else np.float64
    return _core.box_means(np.ascontiguousarray(values, kind), side=side_px, border=border)


def weighted_sum(
    values: NDArray[Any],
    weights_y: NDArray[Any],
    weights_x: NDArray[Any],
    *,
    border: Border = "edge",
    step: int = 1,
) -> NDArray[np.float32]:
    """Weighted sum of the neighbours of every pixel, or of every ``step``-th along both axes.

    Parameters
    ----------
    values : (h, w) float array
        Computed in single precision. A value that is not finite spreads over what it reaches.
    weights_y, weights_x : (n,) float arrays
        Odd numbers of weights, that of the pixel itself in the middle.
    border : str
    step : int
        Distance of the pixels that are computed, from the first one on, px.

    Returns
    -------
    (ceil(h / step), ceil(w / step)) float32 array
    """
    whole = np.ascontiguousarray(values, np.float32)
    along = [weights.astype(np.float64).tolist() for weights in (weights_y, weights_x)]
    return _core.weighted_sums(
        whole, weights_y=along[0], weights_x=along[1], border=border, step=step
    )


def gaussian(
    values: NDArray[Any], width_px: float, reach_px: int, border: Border = "edge"
) -> NDArray[np.float32]:
    """Smooth by a Gaussian of σ = ``width_px`` that is cut off at ``reach_px`` and sums to 1."""
    offsets = np.arange(-reach_px, reach_px + 1)
    weights = np.exp(-0.5 * (offsets / width_px) ** 2)
    weights /= weights.sum()
    return weighted_sum(values, weights, weights, border=border)


def median_of_nine(values: NDArray[Any]) -> NDArray[np.float32]:
    """Median of the 3 × 3 pixels around every pixel; the border's values go on. NaN where one is.

    Parameters
    ----------
    values : (h, w) float array
        Computed in single precision.
    """
    return _core.median_of_nine(np.ascontiguousarray(values, np.float32))


def widened(marks: BoolMap, reach_px: int) -> BoolMap:
    """Marks with what is within a distance of them along rows, columns and diagonals."""
    return _core.widen(np.ascontiguousarray(marks, bool), reach=reach_px)


def opened(marks: BoolMap, side_px: int) -> BoolMap:
    """Marks without what no square of an odd side fits into; squares may reach over the border."""
    reach = side_px // 2
    return widened(~widened(~marks, reach), reach)


def reduced(values: NDArray[Any], shape: tuple[int, int]) -> NDArray[np.float32]:
    """A smaller map whose pixels are means of the areas that they cover, in single precision."""
    whole = np.ascontiguousarray(values, np.float32)
    return _core.area_means(whole, rows=shape[0], columns=shape[1])


def enlarged(values: NDArray[Any], shape: tuple[int, int]) -> NDArray[np.float32]:
    """A map of another number of pixels, linear between the centres of those there are."""
    places = [
        (np.arange(n) + 0.5) * (before / n) - 0.5
        for n, before in zip(shape, values.shape, strict=True)
    ]
    whole = np.ascontiguousarray(values, np.float32)
    return np.asarray(_core.interpolate_linear(whole, rows=places[0], columns=places[1]))
