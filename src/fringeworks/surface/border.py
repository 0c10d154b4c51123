"""Where a measured surface ends in the image: beside missing pixels and beside steps in depth."""

from __future__ import annotations

import numpy as np
import scipy

from fringeworks.surface.cloud import cloud_triangles
from fringeworks.types import BoolMap, PointCloud


def inside_surface(cloud: PointCloud, distance_px: int = 1) -> BoolMap:
    """Find the pixels whose neighbours all continue the same surface.

    Parameters
    ----------
    cloud : PointCloud
    distance_px : int ≥ 1
        How far the surface goes on around a pixel, px.

    Returns
    -------
    (h, w) bool array. False beside pixels without a point, and beside steps in depth as
    ``cloud_triangles`` finds them. Blur mixes the light of two surfaces there, or of a surface and
    its shadow.

    Examples
    --------
    >>> from fringeworks.types import PointCloud
    >>> z = np.full((5, 5), 500.0)
    >>> z[:, 3:] = 540.0
    >>> y, x = np.mgrid[:5, :5] * 1.0
    >>> flat = np.zeros((5, 5))
    >>> cloud = PointCloud(np.stack((x, y, z), -1), flat, flat, flat.astype(np.uint8))
    >>> inside_surface(cloud)[2].tolist()
    [False, True, False, False, False]
    """
    h, w = cloud.shape
    faces = cloud_triangles(cloud).astype(np.int64)
    # A square of four pixels has two triangles: one begins at its first pixel, one at its second.
    square = np.where(faces[:, 1] - faces[:, 0] == w, faces[:, 0], faces[:, 0] - 1)
    whole = np.bincount(square, minlength=h * w).reshape(h, w) == 2
    inner = np.zeros((h, w), bool)
    inner[1:, 1:] = whole[1:, 1:] & whole[:-1, 1:] & whole[1:, :-1] & whole[:-1, :-1]
    if distance_px > 1:
        side = 2 * distance_px - 1
        inner = scipy.ndimage.minimum_filter(inner, side, mode="constant", cval=False)
    return np.asarray(inner)
