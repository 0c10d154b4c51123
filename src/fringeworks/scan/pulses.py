"""Frames that a camera exposes for the pulses of a projector, one for every picture."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from fringeworks.devices.clock import clock_of
from fringeworks.devices.protocols import Camera, Grab, LineCamera
from fringeworks.devices.sequencer import SequenceProjector
from fringeworks.scan.fast import MAX_ROUNDS
from fringeworks.scan.saturation import SaturationGuard
from fringeworks.scan.taking import Picture
from fringeworks.types import CameraSettings, DeviceProblem, InputError

MOST_LOST = 0.2
"""Largest share of pulses without a frame that counts as a loss, 0…1. A camera that is too slow for
the pulses misses every second one, or more."""
LATE_S = 0.7
"""Longest time from a pulse until its frame arrives, beyond the period, s: readout and network of
slow cameras. A camera that was unplugged is found after it, so it is below a second."""
PAUSE_S = 0.002
"""Pause while frames are waited for, s: short beside the time that a frame takes to arrive."""
CUT_S = 1e-5
"""Largest part of a picture that an exposure may miss, s: cameras round exposures to 10 µs or less,
which is a third of a count of the shortest pictures of 8 bit."""
OFF_STEP = 0.25
"""Largest distance of the time between two frames from a whole number of periods, periods. Beyond
it, frames are not those of the pulses. Clocks of cameras differ by 1e-4 from the projector's."""


class PulseTaker:
    """Takes a frame of every picture that a projector plays at its own pace.

    Parameters
    ----------
    projector : SequenceProjector
    camera : LineCamera
        Its trigger input is connected to the projector's trigger output.

    Raises
    ------
    InputError for a camera without such an input.

    Notes
    -----
    Frames are counted. Where fewer arrive than pulses were sent, the times of the camera's own
    clock, or else its numbers of frames, tell which pulse got no frame. The sequence is played
    again for these pictures. A pulse that is lost at either end leaves no gap between frames, so
    that all frames are then taken again.
    """

    def __init__(self, projector: SequenceProjector, camera: Camera) -> None:
        if not isinstance(camera, LineCamera):
            raise InputError(
                f"{camera.name}: expected a camera with a trigger input for the projector "
                f"{projector.name}, which plays at its own pace, got one without"
            )
        self._projector = projector
        self._camera: LineCamera = camera
        self._clock = clock_of(camera)
        self.lost: list[str] = []
        """A sentence for every loss so far."""
        self.notes: dict[int, str] = {}
        """What to say of frames that were taken again, by the number of the picture."""

    def frames(
        self, pictures: Iterable[Picture], average: int = 1, guard: SaturationGuard | None = None
    ) -> Iterator[tuple[int, list[Grab]]]:
        """Play the sequence and take frames of each picture; see ``Taker``."""
        self._check_exposure()
        wanted = {picture.number: picture for picture in pictures}
        for numbers in self._projector.portions(sorted(wanted)):
            part = [wanted[number] for number in numbers]
            self._projector.load([picture.counts for picture in part], numbers)
            taken = self._portion(part, average)
            if guard is not None:
                guard.check(grabs[0].pixels for grabs in taken)
            yield from zip(numbers, taken, strict=True)

    def _check_exposure(self) -> None:
        """Refuse an exposure that sees the next picture, or a part of the planes of grey levels.

        Raises
        ------
        InputError with the exposures that fit.
        """
        exposure_ms = self._camera.configure(CameraSettings()).exposure_ms
        if exposure_ms is None:
            return
        begins_s, ends_s = self._projector.lit_s
        grey = self._projector.bits > 1
        least_s, most_s = (ends_s if grey else 0.0), self._projector.period_s + begins_s
        if grey and begins_s < -CUT_S:
            raise InputError(
                f"{self._projector.name}: trigger_out_delay_us: expected a pulse that begins with "
                f"its picture or before, got one {-1e6 * begins_s:g} µs later: a frame must hold "
                "all planes of a picture of 8 bit"
            )
        if not least_s - CUT_S <= 1e-3 * exposure_ms <= most_s + CUT_S:
            whole = f"a whole picture of {self._projector.bits} bit and " if grey else ""
            raise InputError(
                f"{self._camera.name}: exposure_ms: expected {1e3 * least_s:g} to {1e3 * most_s:g} "
                f"ms, so that a frame holds {whole}nothing of the next one, got {exposure_ms:g} ms"
            )

    def _portion(self, part: Sequence[Picture], average: int) -> list[list[Grab]]:
        """The frames of the loaded pictures; played until each has as many as wanted."""
        taken: list[list[Grab]] = [[] for _ in part]
        try:
            for _ in range(MAX_ROUNDS + average - 1):
                for place, grab in self._played(part).items():
                    if len(taken[place]) < average:
                        taken[place].append(grab)
                if all(len(grabs) == average for grabs in taken):
                    return taken
        finally:
            self._projector.stop()
        raise DeviceProblem(
            f"{self._camera.name}: expected a frame of every picture in {MAX_ROUNDS} rounds, got "
            f"none of some; {self.lost[-1]}"
        )

    def _played(self, part: Sequence[Picture]) -> dict[int, Grab]:
        """Play once: complete frames by their places; none where the places are not known."""
        self._camera.wait_for_line()
        self._camera.discard()
        self._projector.start()
        grabs = self._collected(len(part))
        where = places(grabs, len(part), self._projector.period_s, self._camera.name)
        if where is None:
            self._tell(part, None, len(grabs))
            return {}
        found = {at: grab for at, grab in zip(where, grabs, strict=True) if grab.complete}
        missing = [at for at in range(len(part)) if at not in found]
        if missing:
            self._tell(part, missing, len(found))
        return found

    def _collected(self, count: int) -> list[Grab]:
        """The frames of a sequence, as many as arrive."""
        period_s = self._projector.period_s
        grabs: list[Grab] = []
        heard_s = self._clock.now_s()
        end_s = heard_s + count * period_s + LATE_S
        while (now_s := self._clock.now_s()) < end_s and len(grabs) < count:
            if self._camera.waiting():
                grabs.append(self._camera.grab())
                heard_s = self._clock.now_s()
            elif now_s - heard_s > period_s + LATE_S:
                # A camera that is gone answers no question, and this raises.
                self._camera.limits()
                heard_s = now_s
            else:
                self._clock.wait_until(now_s + PAUSE_S)
        if len(grabs) < count:
            self._camera.limits()
        self._clock.wait_until(self._clock.now_s() + min(period_s, LATE_S))
        if self._camera.waiting():
            raise DeviceProblem(
                f"{self._camera.name}: expected {count} frames for {count} pulses, got more: the "
                "input line bounces, or another source triggers the camera"
            )
        return grabs

    def _why_none(self) -> str:
        """What to do where no pulse exposed a frame, as the end of a sentence."""
        name = self._projector.name
        ask = getattr(self._projector, "status", None)
        said = _said(ask()) if callable(ask) else ""
        if said:
            return f"{name} says: {said}"
        return f"connect the trigger output of {name} to the camera's input, and check its level"

    def _tell(self, part: Sequence[Picture], missing: list[int] | None, count: int) -> None:
        """Note which pulses got no frame, and refuse a camera that misses too many."""
        sent = len(part)
        if not count:
            raise DeviceProblem(
                f"{self._camera.name}: expected a frame for each of {sent} pulses, got none: "
                f"{self._why_none()}"
            )
        if sent - count > max(1.0, MOST_LOST * sent):
            raise DeviceProblem(
                f"{self._camera.name}: expected a frame for each of {sent} pulses, got {count}: "
                f"the camera is too slow for one every {1e3 * self._projector.period_s:g} ms; "
                "lengthen the period, or shorten the exposure"
            )
        again = range(sent) if missing is None else missing
        if missing is None:
            said = f"one of the first or the last of {sent} pulses got no frame"
        else:
            named = ", ".join(f"{k + 1} ({part[k].label})" for k in missing)
            said = f"pulse {named} of {sent} got no frame"
        self.lost.append(said)
        self.notes |= {part[k].number: f" (taken again: {said})" for k in again}


