"""Cameras of the Raspberry Pi, through its library picamera2."""

from __future__ import annotations

import math
import time
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.devices.frame_reader import FrameReader, FromReader
from fringeworks.devices.http_camera import colours_of, grey_of
from fringeworks.devices.pixel_formats import Channel
from fringeworks.devices.protocols import CameraLimits, Grab
from fringeworks.types import CameraSettings, DeviceProblem, InputError, MissingPackage, Region

FIRST_FRAME_S = 10.0
"""Longest wait for the first frame, s."""
SILENT_S = 0.8
"""Longest wait for a frame beyond its exposure, s, so that a camera that is gone is said within a
second."""
SETTLES = 12
"""Frames after which new settings must have arrived: the pipeline holds four to eight."""
SAME = 0.02
"""Largest relative difference of the exposure from the one that was asked for: sensors count lines
of about 20 µs, and 1 ms is a short exposure."""
ONE_GAIN = 1.0
"""Gain of red and blue that leaves the counts of the sensor as they are."""


class PiSource:
    """Reads frames of a camera, in the manner of ``cv2.VideoCapture``.

    Parameters
    ----------
    number : int
        Number of the camera, from 0.
    """

    def __init__(self, number: int) -> None:
        library = pi_library()
        there = len(library.Picamera2.global_camera_info())
        if number >= there:
            raise DeviceProblem(
                f"picamera {number}: expected one of {there} cameras that are connected, got "
                f"number {number}"
            )
        self._camera = library.Picamera2(number)
        fixed = {
            "AeEnable": False,
            "AwbEnable": False,
            "ColourGains": (ONE_GAIN, ONE_GAIN),
            "NoiseReductionMode": 0,
        }
        size = self._camera.sensor_resolution
        shape = {"size": size, "format": "RGB888"}
        self._camera.configure(self._camera.create_video_configuration(main=shape, controls=fixed))
        self._camera.start()
        self._asked: dict[str, float] = {}
        self._settling = 0
        self.used: dict[str, Any] = {}
        """What the camera says of the last frame: ExposureTime in µs, AnalogueGain."""
        self._image: NDArray[Any] | None = None

    @property
    def controls(self) -> dict[str, Any]:
        """Smallest, largest and usual value of every control, by its name."""
        return dict(self._camera.camera_controls)

    def set(self, asked: dict[str, float]) -> None:
        """Ask for controls. Frames that were exposed before they arrived are thrown away."""
        self._camera.set_controls(asked)
        self._asked, self._settling = self._asked | asked, SETTLES

    def grab(self) -> bool:
        """Fetch the next frame that has the settings."""
        while True:
            exposure_s = 1e-6 * float(self.used.get("ExposureTime", 0.0))
            job = self._camera.capture_request(wait=False)
            try:
                request = self._camera.wait(job, timeout=SILENT_S + exposure_s)
            except TimeoutError as error:
                raise DeviceProblem(
                    "expected a frame, got none: the camera was unplugged or has stopped; connect "
                    "it and resume"
                ) from error
            try:
                self._image = np.array(request.make_array("main"))
                self.used = request.get_metadata()
            finally:
                request.release()
            if not self._settling or self._settled():
                self._settling = 0
                return True
            self._settling -= 1

    def _settled(self) -> bool:
        return all(
            abs(float(self.used.get(name, math.nan)) - value) <= SAME * value
            for name, value in self._asked.items()
        )

    def retrieve(self) -> tuple[bool, NDArray[Any] | None]:
        """The frame that was fetched last, blue first."""
        return self._image is not None, self._image

    def release(self) -> None:
        """Stop the camera."""
        self._camera.stop()
        self._camera.close()


