"""The rig that calibration and measurement are proved on, and what is put before it."""

from __future__ import annotations

import numpy as np

from fringeworks.patterns.plan import PatternPlan, PhaseSteps, equal_steps
from fringeworks.rig.calibration.board import Board
from fringeworks.rig.pinhole import look_at, pose, rotation
from fringeworks.simulate.bodies import Body, Box, Cylinder, Paraboloid, Plane, Sphere
from fringeworks.types import FloatMap, Pinhole, Rig

DISTANCE_MM = 500.0
"""From the camera to the middle of the field."""


def standard_rig(*, scale: float = 1.0, baseline_mm: float = 280.0) -> Rig:
    """A camera of 1280 × 1024 and a projector of 1920 × 1200 px on a field of 200 mm at 500 mm.

    Parameters
    ----------
    scale : float > 0
        Size of both frames over that; 0.5 has a quarter of the pixels and the same field.
    baseline_mm : float
        Distance of the two pupils.
    """
    camera = Pinhole(
        round(1280 * scale),
        round(1024 * scale),
        (3150.0 * scale, 3152.0 * scale),
        (648.0 * scale, 509.0 * scale),
        (-0.12, 0.15, 4e-4, -3e-4, 0.0),
    )
    projector = Pinhole(
        round(1920 * scale),
        round(1200 * scale),
        (4100.0 * scale, 4096.0 * scale),
        (968.0 * scale, 610.0 * scale),
        (-0.05, 0.04, -3e-4, 5e-4, 0.0),
    )
    middle = np.array([0.0, 0.0, DISTANCE_MM])
    return Rig(camera, projector, look_at(np.array([baseline_mm, 8.0, 0.0]), middle))


def fringe_plan(rig: Rig, *, both: bool = True, steps: int = 4) -> PatternPlan:
    """Three sets of fringes along x (59, 64 and 70 on 1920 px), and along y as well for a board."""
    width, height = rig.projector.width_px, rig.projector.height_px
    along_x = [PhaseSteps("x", width / n, equal_steps(steps)) for n in (59, 64, 70)]
    along_y = [PhaseSteps("y", height / n, equal_steps(steps)) for n in (37, 40, 44)]
    return PatternPlan(width, height, (*along_x, *(along_y if both else ())))


def board_poses(board: Board, count: int = 12, *, seed: int = 0) -> list[FloatMap]:
    """Places of a board before the standard rig, tilted by 15° to 35° to all sides.

    Returns
    -------
    T_camera_board of each, (4, 4), mm.
    """
    rng = np.random.default_rng(seed)
    middle = pose(np.eye(3), -board.points_mm.mean(axis=0))
    poses: list[FloatMap] = []
    for k in range(count):
        tilt = np.radians(rng.uniform(15.0, 35.0))
        side = 2.0 * np.pi * k / count + rng.uniform(-0.2, 0.2)
        turn = rotation(
            np.array([tilt * np.cos(side), tilt * np.sin(side), rng.uniform(-0.3, 0.3)])
        )
        place = [rng.uniform(-20, 20), rng.uniform(-15, 15), DISTANCE_MM + rng.uniform(-40, 50)]
        poses.append(pose(turn, np.array(place)) @ middle)
    return poses


def board_body(board: Board, T_camera_board: FloatMap) -> Body:
    """A board as a body before the camera."""
    left, top, right, bottom = board.extent_mm
    sheet = Plane(right - left, bottom - top, (0.5 * (left + right), 0.5 * (top + bottom)))
    return Body(sheet, T_camera_board, board.albedo)


def bust(T_camera_scene: FloatMap | None = None, *, albedo: float = 0.75) -> list[Body]:
    """Something like a head on shoulders: ellipse-like parts of simple bodies, 120 mm tall."""
    ahead = pose(np.eye(3), np.array([0.0, 0.0, DISTANCE_MM]))
    T = ahead if T_camera_scene is None else T_camera_scene

    def at(x: float, y: float, z: float, turn: tuple[float, float, float] = (0, 0, 0)) -> FloatMap:
        return T @ pose(rotation(np.array(turn, float)), np.array([x, y, z]))

    def eye(x: float, y: float) -> Body:
        return Body(Sphere(5.5), at(x, y, -22.5), albedo)

    return [
        Body(Sphere(30.0), at(0, -22, 5), albedo),
        Body(Sphere(26.0), at(0, -6, 1), albedo),
        Body(Cylinder(14.0, 40.0), at(0, 30, 8), albedo),
        Body(Sphere(8.0), at(0, 12, -19), albedo),
        # The nose: a cap that opens away from the camera.
        Body(Paraboloid(7.0, 14.0), at(0, -9, -23, (np.pi, 0, 0)), albedo),
        eye(-10.5, -18),
        eye(10.5, -18),
        Body(Cylinder(16.0, 110.0), at(0, 58, 14, (0, 0, np.pi / 2)), albedo),
        Body(Box((60.0, 26.0, 40.0)), at(0, 70, 18), albedo),
        Body(Plane(), at(0, 0, 60), 0.35),
    ]


def truth_distance(points_mm: FloatMap, measured_mm: FloatMap) -> FloatMap:
    """Signed error along the camera's ray: how much further than the truth, mm."""
    off = np.asarray(measured_mm, np.float64) - points_mm
    length = np.linalg.norm(points_mm, axis=-1)
    return np.asarray(np.sum(off * points_mm, axis=-1) / length)
