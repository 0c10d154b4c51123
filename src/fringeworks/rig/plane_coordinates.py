"""What a camera sees of a plane: the projector coordinates of all its pixels, from the rig."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fringeworks.rig.pinhole import project, rays, transform
from fringeworks.types import Axis, CoordinateMap, InputError, Reason, Rig, sealed

PLANE_NUMBERS = 4
"""a, b, c and d of a x + b y + c z = d."""


def plane_coordinates(rig: Rig, plane: Sequence[float], axis: Axis = "x") -> CoordinateMap:
    """Predict the projector coordinate of every camera pixel that looks at a plane.

    Parameters
    ----------
    rig : Rig
    plane : (a, b, c, d)
        a x + b y + c z = d in camera coordinates, mm; the length of (a, b, c) does not matter.
    axis : "x" or "y"
        Of the projector.

    Returns
    -------
    CoordinateMap without noise; NaN with the reason ``OUTSIDE`` where the plane is not in front of
    both devices, or not in the projector's frame. Its modulation and background are NaN.

    Raises
    ------
    InputError for a plane that is none, or through the camera's pupil.
    """
    a, b, c, d = _checked(plane)
    h, w = rig.camera.shape
    rows, columns = np.indices((h, w), dtype=np.float64)
    ray = rays(rig.camera, np.stack((columns, rows), axis=-1))
    with np.errstate(all="ignore"):
        depth = d / (ray @ np.array([a, b, c]))
        points = np.where(depth[..., None] > 0, ray * depth[..., None], np.nan)
        seen = project(rig.projector, transform(rig.T_projector_camera, points))
    k = 0 if axis == "x" else 1
    size = (rig.projector.width_px, rig.projector.height_px)
    with np.errstate(invalid="ignore"):
        lit = ((seen >= -0.5) & (seen <= np.array(size) - 0.5)).all(axis=-1)
    if not lit.any():
        raise InputError("plane: expected one that camera and projector see, got another")
    unknown = sealed(np.full((h, w), np.nan))
    return CoordinateMap(
        coordinate_px=sealed(np.where(lit, seen[..., k], np.nan)),
        sigma_px=sealed(np.where(lit, 0.0, np.nan)),
        modulation=unknown,
        background=unknown,
        reason=sealed(np.where(lit, Reason.OK, Reason.OUTSIDE).astype(np.uint8)),
        axis=axis,
        periods_px=(),
    )


def _checked(plane: Sequence[float]) -> list[float]:
    values = [float(v) for v in plane]
    good = len(values) == PLANE_NUMBERS and bool(np.isfinite(values).all())
    if not good or not any(values[:3]) or values[3] == 0:
        raise InputError(
            "plane: expected four numbers a, b, c, d of a x + b y + c z = d that is not through "
            f"the camera, got {list(plane)}"
        )
    return values
