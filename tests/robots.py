"""Robots with a camera and a board, as numbers: poses with noise and the corners of every view."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

import fringeworks as fw
from fringeworks.rig.pinhole import inverse, pose, project, rotation, transform
from fringeworks.rig.robot.readings import Reading, inverses
from fringeworks.rig.robot.start import rotation_vectors
from fringeworks.simulate import standard_rig

BOARD = "chessboard:11x8:12"
NOISE = (0.05, 0.01)
"""Robot noise, mm and degrees."""
CORNER_PX = 0.02
MOST_OUTSIDE = 48
"""Corners of 88 that may lie outside of a frame."""


@dataclass
class Robot:
    """A set-up with its views."""

    X: np.ndarray
    """T_flange_camera or T_base_camera, true."""
    Y: np.ndarray
    """The board on the other side, true."""
    T_base_flange: np.ndarray
    """Stated poses, (n, 4, 4)."""
    views: list
    mount: str

    def calibrated(self, poses=None, **options):
        given = self.T_base_flange if poses is None else poses
        known = {"mount": self.mount} | options
        board = known.pop("board", BOARD)
        return fw.rig.hand_eye(given, self.views, board, known.pop("rig", the_rig()), **known)

    def error(self, T) -> np.ndarray:
        """Rotation (rad) and translation (mm) from a result to the truth, (6,)."""
        turn = rotation_vectors(self.X[:3, :3] @ T[:3, :3].T)
        return np.concatenate((turn, self.X[:3, 3] - T[:3, 3]))


@lru_cache
def the_rig():
    return standard_rig()


def _any_rotation(rng) -> np.ndarray:
    axis = rng.normal(size=3)
    return rotation(axis / np.linalg.norm(axis) * rng.uniform(0.0, np.pi))


def board_places(rng, count: int, tilt_deg=(15.0, 45.0)) -> list[np.ndarray]:
    """T_camera_board of boards at 440 to 580 mm, tilted to all sides and turned by up to 50°."""
    board, rig = fw.rig.parse_board(BOARD), the_rig()
    middle = pose(np.eye(3), -board.points_mm.mean(axis=0))
    found = []
    while len(found) < count:
        tilt = np.radians(rng.uniform(*tilt_deg))
        side = 2.0 * np.pi * len(found) / count + rng.uniform(-0.3, 0.3)
        turn = rotation(np.array([tilt * np.cos(side), tilt * np.sin(side), 0.0]))
        turn = turn @ rotation(np.array([0.0, 0.0, rng.uniform(-0.9, 0.9)]))
        place = np.array([rng.uniform(-20, 20), rng.uniform(-15, 15), 500.0 + rng.uniform(-60, 80)])
        T = pose(turn, place) @ middle
        if np.count_nonzero(~_inside(project(rig.camera, transform(T, board.points_mm)))) <= (
            MOST_OUTSIDE
        ):
            found.append(T)
    return found


def _inside(pixels) -> np.ndarray:
    h, w = the_rig().camera.shape
    return ((pixels > 5) & (pixels < np.array([w - 6, h - 6]))).all(axis=1)


def robot(
    seed: int,
    count: int = 15,
    mount: str = "hand",
    *,
    noise=NOISE,
    corner_px=CORNER_PX,
    places=None,
    straight: bool = False,
    draw: int = 0,
    board: str = BOARD,
    camera=None,
) -> Robot:
    """A random set-up: where camera and board are, the robot's poses with noise, the corners.

    ``straight``: the first pose of a camera in the hand is the base itself, without a turn.
    ``draw``: which noise of the same set-up. ``camera``: the real one, beside that of the rig.
    """
    rng = np.random.default_rng(seed)
    reach = (600.0, 600.0, 400.0) if mount == "hand" else (100.0, 100.0, 100.0)
    X = pose(_any_rotation(rng), rng.uniform(-120.0, 120.0, 3))
    Y = pose(_any_rotation(rng), rng.uniform(-1.0, 1.0, 3) * reach)
    if mount == "base":
        X[:3, 3] = rng.uniform(-1.0, 1.0, 3) * (600.0, 600.0, 400.0)
    if straight:
        Y = X @ places[0]
    known, camera = fw.rig.parse_board(board), camera or the_rig().camera
    poses, views = [], []
    places = board_places(rng, count) if places is None else places
    rng = np.random.default_rng([seed, draw])
    for T in places:
        G = X @ T @ inverse(Y)
        B = inverse(G) if mount == "hand" else G
        turn = rng.normal(size=3) * np.radians(noise[1])
        poses.append(pose(rotation(turn) @ B[:3, :3], B[:3, 3] + rng.normal(size=3) * noise[0]))
        pixels = project(camera, transform(T, known.points_mm))
        index = np.flatnonzero(_inside(pixels))
        seen = pixels[index] + rng.normal(size=(len(index), 2)) * corner_px
        views.append(fw.rig.BoardView(index, seen))
    return Robot(X, Y, np.array(poses), views, mount)


def bound(made: Robot, noise=NOISE, corner_px=CORNER_PX) -> np.ndarray:
    """Least covariance of ``error`` that an unbiased estimate can have (Cramér and Rao), (6, 6).

    From the views alone, by differences: corners scatter by their own noise, and all corners of a
    view together by that of the robot's pose.
    """
    points, camera = fw.rig.parse_board(BOARD).points_mm, the_rig().camera
    scale = np.concatenate((np.full(3, np.radians(noise[1])), np.full(3, noise[0])))
    steps = np.diag([1e-6] * 3 + [1e-3] * 3)
    information = np.zeros((12, 12))

    def moved(T, step):
        return pose(rotation(step[:3]) @ T[:3, :3], T[:3, 3] + step[3:])

    for stated, view in zip(made.T_base_flange, made.views, strict=True):

        def pixels(steps, stated=stated, index=view.index):
            X, Y, B = (
                moved(T, step) for T, step in zip((made.X, made.Y, stated), steps, strict=True)
            )
            G = inverse(B) if made.mount == "hand" else B
            return project(camera, transform(inverse(X) @ G @ Y, points[index])).ravel()

        columns = []
        for which in range(3):
            for step in steps:
                ends = []
                for sign in (1.0, -1.0):
                    given = np.zeros((3, 6))
                    given[which] = sign * step
                    ends.append(pixels(given))
                columns.append((ends[0] - ends[1]) / (2.0 * step.max()))
        J = np.array(columns).T
        scatter = (J[:, 12:] * scale**2) @ J[:, 12:].T + corner_px**2 * np.eye(len(J))
        information += J[:, :12].T @ np.linalg.solve(scatter, J[:, :12])
    return np.linalg.inv(information)[:6, :6]


def written(T_base_flange, reading: Reading) -> np.ndarray:
    """Poses as a robot writes them, by SciPy."""
    T = inverses(T_base_flange) if reading.inverse else T_base_flange.copy()
    T[:, :3, 3] /= 1000.0 if reading.length == "m" else 1.0
    turn, degrees = Rotation.from_matrix(T[:, :3, :3]), reading.angle == "deg"
    kind = reading.rotation
    if kind in ("rows", "columns"):
        return (T if kind == "rows" else np.swapaxes(T, 1, 2)).reshape(-1, 16)
    if kind == "vector":
        part = turn.as_rotvec(degrees=degrees)
    elif kind in ("wxyz", "xyzw"):
        part = np.roll(turn.as_quat(), kind == "wxyz", axis=1)
    else:
        axes = "xyz" if kind == "fixed-xyz" else kind.upper()
        part = turn.as_euler(axes, degrees=degrees)
    return np.hstack((T[:, :3, 3], part))
