"""Raw frames behind a mosaic of colour filters: the pixels of one colour, without interpolation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.bayer_image import BayerImage
from fringeworks.types import InputError

MOSAICS = ("rggb", "grbg", "gbrg", "bggr")
"""Filters of the first two pixels of the first row and of the second, as makers write them."""
IN_FILE = "file"
"""Word for raw photographs, whose files say their mosaic."""


def checked_mosaic(mosaic: str | None, channels: str) -> str:
    """A mosaic as it was given, empty for none.

    Raises
    ------
    InputError for a mosaic that is none, and for one without a single channel beside it.
    """
    mosaic = (mosaic or "").lower()
    if not mosaic:
        return ""
    if mosaic not in (*MOSAICS, IN_FILE):
        raise InputError(
            f"mosaic: expected one of {', '.join(MOSAICS)}, or {IN_FILE} for raw photographs, got "
            f"{mosaic!r}"
        )
    if len(channels) != 1:
        raise InputError(
            'mosaic: expected one channel beside it, as channels = "blue", because only pixels '
            f"behind one colour are read; got {channels or 'none'}"
        )
    return mosaic


def places_of(mosaic: str, letter: str) -> list[tuple[int, int]]:
    """Row and column of the pixels of a channel in the first two rows and columns.

    Examples
    --------
    >>> places_of("rggb", "b")
    [(1, 1)]
    """
    return [(k // 2, k % 2) for k, filter_ in enumerate(mosaic) if filter_ == letter]


def first_px(mosaic: str, letter: str) -> tuple[float, float]:
    """Column and row of the frame at which the first pixel of a channel's plane lies, px.

    Both greens are one pixel: it lies between them.

    Examples
    --------
    >>> first_px("rggb", "b"), first_px("rggb", "g")
    ((1.0, 1.0), (0.5, 0.5))
    """
    rows, columns = np.mean(places_of(mosaic, letter), axis=0)
    return float(columns), float(rows)


def plane_of(raw: NDArray[Any], mosaic: str, letter: str) -> NDArray[Any]:
    """The pixels of a channel of a raw frame, (h // 2, w // 2).

    Red and blue keep their counts. Green is the mean of two pixels, float32; where one of them is
    at the limit of its type, so is the mean, because clipped counts would hide in it.
    """
    rows, columns = raw.shape[0] // 2 * 2, raw.shape[1] // 2 * 2
    return _mean([raw[v:rows:2, u:columns:2] for v, u in places_of(mosaic, letter)])


def _mean(found: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """The mean of the pixels behind one colour, or the limit of their type where one is at it."""
    if len(found) == 1:
        return np.ascontiguousarray(found[0])
    mean = np.asarray(np.mean(found, axis=0, dtype=np.float32))
    kind = found[0].dtype
    if kind.kind in "ui":
        limit = np.iinfo(kind).max
        mean[np.max(found, axis=0) == limit] = limit
    return mean


def plane_of_image(
    image: NDArray[Any] | BayerImage, mosaic: str, letter: str
) -> tuple[NDArray[Any], tuple[float, float]]:
    """The pixels of a channel of an image, and the place of the first of them in it.

    Raises
    ------
    InputError for an image whose colours were interpolated already, and for a raw photograph
    without a mosaic of 2 × 2.
    """
    if isinstance(image, BayerImage):
        own = image.mosaic
        if mosaic not in (IN_FILE, own):
            raise InputError(f"mosaic: expected {own}, which the file says, got {mosaic}")
        found = [image.counts_at(v, u) for v, u in places_of(own, letter)]
        return _mean(found), first_px(own, letter)
    if mosaic == IN_FILE:
        raise InputError(
            "mosaic: expected a raw photograph that says its mosaic, or one of "
            f"{', '.join(MOSAICS)}"
        )
    if image.ndim != 2:
        raise InputError(
            f"mosaic: expected the raw counts, (h, w), got colours of shape {image.shape}"
        )
    return plane_of(image, mosaic, letter), first_px(mosaic, letter)
