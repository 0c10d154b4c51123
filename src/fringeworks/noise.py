"""How much noise is in a frame."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from fringeworks.types import BoolMap, FloatMap


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
