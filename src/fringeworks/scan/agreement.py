"""The safe way to take a frame: wait until it has changed and two in a row agree."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.devices.protocols import Camera, Grab, Projector
from fringeworks.scan.differences import (
    ROUNDING_VARIANCE,
    agree,
    block_differences,
    changed,
    compared,
    noise_between,
)
from fringeworks.scan.saturation import (
    MOST_SATURATED,
    SaturationGuard,
    largest_count,
    saturated_share,
)
from fringeworks.scan.taking import Picture
from fringeworks.scan.uniform import black_picture, uniform_picture, white_picture
from fringeworks.types import CameraNoise, CameraSettings, DeviceProblem

TIMEOUT_S = 5.0
"""Longest wait for a picture to appear, s. Slow webcams with long exposures need one second."""
BLACK_FRAMES = 3
"""Frames of black that are grabbed before white is shown, so that black was on the screen for two
whole frames."""
STEADY_FRAMES = 4
"""Frames in a row of nearly the same mean brightness that count as white."""
STEADY_SHARE = 0.02
"""Largest difference of their means, relative to the rise from black. The light of a lamp on mains
flickers more where it flickers at all; later frames are compared pixel by pixel."""
MIN_RISE_COUNTS = 1.0
"""Smallest rise of the mean brightness from black to white, counts. Noise moves a mean over a frame
by less than 0.1 counts."""
GREYS = (0.5, 0.25, 0.125)
"""Grey levels that are tried, one after the other, where white saturates: shot noise is seen only
between black and saturation. With a response of γ = 2.2 the last has a hundredth of white's light.
"""
MAX_INCOMPLETE = 20
"""Incomplete frames in a row after which a camera's connection is unusable, if they fill the
longest wait as well: with 5 % lost packets, frames of 40 packets are complete once in eight."""


class Agreement:
    """Takes frames without an assumption about the delay between projector and camera.

    A frame counts when it differs from the frame of the picture before, and agrees with the frame
    before it within the camera's noise. The second of two frames that agree is used: if the first
    was exposed while the picture changed, the second was not.

    Parameters
    ----------
    projector : Projector
    camera : Camera
    timeout_s : float
        Longest wait for a picture, s.

    Notes
    -----
    The first frame has no frame before it to differ from. ``start`` therefore shows black and then
    white, and waits for the brightness to rise from the darkest frame so far. Black is the darkest
    picture, so what was on the screen before cannot be mistaken for it.
    """

    def __init__(
        self, projector: Projector, camera: Camera, *, timeout_s: float = TIMEOUT_S
    ) -> None:
        self._projector = projector
        self._camera = camera
        self._timeout_s = timeout_s
        self._picture: NDArray[Any] | None = None
        self._frame: NDArray[np.float32] = np.empty((0, 0), np.float32)
        self._exact = False
        self._kind: tuple[tuple[int, ...], np.dtype[Any]] | None = None
        self.pair: tuple[NDArray[np.float32], NDArray[np.float32]] = (self._frame, self._frame)
        """The two frames that agreed last, on the grid of ``compared``, counts; they differ by
        noise."""
        self.noise = CameraNoise(float(np.sqrt(ROUNDING_VARIANCE)))
        """The camera's noise, measured by ``start``."""

    def frames(
        self, pictures: Iterable[Picture], average: int = 1, guard: SaturationGuard | None = None
    ) -> Iterator[tuple[int, list[Grab]]]:
        """Show pictures and take frames of each; see ``Taker``."""
        if self._picture is None:
            uniform = self.start()
            if guard is not None:
                guard.check(grab.pixels for grab in uniform)
        for number, label, counts in pictures:
            yield number, [self.take(counts, label), *self.more(average - 1)]

    def start(self) -> tuple[Grab, Grab]:
        """Show black and white, and measure the camera's noise.

        Returns
        -------
        The frames of black and of white.

        Raises
        ------
        DeviceProblem where white is not brighter than black, or frames never agree.
        """
        settings = self._camera.configure(CameraSettings(triggered=False))
        self._kind = None
        black = black_picture(self._projector)
        self._show(black)
        darkest = min(_mean(self._complete()) for _ in range(BLACK_FRAMES))
        of_white = self._steady(darkest, self._show(white_picture(self._projector)), rising=True)
        of_black = self._steady(_mean(of_white[-1]), self._show(black), rising=False)
        # Frames of a real camera differ by noise; equal ones are one frame delivered twice. The
        # first of the steady frames may still show a trace of black.
        self._exact = not any(_differing(frames[1:]) for frames in (of_white, of_black))
        self._picture, self._frame = black, compared(of_black[-1].pixels)
        of_grey = self._steady_grey(of_black[-1], of_white[-1], settings)
        self.noise = noise_between(
            [_two(frames) for frames in (of_black, of_white, of_grey) if frames]
        )
        one, other = _two(of_black)
        self.pair = compared(one), compared(other)
        return of_black[-1], of_white[-1]

    def _steady_grey(self, black: Grab, white: Grab, settings: CameraSettings) -> list[Grab]:
        """Frames of a grey that most pixels can show, if white saturates them; none elsewhere."""
        full = largest_count(settings, white.pixels.dtype)
        frames: list[Grab] = []
        bright = white
        for level in GREYS:
            if saturated_share(black.pixels, bright.pixels, full) <= MOST_SATURATED:
                break
            grey = uniform_picture(self._projector, level)
            try:
                frames = self._steady(_mean(black), self._show(grey), rising=True)
            except DeviceProblem:
                # Too dark to be seen. The noise of black and white must do.
                break
            bright = frames[-1]
            self._picture, self._frame = grey, compared(bright.pixels)
        return frames

    def more(self, count: int) -> list[Grab]:
        """Return further frames of the picture that ``take`` has taken last.

        Raises
        ------
        DeviceProblem where the frames do not agree with it.
        """
        found: list[Grab] = []
        last: NDArray[np.float32] | None = None
        tries = 0
        while len(found) < count:
            tries += 1
            if tries > count * MAX_INCOMPLETE:
                raise DeviceProblem(
                    f"{self._camera.name}: expected {count} more frames that agree, got "
                    f"{len(found)}: something moves, the light flickers, or an automatic exposure "
                    "is on"
                )
            grab = self._complete()
            frame = compared(grab.pixels)
            repeated = last is not None and not self._exact and np.array_equal(frame, last)
            if not repeated and agree(block_differences(self._frame, frame, self.noise)):
                found.append(grab)
            last = frame
        return found

    def take(self, picture: NDArray[Any], label: str = "the picture") -> Grab:
        """Show a picture, and return a frame that shows nothing else.

        Parameters
        ----------
        picture : (rows, columns) array of counts
        label : str
            Name of the picture in messages.

        Raises
        ------
        DeviceProblem where the camera sees no change, or no two frames agree, in time.
        """
        if self._picture is None:
            self.start()
        new = not np.array_equal(picture, self._picture)  # type: ignore[arg-type]
        before, last = self._frame, None
        shown_s = self._show(picture)
        seen = False
        while True:
            grab = self._complete()
            frame = compared(grab.pixels)
            differs = changed(block_differences(before, frame, self.noise))
            seen |= differs
            if (differs or not new) and last is not None and self._agrees(last, frame):
                self._picture, self._frame = np.array(picture), frame
                self.pair = last, frame
                return grab
            if grab.host_s - shown_s > self._timeout_s:
                raise DeviceProblem(self._why_not(label, seen))
            last = frame

    def _agrees(self, one: NDArray[np.float32], other: NDArray[np.float32]) -> bool:
        if not self._exact and np.array_equal(one, other):
            return False
        return agree(block_differences(one, other, self.noise))

    def _show(self, picture: NDArray[Any]) -> float:
        shown_s = self._projector.show(picture)
        self._camera.discard()
        return shown_s

    def _complete(self) -> Grab:
        """The next frame of which all pixels arrived."""
        arrived_s: list[float] = []
        while True:
            grab = self._camera.grab(self._timeout_s)
            if grab.complete:
                self._check_size(grab.pixels)
                return grab
            arrived_s.append(grab.host_s)
            passed_s = grab.host_s - arrived_s[0]
            if len(arrived_s) >= MAX_INCOMPLETE and passed_s >= self._timeout_s:
                raise DeviceProblem(
                    f"{self._camera.name}: expected complete frames, got {len(arrived_s)} "
                    f"incomplete ones in a row within {passed_s:.1f} s: lower the frame rate, or "
                    "send smaller frames"
                )

    def _check_size(self, pixels: NDArray[Any]) -> None:
        """Refuse a frame of another size or depth than the first."""
        self._kind = self._kind or (pixels.shape, pixels.dtype)
        if (pixels.shape, pixels.dtype) != self._kind:
            (rows, columns), depth = self._kind
            raise DeviceProblem(
                f"{self._camera.name}: expected frames of one size and depth, {columns} × {rows} px"
                f" of {8 * depth.itemsize} bit, got {pixels.shape[1]} × {pixels.shape[0]} px of "
                f"{8 * pixels.dtype.itemsize} bit: change no setting of the camera during a capture"
            )

    def _steady(self, limit: float, shown_s: float, *, rising: bool) -> list[Grab]:
        """Frames in a row that are steady and brighter (or darker) than any before."""
        frames: list[Grab] = []
        sign = 1.0 if rising else -1.0
        while True:
            frames = [*frames[1 - STEADY_FRAMES :], self._complete()]
            means = [_mean(grab) for grab in frames]
            limit = sign * min(sign * mean for mean in (limit, *means))
            change = sign * (means[-1] - limit)
            if (
                len(frames) == STEADY_FRAMES
                and change >= MIN_RISE_COUNTS
                and np.ptp(means) <= max(STEADY_SHARE * change, 0.5 * MIN_RISE_COUNTS)
            ):
                return frames
            if frames[-1].host_s - shown_s > self._timeout_s:
                raise DeviceProblem(self._why_not_steady([limit, *means], np.ptp(means)))

    def _why_not_steady(self, means: list[float], change: float) -> str:
        """The message on black or white; ``change`` is that of the last frames, counts."""
        low, high = min(means), max(means)
        said = (
            f"{self._camera.name}: expected white to be brighter than black and steady, got mean "
            f"brightnesses of {low:.1f} to {high:.1f} counts"
        )
        if high - low < MIN_RISE_COUNTS or change < STEADY_SHARE * (high - low):
            return (
                f"{said}: point the camera at the projected picture, open the lens, or check that "
                "the picture is on the right screen; an automatic exposure must be off"
            )
        refresh_s = self._projector.refresh_s
        periods = "" if refresh_s is None else f" ({1e3 * refresh_s:.4g} ms and its multiples)"
        return (
            f"{said}, and {change:.1f} counts between the last {STEADY_FRAMES} frames of one "
            f"picture: expose for whole refresh periods of the projector{periods}, switch lamps "
            "off that flicker, and switch an automatic exposure off"
        )

    def _why_not(self, label: str, seen: bool) -> str:
        name, wait = self._camera.name, f"within {self._timeout_s:g} s"
        if not seen:
            return (
                f"{name}: expected a change after {label} was shown, got none {wait}: the camera "
                "may repeat one frame, or something covers the screen or the lens"
            )
        return (
            f"{name}: expected two frames in a row that agree after {label} was shown, got none "
            f"{wait}: something moves, the light flickers, or an automatic exposure is on"
        )


def _differing(frames: list[Grab]) -> list[Grab]:
    """The frames that differ from the last one."""
    return [f for f in frames if not np.array_equal(f.pixels, frames[-1].pixels)]


def _two(frames: list[Grab]) -> tuple[NDArray[Any], NDArray[Any]]:
    """The last two frames that are not one frame delivered twice; the last two if all are equal."""
    before = _differing(frames) or frames[:-1]
    return before[-1].pixels, frames[-1].pixels


def _mean(grab: Grab) -> float:
    return float(grab.pixels.mean())
