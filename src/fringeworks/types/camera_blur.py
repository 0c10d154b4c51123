"""The blur of a camera by place in its frame and by distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.types.arrays import FloatMap
from fringeworks.types.checks import finite, positive
from fringeworks.types.errors import InputError
from fringeworks.types.frozen import Frozen

BLUR_TERMS = 6
"""Number of terms of a blur: 1, x, y, x² + y², w, w²."""
LEAST_VARIANCE_PX2 = 1.0 / 16.0
"""Smallest variance of a blur, px². Pixels alone, whose light is collected over their whole area,
blur with 1/12; some collect over less."""


@dataclass(frozen=True, eq=False, repr=False)
class CameraBlur(Frozen):
    """Variance of a camera's blur, with that of its pixels, by place and distance.

    It is c₀ + c₁ x + c₂ y + c₃ (x² + y²) + c₄ w + c₅ w², with x and y from the middle of the frame
    in halves of its width, and w = middle/z − 1: a lens blurs in proportion to the difference of
    1/z from where it is in focus. Distances beyond ``depth_mm`` count as its ends.

    Raises
    ------
    InputError for factors that are not six finite numbers, and distances and errors out of range.
    """

    factors_px2: tuple[float, ...]
    """c₀ … c₅, px²."""
    middle_mm: float
    """Distance at which w is 0, mm."""
    depth_mm: tuple[float, float]
    """Nearest and farthest distance z at which it was measured, mm."""
    relative_sigma: float
    """Standard deviation of the variance, as a share of it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.factors_px2) != BLUR_TERMS or not finite(*self.factors_px2):
            raise InputError(f"blur: expected {BLUR_TERMS} finite numbers, got {self.factors_px2}")
        near, far = self.depth_mm
        if not positive(self.middle_mm, near, far) or near > far:
            raise InputError(
                f"blur: expected distances > 0, got {self.middle_mm}, {near} and {far} mm"
            )
        if not finite(self.relative_sigma) or self.relative_sigma < 0:
            raise InputError(f"blur: expected an error >= 0, got {self.relative_sigma}")

    @property
    def middle_px(self) -> float:
        """Standard deviation in the middle of the frame at the middle distance, px."""
        return float(np.sqrt(max(self.factors_px2[0], 0.0)))

    @classmethod
    def everywhere(cls, sigma_px: float, *, relative_sigma: float = 0.0) -> CameraBlur:
        """Return the blur that is the same everywhere, by its standard deviation, px."""
        factors = (float(sigma_px) ** 2, 0.0, 0.0, 0.0, 0.0, 0.0)
        return cls(factors, 1.0, (1.0, 1.0), relative_sigma)

    def variance_px2(self, shape: tuple[int, int], pixels: FloatMap, z_mm: FloatMap) -> FloatMap:
        """Return the variance at pixels (…, 2) of a frame that see points at z (…), px²."""
        terms = blur_terms(shape, pixels, np.clip(z_mm, *self.depth_mm), self.middle_mm)
        least = min(LEAST_VARIANCE_PX2, abs(self.factors_px2[0]))
        return np.asarray(np.maximum(terms @ np.array(self.factors_px2), least))


def blur_terms(
    shape: tuple[int, int], pixels: FloatMap, z_mm: FloatMap, middle_mm: float
) -> FloatMap:
    """Return 1, x, y, x² + y², w and w² of a blur, (…, 6)."""
    half = 0.5 * shape[1]
    x, y = ((pixels[..., k] - 0.5 * (shape[1 - k] - 1)) / half for k in (0, 1))
    w = middle_mm / z_mm - 1.0
    return np.stack((np.ones_like(x), x, y, x * x + y * y, w, w * w), axis=-1)
