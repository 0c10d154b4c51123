"""What a device's lens model does not hold: a smooth correction of pixels by their place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fringeworks.types.arrays import FloatMap
from fringeworks.types.checks import MOST_PX, finite, positive, unmasked
from fringeworks.types.errors import InputError
from fringeworks.types.frozen import Frozen

LEAST_CONTROLS = 4
"""Smallest number of control points along an axis: a cubic spline has four in every interval."""
MAX_SLOPE = 0.25
"""Largest difference of neighbouring control points, over their distance. With it a correction can
be undone everywhere; lenses have a hundredth of it."""


@dataclass(frozen=True, eq=False, repr=False)
class LensField(Frozen):
    """A correction of a device's pixels as a surface of cubic B-splines over its frame.

    It is subtracted from a measured pixel. What is left follows the pinhole with Brown's
    distortion. Beyond the outer control points it is constant.
    """

    layout: ClassVar[Mapping[str, str]] = {
        "control_px": "f rc2",
        "sigma_px": "f rc2",
    }
    first_px: tuple[float, float]
    """Column and row of the first control point, px; outside of the frame."""
    step_px: tuple[float, float]
    """Distance of control points along columns and rows; > 0, px."""
    control_px: FloatMap
    """Control points of the corrections of column and row, (rows, columns, 2), px."""
    sigma_px: FloatMap
    """Standard deviations of the corrections there, (rows, columns, 2), px."""

    def __post_init__(self) -> None:
        for name in ("control_px", "sigma_px"):
            object.__setattr__(self, name, unmasked(getattr(self, name), name).astype(np.float64))
        super().__post_init__()
        if not (finite(*self.first_px, *self.step_px) and positive(*self.step_px)):
            raise InputError(
                f"field: expected steps > 0, got {self.step_px} from {self.first_px} on"
            )
        if min(self.control_px.shape[:2]) < LEAST_CONTROLS:
            raise InputError(
                f"field: expected {LEAST_CONTROLS} control points or more along both axes, got "
                f"{self.control_px.shape[1]} × {self.control_px.shape[0]}"
            )
        largest = max(np.abs(values).max() for values in (self.control_px, self.sigma_px))
        if not largest <= MOST_PX:
            raise InputError(
                "field: expected finite control points and standard deviations up to "
                f"{MOST_PX} px, got {largest}"
            )
        if (self.sigma_px < 0).any():
            raise InputError("field: expected standard deviations >= 0")
        steps = [np.abs(np.diff(self.control_px, axis=1 - k)).max() for k in range(2)]
        slope = max(step / apart for step, apart in zip(steps, self.step_px, strict=True))
        if not slope <= MAX_SLOPE:
            raise InputError(
                f"field: expected control points that differ by up to {MAX_SLOPE} of their "
                f"distance, got {slope:.3g}, which would fold the image"
            )
