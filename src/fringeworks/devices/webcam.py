"""Webcams and other cameras of the operating system, through OpenCV."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from fringeworks.devices.frame_reader import FrameReader, FromReader
from fringeworks.devices.http_camera import colours_of
from fringeworks.devices.pixel_formats import Channel
from fringeworks.devices.protocols import CameraLimits, Grab
from fringeworks.types import CameraSettings, DeviceProblem, InputError, Region
from fringeworks.types.packages import need_opencv

FIRST_FRAME_S = 10.0
"""Longest wait for the first frame, s. Some webcams need three seconds to start."""
NOT_TOLD = (0.0, -1.0)
"""Values of an exposure with which OpenCV says that the driver does not tell."""
LISTED_WEBCAMS = 8
"""Largest number of webcams that are looked for where the system does not list them."""


@dataclass(frozen=True)
class Exposures:
    """How one of OpenCV's backends counts exposures."""

    to_value: Callable[[float], float]
    """From an exposure in ms to the value of ``CAP_PROP_EXPOSURE``."""
    to_ms: Callable[[float], float]
    """From the value of ``CAP_PROP_EXPOSURE`` to an exposure in ms."""
    automatic_off: tuple[float, ...]
    """Values of ``CAP_PROP_AUTO_EXPOSURE`` that, one after the other, switch it off."""


LOGARITHMIC = Exposures(
    lambda ms: float(np.round(np.log2(1e-3 * ms))), lambda value: float(1e3 * 2.0**value), (0.0,)
)
"""Exposure as log₂ of seconds, whole numbers only: DirectShow and Media Foundation."""
EXPOSURES = {
    # V4L2_CID_EXPOSURE_ABSOLUTE counts 100 µs. Mode 3 is aperture priority, 1 is manual; some
    # cameras ignore "manual" unless the mode changes.
    "V4L2": Exposures(lambda ms: float(np.round(10.0 * ms)), lambda value: 0.1 * value, (3.0, 1.0)),
    "DSHOW": LOGARITHMIC,
    "MSMF": LOGARITHMIC,
}
"""Backends whose unit of exposure is known, by OpenCV's names."""


