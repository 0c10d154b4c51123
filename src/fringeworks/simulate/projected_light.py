"""Light of the projector's patterns where the pixels of a view look."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.simulate.lens import blur_levels, level_weights
from fringeworks.types import FloatMap, InputError

SAMPLES_PER_PIXEL = 16
"""Samples of a pattern's profile per projector pixel, with linear interpolation between them: with
a blur of 0.6 px, the light is exact to 0.03 % of the height of an edge."""
REACH_SIGMAS = 5.0
"""Distance over which the light of a pixel is blurred, in standard deviations; the rest is below
1e-6 of its light."""
EXCESS_VARIANCE = 1.0 / 12.0
"""By how much linear interpolation between pixel centres (variance 1/6 px²) blurs more than square
pixels do (1/12 px²). The Gaussian blur is reduced by it."""


class ProjectedLight:
    """Light of projected pictures at the pixels of a view, before shading.

    A projector pixel is a square of constant light, blurred by a Gaussian.

    Parameters
    ----------
    projector_px : (h, w, 2) array
        Column and row on the projector where each camera pixel looks, px.
    lit : (h, w) bool array
        Pixels that the projector reaches; the others get no light.
    defocus_px : float or (h, w) array ≥ 0
        Standard deviation of the projector's blur, projector px.
    fill : float, 0…1
        Lit side of a projector pixel over its pitch. The mean light does not depend on it.
    """

    def __init__(
        self,
        projector_px: FloatMap,
        lit: NDArray[np.bool_],
        defocus_px: FloatMap | float,
        fill: float = 1.0,
    ) -> None:
        self.fill = fill
        self.shape = lit.shape
        self.lit = np.flatnonzero(lit)
        here = np.broadcast_to(defocus_px, lit.shape).reshape(-1)[self.lit]
        self.levels = blur_levels(here) if here.size else np.zeros(1)
        """Blurs that the light is computed for, px."""
        self.weights = level_weights(here, self.levels**2)
        """Shares of these blurs at the lit pixels."""
        self.coordinates = [projector_px[..., k].reshape(-1)[self.lit] for k in (0, 1)]
        """Columns and rows of the lit pixels, px."""
        self._samples: dict[int, tuple[NDArray[np.int32], NDArray[np.float32]]] = {}

    def __call__(self, picture: FloatMap) -> FloatMap:
        """Return the light of a picture (rows, columns) of the projector at all pixels, (h, w)."""
        light = np.zeros(self.shape)
        self.pixels = picture.shape[::-1]
        if (picture == picture[:1]).all():
            light.reshape(-1)[self.lit] = self._of_profile(0, picture[0])
        elif (picture == picture[:, :1]).all():
            light.reshape(-1)[self.lit] = self._of_profile(1, picture[:, 0])
        else:
            light.reshape(-1)[self.lit] = self._of_picture(picture)
        return light

    def _of_profile(self, axis: int, values: FloatMap) -> FloatMap:
        """Light of a picture that varies along one axis only, as most patterns do."""

        def light(defocus_px: float) -> FloatMap:
            along = self._at(axis, values, defocus_px)
            if self.fill == 1.0:
                return along
            # The gaps across the profile are those of a uniform picture.
            across = self.pixels[1 - axis]
            return along * self._at(1 - axis, np.ones(across), defocus_px)

        return self._mixed(light)

    def _at(self, axis: int, values: FloatMap, defocus_px: float) -> FloatMap:
        """Light of a line of projector pixels at the lit pixels' columns or rows."""
        if axis not in self._samples:
            place = (self.coordinates[axis] + 0.5) * SAMPLES_PER_PIXEL
            whole = np.clip(place.astype(np.int32), 0, values.size * SAMPLES_PER_PIXEL - 1)
            self._samples[axis] = whole, (place - whole).astype(np.float32)
        index, fraction = self._samples[axis]
        profile = blurred_profile(values, defocus_px, self.fill)
        return np.asarray(profile[index] + fraction * np.diff(profile)[index])

    def _of_picture(self, picture: FloatMap) -> FloatMap:
        """Light of any picture: blurred at the centres of projector pixels, linear between them."""
        if self.fill != 1.0:
            raise InputError(
                f"fill: expected 1 for pictures that vary along both axes, got {self.fill}"
            )

        def light(defocus_px: float) -> FloatMap:
            sigma = np.sqrt(max(defocus_px**2 - EXCESS_VARIANCE, 0.0))
            blurred = scipy.ndimage.gaussian_filter(picture, sigma, mode="nearest")
            return np.asarray(
                scipy.ndimage.map_coordinates(
                    blurred, self.coordinates[::-1], order=1, mode="nearest"
                )
            )

        return self._mixed(light)

    def _mixed(self, light: Callable[[float], FloatMap]) -> FloatMap:
        """Light of the lit pixels, each between the two blurs next to its own."""
        if len(self.levels) == 1:
            return light(float(self.levels[0]))
        parts = zip(self.weights, self.levels, strict=True)
        return sum((w * light(float(level)) for w, level in parts), np.zeros(self.lit.size))


def blurred_profile(values: FloatMap, defocus_px: float, fill: float = 1.0) -> FloatMap:
    """Return the light of a line of square pixels, each blurred by a Gaussian.

    Parameters
    ----------
    values : (n,) array
        Light of the pixels.
    defocus_px : float ≥ 0
        Standard deviation of the blur, px.
    fill : float, 0…1
        Lit width of a pixel over its pitch. The light of the lit part is raised by 1/fill.

    Returns
    -------
    (16 n + 1,) array, the light at −½, −½ + 1/16, … n − ½ px.
    """
    n = values.size
    index = np.arange(n * SAMPLES_PER_PIXEL + 1)
    nearest = np.minimum(index // SAMPLES_PER_PIXEL, n - 1)
    # Places repeat from pixel to pixel: the last entry is the far end of the last pixel.
    phase = index - nearest * SAMPLES_PER_PIXEL
    place = np.arange(SAMPLES_PER_PIXEL + 1) / SAMPLES_PER_PIXEL - 0.5
    half = 0.5 * fill
    if defocus_px == 0:
        return np.asarray(values[nearest] * (np.abs(place) <= half)[phase] / fill)
    reach = int(np.ceil(REACH_SIGMAS * defocus_px)) + 1
    padded = np.pad(values, reach)
    light = np.zeros(index.size)
    for k in range(-reach, reach + 1):
        edges = (k + half - place, k - half - place)
        share = scipy.special.ndtr(edges[0] / defocus_px) - scipy.special.ndtr(
            edges[1] / defocus_px
        )
        light += share[phase] * padded[nearest + reach + k]
    return light / fill
