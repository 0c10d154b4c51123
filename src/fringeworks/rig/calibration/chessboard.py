"""Corners of a chessboard: a part is found by OpenCV, then the lattice is grown and fitted."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.rig.calibration.board import Board
from fringeworks.rig.calibration.board_view import MIN_CORNERS, BoardView, flattened
from fringeworks.rig.calibration.outliers import off_board
from fringeworks.rig.calibration.saddle import MIN_CONTRAST, fit_saddles
from fringeworks.types import BoardNotFound, FloatMap
from fringeworks.types.packages import cv2

PART_SIZES = ((5, 5), (3, 3), (4, 4), (4, 3))
"""Sizes of the part of a chessboard that OpenCV looks for, columns and rows, in the order in which
they are tried. A large part is unlikely to be anything else; smaller ones fit between hidden
corners."""
MAX_FIT_RESIDUAL = 0.25
"""Largest root mean square residual of a fitted corner, relative to its amplitude. On the
virtual rig corners have 3 %, and three quarters of all other places more than 45 %. Empirical."""
FAINT_CONTRAST = 0.1
"""Smallest contrast of corners that are missing on a board, relative to the usual contrast: the
light of a room is a tenth of the projector's. Empirical."""
NEARLY_ALL = 0.9
"""Share of a board's corners that is enough to search no further where OpenCV saw the whole board:
the others are hidden."""
RETRY_PX = 1.0
"""How far a new guess of a corner must lie from the one that failed for another trial, px. The fit
converges from a quarter of a square, so a nearer guess would fail again."""
MIN_LINE_CORNERS = 3
"""Smallest number of corners of an outermost column or row of a lattice, unless the lattice has the
board's size: no board has fewer. A single corner is never a line."""
FULL_LINE = 0.75
"""Share of a line's places beyond a complete board from which on the line belongs to a larger
board. The outer squares' own corners, on coarse photographs with JPEG, fill up to half of a line;
a larger board shows nearly all of its next line. Empirical."""

MAX_STEP = 0.5
"""Largest change of brightness across an edge alone, relative to the crossing, at a corner: halfway
between 0, where four squares meet, and 1, where the outer squares end."""

Place = tuple[int, int]
"""Column and row of a corner in the lattice, counted from the part that was found first."""


def chessboard_view(image: NDArray[Any], board: Board) -> BoardView:
    """Find the corners of a chessboard.

    OpenCV's detector stops at a hidden corner and does not say how large another board is. It
    only finds a part here, and the lattice is grown from it over all corners that are visible.

    Raises
    ------
    InputError where no chessboard is found, or one of another size.
    """
    grey = flattened(image)
    best: _Lattice | None = None
    for part in _parts(grey, board):
        lattice = _Lattice(grey.astype(np.float64), part)
        lattice.extend(board)
        # Something else in the photograph may look like a part of a chessboard, and a hidden corner
        # can distort a part; the largest lattice of the board's size comes from a good one.
        if best is None or lattice.rank(board) > best.rank(board):
            best = lattice
        if best.is_nearly_complete(board):
            break
    if best is None:
        raise BoardNotFound(
            f"expected a chessboard of {board.columns} × {board.rows} inner corners, found none"
        )
    return best.as_view(image.astype(np.float64), board)


def _parts(grey: NDArray[np.uint8], board: Board) -> Iterator[FloatMap]:
    """Boards and parts of boards that OpenCV finds, (rows, columns, 2), px, the likeliest first."""
    exact = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
    for size in (board.grid, *PART_SIZES):
        flags = exact if size == board.grid else exact | cv2.CALIB_CB_LARGER
        found, corners, meta = cv2.findChessboardCornersSBWithMeta(grey, size, flags)
        if found:
            yield np.asarray(corners, np.float64).reshape(*meta.shape, 2)
    # The older detector finds complete boards in clutter, where parts may lie beside the board.
    # The older detector: its defaults, and a quick end where nothing is seen.
    old = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    found, corners = cv2.findChessboardCorners(grey, board.grid, flags=old)
    if found:
        yield np.asarray(corners, np.float64).reshape(*board.grid[::-1], 2)