class WebcamCamera(FromReader):
    """A webcam, or a video file for trials.

    Parameters
    ----------
    source : int or str
        Number of the webcam, its path (``/dev/video0``), the address of a stream, or the path of a
        video file or image sequence (``frame-%02d.png``). A file's frames are delivered one after
        the other, none is lost.
    channel : str
        What is made of frames in colour: luminance (BT.601), red, green or blue. Where a channel is
        at its limit, so is the luminance, because a mean of clipped and other channels does not
        show that the pixel is saturated.
    size_px : (columns, rows), optional
        Frame size to ask for; the camera takes the nearest that it has. By default the driver's.

    Raises
    ------
    DeviceProblem where there is no such camera, it is in use, or this user may not use it.

    Notes
    -----
    A thread reads all the time and keeps the last four frames; see ``FrameReader``. Automatic
    exposure, white balance and focus are switched off as far as the driver allows. Drivers report
    settings that they do not follow: only light proves that exposure obeys (``exposure_obeys``).
    """

    def __init__(
        self,
        source: int | str,
        *,
        channel: Channel = "luminance",
        size_px: tuple[int, int] | None = None,
    ) -> None:
        need_opencv("a webcam")
        if channel not in get_args(Channel):
            raise InputError(f"channel: expected one of {get_args(Channel)}, got {channel!r}")
        self._channel = channel
        self._region: Region | None = None
        live = isinstance(source, int) or source.startswith("/dev/") or "://" in source
        self._name = f"webcam {source}" if live else f"video {source}"
        self._backend = ""

        def open_source() -> Any:
            opened = _opened(source, live=live, size_px=size_px)
            self._backend = str(opened.getBackendName())
            return opened

        self._reader = FrameReader(open_source, self._name, live=live)
        try:
            image = self._reader.first(FIRST_FRAME_S).image
        except DeviceProblem as error:
            self._reader.close()
            cause = _usual_cause(source) if live else "it may hold no pictures"
            raise DeviceProblem(
                f"{self._name}: expected a first frame, got none; {cause}"
            ) from error
        if image is None:
            self._reader.close()
            raise DeviceProblem(f"{self._name}: expected a frame that can be decoded, got another")
        self._size_px = image.shape[1], image.shape[0]

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """Change settings; see ``Camera.configure``.

        The exposure is rounded to what the driver counts in: 0.1 ms on Linux, powers of two on
        Windows. A gain of 0 dB sets the lowest gain; drivers do not tell what others mean. A region
        is cut from the frames. Frames that were exposed before are thrown away.

        Raises
        ------
        InputError for a setting that a webcam does not have; DeviceProblem where it is gone.
        """
        self._check(settings)
        exposure_ms = self._reader.run(lambda source: self._set(source, settings))
        if settings.region is not None:
            self._region = settings.region
        self._reader.discard()
        region = self._region or Region(0, 0, *self._size_px)
        return CameraSettings(exposure_ms, None, region, self._format, False)

    def grab(self, timeout_s: float = 5.0) -> Grab:
        """Return the oldest frame that was not returned yet; see ``Camera.grab``."""
        read = self._reader.take(timeout_s)
        if read.image is None:
            columns, rows = self._size_px
            grey = np.zeros((rows, columns), np.uint8)
        else:
            grey = (
                colours_of(read.image[..., ::-1])
                if self._colours
                else grey_of(read.image, self._channel)
            )
        if self._region is not None:
            r = self._region
            grey = grey[r.y_px : r.y_px + r.height_px, r.x_px : r.x_px + r.width_px]
        return Grab(grey, read.host_s, None, read.number, read.image is not None)

    def _check(self, settings: CameraSettings) -> None:
        if settings.exposure_ms is not None and self._backend not in EXPOSURES:
            raise InputError(
                f"{self.name}: exposure_ms: expected no value, because OpenCV's {self._backend} "
                f"does not tell its unit, got {settings.exposure_ms:g}: set it with the camera's "
                "own program"
            )
        if settings.gain_db not in (None, 0.0):
            raise InputError(
                f"{self.name}: gain_db: expected 0 (the lowest gain), because webcams do not tell "
                f"their gain in dB, got {settings.gain_db:g}"
            )
        if settings.pixel_format not in (None, self._format):
            raise InputError(
                f"{self.name}: expected the pixel format {self._format}, got "
                f"{settings.pixel_format}"
            )
        if settings.triggered:
            raise InputError(f"{self.name}: expected triggered=False: webcams have no trigger")
        region, (columns, rows) = settings.region, self._size_px
        if region is not None and (
            region.x_px + region.width_px > columns or region.y_px + region.height_px > rows
        ):
            raise InputError(
                f"{self.name}: expected a region within {columns} × {rows} px, got {region}"
            )

    def _set(self, source: Any, settings: CameraSettings) -> float | None:
        """Set exposure and gain; return the exposure that the driver reports, ms."""
        import cv2

        unit = EXPOSURES.get(self._backend)
        if settings.gain_db is not None:
            source.set(cv2.CAP_PROP_GAIN, 0.0)
        if unit is None:
            return None
        if settings.exposure_ms is not None:
            for value in unit.automatic_off:
                source.set(cv2.CAP_PROP_AUTO_EXPOSURE, value)
            # The shortest exposure that drivers count is 1; 0 would mean automatic to some.
            value = unit.to_value(settings.exposure_ms)
            source.set(cv2.CAP_PROP_EXPOSURE, max(value, 1.0) if unit is not LOGARITHMIC else value)
        value = float(source.get(cv2.CAP_PROP_EXPOSURE))
        return None if value in NOT_TOLD or not np.isfinite(value) else unit.to_ms(value)


def grey_of(image: NDArray[Any], channel: Channel) -> NDArray[np.uint8]:
    """Return an image of OpenCV as one grey frame.

    Parameters
    ----------
    image : (h, w) or (h, w, 1 or 3) uint8 array, blue first
    channel : str

    Returns
    -------
    (h, w) uint8 array: the channel, or the luminance (BT.601) rounded to whole counts, with 255
    where any channel is 255.

    Raises
    ------
    DeviceProblem for another shape or type.
    """
    import cv2

    if (
        image.dtype != np.uint8
        or image.ndim not in (2, 3)
        or image.shape[2:] not in ((), (1,), (3,))
    ):
        raise DeviceProblem(
            f"frame: expected 8 bits in one or three colours, got {image.dtype} {image.shape}"
        )
    if image.ndim == 2 or image.shape[2] == 1:
        return image.reshape(image.shape[:2])
    if channel != "luminance":
        return np.ascontiguousarray(image[..., ("blue", "green", "red").index(channel)])
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
    grey[image.max(axis=2) == 255] = 255
    return grey


