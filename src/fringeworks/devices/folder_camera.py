"""A folder into which another program writes the frames of a camera."""

from __future__ import annotations

import os
import time
from collections import deque
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringeworks.devices.pixel_formats import Channel
from fringeworks.devices.protocols import CameraLimits, Closing, Grab
from fringeworks.files.images import (
    CHANNELS,
    IMAGE_SUFFIXES,
    TIFF_SUFFIXES,
    checked_channels,
    read_frames,
)
from fringeworks.types import CameraSettings, DeviceProblem, FileProblem, InputError, Region

POLL_S = 0.05
"""Pause between two looks at the folder, s."""
SETTLED_S = 0.3
"""Time for which a file must not change to count as written, s. Programs write images of 20 MB in
one go; over slow networks the decoding finds out that a part is missing."""
DISCARD_S = 5.0
"""Longest wait for a file that is being written while frames are thrown away, s."""


class _Stamp(NamedTuple):
    """What changes when a file is written."""

    changed_ns: int
    size: int
    inode: int


class _Growing(NamedTuple):
    """A new file that may still be written to."""

    stamp: _Stamp
    since_s: float
    """Time at which it was first seen like this, s."""
    arrived_s: float
    """Time at which it was first seen, s."""


class FolderCamera(Closing):
    """A camera whose frames another program writes into a folder, such as a tethered photo camera.

    Parameters
    ----------
    folder : path
        Watched for new images (PNG, JPEG, BMP, TIFF), and for images that are written again. Those
        that are there already are ignored, and so are hidden files and files of other kinds.
    settled_s : float
        Time for which a file must not change to count as written, s.
    channel : str
        What is made of frames in colour: luminance (BT.601), red, green or blue.

    Raises
    ------
    DeviceProblem where there is no such folder.

    Notes
    -----
    A file counts when it no longer changes and can be decoded. Colour becomes luminance (BT.601),
    rounded to whole counts, unless ``deliver_colours`` asks for it. Settings are those of the
    program that writes: switch automatic exposure, white balance and focus off there. Frames are
    asked for there as well, so let it take one photograph after the other.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        *,
        settled_s: float = SETTLED_S,
        channel: Channel = "luminance",
    ) -> None:
        self._folder = Path(folder)
        self._channel = channel
        self._settled_s = settled_s
        self._size_px: tuple[int, int] | None = None
        self._count = 0
        self._open = True
        self._colours = False
        self._growing: dict[str, _Growing] = {}
        self._written: deque[tuple[str, float]] = deque()
        self._ahead: Grab | None = None
        self._known = dict(self._images())

    @property
    def name(self) -> str:
        """``folder`` and its path."""
        return f"folder {self._folder}"

    def limits(self) -> CameraLimits:
        """Frame size. Waits for the first frame, which is returned by the next ``grab``.

        Raises
        ------
        DeviceProblem where no frame comes in 5 s.
        """
        if self._size_px is None:
            self._ahead = self.grab()
        assert self._size_px is not None
        return CameraLimits(*self._size_px)

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """Return the frame size as the region, once a frame was grabbed; nothing can be set.

        Raises
        ------
        InputError for any setting other than ``triggered=False``.
        """
        wanted = set(settings.given())
        if settings.triggered is False:
            wanted.discard("triggered")
        if wanted:
            raise InputError(
                f"{self.name}: {', '.join(sorted(wanted))}: expected no setting, because another "
                "program controls this camera: set it there"
            )
        region = None if self._size_px is None else Region(0, 0, *self._size_px)
        return CameraSettings(region=region, triggered=False)

    def deliver_colours(self, wanted: bool) -> None:
        """Deliver frames in colour or in grey; see ``ColourCamera.deliver_colours``."""
        self._colours, self._ahead = wanted, None

    def grab(self, timeout_s: float = 5.0) -> Grab:
        """Return the frame of the oldest new file, or wait for one; see ``Camera.grab``.

        Raises
        ------
        DeviceProblem where no file is complete in time, naming one that is not; it is not waited
        for again. FileProblem for an image that is not of 8 or 16 bit.
        """
        if self._ahead is not None:
            ahead, self._ahead = self._ahead, None
            return ahead
        deadline_s = time.monotonic() + timeout_s
        broken: FileProblem | None = None
        while True:
            self._look()
            while self._written:
                name, arrived_s = self._written[0]
                try:
                    frame = whole_counts(
                        self._folder / name, colours=self._colours, channel=self._channel
                    )
                except FileProblem as problem:
                    # The writer may have paused in the middle; try again until the time is over.
                    broken = problem
                    break
                self._written.popleft()
                return self._grabbed(frame, arrived_s)
            now_s = time.monotonic()
            if now_s >= deadline_s:
                raise DeviceProblem(self._why_none(timeout_s, broken))
            time.sleep(min(POLL_S, deadline_s - now_s))

    def waiting(self) -> int:
        """Number of files that are written and were not grabbed yet."""
        self._look()
        return len(self._written) + (self._ahead is not None)

    def discard(self) -> None:
        """Ignore all files that have arrived. One that is being written is waited for: its frame
        was exposed before."""
        deadline_s = time.monotonic() + DISCARD_S
        self._look()
        while self._growing and time.monotonic() < deadline_s:
            time.sleep(POLL_S)
            self._look()
        self._ahead = None
        self._written.clear()

    def close(self) -> None:
        """Watch no longer; again without effect."""
        self._open = False

    def _images(self) -> list[tuple[str, _Stamp]]:
        """Images in the folder, the oldest first."""
        found = []
        try:
            with os.scandir(self._folder) as entries:
                for entry in entries:
                    suffix = os.path.splitext(entry.name)[1].lower()
                    if suffix not in IMAGE_SUFFIXES + TIFF_SUFFIXES or entry.name[0] == ".":
                        continue
                    try:
                        about = os.stat(entry.path)
                    except FileNotFoundError:  # renamed or deleted since it was listed
                        continue
                    stamp = _Stamp(about.st_mtime_ns, about.st_size, about.st_ino)
                    found.append((entry.name, stamp))
        except OSError as error:
            raise DeviceProblem(
                f"{self.name}: expected a folder that can be read, got: {error.strerror}"
            ) from error
        return sorted(found, key=lambda image: (image[1].changed_ns, image[0]))

    def _look(self) -> None:
        """Find the files that are new, and those that no longer change."""
        if not self._open:
            raise DeviceProblem(f"{self.name}: expected an open camera, got a closed one")
        now_s = time.monotonic()
        images = self._images()
        for name, stamp in images:
            if self._known.get(name) == stamp:
                continue
            growing = self._growing.get(name)
            if growing is None or growing.stamp != stamp:
                arrived_s = now_s if growing is None else growing.arrived_s
                self._growing[name] = _Growing(stamp, now_s, arrived_s)
            elif now_s - growing.since_s >= self._settled_s and stamp.size > 0:
                self._known[name] = stamp
                self._written.append((name, growing.arrived_s))
                del self._growing[name]
        there = {name for name, _ in images}
        self._growing = {name: g for name, g in self._growing.items() if name in there}

    def _grabbed(self, frame: NDArray[Any], arrived_s: float) -> Grab:
        self._size_px = frame.shape[1], frame.shape[0]
        self._count += 1
        return Grab(frame, arrived_s, None, self._count - 1)

    def _why_none(self, timeout_s: float, broken: FileProblem | None) -> str:
        said = f"{self.name}: expected a new image within {timeout_s:g} s, got"
        if broken is not None:
            self._written.popleft()
            return f"{said} one that cannot be read: {broken}"
        if self._growing:
            return f"{said} {next(iter(self._growing))}, which is still being written"
        return f"{said} none: let the program that controls the camera save its photographs there"


def whole_counts(
    path: Path, *, colours: bool = False, channel: Channel = "luminance"
) -> NDArray[Any]:
    """The frame of a file in counts of 8 or 16 bit, in grey or with red, green and blue."""
    named = "" if channel == "luminance" else checked_channels(channel)
    read = read_frames([path], stack=True, channels=CHANNELS if colours else named)
    frame = np.stack(read.frames, axis=-1) if colours else read.frames[0]
    if frame.dtype in (np.uint8, np.uint16):
        return frame
    if read.saturation not in (255, 65535):
        raise FileProblem(f"{path}: expected counts of 8 or 16 bit, got {frame.dtype}")
    return np.asarray(np.rint(frame), np.uint8 if read.saturation == 255 else np.uint16)
