"""Black, white, greys and blocks: the pictures that scans show beside those of a plan."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.devices.protocols import Projector

SMALLEST_BLOCK_PX = 8
"""Smallest side of the blocks of a texture, projector px: projectors out of focus still show it."""
TEXTURE_BLOCKS = 160
"""Blocks on the longer side of a texture: several cross every block of 8 × 8 px that JPEG
compresses by itself."""


def black_picture(projector: Projector) -> NDArray[Any]:
    """Return the projector's black, (rows, columns), counts."""
    return uniform_picture(projector, 0.0)


def white_picture(projector: Projector) -> NDArray[Any]:
    """Return the projector's white, (rows, columns), counts."""
    return uniform_picture(projector, 1.0)


def block_pictures(projector: Projector, count: int, *, side_px: int, seed: int) -> NDArray[Any]:
    """Return pictures of random black and white blocks, (count, rows, columns), counts.

    Half of the blocks differ between any two of them, wherever a camera looks.
    """
    columns, rows = projector.size_px
    rng = np.random.default_rng(seed)
    cells = rng.integers(0, 2, (count, -(-rows // side_px), -(-columns // side_px)))
    large = cells.repeat(side_px, axis=1).repeat(side_px, axis=2)[:, :rows, :columns]
    return np.asarray(large * (2**projector.bits - 1)).astype(picture_type(projector))


def texture_picture(projector: Projector) -> NDArray[Any]:
    """Return blocks of random greys, (rows, columns), counts: all brightnesses, and edges."""
    columns, rows = projector.size_px
    side_px = max(SMALLEST_BLOCK_PX, max(columns, rows) // TEXTURE_BLOCKS)
    rng = np.random.default_rng(0)
    greys = rng.integers(0, 2**projector.bits, (-(-rows // side_px), -(-columns // side_px)))
    large = greys.repeat(side_px, axis=0).repeat(side_px, axis=1)[:rows, :columns]
    return np.asarray(large).astype(picture_type(projector))


def picture_type(projector: Projector) -> type[np.unsignedinteger[Any]]:
    """Return the type of the projector's pictures."""
    return np.uint8 if projector.bits == 8 else np.uint16


def uniform_picture(projector: Projector, level: float) -> NDArray[Any]:
    """Return a picture of one grey level (0…1 of full scale), (rows, columns), counts."""
    count = round(level * (2**projector.bits - 1))
    return np.full(projector.size_px[::-1], count, picture_type(projector))