@dataclass(frozen=True)
class Webcam:
    """A webcam that can be opened."""

    number: int
    """What opens it."""
    model: str
    """Name that the system gives it; empty where it gives none."""
    limits: CameraLimits


def webcams() -> Iterator[Webcam | DeviceProblem]:
    """Open one webcam after the other; each that opens, or why one that is there does not.

    On Linux those of ``/dev/video*``; elsewhere by number, until one does not open.
    """
    linux = sys.platform.startswith("linux")
    numbers = linux_webcams() if linux else dict.fromkeys(range(LISTED_WEBCAMS), "")
    for number, model in numbers.items():
        try:
            with WebcamCamera(number) as camera:
                yield Webcam(number, model, camera.limits())
        except DeviceProblem as problem:
            if not linux:
                return
            yield problem


def linux_webcams(
    devices: Path = Path("/dev"), described: Path = Path("/sys/class/video4linux")
) -> dict[int, str]:
    """Numbers and models of the webcams on Linux. A webcam's further nodes hold no pictures."""
    found = {}
    for node in devices.glob("video[0-9]*"):
        about = described / node.name
        if _text(about / "index") in ("", "0") and node.name[5:].isdigit():
            found[int(node.name[5:])] = _text(about / "name")
    return dict(sorted(found.items()))


def _text(path: Path) -> str:
    try:
        return path.read_text(errors="replace").strip()
    except OSError:
        return ""


def _opened(source: int | str, *, live: bool, size_px: tuple[int, int] | None) -> Any:
    """The open source, set up so that all frames are alike."""
    import cv2

    backend = cv2.CAP_ANY
    if live and "://" not in str(source):
        systems = {"linux": cv2.CAP_V4L2, "win32": cv2.CAP_DSHOW, "darwin": cv2.CAP_AVFOUNDATION}
        backend = systems.get(sys.platform, cv2.CAP_ANY)
    if not live and "%" not in str(source) and not Path(str(source)).is_file():
        raise DeviceProblem(f"video {source}: expected a video file, got no such file")
    with _quiet():
        opened = cv2.VideoCapture(source, backend)
    if not opened.isOpened():
        opened.release()
        if live:
            raise DeviceProblem(
                f"webcam {source}: expected a camera that opens; {_usual_cause(source)}"
            )
        raise DeviceProblem(f"video {source}: expected a video that OpenCV reads, got another file")
    if live:
        _set_up(opened, size_px)
    return opened


def _set_up(opened: Any, size_px: tuple[int, int] | None) -> None:
    """Switch off what changes frames by itself, as far as the driver allows."""
    import cv2

    wanted = [(cv2.CAP_PROP_BUFFERSIZE, 1.0)]
    if size_px is not None:
        wanted += [(cv2.CAP_PROP_FRAME_WIDTH, size_px[0]), (cv2.CAP_PROP_FRAME_HEIGHT, size_px[1])]
    wanted += [(cv2.CAP_PROP_AUTO_WB, 0.0), (cv2.CAP_PROP_AUTOFOCUS, 0.0)]
    unit = EXPOSURES.get(opened.getBackendName())
    if unit is not None:
        wanted += [(cv2.CAP_PROP_AUTO_EXPOSURE, value) for value in unit.automatic_off]
        exposure = float(opened.get(cv2.CAP_PROP_EXPOSURE))
        # DirectShow switches to manual only when an exposure is set.
        wanted += [(cv2.CAP_PROP_EXPOSURE, exposure)] if exposure not in NOT_TOLD else []
    for which, value in wanted:
        opened.set(which, value)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep OpenCV from printing while a source is opened: the error says the same."""
    import cv2

    logging = cv2.utils.logging
    level = logging.getLogLevel()
    logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        logging.setLogLevel(level)


def _usual_cause(source: int | str) -> str:
    """Why a webcam does not open or sends nothing, and what to do."""
    path = Path(f"/dev/video{source}" if isinstance(source, int) else str(source))
    if not sys.platform.startswith("linux") or "://" in str(source):
        return "it is not connected, another program uses it, or this program may not use it"
    if not path.exists():
        there = ", ".join(str(number) for number in linux_webcams()) or "none"
        return f"there is no {path}; numbers of the webcams that are there: {there}"
    if not os.access(path, os.R_OK | os.W_OK):
        return f"this user may not use {path}: run 'sudo usermod -aG video $USER' and log in again"
    return f"another program uses {path}, or it is no camera"
