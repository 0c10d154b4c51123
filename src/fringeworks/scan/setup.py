"""The set-up: what a projector and a camera can do together, and which plan suits them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from fringeworks.devices.protocols import Camera, Projector, VideoMode, video_mode_of
from fringeworks.files.setup import StoredSetup
from fringeworks.patterns.gray_code import finest_cell
from fringeworks.patterns.propose import Proposal, propose
from fringeworks.scan.agreement import Agreement
from fringeworks.scan.checks.exposure import Exposing, check_exposure
from fringeworks.scan.checks.flicker import MIN_FLICKER, Flicker, check_flicker
from fringeworks.scan.checks.frames import check_frames
from fringeworks.scan.checks.levels import Levels, check_levels
from fringeworks.scan.checks.orientation import Orientation, check_orientation
from fringeworks.scan.checks.pixel_grid import PixelGrid, check_pixel_grid
from fringeworks.scan.checks.rhythm import Rhythm, check_rhythm
from fringeworks.scan.checks.stripes import Stripes, check_stripes
from fringeworks.scan.checks.video_mode import check_video_mode
from fringeworks.scan.checks.vignetting import Vignetting, check_vignetting
from fringeworks.scan.delay import measure_delay
from fringeworks.types import (
    Axis,
    CameraNoise,
    CameraSettings,
    Delay,
    DeviceProblem,
    Finding,
    FloatMap,
    Frozen,
    InputError,
    explained,
)

DARK_QUANTILE = 0.1
"""Quantile of the modulation over the lit pixels that a plan is proposed for: nine of ten pixels
are brighter."""
STEADY_KINDS = ("range", "scale", "averaged", "compressed")
"""Findings that compare the light of several frames: they mean nothing where it flickers."""
IMPORTANCE = (
    "mirrored",
    "saturated",
    "dark",
    "range",
    "scale",
    "contrast",
    "room",
    "exposure",
    "flicker",
    "averaged",
    "compressed",
    "pixel grid",
    "ramp",
    "vignetting",
    "delay",
)
"""Kinds of findings, the most important first: what makes results wrong, then what adds errors,
then what costs light or time."""
DELAY_ADVICE = (
    "scans take frames by agreement, which needs no delay; use a camera with a steady frame rate"
)
"""What to do where the delay cannot be measured."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SetupTests(Frozen):
    """What the tests of a set-up have measured; None where a test was not reached."""

    projector: str
    """Name of the projector."""
    camera: str
    """Name of the camera."""
    size_px: tuple[int, int]
    """Columns and rows of the projector."""
    mode: VideoMode | None = None
    """How the projector shows pictures; None where it does not tell."""
    exposing: Exposing | None = None
    rhythm: Rhythm | None = None
    """None also where the light of the room flickers."""
    flicker: Flicker | None = None
    noise: CameraNoise | None = None
    """Noise of the camera at the settings of ``exposing``."""
    levels: Levels | None = None
    orientation: Orientation | None = None
    stripes: tuple[Stripes, ...] = ()
    """Along x, then along y."""
    vignetting: Vignetting | None = None
    pixel_grid: PixelGrid | None = None
    """None also where too little of the frame is lit."""
    delay: Delay | None = None
    """None also where it could not be measured, and where the light is not steady."""
    findings: tuple[Finding, ...] = ()
    """What makes measurements worse, the most important first; empty where all is well."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Setup(SetupTests):
    """What was measured of a projector and a camera, and the plan that suits them."""

    exposing: Exposing
    flicker: Flicker
    noise: CameraNoise
    levels: Levels
    orientation: Orientation
    vignetting: Vignetting
    proposal: Proposal
    """The plan that is proposed for these devices, with its predicted error."""

    @property
    def finest_cell_px(self) -> int | None:
        """Width of the finest Gray-code cells that the camera resolves, projector px; None where it
        resolves none."""
        modulation = dark_modulation(self.levels)
        ratio = float(np.sqrt(self.noise.variance(modulation))) / modulation
        pixel, blur = _optics(self.stripes)
        return None if pixel is None else finest_cell(pixel, blur, ratio)

    @property
    def settings(self) -> CameraSettings:
        """Settings of the camera, as it reported them."""
        return self.exposing.settings

    def stored(self, projector: str, camera: str) -> StoredSetup:
        """What a file holds of the set-up.

        Parameters
        ----------
        projector, camera : str
            Words that open the devices; see ``open_devices``.
        """
        pixel, blur = _optics(self.stripes)
        return StoredSetup(
            projector=projector,
            camera=camera,
            projector_name=self.projector,
            camera_name=self.camera,
            settings=self.settings,
            noise=self.noise,
            delay=self.delay,
            plan=self.proposal.plan,
            predicted_sigma_px=self.proposal.sigma_px,
            findings=self.findings,
            size_px=self.size_px,
            min_period_px=max(s.min_period_px for s in self.stripes),
            camera_pixel_px=pixel,
            blur_px=blur,
            modulation=dark_modulation(self.levels),
            gamma=self.levels.gamma,
            contrast=self.levels.contrast,
            black_counts=float(self.levels.brightness[0]),
        )


class SetupStopped(DeviceProblem):
    """A set-up could not be finished. Its findings name the causes.

    Parameters
    ----------
    message : str
    tests : SetupTests
        What was measured until then.
    """

    def __init__(self, message: str, tests: SetupTests) -> None:
        super().__init__(message, findings=tests.findings)
        self.tests = tests


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
        Asked for before the first frame. Without an exposure and a gain, both are chosen so that
        white is bright and not saturated.
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
    SetupStopped (a DeviceProblem) where a test cannot be done, such as where the camera does not
    see the projector's pictures, and where no plan suits the devices. It holds what was measured
    until then.
    """
    tests = _Tests(projector, camera)
    try:
        tests.run(settings or CameraSettings(), progress)
    except DeviceProblem as error:
        message = _with_rhythm(str(error), tests.done)
        raise explained(SetupStopped(message, tests.done), error.findings) from error
    done = tests.done
    try:
        proposal = _proposed(done, frames, axes)
    except InputError as error:
        raise explained(SetupStopped(str(error), done), error.findings) from error
    return Setup(
        **{f.name: getattr(done, f.name) for f in fields(done)},
        proposal=proposal,
    )


