"""Calibration boards: the positions of their corners in mm, and their printed pattern."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from fringeworks.types import FloatMap, InputError
from fringeworks.types.computed import cached_property
from fringeworks.types.packages import cv2, need_opencv

BoardKind = Literal["chessboard", "charuco", "circles", "asymmetric-circles"]
DICTIONARY = "4X4_250"
"""ArUco dictionary of a ChArUco board whose description gives no dictionary: 250 markers of 4 × 4
bits, enough for boards of up to 500 squares."""
BOARD_SYNTAX = (
    "chessboard:9x7:75, charuco:8x6:30:22[:dictionary][:legacy], circles:9x7:30 or "
    "asymmetric-circles:4x11:20"
)
PAPER_ALBEDO = 0.85
"""Reflectance of the white parts of a simulated board, 0…1: usual for matt white paper."""
INK_ALBEDO = 0.08
"""Reflectance of the black parts of a simulated board, 0…1: printer's ink is not quite black, so
fringes on black squares can still be decoded, as on a real board."""
PRINT_PX_PER_SQUARE = 48
"""Resolution of the image from which a simulated ChArUco board's pattern is read, px per square:
edges of markers are placed to 1/48 of a square, below a camera pixel in usual views. Empirical."""
SHEET_MARGIN = 1.5
"""Paper around the outermost corners or centres of circles, in pitches: one square, which the
pattern fills, and half a square of white around it."""
CIRCLE_RADIUS = 0.3
"""Radius of the printed circles of a symmetric grid, in pitches: large, and still well apart."""
ASYMMETRIC_CIRCLE_RADIUS = 0.5
"""Radius of the printed circles of an asymmetric grid, in pitches. Neighbours are √2 pitches
apart, so it fills them about as well as ``CIRCLE_RADIUS`` fills a symmetric grid."""
MIN_SQUARES = 2
"""Smallest number of squares across and down of a ChArUco board: OpenCV's limit."""
MIN_CORNERS_ACROSS = 3
"""Smallest number of inner corners or circles across and down on other boards. OpenCV refuses
chessboards below it; circle grids have the same limit for simplicity."""


