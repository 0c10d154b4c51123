"""The colour of a scene from its colour images, which are read one after the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks._lazy import scipy
from fringeworks.files.bayer_image import BayerImage
from fringeworks.files.mosaic_colour import MosaicColour
from fringeworks.signal.bands import row_bands
from fringeworks.statistics.chi_square import chi_square_quantile
from fringeworks.types import CameraNoise, FloatMap

Colours = NDArray[Any] | BayerImage
"""A colour image: an array, or one that is computed in bands."""
LUMINANCE = (0.299, 0.587, 0.114)
"""Weights of red, green and blue in a grey value (ITU-R BT.601)."""
COLOURS = 3
"""Red, green and blue."""
SAMPLED_PX = 20_000
"""Approximate number of pixels in which the noise is measured: with twelve frames they determine a
standard deviation to 0.2 %."""
FEWEST = 16
"""Smallest number of lit pixels that tell the noise of the colour."""
LEAST_FRAMES = 4
"""Smallest number of frames that tell the noise of the colour: three residuals per pixel."""
KEPT = 0.999
"""Share of the pixels' variances that the largest one to be used leaves below it: edges in motion
and the like lie far above it."""
PASSES = 8
"""Passes of the fit of the noise, whose weights depend on its result. Four change it by 1 %."""
NO_VARIANCE = 1e-9
"""Smallest variance of a sample in the weights, counts²: that of images without noise is 0."""
LIT_SHARE = 0.1
"""Brightness of a pixel, as a share of the 99th percentile, from which on it tells the noise: the
ratios of the channels of darker ones are uncertain. Empirical."""


class SceneColour:
    """Adds up coloured images while they are read, so that few at a time are in memory.

    They are added in the order of their numbers, whichever is read first: equal files give equal
    sums to the last bit.

    Parameters
    ----------
    weights : mapping
        Weights of the images, by their numbers, whose mean is the scene under even light. Without
        any there is no colour.
    count : int
        Number of images.
    own_light : bool
        Whether to sum up the luminance as well; where it is kept for each image, ``colour`` takes
        it from there.
    shares : (3,) floats
        Weights of red, green and blue in the light that is kept; those of the luminance by default.

    Notes
    -----
    A pixel sees I_nc = a_c p_n in image n and channel c, with one pattern p for all channels. The
    even light of the luminance, T = Σ w_n L_n / Σ w_n, gives the scale, and a regression of each
    channel on the luminance, r_c = Σ L_n I_nc / Σ L_n², the colour: a_c = T r_c. Bright images
    count more than dark ones, which hold noise only, and images without a weight count as well.
    Where other shares s of the channels are kept, with the light S_n = Σ s_c I_nc, they give the
    scale: T = Σ w_n S_n / Σ w_n, r_c = Σ L_n I_nc / Σ L_n S_n, whose divisor is Σ s_c Σ L_n I_nc.
    The error of a_c is within 6 % of the smallest possible one (tests/test_scene_colour.py). Images
    with a channel at the limit of its type are left out of r_c at that pixel. Behind a mosaic of
    filters, ``MosaicColour`` adds up the light of each pixel's own filter instead.
    """

    def __init__(
        self,
        weights: Mapping[int, float],
        count: int,
        *,
        own_light: bool = True,
        shares: Sequence[float] = LUMINANCE,
    ) -> None:
        self._own_light = own_light
        self._shares = np.array(shares)
        self._weights = dict(weights)
        self._count = count
        self._next = 0
        self._waiting: dict[int, Colours | None] = {}
        self._lock = Lock()
        self._coloured = False
        self._failed = not weights
        self._kind: np.dtype[Any] = np.dtype(np.float32)
        self._shape: tuple[int, ...] = ()
        self._mosaic: MosaicColour | None = None
        self._even: NDArray[np.float32] = np.zeros((0, 0), np.float32)
        self._products = self._even
        self._samples: list[NDArray[np.float32]] = []

    def add(self, number: int, array: Colours, *, coloured: bool) -> None:
        """Take image number ``number``: colours (h, w, 3) or (h, w, 4), or grey."""
        if self._failed:
            return
        usable = array.ndim == COLOURS and array.shape[2] >= COLOURS
        with self._lock:
            self._coloured |= coloured
            self._waiting[number] = array if usable else None
            while self._next in self._waiting and not self._failed:
                self._take(self._next, self._waiting.pop(self._next))
                self._next += 1

    def _take(self, number: int, image: Colours | None) -> None:
        if image is None:  # of grey images, only those that show the even light are missed
            self._failed = number in self._weights
            return
        shape = (*image.shape[:2], COLOURS)
        if not self._shape:
            self._shape, self._kind = shape, image.dtype
            if isinstance(image, BayerImage):
                total = sum(self._weights.values())
                self._mosaic = MosaicColour(shape[:2], image.channels, total, self._limit)
            else:
                self._products = np.zeros(shape, np.float32)
            if self._own_light:
                self._even = np.zeros(shape[:2], np.float32)
        if isinstance(image, BayerImage) is (self._mosaic is None):
            self._failed = True
            return
        if (shape, image.dtype) != (self._shape, self._kind):
            self._failed = True  # other sizes and types are refused elsewhere
            return
        even = np.float32(self._weights.get(number, 0.0))
        if isinstance(image, BayerImage) and self._mosaic is not None:
            self._mosaic.add(image, float(even), self._even)
            return
        step = max(1, int(np.sqrt(shape[0] * shape[1] / SAMPLED_PX)))
        sample = []
        # A band of the image as floats, its luminance, and a product.
        for band in row_bands(shape[:2], 4 * (COLOURS + 2)):
            part = image[band.rows][..., :COLOURS]
            sample.append(part[-band.rows.start % step :: step, ::step].reshape(-1, COLOURS))
            self._add_band(part, band.rows, even)
        self._samples.append(np.concatenate(sample).astype(np.float32))

    @property
    def _limit(self) -> float:
        """Largest count of the images' type."""
        return float(np.iinfo(self._kind).max) if self._kind.kind in "ui" else np.inf

    def _add_band(self, image: NDArray[Any], rows: slice, even: np.float32) -> None:
        light = np.zeros(image.shape[:2], np.float32)
        for c, share in enumerate(LUMINANCE):
            light += image[..., c] * np.float32(share)
        if self._own_light and even:
            self._even[rows] += even * light
        light[(image >= self._limit).any(axis=2)] = 0.0
        for c in range(COLOURS):
            self._products[rows, :, c] += light * image[..., c]

    @property
    def known(self) -> bool:
        """Whether all images have come, and show colours."""
        complete = self._next == self._count and bool(self._shape)
        return complete and self._coloured and not self._failed

    def colour(self, light: Sequence[NDArray[Any]] = ()) -> FloatMap | None:
        """The colour, (h, w, 3), counts; None where it is not known. To be called once.

        Parameters
        ----------
        light : sequence of (h, w) arrays
            Light of all images by the shares, at the limit where a channel is, unless it was summed
            up.
        """
        if not self.known:
            return None
        if self._mosaic is not None:
            noise = self._mosaic.noise()
            self._mosaic.settle(lambda rows: self._even_light(light, rows))
            self._even = self._products
            return self._mosaic.colour(noise)
        found = self._products
        for band in row_bands(self._shape[:2], 4 * COLOURS):
            rows = band.rows
            even = self._even_light(light, rows)
            square = np.zeros_like(even)
            for c, share in enumerate(self._shares):
                square += found[rows][..., c] * np.float32(share)
            even = np.maximum(even / np.float32(sum(self._weights.values())), 0.0)
            # A pixel that is saturated in every image, or dark in all, is grey.
            seen = square > 0
            found[rows] *= np.divide(even, square, out=np.zeros_like(even), where=seen)[..., None]
            found[rows][~seen] = even[~seen, None]
        self._even = self._products = np.zeros((0, 0), np.float32)
        return np.asarray(np.maximum(found, 0.0, out=found), np.float32)

    def _even_light(self, light: Sequence[NDArray[Any]], rows: slice) -> FloatMap:
        """Some rows of the sum of the even light."""
        if self._own_light:
            return self._even[rows]
        even = np.zeros(light[0][rows].shape, np.float32)
        for k, weight in self._weights.items():
            even += np.float32(weight) * light[k][rows]
        return even

    def noise(self) -> tuple[CameraNoise, CameraNoise, CameraNoise] | None:
        """Noise of the colour's red, green and blue; None where the images do not tell it."""
        if self.known and self._mosaic is not None:
            return self._mosaic.noise()
        if not self.known or self._count != len(self._samples) or self._count < LEAST_FRAMES:
            return None
        weights = np.array([self._weights.get(k, 0.0) for k in range(self._count)])
        return noise_of_colour(np.stack(self._samples), weights / weights.sum(), self._shares)


