"""Captures: the frames of a plan in a folder, each on the disk as soon as it is taken."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

from fringeworks.devices.pixel_formats import full_scale
from fringeworks.devices.protocols import Camera, Projector
from fringeworks.files.atomic import StrPath
from fringeworks.files.capture_writer import (
    refuse_replacing,
    settings_to_resume,
    writing_capture,
)
from fringeworks.patterns.plan import PatternPlan
from fringeworks.scan.exposure import auto_exposure
from fringeworks.scan.frames import (
    Grabbed,
    Progress,
    check_plan,
    mosaic_seen,
    seeing_colours,
    take_frames,
)
from fringeworks.scan.saturation import MOST_SATURATED
from fringeworks.stack.colour_steps import unmix
from fringeworks.stack.frames import Stack, step_of
from fringeworks.types import CameraSettings, Delay, InputError

AVERAGED_SATURATION = 0.98
"""Share of the camera's full scale from which on a mean of several frames is not trusted: some of
its samples may have been clipped."""


def capture(
    projector: Projector,
    camera: Camera,
    plan: PatternPlan,
    folder: StrPath,
    *,
    settings: CameraSettings | None = None,
    exposure: Literal["given", "auto"] = "given",
    delay: Delay | None = None,
    average: int = 1,
    most_saturated: float = MOST_SATURATED,
    resume: bool = False,
    force: bool = False,
    progress: Progress = lambda _: None,
) -> Path:
    """Show the pictures of a plan, take a frame of each, and write them as a capture.

    Parameters
    ----------
    projector : Projector
    camera : Camera
    plan : PatternPlan
        With ``colours``, projector and camera must be a ``ColourProjector`` and a ``ColourCamera``;
        the photographs (h, w, 3) are written as they come.
    folder : path
        New, empty, or of a capture that was not finished.
    settings : CameraSettings, optional
        Asked for before the first frame. What the camera then reports is stored with the capture.
        With ``resume``, settings that are not given are those of the interrupted capture.
    exposure : "given" or "auto"
        "auto" lets ``auto_exposure`` choose exposure and gain; with ``resume``, those of the
        interrupted capture are taken.
    delay : Delay, optional
        For the fast way of taking frames; see ``take_frames``.
    average : int
        Number of frames that are averaged for each picture.
    most_saturated : float
        Largest share of the lit pixels that may be saturated, 0…1; see ``take_frames``.
    resume : bool
        Keep the frames of a capture that was interrupted, and take the others. A complete capture
        with the same plan and settings is left as it is.
    force : bool
        Write into a folder with other things in it, too, and replace a finished capture.
    progress : callable
        Called with the label of every frame that was taken.

    Returns
    -------
    The folder. An interruption leaves all frames that were taken; ``resume`` goes on from there.

    Raises
    ------
    InputError for a plan that the projector cannot show or whose colours the camera cannot see, or
    other settings than those of the interrupted capture; DeviceProblem where frames do not come or
    too many pixels are saturated; FileProblem where the folder cannot be written to.

    Examples
    --------
    >>> import tempfile
    >>> import fringeworks as fw
    >>> from fringeworks.devices.clock import SimulatedClock
    >>> clock = SimulatedClock()
    >>> projector, camera = fw.devices.virtual_bench("sphere", clock=clock)
    >>> plan = fw.simulate.fringe_plan(fw.devices.virtual_rig(), both=False)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     taken = fw.capture(projector, camera, plan, f"{folder}/sphere")
    ...     points = fw.measure(taken, fw.devices.virtual_rig()).points
    >>> bool((points.reason == 0).sum() > 3000)
    True
    """
    check_plan(projector, plan, colours=True)
    if not (resume or force):
        refuse_replacing(folder)
    settings = settings or CameraSettings()
    if resume:
        taken = settings_to_resume(folder)
        settings = taken if exposure == "auto" else settings.over(taken)
    with seeing_colours(camera, plan):
        used = _configured(
            projector, camera, plan, settings, auto=exposure == "auto" and not resume
        )
    with writing_capture(
        folder,
        plan,
        camera=camera.name,
        projector=projector.name,
        settings=used,
        averaged=average,
        saturation=saturation_of(used, average),
        mosaic=mosaic_seen(camera, plan),
        resume=resume,
        force=force,
    ) as writer:
        if writer.missing:
            frames = take_frames(
                projector,
                camera,
                plan,
                delay=delay,
                average=average,
                only=writer.missing,
                most_saturated=most_saturated,
                progress=progress,
            )
            for number, frame in frames:
                writer.add(number, frame)
    return Path(folder)


def capture_in_memory(
    projector: Projector,
    camera: Camera,
    plan: PatternPlan,
    *,
    settings: CameraSettings | None = None,
    exposure: Literal["given", "auto"] = "given",
    delay: Delay | None = None,
    average: int = 1,
    most_saturated: float = MOST_SATURATED,
    progress: Progress = lambda _: None,
    grabbed: Grabbed = lambda *_: None,
) -> Stack:
    """Take the frames of a plan as ``capture`` does, and keep them in memory; ``grabbed`` as for
    ``take_frames``.

    Returns
    -------
    Stack that ``measure`` takes: with the bits that reading the written capture would give.

    Raises
    ------
    As ``capture``, but for those of folders.
    """
    check_plan(projector, plan, colours=True)
    with seeing_colours(camera, plan):
        used = _configured(
            projector, camera, plan, settings or CameraSettings(), auto=exposure == "auto"
        )
    taken = take_frames(
        projector,
        camera,
        plan,
        delay=delay,
        average=average,
        most_saturated=most_saturated,
        progress=progress,
        grabbed=grabbed,
    )
    frames = [frame for _, frame in taken]
    if mosaic_seen(camera, plan) is not None:
        raise InputError("camera: expected frames in a folder for channel=raw: capture them first")
    shown = used.region
    fits = shown is not None and frames[0].shape[:2] == (shown.height_px, shown.width_px)
    if plan.colours:
        return replace(
            unmix(frames, plan, saturation=saturation_of(used, average)),
            camera=camera.name,
            projector=projector.name,
            region=shown if fits else None,
        )
    return Stack(
        frames,
        plan,
        saturation=saturation_of(used, average),
        camera=camera.name,
        projector=projector.name,
        count_step=step_of(frames[0].dtype),
        region=shown if fits else None,
    )


def _configured(
    projector: Projector,
    camera: Camera,
    plan: PatternPlan,
    settings: CameraSettings,
    *,
    auto: bool,
) -> CameraSettings:
    """Set a camera that delivers what a plan needs; its settings as read back."""
    if plan.colours and (settings.pixel_format or "").startswith("Mono"):
        # A set-up was made with grey frames; its grey format holds no colours.
        settings = replace(settings, pixel_format=None)
    used = camera.configure(settings)
    return camera.configure(auto_exposure(projector, camera)) if auto else used


def saturation_of(settings: CameraSettings, average: int) -> float | None:
    """Counts from which on samples are not trusted, where the type of the frames does not tell."""
    if settings.pixel_format is None:
        return None
    top = float(full_scale(settings.pixel_format))
    return top if average == 1 else AVERAGED_SATURATION * top