@dataclass(frozen=True)
class Board:
    """A flat calibration board with a known pattern.

    Raises
    ------
    InputError for too few columns or rows, lengths that are not above 0, markers that do not fit
    into their squares, an unknown dictionary, and one with too few markers.
    """

    kind: BoardKind
    columns: int
    """Number of inner corners (chessboard), squares (ChArUco) or circles across."""
    rows: int
    """Number of inner corners, squares or circles down."""
    pitch_mm: float
    """Side of a square, or distance of neighbouring circles; > 0, mm. On an asymmetric grid: the
    distance of neighbouring rows, which is half the distance of circles within a row."""
    marker_mm: float | None = None
    """Side of a ChArUco board's markers, mm; None for other boards."""
    dictionary: str = DICTIONARY
    """Name of the ArUco dictionary, without DICT_; for ChArUco boards."""
    legacy: bool = False
    """True for a ChArUco board with the layout of OpenCV before 4.6."""

    def __post_init__(self) -> None:
        least = MIN_SQUARES if self.kind == "charuco" else MIN_CORNERS_ACROSS
        if self.columns < least or self.rows < least:
            raise InputError(
                f"board: expected {least} × {least} or more, got {self.columns} × {self.rows}"
            )
        if not (math.isfinite(self.pitch_mm) and self.pitch_mm > 0):
            raise InputError(f"board: expected a pitch > 0 mm, got {self.pitch_mm}")
        if self.kind == "charuco":
            if self.marker_mm is None or not 0 < self.marker_mm < self.pitch_mm:
                raise InputError(
                    f"board: expected markers smaller than the squares of {self.pitch_mm:g} mm, "
                    f"got {self.marker_mm}"
                )
            need_opencv("a ChArUco board")
            if not hasattr(cv2.aruco, f"DICT_{self.dictionary}"):
                raise InputError(
                    "board: expected the name of an ArUco dictionary such as "
                    f"{DICTIONARY}, got {self.dictionary!r}"
                )
            self._check_markers()

    def _check_markers(self) -> None:
        """Refuse a ChArUco board that needs more markers than its dictionary has."""
        needed = self.columns * self.rows // 2
        number = getattr(cv2.aruco, f"DICT_{self.dictionary}")
        known = len(cv2.aruco.getPredefinedDictionary(number).bytesList)
        if needed > known:
            raise InputError(
                f"board: expected at most {known} markers, as many as the dictionary "
                f"{self.dictionary} has, got {self.columns} × {self.rows} squares with {needed}"
            )

    @property
    def name(self) -> str:
        """The board's description as ``parse_board`` and ``calibrate --board`` read it."""
        text = f"{self.kind}:{self.columns}x{self.rows}:{_shortest(self.pitch_mm)}"
        if self.kind != "charuco":
            return text
        text += f":{_shortest(self.marker_mm or 0.0)}"
        if self.dictionary != DICTIONARY:
            text += f":{self.dictionary}"
        return f"{text}:legacy" if self.legacy else text

    @cached_property
    def aruco(self) -> Any:
        """The ChArUco board as an OpenCV object."""
        dictionary = cv2.aruco.getPredefinedDictionary(
            getattr(cv2.aruco, f"DICT_{self.dictionary}")
        )
        board = cv2.aruco.CharucoBoard(
            (self.columns, self.rows), self.pitch_mm, self.marker_mm or 0.0, dictionary
        )
        board.setLegacyPattern(self.legacy)
        return board

    @property
    def grid(self) -> tuple[int, int]:
        """Number of corners (or circles) across and down."""
        if self.kind == "charuco":
            return self.columns - 1, self.rows - 1
        return self.columns, self.rows

    @cached_property
    def points_mm(self) -> FloatMap:
        """Positions of the corners or circle centres, (n, 3), row by row, z = 0, mm."""
        across, down = self.grid
        j, i = (a.ravel().astype(np.float64) for a in np.mgrid[:down, :across])
        if self.kind == "asymmetric-circles":
            x, y = (2.0 * i + j % 2.0) * self.pitch_mm, j * self.pitch_mm
        elif self.kind == "charuco":
            x, y = (i + 1.0) * self.pitch_mm, (j + 1.0) * self.pitch_mm
        else:
            x, y = i * self.pitch_mm, j * self.pitch_mm
        return np.column_stack((x, y, np.zeros_like(x)))

    @cached_property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom edge of the sheet in the board's coordinates, mm."""
        across, down = self.grid
        first = 1.0 if self.kind == "charuco" else 0.0
        # Every other row of an asymmetric grid is shifted by one pitch.
        wide = 2 * (across - 1) + 1 if self.kind == "asymmetric-circles" else across - 1
        low, p = (first - SHEET_MARGIN) * self.pitch_mm, self.pitch_mm
        right = (first + wide + SHEET_MARGIN) * p
        return low, low, right, (first + down - 1 + SHEET_MARGIN) * p

    def albedo(self, x_mm: FloatMap, y_mm: FloatMap) -> FloatMap:
        """Return the reflectance at points of the board, 0…1.

        Parameters
        ----------
        x_mm, y_mm : arrays of one shape
            Positions in the board's coordinates, mm.
        """
        return PAPER_ALBEDO - (PAPER_ALBEDO - INK_ALBEDO) * self._ink(x_mm, y_mm)

    def _ink(self, x_mm: FloatMap, y_mm: FloatMap) -> FloatMap:
        """1 where the board is printed black, 0 where it is white paper."""
        if self.kind == "chessboard":
            return self._chessboard_ink(x_mm, y_mm)
        if self.kind == "charuco":
            return self._charuco_ink(x_mm, y_mm)
        return self._circle_ink(x_mm, y_mm)

    def _chessboard_ink(self, x_mm: FloatMap, y_mm: FloatMap) -> FloatMap:
        i, j = np.floor(x_mm / self.pitch_mm), np.floor(y_mm / self.pitch_mm)
        inside = (i >= -1) & (i < self.columns) & (j >= -1) & (j < self.rows)
        # Numbers are even if half of them is whole; remainders of floats take much longer.
        half = 0.5 * (i + j)
        return np.asarray(inside & (np.floor(half) == half), np.float64)

    def _charuco_ink(self, x_mm: FloatMap, y_mm: FloatMap) -> FloatMap:
        h, w = self._print.shape
        i = np.floor(x_mm * (PRINT_PX_PER_SQUARE / self.pitch_mm)).astype(np.int64)
        j = np.floor(y_mm * (PRINT_PX_PER_SQUARE / self.pitch_mm)).astype(np.int64)
        inside = (i >= 0) & (i < w) & (j >= 0) & (j < h)
        ink = self._print[np.clip(j, 0, h - 1), np.clip(i, 0, w - 1)]
        return np.where(inside, ink, 0.0)

    def _circle_ink(self, x_mm: FloatMap, y_mm: FloatMap) -> FloatMap:
        p = self.pitch_mm
        j = np.clip(np.rint(y_mm / p), 0, self.rows - 1)
        if self.kind == "asymmetric-circles":
            i = np.clip(np.rint((x_mm / p - j % 2) / 2), 0, self.columns - 1)
            centre, radius = (2 * i + j % 2) * p, ASYMMETRIC_CIRCLE_RADIUS * p
        else:
            i = np.clip(np.rint(x_mm / p), 0, self.columns - 1)
            centre, radius = i * p, CIRCLE_RADIUS * p
        return np.asarray(np.hypot(x_mm - centre, y_mm - j * p) <= radius, np.float64)

    @cached_property
    def _print(self) -> FloatMap:
        """Ink of a ChArUco board as an image, 0…1."""
        size = (self.columns * PRINT_PX_PER_SQUARE, self.rows * PRINT_PX_PER_SQUARE)
        return np.asarray(1.0 - self.aruco.generateImage(size) / 255.0)


