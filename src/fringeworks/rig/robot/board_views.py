"""The board before the camera in every view: its pose with covariance, from the corners alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fringeworks.rig.calibration.board import Board
from fringeworks.rig.calibration.board_view import MIN_CORNERS, BoardView
from fringeworks.rig.calibration.parameters import DEVICE_SIZE, POSE_SIZE, moved_pose
from fringeworks.rig.calibration.residuals import point_by_pose
from fringeworks.rig.calibration.start import first_pose_of
from fringeworks.rig.pinhole import pose, project_with_derivatives, rotation, skew, transform
from fringeworks.types import MOST_PX, BoolMap, FloatMap, Frozen, InputError, Pinhole, Rig
from fringeworks.types.packages import cv2

MAX_STEPS = 40
"""Largest number of Gauss–Newton steps for a pose; fewer than ten are usual."""
SETTLED = 1e-10
"""Step below which a pose has settled, rad and mm: far below what corners tell."""


@dataclass(frozen=True, eq=False, repr=False)
class SeenBoards(Frozen):
    """The board's poses before the camera, as n views show them.

    An error (ω, v) of a pose turns R into exp(ω) R and t into t + v, in camera coordinates.
    """

    T_camera_board: FloatMap
    """(n, 4, 4), mm."""
    covariance: FloatMap
    """(n, 6, 6) covariance of their errors by the scatter of the corners; rad, mm."""
    by_camera: FloatMap
    """(n, 6, k): errors by the k independent parts of the camera's covariance, of unit variance,
    which all views have in common; k is 0 where the camera's covariance is not known."""
    scatter_px: float
    """Standard deviation of a corner, per coordinate, px."""
    middle_mm: FloatMap
    """Mean of the board's corners, (3,), mm."""
    radius_mm: float
    """Root mean square distance of the corners from it, mm."""
    half_turn: bool = False
    """Whether the board looks the same after half a turn, so that views may differ by it."""

    def __len__(self) -> int:
        return len(self.T_camera_board)

    def at(self, kept: BoolMap) -> SeenBoards:
        """Some of the views."""
        return SeenBoards(
            self.T_camera_board[kept],
            self.covariance[kept],
            self.by_camera[kept],
            self.scatter_px,
            self.middle_mm,
            self.radius_mm,
            self.half_turn,
        )

    def turned(self, which: BoolMap) -> SeenBoards:
        """The views, some of them with the board turned by half a turn about its middle."""
        half = pose(np.diag([-1.0, -1.0, 1.0]), self.middle_mm * (2.0, 2.0, 0.0))
        moved = self.T_camera_board @ half
        # An error (ω, v) moves the other origin of the board by v + ω × R t.
        lever = np.tile(np.eye(6), (len(self), 1, 1))
        lever[:, 3:, :3] = -skew(moved[:, :3, 3] - self.T_camera_board[:, :3, 3])
        covariance = lever @ self.covariance @ np.swapaxes(lever, 1, 2)
        pick = which[:, None, None]
        return replace(
            self,
            T_camera_board=np.where(pick, moved, self.T_camera_board),
            covariance=np.where(pick, covariance, self.covariance),
            by_camera=np.where(pick, lever @ self.by_camera, self.by_camera),
        )


def seen_boards(
    views: Sequence[BoardView], board: Board, rig: Rig, names: Sequence[str]
) -> SeenBoards:
    """Fit the board's pose to the corners of every view.

    Parameters
    ----------
    views : sequence of BoardView
    board : Board
    rig : Rig
        Its camera, and the covariance of the camera's nine parameters.
    names : sequence of str
        One for each view, for messages.

    Raises
    ------
    InputError, with the name, for too few corners and for corners that are not of this board.

    Notes
    -----
    The scatter is estimated from the residuals of all views. A view whose own scatter is larger
    has its own.
    """
    fits = [_fitted(v, board, rig.camera, name) for v, name in zip(views, names, strict=True)]
    freedom = np.array([2 * len(v.index) - POSE_SIZE for v in views])
    squares = np.array([f.squares for f in fits])
    pooled = float(np.sum(squares) / np.sum(freedom))
    variance = np.maximum(squares / freedom, pooled)
    parts = _camera_parts(rig)
    points = board.points_mm
    middle = points.mean(axis=0)
    return SeenBoards(
        np.stack([f.T for f in fits]),
        np.stack([v * f.inverse_normal for v, f in zip(variance, fits, strict=True)]),
        np.stack([f.by_device @ parts for f in fits]),
        float(np.sqrt(pooled)),
        middle,
        float(np.sqrt(np.mean(np.sum((points - middle) ** 2, axis=1)))),
        _symmetric(board),
    )