def noise_of_colour(
    samples: NDArray[np.float32], weights: FloatMap, shares: FloatMap
) -> tuple[CameraNoise, CameraNoise, CameraNoise] | None:
    """Noise of the colour that ``SceneColour`` computes.

    Parameters
    ----------
    samples : (n, pixels, 3) array
        What some pixels show in all images, counts.
    weights : (n,) array
        Of the images in the even light; their sum is 1.
    shares : (3,) array
        Weights of the channels in the light that gives the scale.

    Returns
    -------
    Noise of red, green and blue; None where too few pixels are lit.

    Notes
    -----
    Channels that see one pattern tell the noise of each, as three instruments do that measure one
    thing. Errors that channels have in common, such as those of JPEG, are not contained.
    """
    mean = samples.mean(axis=0, dtype=np.float64)
    light = mean @ np.array(LUMINANCE)
    if not light.size:
        return None
    lit = (light > LIT_SHARE * np.quantile(light, 0.99)) & (mean > 0).all(axis=1)
    lit &= samples.max(axis=(0, 2)) < samples.max()
    if np.count_nonzero(lit) < FEWEST:
        return None
    seen, mean = samples[:, lit].astype(np.float64), mean[lit]
    models = _channel_noise(seen, mean)
    read, gain = (np.array([getattr(m, name) for m in models]) for name in ("read_counts", "gain"))
    of_read = _variance_of_colour(np.broadcast_to(read**2, seen.shape), seen, weights, shares)
    of_gain = _variance_of_colour(gain * np.maximum(seen, 0.0), seen, weights, shares)
    red, green, blue = (
        CameraNoise(
            float(np.sqrt(np.median(of_read[:, c]))), float(np.median(of_gain[:, c] / mean[:, c]))
        )
        for c in range(COLOURS)
    )
    return red, green, blue


