"""Brightness and colour of points in 8 or 16 bits, as files of points and meshes hold them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.statistics.quantiles import quantile
from fringeworks.types import FloatMap

WHITE_PERCENTILE = 99.5
"""Brightness that becomes white in 8 bits, percent of the points below it: highlights beyond it do
not darken the rest."""
WHITE_POINTS = 300_000
"""Approximate largest number of points that white is taken from."""


WHITE = 255.0
"""White in 8 bits."""


def white_of(colour: FloatMap) -> float | None:
    """Brightness that becomes white, of points with brightness (n,) or colour (n, 3); None where no
    point has any."""
    # An odd step does not meet the same places of rows or stripes again and again.
    seen = np.asarray(colour)[:: max(1, len(colour) // WHITE_POINTS) | 1]
    if not np.isfinite(seen).any():
        return None
    if seen.dtype.kind != "f":
        seen = seen.astype(np.float64)
    return max(quantile(seen[~np.isnan(seen)], WHITE_PERCENTILE / 100.0), 1e-9)


def as_numbers(colour: FloatMap, white: float, bits: int) -> NDArray[Any]:
    """Red, green and blue of 8 or 16 bits, (n, 3), of points with brightness (n,) or colour
    (n, 3)."""
    most = float((1 << bits) - 1)
    scaled = np.nan_to_num(np.asarray(colour, np.float64)) * (most / white)
    shown = np.clip(np.rint(scaled), 0, most).astype(f"u{bits // 8}")
    return np.stack((shown,) * 3, axis=-1) if shown.ndim == 1 else shown


def eight_bits(colour: FloatMap, white: float) -> NDArray[np.uint8]:
    """Red, green and blue, (n, 3), of points with brightness (n,) or colour (n, 3)."""
    return as_numbers(colour, white, 8)
