"""Frames while a projector plays pictures from its memory, each triggered."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from fringeworks.devices.memory_projector import MemoryProjector
from fringeworks.devices.protocols import Camera, Grab, TriggeredCamera
from fringeworks.scan.saturation import SaturationGuard
from fringeworks.scan.taking import Picture
from fringeworks.types import CameraSettings, DeviceProblem, InputError


class SequenceTaker:
    """Takes one frame of every picture that a projector plays from its memory.

    Parameters
    ----------
    projector : MemoryProjector
        At the first picture of its sequence.
    camera : TriggeredCamera
        Triggered once for every picture of the projector's plan.

    Raises
    ------
    InputError for a camera without trigger.

    Notes
    -----
    A sequence cannot be continued in its middle. After an error, start the projector's sequence
    again, and call ``projector.restart``.
    """

    def __init__(self, projector: MemoryProjector, camera: Camera) -> None:
        if not isinstance(camera, TriggeredCamera):
            raise InputError(
                f"{camera.name}: expected a camera with a trigger for a projector that plays from "
                "its memory, got one without"
            )
        self._projector = projector
        self._camera: TriggeredCamera = camera

    def frames(
        self, pictures: Iterable[Picture], average: int = 1, guard: SaturationGuard | None = None
    ) -> Iterator[tuple[int, list[Grab]]]:
        """Play the sequence and take frames of each picture; see ``Taker``.

        The whole sequence is played, whichever pictures are wanted.
        """
        wanted = {picture.number for picture in pictures}
        rounds = [self._play() for _ in range(average)]
        if guard is not None:
            guard.check(grab.pixels for grab in rounds[0])
        for number in sorted(wanted):
            yield number, [grabs[number] for grabs in rounds]

    def _play(self) -> list[Grab]:
        """One frame of every picture of the sequence."""
        projector, camera = self._projector, self._camera
        if projector.position != 0:
            raise DeviceProblem(
                "memory projector: expected the first picture of the sequence to come next, got "
                f"picture {projector.position + 1}: start the projector's sequence again and call "
                "restart"
            )
        camera.configure(CameraSettings(triggered=True))
        camera.discard()
        labels = projector.plan.labels()
        grabs: list[Grab] = []
        for number, picture in enumerate(projector.pictures):
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
            grabs.append(grab)
        return grabs
