"""How many frames of a proposal each axis gets."""

from __future__ import annotations

import math
from collections.abc import Sequence

from fringeworks.types import Axis, InputError


def checked_share(
    frames: int,
    axes: Sequence[Axis],
    noise: float,
    modulation: float,
    band: tuple[float, float],
) -> int:
    """Frames for each axis; refuses arguments that are out of range."""
    if not axes or any(axis not in ("x", "y") for axis in axes):
        raise InputError(f"axes: expected x, y or both, got {', '.join(axes) or 'none'}")
    for name, value in (("noise", noise), ("modulation", modulation)):
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"{name}: expected > 0 counts, got {value}")
    min_period_px, max_period_px = band
    if not min_period_px >= 2:
        raise InputError(f"min_period_px: expected 2 px or more, got {min_period_px}")
    if not max_period_px >= min_period_px:
        raise InputError(
            f"max_period_px: expected {min_period_px:g} px or more, like min_period_px, got "
            f"{max_period_px:g}"
        )
    share = frames // len(axes)
    if share < 3:
        raise InputError(
            f"frames: expected 3 or more for each axis, got {frames} for {len(axes)} axes"
        )
    return share
