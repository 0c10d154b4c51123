"""Cameras through a producer of GenTL, the driver that their maker installs."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from fringeworks.devices.genicam_names import (
    PTP_ENABLE,
    PTP_LATCH,
    PTP_OFFSET,
    PTP_STATUS,
    SOFTWARE,
    Coloured,
    check_limits,
    exposure_us,
    input_line,
    no_ptp,
    settled,
    unplugged,
)
from fringeworks.devices.gentl_nodes import Nodes
from fringeworks.devices.gentl_stream import GentlStream
from fringeworks.devices.gentl_system import found_of, gentl, named, said
from fringeworks.devices.pixel_formats import Channel, full_scale, to_colours, to_grey, unpacked
from fringeworks.devices.protocols import CameraLimits, Closing, Grab
from fringeworks.types import CameraSettings, DeviceProblem, Region

T = TypeVar("T")

SILENT_S = 0.5
"""Time without a frame after which a camera is asked whether it is still there, s: a producer
answers at once, so that an unplugged camera is named within a second."""
EXPOSURE, GAIN = ("ExposureTime", "ExposureTimeAbs"), ("Gain",)
"""Names of the exposure in µs and the gain in dB (Standard Features Naming Convention, and its
version before 2.0)."""
GONE = "IoException", "InvalidHandleException", "TimeoutException"
"""Errors of a producer for a device that answers no longer (GC_ERR_IO, GC_ERR_INVALID_HANDLE,
GC_ERR_TIMEOUT); others are about the question."""
AUTOMATIC = "ExposureAuto", "GainAuto"
"""What cameras change by themselves unless it is switched off."""


class GentlCamera(Coloured, Closing):
    """A camera through a producer of GenTL.

    Parameters
    ----------
    identifier : str, optional
        Identifier, serial number or user's name; the first camera found by default.
    channel : str
        What is made of the frames of a colour camera: luminance, red, green or blue.

    Raises
    ------
    MissingPackage without genicam; DeviceProblem where there is no such camera, or it is in use.

    Notes
    -----
    Producers are found in the folders of the environment variable GENICAM_GENTL64_PATH, which the
    makers' packages set. Automatic exposure and gain are switched off, so that all frames of a
    capture are alike.
    """

    def __init__(
        self, identifier: str | None = None, *, channel: Channel | Literal["raw"] = "luminance"
    ) -> None:
        self._module, _ = gentl()
        self._device: Any = None
        self._stream: GentlStream | None = None
        self._channel = channel
        self._colours = False
        self._clock: Literal["camera", "ptp"] = "camera"
        self._triggered = self._on_line = False
        info = named(identifier)
        found = found_of(info)
        self._name = f"{found.vendor} {found.model} {found.serial}".strip()
        device = info.create_device()
        try:
            device.open(self._module.DEVICE_ACCESS_FLAGS_LIST.DEVICE_ACCESS_CONTROL)
        except self._module.GenericException as error:
            raise DeviceProblem(
                f"camera {identifier or found.identifier}: expected one that is connected and not "
                f"in use ({said(error)})"
            ) from error
        self._device = device
        try:
            self._nodes: Nodes = self._asked(lambda: Nodes(device.remote_port))
            self._asked(self._forget)
        except BaseException:
            self.close()
            raise

    @property
    def name(self) -> str:
        """Vendor, model and serial number."""
        return self._name

    def limits(self) -> CameraLimits:
        """What the camera can be set to."""
        return self._asked(self._limits)

    def _limits(self) -> CameraLimits:
        nodes = self._nodes
        exposure = nodes.bounds(*EXPOSURE)
        rate = nodes.get("AcquisitionFrameRate")
        return CameraLimits(
            int(nodes.get("SensorWidth") or nodes.get("WidthMax") or nodes.get("Width")),
            int(nodes.get("SensorHeight") or nodes.get("HeightMax") or nodes.get("Height")),
            None if exposure is None else (1e-3 * exposure[0], 1e-3 * exposure[1]),
            nodes.bounds(*GAIN),
            nodes.choices("PixelFormat"),
            1.0 / rate if rate else None,
        )

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """Change settings; see ``Camera.configure``."""
        if settings == CameraSettings():
            # Nothing changes, so frames may go on.
            return self._asked(self._read_back)
        check_limits(self.name, self.limits(), settings)
        self._stop()
        return self._asked(lambda: self._set(settings))

    def _set(self, settings: CameraSettings) -> CameraSettings:
        nodes, region = self._nodes, settings.region
        if settings.pixel_format is not None:
            nodes.choose("PixelFormat", settings.pixel_format)
        if region is not None:
            # An offset limits the size, so it goes first and comes last.
            offsets = {"OffsetX": region.x_px, "OffsetY": region.y_px}
            for name in offsets:
                nodes.write(0, name, needed=False)
            nodes.write(region.width_px, "Width")
            nodes.write(region.height_px, "Height")
            for name, value in offsets.items():
                nodes.write(value, name, needed=value > 0)
        if settings.exposure_ms is not None:
            nodes.write(exposure_us(settings.exposure_ms), *EXPOSURE)
        if settings.gain_db is not None:
            nodes.write(settings.gain_db, *GAIN)
        changes = self._on_line or settings.triggered != self._triggered
        if settings.triggered is not None and changes:
            self._on_line = False
            if settings.triggered:
                self._wait_for(SOFTWARE)
            else:
                self._clear_triggers()
            self._triggered = settings.triggered
        return self._read_back()

    def _pixel_format(self) -> str:
        return str(self._nodes.get("PixelFormat"))

    def grab(self, timeout_s: float = 5.0) -> Grab:
        """Return the oldest frame that was not returned yet; see ``Camera.grab``."""
        stream = self._started()
        end_s = time.monotonic() + timeout_s
        while True:
            wait_s = min(max(end_s - time.monotonic(), 0.0), SILENT_S)
            try:
                frame = stream.take(wait_s)
            except DeviceProblem as error:
                raise unplugged(self.name, error) from error
            if frame is not None:
                return frame
            # A camera that is gone answers no question, and this raises.
            self._asked(lambda: self._nodes.get("Width", fresh=True))
            if time.monotonic() >= end_s:
                raise DeviceProblem(
                    f"{self.name}: expected a frame, got none within {timeout_s:g} s"
                )

    def waiting(self) -> int:
        """Number of frames that have arrived and were not returned yet."""
        return self._started().waiting()

    def discard(self) -> None:
        """Throw away all frames that have arrived."""
        self._started().discard()

    def trigger(self) -> float:
        """Expose a frame; see ``TriggeredCamera.trigger``."""
        if not self._triggered:
            raise DeviceProblem(f"{self.name}: expected a camera that waits for triggers")
        self._started()
        self._asked(lambda: self._nodes.do("TriggerSoftware"))
        return time.monotonic()

    def wait_for_line(self) -> None:
        """Expose a frame for every pulse on the first input line; see ``LineCamera``."""
        line = input_line(self.name, self._asked(lambda: self._nodes.choices("TriggerSource")))
        self._stop()
        self._asked(lambda: self._wait_for(line))
        self._triggered, self._on_line = False, True
        self._started()

    def synchronise(self, timeout_s: float = 15.0) -> float | None:
        """Let the camera's clock follow the network's; see ``PtpCamera.synchronise``."""
        self._stop()
        if not self._asked(lambda: self._nodes.has(*PTP_ENABLE)):
            raise no_ptp(self.name)
        self._asked(lambda: self._nodes.write(True, *PTP_ENABLE))

        def status() -> str:
            return str(self._asked(lambda: self._nodes.get(*PTP_STATUS, fresh=True)))

        settled(self.name, status, timeout_s)
        self._clock = "ptp"
        return self._asked(self._offset_s)

    def _offset_s(self) -> float | None:
        if self._nodes.has(PTP_LATCH):
            self._nodes.do(PTP_LATCH)
        offset_ns = self._nodes.get(PTP_OFFSET, fresh=True)
        return None if offset_ns is None else 1e-9 * int(offset_ns)

    def close(self) -> None:
        """Release the camera; again without effect."""
        if self._device is None:
            return
        self._stop()
        device, self._device = self._device, None
        # A camera that is gone may not be closed any more.
        with suppress(self._module.GenericException):
            device.close()

    def _asked(self, question: Callable[[], T]) -> T:
        """The answer to a question, with errors of the library in words."""
        if self._device is None:
            raise DeviceProblem(f"{self._name}: expected an open camera, got a closed one")
        _, genapi = gentl()
        try:
            return question()
        except tuple(getattr(self._module, name) for name in GONE) as error:
            raise unplugged(self._name, said(error)) from error
        except (self._module.GenericException, genapi.GenericException, DeviceProblem) as error:
            raise DeviceProblem(f"{self._name}: {said(error)}") from error

    def _forget(self) -> None:
        """Undo what an earlier program set: cameras keep their settings."""
        self._nodes.write(False, *PTP_ENABLE, needed=False)
        for name in AUTOMATIC:
            self._nodes.choose(name, "Off", needed=False)
        self._clear_triggers()

    def _wait_for(self, source: str) -> None:
        self._nodes.choose("TriggerSelector", "FrameStart", needed=False)
        self._nodes.choose("TriggerMode", "On")
        self._nodes.choose("TriggerSource", source)

    def _clear_triggers(self) -> None:
        for selector in self._nodes.choices("TriggerSelector") or ("",):
            if selector:
                self._nodes.choose("TriggerSelector", selector)
            self._nodes.choose("TriggerMode", "Off", needed=False)

    def _read_back(self) -> CameraSettings:
        nodes = self._nodes
        names = ("OffsetX", "OffsetY", "Width", "Height")
        exposure, gain = nodes.get(*EXPOSURE), nodes.get(*GAIN)
        return CameraSettings(
            None if exposure is None else 1e-3 * exposure,
            gain,
            Region(*(int(nodes.get(name) or 0) for name in names)),
            nodes.get("PixelFormat"),
            self._triggered,
        )

    def _started(self) -> GentlStream:
        """The stream of frames, which begins unless it runs."""
        if self._stream is None:
            self._stream = self._asked(self._begin)
        return self._stream

    def _begin(self) -> GentlStream:
        used = self._read_back()
        payload = int(self._nodes.get("PayloadSize"))
        stream = GentlStream(self._device, payload, lambda b, at: self._grabbed(b, at, used))
        try:
            self._nodes.write(1, "TLParamsLocked", needed=False)
            self._nodes.do("AcquisitionStart")
        except BaseException:
            stream.close()
            raise
        return stream

    def _stop(self) -> None:
        """Receive no more frames."""
        if self._stream is None:
            return
        stream, self._stream = self._stream, None
        _, genapi = gentl()
        # A camera that is gone cannot be told to stop.
        with suppress(self._module.GenericException, genapi.GenericException, DeviceProblem):
            self._nodes.do("AcquisitionStop")
            self._nodes.write(0, "TLParamsLocked", needed=False)
        stream.close()

    def _grabbed(self, buffer: Any, arrived_s: float, used: CameraSettings) -> Grab:
        complete = bool(buffer.is_complete())
        return Grab(
            self._pixels(buffer, complete, used),
            arrived_s,
            self._stamp_s(buffer),
            int(buffer.frame_id),
            complete,
            self._clock,
        )

    def _stamp_s(self, buffer: Any) -> float | None:
        """Time of a frame on the camera's clock, s."""
        with suppress(self._module.GenericException):
            return 1e-9 * int(buffer.timestamp_ns)
        with suppress(self._module.GenericException, ZeroDivisionError):
            return int(buffer.timestamp) / int(self._device.timestamp_frequency)
        return None

    def _pixels(self, buffer: Any, complete: bool, used: CameraSettings) -> NDArray[Any]:
        region, name = used.region, used.pixel_format
        assert region is not None
        assert name is not None
        shape = region.height_px, region.width_px
        if not complete:
            # Its bytes may be old or missing; nobody may use them.
            return np.zeros(shape, np.uint8 if full_scale(name) == 255 else np.uint16)
        begin = 0
        with suppress(self._module.GenericException):
            begin = int(buffer.image_offset)
        content = np.frombuffer(buffer.raw_buffer, np.uint8)[begin:]
        raw = unpacked(content, shape, name)
        return to_colours(raw, name) if self._colours else to_grey(raw, name, self._channel)
