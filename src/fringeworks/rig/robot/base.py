"""Points in the coordinates of a robot's base."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from fringeworks.rig.pinhole import skew
from fringeworks.rig.robot.readings import Reading, RobotPoses, distinct
from fringeworks.types import (
    Finding,
    FloatMap,
    InputError,
    PointCloud,
    Rig,
    RobotFrame,
    check_rigid,
)

TINY_MM = 1e-9
"""Lower bound of a distance, mm, so that its logarithm is finite."""
BASE = "base"
"""Name of the coordinates of a robot's base."""


def in_base(
    cloud: PointCloud, rig: Rig, robot_pose: RobotPoses | FloatMap | None = None
) -> PointCloud:
    """Return points in the coordinates of the robot's base, with the hand–eye error in their σ.

    Parameters
    ----------
    cloud : PointCloud
        In camera coordinates.
    rig : Rig
        With ``robot``, from ``hand_eye``.
    robot_pose : RobotPoses or (4, 4) array, optional
        Where the flange was when the frames were taken: one pose as the robot writes it, or
        T_base_flange in mm. Needed where the camera is in the hand, refused where it is not.

    Returns
    -------
    PointCloud
        In "base". σ holds the covariance of the hand–eye calibration and, with the camera in the
        hand, the noise of the robot's pose, in the worst direction; all points have it in common.

    Raises
    ------
    InputError for a rig without ``robot``, a pose that is missing or not needed, and one that can
    be read in several ways that the rig does not decide.

    Examples
    --------
    >>> import numpy as np
    >>> import fringeworks as fw
    >>> rig = fw.simulate.standard_rig()
    >>> in_base(None, rig)
    Traceback (most recent call last):
    ...
    fringeworks.types.errors.InputError: rig: expected where the camera is on the robot, got ...
    """
    T, covariance = base_camera(rig, robot_pose)
    if cloud.placement is not None:
        raise InputError(
            f"cloud: expected points in camera coordinates, got those of {cloud.frame}"
        )
    placed = cloud.transformed(T, frame=BASE, covariance=covariance)
    assert rig.robot is not None
    unknown = _unknown(rig.robot)
    return replace(placed, findings=(*placed.findings, *unknown)) if unknown else placed


def base_camera(
    rig: Rig, robot_pose: RobotPoses | FloatMap | None = None
) -> tuple[FloatMap, FloatMap | None]:
    """Return T_base_camera and its covariance, or None for the covariance where it is unknown.

    Parameters and errors are those of ``in_base``: it refuses the same before frames are taken.
    """
    robot = rig.robot
    if robot is None:
        raise InputError(
            "rig: expected where the camera is on the robot, got none: hand-eye calibrates it"
        )
    if robot.mount == "base":
        if robot_pose is not None:
            raise InputError(
                "robot pose: expected none, because the camera stands beside the robot (mount base)"
            )
        return robot.T_mount_camera, robot.covariance
    if robot_pose is None:
        raise InputError(
            "robot pose: expected the pose of the flange at these frames, because the camera "
            "is in the robot's hand (mount hand), got none"
        )
    return _by_pose(robot, _pose(robot, robot_pose))


def _by_pose(robot: RobotFrame, flange: FloatMap) -> tuple[FloatMap, FloatMap | None]:
    """T_base_camera with the camera in the hand, and its covariance.

    An error (ω, v) of the robot's pose and (ω', v') of the camera on the flange make
    (ω + R ω', v + ω × R t' + R v').
    """
    T = flange @ robot.T_mount_camera
    parts = []
    if robot.covariance is not None:
        turn = np.kron(np.eye(2), flange[:3, :3])
        parts.append(turn @ robot.covariance @ turn.T)
    if robot.noise is not None:
        lever = np.eye(6)
        lever[3:, :3] = -skew(flange[:3, :3] @ robot.T_mount_camera[:3, 3])
        parts.append(lever @ np.diag(robot.noise.variances) @ lever.T)
    return T, sum(parts[1:], parts[0]) if parts else None


def _pose(robot: RobotFrame, given: RobotPoses | FloatMap) -> FloatMap:
    """T_base_flange of one pose, read as the poses of the calibration were."""
    if not isinstance(given, RobotPoses):
        return check_rigid(given, "robot pose")
    if len(given) != 1:
        raise InputError(f"robot pose: expected one, got {len(given)}")
    same = tuple(r for r in given.readings if r.spec == robot.poses_as)
    if robot.poses_as and not same:
        raise InputError(
            f"robot pose: expected it written as {robot.poses_as}, as at the hand-eye calibration, "
            f"but it can only be {' or '.join(r.spec for r in given.readings[:3])}"
        )
    known = RobotPoses(given.values, given.names, same or given.readings)
    if same and robot.reach_mm is not None:
        _check_unit(given, same[0], robot.reach_mm)
    found = distinct(known)
    return np.asarray(found[0][1][0] if len(found) == 1 else known.transforms[0])


def _check_unit(given: RobotPoses, reading: Reading, reach_mm: float) -> None:
    """Refuse a pose that lies where the robot worked only in the other unit of length.

    mm and m differ by 1000: the unit is the one by which the flange is nearer, as a ratio, to the
    distance that it had at the calibration. A unit that was stated is not doubted.
    """
    other = replace(reading, length="m" if reading.length == "mm" else "mm")
    if other not in given.readings:
        return
    away = [_away_mm(given, one) for one in (reading, other)]
    off = [abs(math.log(max(d, TINY_MM) / reach_mm)) for d in away]
    if off[1] < off[0]:
        raise InputError(
            f"robot pose: expected it in {reading.length}, as at the hand-eye calibration, but the "
            f"flange would be {away[0]:.4g} mm from the base, and {away[1]:.4g} mm if the numbers "
            f"are in {other.length}; at the calibration it was {reach_mm:.4g} mm. Say poses_as "
            f"(--poses-as) {reading.length} if the pose is right, or write it in {reading.length}"
        )


def _away_mm(given: RobotPoses, reading: Reading) -> float:
    """Distance of the flange from the base, mm."""
    T = reading.transforms(given.values)
    assert T is not None
    return float(np.linalg.norm(T[0, :3, 3]))


def _unknown(robot: RobotFrame) -> tuple[Finding, ...]:
    missing = ["of the hand-eye calibration"] if robot.covariance is None else []
    if robot.mount == "hand" and robot.noise is None:
        missing.append("of the robot's poses")
    if not missing:
        return ()
    what = f"σ does not hold the errors {' and '.join(missing)}, which the rig does not state"
    return (Finding("uncertainty", what, advice="calibrate the camera on the robot by hand-eye"),)
