"""The rhythm of the projector's light, and the exposures that it leaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.devices.protocols import Camera, Projector
from fringeworks.scan.rhythm import (
    LEAST_RIPPLE,
    MOST_RIPPLE,
    Ripple,
    measure_ripple,
    ripple_words,
    safe_period,
    safe_settings,
)
from fringeworks.types import CameraSettings, Finding, Frozen

WHITE_SHARE = 0.5
"""Change under white, over the largest under a grey, from which on the light itself changes. Below,
only the greys do, because they are made of pulses."""


@dataclass(frozen=True, eq=False, repr=False)
class Rhythm(Frozen):
    """How steady the projector's light is at the exposure of the set-up."""

    ripple: Ripple
    """At the exposure that was found or given."""
    tried: tuple[Ripple, ...]
    """At other exposures; empty where the light is steady."""
    period_ms: float | None
    """Exposures that are multiples of this are safe, ms; None where the light is steady, and where
    no safe one was found."""
    settings: CameraSettings | None
    """Settings with a safe exposure, which replace the chosen ones; None where those stay."""
    findings: tuple[Finding, ...]


def check_rhythm(projector: Projector, camera: Camera, *, free: bool) -> Rhythm:
    """Measure the light in time, and look for safe exposures where it is not steady.

    Parameters
    ----------
    projector : Projector
    camera : Camera
        At the exposure of the set-up.
    free : bool
        Whether another exposure may be chosen.

    Returns
    -------
    Rhythm. The camera is left at its settings, or at the new ones.

    Raises
    ------
    DeviceProblem where frames do not come.
    """
    present = camera.configure(CameraSettings())
    ripple = measure_ripple(projector, camera)
    if ripple.steady or not np.isfinite(ripple.depth):
        return Rhythm(ripple, (), None, None, ())
    period_ms, tried = safe_period(projector, camera, ripple)
    settings = None
    if free and period_ms is not None:
        wanted = safe_settings(camera, present, period_ms)
        settings = None if wanted is None else camera.configure(wanted)
    chosen_ms = None if settings is None else settings.exposure_ms
    found = _finding(ripple, tried, period_ms, chosen_ms)
    return Rhythm(ripple, tried, period_ms, settings, (found,))


def _finding(
    ripple: Ripple, tried: tuple[Ripple, ...], period_ms: float | None, chosen_ms: float | None
) -> Finding:
    pulses = ("a projector that makes greys of pulses (DMD)", "dithering over several pictures")
    turns = ("a colour wheel", "black frames between pictures, or a backlight that pulses")
    white = ripple.white > WHITE_SHARE * ripple.depth
    figures = {"depth_share": ripple.depth, "exposure_ms": ripple.exposure_ms}
    if period_ms is not None:
        figures["period_ms"] = period_ms
    seen = f"the light under {ripple.picture} changes from frame to frame by {ripple}"
    if len(tried) > 1:
        seen += f" (by exposure: {ripple_words(tried)})"
    if chosen_ms is not None:
        seen += f", so that {chosen_ms:.4g} ms was chosen"
    return Finding(
        "flicker",
        seen,
        (*turns, *pulses) if white else (*pulses, *turns),
        _advice(period_ms),
        figures=figures,
        severity="note" if chosen_ms is not None or ripple.depth <= MOST_RIPPLE else "warning",
    )


def _advice(period_ms: float | None) -> str:
    if period_ms is None:
        return (
            "no exposure was found at which the light is steady: expose for whole refresh periods, "
            "and close the aperture or dim the projector where that is too bright"
        )
    return (
        f"expose for {period_ms:.4g} ms or multiples of it, at which the light changes by less "
        f"than {LEAST_RIPPLE:.1%}"
    )