def _said(status: object) -> str:
    """Why a projector shows nothing, by what it says of itself; empty where it says nothing."""
    problems = [str(one) for one in getattr(status, "problems", ())]
    if getattr(status, "parked", False):
        problems.append("its mirrors are parked; switch it off and on")
    return "; ".join(problems)


def places(grabs: Sequence[Grab], count: int, period_s: float, name: str) -> list[int] | None:
    """Return which pulse each frame belongs to, from 0; None where that cannot be told.

    Parameters
    ----------
    grabs : sequence of Grab
        In the order of their arrival.
    count : int
        Number of pulses.
    period_s : float
        Time from one pulse to the next, s.
    name : str
        Name of the camera in messages.

    Raises
    ------
    DeviceProblem where the frames do not come in the pace of the pulses.

    Examples
    --------
    >>> frames = [Grab(np.zeros((1, 1), np.uint8), 0.0, at) for at in (7.0, 7.01, 7.03)]
    >>> places(frames, 4, 0.01, "camera")
    [0, 1, 3]
    """
    times = [grab.device_s for grab in grabs if grab.device_s is not None]
    numbers = [grab.number for grab in grabs if grab.number is not None]
    if grabs and len(times) == len(grabs):
        gaps = np.diff(times) / period_s
    elif grabs and len(numbers) == len(grabs):
        gaps = np.diff(np.asarray(numbers, np.float64))
    else:
        return list(range(count)) if len(grabs) == count else None
    steps = np.rint(gaps)
    if np.any(np.abs(gaps - steps) > OFF_STEP):
        usual = 1e3 * period_s * float(np.median(gaps))
        raise DeviceProblem(
            f"{name}: expected frames in the pace of the pulses, every {1e3 * period_s:g} ms, got "
            f"some every {usual:.4g} ms: another source triggers the camera"
        )
    at = np.concatenate(([0.0], np.cumsum(steps))).astype(int)
    if np.any(steps < 1) or at[-1] != count - 1:
        return None
    return [int(k) for k in at]
