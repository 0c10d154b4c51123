"""Brightness of the scene under black and white, at known settings of the camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.devices.protocols import Camera, Projector
from fringeworks.scan.agreement import Agreement
from fringeworks.scan.saturation import CLIPPED_SHARE, largest_count
from fringeworks.types import BoolMap, CameraSettings, FloatMap, Frozen

LIT_SIGMAS = 5.0
"""Rise from black to white from which on a pixel counts as lit, in standard deviations of its
noise: noise alone reaches it in one pixel of three million."""
BORDER_SHARE = 0.01
"""Width of the borders of lit regions that do not decide about exposures, share of the frame's
rows. There surfaces turn away from the light and blur mixes in the dark background: the rim of a
ball would ask for ten times the light of its middle."""
INSIDE_SHARE = 0.9
"""Share of lit pixels around a pixel, within the width of a border, from which on it lies inside:
single dark pixels do not make a border."""
LEAST_INSIDE = 100
"""Smallest number of pixels inside. Where there are fewer, all lit pixels decide."""


@dataclass(frozen=True, eq=False, repr=False)
class Brightness(Frozen):
    """What the camera sees under black and white."""

    settings: CameraSettings
    """Settings of the camera."""
    black: FloatMap
    """Frame under black, (h, w), shares of full scale; of colours the brightest channel."""
    white: FloatMap
    """Frame under white, (h, w), shares of full scale; of colours the brightest channel."""
    lit: BoolMap
    """True where white is brighter than black by more than noise, (h, w)."""
    full: float
    """Largest count of the camera."""

    @property
    def saturated(self) -> BoolMap:
        """True where white reaches the sensor's limit, (h, w)."""
        return np.asarray(self.white >= CLIPPED_SHARE)

    @property
    def amount(self) -> float:
        """Exposure times gain, ms; brightness is proportional to it."""
        return amount_of(self.settings)


def amount_of(settings: CameraSettings) -> float:
    """Return exposure times gain, ms; an unknown exposure counts as 1 ms, no gain as 0 dB."""
    return float((settings.exposure_ms or 1.0) * 10.0 ** ((settings.gain_db or 0.0) / 20.0))


def measure_brightness(
    projector: Projector, camera: Camera, settings: CameraSettings
) -> Brightness:
    """Show black and white, and grab a frame of each.

    Parameters
    ----------
    projector : Projector
    camera : Camera
    settings : CameraSettings
        The camera's present settings, for the result.

    Raises
    ------
    DeviceProblem where white is not brighter than black, or frames do not come.
    """
    agreement = Agreement(projector, camera)
    grabs = agreement.start()
    black, white = (brightest_channel(grab.pixels).astype(np.float64) for grab in grabs)
    noise = agreement.noise.usual.variance(black) + agreement.noise.usual.variance(white)
    full = largest_count(settings, grabs[0].pixels.dtype)
    lit = white - black > LIT_SIGMAS * np.sqrt(noise)
    return Brightness(settings, black / full, white / full, lit, full)


def brightest_channel(frame: NDArray[Any]) -> NDArray[Any]:
    """Return a grey frame as it is, and of one in colours the brightest channel of each pixel."""
    return frame if frame.ndim == 2 else np.asarray(frame.max(axis=-1))


def light_per_ms(seen: Sequence[Brightness]) -> tuple[FloatMap, BoolMap]:
    """Combine the brightness at several settings into that of every lit pixel, without borders.

    Parameters
    ----------
    seen : sequence of Brightness

    Returns
    -------
    light : (k,) array
        Share of full scale per ms under white at 0 dB of the lit pixels inside their borders; of
        saturated ones a lower bound.
    bounded : (k,) bool array
        True where a pixel is saturated in all of them.
    """
    lit = np.any([b.lit for b in seen], axis=0)
    light = np.full(lit.shape, np.nan)
    bounded = np.ones(lit.shape, bool)
    for one in sorted(seen, key=lambda b: b.amount):
        usable = ~one.saturated
        # Longer exposures have less noise, and replace shorter ones while they are not saturated.
        light = np.where(usable | np.isnan(light), one.white / one.amount, light)
        bounded &= ~usable
    inside = _inside(lit)
    return light[inside], bounded[inside]


def _inside(lit: BoolMap) -> BoolMap:
    """Lit pixels that are surrounded by lit pixels; all of them where those are too few."""
    side = 1 + 2 * int(np.ceil(BORDER_SHARE * lit.shape[0]))
    share = scipy.ndimage.uniform_filter(lit.astype(np.float64), side, mode="nearest")
    inside = lit & (share >= INSIDE_SHARE)
    return np.asarray(inside if np.count_nonzero(inside) >= LEAST_INSIDE else lit)