class RaspberryCamera(FromReader):
    """A camera on a Raspberry Pi.

    Parameters
    ----------
    number : int
        Number of the camera, from 0.
    channel : str
        What is made of frames in colour: luminance (BT.601), red, green or blue.

    Raises
    ------
    MissingPackage without picamera2; DeviceProblem where there is no such camera.

    Notes
    -----
    Automatic exposure, white balance and noise reduction are switched off. A change of settings
    arrives some frames later; ``configure`` waits for it, by what the camera says of each frame.
    """

    def __init__(self, number: int = 0, *, channel: Channel = "luminance") -> None:
        self._name = f"picamera {number}"
        self._channel = channel
        self._source: PiSource | None = None

        def opened() -> PiSource:
            self._source = PiSource(number)
            return self._source

        self._reader = FrameReader(opened, self._name)
        try:
            image = self._reader.first(FIRST_FRAME_S).image
        except BaseException:
            self._reader.close()
            raise
        assert image is not None
        self._size_px = image.shape[1], image.shape[0]

    def limits(self) -> CameraLimits:
        """Frame size and rate, limits of exposure and gain."""
        assert self._source is not None
        controls = self._source.controls
        exposure, gain = controls["ExposureTime"], controls["AnalogueGain"]
        return CameraLimits(
            *self._size_px,
            exposure_ms=(1e-3 * exposure[0], 1e-3 * exposure[1]),
            gain_db=(_decibel(gain[0]), _decibel(gain[1])),
            pixel_formats=(self._format,),
            frame_s=self._reader.period_s,
        )

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """Change exposure and gain; see ``Camera.configure``.

        Raises
        ------
        InputError for other settings and values out of the limits; DeviceProblem where the camera
        is gone.
        """
        self._check(settings)
        asked = {}
        if settings.exposure_ms is not None:
            asked["ExposureTime"] = round(1e3 * settings.exposure_ms)
        if settings.gain_db is not None:
            asked["AnalogueGain"] = 10.0 ** (settings.gain_db / 20.0)
        if asked:
            self._reader.run(lambda source: source.set(asked))
        self._reader.discard()
        used = self._used(bool(asked))
        return CameraSettings(
            1e-3 * float(used["ExposureTime"]),
            _decibel(float(used["AnalogueGain"])),
            Region(0, 0, *self._size_px),
            self._format,
            False,
        )

    def _used(self, changed: bool) -> dict[str, Any]:
        """What the camera says of its frames, once it has the settings."""
        assert self._source is not None
        if changed:
            self._reader.first(FIRST_FRAME_S)
        end_s = time.monotonic() + FIRST_FRAME_S
        while not self._source.used and time.monotonic() < end_s:
            time.sleep(SILENT_S / 100)
        return self._source.used

    def _check(self, settings: CameraSettings) -> None:
        limits = self.limits()
        for what in ("exposure_ms", "gain_db"):
            value, bounds = getattr(settings, what), getattr(limits, what)
            if value is not None and not bounds[0] <= value <= bounds[1]:
                raise InputError(
                    f"{self.name}: {what}: expected {bounds[0]:g} to {bounds[1]:g}, got {value:g}"
                )
        whole = Region(0, 0, *self._size_px)
        others = (
            settings.triggered,
            settings.pixel_format not in (None, self._format),
            settings.region not in (None, whole),
        )
        if any(others):
            raise InputError(
                f"{self.name}: expected no trigger, the pixel format {self._format} and the whole "
                f"sensor, got {settings}"
            )

    def grab(self, timeout_s: float = 5.0) -> Grab:
        """Return the oldest frame that was not returned yet; see ``Camera.grab``."""
        read = self._reader.take(timeout_s)
        assert read.image is not None
        image = read.image[..., ::-1]
        pixels = colours_of(image) if self._colours else grey_of(image, self._channel)
        return Grab(pixels, read.host_s, None, read.number)


def _decibel(gain: float) -> float:
    """A gain as a factor, in dB."""
    return 20.0 * math.log10(gain)


def pi_library() -> Any:
    """Return the module ``picamera2``.

    Raises
    ------
    MissingPackage where it is not installed.
    """
    try:
        return import_module("picamera2")
    except ImportError as error:
        raise MissingPackage(
            "a camera of the Raspberry Pi: expected the package picamera2, got none; "
            "apt install python3-picamera2, in a virtual environment with --system-site-packages"
        ) from error


def pi_cameras() -> list[str]:
    """Return the models of the cameras that are connected, by their number."""
    return [str(one["Model"]) for one in pi_library().Picamera2.global_camera_info()]