def _shortest(length_mm: float) -> str:
    """The shortest text that reads back as exactly this length."""
    return repr(float(length_mm)).removesuffix(".0")


def parse_board(text: str) -> Board:
    """Read a board from its short description.

    Parameters
    ----------
    text : str
        ``chessboard:9x7:75`` (inner corners across and down, side of a square in mm),
        ``charuco:8x6:30:22[:dictionary][:legacy]`` (squares across and down, sides of square and
        marker in mm), ``circles:9x7:30`` or ``asymmetric-circles:4x11:20`` (circles across and
        down, pitch in mm; see ``Board.pitch_mm``).

    Returns
    -------
    Board

    Raises
    ------
    InputError for a text that describes no board; it lists the descriptions that do.

    Examples
    --------
    >>> parse_board("chessboard:9x7:75").points_mm.shape
    (63, 3)
    >>> parse_board("charuco:8x6:30:22:5X5_100").grid
    (7, 5)
    """
    kind, _, rest = text.partition(":")
    parts = rest.split(":") if rest else []
    kinds: dict[str, BoardKind] = {
        "chessboard": "chessboard",
        "charuco": "charuco",
        "circles": "circles",
        "asymmetric-circles": "asymmetric-circles",
    }
    not_a_board = InputError(f"board: expected {BOARD_SYNTAX}, got {text!r}")
    if kind not in kinds or len(parts) < 2:
        raise not_a_board
    try:
        columns, rows = (int(n) for n in parts[0].lower().split("x"))
        lengths = [float(p) for p in parts[1 : 3 if kind == "charuco" else 2]]
    except ValueError as error:
        raise not_a_board from error
    words = parts[1 + len(lengths) :]
    if kind != "charuco":
        if words:
            raise not_a_board
        return Board(kinds[kind], columns, rows, lengths[0])
    if len(lengths) < 2:
        raise InputError(f"board: expected the sides of square and marker in mm, got {text!r}")
    legacy = "legacy" in words
    names = [word for word in words if word != "legacy"]
    if len(names) > 1:
        raise not_a_board
    name = names[0].upper().removeprefix("DICT_") if names else DICTIONARY
    return Board("charuco", columns, rows, lengths[0], lengths[1], name, legacy)
