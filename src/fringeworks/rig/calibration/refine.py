"""Corners measured again with a known rig: perspective and lens distortion taken into account."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.rig.calibration.board import Board
from fringeworks.rig.calibration.board_view import BoardView
from fringeworks.rig.calibration.corners import refit
from fringeworks.rig.pinhole import project, transform
from fringeworks.types import FloatMap, Pinhole

CURVATURE_REACH = 0.25
"""Distance from a corner at which the bend of its edges is computed, in squares. It lies inside
the window in which the corner is fitted (0.38 squares), where the bend matters."""
RING_POINTS = 48
"""Number of points on a circle's rim from which the centre of gravity of its image is computed. On
the standard rig it is off by 0.0003 px with 48 points, for a perspective shift of 0.1 px."""
DIFFERENCE_STEP = 0.01
"""Step of the finite differences for the area of a circle's image, in pitches: far below the size
of a circle, far above rounding."""


def refined_view(
    image: NDArray[Any], board: Board, view: BoardView, camera: Pinhole, T_camera_board: FloatMap
) -> BoardView:
    """Measure the corners of a board again, with the camera and the board's pose nearly known.

    Parameters
    ----------
    image : (h, w) array
        The photograph, counts.
    board : Board
    view : BoardView
        The corners as they were found.
    camera : Pinhole
        From a first calibration.
    T_camera_board : (4, 4) array, mm

    Returns
    -------
    BoardView with the same corners.

    Notes
    -----
    Corners of squares are fitted again with edges as bent as lens distortion bends them. Circles
    are moved from the centre of gravity of their image to the image of their centre: perspective
    and lens distortion separate the two (theory §8).
    """
    points = board.points_mm[view.index]
    if board.kind in ("circles", "asymmetric-circles"):
        pixels = view.pixels + _circle_shift(view, points, board, camera, T_camera_board)
        return replace(view, pixels=pixels)
    return refit(image, board, view, *_bent_edges(points, board, camera, T_camera_board))


def _bent_edges(
    points: FloatMap, board: Board, camera: Pinhole, T: FloatMap
) -> tuple[FloatMap, FloatMap]:
    """Edges (n, 2, 2), px, and half the curvature that lens distortion gives them, (n, 2), 1/px."""
    corner = project(camera, transform(T, points))
    edges, bends = [], []
    for step in CURVATURE_REACH * board.pitch_mm * np.eye(3)[:2]:
        ahead = project(camera, transform(T, points + step)) - corner
        behind = project(camera, transform(T, points - step)) - corner
        along = ahead - behind
        length = np.linalg.norm(along, axis=1, keepdims=True)
        normal = np.column_stack((-along[:, 1], along[:, 0])) / length
        edges.append(along / (2.0 * CURVATURE_REACH))
        bends.append(np.sum((ahead + behind) * normal, axis=1) / (0.5 * length[:, 0] ** 2))
    return np.stack(edges, axis=1), np.stack(bends, axis=1)


def _circle_shift(
    view: BoardView, points: FloatMap, board: Board, camera: Pinhole, T: FloatMap
) -> FloatMap:
    """From the centre of gravity of a circle's image to the image of its centre, (n, 2), px."""
    radius = _circle_radius_mm(view, points, board, camera, T)
    angle = np.linspace(0.0, 2.0 * np.pi, RING_POINTS, endpoint=False)
    ring = radius * np.column_stack((np.cos(angle), np.sin(angle), np.zeros(RING_POINTS)))
    rim = project(camera, transform(T, points[:, None] + ring))
    following = np.roll(rim, -1, axis=1)
    # Centre of gravity of a polygon (shoelace formula).
    wedge = rim[..., 0] * following[..., 1] - following[..., 0] * rim[..., 1]
    gravity = (
        np.sum((rim + following) * wedge[..., None], axis=1) / (3.0 * wedge.sum(axis=1))[:, None]
    )
    return np.asarray(project(camera, transform(T, points)) - gravity)


def _circle_radius_mm(
    view: BoardView, points: FloatMap, board: Board, camera: Pinhole, T: FloatMap
) -> float:
    """Radius of the printed circles, from the area of their images."""
    assert view.ink_px is not None
    steps = DIFFERENCE_STEP * board.pitch_mm * np.eye(3)[:2]
    (ax, ay), (bx, by) = (
        (
            project(camera, transform(T, points + step))
            - project(camera, transform(T, points - step))
        ).T
        for step in steps
    )
    px2_per_mm2 = np.abs(ax * by - ay * bx) / (2.0 * DIFFERENCE_STEP * board.pitch_mm) ** 2
    return float(np.median(np.sqrt(view.ink_px / (np.pi * px2_per_mm2))))
