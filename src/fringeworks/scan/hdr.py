"""Several exposures of one scene, for surfaces that one exposure cannot hold."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fringeworks.devices.protocols import Camera, Projector
from fringeworks.files.atomic import StrPath
from fringeworks.files.capture_writer import refuse_replacing
from fringeworks.files.exposures import series_to_resume, writing_exposures
from fringeworks.patterns.plan import PatternPlan
from fringeworks.scan.capture import capture
from fringeworks.scan.exposure import TooBright, exposure_series, series_in
from fringeworks.scan.exposure_range import configured, shorter_ranges
from fringeworks.scan.frames import Progress, check_plan, seeing_colours
from fringeworks.types import CameraSettings, Delay, InputError


def capture_hdr(
    projector: Projector,
    camera: Camera,
    plan: PatternPlan,
    folder: StrPath,
    settings: Sequence[CameraSettings] | int,
    *,
    delays: Sequence[Delay] | None = None,
    average: int = 1,
    resume: bool = False,
    force: bool = False,
    progress: Progress = lambda _: None,
) -> Path:
    """Capture a scene with several exposures, each as a capture of its own.

    Parameters
    ----------
    projector : Projector
    camera : Camera
    plan : PatternPlan
        With ``colours``, crosstalk is removed from each exposure by its own solid pictures.
    folder : path
        New, empty, or of a scan that was not finished. The captures lie in its folders 0, 1, …
    settings : sequence of CameraSettings, or int
        One for each exposure, as from ``exposure_series``; or their number, and ``exposure_series``
        chooses them. Where whole refresh periods are too bright, they are multiples of a half, a
        third or a quarter of one, or any; each scan then measures the light first. With ``resume``,
        a number stands for those of the interrupted scan.
    delays : sequence of Delay, optional
        One for each exposure, for the fast way of taking frames: a delay depends on the exposure.
    average, force, progress
        As for ``capture``. The labels that ``progress`` gets begin with the exposure, as in
        ``exposure 2 of 3: x0_00``.
    resume : bool
        Keep the exposures and frames of a scan that was interrupted, and take the others. A
        complete scan is left as it is.

    Returns
    -------
    The folder, for ``decode``, ``measure`` and ``read_exposures``.

    Raises
    ------
    As ``capture``, and InputError where an interrupted scan had other settings or another plan.
    """
    check_plan(projector, plan, colours=True)
    if not (resume or force):
        refuse_replacing(folder)
    if isinstance(settings, int):
        known = series_to_resume(folder) if resume else None
        settings = known or _series(projector, camera, settings)
    if delays is not None and len(delays) != len(settings):
        raise InputError(f"delays: expected {len(settings)}, one per exposure, got {len(delays)}")
    with writing_exposures(folder, settings, resume=resume, force=force) as writer:
        for number, wanted in enumerate(settings):
            begun, target = writer.is_begun(number), writer.folder(number)
            with seeing_colours(camera, plan):
                configured(camera, wanted)
            capture(
                projector,
                camera,
                plan,
                target,
                settings=wanted,
                delay=None if delays is None else delays[number],
                average=average,
                # The longest exposure saturates whatever the shorter ones are for.
                most_saturated=1.0,
                resume=begun,
                force=force,
                progress=_numbered(progress, number, len(settings)),
            )
    return Path(folder)


def _series(projector: Projector, camera: Camera, count: int) -> Sequence[CameraSettings]:
    """Exposures of whole refresh periods, or shorter ones where these are too bright."""
    if count == 1 or projector.refresh_s is None:
        return exposure_series(projector, camera, count)
    try:
        return exposure_series(projector, camera, count)
    except TooBright as error:
        for allowed in shorter_ranges(projector, camera):
            try:
                return series_in(projector, camera, allowed, count)
            except TooBright:
                continue
        raise error


def _numbered(progress: Progress, number: int, count: int) -> Progress:
    return lambda label: progress(f"exposure {number + 1} of {count}: {label}")
