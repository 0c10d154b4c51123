"""The noise model of a camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.types.arrays import FloatMap
from fringeworks.types.checks import finite
from fringeworks.types.errors import InputError
from fringeworks.types.frozen import Frozen


@dataclass(frozen=True, eq=False, repr=False)
class CameraNoise(Frozen):
    """Variance of a camera count, σ²(I) = read² + gain · I (theory §9)."""

    read_counts: float
    """Standard deviation in the dark, quantisation included; ≥ 0, counts."""
    gain: float = 0.0
    """Shot noise: variance per count; ≥ 0, counts."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("read_counts", "gain"):
            value = getattr(self, name)
            if not (finite(value) and value >= 0):
                raise InputError(f"noise: expected {name} >= 0, got {value}")

    def variance(self, brightness: FloatMap | float) -> FloatMap:
        """Variance of a count at some brightness (counts), counts²; below zero that of the dark."""
        return np.asarray(self.read_counts**2 + self.gain * np.maximum(brightness, 0.0))
