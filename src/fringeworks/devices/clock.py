"""Clocks of virtual devices: the machine's, and one that only moves when a device waits."""

from __future__ import annotations

import time
from typing import Protocol, runtime_checkable


@runtime_checkable
class Clock(Protocol):
    """Time of virtual devices, s."""

    def now_s(self) -> float:
        """Return the present time, s."""

    def wait_until(self, time_s: float) -> None:
        """Return when the time has come; at once where it has passed."""


class SystemClock:
    """The clock of ``time.monotonic``; waiting takes real time."""

    def now_s(self) -> float:
        """Return the present time, s."""
        return time.monotonic()

    def wait_until(self, time_s: float) -> None:
        """Sleep until then."""
        time.sleep(max(0.0, time_s - time.monotonic()))


def clock_of(device: object) -> Clock:
    """Return the clock that a device lives on: a virtual device's own, else the machine's."""
    clock = getattr(device, "clock", None)
    return clock if isinstance(clock, Clock) else SystemClock()


class SimulatedClock:
    """A clock that jumps to the time that a device waits for: minutes pass in an instant."""

    def __init__(self) -> None:
        self._now_s = 0.0

    def now_s(self) -> float:
        """Return the present time, s."""
        return self._now_s

    def wait_until(self, time_s: float) -> None:
        """Set the clock to then."""
        self._now_s = max(self._now_s, time_s)
