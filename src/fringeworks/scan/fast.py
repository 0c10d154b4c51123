"""The fast way to take frames: at a steady pace, with a delay that was measured before."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from numpy.typing import NDArray

from fringeworks.devices.clock import clock_of
from fringeworks.devices.protocols import (
    Camera,
    Grab,
    Projector,
    TriggeredCamera,
)
from fringeworks.scan.saturation import SaturationGuard
from fringeworks.scan.taking import Picture
from fringeworks.types import CameraSettings, Delay, DeviceProblem

MAX_ROUNDS = 6
"""Times that pictures are shown until each has its frame. Frames that a camera loses at 5 % are all
there after four rounds with 99.99 % probability for 20 pictures."""
PAUSES_PER_REFRESH = 10
"""How often in a refresh period the camera is asked for frames."""
WAITED_FRAMES = 4
"""Frame periods over which the last frame is waited for after it is due."""


class FastTaker:
    """Takes the frames of pictures at a steady pace.

    Parameters
    ----------
    projector : Projector
    camera : Camera
        Configured as when the delay was measured.
    delay : Delay
        From ``measure_delay``.

    Notes
    -----
    A frame belongs to a picture if it arrived when the picture before was gone for good and the one
    after had not begun to appear (``Delay``). Frames that arrive at other times are thrown away,
    and pictures without a frame are shown again.
    """

    def __init__(self, projector: Projector, camera: Camera, delay: Delay) -> None:
        self._projector = projector
        self._camera = camera
        self._delay = delay
        self._clock = clock_of(projector)
        self._triggers_s: list[float] = []
        self._unused: Counter[str] = Counter()
        """Reasons why frames were not used, with their numbers."""

    def frames(
        self, pictures: Iterable[Picture], average: int = 1, guard: SaturationGuard | None = None
    ) -> Iterator[tuple[int, list[Grab]]]:
        """Show pictures and take frames of each; see ``Taker``."""
        shown = list(pictures)
        rounds = [self.take([picture.counts for picture in shown]) for _ in range(average)]
        if guard is not None:
            guard.check(grab.pixels for grab in rounds[0])
        for k, picture in enumerate(shown):
            yield picture.number, [grabs[k] for grabs in rounds]

    def take(self, pictures: Sequence[NDArray[Any]]) -> list[Grab]:
        """Show pictures and return a frame of each, in their order.

        Raises
        ------
        DeviceProblem where some pictures get no frame in six rounds.
        """
        self._camera.configure(CameraSettings(triggered=self._delay.transit_s is not None))
        frames: dict[int, Grab] = {}
        self._unused.clear()
        for _ in range(MAX_ROUNDS):
            frames |= self._round({n: p for n, p in enumerate(pictures) if n not in frames})
            if len(frames) == len(pictures):
                return [frames[n] for n in range(len(pictures))]
        lost = len(pictures) - len(frames)
        unused = ", ".join(f"{count} {why}" for why, count in self._unused.items())
        raise DeviceProblem(
            f"{self._camera.name}: expected a frame of every picture in {MAX_ROUNDS} rounds, got "
            f"none of {lost} of {len(pictures)} (frames that could not be used: "
            f"{unused or 'none, so frames were dropped'}): the delay has changed or frames are "
            "lost; measure the delay again, or take frames by agreement"
        )

    def _round(self, pictures: dict[int, NDArray[Any]]) -> dict[int, Grab]:
        """Show every picture once; the frames that show one of them only."""
        delay = self._delay
        self._camera.discard()
        shown: list[tuple[int, float]] = []
        grabs: list[Grab] = []
        for n, picture in pictures.items():
            shown.append((n, self._projector.show(picture)))
            if delay.transit_s is not None:
                self._triggers_s.append(shown[-1][1] + delay.first_s - delay.transit_s[0])
            # Half a period before its time, so that the next picture takes the right refresh.
            self._watch(shown[-1][1] + delay.hold_s - 0.5 * delay.refresh_s, grabs)
        due_s = shown[-1][1] + delay.first_s
        end_s = due_s + WAITED_FRAMES * max(delay.frame_s, delay.refresh_s)
        while self._clock.now_s() < end_s and not (grabs and grabs[-1].host_s >= due_s):
            self._watch(self._clock.now_s() + delay.refresh_s, grabs)
        self._triggers_s.clear()
        return self._assigned(shown, grabs)

    def _watch(self, until_s: float, grabs: list[Grab]) -> None:
        """Collect the frames that arrive until then, and send the triggers that are due."""
        pause_s = self._delay.refresh_s / PAUSES_PER_REFRESH
        while (now_s := self._clock.now_s()) < until_s:
            if self._triggers_s and self._triggers_s[0] <= now_s:
                assert isinstance(self._camera, TriggeredCamera)
                self._triggers_s.pop(0)
                self._camera.trigger()
            if self._camera.waiting():
                grabs.append(self._camera.grab())
                continue
            next_s = min([until_s, now_s + pause_s, *self._triggers_s[:1]])
            self._clock.wait_until(max(next_s, now_s))

    def _assigned(self, shown: list[tuple[int, float]], grabs: list[Grab]) -> dict[int, Grab]:
        frames: dict[int, Grab] = {}
        used: set[int] = set()
        ends = [s for _, s in shown[1:]] + [float("inf")]
        for (n, from_s), end_s in zip(shown, ends, strict=True):
            for k, grab in enumerate(grabs):
                in_time = from_s + self._delay.first_s <= grab.host_s <= end_s + self._delay.last_s
                if grab.complete and in_time:
                    frames[n] = grab
                    used.add(k)
                    break
        self._unused.update(
            "in transition between pictures" if grab.complete else "incomplete"
            for k, grab in enumerate(grabs)
            if k not in used
        )
        return frames
