"""Calibration boards to print: exact in mm, with rulers that check the printer's scale."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fringeworks import _core
from fringeworks.files.atomic import StrPath, check_target, replacing
from fringeworks.report.board_outlines import board_ink
from fringeworks.report.drawing import (
    Affine2D,
    Axes,
    Figure,
    FontProperties,
    Outline,
    Patch,
    PathPatch,
    Rectangle,
    TextPath,
    need_plots,
    rc_context,
)
from fringeworks.report.figures import FORMATS
from fringeworks.report.papers import (
    BOTTOM_STRIP_MM,
    LEFT_STRIP_MM,
    PRINTER_MARGIN_MM,
    place_on_sheet,
    sheet_size,
)
from fringeworks.rig.calibration.board import Board, parse_board
from fringeworks.types import InputError

MM_PER_INCH = 25.4
"""Millimetres in an inch; matplotlib measures figures in inches."""
POINTS_PER_MM = 72.0 / MM_PER_INCH
"""Points, the unit of font sizes, in a millimetre."""
RULER_MM = 100.0
"""Length of the rulers where they fit, mm: 0.1 mm read on a steel rule is then 0.1 % of scale."""
RULER_STEP_MM = 10.0
"""Rulers are a multiple of this long, mm; these marks have numbers."""
TICK_MM = (1.5, 2.2, 3.0)
"""Lengths of the marks of 1, 5 and 10 mm on the rulers, mm."""
LINE_MM = 0.1
"""Width of the rulers' lines, mm: a printer's finest line at 300 dpi is 0.085 mm."""
RULER_GAP_MM = 2.5
"""Distance of the rulers from the board's sheet, mm."""
NUMBER_POINTS = 6.0
"""Font size of the rulers' numbers, points: three digits are 3.8 mm wide, of 10 mm."""
NUMBER_GAP_MM = 0.6
"""Distance of the numbers from the marks, mm."""
NUMBER_REACH_MM = 2.0
"""How far the last number reaches beyond its ruler, mm: half of three digits."""
NAME_POINTS = 9.0
"""Largest font size of the board's name, points."""
HINT_POINTS = 7.0
"""Largest font size of the hint for printing, points."""
HINT_LINE_MM = 3.6
"""Height of the line with the hint, mm: 7 points are 2.5 mm, and some distance."""
FONT = "DejaVu Sans Mono"
"""Font of all text: it comes with matplotlib, so every machine draws the same sheet."""
DEFAULT_DPI = 600
"""Dots per inch of a PNG: what laser printers print, with edges exact to 0.02 mm."""
LIMITS_DPI = (72, 2400)
"""Smallest and largest resolution of a PNG, dots per inch: usual screens to imagesetters."""
MAX_PIXELS = 300_000_000
"""Largest number of pixels of a PNG: drawing it takes 1.2 GB. A0 at 439 dpi has as many; PDF
and SVG have no such limit."""
DRAWING: Any = {
    "savefig.bbox": None,
    "savefig.facecolor": "auto",
    "savefig.transparent": False,
    "path.simplify": False,
    "path.sketch": None,
    "text.usetex": False,
    "pdf.fonttype": 42,
    "pdf.use14corefonts": False,
    "svg.fonttype": "path",
    "svg.hashsalt": "fringeworks",
}
"""Settings of matplotlib that could change the sheet's size, its lines or its bytes: a user's own
settings must not. The salt replaces random names inside SVG files."""


