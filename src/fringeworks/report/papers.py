"""Paper sizes, and which boards fit on them beside their rulers."""

from __future__ import annotations

import math
from dataclasses import replace

from fringeworks.rig.calibration.board import (
    ASYMMETRIC_CIRCLE_RADIUS,
    CIRCLE_RADIUS,
    MIN_CORNERS_ACROSS,
    MIN_SQUARES,
    SHEET_MARGIN,
    Board,
)
from fringeworks.types import InputError
from fringeworks.types.numbers import number

PAPERS = {
    "A5": (148.0, 210.0),
    "A4": (210.0, 297.0),
    "A3": (297.0, 420.0),
    "A2": (420.0, 594.0),
    "A1": (594.0, 841.0),
    "A0": (841.0, 1189.0),
    "letter": (215.9, 279.4),
    "legal": (215.9, 355.6),
    "tabloid": (279.4, 431.8),
}
"""Width and height of papers, upright, mm (ISO 216, ANSI/ASME Y14.1)."""
PRINTER_MARGIN_MM = 5.0
"""Edge of the paper on which nothing is drawn, mm: many printers cannot print there."""
LEFT_STRIP_MM = 15.0
"""Width of the strip at the left for the vertical ruler, mm: the printer's margin and the ruler
with its numbers."""
BOTTOM_STRIP_MM = 24.0
"""Height of the strip at the bottom, mm: the printer's margin, two lines of text and the
horizontal ruler with its numbers."""
PITCH_STEP_MM = 0.1
"""Step of the lengths of a board that is proposed in place of one that does not fit, mm."""
LARGEST_PAPER_MM = 5000.0
"""Longest side of a paper, mm. PDF viewers end at 5080 mm (14 400 points)."""
SMALLEST_PAPER_MM = 60.0
"""Shortest side of a paper, mm: the strips and a ruler of 20 mm need it."""
ROUNDING = 1e-9
"""Lengths that exceed a paper by this share of a pitch, or mm, fit: floating point rounds them."""
MAX_FIELDS = 10_000
"""Largest number of squares or circles that is drawn: far more than a finder takes, and still drawn
in seconds."""


def paper_size(paper: str) -> tuple[float, float]:
    """Return width and height of a paper in mm.

    Parameters
    ----------
    paper : str
        A name such as ``A4`` or ``letter``, upright; or width x height in mm, such as ``400x300``.

    Raises
    ------
    InputError for an unknown name, and for sides that are not 60…5000 mm.
    """
    for name, size in PAPERS.items():
        if name.lower() == paper.strip().lower():
            return size
    width, _, height = paper.lower().replace("×", "x").partition("x")
    try:
        found = float(width), float(height)
    except ValueError as error:
        raise InputError(
            f"paper: expected {', '.join(PAPERS)} or width x height in mm such as 400x300, "
            f"got {paper!r}"
        ) from error
    if not all(SMALLEST_PAPER_MM <= side <= LARGEST_PAPER_MM for side in found):
        raise InputError(
            f"paper: expected sides of {SMALLEST_PAPER_MM:g}…{LARGEST_PAPER_MM:g} mm, got {paper!r}"
        )
    return found


def white_rim_mm(board: Board) -> float:
    """Width of the white paper that the finder needs around the ink of a board, mm."""
    if board.kind == "circles":
        return (SHEET_MARGIN - CIRCLE_RADIUS) * board.pitch_mm
    if board.kind == "asymmetric-circles":
        return (SHEET_MARGIN - ASYMMETRIC_CIRCLE_RADIUS) * board.pitch_mm
    return (SHEET_MARGIN - 1.0) * board.pitch_mm


def edge_mm(board: Board, white_on_black: bool = False) -> float:
    """Smallest distance of a board's sheet from the paper's upper and right edge, mm."""
    # The white rim may lie on the paper's unprintable edge, ink may not.
    rim = 0.0 if white_on_black else white_rim_mm(board)
    return max(PRINTER_MARGIN_MM - rim, 0.0)


def place_on_sheet(
    board: Board, size: tuple[float, float], white_on_black: bool = False
) -> tuple[float, float]:
    """Return where on a sheet the board's coordinates begin, mm from its upper left corner.

    The board stands in the middle of the area that the rulers and the printer's margin leave.
    """
    left, top, right, bottom = board.extent_mm
    edge = edge_mm(board, white_on_black)
    x = 0.5 * (LEFT_STRIP_MM + size[0] - edge - (left + right))
    y = 0.5 * (edge + size[1] - BOTTOM_STRIP_MM - (top + bottom))
    return x, y


