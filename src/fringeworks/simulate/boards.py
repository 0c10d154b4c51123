"""Real boards: a print that is off at the same corners in every pose, and a sheet that is bowed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.rig.calibration.board import Board
from fringeworks.types import FloatMap, InputError


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
    rng = np.random.default_rng(errors.seed)
    off = errors.print_mm * rng.standard_normal((len(nominal), 2))
    low, high = nominal.min(axis=0), nominal.max(axis=0)
    scaled = (nominal - 0.5 * (low + high)) / (0.5 * np.max(high - low))
    angle = np.radians(errors.direction_deg)
    along = np.cos(angle) * scaled[:, 0] + np.sin(angle) * scaled[:, 1]
    return np.column_stack((nominal[:, :2] + off, nominal[:, 2] + errors.bow_mm * along**2))
