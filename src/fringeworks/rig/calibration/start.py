"""Start of a calibration: each device calibrated alone, then their relative pose."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from fringeworks.rig.calibration.parameters import pinhole_of
from fringeworks.rig.calibration.poses import relative_pose, tilts_deg
from fringeworks.rig.calibration.residuals import Sighting
from fringeworks.rig.pinhole import pose, rays
from fringeworks.types import FloatMap, InputError, Pinhole, Rig
from fringeworks.types.packages import cv2

MIN_TILT_DEG = 5.0
"""The two boards that differ most must be tilted against each other by this, degrees. Parallel
boards do not determine focal lengths (Zhang 2000). On the virtual rig with four poses and corners
of 0.01 px, 5° leaves the camera's focal length uncertain by 0.3 %, 20° by 0.03 %."""


def start(
    sightings: Sequence[Sighting],
    camera_size: tuple[int, int],
    projector_size: tuple[int, int],
    *,
    distortion: bool = True,
) -> tuple[Rig, list[FloatMap]]:
    """Estimate a rig and the board's poses to start bundle adjustment from.

    Parameters
    ----------
    sightings : sequence of Sighting
    camera_size, projector_size : (columns, rows)
    distortion : bool
        Whether k₁ and k₂ are estimated; all coefficients are 0 otherwise.

    Returns
    -------
    The rig without a covariance, and T_camera_board of every sighting.

    Raises
    ------
    InputError where a device cannot be calibrated alone, and where all boards are parallel.
    """
    camera, T_camera_board = _calibrated_alone("camera", sightings, camera_size, distortion)
    projector, T_projector_board = _calibrated_alone(
        "projector", sightings, projector_size, distortion
    )
    _check_tilts(T_camera_board)
    return Rig(camera, projector, relative_pose(T_camera_board, T_projector_board)), T_camera_board


def first_pose(sighting: Sighting, camera: Pinhole) -> FloatMap:
    """Estimate the pose of a board, T_camera_board (4, 4), from a known camera alone."""
    return first_pose_of(sighting.points_mm, sighting.camera_px, camera)


def first_pose_of(points_mm: FloatMap, camera_px: FloatMap, camera: Pinhole) -> FloatMap:
    """Estimate the pose of a board from its points (m, 3), mm, and their pixels (m, 2)."""
    ideal = np.ascontiguousarray(rays(camera, camera_px)[:, :2])
    _, turn, shift = cv2.solvePnP(points_mm, ideal, np.eye(3), None)
    return pose(np.asarray(cv2.Rodrigues(turn)[0], np.float64), np.ravel(shift))


def _calibrated_alone(
    device: Literal["camera", "projector"],
    sightings: Sequence[Sighting],
    size: tuple[int, int],
    distorted: bool,
) -> tuple[Pinhole, list[FloatMap]]:
    """Calibrate one device with OpenCV; also return the board's poses before it."""
    pixels = [s.camera_px if device == "camera" else s.projector_px for s in sightings]
    points = [s.points_mm.astype(np.float32) for s in sightings]
    images = [p.astype(np.float32) for p in pixels]
    flags = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    if not distorted:
        flags |= cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2
    failed = f"calibration: the {device} could not be calibrated alone, as the start needs"
    try:
        _, K, d, turns, shifts = cv2.calibrateCamera(points, images, size, None, None, flags=flags)
    except cv2.error as error:
        raise InputError(f"{failed}: {str(error).splitlines()[0]}") from error
    distortion = np.zeros(5)
    distortion[: min(5, d.size)] = d.ravel()[:5]
    values = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *distortion])
    if not np.isfinite(values).all() or min(K[0, 0], K[1, 1]) <= 0:
        raise InputError(f"{failed}: expected a focal length > 0 px, got {K[0, 0]:g} px")
    poses = [
        pose(np.asarray(cv2.Rodrigues(r)[0], np.float64), np.ravel(t))
        for r, t in zip(turns, shifts, strict=True)
    ]
    return pinhole_of(values, Pinhole(*size, (1.0, 1.0), (0.0, 0.0))), poses


def _check_tilts(T_camera_board: Sequence[FloatMap]) -> None:
    largest = float(tilts_deg(T_camera_board).max())
    if largest < MIN_TILT_DEG:
        raise InputError(
            f"calibration: expected boards tilted against each other by {MIN_TILT_DEG:g}° or more, "
            f"got {len(T_camera_board)} that are parallel within {largest:.1f}°: they do not "
            "determine focal lengths; tilt the board by 15° to 35° to all sides"
        )