def needed_mm(board: Board, white_on_black: bool = False) -> tuple[float, float]:
    """Return the smallest width and height of a paper for a board and its rulers, mm."""
    left, top, right, bottom = board.extent_mm
    edge = edge_mm(board, white_on_black)
    return right - left + edge + LEFT_STRIP_MM, bottom - top + edge + BOTTOM_STRIP_MM


def sheet_size(
    board: Board, paper: str, landscape: bool | None, white_on_black: bool = False
) -> tuple[float, float]:
    """Return the width and height of the sheet on which a board is drawn, mm.

    Parameters
    ----------
    board : Board
    paper : str
        As for ``paper_size``.
    landscape : bool, optional
        True: the long side is horizontal; False: it is vertical. By default the way in which the
        board fits, and its own direction where both do.
    white_on_black : bool

    Raises
    ------
    InputError for a board that does not fit; it names the largest ones that do.
    """
    sizes = _turned(paper_size(paper), board, landscape)
    for size in sizes:
        if _fits(board, size, white_on_black):
            _check_count(board)
            return size
    smaller = _smaller_pitch(board, sizes, white_on_black)
    fewer = _fewer(board, sizes, white_on_black)
    proposals = " or ".join(b.name for b in (smaller, fewer) if b is not None)
    width, height = needed_mm(board, white_on_black)
    raise InputError(
        f"board {board.name}: expected a board that fits on {paper} with its rulers, but it needs "
        f"{number(width, digits=4)} × {number(height, digits=4)} mm; "
        + (f"largest that fits: {proposals}" if proposals else "none of its kind fits")
    )


def _check_count(board: Board) -> None:
    if board.columns * board.rows > MAX_FIELDS:
        raise InputError(
            f"board {board.name}: expected at most {MAX_FIELDS} squares or circles, "
            f"got {board.columns * board.rows}"
        )


def _turned(
    size: tuple[float, float], board: Board, landscape: bool | None
) -> list[tuple[float, float]]:
    """The orientations of a paper to try, in this order."""
    short, long = sorted(size)
    upright, across = (short, long), (long, short)
    if landscape is not None:
        return [across if landscape else upright]
    left, top, right, bottom = board.extent_mm
    return [across, upright] if right - left > bottom - top else [upright, across]


def _fits(board: Board, size: tuple[float, float], white_on_black: bool) -> bool:
    width, height = needed_mm(board, white_on_black)
    return width <= size[0] + ROUNDING and height <= size[1] + ROUNDING


def _smaller_pitch(
    board: Board, sizes: list[tuple[float, float]], white_on_black: bool
) -> Board | None:
    """The board with as many squares or circles and the largest pitch that fits."""
    ratio = None if board.marker_mm is None else board.marker_mm / board.pitch_mm
    steps = math.ceil(board.pitch_mm / PITCH_STEP_MM) - 1
    # No paper takes a larger pitch than its longest side has room for.
    steps = min(steps, math.floor(max(max(s) for s in sizes) / PITCH_STEP_MM))
    for k in range(steps, 0, -1):
        pitch = round(k * PITCH_STEP_MM, 1)
        marker = None
        if ratio is not None:
            marker = round(math.floor(ratio * pitch / PITCH_STEP_MM) * PITCH_STEP_MM, 1)
            if marker <= 0.0:
                return None
        smaller = replace(board, pitch_mm=pitch, marker_mm=marker)
        if any(_fits(smaller, size, white_on_black) for size in sizes):
            return smaller
    return None


def _fewer(board: Board, sizes: list[tuple[float, float]], white_on_black: bool) -> Board | None:
    """The board with the same squares or circles, and as many of them as fit."""
    least = MIN_SQUARES if board.kind == "charuco" else MIN_CORNERS_ACROSS
    found: list[Board] = []
    for width, height in sizes:
        smallest = replace(board, columns=least, rows=least)
        if not _fits(smallest, (width, height), white_on_black):
            continue
        needed = needed_mm(smallest, white_on_black)
        # On asymmetric grids, circles within a row are two pitches apart.
        step = 2.0 if board.kind == "asymmetric-circles" else 1.0
        more = math.floor((width - needed[0]) / (step * board.pitch_mm) + ROUNDING)
        columns = min(board.columns, least + more)
        more = math.floor((height - needed[1]) / board.pitch_mm + ROUNDING)
        rows = min(board.rows, least + more)
        found.append(replace(board, columns=columns, rows=rows))
    return max(found, key=lambda b: b.columns * b.rows, default=None)
