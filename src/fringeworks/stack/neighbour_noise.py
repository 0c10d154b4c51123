"""Noise of the camera from neighbouring pixels, for stacks that leave no residuals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from fringeworks.signal.noise import (
    BRIGHTNESS_GROUPS,
    GAIN_SIGMAS,
    MIN_BRIGHTNESS_SPREAD,
)
from fringeworks.stack.kernel_settings import Limits
from fringeworks.stack.noise import CLIPPED_SIGMAS, MIN_JUDGED_PIXELS
from fringeworks.statistics.quantiles import NORMAL_MEDIAN
from fringeworks.types import CameraNoise, FloatMap

DIFFERENCE_GAIN = 36.0
"""Variance of the product of second differences along x and y, over that of white noise."""
MEDIAN_INFORMATION = 0.37 / 4.0
"""Information of a product of second differences in a median, over that of an independent residual:
the median uses 37 % of it, and about four neighbouring products share their noise."""


def neighbour_noise(patch: Sequence[FloatMap], limits: Limits, rough: CameraNoise) -> CameraNoise:
    """Noise as a function of brightness, from the differences of neighbouring pixels.

    Parameters
    ----------
    patch : (h, w) float arrays
        Connected pixels of some frames, counts.
    limits : Limits
    rough : CameraNoise
        The same without regard to brightness; returned where too few pixels keep their distance
        from the sensor's limits, which cut off the noise.

    Returns
    -------
    CameraNoise; it contains the texture of the scene.

    Notes
    -----
    σ² = read² + gain · I by weighted least squares over groups of similar brightness. Variances are
    medians of products of second differences (Immerkær, CVIU 64, 1996).
    """
    brightness, off = (np.concatenate(v) for v in zip(*map(_differences, patch), strict=True))
    margin = CLIPPED_SIGMAS * rough.read_counts
    inside = (brightness > margin) & ~(brightness > limits.saturation - margin)
    if inside.sum() < MIN_JUDGED_PIXELS:
        return rough
    brightness, off = brightness[inside], off[inside]
    order = np.argsort(brightness, kind="stable")
    groups = np.array_split(order, min(BRIGHTNESS_GROUPS, order.size // MIN_JUDGED_PIXELS))
    mean = np.array([brightness[group].mean() for group in groups])
    variance = np.array([_variance(off[group]) for group in groups])
    constant = CameraNoise(_variance(off) ** 0.5)
    if np.ptp(mean) < MIN_BRIGHTNESS_SPREAD * mean.max() or not (variance > 0.0).all():
        return constant
    design = np.stack((np.ones_like(mean), mean), axis=1)
    size = MEDIAN_INFORMATION * np.array([group.size for group in groups])
    weighted = design.T * (size / (2.0 * variance**2))
    read, gain = np.linalg.solve(weighted @ design, weighted @ variance)
    error = np.linalg.inv(weighted @ design)[1, 1] ** 0.5
    if gain < GAIN_SIGMAS * error:
        return constant
    if read < 0.0:
        read, gain = 0.0, float(weighted[1] @ variance / (weighted[1] @ mean))
    return CameraNoise(float(read) ** 0.5, float(gain))


def _differences(frame: FloatMap) -> tuple[FloatMap, FloatMap]:
    """Mean brightness of 3 × 3 pixels, counts, and magnitude of the product of second differences,
    of every neighbourhood that is finite."""
    if min(frame.shape) < 3:
        return np.empty(0), np.empty(0)
    mean = scipy.ndimage.uniform_filter(frame, 3)[1:-1, 1:-1]
    off = np.abs(np.diff(np.diff(frame, 2, axis=0), 2, axis=1))
    finite = np.isfinite(off) & np.isfinite(mean)
    return mean[finite], off[finite]


def _variance(off: FloatMap) -> float:
    """Variance of a pixel, counts², from products of second differences."""
    median = float(np.partition(off, off.size // 2)[off.size // 2])  # one of the values
    if median > 0.0 and not (off % 1.0).any():
        # Whole numbers: the place of the median within its count.
        median += float((0.5 - np.mean(off < median)) / np.mean(off == median)) - 0.5
    return (median / NORMAL_MEDIAN) ** 2 / DIFFERENCE_GAIN
