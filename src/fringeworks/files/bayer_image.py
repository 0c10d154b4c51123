"""A raw frame behind a mosaic of colour filters, as a colour image that is computed in bands."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.between_filters import spread
from fringeworks.signal.bands import row_bands

LARGEST = 65535
"""Largest count of the image."""
CHANNEL_OF = (0, 1, 2, 1)
"""Red, green or blue for the numbers of a mosaic: both greens are one channel."""
BYTES_PER_PX = 48
"""Memory of a band while its channels are interpolated, bytes per pixel: twelve arrays of float32.
"""


class BayerImage:
    """Red, green and blue of a raw frame, interpolated linearly between its pixels.

    It keeps the raw counts alone, two bytes per pixel. Rows are computed when they are asked for:
    ``image[rows]`` is (n, w, 3), uint16.

    Parameters
    ----------
    raw : (h, w) uint16 array
        Counts of the sensor.
    pattern : (2, 2) array
        Numbers of the filters: 0 red, 1 and 3 green, 2 blue.
    black : sequence of 4 floats
        Counts without light, by the numbers of the filters.
    white : float
        Largest count, which becomes 65535.
    """

    ndim = 3
    dtype = np.dtype(np.uint16)

    def __init__(
        self, raw: NDArray[np.uint16], pattern: NDArray[Any], black: Any, white: float
    ) -> None:
        self._raw = raw
        self._pattern = np.asarray(pattern)
        self._black = np.array(black, np.float32)[self._pattern]
        self._scale = np.float32(LARGEST) / (np.float32(white) - self._black)
        self.shape = (*raw.shape, 3)

    @property
    def channels(self) -> NDArray[np.intp]:
        """Channels of the filters of the first two rows and columns: 0 red, 1 green, 2 blue."""
        return np.asarray(np.array(CHANNEL_OF)[self._pattern], np.intp)

    @property
    def mosaic(self) -> str:
        """Filters of the first two pixels of the first row and of the second, as "rggb"."""
        return "".join("rgb"[CHANNEL_OF[int(k)]] for k in self._pattern.ravel())

    def own(self, rows: slice) -> NDArray[np.float32]:
        """Counts of rows of pixels through their own filters, (n, w), from 0 in the dark."""
        # Of the pattern, the rows and columns of this part.
        place = np.ix_(np.arange(rows.start, rows.stop) % 2, np.arange(self.shape[1]) % 2)
        counts = self._raw[rows] - self._black[place]
        counts *= self._scale[place]
        return np.asarray(np.clip(counts, 0, LARGEST, out=counts), np.float32)

    def counts_at(self, row: int, column: int) -> NDArray[np.uint16]:
        """Counts of every second pixel from a row and a column on, from 0 in the dark; of frames
        of odd size without the last row or column, (h // 2, w // 2)."""
        rows, columns = (size // 2 * 2 for size in self._raw.shape)
        part = self._raw[row:rows:2, column:columns:2] - self._black[row, column]
        part *= self._scale[row, column]
        np.clip(np.rint(part, out=part), 0, LARGEST, out=part)
        return np.asarray(part, np.uint16)

    def __getitem__(self, rows: slice) -> NDArray[np.uint16]:
        start, stop, step = rows.indices(self.shape[0])
        first, last = max(start - 1, 0), min(stop + 1, self.shape[0])
        # Of the pattern, the rows and columns of this part.
        v, u = np.arange(first, last) % 2, np.arange(self.shape[1]) % 2
        counts = self.own(slice(first, last))
        channel = self.channels[np.ix_(v, u)]
        out = np.empty((last - first, self.shape[1], 3), np.uint16)
        for c in range(3):
            own = (channel == c).astype(np.float32)
            between = spread(counts * own) / spread(own)
            out[..., c] = np.rint(np.where(own > 0, counts, between))
        return out[start - first : stop - first : step]

    def channel(self, number: int) -> NDArray[np.uint16]:
        """One channel, (h, w)."""
        out = np.empty(self.shape[:2], np.uint16)
        for band in row_bands(self.shape[:2], BYTES_PER_PX):
            out[band.rows] = self[band.rows][..., number]
        return out

    def whole(self) -> NDArray[np.uint16]:
        """The image as an array, (h, w, 3)."""
        out = np.empty(self.shape, np.uint16)
        for band in row_bands(self.shape[:2], BYTES_PER_PX):
            out[band.rows] = self[band.rows]
        return out


def bayer_image(raw: Any) -> BayerImage | None:
    """The image of an open file of rawpy, or None for one without a plain mosaic of 2 × 2."""
    pattern, sizes = getattr(raw, "raw_pattern", None), raw.sizes
    if pattern is None or np.shape(pattern) != (2, 2) or getattr(raw, "num_colors", 0) != 3:
        return None
    counts = np.asarray(raw.raw_image_visible)
    plain = counts.ndim == 2 and counts.dtype == np.uint16 and bytes(raw.color_desc) == b"RGBG"
    upright = counts.shape == (sizes.height, sizes.width) == (sizes.iheight, sizes.iwidth)
    complete = {CHANNEL_OF[int(k)] for k in np.ravel(pattern)} == {0, 1, 2}
    black, white = raw.black_level_per_channel, float(raw.white_level)
    if not (plain and upright and complete and sizes.pixel_aspect == 1 and max(black) < white):
        return None
    return BayerImage(counts.copy(), pattern, black, white)
