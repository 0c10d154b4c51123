"""The unknowns of a calibration: devices, their relative pose, the board's poses and its shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.rig.calibration.board_shape import BOW_SIZE, OFFSET_SIZE, BoardShape
from fringeworks.rig.pinhole import rotation
from fringeworks.types import RIG_PARAMETERS, FloatMap, Pinhole, Rig

DEVICE_SIZE = 9
"""Number of parameters of a device, those of ``Pinhole.parameters``."""
RIG_SIZE = len(RIG_PARAMETERS)
"""Number of parameters of a rig: two devices, then rotation (rad) and translation (mm)."""
POSE_SIZE = 6
"""Number of parameters of a pose: rotation (rad), then translation (mm)."""


@dataclass(frozen=True, eq=False)
class State:
    """Values of all unknowns."""

    rig: Rig
    poses: tuple[FloatMap, ...]
    """T_camera_board of every sighting, (4, 4), mm."""
    shape: BoardShape
    """How the board deviates from its description."""

    def moved(self, step: FloatMap) -> State | None:
        """Return the state after a step of all parameters, (24 + 6 poses + 3 + 3 points,).

        None where a focal length would not be positive or a device's parameter not finite.
        """
        rig = moved_rig(self.rig, step[:RIG_SIZE])
        if rig is None:
            return None
        of_board = step[RIG_SIZE + POSE_SIZE * len(self.poses) :]
        of_poses = step[RIG_SIZE : step.size - of_board.size].reshape(-1, POSE_SIZE)
        poses = tuple(moved_pose(np.stack(self.poses), of_poses))
        shape = BoardShape(
            self.shape.bow_mm + of_board[:BOW_SIZE],
            self.shape.offset_mm + of_board[BOW_SIZE:].reshape(-1, OFFSET_SIZE),
        )
        return State(rig, poses, shape)


def moved_rig(rig: Rig, step: FloatMap) -> Rig | None:
    """Return a rig after a step of its 24 parameters, without a covariance.

    None where a focal length would not be positive or a device's parameter not finite.
    """
    devices = []
    for k, device in enumerate((rig.camera, rig.projector)):
        values = device.parameters + step[DEVICE_SIZE * k : DEVICE_SIZE * (k + 1)]
        if not (np.isfinite(values).all() and values[0] > 0 and values[1] > 0):
            return None
        devices.append(pinhole_of(values, device))
    T = moved_pose(rig.T_projector_camera, step[2 * DEVICE_SIZE : RIG_SIZE])
    return Rig(devices[0], devices[1], T)


def parameter_change(found: Rig, reference: Rig) -> FloatMap:
    """Return the difference of two rigs, (24,), in the order of ``RIG_PARAMETERS``."""
    turn = found.T_projector_camera[:3, :3] @ reference.T_projector_camera[:3, :3].T
    small = 0.5 * np.array(
        [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    )
    return np.concatenate(
        (
            found.camera.parameters - reference.camera.parameters,
            found.projector.parameters - reference.projector.parameters,
            small,
            found.T_projector_camera[:3, 3] - reference.T_projector_camera[:3, 3],
        )
    )


@dataclass(frozen=True, eq=False)
class RigPrior:
    """What is known about a rig before an adjustment."""

    rig: Rig
    """The most likely rig."""
    precision: FloatMap
    """Inverse covariance of its 24 parameters, (24, 24); zero where nothing is known."""

    def information(self, rig: Rig) -> tuple[FloatMap, FloatMap]:
        """Return the precision (24, 24), and the difference of a rig from the most likely (24,)."""
        return self.precision, parameter_change(rig, self.rig)


def pose_slice(k: int) -> slice:
    """Return where the parameters of the k-th board pose lie in the vector of all parameters."""
    return slice(RIG_SIZE + POSE_SIZE * k, RIG_SIZE + POSE_SIZE * (k + 1))


def pinhole_of(values: FloatMap, like: Pinhole) -> Pinhole:
    """Build a device from its nine parameters and the frame size of another device.

    Parameters
    ----------
    values : (9,) array
        In the order of ``Pinhole.parameters``.
    like : Pinhole
        Its frame size is taken over.
    """
    v = [float(x) for x in values]
    return Pinhole(
        like.width_px, like.height_px, (v[0], v[1]), (v[2], v[3]), (v[4], v[5], v[6], v[7], v[8])
    )


def moved_pose(T: FloatMap, step: FloatMap) -> FloatMap:
    """Change poses (..., 4, 4) by small rotation vectors (rad) and translations (mm), (..., 6).

    The rotation ω turns R into exp(ω) R.
    """
    turned = rotation(step[..., :3]) @ T[..., :3, :3]
    # Rounding errors add up over many steps, so the nearest exact rotation is taken.
    u, _, v = np.linalg.svd(turned)
    moved = np.array(T)
    moved[..., :3, :3] = u @ v
    moved[..., :3, 3] += step[..., 3:]
    return moved