def board_sheet(
    board: Board | str,
    paper: str = "A4",
    *,
    landscape: bool | None = None,
    white_on_black: bool = False,
) -> Figure:
    """Draw a calibration board on a sheet of paper, in its true size.

    Parameters
    ----------
    board : Board or str
        A board, or its short form, as for ``parse_board``.
    paper : str
        ``A5`` … ``A0``, ``letter``, ``legal``, ``tabloid``, or width x height in mm (``400x300``).
    landscape : bool, optional
        True: the long side is horizontal; False: it is vertical. By default the way in which the
        board fits, and its own direction where both do.
    white_on_black : bool
        Draw white circles on black, for grids of circles.

    Returns
    -------
    matplotlib Figure of the paper's size, with one axes in mm from the paper's upper left corner. A
    ruler stands at the left and one at the bottom; they are 100 mm long, or what fits. The board's
    name stands below, as ``parse_board`` reads it. Around the board, white paper as wide as the
    finder needs stays empty.

    Raises
    ------
    InputError for a text that describes no board, an unknown paper, a board that does not fit (it
    names the largest ones that do), and ``white_on_black`` for boards other than circles.

    Examples
    --------
    >>> sheet = board_sheet("charuco:11x8:15:11", "A4")
    >>> [round(float(25.4 * side), 3) for side in sheet.get_size_inches()]
    [297.0, 210.0]
    """
    need_plots("a board to print")
    board = parse_board(board) if isinstance(board, str) else board
    if white_on_black and board.kind not in ("circles", "asymmetric-circles"):
        raise InputError(
            f"board {board.name}: expected a grid of circles for white on black; other boards are "
            "found in black on white only"
        )
    width, height = sheet_size(board, paper, landscape, white_on_black)
    with rc_context(DRAWING):
        figure = Figure(figsize=(width / MM_PER_INCH, height / MM_PER_INCH), facecolor="white")
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set(xlim=(0.0, width), ylim=(height, 0.0))
        _draw_board(axes, board, (width, height), white_on_black)
        lengths = _draw_rulers(axes, width, height)
        _draw_text(axes, board, (width, height), lengths)
    return figure


def write_board(
    path: StrPath,
    board: Board | str,
    paper: str = "A4",
    *,
    landscape: bool | None = None,
    white_on_black: bool = False,
    dpi: int = DEFAULT_DPI,
) -> Path:
    """Write a calibration board to print, whole or not at all; equal calls write equal bytes.

    Parameters
    ----------
    path : path
        ``.pdf`` or ``.svg`` (exact lines), or ``.png``.
    board, paper, landscape, white_on_black
        As for ``board_sheet``.
    dpi : int
        Resolution of a PNG, 72…2400 dots per inch.

    Raises
    ------
    InputError as ``board_sheet``, and for a resolution that is out of range or gives more than 300
    million pixels.
    FileProblem for another suffix, and where the folder cannot be written to.
    """
    path = Path(path)
    check_board_target(path)
    kind = path.suffix.lower()[1:]
    board = parse_board(board) if isinstance(board, str) else board
    figure = board_sheet(board, paper, landscape=landscape, white_on_black=white_on_black)
    if kind == "png":
        _check_dpi(figure, dpi)
    program = f"fringeworks {_core.version}"
    # A date would make every file differ from the last.
    metadata: dict[str, dict[str, Any]] = {
        "png": {"Software": program},
        "pdf": {"Creator": program, "CreationDate": None},
        "svg": {"Creator": program, "Date": None},
    }
    with replacing(path) as temporary, rc_context(DRAWING):
        figure.savefig(
            temporary, dpi=dpi, format=kind, metadata={"Title": board.name, **metadata[kind]}
        )
    return path


def check_board_target(path: StrPath) -> None:
    """Refuse a file that ``write_board`` cannot write, before anything is drawn for it."""
    need_plots("a board to print")
    check_target(path, FORMATS)


def _check_dpi(figure: Figure, dpi: int) -> None:
    low, high = LIMITS_DPI
    if not low <= dpi <= high:
        raise InputError(f"dpi: expected {low}…{high} dots per inch, got {dpi}")
    width, height = figure.get_size_inches()
    if width * height * dpi**2 > MAX_PIXELS:
        largest = int((MAX_PIXELS / (width * height)) ** 0.5)
        raise InputError(
            f"dpi: expected at most {largest} dots per inch for this paper, got {dpi}; PDF and SVG "
            "are exact at every size"
        )