class _Lattice:
    """Corners of a chessboard by column and row, as far as they have been found."""

    def __init__(self, image: FloatMap, corners: FloatMap) -> None:
        self.image = image
        rows, columns = corners.shape[:2]
        places = [(i, j) for j in range(rows) for i in range(columns)]
        self.corners: dict[Place, FloatMap] = dict(
            zip(places, corners.reshape(-1, 2).astype(np.float64), strict=True)
        )
        self.usual_contrast = 0.0
        self.part: Place = (columns, rows)
        self.whole = False
        self._fit(places)

    def extend(self, board: Board) -> None:
        """Grow to all visible corners of the board, without wrong ones and its surroundings."""
        self.grow()
        if self.drop_wrong():
            self.grow()
            self.drop_wrong()
        if len(self.corners) < len(board.points_mm):
            # Beyond the edge of the projector's light, the rest of the board is faint.
            self.grow(FAINT_CONTRAST)
            self.drop_wrong()
        self.trim(board)

    def grow(self, least_contrast: float = MIN_CONTRAST) -> None:
        """Add corners next to the known ones until no more are found."""
        tried: dict[Place, FloatMap] = {}
        while True:
            new = []
            for place in self._empty_neighbours():
                guess = self._guess(place)
                before = tried.get(place)
                if before is None or np.hypot(*(guess - before)) > RETRY_PX:
                    tried[place] = self.corners[place] = guess
                    new.append(place)
            if not new or not self._fit(new, least_contrast):
                return

    def drop_wrong(self) -> int:
        """Drop corners that do not lie where the others say. Returns how many they are."""
        places = list(self.corners)
        if not places:
            return 0
        pixels = np.stack([self.corners[place] for place in places])
        wrong = off_board(np.array(places, np.float64), pixels)
        for place, is_wrong in zip(places, wrong, strict=True):
            if is_wrong:
                del self.corners[place]
        return int(wrong.sum())

    def rank(self, board: Board) -> tuple[bool, int]:
        """Whether the lattice has the size of the board, and how many corners: larger is better."""
        return self._has_size_of(board), len(self.corners)

    def trim(self, board: Board) -> None:
        """Drop false corners beyond the board: short outer lines, and what surrounds the board.

        The edge of the sheet, the edge of the projector's light, and things beside the board cross
        the lattice's lines now and then. A board that is larger than asked for is kept, because
        its outer lines are full.
        """
        across, down = board.grid
        if self.part in ((across, down), (down, across)):
            # OpenCV saw the whole board: a line of it that is too dark to be measured is missing.
            seen = {(i, j) for i in range(self.part[0]) for j in range(self.part[1])}
            if not self._continues(seen, self.part):
                self.corners = {p: c for p, c in self.corners.items() if p in seen}
                self.whole = True
                return
        # Where the size is right, a line of two corners is the rest of a hidden one.
        while self._drop_outer_lines(MIN_LINE_CORNERS - self._has_size_of(board)):
            pass
        for size in {(across, down), (down, across)}:
            window = self._complete_window(size)
            if window is not None:
                self.corners = {p: c for p, c in self.corners.items() if p in window}
                return

    def _drop_outer_lines(self, least: int) -> bool:
        """Drop outermost columns and rows with fewer corners; return whether there were any."""
        places = np.array(list(self.corners)).reshape(-1, 2)
        if not len(places):
            return False
        short = np.zeros(len(places), bool)
        for axis in (0, 1):
            for end in (places[:, axis].min(), places[:, axis].max()):
                line = places[:, axis] == end
                if line.sum() < least:
                    short |= line
        self.corners = {(int(i), int(j)): self.corners[i, j] for i, j in places[~short]}
        return bool(short.any())

    def _complete_window(self, size: Place) -> set[Place] | None:
        """Places of a complete board of a size; None where none or a larger board is there."""
        columns, rows = self._size()
        first = np.array(list(self.corners)).reshape(-1, 2).min(axis=0, initial=0)
        for di in range(columns - size[0] + 1):
            for dj in range(rows - size[1] + 1):
                i0, j0 = int(first[0]) + di, int(first[1]) + dj
                window = {(i0 + i, j0 + j) for i in range(size[0]) for j in range(size[1])}
                if window <= self.corners.keys() and not self._continues(window, size):
                    return window
        return None

    def _continues(self, window: set[Place], size: Place) -> bool:
        """Whether the lattice beyond a window has lines as full as those of a larger board."""
        outside = [p for p in self.corners if p not in window]
        for axis, length in ((0, size[1]), (1, size[0])):
            inside = {p[axis] for p in window}
            beyond = [p[axis] for p in outside if p[axis] not in inside]
            if any(beyond.count(k) > FULL_LINE * length for k in set(beyond)):
                return True
        return False

    def _empty_neighbours(self) -> list[Place]:
        """Empty places that continue a line of two corners, and those one place further on."""
        places = set()
        for i, j in self.corners:
            for di, dj in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                if (i - di, j - dj) in self.corners:
                    places |= {(i + di, j + dj), (i + 2 * di, j + 2 * dj)}
        return sorted(p for p in places if p not in self.corners)

    def _guess(self, place: Place) -> FloatMap:
        """Interpolate or extrapolate where the corner at a place should be, (2,), px."""
        i, j = place
        guesses = []
        for di, dj in ((1, 0), (0, 1)):
            line = [self.corners.get((i + k * di, j + k * dj)) for k in (-3, -2, -1, 1, 2, 3)]
            if line[2] is not None and line[3] is not None:
                return np.asarray(0.5 * (line[2] + line[3]))
            for first, second, third in (line[2::-1], line[3:]):
                if first is not None and second is not None:
                    guesses.append(
                        2.0 * first - second
                        if third is None
                        else 3.0 * first - 3.0 * second + third
                    )
                elif second is not None and third is not None:
                    guesses.append(3.0 * second - 2.0 * third)
        return np.asarray(np.mean(guesses, axis=0))

    def _edges(self, places: Iterable[Place]) -> FloatMap:
        """Vectors to the next corner along columns and rows, (n, 2, 2), px, from the nearest pairs.

        NaN where no two corners follow each other.
        """
        at = np.array(list(places), np.float64)
        edges = np.full((len(at), 2, 2), np.nan)
        for k, step in enumerate(np.eye(2, dtype=int)):
            pairs = [(p, (p[0] + step[0], p[1] + step[1])) for p in self.corners]
            pairs = [(first, second) for first, second in pairs if second in self.corners]
            if pairs:
                middle = np.array([first for first, _ in pairs]) + 0.5 * step
                vectors = np.array([self.corners[b] - self.corners[a] for a, b in pairs])
                apart = np.hypot(*np.moveaxis(middle - at[:, None], 2, 0))
                edges[:, k] = vectors[np.argmin(apart, axis=1)]
        return edges

    def _fit(self, places: list[Place], least_contrast: float = MIN_CONTRAST) -> int:
        """Fit the corners at these places and remove failed ones. Returns how many remain."""
        edges = self._edges(places)
        guesses = np.stack([self.corners[place] for place in places])
        saddles = fit_saddles(self.image, guesses, np.nan_to_num(edges, nan=1.0))
        # Light and dark squares alternate, and so does the sign of a corner's contrast.
        signs = np.array([1.0 - 2.0 * ((i + j) % 2) for i, j in places])
        if not self.usual_contrast:
            self.usual_contrast = float(np.median(saddles.contrast * signs))
        relative = saddles.contrast * signs / self.usual_contrast
        good = saddles.good & (relative > least_contrast)
        good &= saddles.residual < np.abs(saddles.contrast) * MAX_FIT_RESIDUAL
        good &= saddles.step < MAX_STEP
        for place, pixel, is_corner in zip(places, saddles.pixels, good, strict=True):
            if is_corner:
                self.corners[place] = pixel
            else:
                del self.corners[place]
        return int(good.sum())

    def is_nearly_complete(self, board: Board) -> bool:
        """Whether the lattice has all corners of the board, or most of a board that was seen whole.

        A smaller board beside other things can grow to nearly the same size, so no more is enough.
        """
        has_its_size, count = self.rank(board)
        enough = NEARLY_ALL if self.whole else 1.0
        return has_its_size and count >= enough * len(board.points_mm)

    def _has_size_of(self, board: Board) -> bool:
        """Whether the lattice has as many columns and rows as the board, either way round."""
        across, down = board.grid
        return self._size() in ((across, down), (down, across))

    def _size(self) -> tuple[int, int]:
        """Columns and rows of the whole board, or else those that the lattice spans."""
        if self.whole:
            return self.part
        places = np.array(list(self.corners)).reshape(-1, 2)
        columns, rows = np.ptp(places, axis=0) + 1 if len(places) else (0, 0)
        return int(columns), int(rows)

    def as_view(self, image: FloatMap, board: Board) -> BoardView:
        """Fit all corners in the image itself, and number them as the board does."""
        if len(self.corners) < MIN_CORNERS:
            raise BoardNotFound(
                f"expected {MIN_CORNERS} corners or more, found {len(self.corners)}"
            )
        across, down = board.grid
        size = self._size()
        if not self._has_size_of(board):
            raise BoardNotFound(
                f"expected {across} × {down} inner corners, found {size[0]} × {size[1]}"
            )
        places = list(self.corners)
        edges = self._edges(places)
        start = np.stack([self.corners[place] for place in places])
        saddles = fit_saddles(image, start, edges)
        pixels = np.where(saddles.good[:, None], saddles.pixels, start)
        from_zero = np.array(places)
        if not self.whole:
            from_zero -= from_zero.min(axis=0)
        numbered = _as_on_board(from_zero, size, pixels, saddles.contrast, board)
        index = numbered[:, 1] * across + numbered[:, 0]
        order = np.argsort(index)
        return BoardView(index[order], pixels[order], blur_px=saddles.blur_px[order])


