"""The unknowns of a calibration: devices, their relative pose, the board's poses and its shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fringeworks.rig.calibration.board_shape import BOW_SIZE, OFFSET_SIZE, SHAPE_SIZE, BoardShape
from fringeworks.rig.pinhole import inverse, rotation
from fringeworks.types import RIG_PARAMETERS, FloatMap, Pinhole, Rig

DEVICE_SIZE = 9
"""Number of parameters of a device, those of ``Pinhole.parameters``."""
RIG_SIZE = len(RIG_PARAMETERS)
"""Number of parameters of a rig: two devices, then rotation (rad) and translation (mm)."""
POSE_SIZE = 6
"""Number of parameters of a pose: rotation (rad), then translation (mm)."""
FURTHER_SIZE = DEVICE_SIZE + POSE_SIZE
"""Number of parameters of every camera after the first: its device and its pose."""


@dataclass(frozen=True, eq=False)
class FurtherCamera:
    """A camera after the first of a rig."""

    camera: Pinhole
    T_camera_first: FloatMap
    """(4, 4), maps coordinates of the first camera to this camera's; mm."""

    def moved(self, step: FloatMap) -> FurtherCamera | None:
        """Return the camera after a step of its 15 parameters; None where it is none."""
        device = _moved_device(self.camera, step[:DEVICE_SIZE])
        if device is None:
            return None
        return FurtherCamera(device, moved_pose(self.T_camera_first, step[DEVICE_SIZE:]))


@dataclass(frozen=True, eq=False)
class State:
    """Values of all unknowns."""

    rig: Rig
    poses: tuple[FloatMap, ...]
    """T_camera_board of the board in every pose before the first camera, (4, 4), mm."""
    shape: BoardShape
    """How the board deviates from its description."""
    further: tuple[FurtherCamera, ...] = ()
    """Cameras after the first."""

    @property
    def devices_size(self) -> int:
        """Number of parameters of all devices and their poses, 24 + 15 (cameras − 1)."""
        return RIG_SIZE + FURTHER_SIZE * len(self.further)

    def moved(self, step: FloatMap) -> State | None:
        """Return the state after a step of all parameters.

        They are those of the devices, 6 for every pose, those of the board's smooth errors and 3
        for every point. None where a focal length would not be positive or a device's parameter not
        finite.
        """
        size = self.devices_size
        rig = moved_rig(self.rig, step[:RIG_SIZE])
        further = [
            other.moved(part)
            for other, part in zip(
                self.further, step[RIG_SIZE:size].reshape(-1, FURTHER_SIZE), strict=True
            )
        ]
        if rig is None or any(other is None for other in further):
            return None
        of_board = step[size + POSE_SIZE * len(self.poses) :]
        of_poses = step[size : step.size - of_board.size].reshape(-1, POSE_SIZE)
        poses = tuple(moved_pose(np.stack(self.poses), of_poses))
        shape = BoardShape(
            self.shape.bow_mm + of_board[:BOW_SIZE],
            self.shape.smooth_mm + of_board[BOW_SIZE:SHAPE_SIZE],
            self.shape.offset_mm + of_board[SHAPE_SIZE:].reshape(-1, OFFSET_SIZE),
        )
        return State(rig, poses, shape, tuple(o for o in further if o is not None))


def moved_rig(rig: Rig, step: FloatMap) -> Rig | None:
    """Return a rig after a step of its 24 parameters, without a covariance.

    None where a focal length would not be positive or a device's parameter not finite.
    """
    camera = _moved_device(rig.camera, step[:DEVICE_SIZE])
    projector = _moved_device(rig.projector, step[DEVICE_SIZE : 2 * DEVICE_SIZE])
    if camera is None or projector is None:
        return None
    T = moved_pose(rig.T_projector_camera, step[2 * DEVICE_SIZE : RIG_SIZE])
    return Rig(camera, projector, T)


def _moved_device(device: Pinhole, step: FloatMap) -> Pinhole | None:
    """A device after a step of its nine parameters; None where it is none."""
    values = device.parameters + step
    if not (np.isfinite(values).all() and values[0] > 0 and values[1] > 0):
        return None
    return pinhole_of(values, device)


def parameter_change(found: Rig, reference: Rig) -> FloatMap:
    """Return the difference of two rigs, (24,), in the order of ``RIG_PARAMETERS``."""
    return np.concatenate(
        (
            found.camera.parameters - reference.camera.parameters,
            found.projector.parameters - reference.projector.parameters,
            pose_change(found.T_projector_camera, reference.T_projector_camera),
        )
    )


def further_change(found: Sequence[FurtherCamera], reference: Sequence[FurtherCamera]) -> FloatMap:
    """Return the difference of the same cameras in two rigs, (15 cameras,)."""
    parts: list[FloatMap] = [np.zeros(0)]
    for a, b in zip(found, reference, strict=True):
        parts.append(a.camera.parameters - b.camera.parameters)
        parts.append(pose_change(a.T_camera_first, b.T_camera_first))
    return np.concatenate(parts)


def pair_rig(first: Rig, further: Sequence[FurtherCamera], camera: int) -> Rig:
    """Return one camera, by its number, and the projector as a rig without a covariance."""
    if camera == 0:
        return first
    other = further[camera - 1]
    T = first.T_projector_camera @ inverse(other.T_camera_first)
    return Rig(other.camera, first.projector, T)


def pose_change(found: FloatMap, reference: FloatMap) -> FloatMap:
    """Return the rotation vector (rad) and the translation (mm) from one pose to another, (6,)."""
    turn = found[:3, :3] @ reference[:3, :3].T
    axis = 0.5 * np.array(
        [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    )
    sine = float(np.linalg.norm(axis))
    if sine > 0:
        axis *= np.arctan2(sine, 0.5 * (np.trace(turn) - 1.0)) / sine
    return np.concatenate((axis, found[:3, 3] - reference[:3, 3]))


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


def pinhole_of(values: FloatMap, like: Pinhole) -> Pinhole:
    """Build a device from its nine parameters and the frame size of another device.

    Parameters
    ----------
    values : (9,) array
        In the order of ``Pinhole.parameters``.
    like : Pinhole
        Its frame size and its field are taken over.
    """
    v = [float(x) for x in values]
    return Pinhole(
        like.width_px,
        like.height_px,
        (v[0], v[1]),
        (v[2], v[3]),
        (v[4], v[5], v[6], v[7], v[8]),
        like.field,
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