def _with_rhythm(message: str, done: SetupTests) -> str:
    """The message of a test that cannot be done, with light that is not steady named first."""
    found = [] if done.rhythm is None else [f for f in done.rhythm.findings if f.rank]
    return f"flicker: {found[0].seen}; {found[0].advice}; besides, {message}" if found else message


class _Tests:
    """The tests in their order, and what those that are done have measured."""

    def __init__(self, projector: Projector, camera: Camera) -> None:
        self._projector = projector
        self._camera = camera
        self._agreement = Agreement(projector, camera)
        mode = video_mode_of(projector)
        self.done = SetupTests(
            projector=projector.name,
            camera=camera.name,
            size_px=projector.size_px,
            mode=mode,
            findings=check_video_mode(mode),
        )

    def run(self, wanted: CameraSettings, progress: Callable[[str], None]) -> None:
        """Do all tests; ``DeviceProblem`` where one cannot be done."""
        projector, camera, agreement = self._projector, self._camera, self._agreement
        progress("exposure")
        exposing = check_exposure(projector, camera, wanted)
        self._add(exposing.findings, exposing=exposing)
        if exposing.proof is not None and exposing.proof.verdict == "automatic":
            raise DeviceProblem(
                f"{camera.name}: expected an exposure that stays, got an automatic one: the other "
                "tests compare the light of several pictures"
            )
        progress("flicker")
        flicker = check_flicker(projector, camera)
        exposing = self._follow_light(exposing, flicker, progress)
        progress("grey levels")
        levels = check_levels(projector, camera, agreement, exposing.settings)
        found = (*levels.findings, *check_frames(agreement.noise))
        self._add(found, levels=levels, noise=agreement.noise.usual)
        progress("orientation")
        seen = check_orientation(projector, camera, agreement, gamma=levels.gamma)
        self._add(seen.findings, orientation=seen)
        places: tuple[tuple[Axis, FloatMap], ...] = (("x", seen.x_px), ("y", seen.y_px))
        for axis, place in places:
            progress(f"stripes along {axis}")
            stripes = check_stripes(projector, agreement, levels.lit, place, axis=axis)
            self._add(stripes.findings, stripes=(*self.done.stripes, stripes))
        progress("vignetting")
        vignetting = check_vignetting(projector.size_px, levels, seen, agreement.noise.usual)
        self._add(vignetting.findings, vignetting=vignetting)
        progress("pixel grid")
        grid = check_pixel_grid(levels, seen)
        self._add(() if grid is None else grid.findings, pixel_grid=grid)
        if self.done.rhythm is not None and any(f.rank for f in self.done.rhythm.findings):
            return  # fast scans at this exposure are refused
        progress("delay")
        self._measure_delay()

    def _follow_light(
        self, exposing: Exposing, flicker: Flicker, progress: Callable[[str], None]
    ) -> Exposing:
        """Measure the light in time, and return the exposure with a safe one where it needs one."""
        if flicker.in_black > MIN_FLICKER and flicker.findings:
            # The light of the room hides changes of the projector's.
            self._add(flicker.findings, flicker=flicker)
            return exposing
        progress("light in time")
        rhythm = check_rhythm(self._projector, self._camera, free=exposing.chosen)
        if rhythm.settings is not None:
            exposing = replace(exposing, settings=rhythm.settings)
        # Changes under white are those of the rhythm.
        found = rhythm.findings or flicker.findings
        self._add(found, flicker=flicker, rhythm=rhythm, exposing=exposing)
        return exposing

    def _measure_delay(self) -> None:
        try:
            self._add((), delay=measure_delay(self._projector, self._camera))
        except DeviceProblem as error:
            causes = ("frames that arrive irregularly", "a delay that changes")
            self._add((Finding("delay", str(error), causes, DELAY_ADVICE, severity="note"),))

    def _add(self, findings: tuple[Finding, ...], **measured: Any) -> None:
        """Keep what a test has measured, and what it has found."""
        found = _kept((*self.done.findings, *findings))
        self.done = replace(self.done, findings=found, **measured)


