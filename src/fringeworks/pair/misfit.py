"""Where windows do not explain the object: squares of what they leave, averaged over patches."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fringeworks.signal.filters import box_mean, opened
from fringeworks.types import BoolMap

PATCH_PX = 7
"""Side of the squares over which misfits are averaged: the mean of 49 squares scatters by 20 %."""
MIN_MISFIT = 4.0
"""Mean squared misfit of a patch that the windows do not explain, in variances of the noise."""
MIN_MISFIT_SHARE = 1e-3
"""The same as a share of the squared modulation, on frames without noise."""
MIN_BLOB_PX = 5
"""Side of the smallest square of such pixels that counts; smaller ones are chance or dust."""
MIN_POOR_PIXELS = 50
"""Number of such pixels from which edges are searched."""
MEDIAN_STEP = 4
"""Every so many rows and columns determine the median."""


def mean_square(misfit: NDArray[np.float32], side_px: int = PATCH_PX) -> NDArray[np.float32]:
    """Mean square over squares of a side, (h, w); pixels without data count as 0."""
    square = np.where(np.isfinite(misfit), misfit**2, np.float32(0))
    return box_mean(square, side_px, "edge")


def usual_noise(patches: NDArray[np.float32], noise: float) -> float:
    """Variance that most patches show, at least that of the noise: compression leaves more."""
    return max(noise, float(np.median(patches[::MEDIAN_STEP, ::MEDIAN_STEP])))


def unexplained(misfit: NDArray[np.float32], noise: float, most: float = MIN_MISFIT) -> BoolMap:
    """Where the mean squared misfit of a patch is more than ``most`` variances of noise, (h, w)."""
    patches = mean_square(misfit)
    poor = patches > most * usual_noise(patches, noise) + MIN_MISFIT_SHARE
    return opened(poor, MIN_BLOB_PX)


def is_rare(places: BoolMap) -> bool:
    """Whether so few pixels are marked that nothing is searched there."""
    return int(np.count_nonzero(places)) < MIN_POOR_PIXELS
