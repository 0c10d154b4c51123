"""Array types, and why a pixel has no value."""

from __future__ import annotations

from enum import IntEnum
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fringeworks.types.errors import InputError

Axis = Literal["x", "y"]
"""x: from column to column. y: from row to row."""
FloatMap = NDArray[np.floating[Any]]
"""Real numbers, single or double precision."""
BoolMap = NDArray[np.bool_]
"""True or false per pixel."""
ByteMap = NDArray[np.uint8]
"""Small whole numbers per pixel, such as ``Reason``."""


class Reason(IntEnum):
    """Why a pixel has no value. ``OK`` where it has one."""

    OK = 0
    MASKED = 1  # excluded by the caller, or not finite in the input
    OUTSIDE = 2  # the matching point lies outside the reference frame
    LOW_MODULATION = 3  # the fringe is too weak against the noise, as on dark paint
    SATURATED = 4  # the sensor was at its limit over the whole neighbourhood
    ORDER_AMBIGUOUS = 5  # the fringe order cannot be decided
    OUT_OF_RANGE = 6  # the intensity lies outside the matching part of the reference
    UNDETERMINED = 7  # no window determines the displacement
    BEYOND_GEOMETRY = 8  # no height has this displacement, or no point in front of both devices
    SHADOW = 9  # the fringes are not above the noise: the projector does not light the pixel
    RAYS_APART = 10  # columns and rows disagree: the rays of camera and projector do not meet
    ISOLATED = 11  # no surface through its neighbours has its coordinate: two depths in one pixel
    OUTSIDE_DEPTH = 12  # no depth in the given range has the coordinate


def count_reasons(reason: ByteMap) -> dict[str, int]:
    """Pixels per reason.

    Parameters
    ----------
    reason : (h, w) uint8 array of ``Reason``

    Returns
    -------
    Number of pixels by the reason's name in lower case, without the reasons that do not occur.

    Raises
    ------
    InputError for anything but whole numbers that are a ``Reason``.

    Examples
    --------
    >>> count_reasons(np.array([[0, 0, 3]], np.uint8))
    {'ok': 2, 'low_modulation': 1}
    """
    codes = np.asarray(reason)
    if codes.dtype.kind not in "ui" or (
        codes.size and not 0 <= codes.min() <= codes.max() < len(Reason)
    ):
        raise InputError(
            f"reason: expected whole numbers of 0 to {len(Reason) - 1}, got others ({codes.dtype})"
        )
    return {Reason(k).name.lower(): int(n) for k, n in enumerate(reason_counts(codes)) if n}


def reason_counts(reason: ByteMap) -> NDArray[np.int64]:
    """Pixels per reason, (reasons,), in the order of ``Reason``."""
    # Most pixels of a map have a value, and counting bytes one by one takes far longer.
    failed = reason[reason != Reason.OK]
    counts = np.bincount(failed, minlength=len(Reason))
    counts[Reason.OK] = reason.size - failed.size
    return counts
