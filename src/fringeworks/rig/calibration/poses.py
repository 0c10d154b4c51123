"""Poses of a board and of the two devices, by themselves: fits, starts and angles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fringeworks.rig.calibration.parameters import POSE_SIZE, moved_pose
from fringeworks.rig.calibration.residuals import Sighting, point_by_pose
from fringeworks.rig.pinhole import inverse, project_with_derivatives
from fringeworks.types import FloatMap, Rig

MAX_POSE_STEPS = 40
"""Largest number of Gauss–Newton steps for a pose; from a good start fewer than five are usual."""
ROTATION_SETTLED_RAD = 1e-10
"""Rotation step below which a pose has settled, rad: 1e-6 px in an image 10 000 px wide."""
TRANSLATION_SETTLED_MM = 1e-8
"""Translation step below which a pose has settled, mm: far below any measurement."""


def fit_pose(sighting: Sighting, rig: Rig, start: FloatMap) -> FloatMap:
    """Fit the pose of a board to the camera's corners alone; the rig stays as it is.

    Parameters
    ----------
    sighting : Sighting
    rig : Rig
    start : (4, 4) array
        T_camera_board, mm.

    Returns
    -------
    (4, 4) array, T_camera_board, mm.
    """
    T = start
    for _ in range(MAX_POSE_STEPS):
        turned = sighting.points_mm @ T[:3, :3].T
        predicted, by_point, _ = project_with_derivatives(rig.camera, turned + T[:3, 3])
        J = (by_point @ point_by_pose(turned)).reshape(-1, POSE_SIZE)
        step = np.linalg.lstsq(J, (sighting.camera_px - predicted).ravel(), rcond=None)[0]
        T = moved_pose(T, step)
        rotation_settled = np.linalg.norm(step[:3]) < ROTATION_SETTLED_RAD
        if rotation_settled and np.linalg.norm(step[3:]) < TRANSLATION_SETTLED_MM:
            break
    return T


def relative_pose(
    T_camera_board: Sequence[FloatMap], T_projector_board: Sequence[FloatMap]
) -> FloatMap:
    """Return T_projector_camera from the poses of the same boards before both devices.

    Every pose of the board gives one estimate. The one whose translation has the smallest median
    distance from all others is returned, so that a few wrong poses do no harm.
    """
    estimates: list[NDArray[np.float64]] = [
        p @ inverse(c) for c, p in zip(T_camera_board, T_projector_board, strict=True)
    ]
    translations = np.array([T[:3, 3] for T in estimates])
    distance = np.linalg.norm(translations[:, None] - translations[None], axis=2)
    return estimates[int(np.argmin(np.median(distance, axis=1)))]


def tilts_deg(T_camera_board: Sequence[FloatMap]) -> FloatMap:
    """Return the angles between the normals of boards, (n, n), degrees."""
    normals = np.stack([T[:3, 2] for T in T_camera_board])
    return np.degrees(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0)))
