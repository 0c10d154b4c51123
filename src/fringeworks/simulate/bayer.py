"""A colour camera as a source of grey frames: a mosaic of filters, and its interpolation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.types import FloatMap, check_fields

BayerOutput = Literal["luminance", "green", "raw"]
"""What a colour camera hands on: the luminance, the green channel, or the mosaic itself."""
LUMINANCE_SHARES = (0.299, 0.587, 0.114)
"""Shares of red, green and blue in the luminance (ITU-R BT.601, which JPEG uses)."""
FILTERS = ((0.90, 0.08, 0.02), (0.07, 0.85, 0.08), (0.02, 0.12, 0.86))
"""Shares of the projector's red, green and blue in the channels red, green and blue of a camera
with three of them. Other colours have 2 to 12 %, as in the spectral simulation of
docs/few-frames.md."""
OF_RED_AND_BLUE = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 4.0
"""Weights by which a channel that has one pixel of four is interpolated bilinearly."""
OF_GREEN = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]]) / 4.0
"""Weights by which the channel that has every second pixel is interpolated bilinearly."""


@dataclass(frozen=True)
class Bayer:
    """A mosaic of colour filters: red and green in even rows, green and blue in odd rows.

    Raises
    ------
    InputError for a value out of its range.
    """

    filters: tuple[float, float, float] = (0.55, 1.0, 0.4)
    """Share of the projector's white light that the red, green and blue filters pass, 0…1, relative
    to the best of them. By default those of a silicon sensor under a lamp."""
    balanced: bool = True
    """Whether the camera scales the channels so that white is white; clips at the frame's limit."""
    output: BayerOutput = "luminance"
    """What the camera hands on."""

    def __post_init__(self) -> None:
        right = len(self.filters) == 3 and all(0 < share <= 1 for share in self.filters)
        check_fields(
            self,
            filters=(right, "three shares above 0, up to 1"),
            output=(self.output in get_args(BayerOutput), f"one of {get_args(BayerOutput)}"),
        )


def are_shares(filters: tuple[tuple[float, float, float], ...]) -> bool:
    """Whether filters are three rows of three shares, each with the sum 1."""
    rows = np.asarray(filters, np.float64)
    return bool(rows.shape == (3, 3) and (rows >= 0).all() and np.allclose(rows.sum(axis=1), 1.0))


def filter_of_pixels(shape: tuple[int, int]) -> NDArray[np.intp]:
    """Return the filter of every pixel, (h, w): 0 red, 1 green, 2 blue."""
    v, u = np.indices(shape) % 2
    return np.asarray(v + u)


def mosaic(shape: tuple[int, int], bayer: Bayer) -> FloatMap:
    """Return the share of light that passes the filter of every pixel, (h, w)."""
    return np.asarray(np.array(bayer.filters)[filter_of_pixels(shape)])


def demosaiced(raw: NDArray[Any], bayer: Bayer, largest: int) -> NDArray[Any]:
    """Interpolate a raw frame bilinearly.

    Parameters
    ----------
    raw : (h, w) array of unsigned integers
        Counts of the pixels behind their filters.
    bayer : Bayer
    largest : int
        Limit of the counts, at which balanced channels are clipped.

    Returns
    -------
    (h, w) array of the type of ``raw``.

    Examples
    --------
    >>> camera = Bayer(filters=(0.5, 1.0, 0.25))
    >>> raw = (100 * mosaic((4, 6), camera)).astype(np.uint8)
    >>> bool((demosaiced(raw, camera, 255) == 100).all())
    True
    """
    if bayer.output == "raw":
        return raw
    counts = raw.astype(np.float64)
    if bayer.balanced:
        # The electronics hold no more than the frame's limit after scaling either.
        counts = np.minimum(counts / mosaic(raw.shape, bayer), largest)
    colour = filter_of_pixels(raw.shape)

    def channel(k: int) -> FloatMap:
        weights = OF_GREEN if k == 1 else OF_RED_AND_BLUE
        # Mirroring about the border's pixels keeps every filter on its own colour.
        known = np.where(colour == k, counts, 0.0)
        return np.asarray(scipy.ndimage.convolve(known, weights, mode="mirror"))

    if bayer.output == "green":
        seen = channel(1)
    else:
        seen = sum((w * channel(k) for k, w in enumerate(LUMINANCE_SHARES)), np.zeros(raw.shape))
    return np.asarray(np.rint(seen).astype(raw.dtype))
