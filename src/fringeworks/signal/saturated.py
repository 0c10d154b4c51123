"""Where a frame is at the limit of its counts."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.types import BoolMap

SATURATED_PX = 3
"""Side of the smallest square of samples at the sensor's limit that counts as saturated, px.

Smaller groups are usually peaks of the noise, whose neighbours still carry the fringe. An
empirical choice.
"""


def saturated_squares(frame: NDArray[Any]) -> BoolMap:
    """True where a frame is at the limit of its counts over 3 × 3 px.

    Parameters
    ----------
    frame : (h, w) array as captured
        Counts; floats have no limit.

    Returns
    -------
    (h, w) bool array
    """
    if frame.dtype.kind != "u":
        return np.zeros(frame.shape, bool)
    at_limit = frame == np.iinfo(frame.dtype).max
    return np.asarray(scipy.ndimage.binary_opening(at_limit, np.ones((SATURATED_PX, SATURATED_PX))))
