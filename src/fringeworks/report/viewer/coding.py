"""Codes of the packed surface: numbers per pixel, predicted from neighbours and deflated.

A number is rounded to a multiple of its pixel's step. The page knows the steps, so the error is at
most half a step. What is stored is the multiple minus that of the prediction, which needs few bits.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fringeworks.types import FloatMap, InputError

Symbols = NDArray[np.uint32]
"""0 for no number, else 1 + the folded difference: 0, −1, 1, −2, … become 0, 1, 2, 3, …"""
LARGEST_SYMBOL = 2**32 - 2
"""Largest folded difference that fits a symbol."""
CODES = 256
"""Values of one byte."""
FINEST_RATIO = 1.03
"""Smallest ratio of neighbouring values of an 8-bit logarithm: they are then known to 1.5 %, which
is finer than a standard deviation can be estimated, and noise in the code costs few bytes."""
WIDEST_RATIO = 1500.0
"""Largest over smallest value of a logarithm that need not hold the smallest values exactly: 255
codes at ``FINEST_RATIO`` span 1,880."""

LARGEST_RATIO = 1e60
"""Largest ratio of standard deviations in a surface: a code would span more than a factor of 1.7
beyond it."""


@dataclass
class Blocks:
    """The deflated blocks of a packed surface, one after the other."""

    parts: list[bytes] = field(default_factory=list)
    size: int = 0

    def add(self, content: bytes) -> list[int]:
        """Append a block; return its offset, its deflated and its inflated size, bytes."""
        packed = deflated(content)
        place = [self.size, len(packed), len(content)]
        self.parts.append(packed)
        self.size += len(packed)
        return place

    def add_planes(self, numbers: NDArray[np.generic]) -> list[list[int]]:
        """Append the bytes of little-endian numbers as one block per byte, the lowest first.

        Blocks of zeros at the end are left out.
        """
        little = np.ascontiguousarray(numbers, numbers.dtype.newbyteorder("<")).reshape(-1)
        planes = little.view(np.uint8).reshape(little.size, little.itemsize).T
        used = max((k + 1 for k, plane in enumerate(planes) if plane.any()), default=1)
        return [self.add(plane.tobytes()) for plane in planes[:used]]


def deflated(content: bytes) -> bytes:
    """Deflate bytes, with or without a search for repetitions, whichever is shorter.

    Noise has no repetitions: the search finds false ones and makes noise 8 % longer.
    """
    coder = zlib.compressobj(9, zlib.DEFLATED, 15, 9, zlib.Z_HUFFMAN_ONLY)
    plain = coder.compress(content) + coder.flush()
    searched = zlib.compress(content, 6)
    return min(plain, searched, key=len)


def coded(values: FloatMap, step: FloatMap | float, origin: float) -> tuple[Symbols, FloatMap]:
    """Code a map in steps.

    Parameters
    ----------
    values : (h, w) array
        NaN is coded as no number.
    step : (h, w) array or float
        Step of every pixel, > 0. The error is at most half of it.
    origin : float
        Prediction where no neighbour is known.

    Returns
    -------
    symbols : (h, w) uint32
    decoded : (h, w) float64, what the page will read; NaN where there is no number

    Raises
    ------
    InputError where a step is too small for the range of the values.
    """
    steps = np.broadcast_to(np.asarray(step, np.float64), values.shape)
    with np.errstate(all="ignore"):
        exact = np.where(np.isfinite(values), values, np.nan).astype(np.float64)
        multiple = np.floor(exact / steps + 0.5)
        decoded = multiple * steps
        change = multiple - np.floor(predicted(decoded, origin) / steps + 0.5)
        folded = np.where(change >= 0, 2.0 * change, -2.0 * change - 1.0)
    number = np.isfinite(exact)
    if number.any() and not np.max(folded[number]) < LARGEST_SYMBOL:
        raise InputError("packing: expected values within 2³¹ steps of each other, got more")
    symbols = np.zeros(values.shape, np.uint32)
    symbols[number] = folded[number].astype(np.uint32) + 1
    return symbols, decoded


def predicted(values: FloatMap, origin: float) -> FloatMap:
    """Predict every value from its neighbours to the left and above, (h, w).

    The left one continued by half the slope of the row above, the left one, the upper one, or
    ``origin``: the first of them that is known.
    """
    framed = np.pad(values, 1, constant_values=np.nan)
    left, upper = framed[1:-1, :-2], framed[:-2, 1:-1]
    sloped = left + (framed[:-2, 2:] - framed[:-2, :-2]) / 2.0
    nearest = np.where(np.isfinite(left), left, np.where(np.isfinite(upper), upper, origin))
    return np.where(np.isfinite(sloped), sloped, nearest)


def logarithms(values: FloatMap, *, bounded: bool) -> tuple[NDArray[np.int64], FloatMap]:
    """Code positive values by their logarithm, in one byte.

    Parameters
    ----------
    values : array
        Not positive and not finite values have no logarithm: their code is −1.
    bounded : bool
        Whether a code's value must not be above the value itself. Otherwise small values, and
        zero, take the lowest code.

    Returns
    -------
    codes : int64 array, −1…255
    table : (256,) float64, the lowest value of each code

    Raises
    ------
    InputError for values over more than ``LARGEST_RATIO``.
    """
    finite = np.isfinite(values)
    positive = finite & (values > 0)
    codes = np.full(values.shape, -1, np.int64)
    if not positive.any():
        return codes, geometric(1.0, FINEST_RATIO)
    low, high = float(values[positive].min()), float(values[positive].max())
    if not bounded:
        low, positive = max(low, high / WIDEST_RATIO), finite & (values >= 0)
    if low * LARGEST_RATIO < high:
        raise InputError(
            f"packing: expected values within a factor of {LARGEST_RATIO:g}, got {low:g} to "
            f"{high:g}"
        )
    # A code less than there are: rounding must not move the largest value beyond the last one.
    ratio = max(FINEST_RATIO, (high / low) ** (1.0 / (CODES - 2)))
    table = geometric(low, ratio)
    found = np.searchsorted(table, values[positive].astype(np.float64), side="right") - 1
    codes[positive] = np.maximum(found, 0)
    return codes, table


def geometric(first: float, ratio: float) -> FloatMap:
    """The geometric sequence of 256 values, by repeated multiplication as the page does it."""
    return np.asarray(np.multiply.accumulate(np.array([first] + [ratio] * (CODES - 1))))
