"""Several exposures of one scene, for surfaces that one exposure cannot hold."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fringeworks.devices.protocols import Camera, Projector
from fringeworks.files.atomic import StrPath
from fringeworks.files.exposures import writing_exposures
from fringeworks.files.plan import PLAN_FILE, read_plan
from fringeworks.patterns.plan import PatternPlan
from fringeworks.scan.capture import capture
from fringeworks.scan.delay import Delay
from fringeworks.scan.exposure_range import configured
from fringeworks.scan.frames import Progress, check_plan
from fringeworks.types import CameraSettings, InputError


def capture_hdr(
    projector: Projector,
    camera: Camera,
    plan: PatternPlan,
    folder: StrPath,
    settings: Sequence[CameraSettings],
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
    folder : path
        New, empty, or an earlier result, which is replaced as a whole. The captures lie in its
        folders 0, 1, …
    settings : sequence of CameraSettings
        From ``exposure_series``: one for each exposure.
    delays : sequence of Delay, optional
        One for each exposure, for the fast way of taking frames: a delay depends on the exposure.
    average, force, progress
        As for ``capture``. The labels that ``progress`` gets begin with the exposure, as in
        ``exposure 2 of 3: x0_00``.
    resume : bool
        Keep the exposures and frames of a scan that was interrupted, and take the others.

    Returns
    -------
    The folder, for ``decode_stack``, ``measure`` and ``read_exposures``.

    Raises
    ------
    As ``capture``, and InputError where an interrupted scan had other settings or another plan.
    """
    check_plan(projector, plan)
    if delays is not None and len(delays) != len(settings):
        raise InputError(f"delays: expected {len(settings)}, one per exposure, got {len(delays)}")
    with writing_exposures(folder, settings, resume=resume, force=force) as writer:
        for number, wanted in enumerate(settings):
            begun, complete = writer.is_begun(number), writer.is_complete(number)
            target = writer.folder(number)
            if complete:
                _check_same_plan(target, plan)
                continue
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


def _check_same_plan(folder: Path, plan: PatternPlan) -> None:
    """``InputError`` where a complete exposure of an interrupted scan has another plan."""
    if read_plan(folder / PLAN_FILE) != plan:
        raise InputError(f"{folder}: expected the plan of the interrupted capture, got another")


def _numbered(progress: Progress, number: int, count: int) -> Progress:
    return lambda label: progress(f"exposure {number + 1} of {count}: {label}")
