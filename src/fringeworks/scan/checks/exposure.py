"""The exposure of the set-up: chosen where the user has not, and proved to obey."""

from __future__ import annotations

from dataclasses import dataclass

from fringeworks.devices.protocols import Camera, Projector
from fringeworks.scan.exposure import TooBright, TooDark, Unsteady, auto_exposure, exposure_in
from fringeworks.scan.exposure_proof import ExposureProof, exposure_obeys
from fringeworks.scan.exposure_range import shorter_ranges
from fringeworks.types import CameraSettings, DeviceProblem, Finding, Frozen, InputError
from fringeworks.types.numbers import number

SELF_WILLED = ("ignored", "automatic")
"""Verdicts of cameras that keep an exposure of their own, so that none can be chosen."""


@dataclass(frozen=True, eq=False, repr=False)
class Exposing(Frozen):
    """The exposure that the tests and all later scans use."""

    settings: CameraSettings
    """Settings of the camera as it reported them."""
    chosen: bool
    """Whether exposure and gain were chosen here; False where they were given, and where the camera
    does not let them be chosen."""
    proof: ExposureProof | None
    """Whether the exposure obeys; None where that cannot be seen."""
    unproved: str
    """Why it cannot be seen whether the exposure obeys; empty where it can."""
    findings: tuple[Finding, ...]


def check_exposure(projector: Projector, camera: Camera, wanted: CameraSettings) -> Exposing:
    """Choose exposure and gain where none is given, and find out whether the camera obeys.

    Parameters
    ----------
    projector : Projector
    camera : Camera
    wanted : CameraSettings
        What the user asks for. With an exposure or a gain, both stay as they are.

    Returns
    -------
    Exposing. The camera is left at its settings.

    Raises
    ------
    DeviceProblem where the camera does not see the projector's pictures.
    """
    before = camera.configure(wanted)
    settings = before
    problem: InputError | None = None
    found: list[Finding] = []
    free = wanted.exposure_ms is None and wanted.gain_db is None
    if free and camera.limits().exposure_ms is not None:
        try:
            settings, bright = _chosen(projector, camera)
            found += [] if bright is None else [_shortened(settings, bright)]
        except (TooDark, TooBright) as error:
            # The camera is at the end of its range, where it sees as much as it can.
            settings, problem = camera.configure(CameraSettings()), error
        except Unsteady as error:
            # The light in time is measured at this exposure, and steady ones are looked for.
            settings, problem = camera.configure(CameraSettings()), error
        except InputError as error:
            settings, problem = _put_back(camera, before), error
    proof, unproved = _proof(projector, camera)
    if proof is None and problem is not None and not isinstance(problem, TooDark | TooBright):
        raise problem
    if proof is not None and proof.verdict in SELF_WILLED:
        settings = _put_back(camera, before)
        return Exposing(settings, False, proof, "", (_disobeys(proof),))
    found += [] if problem is None else [_not_chosen(problem)]
    if proof is not None and not proof.obeyed:
        found.append(_disobeys(proof))
    chosen = settings != before and problem is None
    return Exposing(camera.configure(settings), chosen, proof, unproved, tuple(found))


def _chosen(projector: Projector, camera: Camera) -> tuple[CameraSettings, TooBright | None]:
    """An exposure of whole refresh periods, or a shorter one where these are too bright, and why.

    Whether a shorter one sees the same light in every frame is measured next.

    Raises
    ------
    TooBright of whole periods, at whose shortest exposure the camera is left, where no shorter
    exposure can be chosen.
    """
    if projector.refresh_s is None:
        return auto_exposure(projector, camera, whole_periods=False), None
    try:
        return auto_exposure(projector, camera), None
    except TooBright as error:
        shortest = camera.configure(CameraSettings())
        for allowed in shorter_ranges(projector, camera):
            try:
                return exposure_in(projector, camera, allowed), error
            except TooBright:
                continue
            except InputError:
                break  # the light changes from frame to frame
        camera.configure(CameraSettings(shortest.exposure_ms, shortest.gain_db))
        raise error


def _proof(projector: Projector, camera: Camera) -> tuple[ExposureProof | None, str]:
    """The proof that the exposure obeys, or why there is none."""
    try:
        return exposure_obeys(projector, camera), ""
    except DeviceProblem as error:
        # Where the room is bright, half and double the exposure are too dark or too bright.
        return None, str(error)
    except InputError:
        return None, "another program sets the exposure"


def _put_back(camera: Camera, before: CameraSettings) -> CameraSettings:
    """Set exposure and gain to what they were, and return all settings."""
    return camera.configure(CameraSettings(exposure_ms=before.exposure_ms, gain_db=before.gain_db))


def _disobeys(proof: ExposureProof) -> Finding:
    """The finding of a camera whose exposure does not obey."""
    ratio = f"the light changed {proof.ratio:.2f} times instead of {proof.expected_ratio:.2f} times"
    seen, causes = {
        "ignored": (
            f"the camera ignores its exposure: {ratio}",
            ("a driver that accepts an exposure and keeps its own",),
        ),
        "automatic": (
            f"an automatic exposure is on: {proof.drift:.0%} of every change of brightness is "
            "taken back",
            (
                "automatic exposure or gain in the camera's settings",
                "a driver that cannot switch it off",
            ),
        ),
        "another ratio": (
            f"the brightness follows the exposure by another ratio: {ratio}",
            ("a driver that rounds exposures", "a response with a gamma"),
        ),
    }[proof.verdict]
    return Finding(
        "exposure",
        seen,
        causes,
        "set the exposure with the camera's own program, or use another driver or camera",
        figures={
            "expected_ratio": proof.expected_ratio,
            "ratio": proof.ratio,
            "drift": proof.drift,
        },
        severity="error",
    )


def _shortened(settings: CameraSettings, bright: TooBright) -> Finding:
    """The finding that whole refresh periods are too bright, and what was chosen."""
    shown = number(settings.exposure_ms or float("nan"), digits=4)
    return Finding(
        "exposure",
        f"{shown} ms was chosen, less than a refresh period of the projector, which is too bright "
        f"({str(bright).partition(': too bright')[0]})",
        ("a projector too bright or too near", "lamps in the room"),
        "close the aperture or darken the room to expose for whole refresh periods, whatever the "
        "projector's light does within them",
        figures={"exposure_ms": settings.exposure_ms or float("nan")},
        severity="note",
    )


def _not_chosen(problem: InputError) -> Finding:
    """The finding that no good exposure exists or could be found."""
    seen = str(problem)
    if isinstance(problem, TooDark):
        return Finding(
            "dark",
            seen.partition(": too dark")[0],
            ("a projector too dim or too far away", "a dark object", "a small aperture"),
            "open the aperture, move the devices closer, use a brighter lamp, or darken the room",
        )
    if isinstance(problem, TooBright):
        return Finding(
            "saturated",
            seen.partition(": too bright")[0],
            ("a projector too bright or too near", "lamps in the room", "a shiny object"),
            "close the aperture, dim the projector, or move the devices away",
        )
    return Finding(
        "exposure",
        f"no exposure could be chosen: {seen}",
        ("light that flickers", "something that moves", "an automatic exposure or gain"),
        "switch off lamps and automatic exposure, or set an exposure by hand",
    )
