"""Calibration boards: their corners in mm, and what they look like."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import cv2
import numpy as np

from fringeworks.types import FloatMap, InputError

Kind = Literal["chessboard", "charuco", "circles", "asymmetric-circles"]
DICTIONARY = "4X4_250"
FORMS = (
    "chessboard:9x7:75, charuco:8x6:30:22[:dictionary][:legacy], circles:9x7:30 or "
    "asymmetric-circles:4x11:20"
)
PAPER, INK = 0.85, 0.08
"""Albedo of what is white and what is black on a board."""
PRINT_PX = 48
"""Pixels of a square in the picture that a ChArUco board is looked up in."""


@dataclass(frozen=True)
class Board:
    """A flat board with a known pattern."""

    kind: Kind
    columns: int
    """Inner corners across (chessboard), squares across (ChArUco) or circles across."""
    rows: int
    """The same downwards."""
    pitch_mm: float
    """Side of a square, or distance of circles (of neighbouring rows' halves where asymmetric)."""
    marker_mm: float | None = None
    """Side of a ChArUco board's markers."""
    dictionary: str = DICTIONARY
    """Name of the dictionary of markers, without DICT_."""
    legacy: bool = False
    """Whether a ChArUco board has the layout of OpenCV before 4.6 (even rows start in white)."""

    def __post_init__(self) -> None:
        least = 2 if self.kind == "charuco" else 3
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
            if not hasattr(cv2.aruco, f"DICT_{self.dictionary}"):
                raise InputError(f"board: expected a dictionary of ArUco, got {self.dictionary!r}")

    @cached_property
    def aruco(self) -> Any:
        """OpenCV's form of a ChArUco board."""
        known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{self.dictionary}"))
        made = cv2.aruco.CharucoBoard(
            (self.columns, self.rows), self.pitch_mm, self.marker_mm or 0.0, known
        )
        made.setLegacyPattern(self.legacy)
        return made

    @property
    def grid(self) -> tuple[int, int]:
        """Corners (or circles) across and down."""
        if self.kind == "charuco":
            return self.columns - 1, self.rows - 1
        return self.columns, self.rows

    @cached_property
    def points_mm(self) -> FloatMap:
        """Corners or centres of circles on the board, (n, 3), row by row, z = 0, mm."""
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
        """Left, top, right and bottom of the sheet, mm."""
        low, high = self.points_mm[:, :2].min(axis=0), self.points_mm[:, :2].max(axis=0)
        rim = 1.5 * self.pitch_mm
        return low[0] - rim, low[1] - rim, high[0] + rim, high[1] + rim

    def albedo(self, x_mm: FloatMap, y_mm: FloatMap) -> FloatMap:
        """Reflectance at points of the board, 0…1."""
        return PAPER - (PAPER - INK) * self._ink(x_mm, y_mm)

    def _ink(self, x_mm: FloatMap, y_mm: FloatMap) -> FloatMap:
        p = self.pitch_mm
        if self.kind == "chessboard":
            i, j = np.floor(x_mm / p), np.floor(y_mm / p)
            inside = (i >= -1) & (i < self.columns) & (j >= -1) & (j < self.rows)
            return np.asarray(inside & ((i + j) % 2 == 0), np.float64)
        if self.kind == "charuco":
            h, w = self._print.shape
            i = np.floor(x_mm * (PRINT_PX / p)).astype(np.int64)
            j = np.floor(y_mm * (PRINT_PX / p)).astype(np.int64)
            inside = (i >= 0) & (i < w) & (j >= 0) & (j < h)
            # Outside the print is paper, not what lies at its rim.
            shown = self._print[np.clip(j, 0, h - 1), np.clip(i, 0, w - 1)]
            return np.where(inside, shown, 0.0)
        if self.kind == "asymmetric-circles":
            j = np.clip(np.rint(y_mm / p), 0, self.rows - 1)
            i = np.clip(np.rint((x_mm / p - j % 2) / 2), 0, self.columns - 1)
            centre, radius = (2 * i + j % 2) * p, 0.5 * p
        else:
            j = np.clip(np.rint(y_mm / p), 0, self.rows - 1)
            i = np.clip(np.rint(x_mm / p), 0, self.columns - 1)
            centre, radius = i * p, 0.3 * p
        return np.asarray(np.hypot(x_mm - centre, y_mm - j * p) <= radius, np.float64)

    @cached_property
    def _print(self) -> FloatMap:
        size = (self.columns * PRINT_PX, self.rows * PRINT_PX)
        return np.asarray(1.0 - self.aruco.generateImage(size) / 255.0)


def parse_board(text: str) -> Board:
    """A board from its short form.

    Parameters
    ----------
    text : str
        ``chessboard:9x7:75`` (inner corners, side of a square in mm),
        ``charuco:8x6:30:22[:dictionary][:legacy]`` (squares, sides of square and marker),
        ``circles:9x7:30`` or ``asymmetric-circles:4x11:20`` (circles, distance).

    Raises
    ------
    InputError that says what was expected.

    Examples
    --------
    >>> parse_board("chessboard:9x7:75").points_mm.shape
    (63, 3)
    """
    kind, _, rest = text.partition(":")
    parts = rest.split(":") if rest else []
    kinds: dict[str, Kind] = {
        "chessboard": "chessboard",
        "charuco": "charuco",
        "circles": "circles",
        "asymmetric-circles": "asymmetric-circles",
    }
    if kind not in kinds or len(parts) < 2:
        raise InputError(f"board: expected {FORMS}, got {text!r}")
    try:
        columns, rows = (int(n) for n in parts[0].lower().split("x"))
        lengths = [float(p) for p in parts[1 : 3 if kind == "charuco" else 2]]
    except ValueError as error:
        raise InputError(f"board: expected {FORMS}, got {text!r}") from error
    words = parts[1 + len(lengths) :]
    if kind != "charuco":
        if words:
            raise InputError(f"board: expected {FORMS}, got {text!r}")
        return Board(kinds[kind], columns, rows, lengths[0])
    if len(lengths) < 2:
        raise InputError(f"board: expected sides of square and marker, got {text!r}")
    legacy = "legacy" in words
    names = [word for word in words if word != "legacy"]
    if len(names) > 1:
        raise InputError(f"board: expected {FORMS}, got {text!r}")
    name = names[0].upper().removeprefix("DICT_") if names else DICTIONARY
    return Board("charuco", columns, rows, lengths[0], lengths[1], name, legacy)
