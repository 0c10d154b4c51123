"""Noise of frames, and of a camera as a function of brightness."""

from __future__ import annotations

import numpy as np

from fringeworks import _core
from fringeworks._lazy import scipy
from fringeworks.statistics.chi_square import residual_variance
from fringeworks.statistics.groups import similar_groups
from fringeworks.statistics.quantiles import NORMAL_MEDIAN, median
from fringeworks.types import BoolMap, CameraNoise, FloatMap

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
    kind = np.float32 if frame.dtype == np.float32 else np.float64
    second = _core.second_magnitudes(np.ascontiguousarray(frame, kind)).ravel()
    if second.size and not ok.all():
        whole = scipy.ndimage.binary_erosion(ok, np.ones((3, 3)))[1:-1, 1:-1]
        second = second[whole.ravel()]
    return (median(second) / NORMAL_MEDIAN) ** 2 / 36.0 if second.size else 0.0


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
    groups = similar_groups(brightness, square, BRIGHTNESS_GROUPS, MIN_GROUP_PIXELS)

    def constant() -> CameraNoise:
        return CameraNoise(residual_variance(square, freedom) ** 0.5)

    if len(groups) < MIN_GROUPS:
        return constant()
    size = np.array([light.size for light, _ in groups])
    mean = np.array([light.mean() for light, _ in groups])
    variance = np.array([residual_variance(part, freedom) for _, part in groups])
    # Groups without any noise, such as those that are cut off at zero counts, say nothing.
    noisy = variance > NO_NOISE * variance.max()
    size, mean, variance = size[noisy], mean[noisy], variance[noisy]
    if len(mean) < MIN_GROUPS or np.ptp(mean) < MIN_BRIGHTNESS_SPREAD * mean.max():
        return constant()
    weight = size * freedom / (2.0 * variance**2)
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
        return constant()
    return CameraNoise(float(np.sqrt(read_variance)), float(gain))
