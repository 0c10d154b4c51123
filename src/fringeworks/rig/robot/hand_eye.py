"""Hand–eye calibration: where the camera is on a robot, with its covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fringeworks.rig.calibration.board import Board
from fringeworks.rig.calibration.board_view import BoardView
from fringeworks.rig.calibration.parameters import POSE_SIZE
from fringeworks.rig.robot.board_views import SeenBoards, seen_boards
from fringeworks.rig.robot.choose import Chosen, chosen, chosen_of_transforms
from fringeworks.rig.robot.findings import findings_of
from fringeworks.rig.robot.fit import Fit
from fringeworks.rig.robot.readings import RobotPoses
from fringeworks.types import (
    BoolMap,
    Finding,
    FloatMap,
    Frozen,
    InputError,
    Mount,
    Noted,
    Provenance,
    Rig,
    RobotFrame,
    RobotNoise,
    check_rigid,
    unmasked,
)


@dataclass(frozen=True, eq=False, repr=False)
class HandEye(Noted, Frozen):
    """The camera's place on a robot, and how well all poses agree with it."""

    robot: RobotFrame
    """``T_flange_camera`` or ``T_base_camera`` with its covariance, as a rig holds it."""
    T_other_board: FloatMap
    """The board on the robot's other side, (4, 4), mm: ``T_base_board`` with the camera in the
    hand, ``T_flange_board`` with the camera beside the robot."""
    board_covariance: FloatMap
    """(6, 6) covariance of its error; rad, mm."""
    noise_estimated: bool
    """Whether the robot's noise comes from the residuals: not stated, or contradicted by them."""
    names: tuple[str, ...]
    """Names of the poses."""
    used: BoolMap
    """(n,), False for poses that stand out and were left out."""
    left_out_mm: FloatMap
    """(n,), distance of the board of every pose from where the other poses predict it, root mean
    square over the board, mm."""
    left_out_sigma_mm: FloatMap
    """(n,), what noise lets expect of it, mm."""
    corner_px: float
    """Standard deviation of a corner, per coordinate, px."""
    distance_mm: float
    """Mean distance of the board from the camera, mm."""
    converged: bool
    """Whether the last step was below its limit."""
    findings: tuple[Finding, ...] = ()
    """What was found about poses and readings, and what to do about it."""
    provenance: Provenance | None = None
    """How it was made; None where the caller made the views."""

    @property
    def sigma(self) -> FloatMap:
        """Standard deviations of the transform: rotation (rad), then translation (mm), (6,)."""
        assert self.robot.covariance is not None
        return np.sqrt(np.diag(self.robot.covariance))

    @property
    def board_sigma_mm(self) -> float:
        """Standard deviation that this gives to points at the board's distance, in space, mm."""
        assert self.robot.covariance is not None
        T = self.robot.T_mount_camera
        lever = T[:3, :3] @ np.array([0.0, 0.0, self.distance_mm])
        x, y, z = lever
        by = np.hstack((-np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]), np.eye(3)))
        return float(np.sqrt(np.trace(by @ self.robot.covariance @ by.T)))

    @property
    def text(self) -> str:
        """The result in one sentence."""
        shift = self.robot.T_mount_camera[:3, 3]
        sigma = self.sigma
        places = ", ".join(
            f"{axis} {value:.3f} ± {s:.3f}"
            for axis, value, s in zip("xyz", shift, sigma[3:], strict=True)
        )
        turn = np.degrees(np.sqrt(np.mean(sigma[:3] ** 2)))
        return (
            f"{self.robot.name}: camera at {places} mm, turned to ± {turn:.2g}°; "
            f"± {self.board_sigma_mm:.2g} mm at {self.distance_mm:.0f} mm, from "
            f"{int(np.count_nonzero(self.used))} of {len(self.used)} poses"
        )

    def __str__(self) -> str:
        return "\n".join([self.text, *(f.line for f in self.findings)])


def hand_eye_of(
    robot_poses: RobotPoses | FloatMap,
    views: Sequence[BoardView],
    board: Board,
    rig: Rig,
    *,
    mount: Mount,
    noise: RobotNoise | None = None,
    names: Sequence[str] = (),
) -> HandEye:
    """Calibrate the camera's place on a robot from corners; see ``fringeworks.rig.hand_eye``."""
    if mount not in ("hand", "base"):
        raise InputError(
            "mount: expected hand (the camera on the flange) or base (the camera beside the "
            f"robot), got {mount!r}"
        )
    poses = _poses(robot_poses)
    if len(poses) != len(views):
        raise InputError(
            f"hand-eye: expected a robot pose for each of the {len(views)} board views, got "
            f"{len(poses)}"
        )
    known = _names(poses, views, names)
    seen = seen_boards(views, board, rig, known)
    if isinstance(poses, RobotPoses):
        found = chosen(poses, seen, mount, noise)
    else:
        found = chosen_of_transforms(poses, seen, mount, noise)
    return _result(found, seen, known, rig)


def _poses(given: Any) -> RobotPoses | FloatMap:
    if isinstance(given, RobotPoses):
        return given
    T = (
        unmasked(given, "robot_poses").astype(np.float64)
        if not isinstance(given, str)
        else np.empty(0)
    )
    if T.ndim != 3:
        raise InputError(
            "robot_poses: expected RobotPoses, or transforms T_base_flange (n, 4, 4), got "
            f"{type(given).__name__} of shape {T.shape}"
        )
    return np.stack([check_rigid(one, "robot_poses") for one in T]) if len(T) else T


def _names(
    poses: RobotPoses | FloatMap, views: Sequence[BoardView], names: Sequence[str]
) -> tuple[str, ...]:
    if names and len(names) != len(views):
        raise InputError(f"names: expected {len(views)}, got {len(names)}")
    own = poses.names if isinstance(poses, RobotPoses) else ()
    return tuple(names) or own or tuple(f"pose {k}" for k in range(1, len(views) + 1))


def _reach_mm(fit: Fit) -> float | None:
    """Median distance of the flange from the base; None where it is the base's own place."""
    away = np.linalg.norm(fit.data.T_base_flange[fit.used][:, :3, 3], axis=1)
    return float(np.median(away)) or None


def _result(found: Chosen, seen: SeenBoards, names: tuple[str, ...], rig: Rig) -> HandEye:
    fit: Fit = found.fit
    solution = fit.solution
    covariance = fit.covariance
    robot = RobotFrame(
        fit.data.mount,
        solution.X,
        covariance[:POSE_SIZE, :POSE_SIZE],
        fit.noise,
        "" if found.reading is None else found.reading.spec,
        _reach_mm(fit),
    )
    distance = np.linalg.norm(
        seen.T_camera_board[:, :3, :3] @ seen.middle_mm + seen.T_camera_board[:, :3, 3], axis=1
    )
    return HandEye(
        robot,
        solution.Y,
        covariance[POSE_SIZE:, POSE_SIZE:],
        fit.estimated,
        names,
        fit.used,
        fit.others.distance_mm,
        fit.others.sigma_mm,
        seen.scatter_px,
        float(np.mean(distance)),
        solution.converged,
        findings_of(found, names, rig),
    )