def _draw_board(axes: Axes, board: Board, size: tuple[float, float], white_on_black: bool) -> None:
    """Draw the board in the middle of the paper that the strips of the rulers leave."""
    x, y = place_on_sheet(board, size, white_on_black)
    if white_on_black:
        left, top, right, bottom = board.extent_mm
        ground = Rectangle((x + left, y + top), right - left, bottom - top, facecolor="black")
        axes.add_patch(_exact(ground, "ground"))
    ink = board_ink(board).transformed(Affine2D().translate(x, y))
    colour = "white" if white_on_black else "black"
    axes.add_patch(_exact(PathPatch(ink, facecolor=colour), "board"))


def _exact(patch: Patch, name: str) -> Patch:
    """A filled patch without an outline, which is not moved to whole pixels."""
    patch.set(linewidth=0.0, edgecolor="none", snap=False, clip_on=False, gid=name)
    return patch


def _draw_rulers(axes: Axes, width: float, height: float) -> tuple[float, float]:
    """Draw a ruler at the bottom and one at the left; return their lengths in mm."""
    x, y = LEFT_STRIP_MM, height - BOTTOM_STRIP_MM
    across = _ruler_length(width - x)
    up = _ruler_length(y)
    line_y = y + RULER_GAP_MM
    line_x = x - RULER_GAP_MM
    numbers: dict[str, Any] = {"fontsize": NUMBER_POINTS, "family": FONT}
    _ruler(axes, "ruler-across", [(x + s, line_y, 0.0, t) for s, t in _ticks(across)])
    _ruler(axes, "ruler-up", [(line_x, y - s, -t, 0.0) for s, t in _ticks(up)])
    reach = TICK_MM[-1] + NUMBER_GAP_MM
    for s in range(0, int(max(across, up)) + 1, int(RULER_STEP_MM)):
        if s <= across:
            axes.text(x + s, line_y + reach, str(s), ha="center", va="top", **numbers)
        if s <= up:
            axes.text(line_x - reach, y - s, str(s), ha="right", va="center", **numbers)
    return across, up


def _ruler_length(room_mm: float) -> float:
    """The longest ruler that fits, mm."""
    room = room_mm - PRINTER_MARGIN_MM - NUMBER_REACH_MM
    return min(RULER_MM, RULER_STEP_MM * (room // RULER_STEP_MM))


def _ticks(length: float) -> list[tuple[float, float]]:
    """Place and length of every mark of a ruler, mm."""
    short, middle, long = TICK_MM
    return [
        (float(s), long if s % 10 == 0 else middle if s % 5 == 0 else short)
        for s in range(int(length) + 1)
    ]


def _ruler(axes: Axes, name: str, marks: list[tuple[float, float, float, float]]) -> None:
    """Draw marks, each from x, y by dx, dy, and the line along which they stand."""
    vertices = [marks[0][:2], marks[-1][:2]]
    for x, y, dx, dy in marks:
        vertices += [(x, y), (x + dx, y + dy)]
    codes = [Outline.MOVETO, Outline.LINETO] * (len(marks) + 1)
    lines = PathPatch(
        Outline(vertices, codes),
        fill=False,
        linewidth=LINE_MM * POINTS_PER_MM,
        capstyle="butt",
        snap=False,
        clip_on=False,
        gid=name,
    )
    axes.add_patch(lines)


def _draw_text(
    axes: Axes, board: Board, size: tuple[float, float], rulers: tuple[float, float]
) -> None:
    """Write the board's name and what the rulers are for below them."""
    width, height = size
    hint = (
        f"Print at 100 % (actual size), then check the rulers: {rulers[0]:g} mm across, "
        f"{rulers[1]:g} mm up."
    )
    room = width - LEFT_STRIP_MM - PRINTER_MARGIN_MM
    for text, points, weight, y in (
        (board.name, NAME_POINTS, "bold", height - PRINTER_MARGIN_MM - HINT_LINE_MM),
        (hint, HINT_POINTS, "normal", height - PRINTER_MARGIN_MM),
    ):
        font = FontProperties(family=FONT, weight=weight)
        natural = TextPath((0.0, 0.0), text, size=points, prop=font).get_extents().width
        font.set_size(points * min(1.0, room * POINTS_PER_MM / natural))
        axes.text(LEFT_STRIP_MM, y, text, fontproperties=font, va="bottom", parse_math=False)
