"""How far fringes lie beside where a fine Gray code has them, line by line.

Three steps leave no residuals: light that changes from row to row while the frames are taken, a
response that a table straightens in part, and steps that are off bend their coordinate unseen. A
code of narrow cells shows the coordinate as well, whatever the surface.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.order_chain import TURN
from fringeworks.stack.decoded_sample import decode_by_gray_code, decode_sample
from fringeworks.stack.kernel_settings import Decoding
from fringeworks.stack.refine import NOTABLE_RATIO, RIPPLE_FACTOR
from fringeworks.stack.set_residuals import Known
from fringeworks.statistics.quantiles import MAD_TO_SIGMA, median
from fringeworks.types import FloatMap

ORDERS = 3
"""Highest order of what light, steps and a response make, periods per fringe."""

NARROWEST = 12
"""Cells per fringe from which on a code tells that order: four in each of its periods."""

FEWEST_CELLS = 4 * (2 * ORDERS + 1)
"""Fewest cells along a line that is used: four for each number that is fitted to it."""

OUTLIERS = 5.0
"""Standard deviations from which on a pixel of a line is an outlier, such as a wrong cell."""


def shows_places(decoding: Decoding) -> bool:
    """Whether the cells of the Gray code are narrow enough to compare the fringes with."""
    gray = decoding.gray
    if gray is None or not decoding.sets or gray.levels > 2:
        return False
    told = bool(gray.inverse) or gray.white_black is not None
    return told and (gray.resolved_px or gray.step_px) * NARROWEST <= decoding.finest_px


def apart_px(decoding: Decoding, lines: list[NDArray[Any]], known: Known) -> float:
    """Distance of the coordinates by fringes from those by the cells, rms, projector px.

    Parameters
    ----------
    decoding : Decoding
    lines : (r, l) arrays in the decoding's order, counts
    known : Known

    Returns
    -------
    float
        What harmonics up to ``ORDERS`` per fringe, other ones on every line, explain of the
        distances, beyond chance, beyond the mean of all lines, and beyond what is in σ for all
        pixels alike; 0 where that is little beside σ, or cells are too wide.

    Notes
    -----
    A pixel lies anywhere in its cell, so that its distance is uniform over it. The pixels of a cell
    count as one: their errors are those of its borders.
    """
    if not shows_places(decoding):
        return 0.0
    maps = decode_sample(decoding, lines, known.noise, known.limits.open)
    code = decode_by_gray_code(decoding, lines, known.noise, known.limits.open)
    off, cell = maps["coordinate"] - code["coordinate"], np.rint(code["coordinate"])
    phase = TURN * maps["coordinate"] / decoding.finest_px
    found = [_explained(*line) for line in zip(off, phase, cell, strict=True)]
    told = [(mean, square) for mean, square in found if np.isfinite(square)]
    if not told:
        return 0.0
    means, squares = np.array(told).T
    finest = min(decoding.sets, key=lambda phases: phases.period_px)
    known_px = finest.floor_rad * finest.period_px / TURN / RIPPLE_FACTOR
    beyond = float(np.mean(squares) - np.mean(means) ** 2) - known_px**2
    usual = median(maps["sigma"][np.isfinite(maps["sigma"])])
    return beyond**0.5 if beyond > (NOTABLE_RATIO - 1.0) * usual**2 else 0.0


def _explained(off: FloatMap, phase: FloatMap, cell: FloatMap) -> tuple[float, float]:
    """Mean of what the harmonics of the phase explain of a line's distances, and of its square less
    what chance makes, px and px²; NaN where it holds too few cells."""
    known = np.isfinite(off)
    off, phase, cell = off[known].astype(float), phase[known].astype(float), cell[known]
    if not off.size:
        return np.nan, np.nan
    waves = [np.ones_like(phase)]
    for order in range(1, ORDERS + 1):
        waves += [np.cos(order * phase), np.sin(order * phase)]
    design, kept = np.column_stack(waves), np.ones(off.size, bool)
    for _ in range(2):
        found = np.linalg.lstsq(design[kept], off[kept], rcond=None)[0]
        left = np.abs(off - design @ found)
        kept = left < OUTLIERS * MAD_TO_SIGMA * median(left)
        cells = 1 + int(np.count_nonzero(np.diff(cell[kept])))
        if cells < FEWEST_CELLS or not kept.any():
            return np.nan, np.nan
    explained = design[kept] @ found
    chance = design.shape[1] * float(np.mean(left[kept] ** 2)) / cells
    return float(np.mean(explained)), float(np.mean(explained**2)) - chance