def _kept(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """The findings that hold beside the others, those of one cause in one, by importance."""
    kinds = {finding.kind for finding in findings}
    kept: dict[tuple[str, str], Finding] = {}
    for new in findings:
        # Light that flickers changes levels and contrast from picture to picture.
        if new.kind in STEADY_KINDS and "flicker" in kinds:
            continue
        # Where the camera resolves projector pixels, the contrast of stripes beats with them.
        if new.kind == "scale" and "pixel grid" in kinds:
            continue
        if new.kind == "saturated" and any(kind == new.kind for kind, _ in kept):
            # No exposure is short enough; that pixels are saturated follows.
            continue
        key = new.kind, new.advice
        if key in kept:
            # Stripes along x and along y.
            old = kept[key]
            new = replace(
                old, seen=f"{old.seen}, and {new.seen}", figures=old.figures | new.figures
            )
        kept[key] = new
    return tuple(sorted(kept.values(), key=lambda finding: IMPORTANCE.index(finding.kind)))


def dark_modulation(levels: Levels) -> float:
    """Return the modulation of fringes at the darkest tenth of the lit pixels, counts."""
    return 0.5 * float(np.quantile(levels.white[levels.lit], DARK_QUANTILE))


def _proposed(done: SetupTests, frames: int, axes: tuple[Axis, ...]) -> Proposal:
    """The plan with the smallest predicted error for the darkest tenth of the lit pixels."""
    assert done.levels is not None
    assert done.noise is not None
    modulation = dark_modulation(done.levels)
    pixel, blur = _optics([s for s in done.stripes if s.axis in axes])
    return propose(
        *done.size_px,
        frames,
        axes=axes,
        noise=float(np.sqrt(done.noise.variance(modulation))),
        modulation=modulation,
        min_period_px=max(s.min_period_px for s in done.stripes if s.axis in axes),
        camera_pixel_px=pixel,
        blur_px=blur,
    )[0]


def _optics(stripes: Sequence[Stripes]) -> tuple[float | None, float]:
    """Size of a camera pixel, projector px, and blur, camera px, along the axis where they take
    most; None and 0 where they are not known."""
    widest = max(stripes, key=lambda s: s.camera_pixel_px * float(np.hypot(s.blur_px, 12.0**-0.5)))
    if not widest.camera_pixel_px > 0:
        return None, 0.0
    return widest.camera_pixel_px, widest.blur_px
