"""Where a board's corners are in a photograph: found by OpenCV, hidden ones left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringeworks.rig.calibration.board import Board
from fringeworks.rig.calibration.saddle import WINDOW, fit_saddles
from fringeworks.types import FloatMap, InputError

STARTS = ((5, 5), (3, 3), (4, 4), (4, 3))
"""Least parts of a chessboard that are looked for."""
MARKER_GAP = 0.4
"""Half side of the window around a ChArUco corner, over the gaps beside a marker (each is half
of what the marker leaves of its field)."""
LEAST = 8
"""Corners below which a view is not used: a pose and a check need that many."""
CONTRAST = 0.5
"""A corner's four fields must differ by this share of what is usual on the board."""
WORST_FIT = 0.25
"""What a fitted corner may leave, over its amplitude."""


@dataclass(frozen=True, eq=False)
class BoardView:
    """Corners of a board that a photograph shows."""

    index: NDArray[np.intp]
    """Which of the board's points, (m,)."""
    pixels: FloatMap
    """Where they are, (m, 2), camera px."""
    ink_px: FloatMap | None = None
    """Of circles: their areas, (m,), px²."""


def find_board(image: NDArray[Any], board: Board) -> BoardView:
    """Find a board.

    Parameters
    ----------
    image : (h, w) array
        Grey picture of the board, evenly lit or not.
    board : Board

    Returns
    -------
    BoardView; corners that something hides are left out.

    Raises
    ------
    InputError where the board is not found, or another one is: says what was seen.
    """
    picture = np.asarray(image)
    if picture.ndim != 2 or picture.dtype.kind not in "uif":
        raise InputError(f"image: expected a grey (h, w) array, got shape {picture.shape}")
    if board.kind == "chessboard":
        return _chessboard(picture, board)
    if board.kind == "charuco":
        return _charuco(picture, board)
    return _circles(picture, board)


def refit(
    image: NDArray[Any], board: Board, view: BoardView, edges: FloatMap, bends: FloatMap
) -> BoardView:
    """The corners of a chessboard or ChArUco board again, with edges as a lens bends them.

    Parameters
    ----------
    image : (h, w) array, as for ``find_board``
    edges : (m, 2, 2) array
        Vectors from each corner to its neighbours along the board's x and y, px.
    bends : (m, 2) array
        See ``fit_saddles``.
    """
    fitted = fit_saddles(
        image.astype(np.float64), view.pixels, edges, window=_window(board), bends=bends
    )
    pixels = np.where(fitted.good[:, None], fitted.pixels, view.pixels)
    return BoardView(view.index, pixels)


def _window(board: Board) -> float:
    """Half side of the fitted square: on a ChArUco board it ends before the markers."""
    if board.kind != "charuco":
        return WINDOW
    return min(MARKER_GAP * (1.0 - (board.marker_mm or 0.0) / board.pitch_mm), WINDOW)


