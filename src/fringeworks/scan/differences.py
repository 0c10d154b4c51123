"""Whether two frames show the same, judged by the camera's noise."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.types import CameraNoise, FloatMap

COMPARED_PIXELS = 200_000
"""Pixels of a frame that are compared; larger frames are compared on a grid. A comparison then
takes 3 ms, well below the time between two frames."""
BLOCK_PX = 16
"""Side of the blocks in which differences are averaged, compared pixels. A mean over 256 pixels
scatters by 9 %, and a shift of the fringes fills whole blocks."""
MOST = 25.0
"""Limit on a squared difference over its variance, so that single hot pixels do not fill a
block."""
AGREES = 2.0
"""Mean squared difference of a block, over that of noise, up to which frames agree. Chance exceeds
1.5 in one block of 10⁸; the rest is for noise that JPEG or interpolation makes uneven."""
CHANGES = 4.0
"""Mean squared difference of a block, over that of noise, from which on it has changed. Twice
``AGREES``, so that a frame cannot be both."""
CHANGED_BLOCKS = 3
"""Blocks that must change for a frame to count as changed."""
ROUNDING_VARIANCE = 1.0 / 12.0
"""Variance of rounding to whole counts: no frame has less noise."""


def compared(frame: NDArray[Any]) -> NDArray[np.float32]:
    """Return the pixels of a frame that comparisons use, on a grid, (h, w).

    The channels of a frame in colours lie side by side in the rows.
    """
    stride = max(1, int(np.ceil(np.sqrt(frame.size / COMPARED_PIXELS))))
    grid = frame[::stride, ::stride]
    return np.asarray(grid.reshape(len(grid), -1), np.float32)


def block_differences(
    one: NDArray[np.float32], other: NDArray[np.float32], noise: CameraNoise
) -> FloatMap:
    """Mean squared difference of two frames in blocks, over the expectation from noise.

    Parameters
    ----------
    one, other : (h, w) arrays
        From ``compared``, counts.
    noise : CameraNoise

    Returns
    -------
    (rows, columns) array of blocks; 1 where the frames differ by noise only.
    """
    variance = noise.read_counts**2 * 2.0 + noise.gain * np.maximum(one + other, 0.0)
    variance = np.maximum(variance, 2.0 * ROUNDING_VARIANCE)
    squares = np.minimum((one - other) ** 2 / variance, MOST)
    edges = [np.arange(0, max(n - BLOCK_PX // 2, 1), BLOCK_PX) for n in squares.shape]
    sums = np.add.reduceat(np.add.reduceat(squares, edges[0], axis=0), edges[1], axis=1)
    sizes = [np.diff(np.append(e, n)) for e, n in zip(edges, squares.shape, strict=True)]
    return np.asarray(sums / np.outer(*sizes), np.float64)


def agree(differences: FloatMap) -> bool:
    """Whether frames with these ``block_differences`` show the same."""
    return bool(differences.max() <= AGREES)


def changed(differences: FloatMap) -> bool:
    """Whether frames with these ``block_differences`` show different things."""
    needed = min(CHANGED_BLOCKS, differences.size)
    return int(np.sum(differences >= CHANGES)) >= needed
