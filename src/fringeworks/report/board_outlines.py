"""Outlines of a board's black and white parts in mm, for drawing it exactly."""

from __future__ import annotations

import numpy as np

from fringeworks.report.drawing import Affine2D, Outline
from fringeworks.rig.calibration.board import ASYMMETRIC_CIRCLE_RADIUS, CIRCLE_RADIUS, Board
from fringeworks.types import BoolMap, FloatMap
from fringeworks.types.packages import cv2

MARKER_BORDER = 1
"""Width of the black border of an ArUco marker, in cells: the value that OpenCV's detector expects
unless it is told another one."""

Node = tuple[int, int]
"""A corner of cells: column and row."""


def board_ink(board: Board) -> Outline:
    """Return the outline of everything that is black on a board.

    Parameters
    ----------
    board : Board

    Returns
    -------
    matplotlib Path in the board's coordinates, mm; x runs right and y down. Neighbouring black
    cells share one outline, so that a viewer that smooths edges shows no gaps between them.
    """
    if board.kind == "chessboard":
        rows, columns = np.mgrid[: board.rows + 1, : board.columns + 1]
        squares = cells_outline((rows + columns) % 2 == 0)
        return _placed(squares, board.pitch_mm, (-board.pitch_mm, -board.pitch_mm))
    if board.kind == "charuco":
        return _charuco_ink(board)
    radius = ASYMMETRIC_CIRCLE_RADIUS if board.kind == "asymmetric-circles" else CIRCLE_RADIUS
    return Outline.make_compound_path(
        *(Outline.circle((x, y), radius * board.pitch_mm) for x, y, _ in board.points_mm)
    )


def cells_outline(black: BoolMap) -> Outline:
    """Return the outline of the black cells of a grid of squares with a side of 1.

    Parameters
    ----------
    black : (h, w) bool array

    Returns
    -------
    matplotlib Path of closed polygons. Cells that touch at a corner only are separate polygons.
    Outer edges and edges of holes run in opposite directions, so every fill rule gives the same.
    """
    after = _edges(black)
    polygons = []
    while after:
        start = min(after)
        corners = _follow(after, start)
        vertices = np.array([*corners, corners[0]], np.float64)
        codes = [Outline.MOVETO] + [Outline.LINETO] * (len(corners) - 1) + [Outline.CLOSEPOLY]
        polygons.append(Outline(vertices, codes))
    return Outline.make_compound_path(*polygons)


def _edges(black: BoolMap) -> dict[Node, list[Node]]:
    """Edges between black and white cells: each start with its ends, the black on the right."""
    padded = np.pad(np.asarray(black, bool), 1)
    after: dict[Node, list[Node]] = {}
    for row, column in np.argwhere(padded):
        x, y = int(column) - 1, int(row) - 1
        for neighbour, start, end in (
            ((row - 1, column), (x, y), (x + 1, y)),
            ((row, column + 1), (x + 1, y), (x + 1, y + 1)),
            ((row + 1, column), (x + 1, y + 1), (x, y + 1)),
            ((row, column - 1), (x, y + 1), (x, y)),
        ):
            if not padded[neighbour]:
                after.setdefault(start, []).append(end)
    return after


def _follow(after: dict[Node, list[Node]], start: Node) -> list[Node]:
    """Take one closed polygon out of the edges; return its corners without those on a line."""
    corners = [start]
    here, heading = start, (0, 0)
    while True:
        ends = after[here]
        # Where two cells touch at a corner, turning right stays on the same cell.
        right = (here[0] - heading[1], here[1] + heading[0])
        end = right if right in ends else ends[0]
        ends.remove(end)
        if not ends:
            del after[here]
        step = (end[0] - here[0], end[1] - here[1])
        if step != heading and here != start:
            corners.append(here)
        if end == start:
            return corners
        here, heading = end, step


def _charuco_ink(board: Board) -> Outline:
    """Black squares and markers of a ChArUco board, as OpenCV places them."""
    dictionary = board.aruco.getDictionary()
    cells = dictionary.markerSize + 2 * MARKER_BORDER
    side = (board.marker_mm or 0.0) / cells
    black = np.ones((board.rows, board.columns), bool)
    markers = []
    for number, corners in zip(board.aruco.getIds().ravel(), _marker_corners(board), strict=True):
        column, row = np.floor(corners.mean(axis=0) / board.pitch_mm).astype(int)
        black[row, column] = False
        bits = cv2.aruco.generateImageMarker(
            dictionary, int(number), cells, borderBits=MARKER_BORDER
        )
        # The board's own numbers are float32, so the place is computed from the square.
        margin = 0.5 * (board.pitch_mm - (board.marker_mm or 0.0))
        place = (column * board.pitch_mm + margin, row * board.pitch_mm + margin)
        markers.append(_placed(cells_outline(bits == 0), side, place))
    squares = _placed(cells_outline(black), board.pitch_mm, (0.0, 0.0))
    return Outline.make_compound_path(squares, *markers)


def _marker_corners(board: Board) -> FloatMap:
    """Corners of a ChArUco board's markers, (n, 4, 2), mm."""
    return np.asarray(board.aruco.getObjPoints(), np.float64)[..., :2]


def _placed(outline: Outline, scale: float, offset: tuple[float, float]) -> Outline:
    return outline.transformed(Affine2D().scale(scale).translate(*offset))
