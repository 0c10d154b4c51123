"""Corners of a board in a photograph: found by OpenCV, then measured to hundredths of a pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.rig.calibration.board import Board
from fringeworks.rig.calibration.board_view import MIN_CORNERS, BoardView, eight_bit, flattened
from fringeworks.rig.calibration.chessboard import chessboard_view
from fringeworks.rig.calibration.circles import circles_view
from fringeworks.rig.calibration.outliers import mapped, off_board
from fringeworks.rig.calibration.saddle import CORNER_WINDOW, MIN_CONTRAST, fit_saddles
from fringeworks.types import BoardNotFound, FloatMap, InputError, unmasked
from fringeworks.types.packages import cv2, need_opencv

MARKER_GAP = 0.4
"""Half side of the window around a ChArUco corner, over the two white margins beside a marker taken
together. The window so ends at 0.8 of one margin, before the blurred edge of the marker."""


def find_board(image: NDArray[Any], board: Board) -> BoardView:
    """Find the corners of a board in a photograph.

    Parameters
    ----------
    image : (h, w) array, integer or float
        Grey photograph of the board, counts; the light may be uneven.
    board : Board

    Returns
    -------
    BoardView; corners that something hides are missing.

    Raises
    ------
    InputError where the board is not found, or another board is found; it says which.

    Notes
    -----
    OpenCV finds chessboards in part, ChArUco boards and grids of circles. Then a blurred crossing
    of edges is fitted to every corner (``fit_saddles``), and circles are measured by their centres
    of gravity (theory §8). On the virtual rig corners are exact to 0.004 px, circles to 0.007 px
    after perspective is corrected.
    """
    need_opencv("finding a board")
    photograph = unmasked(image, "image")
    if photograph.ndim != 2 or photograph.dtype.kind not in "uif":
        raise InputError(f"image: expected a grey (h, w) array, got shape {photograph.shape}")
    if board.kind == "chessboard":
        return chessboard_view(photograph, board)
    if board.kind == "charuco":
        return _charuco(photograph, board)
    return circles_view(photograph, board)


def refit(
    image: NDArray[Any], board: Board, view: BoardView, edges: FloatMap, bends: FloatMap
) -> BoardView:
    """Fit the corners of a chessboard or ChArUco board again, with edges bent by lens distortion.

    Parameters
    ----------
    image : (h, w) array
        As for ``find_board``.
    board : Board
    view : BoardView
        The corners as they were found.
    edges : (m, 2, 2) array
        Vectors from each corner to its neighbours along the board's x and y, px.
    bends : (m, 2) array
        Half the curvature of each edge, 1/px; see ``fit_saddles``.

    Returns
    -------
    BoardView with the same corners; one that cannot be fitted keeps its place.
    """
    saddles = fit_saddles(
        image.astype(np.float64), view.pixels, edges, window=_window(board), bends=bends
    )
    pixels = np.where(saddles.good[:, None], saddles.pixels, view.pixels)
    return BoardView(view.index, pixels, blur_px=saddles.blur_px)


def _window(board: Board) -> float:
    """Half side of the fitted square, in squares: on a ChArUco board it ends before the markers."""
    if board.kind != "charuco":
        return CORNER_WINDOW
    return min(MARKER_GAP * (1.0 - (board.marker_mm or 0.0) / board.pitch_mm), CORNER_WINDOW)


def _charuco(image: NDArray[Any], board: Board) -> BoardView:
    """Find the corners of a ChArUco board between its markers, and fit them."""
    detector = cv2.aruco.CharucoDetector(board.aruco)
    # Markers are lost now and then where the light is made even, and elsewhere where it is not.
    found = [detector.detectBoard(grey) for grey in (flattened(image), eight_bit(image))]
    corners, index, _, markers = max(found, key=lambda f: 0 if f[1] is None else len(f[1]))
    if index is None or len(index) < MIN_CORNERS:
        corner_count = 0 if index is None else len(index)
        marker_count = 0 if markers is None else len(markers)
        raise BoardNotFound(
            f"expected {MIN_CORNERS} corners of a ChArUco board or more, found {corner_count} with "
            f"{marker_count} markers of {board.dictionary}"
        )
    index, start = index.ravel(), corners.reshape(-1, 2).astype(np.float64)
    edges = _edges_on_board(board.points_mm[index, :2], start, board.pitch_mm)
    saddles = fit_saddles(image.astype(np.float64), start, edges, window=_window(board))
    contrast = np.abs(saddles.contrast)
    good = saddles.good & (contrast > MIN_CONTRAST * np.median(contrast))
    if good.sum() < MIN_CORNERS:
        raise BoardNotFound(f"expected {MIN_CORNERS} sharp corners or more, found {good.sum()}")
    wrong = off_board(board.points_mm[index[good], :2] / board.pitch_mm, saddles.pixels[good])
    pixels, blur = saddles.pixels[good][~wrong], saddles.blur_px[good][~wrong]
    return BoardView(index[good][~wrong], pixels, blur_px=blur)


def _edges_on_board(points_mm: FloatMap, pixels: FloatMap, pitch_mm: float) -> FloatMap:
    """Vectors from corners to their neighbours along the board's x and y, (m, 2, 2), px.

    From the homography between the board and the image, good enough as a start.
    """
    homography = cv2.findHomography(points_mm, pixels)[0]
    if homography is None:
        raise BoardNotFound(
            "expected corners of a ChArUco board that span a plane, found all on one line"
        )
    H = np.asarray(homography, np.float64)
    return np.stack(
        [mapped(H, points_mm + step) - mapped(H, points_mm) for step in pitch_mm * np.eye(2)],
        axis=1,
    )
