"""The safe way to take a frame: wait until it has changed and two in a row agree."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.devices.protocols import Camera, Grab, Projector
from fringeworks.scan.differences import agree, block_differences, changed, compared
from fringeworks.scan.frame_noise import FrameNoise, frame_noise, kept_of_change, two_of
from fringeworks.scan.saturation import CLIPPED_SHARE, SaturationGuard, largest_count
from fringeworks.scan.taking import Picture
from fringeworks.scan.uniform import black_picture, texture_picture, white_picture
from fringeworks.types import CameraSettings, DeviceProblem

TIMEOUT_S = 5.0
"""Longest wait for a picture to appear, s. Slow webcams with long exposures need one second."""
BLACK_FRAMES = 3
"""Frames of black that are grabbed before white is shown, so that black was on the screen for two
whole frames."""
STEADY_FRAMES = 4
"""Frames in a row of nearly the same mean brightness that count as white."""
EXTRA_FRAMES = 1
"""Further frames of the texture, from which most is computed."""
STEADY_SHARE = 0.02
"""Largest difference of their means, relative to the rise from black. The light of a lamp on mains
flickers more where it flickers at all; later frames are compared pixel by pixel."""
MIN_RISE_COUNTS = 1.0
"""Smallest rise of the mean brightness from black to white, counts. Noise moves a mean over a frame
by less than 0.1 counts."""
MAX_SIGMA_SHARE = 0.04
"""Largest standard deviation that uneven noise may have in the middle of the range, share of full
scale. JPEG of quality 40 stays below 0.03; with more, something moves."""
MAX_INCOMPLETE = 20
"""Incomplete frames in a row after which a camera's connection is unusable, if they fill the
longest wait as well: with 5 % lost packets, frames of 40 packets are complete once in eight."""
LATE_FRAMES = 8
"""Further frames that have to agree where one of several cameras sees no change: it may be that
many frames late, as many as drivers keep, or look where the picture does not change."""


class Agreement:
    """Takes frames without an assumption about the delay between projector and camera.

    A frame counts when it differs from the frame of the picture before, and agrees with the frame
    before it within the camera's noise. The second of two frames that agree is used: if the first
    was exposed while the picture changed, the second was not.

    Parameters
    ----------
    projector : Projector
    camera : Camera

    Notes
    -----
    The first frame has no frame before it to differ from. ``start`` therefore shows black and then
    white, and waits for the brightness to rise from the darkest frame so far. Black is the darkest
    picture, so what was on the screen before cannot be mistaken for it.

    Then it shows blocks of random greys. They hold all brightnesses below saturation, and edges,
    beside which cameras that compress or smooth their frames have most noise.
    """

    def __init__(self, projector: Projector, camera: Camera) -> None:
        self._projector = projector
        self._camera = camera
        self._picture: NDArray[Any] = np.empty((0, 0))
        self._frame: NDArray[np.float32] = np.empty((0, 0), np.float32)
        self._parts: list[NDArray[np.float32]] = []
        """The same for each of several cameras."""
        self._kind: tuple[tuple[int, ...], np.dtype[Any]] | None = None
        self.pair: tuple[NDArray[np.float32], NDArray[np.float32]] = (self._frame, self._frame)
        """The two frames that agreed last, on the grid of ``compared``, counts; they differ by
        noise."""
        self._noise: FrameNoise | None = None
        self._full = np.inf
        """Largest count of the camera; known after ``start``."""
        self._means: list[float] = []
        """Mean brightness of the frames since a uniform picture was shown."""

    @property
    def noise(self) -> FrameNoise:
        """How frames of one picture differ, measured by ``start``."""
        if self._noise is None:
            self.start()
        assert self._noise is not None
        return self._noise

    def frames(
        self, pictures: Iterable[Picture], average: int = 1, guard: SaturationGuard | None = None
    ) -> Iterator[tuple[int, list[Grab]]]:
        """Show pictures and take frames of each; see ``Taker``."""
        if self._noise is None:
            uniform = self.start()
            if guard is not None:
                guard.check(grab.pixels for grab in uniform)
        for number, label, counts in pictures:
            yield number, [self.take(counts, label), *self.more(average - 1)]

    def start(self) -> tuple[Grab, Grab]:
        """Show black, white and random greys, and measure the camera's noise.

        Returns
        -------
        The frames of black and of white.

        Raises
        ------
        DeviceProblem where white is not brighter than black, or frames never agree.
        """
        settings = self._camera.configure(CameraSettings(triggered=False))
        self._kind = None
        black, white = black_picture(self._projector), white_picture(self._projector)
        self._show(black)
        darkest = min(_mean(self._complete()) for _ in range(BLACK_FRAMES))
        of_white = self._steady(darkest, self._show(white), rising=True)
        kept = kept_of_change([darkest, *self._means])
        of_black = self._steady(_mean(of_white[-1]), self._show(black), rising=False)
        texture = texture_picture(self._projector)
        level = _mean(of_black[-1])
        white_rise = _mean(of_white[-1]) - level
        of_texture = self._steady(level, self._show(texture), rising=True, of=white_rise)
        # The first of the steady frames may still show a trace of the picture before, and equal
        # frames may be one that was delivered again.
        of_texture += [self._complete() for _ in range(EXTRA_FRAMES)]
        series = [_pixels(frames[1:]) for frames in (of_black, of_white, of_texture)]
        noise = frame_noise(series, kept)
        if noise.waited_frames:
            # Such traces may be all that differs in these frames.
            series = [_pixels(self._later(noise.waited_frames))]
            noise = frame_noise(series, kept)
        self._full = largest_count(settings, series[-1][-1].dtype)
        self._noise = self._plausible(noise, self._full)
        self._picture, self._frame = texture, compared(series[-1][-1])
        self._parts = self._parts_of(series[-1][-1])
        if noise.waited_frames:
            return self.take(black, "black"), self.take(white, "white")
        one, other = two_of(_pixels(of_black[1:]))
        self.pair = compared(one), compared(other)
        return of_black[-1], of_white[-1]

    def _later(self, frames: int) -> list[Grab]:
        """Frames of the present picture, after a number of them."""
        for _ in range(frames):
            self._complete()
        return [self._complete() for _ in range(STEADY_FRAMES)]

    def _plausible(self, noise: FrameNoise, full: float) -> FrameNoise:
        """Refuse frames of one picture that differ by more than noise."""
        middle = float(np.sqrt(noise.largest.variance(0.5 * full)))
        if noise.largest != noise.usual and middle > MAX_SIGMA_SHARE * full:
            raise DeviceProblem(
                f"{self._camera.name}: expected frames of one picture to agree, got parts that "
                f"differ by {middle:.0f} counts of {full:.0f}: something moves, the light "
                "flickers, or an automatic exposure is on"
            )
        return noise

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
            if not self._repeated(last, frame) and self._agrees(self._frame, frame):
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
        if self._noise is None:
            self.start()
        new = not np.array_equal(picture, self._picture)
        before, last = self._frame, None
        shown_s = self._show(picture)
        seen = False
        agreeing = 0
        while True:
            grab = self._complete()
            frame = compared(grab.pixels)
            differs = changed(block_differences(before, frame, self.noise.largest))
            seen |= differs
            if self._repeated(last, frame):
                pass
            elif last is not None and (differs or not new) and self._agrees(last, frame):
                agreeing += 1
                self.pair = last, frame
            else:
                agreeing = 0
            parts = self._parts_of(grab.pixels) if agreeing else []
            late = self._late(parts) if new and agreeing else 0
            if agreeing > self.noise.waited_frames + late:
                self._picture, self._frame, self._parts = np.array(picture), frame, parts
                return grab
            if grab.host_s - shown_s > TIMEOUT_S:
                raise DeviceProblem(self._why_not(label, seen))
            last = frame

    def _parts_of(self, pixels: NDArray[Any]) -> list[NDArray[np.float32]]:
        """A frame of several cameras in the parts of each; none for a single camera."""
        split = getattr(self._camera, "split", None)
        return [] if split is None else [compared(part) for part in split(pixels)]

    def _late(self, parts: list[NDArray[np.float32]]) -> int:
        """How many frames one of several cameras may be late: it still sees the picture before."""
        same = (
            not changed(block_differences(before, part, self.noise.largest))
            for before, part in zip(self._parts, parts, strict=True)
        )
        return LATE_FRAMES if any(same) else 0

    def _repeated(self, one: NDArray[np.float32] | None, other: NDArray[np.float32]) -> bool:
        """Whether a frame is the one before, delivered again. Frames of saturated pixels only are
        equal without that."""
        if one is None or self.noise.exact or not np.array_equal(one, other):
            return False
        return not self._saturated(other)

    def _saturated(self, frame: NDArray[np.float32]) -> bool:
        """Whether all pixels are at the sensor's limit."""
        return frame.size > 0 and float(frame.min()) >= CLIPPED_SHARE * self._full

    def _agrees(self, one: NDArray[np.float32], other: NDArray[np.float32]) -> bool:
        return agree(block_differences(one, other, self.noise.largest))

    def _show(self, picture: NDArray[Any]) -> float:
        shown_s = self._projector.show(picture)
        self._camera.discard()
        return shown_s

    def _complete(self) -> Grab:
        """The next frame of which all pixels arrived."""
        arrived_s: list[float] = []
        while True:
            grab = self._camera.grab(TIMEOUT_S)
            if grab.complete:
                self._check_size(grab.pixels)
                return grab
            arrived_s.append(grab.host_s)
            passed_s = grab.host_s - arrived_s[0]
            if len(arrived_s) >= MAX_INCOMPLETE and passed_s >= TIMEOUT_S:
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

    def _steady(self, limit: float, shown_s: float, *, rising: bool, of: float = 0.0) -> list[Grab]:
        """Frames in a row that are steady and brighter (or darker) than any before.

        Their means differ by a share of the change of brightness, or of the change ``of``, counts.
        """
        frames: list[Grab] = []
        self._means = []
        sign = 1.0 if rising else -1.0
        while True:
            frames = [*frames[1 - STEADY_FRAMES :], self._complete()]
            self._means.append(_mean(frames[-1]))
            means = self._means[-STEADY_FRAMES:]
            limit = sign * min(sign * mean for mean in (limit, *means))
            change = sign * (means[-1] - limit)
            if (
                len(frames) == STEADY_FRAMES
                and change >= MIN_RISE_COUNTS
                and np.ptp(means) <= max(STEADY_SHARE * max(change, of), 0.5 * MIN_RISE_COUNTS)
            ):
                return frames
            if frames[-1].host_s - shown_s > TIMEOUT_S:
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
        name, wait = self._camera.name, f"within {TIMEOUT_S:g} s"
        if not seen and self._saturated(self._frame):
            return (
                f"{name}: expected a change after {label} was shown, got none {wait}: all pixels "
                "are saturated; expose for a shorter time, lower the gain, or close the aperture"
            )
        if not seen:
            return (
                f"{name}: expected a change after {label} was shown, got none {wait}: the camera "
                "may repeat one frame, or something covers the screen or the lens"
            )
        return (
            f"{name}: expected two frames in a row that agree after {label} was shown, got none "
            f"{wait}: something moves, the light flickers, or an automatic exposure is on"
        )


def _pixels(grabs: list[Grab]) -> list[NDArray[Any]]:
    return [grab.pixels for grab in grabs]


def _mean(grab: Grab) -> float:
    return float(grab.pixels.mean())
