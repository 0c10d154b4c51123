"""What cameras of the GenICam standard have in common, whichever library talks to them."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from fringeworks.devices.pixel_formats import RAW, Channel, mosaic_of
from fringeworks.devices.protocols import CameraLimits
from fringeworks.types import CameraSettings, DeviceProblem, InputError

EXPOSURE_STEP_MS = 1e-3
"""Resolution in which exposures are compared, ms: GenICam's are whole or fractional µs."""
EXPOSURE_DIGITS = 4
"""Decimal places of exposures in µs that a camera is asked for: 0.1 ns is finer than any camera's
step, and far coarser than the rounding of ms to µs in double precision."""
SOFTWARE = "Software"
"""Trigger source of GenICam for a trigger that the computer sends."""
LINE = "Line"
"""Beginning of the names of trigger sources that are input lines (GenICam, Standard Features Naming
Convention, TriggerSource)."""

PTP_ENABLE = "PtpEnable", "GevIEEE1588"
PTP_STATUS = "PtpStatus", "GevIEEE1588Status"
"""Names of the features of PTP (Standard Features Naming Convention, and its version before
2.4)."""
PTP_OFFSET, PTP_LATCH = "PtpOffsetFromMaster", "PtpDataSetLatch"
"""Difference to the master's clock, ns, and the command that refreshes it."""
SETTLED = "Master", "Slave"
"""Statuses of a clock that is, or follows, the network's (IEEE 1588, port states)."""
PTP_PAUSE_S = 0.1
"""Pause between two questions for the status, s: masters announce themselves every one or two
seconds."""


class Coloured(ABC):
    """What a camera's pixel format says of its colours."""

    _channel: Channel | Literal["raw"]
    _colours: bool

    @abstractmethod
    def _pixel_format(self) -> str:
        """The name of the format in which it delivers frames."""

    @property
    def mosaic(self) -> str | None:
        """Filters of the raw frames that it delivers, as "rggb"; None where it delivers others."""
        return mosaic_of(self._pixel_format()) if self._channel == RAW else None

    @property
    def sees_colours(self) -> bool:
        """Whether it can deliver colours: its pixel format holds them, and it is not to be raw."""
        return self._channel != RAW and not self._pixel_format().startswith("Mono")

    def deliver_colours(self, wanted: bool) -> None:
        """Deliver frames in colour or in grey; see ``ColourCamera.deliver_colours``."""
        self._colours = wanted


@dataclass(frozen=True)
class Found:
    """A camera that answered to a search."""

    identifier: str
    """What opens it."""
    vendor: str
    model: str
    serial: str

    def __str__(self) -> str:
        return f"{self.identifier}: {self.vendor} {self.model}, serial number {self.serial}"


def exposure_us(exposure_ms: float) -> float:
    """Return an exposure in µs as a camera is asked for it.

    Cameras that count whole µs drop the rest, and 1e3 * 4.007 is a hair below 4007.

    Examples
    --------
    >>> exposure_us(4.007)
    4007.0
    """
    return round(1e3 * exposure_ms, EXPOSURE_DIGITS)


def input_line(name: str, sources: Sequence[str]) -> str:
    """Return the trigger source that pulses of a projector arrive on.

    Raises
    ------
    DeviceProblem for a camera without an input line.
    """
    lines = sorted(source for source in sources if source.startswith(LINE))
    if not lines:
        raise DeviceProblem(
            f"{name}: expected an input line as a trigger source, got "
            f"{', '.join(sources) or 'none'}"
        )
    # Line0 is an output of some makers, Line1 an input of most.
    return "Line1" if "Line1" in lines else lines[0]


def check_limits(name: str, limits: CameraLimits, settings: CameraSettings) -> None:
    """Refuse settings that a camera does not have.

    Raises
    ------
    InputError that names the limits.
    """
    for what in ("exposure_ms", "gain_db"):
        value, bounds = getattr(settings, what), getattr(limits, what)
        if value is None:
            continue
        if bounds is None:
            raise InputError(f"{name}: {what}: this camera has no such setting")
        if not bounds[0] - EXPOSURE_STEP_MS <= value <= bounds[1] + EXPOSURE_STEP_MS:
            raise InputError(
                f"{name}: {what}: expected {bounds[0]:g} to {bounds[1]:g}, got {value:g}"
            )
    pixels = settings.pixel_format
    if pixels is not None and pixels not in limits.pixel_formats:
        raise InputError(
            f"{name}: expected a pixel format of {', '.join(limits.pixel_formats)}; got {pixels}"
        )


def unplugged(name: str, reason: object) -> DeviceProblem:
    """Return what is said about a camera that answers no longer."""
    return DeviceProblem(
        f"{name}: expected a camera that answers, got none ({reason}): it was unplugged or "
        "switched off, or the network is down; connect it and resume"
    )


def settled(name: str, status: Callable[[], str], timeout_s: float) -> None:
    """Wait until a camera's clock is, or follows, that of the network.

    Raises
    ------
    DeviceProblem with the last status where that takes too long.
    """
    end_s = time.monotonic() + timeout_s
    while (last := status()) not in SETTLED:
        if time.monotonic() >= end_s:
            raise DeviceProblem(
                f"{name}: expected a clock that follows the network's (PTP) within {timeout_s:g} "
                f"s, got the status {last}; check that all cameras are in the same network, and "
                "that its switches hand PTP on"
            )
        time.sleep(PTP_PAUSE_S)


def no_ptp(name: str) -> DeviceProblem:
    """Return what is said about a camera without PTP."""
    return DeviceProblem(
        f"{name}: expected a camera with PTP (IEEE 1588), got one without {PTP_ENABLE[0]}"
    )