def _symmetric(board: Board) -> bool:
    """Whether half a turn takes the printed pattern to itself.

    Colours of squares change sides with every row and column, and every other row of an asymmetric
    grid is shifted.
    """
    if board.kind == "chessboard":
        return (board.columns + board.rows) % 2 == 0
    return board.kind == "circles" or (board.kind == "asymmetric-circles" and board.rows % 2 == 0)


@dataclass(frozen=True, eq=False)
class _Fit:
    T: FloatMap
    inverse_normal: FloatMap
    by_device: FloatMap
    """Change of the pose by the camera's nine parameters, (6, 9)."""
    squares: float


def _fitted(view: BoardView, board: Board, camera: Pinhole, name: str) -> _Fit:
    """The pose of a board; of the two that a flat board seen from afar has, the one that fits."""
    index, pixels = np.asarray(view.index), np.asarray(view.pixels)
    real = pixels.dtype.kind in "fiu" and index.dtype.kind in "iu"
    if index.ndim != 1 or pixels.shape != (len(index), 2) or not real:
        raise InputError(
            f"{name}: expected numbers (m) and pixels (m, 2) of corners, got {index.dtype} "
            f"{index.shape} and {pixels.dtype} {pixels.shape}"
        )
    if len(index) < MIN_CORNERS:
        raise InputError(f"{name}: expected {MIN_CORNERS} corners or more, got {len(index)}")
    pixels = pixels.astype(np.float64)
    if not np.abs(pixels).max() < MOST_PX:
        raise InputError(f"{name}: expected corners in a frame, got some outside or not finite")
    if index.min() < 0 or index.max() >= len(board.points_mm):
        raise InputError(
            f"{name}: expected corners of a board of {len(board.points_mm)}, got number "
            f"{int(index.max())}"
        )
    points = board.points_mm[index]
    try:
        start = first_pose_of(points, pixels, camera)
        starts = (start, _tilted_otherwise(start, points))
        fits = [_refined(points, pixels, camera, T) for T in starts]
    except (cv2.error, np.linalg.LinAlgError):  # corners on a line, or in one place
        fits = []
    good = [f for f in fits if f is not None]
    if not good:
        raise InputError(f"{name}: expected corners that a pose of the board explains, got others")
    return min(good, key=lambda f: f.squares)


def _tilted_otherwise(T: FloatMap, points: FloatMap) -> FloatMap:
    """The pose whose normal is mirrored about the line of sight: nearly the same picture."""
    middle = transform(T, points.mean(axis=0))
    sight = middle / np.linalg.norm(middle)
    turned = rotation(np.pi * sight) @ T[:3, :3] @ np.diag([-1.0, -1.0, 1.0])
    return pose(turned, middle - turned @ points.mean(axis=0))


def _refined(points: FloatMap, pixels: FloatMap, camera: Pinhole, T: FloatMap) -> _Fit | None:
    """Least squares of the corners; None where the board comes behind the camera."""
    for _ in range(MAX_STEPS):
        turned = points @ T[:3, :3].T
        if not (turned[:, 2] + T[2, 3] > 0).all():
            return None
        predicted, by_point, by_device = project_with_derivatives(camera, turned + T[:3, 3])
        J = (by_point @ point_by_pose(turned)).reshape(-1, POSE_SIZE)
        r = (pixels - predicted).ravel()
        step = np.linalg.lstsq(J, r, rcond=None)[0]
        if not np.isfinite(step).all():
            return None
        T = moved_pose(T, step)
        if np.abs(step).max() < SETTLED:
            break
    inverse_normal = np.linalg.inv(J.T @ J)
    by_camera = -inverse_normal @ J.T @ by_device.reshape(-1, DEVICE_SIZE)
    return _Fit(T, inverse_normal, by_camera, float(r @ r))


def _camera_parts(rig: Rig) -> FloatMap:
    """Independent parts of the camera's covariance, (9, k)."""
    if rig.covariance is None:
        return np.zeros((DEVICE_SIZE, 0))
    own = rig.covariance[:DEVICE_SIZE, :DEVICE_SIZE]
    scale = np.sqrt(np.maximum(np.diag(own), 0.0))
    free = scale > 0
    correlation = own[np.ix_(free, free)] / np.outer(scale[free], scale[free])
    values, vectors = np.linalg.eigh(correlation)
    parts = np.zeros((DEVICE_SIZE, int(np.count_nonzero(free))))
    parts[free] = scale[free, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    return parts


def view_pose(view: BoardView, board: Board, camera: Pinhole, name: str = "view") -> FloatMap:
    """The board's pose before the camera, T_camera_board (4, 4), mm.

    Raises
    ------
    InputError, with the name, for too few corners and for corners that are not of this board.
    """
    return _fitted(view, board, camera, name).T
