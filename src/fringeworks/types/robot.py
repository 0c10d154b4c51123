"""Where the camera is on a robot: on its flange, or before its base."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from fringeworks.types.arrays import FloatMap
from fringeworks.types.checks import finite, unmasked
from fringeworks.types.errors import InputError
from fringeworks.types.frozen import Frozen

Mount = Literal["hand", "base"]
"""Where the camera is fixed: "hand" on the robot's flange, "base" beside the robot."""
FARTHEST_MM = 1e9
"""Largest distance of a robot's frames, mm: beyond it, double precision holds no nanometre."""
RIGID_TOLERANCE = 1e-6
"""Largest deviation of RᵀR from the identity, as for the pose of a rig's projector."""


def check_rigid(T: FloatMap, name: str) -> FloatMap:
    """A transform (4, 4) in double precision.

    Raises
    ------
    InputError for an array that is no rotation and translation.
    """
    found = _numbers(T, (4, 4))
    if found is None:
        raise InputError(f"{name}: expected a finite (4, 4) transform, got {np.shape(T)}")
    turn = found[:3, :3]
    if np.abs(turn).max() > 1.0 + RIGID_TOLERANCE or np.abs(found[:3, 3]).max() > FARTHEST_MM:
        raise InputError(f"{name}: expected a rotation and a translation, got another matrix")
    off = np.abs(turn @ turn.T - np.eye(3)).max()
    if off > RIGID_TOLERANCE or np.linalg.det(turn) < 0 or (found[3] != (0, 0, 0, 1)).any():
        raise InputError(f"{name}: expected a rotation and a translation, got another matrix")
    return found


def check_pose_covariance(covariance: FloatMap | None, name: str) -> FloatMap | None:
    """A covariance (6, 6) in double precision, or None.

    Raises
    ------
    InputError for another shape, values that are not finite, and variances below 0.
    """
    if covariance is None:
        return None
    found = _numbers(covariance, (6, 6))
    if found is None or (np.diag(found) < 0).any() or np.abs(found).max() > FARTHEST_MM**2:
        raise InputError(f"{name}: expected a finite (6, 6) covariance, got {np.shape(covariance)}")
    return found


def _numbers(values: object, shape: tuple[int, int]) -> FloatMap | None:
    """Values in double precision; None for another shape, other types, and without a limit."""
    found = unmasked(values, "transform")
    if found.dtype.kind not in "fiu" or found.shape != shape or not np.isfinite(found).all():
        return None
    return found.astype(np.float64)


@dataclass(frozen=True, eq=False, repr=False)
class RobotNoise(Frozen):
    """Standard deviations of the pose that a robot states, beside the pose that it has.

    Raises
    ------
    InputError for values below 0.
    """

    translation_mm: float
    """Of every coordinate of the flange, mm."""
    rotation_deg: float
    """Of the rotation about every axis, degrees."""

    def __post_init__(self) -> None:
        super().__post_init__()
        values = (self.translation_mm, self.rotation_deg)
        if not finite(*values) or min(values) < 0:
            raise InputError(f"robot noise: expected mm and degrees >= 0, got {values}")

    @property
    def variances(self) -> FloatMap:
        """Of rotation (rad²) and translation (mm²), (6,)."""
        turn = np.radians(self.rotation_deg) ** 2
        return np.repeat([turn, self.translation_mm**2], 3)

    def __str__(self) -> str:
        return f"{self.translation_mm:.2g} mm and {self.rotation_deg:.2g}°"


@dataclass(frozen=True, eq=False, repr=False)
class RobotFrame(Frozen):
    """The camera's place on a robot, from a hand–eye calibration.

    Raises
    ------
    InputError for an unknown mount, a matrix that is no transform, a wrong covariance, and a reach
    that is not above 0.
    """

    mount: Mount
    """"hand": the camera moves with the flange. "base": it stands beside the robot."""
    T_mount_camera: FloatMap
    """(4, 4): ``T_flange_camera`` or ``T_base_camera``, maps camera coordinates, mm."""
    covariance: FloatMap | None = None
    """(6, 6) covariance of its error: rotation ω (rad) and shift v (mm) about the axes of flange or
    base turn R into exp(ω) R and t into t + v. None where unknown."""
    noise: RobotNoise | None = None
    """Errors of the robot's own poses, as stated or found; None where unknown."""
    poses_as: str = ""
    """How the robot's poses are written, such as "zyx:deg:mm"; empty where unknown."""
    reach_mm: float | None = None
    """Median distance of the flange from the base in the poses of the calibration, mm. It shows a
    pose that is written in another unit of length. None where unknown."""

    def __post_init__(self) -> None:
        if self.mount not in ("hand", "base"):
            raise InputError(f"mount: expected hand or base, got {self.mount!r}")
        T = check_rigid(self.T_mount_camera, "T_mount_camera")
        object.__setattr__(self, "T_mount_camera", T)
        known = check_pose_covariance(self.covariance, "robot.covariance")
        object.__setattr__(self, "covariance", known)
        if self.reach_mm is not None and not (finite(self.reach_mm) and self.reach_mm > 0):
            raise InputError(f"reach_mm: expected mm > 0 or None, got {self.reach_mm!r}")
        super().__post_init__()

    @property
    def name(self) -> str:
        """Name of the transform: ``T_flange_camera`` or ``T_base_camera``."""
        return "T_flange_camera" if self.mount == "hand" else "T_base_camera"
