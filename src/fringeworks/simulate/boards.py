"""Real boards: a print that is off at the same corners in every pose, and a sheet that is bowed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from fringeworks.rig.calibration.board import Board
from fringeworks.simulate.bodies import Body, height_field
from fringeworks.types import FloatMap, InputError

SHEET_PITCH_MM = 1.0
"""Side of the facets of a bent sheet, mm: with a bow of 1 mm over half a board of 60 mm, they are
less than 1e-4 mm off the sheet."""


@dataclass(frozen=True)
class BoardErrors:
    """How a real board differs from its description.

    Raises
    ------
    InputError for a print error below 0.
    """

    print_mm: float = 0.0
    """Standard deviation by which every corner is off within the board, per coordinate; ≥ 0, mm."""
    bow_mm: float = 0.0
    """Height of the sheet half the board's longer side from its middle, along ``direction_deg``,
    mm: the sheet is bent about one axis, as paper bends."""
    direction_deg: float = 0.0
    """Direction in which it bends, from the board's x towards its y, degrees."""
    seed: int = 0
    """Seed of the print errors; equal seeds give the same board."""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.print_mm) and self.print_mm >= 0):
            raise InputError(f"print_mm: expected >= 0 mm, got {self.print_mm}")


def real_points(board: Board, errors: BoardErrors) -> FloatMap:
    """Return where the corners of a real board are.

    Parameters
    ----------
    board : Board
    errors : BoardErrors

    Returns
    -------
    (n, 3) array, mm, in the order of ``Board.points_mm``.

    Examples
    --------
    >>> from fringeworks.rig.calibration.board import parse_board
    >>> board = parse_board("chessboard:11x8:12")
    >>> bowed = real_points(board, BoardErrors(bow_mm=1.0))
    >>> round(float(bowed[:, 2].max()), 3)
    1.0
    """
    nominal = board.points_mm
    x, y = nominal[:, 0], nominal[:, 1]
    return np.column_stack((nominal[:, :2] + _off(board, errors), _height(board, errors, x, y)))


def real_board_body(board: Board, errors: BoardErrors, T_camera_board: FloatMap) -> Body:
    """Make a body of a real board, to be photographed: a bent sheet with a misplaced print.

    Parameters
    ----------
    board : Board
    errors : BoardErrors
    T_camera_board : (4, 4) array
        Pose of the board, mm.

    Returns
    -------
    Body, whose corners are those of ``real_points``. Between the corners, the print's displacement
    changes smoothly from that of one corner to that of the next.

    Raises
    ------
    InputError for a board whose points are no rectangular grid.
    """
    nominal = board.points_mm
    axes = [np.unique(nominal[:, k].round(9)) for k in (0, 1)]
    if axes[0].size * axes[1].size != len(nominal):
        raise InputError("board: expected points on a rectangular grid")
    order = np.lexsort((nominal[:, 1].round(9), nominal[:, 0].round(9)))
    grid = _off(board, errors)[order].reshape(axes[0].size, axes[1].size, 2)
    counts = [np.arange(axis.size) for axis in axes]
    displaced = scipy.interpolate.RegularGridInterpolator(counts, grid)

    def albedo(x: FloatMap, y: FloatMap) -> FloatMap:
        place = []
        for v, axis, count in zip((x, y), axes, counts, strict=True):
            at = np.interp(v, axis, count)
            whole = np.minimum(np.floor(at), count[-1])
            part = at - whole
            # Flat at the corners: the print around a corner moves with it, and is not bent.
            place.append(whole + part * part * (3.0 - 2.0 * part))
        off = displaced(np.stack(place, axis=-1))
        return board.albedo(x - off[..., 0], y - off[..., 1])

    left, top, right, bottom = board.extent_mm
    middle = np.array([0.5 * (left + right), 0.5 * (top + bottom), 0.0])
    columns, rows = (int(np.ceil(side / SHEET_PITCH_MM)) for side in (right - left, bottom - top))
    y, x = np.mgrid[: rows + 1, : columns + 1] * SHEET_PITCH_MM
    x, y = (v - 0.5 * v.max() + centre for v, centre in ((x, middle[0]), (y, middle[1])))
    sheet = height_field(_height(board, errors, x, y), SHEET_PITCH_MM)
    to_middle = np.eye(4)
    to_middle[:3, 3] = middle
    return Body(
        sheet,
        T_camera_board @ to_middle,
        lambda x, y: albedo(x + middle[0], y + middle[1]),
    )


def _off(board: Board, errors: BoardErrors) -> FloatMap:
    """Displacement of every corner within the board, (n, 2), mm."""
    rng = np.random.default_rng(errors.seed)
    return errors.print_mm * rng.standard_normal((len(board.points_mm), 2))


def _height(board: Board, errors: BoardErrors, x: FloatMap, y: FloatMap) -> FloatMap:
    """Height of the sheet at places on the board, mm."""
    nominal = board.points_mm
    low, high = nominal.min(axis=0), nominal.max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * np.max(high - low)
    angle = np.radians(errors.direction_deg)
    along = (np.cos(angle) * (x - middle[0]) + np.sin(angle) * (y - middle[1])) / half
    return np.asarray(errors.bow_mm * along**2)