def _even(image: NDArray[Any]) -> NDArray[np.uint8]:
    """The image in 8 bits, bright and dim parts alike: divided by the brightness around."""
    values = np.nan_to_num(image.astype(np.float32))
    values -= values.min()
    size = max(31, (max(image.shape) // 12) | 1)
    # White paper around a place, wherever some is near.
    small = cv2.resize(values, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size // 4, size // 4))
    paper = cv2.GaussianBlur(cv2.dilate(small, kernel), (0, 0), size / 4.0)
    paper = cv2.resize(paper, values.shape[::-1], interpolation=cv2.INTER_LINEAR)
    floor = 0.02 * float(paper.max()) + 1e-6
    return np.minimum(values / np.maximum(paper, floor) * 230.0, 255.0).astype(np.uint8)


def _chessboard(image: NDArray[Any], board: Board) -> BoardView:
    """OpenCV finds a part of the lattice; it is grown over what is hidden, and each corner fitted.

    OpenCV's detector stops at a hidden corner and at a board of another size; grown from any part,
    the lattice tells what is there.
    """
    grey = _even(image)
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_LARGER | cv2.CALIB_CB_EXHAUSTIVE
    best: _Lattice | None = None
    for size in STARTS:
        found, corners, meta = cv2.findChessboardCornersSBWithMeta(grey, size, flags)
        if not found:
            continue
        part = np.asarray(corners, np.float64).reshape(*meta.shape, 2)
        lattice = _Lattice(grey.astype(np.float64), part)
        lattice.grow()
        # Where something hides corners, a start may be askew: the one that explains most is right.
        if best is None or len(lattice.at) > len(best.at):
            best = lattice
        if best.complete(board):
            break
    if best is None:
        raise InputError(
            f"expected a chessboard of {board.columns} × {board.rows} inner corners, found none"
        )
    return best.placed(image.astype(np.float64), board)


class _Lattice:
    """Corners of a chessboard by column and row, as they are found."""

    def __init__(self, image: FloatMap, corners: FloatMap) -> None:
        self.image = image
        rows, columns = corners.shape[:2]
        keys = [(i, j) for j in range(rows) for i in range(columns)]
        self.at: dict[tuple[int, int], FloatMap] = dict(
            zip(keys, corners.reshape(-1, 2).astype(np.float64), strict=True)
        )
        self.contrast = 0.0
        self._keep(keys)

    def grow(self) -> None:
        """Add what continues the lattice and looks like a corner, until there is nothing more."""
        tried: dict[tuple[int, int], FloatMap] = {}
        while True:
            new = []
            for key in self._rim():
                guess = self._guess(key)
                before = tried.get(key)
                if before is None or np.hypot(*(guess - before)) > 1.0:
                    tried[key] = self.at[key] = guess
                    new.append(key)
            if not new or not self._keep(new):
                return

    def _rim(self) -> list[tuple[int, int]]:
        """Empty places with two known corners in a line beside them, or one place further on."""
        places = set()
        for i, j in self.at:
            for di, dj in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                if (i - di, j - dj) in self.at:
                    places |= {(i + di, j + dj), (i + 2 * di, j + 2 * dj)}
        return sorted(p for p in places if p not in self.at)

    def _guess(self, key: tuple[int, int]) -> FloatMap:
        """Where a corner should be: what lies on both sides of it, or the line going on."""
        i, j = key
        guesses = []
        for di, dj in ((1, 0), (0, 1)):
            around = [self.at.get((i + k * di, j + k * dj)) for k in (-3, -2, -1, 1, 2, 3)]
            if around[2] is not None and around[3] is not None:
                return np.asarray(0.5 * (around[2] + around[3]))
            for a, b, c in (around[2::-1], around[3:]):
                if a is not None and b is not None:
                    guesses.append(2.0 * a - b if c is None else 3.0 * a - 3.0 * b + c)
                elif b is not None and c is not None:
                    guesses.append(3.0 * b - 2.0 * c)
        return np.asarray(np.mean(guesses, axis=0))

    def _edges(self, key: tuple[int, int]) -> FloatMap:
        """Vectors to the next corner along rows and columns, (2, 2), from the nearest there are."""
        i, j = key
        edges = []
        for di, dj in ((1, 0), (0, 1)):
            best: tuple[float, FloatMap] | None = None
            for (a, b), place in self.at.items():
                other = self.at.get((a + di, b + dj))
                off = np.hypot(a - i + 0.5 * di, b - j + 0.5 * dj)
                if other is not None and (best is None or off < best[0]):
                    best = (float(off), other - place)
            edges.append(np.full(2, np.nan) if best is None else best[1])
        return np.stack(edges)

    def _keep(self, keys: list[tuple[int, int]]) -> int:
        """Fit the corners at these places; forget those that are none. Returns how many stay."""
        edges = np.stack([self._edges(key) for key in keys])
        start = np.stack([self.at[key] for key in keys])
        found = fit_saddles(self.image, start, np.nan_to_num(edges, nan=1.0))
        signs = np.array([1.0 - 2.0 * ((i + j) % 2) for i, j in keys])
        if not self.contrast:
            self.contrast = float(np.median(found.contrast * signs))
        share = found.contrast * signs / self.contrast
        good = found.good & (share > CONTRAST)
        good &= found.residual < np.abs(found.contrast) * WORST_FIT
        for key, place, right in zip(keys, found.pixels, good, strict=True):
            if right:
                self.at[key] = place
            else:
                del self.at[key]
        return int(good.sum())

    def complete(self, board: Board) -> bool:
        """Whether all of the board's corners are here, and no others."""
        across, down = board.grid
        return len(self.at) == across * down and self._size() in ((across, down), (down, across))

    def _size(self) -> tuple[int, int]:
        places = np.array(list(self.at)).reshape(-1, 2)
        columns, rows = np.ptp(places, axis=0) + 1 if len(places) else (0, 0)
        return int(columns), int(rows)

    def placed(self, image: FloatMap, board: Board) -> BoardView:
        """The corners as the board's, fitted in the image itself."""
        if len(self.at) < LEAST:
            raise InputError(f"expected {LEAST} corners or more, found {len(self.at)}")
        keys = list(self.at)
        places = np.array(keys)
        places -= places.min(axis=0)
        size = self._size()
        across, down = board.grid
        if size not in ((across, down), (down, across)):
            raise InputError(
                f"expected {across} × {down} inner corners, found {size[0]} × {size[1]}"
            )
        edges = np.stack([self._edges(key) for key in keys])
        start = np.stack([self.at[key] for key in keys])
        fitted = fit_saddles(image, start, edges)
        pixels = np.where(fitted.good[:, None], fitted.pixels, start)
        places = _turned(places, size, pixels, fitted.contrast, board)
        order = np.argsort(index := places[:, 1] * across + places[:, 0])
        return BoardView(index[order], pixels[order])


def _turned(
    places: NDArray[np.int_],
    size: tuple[int, int],
    pixels: FloatMap,
    contrast: FloatMap,
    board: Board,
) -> NDArray[np.int_]:
    """Columns and rows of the lattice as the board counts them, seen from its front."""
    turns = []
    for swap in (False, True):
        for flip_i in (False, True):
            for flip_j in (False, True):
                i, j = places.T
                i = size[0] - 1 - i if flip_i else i
                j = size[1] - 1 - j if flip_j else j
                turned = np.column_stack((j, i) if swap else (i, j))
                extent = size[::-1] if swap else size
                x, y, _ = np.linalg.lstsq(
                    np.column_stack((turned, np.ones(len(turned)))), pixels, rcond=None
                )[0]
                if extent != board.grid or x[0] * y[1] - x[1] * y[0] <= 0:
                    continue
                # A flip turns the edges that the contrast's sign refers to. The field after the
                # first corner is dark; where colours cannot tell, that corner is up and left.
                signs = (1.0 - 2.0 * (turned.sum(axis=1) % 2)) * (-1.0) ** (flip_i + flip_j)
                turns.append((float(np.sum(signs * contrast)) < 0, -(x[0] + y[1]), turned))
    return np.asarray(min(turns, key=lambda t: t[:2])[2])


def _charuco(image: NDArray[Any], board: Board) -> BoardView:
    grey = _even(image)
    detector = cv2.aruco.CharucoDetector(board.aruco)
    corners, index, _, markers = detector.detectBoard(grey)
    if index is None or len(index) < LEAST:
        found = 0 if index is None else len(index)
        seen = 0 if markers is None else len(markers)
        raise InputError(
            f"expected {LEAST} corners of a ChArUco board or more, found {found} with {seen} "
            f"markers of {board.dictionary}"
        )
    index, start = index.ravel(), corners.reshape(-1, 2).astype(np.float64)
    # Edges of the fields lie along the board's axes.
    ideal = board.points_mm[index, :2]
    found_map = cv2.findHomography(ideal, start)[0]
    if found_map is None:
        raise InputError("expected corners of a ChArUco board, found some in one line")
    map_ = np.asarray(found_map, np.float64)
    edges = np.stack(
        [_moved(map_, ideal + step) - _moved(map_, ideal) for step in board.pitch_mm * np.eye(2)],
        axis=1,
    )
    fitted = fit_saddles(image.astype(np.float64), start, edges, window=_window(board))
    good = fitted.good & (np.abs(fitted.contrast) > CONTRAST * np.median(np.abs(fitted.contrast)))
    if good.sum() < LEAST:
        raise InputError(f"expected {LEAST} sharp corners or more, found {good.sum()}")
    return BoardView(index[good], fitted.pixels[good])


def _moved(homography: FloatMap, points: FloatMap) -> FloatMap:
    mapped = np.column_stack((points, np.ones(len(points)))) @ homography.T
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


def _circles(image: NDArray[Any], board: Board) -> BoardView:
    symmetric = board.kind == "circles"
    flag = cv2.CALIB_CB_SYMMETRIC_GRID if symmetric else cv2.CALIB_CB_ASYMMETRIC_GRID
    parameters = cv2.SimpleBlobDetector.Params()
    parameters.maxArea = image.size / (4.0 * board.columns * board.rows)
    parameters.minArea = 20.0
    detector = cv2.SimpleBlobDetector.create(parameters)
    grey = _even(image)
    for more in (0, cv2.CALIB_CB_CLUSTERING):
        found, centres = cv2.findCirclesGrid(
            grey, board.grid, flags=flag | more, blobDetector=detector
        )
        if found:
            break
    else:
        raise InputError(f"expected {board.columns} × {board.rows} circles, found no such grid")
    return _centroids(image.astype(np.float64), np.asarray(centres, np.float64).reshape(-1, 2))


def _centroids(image: FloatMap, start: FloatMap) -> BoardView:
    """Centres of gravity of the ink: blur does not move them, nor does uneven light."""
    distance = np.linalg.norm(start[:, None] - start[None], axis=2)
    distance[np.diag_indices(len(start))] = np.inf
    # Half way to the neighbours, so that none comes in.
    half = int(max(3, 0.48 * np.median(distance.min(axis=1))))
    dy, dx = np.mgrid[-half : half + 1, -half : half + 1]
    disc = np.hypot(dx, dy) <= half
    pixels, ink = np.full(start.shape, np.nan), np.zeros(len(start))
    for k, centre in enumerate(np.rint(start).astype(int)):
        top, left = centre[1] - half, centre[0] - half
        part = image[max(top, 0) : top + 2 * half + 1, max(left, 0) : left + 2 * half + 1]
        if part.shape != disc.shape:
            continue
        # Paper is what is brighter than the middle of both; its light may be uneven.
        paper = disc & (part > 0.5 * (np.percentile(part, 5) + np.percentile(part, 95)))
        paper = ndimage.binary_erosion(paper, iterations=1, border_value=1) & disc
        design = np.stack((np.ones_like(dx), dx, dy), axis=-1).astype(np.float64)
        if paper.sum() < 20:
            continue
        light = design @ np.linalg.lstsq(design[paper], part[paper], rcond=None)[0]
        dark = np.where(disc, 1.0 - part / np.maximum(light, 1e-6), 0.0)
        full = np.percentile(dark[disc], 97)
        dark[paper & (np.abs(dark) < 0.5)] = 0.0
        pixels[k] = centre + np.array([np.sum(dark * dx), np.sum(dark * dy)]) / dark.sum()
        ink[k] = dark.sum() / max(full, 1e-6)
    good = np.isfinite(pixels).all(axis=1) & (np.linalg.norm(pixels - start, axis=1) < 0.2 * half)
    if good.sum() < LEAST:
        raise InputError(f"expected {LEAST} circles or more inside the image, found {good.sum()}")
    index = np.flatnonzero(good)
    return BoardView(index, pixels[good], ink_px=ink[good])
