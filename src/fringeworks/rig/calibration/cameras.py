"""Calibration of several cameras and one projector from a flat board, in one bundle adjustment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fringeworks.rig.calibration.adjusted import Adjusted
from fringeworks.rig.calibration.board import Board
from fringeworks.rig.calibration.bundle import adjust
from fringeworks.rig.calibration.calibrate import (
    Observation,
    check_orientation,
    check_poses,
    refined,
    sighting_of,
)
from fringeworks.rig.calibration.coefficients import free_parameters, without_useless
from fringeworks.rig.calibration.leave_out import leave_poses_out, with_smooth_board
from fringeworks.rig.calibration.parameters import FurtherCamera
from fringeworks.rig.calibration.poses import relative_pose
from fringeworks.rig.calibration.residuals import Sighting
from fringeworks.rig.calibration.start import start
from fringeworks.rig.pinhole import inverse
from fringeworks.types import FloatMap, Frozen, InputError, MultiRig, Pinhole, Rig
from fringeworks.types.packages import need_opencv


@dataclass(frozen=True, eq=False, repr=False)
class MultiCalibration(Frozen):
    """A calibrated rig of several cameras, and what it was calibrated from."""

    rig: MultiRig
    """All devices and their poses, with the covariance of all parameters."""
    board: Board
    observations: tuple[tuple[Observation, ...], ...]
    """Per camera: the poses that it saw, with their corners as measured the second time."""
    poses: tuple[str, ...]
    """Names of the board's poses, in the order of ``adjusted.poses``."""
    skipped: dict[str, str]
    """Poses that could not be observed by a camera, with the reason."""
    adjusted: Adjusted
    """The bundle adjustment. Its sightings are those of the first camera, then of the second, and
    so on, each in the order of ``observations``."""
    bow_mm: FloatMap
    """As in ``Calibration``."""
    bow_sigma_mm: FloatMap
    """Their standard deviations, (3,), mm."""
    predicted_px: tuple[float, ...]
    """Per pose: root mean square error of its projector coordinates in all cameras, predicted by a
    calibration without this pose, px; empty for three poses or fewer."""
    inflation: float = 1.0
    """Factor ≥ 1 by which the standard deviations were raised, as in ``Calibration``."""


def calibrate_cameras(
    observations: Sequence[Sequence[Observation]],
    board: Board,
    *,
    skipped: dict[str, str] | None = None,
    distortion: int | None = None,
) -> MultiCalibration:
    """Calibrate several cameras and one projector, with the covariance of every parameter.

    Parameters
    ----------
    observations : one sequence of Observation per camera
        Three poses or more for each. Observations with one name are of one pose of the board; a
        camera need not see every pose.
    board : Board
    skipped, distortion
        As for ``calibrate``.

    Returns
    -------
    MultiCalibration

    Raises
    ------
    InputError as ``calibrate``, with the number of the camera, and for a camera that has no pose of
    the board in common with an earlier one.

    Notes
    -----
    One bundle adjustment holds all devices, all poses and the board's shape. A pose that several
    cameras see ties them to each other, and their errors are correlated in the covariance. The
    further steps are those of ``calibrate``.
    """
    need_opencv("a calibration")
    skipped = dict(skipped or {})
    for number, seen in enumerate(observations, 1):
        try:
            check_poses(seen, board, skipped)
            check_orientation(seen)
        except InputError as error:
            raise error.at(f"camera {number}") from error
    names = list(dict.fromkeys(o.name for seen in observations for o in seen))
    free = free_parameters(distortion, len(observations) - 1)
    sightings = _sightings(observations, board, names)
    rig, further, poses = _start(observations, sightings, distortion != 0)
    adjusted = adjust(sightings, rig, poses, free=free, further=further)
    refined_again = _refined(observations, board, names, adjusted)
    sightings = _sightings(refined_again, board, names)
    adjusted = adjust(sightings, adjusted.rig, adjusted.poses, free=free, further=adjusted.further)
    adjusted = with_smooth_board(sightings, adjusted, free=free)
    if distortion is None:
        adjusted, left_out, free = without_useless(sightings, adjusted, free)
    else:
        left_out = leave_poses_out(sightings, adjusted, free=free)
    return MultiCalibration(
        rig=multi_rig_of(adjusted, left_out.inflation),
        board=board,
        observations=tuple(tuple(seen) for seen in refined_again),
        poses=tuple(names),
        skipped=skipped,
        adjusted=adjusted,
        bow_mm=adjusted.shape.bow_mm,
        bow_sigma_mm=adjusted.bow_sigma_mm * left_out.inflation,
        predicted_px=left_out.predicted_px,
        inflation=left_out.inflation,
    )


def multi_rig_of(adjusted: Adjusted, inflation: float = 1.0) -> MultiRig:
    """Return the adjusted rig, its standard deviations raised by a factor."""
    rig, further = adjusted.rig, adjusted.further
    assert rig.residual_px is not None
    camera_px, projector_px = rig.residual_px
    return MultiRig(
        (rig.camera, *(other.camera for other in further)),
        rig.projector,
        rig.T_projector_camera,
        np.stack([np.eye(4), *(other.T_camera_first for other in further)]),
        adjusted.devices_covariance * inflation**2,
        (camera_px, *adjusted.further_rms_px, projector_px),
    )


def _sightings(
    observations: Sequence[Sequence[Observation]], board: Board, names: list[str]
) -> list[Sighting]:
    """The corners of all cameras, each with its camera and pose."""
    return [
        replace(sighting_of(o, board), camera=k, pose=names.index(o.name))
        for k, seen in enumerate(observations)
        for o in seen
    ]


def _start(
    observations: Sequence[Sequence[Observation]], sightings: Sequence[Sighting], distorted: bool
) -> tuple[Rig, list[FurtherCamera], list[FloatMap]]:
    """Start from every camera with the projector alone, tied by the poses that they share."""
    first, further, place_of = None, [], dict[int, FloatMap]()
    for k, seen in enumerate(observations):
        own = [s for s in sightings if s.camera == k]
        try:
            rig, boards = start(
                own, seen[0].camera_size, seen[0].projector_size, distortion=distorted
            )
        except InputError as error:
            raise error.at(f"camera {k + 1}") from error
        here = {s.pose: T for s, T in zip(own, boards, strict=True) if s.pose is not None}
        if first is None:
            first, place_of = rig, here
            continue
        common = [pose for pose in here if pose in place_of]
        if not common:
            raise InputError(
                f"camera {k + 1}: expected a pose of the board that an earlier camera sees as "
                "well, got none: let both see the board in some poses"
            )
        T = relative_pose([place_of[p] for p in common], [here[p] for p in common])
        further.append(FurtherCamera(rig.camera, T))
        place_of = {pose: inverse(T) @ seen_at for pose, seen_at in here.items()} | place_of
    assert first is not None
    return first, further, [place_of[pose] for pose in sorted(place_of)]


def _refined(
    observations: Sequence[Sequence[Observation]],
    board: Board,
    names: list[str],
    adjusted: Adjusted,
) -> list[list[Observation]]:
    """All observations with their corners measured again."""
    cameras: list[tuple[Pinhole, FloatMap]] = [(adjusted.rig.camera, np.eye(4))]
    cameras += [(other.camera, other.T_camera_first) for other in adjusted.further]
    return [
        [refined(o, board, camera, T @ adjusted.poses[names.index(o.name)]) for o in seen]
        for (camera, T), seen in zip(cameras, observations, strict=True)
    ]
