"""What a projector and a camera must be able to do; any class with these methods is one."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, Literal, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import COLOURS
from fringeworks.types import CameraSettings, Frozen, InputError


@dataclass(frozen=True)
class CameraLimits:
    """What a camera can be set to, as far as it tells; None where it does not."""

    width_px: int
    """Columns of the sensor."""
    height_px: int
    """Rows of the sensor."""
    exposure_ms: tuple[float, float] | None = None
    """Shortest and longest exposure, ms."""
    gain_db: tuple[float, float] | None = None
    """Lowest and highest gain, dB."""
    pixel_formats: tuple[str, ...] = ()
    """Names of the pixel formats; empty where the camera does not tell."""
    frame_s: float | None = None
    """Time from one frame to the next at the current settings, s."""


@dataclass(frozen=True, eq=False, repr=False)
class Grab(Frozen):
    """One frame as it came from a camera."""

    pixels: NDArray[Any]
    """(h, w), counts: uint8 or uint16; (h, w, 3) with red, green and blue of a camera that was told
    to ``deliver_colours``."""
    host_s: float
    """Time at which the frame arrived, on the clock of ``time.monotonic``, s."""
    device_s: float | None = None
    """Time of the frame on the camera's own clock, s; None where the camera has none."""
    number: int | None = None
    """Number of the frame as the camera or its driver counts; None where nobody counts."""
    complete: bool = True
    """False where a part of the pixels did not arrive."""
    clock: Literal["camera", "ptp"] = "camera"
    """What ``device_s`` counts: "camera", from a moment of the camera's own; "ptp", the time of
    IEEE 1588, which all cameras that ``synchronise`` have in common. Its resolution as a number is
    0.24 µs."""

    def __post_init__(self) -> None:
        super().__post_init__()
        shaped = self.pixels.ndim == 2 or self.pixels.shape[2:] == (COLOURS,)
        if not shaped or self.pixels.dtype not in (np.uint8, np.uint16):
            raise InputError(
                "camera: expected frames of shape (h, w) or (h, w, 3) and type uint8 or uint16, "
                f"got {self.pixels.shape} and {self.pixels.dtype}"
            )


@dataclass(frozen=True)
class VideoMode:
    """How a screen shows pictures, as far as the system tells; None where it does not."""

    size_px: tuple[int, int]
    """Columns and rows of the present video mode."""
    refresh_hz: float | None = None
    """Pictures per second."""
    scale: float | None = None
    """Factor by which the system enlarges windows; 1 for none."""
    largest_px: tuple[int, int] | None = None
    """Columns and rows of the largest mode that the screen offers. That is usually its own
    resolution; some projectors also accept larger modes and resize them."""
    straight: bool | None = None
    """Whether the gamma ramp of the graphics card is a straight line."""

    def __str__(self) -> str:
        parts = [f"{self.size_px[0]} × {self.size_px[1]} px"]
        parts += [] if self.refresh_hz is None else [f"{self.refresh_hz:g} Hz"]
        parts += [] if self.scale is None else [f"scale {self.scale:g}"]
        if self.largest_px == self.size_px:
            parts.append("the largest mode that the screen offers")
        elif self.largest_px is not None:
            parts.append(f"the screen offers up to {self.largest_px[0]} × {self.largest_px[1]} px")
        return ", ".join(parts)


def video_mode_of(projector: object) -> VideoMode | None:
    """Return how a projector shows pictures, by its attribute ``mode``; None without one."""
    mode = getattr(projector, "mode", None)
    return mode if isinstance(mode, VideoMode) else None


