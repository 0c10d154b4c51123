"""Refuses frames in which the surface is saturated, before they are kept."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.devices.pixel_formats import full_scale
from fringeworks.devices.protocols import Camera
from fringeworks.types import CameraSettings, DeviceProblem, InputError

MOST_SATURATED = 0.5
"""Largest share of the lit pixels that may be saturated by default. Highlights and white parts
saturate a few per cent of a usual scene; where it is half of it, the exposure is wrong."""
LIT_SHARE = 0.04
"""Change of a pixel between the frames from which on it counts as lit, share of full scale: less
modulation is too weak to be decoded."""
CLIPPED_SHARE = 0.985
"""Share of full scale from which on a sample counts as saturated. Pixels of a sensor clip at
slightly different counts, and noise hides clipping just below full scale."""


class SaturationGuard:
    """Counts the lit pixels that are saturated in any of the frames that it sees.

    Parameters
    ----------
    camera : Camera
    most : float
        Largest share of the lit pixels that may be saturated, 0…1.
    """

    def __init__(self, camera: Camera, most: float = MOST_SATURATED) -> None:
        if not 0 <= most <= 1:
            raise InputError(f"most_saturated: expected 0 to 1, got {most}")
        self._camera = camera
        self._most = most

    def check(self, frames: Iterable[NDArray[Any]]) -> None:
        """Refuse frames of one scene under changing light if too many pixels are saturated.

        Parameters
        ----------
        frames : iterable of (h, w) arrays of counts
            The brightest and the darkest frame of every pixel must be among them.

        Raises
        ------
        DeviceProblem with the share of saturated pixels.
        """
        if self._most >= 1:
            return
        darkest: NDArray[Any] | None = None
        brightest: NDArray[Any] | None = None
        for frame in frames:
            darkest = frame if darkest is None else np.minimum(darkest, frame)
            brightest = frame if brightest is None else np.maximum(brightest, frame)
        if darkest is None or brightest is None:
            return
        full = largest_count(self._camera.configure(CameraSettings()), brightest.dtype)
        share = saturated_share(darkest, brightest, full)
        if share > self._most:
            raise DeviceProblem(
                f"{self._camera.name}: expected at most {self._most:.0%} of the lit pixels to be "
                f"saturated, got {share:.0%}: expose for a shorter time, lower the gain, or take "
                "several exposures (HDR)"
            )


def saturated_share(darkest: NDArray[Any], brightest: NDArray[Any], full: float) -> float:
    """Return the share of the lit pixels that are saturated in the brighter frame.

    Parameters
    ----------
    darkest, brightest : (h, w) arrays of counts
    full : float
        Largest count of the camera.
    """
    lit = brightest.astype(np.float32) - darkest > LIT_SHARE * full
    return float(np.mean(brightest[lit] >= CLIPPED_SHARE * full)) if lit.any() else 0.0


def largest_count(settings: CameraSettings, kind: np.dtype[Any]) -> float:
    """Return the largest count, by the pixel format or the type of the frames."""
    if settings.pixel_format is not None:
        return float(full_scale(settings.pixel_format))
    return float(np.iinfo(kind).max)
