"""Cameras with GigE Vision or USB3 Vision, through the library Aravis."""

from __future__ import annotations

import ctypes as c
import time
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fringeworks.devices.aravis import HANDLE, Unanswered, aravis
from fringeworks.devices.genicam_names import (
    PTP_ENABLE,
    PTP_LATCH,
    PTP_OFFSET,
    PTP_STATUS,
    SOFTWARE,
    Coloured,
    Found,
    check_limits,
    exposure_us,
    input_line,
    no_ptp,
    settled,
    unplugged,
)
from fringeworks.devices.pixel_formats import Channel, full_scale, to_colours, to_grey, unpacked
from fringeworks.devices.protocols import CameraLimits, Closing, Grab
from fringeworks.types import CameraSettings, DeviceProblem, Region

BUFFERS = 8
"""Frames that the library can hold until they are grabbed: half a second at usual rates."""
STATUS_SUCCESS = 0
"""Status of a buffer whose frame is complete (ArvBufferStatus)."""
AUTO_OFF = 0
"""Automatic exposure and gain off (ArvAuto)."""
ORDINARY_SOCKET = 1
"""Option of a GigE camera's stream (ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED). For
administrators alone, the library would read packets from a raw socket that takes three times as
long to set up; once, the first packets of a first frame were missing there. With this option all
users have the same socket, which is open before the stream starts."""
SILENT_S = 1.0
"""Time without a frame after which a camera is asked whether it is still there, s: long enough for
usual exposures, and short beside the 3 s that it takes to learn that nobody answers."""


def genicam_cameras() -> list[Found]:
    """Search for cameras on all networks and USB ports.

    Raises
    ------
    MissingPackage without Aravis.
    """
    library = aravis()
    library.plain("arv_update_device_list", None)
    count = library.plain("arv_get_n_devices", c.c_uint)

    def word(what: str, n: int) -> str:
        text = library.plain(f"arv_get_device_{what}", c.c_char_p, (c.c_uint, n))
        return str((text or b"").decode(errors="replace"))

    return [
        Found(*(word(what, n) for what in ("id", "vendor", "model", "serial_nbr")))
        for n in range(count)
    ]


def _reason(error: DeviceProblem) -> str:
    """The library's message without the path of features, ``[PayloadSize] [PixelFormat] ``."""
    return str(error).rpartition("] ")[2]


