"""Samples of a map along a line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fringeworks.types.arrays import ByteMap, FloatMap, Reason
from fringeworks.types.displayed import Plotted
from fringeworks.types.frozen import Frozen

Line = tuple[tuple[int, int], tuple[int, int]]
"""Column and row of the first pixel, and of the last one."""


@dataclass(frozen=True, eq=False, repr=False)
class Profile(Plotted, Frozen):
    """Samples of a map along a straight line of its pixels, with σ and reasons."""

    layout = {  # noqa: RUF012
        "pixels": "ui n2",
        "along_px": "fiu n",
        "along_mm": "?fiu n",
        "values": "fiu n",
        "sigma": "fiu n",
        "reason": "ui n",
    }

    pixels: NDArray[np.integer[Any]]
    """Column and row of every sample, (n, 2)."""
    along_px: FloatMap
    """Distance of every sample from the first one along the line in the image, (n,), px."""
    along_mm: FloatMap | None
    """Distance from the first measured sample, (n,), mm; NaN where it is not known. None for maps
    without a lateral scale. Across the direction of heights or, where levelled, along the line
    between the ends."""
    values: FloatMap
    """Value of every sample, (n,); NaN where it is not measured."""
    sigma: FloatMap
    """Standard deviation of every value, (n,), same unit; NaN where the value is. That of the
    sample alone: where levelled, the ends count as exact."""
    reason: ByteMap
    """``Reason`` of every sample, (n,)."""
    quantity: str
    """What the values are, such as height or depth z."""
    unit: Literal["mm", "px"]
    """Unit of the values and of σ."""
    levelled: bool = False
    """Whether heights count from the line between the first and the last measured sample."""

    @property
    def failed_fraction(self) -> float:
        """Share of samples without a value, 0…1."""
        return float(np.mean(self.reason != Reason.OK))