@runtime_checkable
class Projector(Protocol):
    """A device that shows pictures."""

    @property
    def name(self) -> str:
        """Name of the device, as setups and captures store it."""

    @property
    def size_px(self) -> tuple[int, int]:
        """Columns and rows."""

    @property
    def bits(self) -> int:
        """Depth of the pictures: counts go from 0 to 2^bits − 1."""

    @property
    def refresh_s(self) -> float | None:
        """Time from one picture to the next, s; None where it is unknown."""

    def show(self, picture: NDArray[Any]) -> float:
        """Show a picture until the next one is shown.

        Parameters
        ----------
        picture : (rows, columns) array of counts, uint8 or uint16

        Returns
        -------
        Time at which the picture was handed to the screen, on the clock of ``time.monotonic``, s.
        Light comes later, by a delay that the projector does not tell.

        Raises
        ------
        InputError for a picture of another shape or type; DeviceProblem where the projector is
        gone.
        """

    def close(self) -> None:
        """Release the device; again without effect."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *error: object) -> None: ...


@runtime_checkable
class ColourProjector(Projector, Protocol):
    """A projector whose ``show`` also takes pictures in red, green and blue, (rows, columns, 3)."""

    @property
    def shows_colours(self) -> bool:
        """Whether it does; True for a class that always does."""


@runtime_checkable
class Camera(Protocol):
    """A device that grabs frames."""

    @property
    def name(self) -> str:
        """Name of the device, as setups and captures store it."""

    def limits(self) -> CameraLimits:
        """What the camera can be set to."""

    def configure(self, settings: CameraSettings) -> CameraSettings:
        """Change settings, and return all settings as read back from the camera.

        The caller compares: a camera may round a value, or ignore it.

        Raises
        ------
        InputError for a setting out of the camera's limits; DeviceProblem where the camera is gone.
        """

    def grab(self, timeout_s: float = 5.0) -> Grab:
        """Return the oldest frame that was not returned yet, or wait for one.

        The camera or its driver keeps the last frames until they are grabbed. A frame that is
        incomplete is returned as well, marked as such.

        Raises
        ------
        DeviceProblem where no frame arrives in time, or the camera is gone.
        """

    def waiting(self) -> int:
        """Number of frames that have arrived and were not returned yet."""

    def discard(self) -> None:
        """Throw away all frames that have arrived."""

    def close(self) -> None:
        """Release the device; again without effect."""

    def __enter__(self) -> Self: ...

    def __exit__(self, *error: object) -> None: ...


@runtime_checkable
class TriggeredCamera(Camera, Protocol):
    """A camera that exposes a frame when it is told to."""

    def trigger(self) -> float:
        """Expose a frame, which ``grab`` returns later.

        Only where ``configure`` was told ``triggered=True``.

        Returns
        -------
        Time at which the trigger was sent, on the clock of ``time.monotonic``, s.

        Raises
        ------
        DeviceProblem where the camera is gone or is not set to wait for triggers.
        """


@runtime_checkable
class ColourCamera(Camera, Protocol):
    """A camera that can deliver frames in colour."""

    def deliver_colours(self, wanted: bool) -> None:
        """Deliver frames (h, w, 3) with red, green and blue from now on, or grey ones again.

        Raises
        ------
        DeviceProblem for a camera whose sensor sees no colours.
        """


@runtime_checkable
class LineCamera(Camera, Protocol):
    """A camera that exposes a frame for every pulse on an input line."""

    def wait_for_line(self) -> None:
        """Expose a frame for every pulse from now on, which ``grab`` returns later.

        ``configure`` with ``triggered=False`` ends it.

        Raises
        ------
        DeviceProblem where the camera is gone or has no such line.
        """


@runtime_checkable
class PtpCamera(Camera, Protocol):
    """A camera whose clock can follow that of the network (PTP, IEEE 1588)."""

    def synchronise(self, timeout_s: float = 15.0) -> float | None:
        """Let the camera's clock follow the network's; frames carry that time from now on.

        Parameters
        ----------
        timeout_s : float
            Longest wait until the cameras have agreed on a master, s.

        Returns
        -------
        Difference to the master's clock that the camera measures, s; None where it does not tell.

        Raises
        ------
        DeviceProblem for a camera without PTP, and where no clock was found in time.
        """


class Closing:
    """Mix-in of devices: a context manager that calls ``close``, and prints its name."""

    def close(self) -> None:
        """Release the device; again without effect."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {getattr(self, 'name', '')}>"


class TakenWhenAsked(Closing, ABC):
    """Mix-in of cameras that take a frame when they are asked for one, which ``grab`` returns."""

    _size_px: tuple[int, int] | None = None
    _count = 0
    _ahead: Grab | None = None
    """A frame that was taken to learn its size, and not returned yet."""

    def grab(self, timeout_s: float = 5.0) -> Grab:
        """Take a frame and return it; see ``Camera.grab``."""
        if self._ahead is not None:
            ahead, self._ahead = self._ahead, None
            return ahead
        return self._taken(timeout_s)

    def waiting(self) -> int:
        """Number of frames that were taken and not returned: frames are taken when asked for."""
        return int(self._ahead is not None)

    def discard(self) -> None:
        """Forget a frame that was not returned yet."""
        self._ahead = None

    @abstractmethod
    def _taken(self, timeout_s: float) -> Grab:
        """Take a frame."""

    def _sized(self) -> None:
        if self._size_px is None:
            self._ahead = self.grab()

    def _grabbed(self, frame: NDArray[Any], complete: bool = True) -> Grab:
        self._count += 1
        return Grab(frame, time.monotonic(), None, self._count - 1, complete)


def checked_picture(
    picture: NDArray[Any], size_px: tuple[int, int], bits: int, *, colours: bool = False
) -> NDArray[Any]:
    """Return a picture as a contiguous array, if a projector of this size and depth can show it.

    Parameters
    ----------
    picture : (rows, columns) array of counts, uint8 or uint16
    size_px : (columns, rows)
    bits : int
    colours : bool
        Whether (rows, columns, 3) can be shown as well.

    Raises
    ------
    InputError for another shape, type or counts beyond the depth.
    """
    shape, kind = size_px[::-1], np.dtype(np.uint8 if bits <= 8 else np.uint16)
    picture = np.asarray(picture)
    if picture.ndim == COLOURS and not colours:
        raise InputError("picture: expected one in grey, (rows, columns), got one in colours")
    if picture.shape not in (shape, (*shape, COLOURS)) or picture.dtype != kind:
        raise InputError(
            f"picture: expected {size_px[0]} × {size_px[1]} px of {kind}, got "
            f"{' × '.join(str(n) for n in picture.shape[::-1])} px of {picture.dtype}"
        )
    if picture.size and int(picture.max()) >= 2**bits:
        raise InputError(
            f"picture: expected counts below {2**bits} (a projector of {bits} bits), got "
            f"{int(picture.max())}"
        )
    return np.ascontiguousarray(picture)
