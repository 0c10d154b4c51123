"""Noise from the residuals of fits, where the harmonics of the fringes differ over the scene.

A response that is not linear adds harmonics. Their shares are those of one projector only where all
is equally sharp: out of focus, at a slant or in indirect light, the fringes lose their harmonics
first. Short stretches of a row have shares of their own, and what these leave is noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.stack.fits import DesignRows, fit_matrices, harmonic_parts
from fringeworks.stack.frames import STRETCH
from fringeworks.types import BoolMap, FloatMap

PIECE = STRETCH // 2
"""Number of pixels in a row with shares of their own: five for each of the six shares."""

MIN_PIECE_PIXELS = 24
"""Smallest number of usable pixels of a piece: four for each of the six shares."""

MOST_ALIKE = 0.5
"""Largest length of the mean of exp(2 i φ) over a piece, in which harmonics do not look like light
that is added to a frame: half a turn or more of the phase. An empirical choice."""

LOCAL_SHARE = 0.5
"""Variance that shares of their own leave of the pieces, over that with shares of the whole
frame, below which the latter is no noise.

Noise alone gives 1 within some per cent. An empirical choice: of eight simulated photographs with
four steps, six gave 0.10 to 0.39, with γ and a projector out of focus at parts of the scene.
"""


def squares_of_pieces(
    planes: Sequence[NDArray[Any]], fitted: FloatMap, rows: DesignRows, used: BoolMap
) -> tuple[NDArray[np.intp], FloatMap]:
    """Sums of squared residuals with shares of the harmonics of their own in every piece.

    Frames of other light than the plan's stay in the residuals: they move the phases as well.

    Parameters
    ----------
    planes : (1, n) arrays, counts
        Samples of a set, stretch by stretch of ``STRETCH`` pixels.
    fitted : (3, n) array of A, c and s, counts
    rows : (N, 3) floats
        What every frame shows of A, c and s; N is four or more.
    used : (n,) bool array
        Pixels that take part.

    Returns
    -------
    pixels : (m,) indices of the pixels of the pieces that have enough of them
    square : (m,) array, counts²
        For N − 3 degrees of freedom each, as the shares take the same part of all.
    """
    inside, pixels = _pieces(fitted, used)
    if pixels.size == 0:
        return pixels, np.empty(0)
    design, _ = fit_matrices(rows)
    across = np.linalg.qr(design, mode="complete")[0][:, 3:]
    kept = inside.reshape(-1)
    data = np.stack([plane[0, pixels].astype(np.float64) for plane in planes])
    left = (across.T @ np.where(kept, data, 0.0)).reshape(-1, *inside.shape)
    parts = harmonic_parts(np.where(kept, fitted[:, pixels], 0.0)).reshape(-1, *inside.shape)
    basis = np.linalg.qr(np.moveaxis(parts, 0, 2))[0]
    shares = np.einsum("mlk,jml->jmk", basis, left)
    left = left - np.einsum("mlk,jmk->jml", basis, shares)
    count = inside.sum(axis=1, keepdims=True)
    square = np.sum(left**2, axis=0) * (count / (count - len(parts)))
    return pixels[kept], np.asarray(square.reshape(-1)[kept])


def _pieces(fitted: FloatMap, used: BoolMap) -> tuple[BoolMap, NDArray[np.intp]]:
    """Pieces with enough pixels over enough of a turn: which pixels of each take part, (m,
    PIECE), and the indices of all."""
    whole = used.size // PIECE  # a rest of a piece is left
    inside = used[: whole * PIECE].reshape(whole, PIECE)
    turns = np.where(used, np.exp(2j * np.arctan2(fitted[2], fitted[1])), 0.0)
    alike = np.abs(turns[: whole * PIECE].reshape(whole, PIECE).sum(axis=1))
    count = inside.sum(axis=1)
    enough = np.flatnonzero((count >= MIN_PIECE_PIXELS) & (alike < MOST_ALIKE * count))
    pixels = (enough[:, None] * PIECE + np.arange(PIECE)).reshape(-1)
    return np.asarray(inside[enough]), pixels
