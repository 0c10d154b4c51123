"""Readable twin of the Gray code's reading: every cell of the projector is tried."""

from __future__ import annotations

import numpy as np

from fringeworks.patterns import GrayCode


def levels_of_cells(code: GrayCode) -> np.ndarray:
    """Level of every digit, (words, digits), for all words of the code."""
    words = np.arange(code.levels**code.bits)
    longer = GrayCode(code.axis, 1.0, words.size, levels=code.levels)
    light = [longer.values(words.astype(float), k) for k in range(longer.bits)]
    return np.rint((code.levels - 1) * np.stack(light, axis=1)).astype(int)


def start_of_pixel(
    samples: np.ndarray, code: GrayCode, *, black: float, white: float, doubt: float
) -> tuple[float, float]:
    """Coordinate that the phases start from and its half width, px.

    ``samples`` are those of the digits. A digit nearer than ``doubt`` counts to the border of two
    levels may have either level. The result is the middle of the only cell that the digits allow,
    or the border of the only two, which must be neighbours; NaN otherwise.
    """
    top = code.levels - 1
    borders = black + (white - black) * (np.arange(top) + 0.5) / top
    allowed = np.ones((code.levels**code.bits,), bool)
    table = levels_of_cells(code)
    for digit, sample in enumerate(samples):
        level = int((sample > borders).sum())
        possible = {level}
        possible |= {k for k, b in enumerate(borders) if abs(sample - b) < doubt and k + 1 == level}
        near = [k for k, b in enumerate(borders) if abs(sample - b) < doubt and k == level]
        possible |= {k + 1 for k in near}
        allowed &= np.isin(table[:, digit], list(possible))
    cells = np.flatnonzero(allowed)
    first = code.offset_px - 0.5
    if cells.size == 1 and cells[0] < code.cells:
        return float((cells[0] + 0.5) * code.step_px + first), 0.5 * code.step_px
    if cells.size == 2 and cells[1] - cells[0] == 1 and cells[0] < code.cells:
        return float(cells[1] * code.step_px + first), code.step_px
    return np.nan, np.nan


def nearest_coordinate(start: float, phase_rad: float, period: float) -> float:
    """The coordinate of a phase that is nearest to a start, px."""
    turns = phase_rad / (2.0 * np.pi) - start / period
    return float(start + period * (turns - np.rint(turns)))
