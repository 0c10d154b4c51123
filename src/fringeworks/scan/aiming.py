"""Brightness, modulation and sharpness of live frames, to aim and focus by; not for measuring."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fringeworks.devices.clock import clock_of
from fringeworks.devices.protocols import Camera, Projector
from fringeworks.patterns.plan import PatternPlan, PhaseSteps, equal_steps
from fringeworks.scan.frames import pictures_of
from fringeworks.scan.saturation import CLIPPED_SHARE, largest_count
from fringeworks.scan.uniform import uniform_picture
from fringeworks.types import BoolMap, CameraSettings, FloatMap, Frozen

Shown = Literal["grey", "fringes"]
FRINGES_ACROSS = 40
"""Fringes over the projector's longer side: short enough to fade where the focus is wrong."""
STEPS = 3
"""Frames of a modulation."""
SETTLING_S = 0.2
"""Time after which a frame shows the new picture: usual projectors and webcams together take 0.05
to 0.15 s. A frame that comes too early makes one modulation wrong, and the next one is right."""
BRIGHT_PERCENTILE = 99.5
"""Brightness that exposures are judged by, percent of the pixels below it."""
MOST_CLIPPED = 0.001
"""Above this share of saturated pixels, the exposure is too long."""
TARGET = 0.85
"""Brightness that is aimed at, share of full scale: with a margin for noise."""
DARK = 0.5
"""Brightness below which a longer exposure is advised, share of full scale."""


@dataclass(frozen=True, eq=False, repr=False)
class Aim(Frozen):
    """What the last frames of a live picture show."""

    brightness: FloatMap
    """Mean of the frames, (h, w), share of full scale."""
    saturated: BoolMap
    """True where a frame reaches the sensor's limit, (h, w)."""
    modulation: FloatMap | None
    """Modulation of the fringes, (h, w), share of full scale; None under even light."""
    level: float
    """Brightness that 0.5 % of the pixels exceed in a frame, share of full scale."""
    sharpness: float
    """Mean difference of neighbouring pixels over the mean brightness: largest in focus."""

    @property
    def contrast(self) -> float | None:
        """Median modulation of the brighter half of the pixels, over their brightness; None under
        even light."""
        if self.modulation is None:
            return None
        bright = self.brightness >= np.median(self.brightness)
        share = self.modulation[bright] / np.maximum(self.brightness[bright], 1e-3)
        return float(np.median(share))

    @property
    def exposure_factor(self) -> float | None:
        """Factor of the exposure that is advised; None where it is good, or too long by an unknown
        factor."""
        clipped = float(self.saturated.mean()) > MOST_CLIPPED
        return None if clipped or self.level >= DARK else TARGET / max(self.level, 1e-3)

    @property
    def advice(self) -> str:
        """What to do about the exposure, in words."""
        share = float(self.saturated.mean())
        if share > MOST_CLIPPED:
            return f"{share:.1%} of the pixels are saturated: halve the exposure"
        if self.exposure_factor is not None:
            return f"dark: the exposure may be {self.exposure_factor:.1f} times as long"
        return "the exposure is good"


def aim(frames: Sequence[NDArray[Any]], full: float) -> Aim:
    """Judge frames of a live picture.

    Parameters
    ----------
    frames : one frame under even light, or three under fringes in steps of a third of a period
        (h, w) arrays, counts.
    full : float
        Largest count of the camera.
    """
    stack = np.stack([np.asarray(frame, np.float32) / np.float32(full) for frame in frames])
    brightest = stack.max(axis=0)
    mean = stack.mean(axis=0)
    modulation = None
    if len(stack) == STEPS:
        phases = np.exp(2j * np.pi * np.arange(STEPS) / STEPS).astype(np.complex64)
        modulation = np.abs(np.tensordot(phases, stack, 1)) * (2.0 / STEPS)
    # The fringes cancel in the mean, so that they are not taken for a sharp picture.
    edges = np.abs(np.diff(mean, axis=1)).mean()
    return Aim(
        brightness=mean,
        saturated=brightest >= CLIPPED_SHARE,
        modulation=modulation,
        level=float(np.percentile(brightest, BRIGHT_PERCENTILE)),
        sharpness=float(edges / max(float(mean.mean()), 1e-3)),
    )


def aiming(
    projector: Projector,
    camera: Camera,
    shown: Shown,
    *,
    level: float = 1.0,
    exposure_ms: float | None = None,
) -> Iterator[Aim]:
    """Show even light or moving fringes, and judge what the camera sees, until the caller stops.

    Parameters
    ----------
    projector : Projector
    camera : Camera
    shown : "grey" or "fringes"
    level : float
        Grey level, 0…1 of full scale.
    exposure_ms : float, optional
        The camera's own by default.

    Yields
    ------
    Aim of every frame; under fringes, of the last three.

    Raises
    ------
    DeviceProblem where frames do not come; InputError for settings that the camera refuses.
    """
    settings = camera.configure(CameraSettings(exposure_ms=exposure_ms, triggered=False))
    clock = clock_of(projector)
    if shown == "grey":
        pictures = [uniform_picture(projector, level)]
    else:
        plan = _fringes(projector)
        pictures = [picture.counts for picture in pictures_of(projector, plan)]
    kept: list[NDArray[Any]] = []
    number = 0
    while True:
        if number < len(pictures) or len(pictures) > 1:
            projector.show(pictures[number % len(pictures)])
            clock.wait_until(clock.now_s() + SETTLING_S)
        number += 1
        camera.discard()
        grab = camera.grab()
        if not grab.complete:
            kept.clear()
            continue
        kept = [*kept, grab.pixels][-len(pictures) :]
        if len(kept) == len(pictures):
            yield aim(kept, largest_count(settings, grab.pixels.dtype))


def _fringes(projector: Projector) -> PatternPlan:
    columns, rows = projector.size_px
    along = PhaseSteps("x", max(columns, rows) / FRINGES_ACROSS, equal_steps(STEPS))
    return PatternPlan(columns, rows, (along,), bits=projector.bits)
