"""The fast way to take frames: at a steady pace, with a delay that was measured before."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.devices.clock import clock_of
from fringeworks.devices.protocols import (
    Camera,
    Grab,
    Projector,
    TriggeredCamera,
)
from fringeworks.scan.dating import moments_s
from fringeworks.scan.references import PROOF_LEVELS, Trace, proof_trace, trace_of
from fringeworks.scan.saturation import SaturationGuard
from fringeworks.scan.taking import Picture
from fringeworks.scan.uniform import uniform_picture
from fringeworks.types import CameraSettings, Delay, DeviceProblem, FloatMap

MAX_ROUNDS = 6
"""Times that pictures are shown until each has its frame. Frames that a camera loses at 5 % are all
there after four rounds with 99.99 % probability for 20 pictures."""
PAUSES_PER_REFRESH = 10
"""How often in a refresh period the camera is asked for frames."""
WAITED_FRAMES = 4
"""Frame periods over which the last frame is waited for after it is due."""

MAX_PROOFS = 12
"""Times that known pictures are shown before the first one. They take a third of a second, and
cameras that deliver late after their settings have changed do so for less than three seconds."""
RECENT_FRAMES = 64
"""Frames of earlier rounds that are kept to date those of the next: a second of them."""
AGAIN, WHITE, BLACK = -1, -2, -3
"""Numbers of the known pictures at the end of a round."""


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
    A frame belongs to a picture if it was due when the picture before was gone for good and the one
    after had not begun to appear (``Delay``). Frames of other times are thrown away, and pictures
    without a frame are shown again. When a frame was due is told by ``moments_s``.

    Before the first picture, white and black are shown until each is in its frame: some cameras
    deliver their first frames late. At the end of every round the first picture, white and black
    are shown again. If their frames hold light of the picture before, the round is repeated.
    """

    def __init__(self, projector: Projector, camera: Camera, delay: Delay) -> None:
        self._projector = projector
        self._camera = camera
        self._delay = delay
        self._clock = clock_of(projector)
        self._triggers_s: list[float] = []
        """Times at which triggers are due."""
        self._sent_s: list[float] = []
        """Times of the triggers of a round."""
        self._unused: Counter[str] = Counter()
        """Reasons why frames were not used, with their numbers."""
        self._triggered = delay.transit_s is not None
        self._configured = False
        self._first = True
        """Whether no round was taken since white of the proof was shown."""
        self._proof: dict[int, Grab] = {}
        """Frames of ``WHITE`` and ``BLACK``; none where frames are triggered."""
        self._recent: list[Grab] = []
        """The last frames of earlier rounds, whose times date later ones."""

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
        DeviceProblem where some pictures get no frame in six rounds, or frames show the light of
        other pictures.
        """
        if not self._configured:
            self._camera.configure(CameraSettings(triggered=self._triggered))
            self._configured = True
            if not self._triggered:
                self._prove()
        frames: dict[int, Grab] = {}
        self._unused.clear()
        trace: Trace | None = None
        for _ in range(MAX_ROUNDS):
            missing = {n: p for n, p in enumerate(pictures) if n not in frames}
            found, trace = self._checked(missing)
            frames |= found
            if len(frames) == len(pictures):
                return [frames[n] for n in range(len(pictures))]
        raise self._lost(len(pictures) - len(frames), len(pictures), trace)

    def _prove(self) -> None:
        """Show known pictures until each is in its frame: then no late frames are on their way."""
        pictures = [uniform_picture(self._projector, level) for level in PROOF_LEVELS]
        trace: Trace | None = None
        for _ in range(MAX_PROOFS):
            frames: dict[int, Grab] = {}
            for _ in range(MAX_ROUNDS):
                frames |= self._round({n: p for n, p in enumerate(pictures) if n not in frames})
                if len(frames) == len(pictures):
                    break
            else:
                continue
            trace = proof_trace([frames[n].pixels for n in range(len(pictures))])
            if trace is None:
                self._proof = {BLACK: frames[3], WHITE: frames[4]}
                return
        raise self._lost(len(pictures), len(pictures), trace)

    def _checked(self, pictures: dict[int, NDArray[Any]]) -> tuple[dict[int, Grab], Trace | None]:
        """Show every picture once, then known ones; frames count if the known ones are right."""
        order = list(pictures)
        known = {AGAIN: pictures[order[0]]}
        for key, level in ((WHITE, 1.0), (BLACK, 0.0)) if self._proof else ():
            known[key] = uniform_picture(self._projector, level)
        frames = self._round(pictures | known)
        # A known picture, the frame that it should equal, and the picture before it.
        pairs = [(AGAIN, frames.get(order[0]), order[-1]), (WHITE, self._proof.get(WHITE), AGAIN)]
        pairs += [(BLACK, self._proof.get(BLACK), WHITE)]
        tests = [(frames.get(k), right, frames.get(before), k) for k, right, before in pairs]
        if self._first:
            tests.append(
                (frames.get(order[0]), frames.get(AGAIN), self._proof.get(WHITE), order[0])
            )
        judged = [
            trace_of(frame.pixels, right.pixels, before.pixels, gain=key != BLACK)
            for frame, right, before, key in tests
            if frame is not None and right is not None and before is not None
        ]
        traces = [trace for trace in judged if trace is not None]
        if traces:
            self._unused["with the light of another picture"] += len(frames)
            return {}, max(traces, key=lambda trace: abs(trace.share))
        self._first = False
        return {n: frame for n, frame in frames.items() if n in pictures and judged}, None

    def _lost(self, lost: int, count: int, trace: Trace | None) -> DeviceProblem:
        """The error for pictures without a frame."""
        unused = ", ".join(f"{number} {why}" for why, number in self._unused.items())
        advice = "measure the delay again, or take frames by agreement"
        if trace is not None:
            return DeviceProblem(
                f"{self._camera.name}: expected frames of known pictures to show them alone, got "
                f"{trace}: frames come later than when the delay was measured, or the light "
                f"changes within a picture; {advice}"
            )
        return DeviceProblem(
            f"{self._camera.name}: expected a frame of every picture in {MAX_ROUNDS} rounds, got "
            f"none of {lost} of {count} (frames that could not be used: "
            f"{unused or 'none, so frames were dropped'}): the delay has changed or frames are "
            f"lost; {advice}"
        )

    def _round(self, pictures: dict[int, NDArray[Any]]) -> dict[int, Grab]:
        """Show every picture once; the frames that show one of them only."""
        delay = self._delay
        self._camera.discard()
        self._sent_s.clear()
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
                self._sent_s.append(self._camera.trigger())
            if self._camera.waiting():
                grabs.append(self._camera.grab())
                continue
            next_s = min([until_s, now_s + pause_s, *self._triggers_s[:1]])
            self._clock.wait_until(max(next_s, now_s))

    def _moments(self, grabs: list[Grab]) -> FloatMap:
        """Times at which the frames of a round were due."""
        moments = moments_s(self._recent + grabs, triggered=self._triggered)[len(self._recent) :]
        self._recent = (self._recent + grabs)[-RECENT_FRAMES:]
        if self._delay.transit_s is not None and len(grabs) == len(self._sent_s):
            # No frame was lost, so that each belongs to its trigger, however late it is.
            moments = np.minimum(moments, np.array(self._sent_s) + self._delay.transit_s[1])
        return moments

    def _assigned(self, shown: list[tuple[int, float]], grabs: list[Grab]) -> dict[int, Grab]:
        frames: dict[int, Grab] = {}
        used: set[int] = set()
        moments = self._moments(grabs)
        ends = [s for _, s in shown[1:]] + [float("inf")]
        for (n, from_s), end_s in zip(shown, ends, strict=True):
            for k, grab in enumerate(grabs):
                first_s, last_s = from_s + self._delay.first_s, end_s + self._delay.last_s
                in_time = first_s <= moments[k] <= last_s
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
