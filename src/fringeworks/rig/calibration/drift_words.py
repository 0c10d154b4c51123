"""Causes of a rig's drift, in words."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fringeworks.rig.calibration.drift_fits import ROTATION, TRANSLATION, Fit
from fringeworks.rig.calibration.parameters import DEVICE_SIZE
from fringeworks.types import FloatMap, Rig

SIGMA_DIGITS = 2
"""Digits of a standard deviation that are shown; more would not be known."""
MAX_DIGITS = 6
"""Largest number of decimals that are shown."""


@dataclass(frozen=True)
class Cause:
    """A change of a rig that explains what was seen."""

    name: str
    """Short name: rotation, translation, baseline, camera focus, projector focus or pose."""
    text: str
    """The change with its size and standard deviation."""


def cause_of(name: str, rig: Rig, fit: Fit) -> Cause:
    """Describe a fitted change of a rig."""
    if name == "rotation":
        return Cause(name, f"the projector {_turn(fit)}")
    if name == "translation":
        return Cause(name, f"the projector {_shift(fit)}")
    if name == "baseline":
        along = rig.T_projector_camera[:3, 3] / rig.baseline_mm
        share = 100.0 * float(fit.change[TRANSLATION] @ along) / rig.baseline_mm
        sigma = 100.0 * _sigma(fit, TRANSLATION, along) / rig.baseline_mm
        return Cause(
            name,
            f"the baseline became {with_sigma(abs(share), sigma)} % "
            f"{'longer' if share > 0 else 'shorter'}, or the board's squares are so much "
            f"{'smaller' if share > 0 else 'larger'} than stated",
        )
    if name == "pose":
        return Cause(name, f"the projector {_turn(fit)}, and {_shift(fit)}")
    device, first = ("camera", 0) if name == "camera focus" else ("projector", DEVICE_SIZE)
    focal = (rig.camera if first == 0 else rig.projector).focal_px[0]
    share = 100.0 * float(fit.change[first]) / focal
    sigma = 100.0 * float(np.sqrt(fit.covariance[first, first])) / focal
    return Cause(
        name,
        f"the {device} was refocused: its focal length is {with_sigma(abs(share), sigma)} % "
        f"{'longer' if share > 0 else 'shorter'}",
    )


def _turn(fit: Fit) -> str:
    omega = np.degrees(fit.change[ROTATION])
    size = float(np.linalg.norm(omega))
    sigma = np.degrees(_sigma(fit, ROTATION, omega / size))
    shares = ", ".join(f"{axis} {value:+.3f}°" for axis, value in zip("xyz", omega, strict=True))
    return (
        f"turned against the camera by {with_sigma(size, sigma)}° (about the projector's axes "
        f"{shares})"
    )


def _shift(fit: Fit) -> str:
    shift = fit.change[TRANSLATION]
    size = float(np.linalg.norm(shift))
    sigma = _sigma(fit, TRANSLATION, shift / size)
    shares = ", ".join(f"{axis} {value:+.2f} mm" for axis, value in zip("xyz", shift, strict=True))
    return f"moved against the camera by {with_sigma(size, sigma)} mm ({shares})"


def with_sigma(value: float, sigma: float) -> str:
    """A value and its standard deviation, as many digits as that says."""
    place = math.floor(math.log10(sigma)) if sigma > 0 else -MAX_DIGITS
    digits = min(max(SIGMA_DIGITS - 1 - place, 0), MAX_DIGITS)
    return f"{value:.{digits}f} ± {sigma:.{digits}f}"


def _sigma(fit: Fit, part: slice, along: FloatMap) -> float:
    """Standard deviation of a part of the change along a unit vector."""
    return math.sqrt(max(float(along @ fit.covariance[part, part] @ along), 0.0))
