"""The colour of a scene from raw frames behind a mosaic of filters, read one after the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.bayer_image import BYTES_PER_PX, BayerImage
from fringeworks.files.between_filters import colours_of_mosaic, noise_of_mosaic
from fringeworks.signal.bands import row_bands
from fringeworks.types import BoolMap, CameraNoise, FloatMap

LUMINANCE = (0.299, 0.587, 0.114)
"""Weights of red, green and blue in a grey value (ITU-R BT.601)."""


class MosaicColour:
    """Adds up what every pixel shows through its own filter, and finds the other two colours once.

    Parameters
    ----------
    shape : (h, w)
    channels : (2, 2) array
        Channel of the filters of the first two rows and columns.
    total : float
        Sum of the weights of the images that add up to even light.
    limit : float
        Largest count, at which the sensor is saturated.

    Notes
    -----
    The images are not interpolated one by one: fringes of a few pixels lose contrast by that, in
    each channel to another extent, which the colour would show. In the sum of the images there are
    no fringes. A pixel that is saturated in one of them takes its ratio to the luminance from the
    others.
    """

    def __init__(
        self, shape: tuple[int, int], channels: NDArray[np.intp], total: float, limit: float
    ) -> None:
        self._channels, self._total, self._limit = channels, total, limit
        self._own, self._product, self._square = (np.zeros(shape, np.float32) for _ in range(3))
        self._clipped: BoolMap = np.zeros(shape, bool)
        self._grey: BoolMap = np.zeros((0, 0), bool)

    def add(self, image: BayerImage, even: float, light_sum: NDArray[np.float32]) -> None:
        """Take an image with its weight in the even light.

        Its luminance is added to ``light_sum`` with this weight, unless that is empty.
        """
        for band in row_bands(image.shape[:2], BYTES_PER_PX):
            rows, colours = band.rows, image[band.rows]
            own = image.own(rows)
            light = np.zeros_like(own)
            for c, share in enumerate(LUMINANCE):
                light += colours[..., c] * np.float32(share)
            clipped = own >= self._limit
            if even:
                self._own[rows] += np.float32(even) * own
                self._clipped[rows] |= clipped
                if light_sum.size:
                    light_sum[rows] += np.float32(even) * light
            light[clipped] = 0.0
            self._product[rows] += light * own
            self._square[rows] += light * light

    def noise(self) -> tuple[CameraNoise, CameraNoise, CameraNoise]:
        """Noise of red, green and blue at the pixels of their own filters, before ``settle``."""
        red, green, blue = (
            CameraNoise(one.read_counts / self._total, one.gain / self._total)
            for one in noise_of_mosaic(self._own, self._channels)
        )
        return red, green, blue

    def settle(self, light_sum: Callable[[slice], FloatMap]) -> None:
        """Divide the sums, and take saturated pixels by the sum of the luminance of rows."""
        self._grey = self._square <= 0
        for band in row_bands(self._grey.shape, BYTES_PER_PX):
            rows = band.rows
            grey = self._grey[rows]
            few = self._clipped[rows] | grey
            if few.any():
                square = np.where(grey, 1.0, self._square[rows])[few]
                ratio = np.where(grey[few], 1.0, self._product[rows][few] / square)
                self._own[rows][few] = light_sum(rows)[few] * ratio
        self._own /= np.float32(self._total)
        self._clipped = np.zeros((0, 0), bool)
        self._product = self._square = np.zeros((0, 0), np.float32)

    def colour(self, noise: Sequence[CameraNoise]) -> NDArray[np.float32]:
        """The colour, (h, w, 3), counts, after ``settle``. To be called once."""
        found = colours_of_mosaic(self._own, self._channels, noise)
        # A pixel that is saturated in every image, or dark in all, is grey.
        found[self._grey] = self._own[self._grey][:, None]
        self._own = np.zeros((0, 0), np.float32)
        return np.maximum(found, 0.0, out=found)