def _as_on_board(
    places: NDArray[np.int_],
    size: tuple[int, int],
    pixels: FloatMap,
    contrast: FloatMap,
    board: Board,
) -> NDArray[np.int_]:
    """Turn columns and rows of the lattice into those of the board, seen from its front.

    Parameters
    ----------
    places : (m, 2) array, columns and rows from 0
    size : (columns, rows) of the lattice
    pixels : (m, 2) array, px
    contrast : (m,) array
        Of the fitted corners, see ``Saddles``.
    board : Board

    Returns
    -------
    (m, 2) array. Of the orientations with the board's size that are not mirrored, the one in which
    the square after the first corner is dark; where the colours do not decide (boards with two odd
    or two even counts), the one whose first corner is up and left in the image.
    """
    candidates = []
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
                mirrored = x[0] * y[1] - x[1] * y[0] <= 0
                if extent != board.grid or mirrored:
                    continue
                # The contrast's sign refers to the edges, which a flip turns round.
                signs = (1.0 - 2.0 * (turned.sum(axis=1) % 2)) * (-1.0) ** (flip_i + flip_j)
                wrong_colours = float(np.sum(signs * contrast)) < 0
                candidates.append((wrong_colours, -(x[0] + y[1]), turned))
    return np.asarray(min(candidates, key=lambda c: c[:2])[2])
