"""Height maps as points and triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fringeworks.types import FloatMap, HeightMap

MAX_SLOPE = 10.0
"""Triangles steeper than this (rise over run) would bridge a cliff and are left out."""


def points(surface: HeightMap) -> tuple[FloatMap, FloatMap, NDArray[np.int32]]:
    """The measured pixels as points.

    Returns
    -------
    xyz : (n, 3) float64
        x to the right and y up in the image, z towards the camera: right-handed; lateral unit as
        the pitch's (mm, or px without a geometry).
    sigma : (n,) float64, of z
    index : (h, w) int32, row of a pixel's point, −1 where it has none
    """
    valid = np.isfinite(surface.values)
    y, x = np.nonzero(valid)
    xyz = np.column_stack((x * surface.pitch, -y * surface.pitch, surface.values[valid]))
    index = np.full(valid.shape, -1, np.int32)
    index[valid] = np.arange(len(xyz), dtype=np.int32)
    return xyz.astype(np.float64), surface.sigma[valid].astype(np.float64), index


def triangles(surface: HeightMap, index: NDArray[np.int32]) -> NDArray[np.int32]:
    """Triangles between neighbouring points, (m, 3) rows of ``points``, facing the camera."""
    a, b = index[:-1, :-1], index[:-1, 1:]
    c, d = index[1:, :-1], index[1:, 1:]
    z = surface.values
    za, zb, zc, zd = z[:-1, :-1], z[:-1, 1:], z[1:, :-1], z[1:, 1:]

    def keep(
        corners: tuple[NDArray[np.int32], ...], heights: tuple[FloatMap, ...]
    ) -> NDArray[np.int32]:
        rise = np.maximum.reduce(heights) - np.minimum.reduce(heights)
        # NaN compares false: a triangle with an unmeasured corner is left out.
        good = rise <= MAX_SLOPE * surface.pitch
        return np.column_stack([corner[good] for corner in corners])

    return np.vstack((keep((a, c, b), (za, zc, zb)), keep((b, c, d), (zb, zc, zd))))
