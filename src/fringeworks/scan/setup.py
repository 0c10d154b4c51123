"""The set-up: what a projector and a camera can do together, and which plan suits them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fringeworks.devices.protocols import Camera, Projector
from fringeworks.patterns.propose import Proposal, propose
from fringeworks.scan.agreement import Agreement
from fringeworks.scan.checks.finding import SetupFinding
from fringeworks.scan.checks.flicker import Flicker, check_flicker
from fringeworks.scan.checks.levels import Levels, check_levels
from fringeworks.scan.checks.orientation import Orientation, check_orientation
from fringeworks.scan.checks.stripes import Stripes, check_stripes
from fringeworks.scan.delay import Delay, measure_delay
from fringeworks.scan.exposure_proof import ExposureProof, exposure_obeys
from fringeworks.types import (
    Axis,
    CameraNoise,
    CameraSettings,
    DeviceProblem,
    FloatMap,
    Frozen,
)

DARK_QUANTILE = 0.1
"""Quantile of the modulation over the lit pixels that a plan is proposed for: nine of ten pixels
are brighter."""
STEADY_KINDS = ("range", "scale")
"""Findings that compare the light of several pictures: they mean nothing where it flickers."""
DELAY_ADVICE = (
    "scans take frames by agreement, which needs no delay; use a camera with a steady frame rate"
)
"""What to do where the delay cannot be measured."""


@dataclass(frozen=True, eq=False, repr=False)
class Setup(Frozen):
    """What was measured of a projector and a camera."""

    projector: str
    """Name of the projector."""
    camera: str
    """Name of the camera."""
    size_px: tuple[int, int]
    """Columns and rows of the projector."""
    settings: CameraSettings
    """Settings of the camera, as it reported them."""
    noise: CameraNoise
    """Noise of the camera at these settings."""
    levels: Levels
    flicker: Flicker
    orientation: Orientation
    stripes: tuple[Stripes, ...]
    """Along x, then along y."""
    delay: Delay | None
    """None where it could not be measured."""
    proposal: Proposal
    """The plan that is proposed for these devices, with its predicted error."""
    findings: tuple[SetupFinding, ...]
    """What makes measurements worse, the most important first; empty where all is well."""


def set_up(
    projector: Projector,
    camera: Camera,
    *,
    settings: CameraSettings | None = None,
    frames: int = 12,
    axes: tuple[Axis, ...] = ("x",),
    progress: Callable[[str], None] = lambda _: None,
) -> Setup:
    """Measure what a projector and a camera can do together.

    Parameters
    ----------
    projector : Projector
    camera : Camera
        Both look at a bright surface, such as a white wall or the object.
    settings : CameraSettings, optional
        Asked for before the first frame.
    frames : int
        Number of frames of the plan that is proposed.
    axes : tuple of "x", "y"
        Axes of that plan.
    progress : callable
        Called with the name of every check before it begins.

    Returns
    -------
    Setup

    Raises
    ------
    DeviceProblem where the camera does not see the projector's pictures; InputError where no plan
    suits the devices.
    """
    used = camera.configure(settings or CameraSettings())
    agreement = Agreement(projector, camera)
    progress("exposure")
    proof = exposure_obeys(projector, camera)
    progress("flicker")
    flicker = check_flicker(projector, camera)
    found = [*_exposure_finding(proof), *flicker.findings]
    try:
        progress("grey levels")
        levels = check_levels(projector, camera, agreement, used)
        progress("orientation")
        orientation = check_orientation(projector, camera, agreement)
        progress("stripes")
        stripes = _stripes(projector, agreement, levels, orientation)
    except DeviceProblem as error:
        raise _explained(error, found) from error
    of_light = [*levels.findings, *(finding for s in stripes for finding in s.findings)]
    if flicker.findings:
        # Light that flickers changes levels and contrast from picture to picture.
        of_light = [finding for finding in of_light if finding.kind not in STEADY_KINDS]
    progress("delay")
    delay, late = _delay(projector, camera)
    return Setup(
        projector.name,
        camera.name,
        projector.size_px,
        used,
        agreement.noise,
        levels,
        flicker,
        orientation,
        stripes,
        delay,
        _proposed(projector.size_px, frames, axes, agreement.noise, levels, stripes),
        (*orientation.findings, *of_light, *found, *late),
    )


def _exposure_finding(proof: ExposureProof) -> list[SetupFinding]:
    """The finding of a camera whose exposure does not obey."""
    if proof.obeyed:
        return []
    causes = {
        "ignored": ("a driver that accepts an exposure and keeps its own",),
        "automatic": ("an automatic exposure or gain that is on",),
        "another ratio": ("a driver that rounds exposures", "a response with a gamma"),
    }[proof.verdict]
    return [
        SetupFinding(
            "exposure",
            str(proof).partition(":")[0],
            causes,
            "set the exposure with the camera's own program, or use another driver or camera",
            {"expected_ratio": proof.expected_ratio, "ratio": proof.ratio, "drift": proof.drift},
        )
    ]


def _stripes(
    projector: Projector, agreement: Agreement, levels: Levels, orientation: Orientation
) -> tuple[Stripes, ...]:
    """Stripes along x and along y."""
    places: tuple[tuple[Axis, FloatMap], ...] = (("x", orientation.x_px), ("y", orientation.y_px))
    return tuple(
        check_stripes(projector, agreement, levels.lit, place, axis=axis) for axis, place in places
    )


def _proposed(
    size_px: tuple[int, int],
    frames: int,
    axes: tuple[Axis, ...],
    noise: CameraNoise,
    levels: Levels,
    stripes: tuple[Stripes, ...],
) -> Proposal:
    """The plan with the smallest predicted error for the darkest tenth of the lit pixels."""
    modulation = 0.5 * float(np.quantile(levels.white[levels.lit], DARK_QUANTILE))
    return propose(
        *size_px,
        frames,
        axes=axes,
        noise=float(np.sqrt(noise.variance(modulation))),
        modulation=modulation,
        min_period_px=max(s.min_period_px for s in stripes if s.axis in axes),
    )[0]


def _explained(error: DeviceProblem, findings: list[SetupFinding]) -> DeviceProblem:
    """The error of a check, with what the checks before have found."""
    return DeviceProblem("; ".join([str(error), *(finding.text for finding in findings)]))


def _delay(projector: Projector, camera: Camera) -> tuple[Delay | None, list[SetupFinding]]:
    """The delay, or the finding that it cannot be measured."""
    try:
        return measure_delay(projector, camera), []
    except DeviceProblem as error:
        causes = ("frames that arrive irregularly", "a delay that changes")
        return None, [SetupFinding("delay", str(error), causes, DELAY_ADVICE)]
