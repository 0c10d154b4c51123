"""What a camera sees of a plane: the projector coordinates of all its pixels, from the rig."""

from __future__ import annotations

import numpy as np

from fringeworks.rig.stated_plane import MODES, StatedPlane
from fringeworks.types import CoordinateMap, FloatMap, InputError, Reason, sealed

BLOCK_ROWS = 64
"""Rows that are computed at a time: their intermediate values are a small part of a frame."""


def surface_coordinates(
    stated: StatedPlane,
    modes_mm: FloatMap | None = None,
    covariance: FloatMap | None = None,
) -> CoordinateMap:
    """Predict the projector coordinate of every camera pixel that looks at a stated plane.

    Parameters
    ----------
    stated : StatedPlane
    modes_mm : (MODES,) array, optional
        Displacement of the plane, mm.
    covariance : (MODES, MODES) array, optional
        Covariance of the modes, mm², from which σ comes; 0 without.

    Returns
    -------
    CoordinateMap without noise; NaN with the reason ``OUTSIDE`` where the plane is not in front of
    both devices, or not in the projector's frame. Its modulation and background are NaN.

    Raises
    ------
    InputError for a plane of which camera and projector see nothing.
    """
    rig = stated.rig
    modes = np.zeros(MODES) if modes_mm is None else modes_mm
    h, w = rig.camera.shape
    seen, sigma = np.empty((h, w, 2)), np.zeros((h, w))
    for top in range(0, h, BLOCK_ROWS):
        rows, columns = np.mgrid[top : min(top + BLOCK_ROWS, h), :w].astype(np.float64)
        pixels = np.stack((columns.ravel(), rows.ravel()), axis=-1)
        block = slice(top, top + BLOCK_ROWS)
        seen[block] = stated.coordinates(pixels, modes).reshape(*rows.shape, 2)
        if covariance is not None:
            shapes = stated.shapes(pixels)
            variance = np.maximum(np.einsum("ni,ij,nj->n", shapes, covariance, shapes), 0.0)
            moved = np.abs(stated.per_mm(pixels, modes)) * np.sqrt(variance)
            sigma[block] = moved.reshape(rows.shape)
    k = 0 if stated.axis == "x" else 1
    size = (rig.projector.width_px, rig.projector.height_px)
    with np.errstate(invalid="ignore"):
        lit = ((seen >= -0.5) & (seen <= np.array(size) - 0.5)).all(axis=-1)
    if not lit.any():
        raise InputError("plane: expected one that camera and projector see, got another")
    unknown = sealed(np.full((h, w), np.nan))
    return CoordinateMap(
        coordinate_px=sealed(np.where(lit, seen[..., k], np.nan)),
        sigma_px=sealed(np.where(lit, sigma, np.nan)),
        modulation=unknown,
        background=unknown,
        reason=sealed(np.where(lit, Reason.OK, Reason.OUTSIDE).astype(np.uint8)),
        axis=stated.axis,
        periods_px=(),
    )
