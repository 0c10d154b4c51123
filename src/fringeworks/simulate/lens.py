"""Blur that grows with the distance from the focus: a thin lens, and images blurred by a map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.types import FloatMap, check_fields

LEVEL_RATIO = 1.2
"""Ratio of neighbouring blurs between which an image is interpolated. A mixture of two Gaussian
blurs of this ratio has the right variance, and its modulation transfer is off by at most 0.01."""
SMALLEST_LEVEL_PX = 0.4
"""Smallest blur above 0 that an image is computed for, px: a Gaussian that is narrower than this is
nearly one sample wide, and mixing with the sharp image serves as well."""
STD_OF_DISC = 0.25
"""Standard deviation of a uniform disc along one axis, over its diameter."""


@dataclass(frozen=True)
class ThinLens:
    """A lens that is sharp at one distance.

    Raises
    ------
    InputError for a value out of its range.

    Examples
    --------
    >>> lens = ThinLens(focus_mm=500.0, aperture_mm=10.0)
    >>> lens.blur_px(np.array([500.0, 550.0]), 3000.0).round(3)
    array([0.   , 1.364])
    """

    focus_mm: float
    """Distance along the axis at which points are sharp, mm; > 0."""
    aperture_mm: float
    """Diameter of the opening, mm; ≥ 0. The f-number is the focal length over it."""

    def __post_init__(self) -> None:
        check_fields(
            self,
            focus_mm=(self.focus_mm > 0, "> 0 mm"),
            aperture_mm=(self.aperture_mm >= 0, ">= 0 mm"),
        )

    def blur_px(self, depth_mm: FloatMap, focal_px: float) -> FloatMap:
        """Return the standard deviation of the blur along one axis, px.

        Parameters
        ----------
        depth_mm : array
            Distance of points along the axis, mm.
        focal_px : float
            Focal length of the device, px.

        Notes
        -----
        The image of a point is a disc of the diameter f_px A |1/z − 1/z_f| for the aperture A and
        the focus z_f (geometrical optics). The same holds for a camera and for a projector. A disc
        of diameter c has the standard deviation c/4 along each axis.
        """
        disc = focal_px * self.aperture_mm * np.abs(1.0 / depth_mm - 1.0 / self.focus_mm)
        return np.asarray(STD_OF_DISC * disc)


def blur_levels(sigma_px: FloatMap) -> FloatMap:
    """Return the blurs, rising, between which a map of blurs is interpolated, px."""
    low, high = float(np.min(sigma_px)), float(np.max(sigma_px))
    if high - low < 1e-9:
        return np.array([low])
    start = max(low, SMALLEST_LEVEL_PX)
    count = int(np.ceil(np.log(max(high / start, 1.0)) / np.log(LEVEL_RATIO))) + 1
    levels = start * LEVEL_RATIO ** np.arange(count)
    return levels if low >= SMALLEST_LEVEL_PX else np.concatenate(([0.0], levels))


def level_weights(sigma_px: FloatMap, variances: FloatMap) -> list[NDArray[np.float64]]:
    """Shares of images of given blur variances that have a blur of σ together, px.

    Two neighbouring images are mixed linearly in the variance, so that the mixture's variance is
    σ².
    """
    one_each = np.eye(variances.size)
    return [np.asarray(np.interp(sigma_px**2, variances, one)) for one in one_each]


def blurred_by_map(image: FloatMap, sigma_px: FloatMap) -> FloatMap:
    """Blur an image by a Gaussian that differs from pixel to pixel.

    Parameters
    ----------
    image : (h, w) array
    sigma_px : (h, w) array ≥ 0
        Standard deviation of the blur at every pixel of the result, px.

    Returns
    -------
    (h, w) array

    Notes
    -----
    The blur is that of the place where light arrives. At depth steps it should be that of the
    surface which the light comes from; there the result is an approximation.
    """
    levels = blur_levels(sigma_px)
    variances = np.array([_variance(level) for level in levels])
    weights = level_weights(sigma_px, variances)
    result = np.zeros(image.shape)
    for level, weight in zip(levels, weights, strict=True):
        result += weight * scipy.ndimage.gaussian_filter(image, level, mode="nearest")
    return result


def _variance(sigma_px: float) -> float:
    """Variance of SciPy's sampled Gaussian, px²: below a blur of 0.6 px it is less than σ²."""
    if sigma_px == 0:
        return 0.0
    reach = int(4.0 * sigma_px + 0.5)
    n = np.arange(-reach, reach + 1)
    weight = np.exp(-0.5 * (n / sigma_px) ** 2)
    return float(np.sum(n**2 * weight) / np.sum(weight))