def _variance_of_colour(
    variance: FloatMap, seen: FloatMap, weights: FloatMap, shares: FloatMap
) -> FloatMap:
    """Variance of a_c = T r_c, (pixels, 3), from that of the samples ``seen``, (n, pixels, 3)."""
    pattern, light = seen @ np.array(LUMINANCE), seen @ shares
    of_light = variance @ shares**2
    product, even = np.sum(pattern * light, axis=0), weights @ light
    of_even = weights**2 @ of_light
    out = np.empty(seen.shape[1:])
    for c, share in enumerate(shares):
        ratio = np.sum(pattern * seen[..., c], axis=0) / product
        # Of the light with a channel less its regression, and of the latter.
        common = share * variance[..., c] - ratio * of_light
        of_rest = variance[..., c] - ratio * (share * variance[..., c] + common)
        of_ratio = np.sum(pattern**2 * of_rest, axis=0) / product**2
        both = np.einsum("n,np,np->p", weights, pattern, common) / product
        out[:, c] = even**2 * of_ratio + ratio**2 * of_even + 2.0 * even * ratio * both
    return np.maximum(out, 0.0)


def _channel_noise(seen: FloatMap, mean: FloatMap) -> list[CameraNoise]:
    """Noise of each channel of (n, pixels, 3) samples, whose means are (pixels, 3).

    A channel less another one, scaled by their ratio, has a variance that is linear in read² and
    gain of both. Weighted least squares over all pixels and pairs of channels determine them.
    """
    freedom = len(seen) - 1
    measured, rows = [], []
    for c, d in ((0, 1), (1, 2), (2, 0)):
        ratio = np.sum(seen[..., c] * seen[..., d], axis=0) / np.sum(seen[..., d] ** 2, axis=0)
        measured.append(np.sum((seen[..., c] - ratio * seen[..., d]) ** 2, axis=0) / freedom)
        row = np.zeros((mean.shape[0], 2 * COLOURS))
        row[:, 2 * c], row[:, 2 * c + 1] = 1.0, mean[:, c]
        row[:, 2 * d], row[:, 2 * d + 1] = ratio**2, ratio**2 * mean[:, d]
        rows.append(row)
    design, values = np.concatenate(rows), np.concatenate(measured)
    largest = chi_square_quantile(KEPT, freedom) / freedom
    model = np.full(values.shape, max(float(np.median(values)), NO_VARIANCE))
    found = np.zeros(2 * COLOURS)
    for _ in range(PASSES):
        kept = values < largest * model
        found = scipy.optimize.nnls(design[kept] / model[kept, None], values[kept] / model[kept])[0]
        model = np.maximum(design @ found, NO_VARIANCE)
    return [
        CameraNoise(float(found[2 * c] ** 0.5), float(found[2 * c + 1])) for c in range(COLOURS)
    ]
