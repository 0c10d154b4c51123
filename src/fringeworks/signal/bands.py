"""Bands of rows: a frame is worked on in parts whose temporary arrays stay in the caches."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

BAND_BYTES = 4 << 20
"""Memory that the temporary arrays of a band take, bytes.

It fits the second- or third-level cache of common processors, and is far below the 32 MB from which
on the C library asks the system for every array anew. An empirical choice.
"""


class Band(NamedTuple):
    """Some rows of a frame, and the rows around them that a filter sees."""

    rows: slice
    """Rows that the band is for."""
    seen: slice
    """These rows with the halo on either side, as far as the frame goes."""
    inner: slice
    """The rows that the band is for, within those that are seen."""


def row_bands(
    shape: tuple[int, ...], bytes_per_px: float, *, halo: int = 0, least: int = 1
) -> Iterator[Band]:
    """Cut a frame into bands of rows.

    Parameters
    ----------
    shape : (h, w)
    bytes_per_px : float > 0
        Memory of all temporary arrays, bytes per pixel of the band.
    halo : int ≥ 0
        Rows on either side that the result of a row depends on.
    least : int ≥ 1
        Smallest number of rows of a band, except for the last one.

    Yields
    ------
    Band
        Together their ``rows`` are the frame, from top to bottom.

    Examples
    --------
    >>> [(band.rows, band.seen) for band in row_bands((5, 1 << 20), 1.0, halo=1)]
    [(slice(0, 4, None), slice(0, 5, None)), (slice(4, 5, None), slice(3, 5, None))]
    """
    height, width = shape
    rows = max(least, int(BAND_BYTES / (bytes_per_px * max(width, 1))))
    for first in range(0, height, rows):
        end = min(first + rows, height)
        above = max(0, first - halo)
        inner = slice(first - above, end - above)
        yield Band(slice(first, end), slice(above, min(end + halo, height)), inner)


def by_bands(
    function: Callable[..., NDArray[Any]],
    *maps: NDArray[Any],
    dtype: DTypeLike,
    bytes_per_px: float = 32.0,
) -> NDArray[Any]:
    """Apply a function of pixels to maps, a band of rows at a time.

    Parameters
    ----------
    function : function of arrays (r, w), one for each map
        Returns an array of that shape; every pixel depends on its own values only.
    *maps : (h, w) arrays
    dtype : type of the result
    bytes_per_px : float > 0
        Memory of the function's temporary arrays, bytes per pixel.

    Returns
    -------
    (h, w) array

    Examples
    --------
    >>> by_bands(lambda a, b: a + b, np.ones((2, 3)), np.ones((2, 3)), dtype=np.float32)
    array([[2., 2., 2.],
           [2., 2., 2.]], dtype=float32)
    """
    out = np.empty(maps[0].shape, dtype)
    for band in row_bands(out.shape, bytes_per_px):
        out[band.rows] = function(*(values[band.rows] for values in maps))
    return out
