"""Captures in which the projector plays pictures from its memory and the camera is triggered."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from fringeworks.devices.memory_projector import MemoryProjector
from fringeworks.devices.pixel_formats import full_scale
from fringeworks.devices.protocols import TriggeredCamera
from fringeworks.files.atomic import StrPath
from fringeworks.files.capture_writer import writing_capture
from fringeworks.patterns.encode import encode
from fringeworks.scan.frames import Progress
from fringeworks.types import CameraSettings, DeviceProblem


def capture_sequence(
    projector: MemoryProjector,
    camera: TriggeredCamera,
    folder: StrPath,
    *,
    settings: CameraSettings | None = None,
    force: bool = False,
    progress: Progress = lambda _: None,
) -> Path:
    """Take one frame of every picture that a projector plays from its memory, and write a capture.

    The camera is triggered once for every picture of the projector's plan.

    Parameters
    ----------
    projector : MemoryProjector
        At the first picture of its sequence.
    camera : TriggeredCamera
    folder : path
        New, empty, or an earlier result, which is replaced as a whole.
    settings : CameraSettings, optional
        Asked for before the first frame. What the camera then reports is stored with the capture.
    force : bool
        Write into a folder with other things in it, too.
    progress : callable
        Called with the label of every frame that was taken.

    Returns
    -------
    The folder. A sequence cannot be continued in its middle: after an error, start the projector's
    sequence again, call ``projector.restart``, and capture again with ``force``.

    Raises
    ------
    DeviceProblem where the projector is in the middle of its sequence, or a frame is missing or
    incomplete; FileProblem where the folder cannot be written to.
    """
    if projector.position != 0:
        raise DeviceProblem(
            "memory projector: expected the first picture of the sequence to come next, got "
            f"picture {projector.position + 1}: start the projector's sequence again and call "
            "restart"
        )
    if settings is not None:
        camera.configure(settings)
    used = camera.configure(CameraSettings(triggered=True))
    top = None if used.pixel_format is None else float(full_scale(used.pixel_format))
    with writing_capture(
        folder,
        projector.plan,
        camera=camera.name,
        projector=projector.name,
        settings=used,
        saturation=top,
        force=force,
    ) as writer:
        for number, frame in _triggered_frames(projector, camera):
            writer.add(number, frame)
            progress(projector.plan.labels()[number])
    return Path(folder)


def _triggered_frames(
    projector: MemoryProjector, camera: TriggeredCamera
) -> Iterator[tuple[int, NDArray[Any]]]:
    camera.discard()
    labels = projector.plan.labels()
    for number, picture in enumerate(encode(projector.plan)):
        projector.show(picture)
        camera.trigger()
        grab = camera.grab()
        if not grab.complete or camera.waiting():
            what = "an incomplete one" if not grab.complete else "more than one"
            raise DeviceProblem(
                f"{camera.name}: expected one complete frame of picture {number + 1} of "
                f"{len(labels)} ({labels[number]}), got {what}: start the projector's sequence "
                "again"
            )
        yield number, grab.pixels
