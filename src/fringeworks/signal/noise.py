"""How much noise is in a frame."""

from __future__ import annotations

import numpy as np
from scipy import ndimage, special

from fringeworks.types import BoolMap, CameraNoise, FloatMap

BINS = 8
"""Groups of equal brightness in which the noise is measured."""
TRIMMED = 0.9995
"""Share of the normal residuals that is used: larger ones are taken for outliers."""


def noise_variance(frame: FloatMap, ok: BoolMap) -> float:
    """Variance of the white noise in a frame of smooth fringes.

    The product of second differences along x and y leaves nothing of fringes that are locally
    plane, and 36 times the variance of white noise (Immerkær 1996, doi:10.1006/cviu.1996.0060);
    the median makes it blind to edges.
    """
    h, w = frame.shape
    if h < 3 or w < 3:
        return 0.0
    second = np.diff(np.diff(frame, 2, axis=0), 2, axis=1)
    if not ok.all():
        second = second[ndimage.binary_erosion(ok, np.ones((3, 3)))[1:-1, 1:-1]]
    if second.size == 0:
        return 0.0
    return float((np.median(np.abs(second)) / 0.6745) ** 2 / 36.0)


def chi_square_quantile(share: float, freedom: float) -> float:
    """Value that a χ² of ``freedom`` degrees stays below with the probability ``share``."""
    return float(2.0 * special.gammaincinv(0.5 * freedom, share))


def residual_variance(square: FloatMap, freedom: float) -> float:
    """Variance behind sums of ``freedom`` squared residuals each, blind to outliers.

    A mean over all sums below a quantile of χ², which starts from the median.
    """
    found = float(np.median(square)) / chi_square_quantile(0.5, freedom)
    limit = chi_square_quantile(TRIMMED, freedom)
    share = special.gammainc(0.5 * freedom + 1.0, 0.5 * limit) / TRIMMED
    for _ in range(3):
        if found <= 0:
            break
        found = float(np.mean(square[square <= found * limit])) / (freedom * float(share))
    return found


def noise_of_residuals(level: FloatMap, square: FloatMap, freedom: float) -> CameraNoise:
    """Camera noise from what a model leaves of many pixels.

    Parameters
    ----------
    level : (n,) float array, counts
        Brightness of each pixel.
    square : (n,) float array, counts²
        Sum of squared residuals of each pixel.
    freedom : float > 0
        Degrees of freedom of each sum.

    Notes
    -----
    σ² = read² + gain · I by weighted least squares over groups of equal brightness; a gain that is
    not positive by three of its standard errors is left out.
    """
    order = np.argsort(level, kind="stable")
    groups = [part for part in np.array_split(order, BINS) if part.size >= 50]
    plain = CameraNoise(float(np.sqrt(residual_variance(square, freedom))))
    if len(groups) < 3:
        return plain
    brightness = np.array([float(np.mean(level[part])) for part in groups])
    variance = np.array([residual_variance(square[part], freedom) for part in groups])
    if np.ptp(brightness) < 0.2 * brightness.max() or variance.min() <= 0:
        return plain
    weight = np.array([part.size for part in groups]) * freedom / (2.0 * variance**2)
    design = np.column_stack((np.ones_like(brightness), brightness))
    normal = np.linalg.inv(design.T @ (weight[:, None] * design))
    read, gain = normal @ (design.T @ (weight * variance))
    if gain < 3.0 * np.sqrt(normal[1, 1]) or read < 0:
        return plain
    return CameraNoise(float(np.sqrt(read)), float(gain))
