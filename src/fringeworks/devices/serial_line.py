"""Devices that take a line of text over a serial port and answer with lines."""

from __future__ import annotations

import time
from importlib import import_module
from typing import Any

from fringeworks.types import DeviceProblem, MissingPackage

READ_S = 0.05
"""Time after which a read that got nothing returns, s: short beside an answer's time."""
LONGEST_LINE = 1000
"""Bytes of a line from which on a device is not taken for the one that it should be."""


class SerialLine:
    """A serial port over which lines of ASCII are exchanged.

    Parameters
    ----------
    port : str
        Such as ``/dev/ttyUSB0`` or ``COM3``.
    baud : int
    name : str
        Name of the device in messages.

    Raises
    ------
    MissingPackage without pyserial, or with the package serial, whose module has the same name;
    DeviceProblem where the port does not open.
    """

    def __init__(self, port: str, baud: int, name: str) -> None:
        self._name = name
        try:
            serial = import_module("serial")
        except ImportError as error:
            raise MissingPackage(
                f"{name}: expected the package pyserial, got none; "
                "pip install 'fringeworks[devices]'"
            ) from error
        if not hasattr(serial, "Serial"):
            raise MissingPackage(
                f"{name}: expected the package pyserial, got another one with the module serial; "
                "pip uninstall serial, then pip install --force-reinstall pyserial"
            )
        try:
            self._port: Any = serial.Serial(port, baud, timeout=READ_S, write_timeout=1.0)
        except (OSError, ValueError) as error:
            raise DeviceProblem(
                f"{name}: expected a serial port {port} that this user may use, got none ({error})"
            ) from error
        self._begun = b""

    def send(self, line: str) -> None:
        """Send a line."""
        self.signal(line.encode("ascii") + b"\n")

    def signal(self, data: bytes) -> None:
        """Send bytes as they are."""
        if self._port is None:
            raise DeviceProblem(f"{self._name}: expected an open device, got a closed one")
        try:
            self._port.write(data)
        except OSError as error:
            raise self._gone() from error

    def line(self, within_s: float, wanted: str) -> str:
        """Return the next line that is not empty.

        Parameters
        ----------
        within_s : float
            Longest wait, s.
        wanted : str
            What is waited for, for the message.

        Raises
        ------
        DeviceProblem where none comes in time, or the device is gone.
        """
        if self._port is None:
            raise DeviceProblem(f"{self._name}: expected an open device, got a closed one")
        end_s = time.monotonic() + within_s
        while True:
            whole, newline, rest = self._begun.partition(b"\n")
            if newline:
                self._begun = rest
                text = whole.decode("ascii", errors="replace").strip()
                if text:
                    return text
                continue
            if time.monotonic() > end_s or self.endless:
                said = self._begun[:40].decode("ascii", errors="replace")
                got = f"{said!r} without an end" if self._begun else "nothing"
                raise DeviceProblem(
                    f"{self._name}: expected {wanted} within {within_s:.3g} s, got {got}: check "
                    "the port, the cable and the speed"
                )
            try:
                self._begun += self._port.read(max(1, self._port.in_waiting))
            except OSError as error:
                raise self._gone() from error

    @property
    def endless(self) -> bool:
        """Whether more has arrived without the end of a line than a line has."""
        return len(self._begun) > LONGEST_LINE

    def close(self) -> None:
        """Release the port; again without effect."""
        if self._port is not None:
            self._port.close()
            self._port = None

    def _gone(self) -> DeviceProblem:
        return DeviceProblem(
            f"{self._name}: expected a device that answers, got none: it was unplugged; connect it "
            "and open it again"
        )
