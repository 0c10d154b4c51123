"""Noise of frames, and of a camera as a function of brightness."""

from __future__ import annotations

import numpy as np
import scipy

from fringeworks.signal.chi_square import chi_square_above, chi_square_quantile
from fringeworks.types import BoolMap, CameraNoise, FloatMap

NORMAL_MEDIAN = 0.6745
"""Median of |z| for a standard normal variable z."""

BRIGHTNESS_GROUPS = 8
"""Number of groups of equal size and similar brightness in which the noise is measured.

Two parameters are fitted; eight groups overdetermine them and still hold many pixels each. An
empirical choice.
"""

MIN_GROUP_PIXELS = 50
"""Smallest number of pixels in a group; its variance then errs by about 20 % (one residual each).

An empirical choice. Fewer pixels make the group's weight in the fit unreliable.
"""

MIN_GROUPS = 3
"""Smallest number of groups for a fit of both parameters, one more than there are parameters."""

MIN_BRIGHTNESS_SPREAD = 0.2
"""Smallest range of the groups' brightness, as a share of the largest, that determines a gain.

Over a smaller range the extrapolation to the dark is too uncertain. An empirical choice.
"""

GAIN_SIGMAS = 3.0
"""Smallest gain in standard errors; a smaller one counts as zero.

At three, noise without a gain is given one in 0.1 % of the cases.
"""

NO_NOISE = 1e-6
"""Variance of a group, over that of the noisiest one, below which it has no noise at all."""

TRIMMED = 0.9995
"""Share of Gaussian residuals that the variance is computed from; larger ones count as outliers.

The trimming costs next to no precision (0.05 % of the samples) and removes residuals above 3.5
standard deviations, such as those of moving edges. An empirical choice.
"""

TRIMMING_STEPS = 3
"""Steps of the trimmed variance; it starts at the median and changes little after the second."""


def noise_variance(frame: FloatMap, ok: BoolMap) -> float:
    """Variance of the white noise in a frame of smooth fringes.

    Parameters
    ----------
    frame : (h, w) float array, counts
    ok : (h, w) bool array
        True for pixels that may be used.

    Returns
    -------
    float ≥ 0, counts²; 0 where no 3 × 3 neighbourhood can be used.

    Notes
    -----
    The product of second differences along x and y vanishes for fringes that are locally plane, and
    has 36 times the variance of white noise (Immerkær, CVIU 64, 1996, doi:10.1006/cviu.1996.0060).
    The median of its magnitude is insensitive to edges.
    """
    h, w = frame.shape
    if h < 3 or w < 3:
        return 0.0
    second = np.diff(np.diff(frame, 2, axis=0), 2, axis=1)
    if not ok.all():
        second = second[scipy.ndimage.binary_erosion(ok, np.ones((3, 3)))[1:-1, 1:-1]]
    if second.size == 0:
        return 0.0
    return float((np.median(np.abs(second)) / NORMAL_MEDIAN) ** 2 / 36.0)


def residual_variance(square: FloatMap, freedom: int) -> float:
    """Variance of a residual, from sums of squared residuals, insensitive to outliers.

    Parameters
    ----------
    square : (n,) float array, counts²
        Sums of squared residuals.
    freedom : int ≥ 1
        Degrees of freedom of each sum.

    Returns
    -------
    float ≥ 0, counts².

    Notes
    -----
    The mean over all sums below a quantile of χ², corrected for the trimming. It starts from the
    median.
    """
    variance = float(np.median(square)) / chi_square_quantile(0.5, freedom)
    limit = chi_square_quantile(TRIMMED, freedom)
    share = (1.0 - chi_square_above(limit, freedom + 2)) / TRIMMED
    for _ in range(TRIMMING_STEPS):
        if variance <= 0:
            break
        inner = square[square <= variance * limit]
        variance = float(np.mean(inner)) / (freedom * share)
    return variance


def noise_of_residuals(
    brightness: FloatMap, square: FloatMap, freedom: int, floor_counts: float = 0.0
) -> CameraNoise:
    """Noise of a camera, from the residuals of a model at many pixels.

    Parameters
    ----------
    brightness : (n,) float array, counts
        Brightness of each pixel.
    square : (n,) float array, counts²
        Sum of squared residuals of each pixel.
    freedom : int ≥ 1
        Degrees of freedom of each sum.
    floor_counts : float ≥ 0
        Smallest possible standard deviation in the dark, that of rounding, counts.

    Returns
    -------
    CameraNoise; without a gain where the pixels do not determine one.

    Notes
    -----
    σ² = read² + gain · I by weighted least squares over groups of similar brightness. The gain is
    set to zero where it is below three of its standard errors. Where the dark noise would be below
    that of rounding, it is set to it, and the gain is fitted alone.
    """
    order = np.argsort(brightness, kind="stable")
    parts = np.array_split(order, BRIGHTNESS_GROUPS)
    groups = [part for part in parts if part.size >= MIN_GROUP_PIXELS]
    constant = CameraNoise(float(np.sqrt(residual_variance(square, freedom))))
    if len(groups) < MIN_GROUPS:
        return constant
    mean = np.array([float(np.mean(brightness[part])) for part in groups])
    variance = np.array([residual_variance(square[part], freedom) for part in groups])
    # Groups without any noise, such as those that are cut off at zero counts, say nothing.
    noisy = variance > NO_NOISE * variance.max()
    groups = [part for part, kept in zip(groups, noisy, strict=True) if kept]
    mean, variance = mean[noisy], variance[noisy]
    if len(groups) < MIN_GROUPS or np.ptp(mean) < MIN_BRIGHTNESS_SPREAD * mean.max():
        return constant
    weight = np.array([part.size for part in groups]) * freedom / (2.0 * variance**2)
    least = min(floor_counts**2, float(variance.min()))
    normal = np.array([[weight.sum(), weight @ mean], [weight @ mean, weight @ mean**2]])
    read_variance, gain = np.linalg.solve(
        normal, np.array([weight @ variance, weight * mean @ variance])
    )
    error = float(np.sqrt(np.linalg.inv(normal)[1, 1]))
    if read_variance < least:
        # Shot noise dominates: the noise in the dark is that of rounding.
        read_variance = least
        gain = weight @ ((variance - least) * mean) / (weight @ mean**2)
        error = float((weight @ mean**2) ** -0.5)
    if gain < GAIN_SIGMAS * error:
        return constant
    return CameraNoise(float(np.sqrt(read_variance)), float(gain))