class GenicamCamera(Coloured, Closing):
    """A camera with GigE Vision or USB3 Vision.

    Parameters
    ----------
    identifier : str, optional
        Identifier or network address; the first camera found by default.
    channel : str
        What is made of the frames of a colour camera: luminance, red, green or blue.

    Raises
    ------
    MissingPackage without Aravis; DeviceProblem where there is no such camera, or it is in use.

    Notes
    -----
    Automatic exposure and gain are switched off, so that all frames of a capture are alike.
    """

    def __init__(
        self, identifier: str | None = None, *, channel: Channel | Literal["raw"] = "luminance"
    ) -> None:
        self._aravis = aravis()
        self._stream: Any = None
        self._camera: Any = None
        self._name = f"camera {identifier}" if identifier else "camera"
        self._gone = False
        self._channel = channel
        self._colours = False
        self._clock: Literal["camera", "ptp"] = "camera"
        self._triggered = False
        self._on_line = False
        self._ahead: Grab | None = None
        text = None if identifier is None else identifier.encode()
        self._camera = self._opened(text)
        if not self._is_ours():
            self.close()
            raise DeviceProblem(
                f"{self._name}: expected one that is not in use, got one that another program "
                "controls"
            )
        self._name = self._word("vendor_name") + " " + self._word("model_name")
        serial = self._word("device_serial_number")
        self._name += f" {serial}" if serial else ""
        for what in ("exposure_time", "gain"):
            short = what.partition("_")[0]
            if self._call(f"is_{short}_auto_available", c.c_int):
                self._call(f"set_{what}_auto", None, (c.c_int, AUTO_OFF))
        # Cameras keep their settings from program to program.
        self._call("clear_triggers", None)
        if (ptp := self._feature(PTP_ENABLE)) is not None:
            self._call("set_boolean", None, (c.c_char_p, ptp), (c.c_int, 0))

    def _opened(self, identifier: bytes | None) -> Any:
        # Without a search, the library may ask for the frames at another network interface.
        self._aravis.plain("arv_update_device_list", None)
        try:
            camera = self._aravis.checked("arv_camera_new", HANDLE, (c.c_char_p, identifier))
        except DeviceProblem as error:
            listed = "; ".join(str(found) for found in genicam_cameras()) or "none"
            raise DeviceProblem(
                f"{self._name}: expected one that is connected and not in use ({error}); "
                f"cameras found: {listed}"
            ) from error
        if not camera:
            raise DeviceProblem("camera: expected one that is connected, got none")
        return camera

    @property
    def name(self) -> str:
        """Vendor, model and serial number."""
        return self._name

    def limits(self) -> CameraLimits:
        """What the camera can be set to."""
        width, height = c.c_int(), c.c_int()
        pointer = c.POINTER(c.c_int)
        self._call("get_sensor_size", None, (pointer, c.byref(width)), (pointer, c.byref(height)))
        formats = self._aravis.words(
            "arv_camera_dup_available_pixel_formats_as_strings", self._camera
        )
        exposure = self._bounds("exposure_time")
        has_rate = self._call("is_frame_rate_available", c.c_int)
        rate = self._call("get_frame_rate", c.c_double) if has_rate else 0.0
        return CameraLimits(
            width.value,
            height.value,
            None if exposure is None else (1e-3 * exposure[0], 1e-3 * exposure[1]),
            self._bounds("gain"),
            formats,
            1.0 / rate if rate else None,
        )

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """Change settings; see ``Camera.configure``."""
        if settings == CameraSettings():
            # Nothing changes, so frames may go on.
            return self._read_back()
        check_limits(self.name, self.limits(), settings)
        self._stop()
        region = settings.region
        if settings.pixel_format is not None:
            name = settings.pixel_format.encode()
            self._call("set_pixel_format_from_string", None, (c.c_char_p, name))
        if region is not None:
            values = (region.x_px, region.y_px, region.width_px, region.height_px)
            self._call("set_region", None, *((c.c_int, value) for value in values))
        if settings.exposure_ms is not None:
            exposure = exposure_us(settings.exposure_ms)
            self._call("set_exposure_time", None, (c.c_double, exposure))
        if settings.gain_db is not None:
            self._call("set_gain", None, (c.c_double, settings.gain_db))
        changes = self._on_line or settings.triggered != self._triggered
        if settings.triggered is not None and changes:
            self._on_line = False
            if settings.triggered:
                self._call("set_trigger", None, (c.c_char_p, SOFTWARE.encode()))
            else:
                self._call("clear_triggers", None)
            self._triggered = settings.triggered
        return self._read_back()

    def _pixel_format(self) -> str:
        return str(self._call("get_pixel_format_as_string", c.c_char_p).decode())

    def grab(self, timeout_s: float = 5.0) -> Grab:
        """Return the oldest frame that was not returned yet; see ``Camera.grab``."""
        self._start()
        buffer = self._popped(timeout_s)
        try:
            return self._grabbed(buffer)
        finally:
            self._push(buffer)

    def waiting(self) -> int:
        """Number of frames that have arrived and were not returned yet."""
        self._start()
        ins, outs = c.c_int(), c.c_int()
        pointer = c.POINTER(c.c_int)
        self._aravis.plain(
            "arv_stream_get_n_buffers",
            None,
            (HANDLE, self._stream),
            (pointer, c.byref(ins)),
            (pointer, c.byref(outs)),
        )
        return max(0, outs.value)

    def discard(self) -> None:
        """Throw away all frames that have arrived."""
        self._start()
        while buffer := self._aravis.plain(
            "arv_stream_try_pop_buffer", HANDLE, (HANDLE, self._stream)
        ):
            self._push(buffer)

    def trigger(self) -> float:
        """Expose a frame; see ``TriggeredCamera.trigger``."""
        if not self._triggered:
            raise DeviceProblem(f"{self.name}: expected a camera that waits for triggers")
        self._start()
        self._call("software_trigger", None)
        return time.monotonic()

    def wait_for_line(self) -> None:
        """Expose a frame for every pulse on the first input line; see ``LineCamera``."""
        sources = self._aravis.words("arv_camera_dup_available_trigger_sources", self._camera)
        line = input_line(self.name, sources)
        self._stop()
        self._call("set_trigger", None, (c.c_char_p, line.encode()))
        self._triggered, self._on_line = False, True
        self._start()

    def synchronise(self, timeout_s: float = 15.0) -> float | None:
        """Let the camera's clock follow the network's; see ``PtpCamera.synchronise``."""
        enable, status = self._feature(PTP_ENABLE), self._feature(PTP_STATUS)
        if enable is None or status is None:
            raise no_ptp(self.name)
        self._stop()
        self._call("set_boolean", None, (c.c_char_p, enable), (c.c_int, 1))

        def told() -> str:
            word = self._call("get_string", c.c_char_p, (c.c_char_p, status))
            return str((word or b"").decode(errors="replace"))

        settled(self.name, told, timeout_s)
        self._clock = "ptp"
        if (latch := self._feature((PTP_LATCH,))) is not None:
            self._call("execute_command", None, (c.c_char_p, latch))
        offset = self._feature((PTP_OFFSET,))
        if offset is None:
            return None
        return 1e-9 * int(self._call("get_integer", c.c_int64, (c.c_char_p, offset)))

    def _feature(self, names: tuple[str, ...]) -> bytes | None:
        """The first of several features that the camera has."""
        for name in names:
            word = name.encode()
            if self._call("is_feature_available", c.c_int, (c.c_char_p, word)):
                return word
        return None

    def close(self) -> None:
        """Release the camera; again without effect."""
        if self._camera is None:
            return
        try:
            self._stop()
        except DeviceProblem:
            self._stream = None
        self._aravis.release(self._camera)
        self._camera = None

    def _call(self, name: str, result: Any, *arguments: tuple[Any, Any]) -> Any:
        if self._camera is None:
            raise DeviceProblem(f"{self._name}: expected an open camera, got a closed one")
        camera = HANDLE, self._camera
        try:
            return self._aravis.checked(f"arv_camera_{name}", result, camera, *arguments)
        except Unanswered as error:
            self._gone = True
            raise unplugged(self._name, _reason(error)) from error
        except DeviceProblem as error:
            raise DeviceProblem(f"{self._name}: {_reason(error)}") from error

    def _is_on_network(self) -> bool:
        """Whether it is a camera of GigE Vision."""
        return bool(self._aravis.plain("arv_camera_is_gv_device", c.c_int, (HANDLE, self._camera)))

    def _is_ours(self) -> bool:
        """Whether a network camera takes orders from us; others cannot be opened twice."""
        if not self._is_on_network():
            return True
        device = self._aravis.plain("arv_camera_get_device", HANDLE, (HANDLE, self._camera))
        return bool(self._aravis.plain("arv_gv_device_is_controller", c.c_int, (HANDLE, device)))

    def _word(self, what: str) -> str:
        try:
            text = self._call(f"get_{what}", c.c_char_p)
        except DeviceProblem:
            return ""
        return str((text or b"").decode(errors="replace"))

    def _bounds(self, what: str) -> tuple[float, float] | None:
        if not self._call(f"is_{what}_available", c.c_int):
            return None
        low, high = c.c_double(), c.c_double()
        pointer = c.POINTER(c.c_double)
        self._call(f"get_{what}_bounds", None, (pointer, c.byref(low)), (pointer, c.byref(high)))
        return low.value, high.value

    def _read_back(self) -> CameraSettings:
        values = [c.c_int() for _ in range(4)]
        pointer = c.POINTER(c.c_int)
        self._call("get_region", None, *((pointer, c.byref(value)) for value in values))
        name = self._call("get_pixel_format_as_string", c.c_char_p)
        exposure_ms = gain_db = None
        if self._call("is_exposure_time_available", c.c_int):
            exposure_ms = 1e-3 * self._call("get_exposure_time", c.c_double)
        if self._call("is_gain_available", c.c_int):
            gain_db = float(self._call("get_gain", c.c_double))
        region = Region(*(value.value for value in values))
        return CameraSettings(exposure_ms, gain_db, region, name.decode(), self._triggered)

    def _start(self) -> None:
        """Begin to receive frames, if that has not been done."""
        if self._stream is not None:
            return
        self._used = self._read_back()
        payload = self._call("get_payload", c.c_uint)
        if self._is_on_network():
            self._aravis.plain(
                "arv_camera_gv_set_stream_options",
                None,
                (HANDLE, self._camera),
                (c.c_int, ORDINARY_SOCKET),
            )
        self._stream = self._call("create_stream", HANDLE, (c.c_void_p, None), (c.c_void_p, None))
        if not self._stream:
            raise DeviceProblem(f"{self.name}: expected a stream of frames, got none")
        for _ in range(BUFFERS):
            self._push(
                self._aravis.plain(
                    "arv_buffer_new", HANDLE, (c.c_size_t, payload), (c.c_void_p, None)
                )
            )
        self._call("start_acquisition", None)

    def _stop(self) -> None:
        """Receive no more frames."""
        if self._stream is None:
            return
        stream, self._stream = self._stream, None
        try:
            # A camera that is gone cannot be told to stop, and asking takes seconds.
            if not self._gone:
                self._call("stop_acquisition", None)
        finally:
            self._aravis.release(stream)

    def _popped(self, timeout_s: float) -> Any:
        """Wait for the next buffer with a frame."""
        end_s = time.monotonic() + timeout_s
        while True:
            wait_s = min(max(end_s - time.monotonic(), 0.0), SILENT_S)
            buffer = self._aravis.plain(
                "arv_stream_timeout_pop_buffer",
                HANDLE,
                (HANDLE, self._stream),
                (c.c_uint64, int(1e6 * wait_s)),
            )
            if buffer:
                return buffer
            # A camera that is gone answers no question, and this raises.
            self._call("get_payload", c.c_uint)
            if time.monotonic() >= end_s:
                raise DeviceProblem(
                    f"{self.name}: expected a frame, got none within {timeout_s:g} s"
                )

    def _push(self, buffer: Any) -> None:
        self._aravis.plain("arv_stream_push_buffer", None, (HANDLE, self._stream), (HANDLE, buffer))

    def _grabbed(self, buffer: Any) -> Grab:
        def ask(what: str, kind: Any) -> Any:
            return self._aravis.plain(f"arv_buffer_get_{what}", kind, (HANDLE, buffer))

        complete = ask("status", c.c_int) == STATUS_SUCCESS
        arrived_ns = ask("system_timestamp", c.c_uint64)
        host_s = time.monotonic()
        # The library stamps frames with the time of day, but none whose first packet was lost.
        if arrived_ns:
            host_s -= time.time() - 1e-9 * arrived_ns
        return Grab(
            self._pixels(buffer, complete),
            host_s,
            1e-9 * ask("timestamp", c.c_uint64),
            int(ask("frame_id", c.c_uint64)),
            complete,
            self._clock,
        )

    def _pixels(self, buffer: Any, complete: bool) -> NDArray[Any]:
        region, name = self._used.region, self._used.pixel_format
        assert region is not None
        assert name is not None
        size = c.c_size_t()
        data = self._aravis.plain(
            "arv_buffer_get_data", HANDLE, (HANDLE, buffer), (c.POINTER(c.c_size_t), c.byref(size))
        )
        shape = region.height_px, region.width_px
        if not complete:
            # Its bytes may be old or missing; nobody may use them.
            return np.zeros(shape, np.uint8 if full_scale(name) == 255 else np.uint16)
        content = np.ctypeslib.as_array((c.c_uint8 * size.value).from_address(data))
        raw = unpacked(content, shape, name)
        return to_colours(raw, name) if self._colours else to_grey(raw, name, self._channel)
