"""A turntable before the virtual rig, for the tests: bodies and a board that turn about an axis, with errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fringeworks.rig.calibration.board import Board
from fringeworks.rig.pinhole import inverse, pose, rotation
from fringeworks.simulate.bodies import Body, Mesh, Sphere
from fringeworks.simulate.standard import DISTANCE_MM, board_body, bust
from fringeworks.types import FloatMap, InputError

BUST_FOOT_MM = (83.0, 18.0)
"""Lowest y of the bust, and z of the middle of its foot, mm: the foot stands on the table's
centre."""


@dataclass(frozen=True)
class TurntableErrors:
    """How a real turntable differs from an ideal one.

    Raises
    ------
    InputError for standard deviations below 0.
    """

    angle_deg: float = 0.0
    """Standard deviation of the angle of every view, degrees."""
    wobble_deg: float = 0.0
    """Tilt of the table against its axis, degrees. The tilt turns with the table."""
    runout_mm: float = 0.0
    """Standard deviation by which the axis is displaced sideways in every view, mm."""
    seed: int = 0
    """Seed of the errors."""

    def __post_init__(self) -> None:
        if not (self.angle_deg >= 0 and self.runout_mm >= 0):
            raise InputError(
                f"turntable: expected errors >= 0, got {self.angle_deg}° and {self.runout_mm} mm"
            )


def turntable_pose(
    *, distance_mm: float = DISTANCE_MM, elevation_deg: float = 35.0, height_mm: float = 50.0
) -> FloatMap:
    """Return the pose T_camera_table of a table at angle 0, (4, 4), mm.

    Parameters
    ----------
    distance_mm : float
        Distance from the camera to a point on the table's axis.
    elevation_deg : float
        Angle by which the camera looks down at the table.
    height_mm : float
        Height of that point above the table.

    Returns
    -------
    (4, 4) array. The table's z axis is the axis of rotation and points down into the table; its y
    axis points towards the camera at angle 0.
    """
    turn = rotation(np.array([np.radians(elevation_deg - 90.0), 0.0, 0.0]))
    return pose(turn, np.array([0.0, 0.0, distance_mm]) + height_mm * turn[:, 2])


def turned_poses(
    T_camera_table: FloatMap, angles_deg: Sequence[float], errors: TurntableErrors | None = None
) -> list[FloatMap]:
    """Return the table's pose in the camera at every angle, with the errors of a real turntable.

    Parameters
    ----------
    T_camera_table : (4, 4) array
        Pose at angle 0, mm.
    angles_deg : sequence of float
        Nominal angles, degrees.
    errors : TurntableErrors, optional

    Returns
    -------
    list of (4, 4) arrays.
    """
    errors = errors or TurntableErrors()
    rng = np.random.default_rng(errors.seed)
    tilt = pose(rotation(np.array([np.radians(errors.wobble_deg), 0.0, 0.0])), np.zeros(3))
    found: list[FloatMap] = []
    for angle in angles_deg:
        real = np.radians(angle + errors.angle_deg * rng.standard_normal())
        aside = np.append(errors.runout_mm * rng.standard_normal(2), 0.0)
        found.append(T_camera_table @ pose(rotation(np.array([0.0, 0.0, real])), aside) @ tilt)
    return found


def on_table(bodies: Sequence[Body], T_camera_table: FloatMap) -> list[Body]:
    """Move bodies that are given in the table's coordinates to the camera's."""
    return [replace(body, T_world_body=T_camera_table @ body.T_world_body) for body in bodies]


def bust_on_table(*, albedo: float = 0.75) -> list[Body]:
    """Return the bust without its wall in the table's coordinates; at angle 0 it faces the camera.

    Parameters
    ----------
    albedo : float, 0…1
    """
    axes = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    low, middle = BUST_FOOT_MM
    return bust(pose(axes, -axes @ np.array([0.0, low, middle])), albedo=albedo)[:-1]


def hexagon_on_table(
    *, marks: int = 2, mark_mm: float = 3.0, turn: float = 0.13, albedo: float = 0.75
) -> list[Body]:
    """Return a hexagonal prism on the table's centre, with half balls as marks on two of its sides.

    Parameters
    ----------
    marks : 0, 1 or 2
    mark_mm : float > 0
        Radius of a mark.
    turn : float
        Angle of the prism, rad.
    albedo : float, 0…1
    """
    angle = turn + np.pi / 3.0 * np.arange(6)
    ring = 38.0 * np.column_stack((np.cos(angle), np.sin(angle)))
    foot, top = (np.column_stack((ring, np.full(6, z))) for z in (0.0, -70.0))
    vertices = np.concatenate((foot, top, [[0.0, 0.0, 0.0], [0.0, 0.0, -70.0]]))
    faces = []
    for k in range(6):
        n = (k + 1) % 6
        faces += [[k, n, 6 + n], [k, 6 + n, 6 + k], [12, n, k], [13, 6 + k, 6 + n]]
    bodies = [Body(Mesh(vertices, np.array(faces)), np.eye(4), albedo)]
    for face, z in ((0, -40.0), (2, -22.0))[:marks]:
        out = angle[face] + np.pi / 6.0
        middle = 38.0 * np.cos(np.pi / 6.0) * np.array([np.cos(out), np.sin(out)])
        place = pose(np.eye(3), np.append(middle, z))
        bodies.append(Body(Sphere(mark_mm), place, albedo))
    return bodies


def board_on_table(board: Board, T_table_board: FloatMap | None = None) -> Body:
    """Return a board that lies on the table, in the table's coordinates.

    Parameters
    ----------
    board : Board
    T_table_board : (4, 4) array, optional
        Pose of the board; by default its corners are centred on the axis.
    """
    centred = inverse(pose(np.eye(3), board.points_mm.mean(axis=0)))
    return board_body(board, centred if T_table_board is None else T_table_board)
