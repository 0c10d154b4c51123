"""Commands of Texas Instruments' DLP controllers as reports of USB HID.

Notes
-----
The packets are those of the programmer's guides DLPU010 (DLPC350) and DLPU018 (DLPC900), section
"USB Interface": a flag byte, a sequence byte, the length of the rest, the command, and its data,
each least significant byte first, cut into reports of 64 bytes.
"""

from __future__ import annotations

import struct
from importlib import import_module
from typing import Any, Protocol

from fringeworks.types import DeviceProblem, MissingPackage

REPORT = 64
"""Bytes of a report, without the number of the report before them (guides, "USB Interface")."""
READS, REPLY, FAILED = 0x80, 0x40, 0x20
"""Bits of the flag byte: a read; a reply is wanted; the command was not found or has failed."""
HEADER = struct.Struct("<BBH")
"""Flag byte, sequence byte, number of bytes that follow."""
ANSWER_MS = 2000
"""Longest wait for a reply, ms. Replies take milliseconds, and the DLPC350 takes up to 200 ms to
load an image from its flash (DLPU011, section 4.1)."""
STALE = 8
"""Replies to earlier commands that are thrown away before a command counts as unanswered: more than
a program that was interrupted leaves behind."""


class HidDevice(Protocol):
    """What is used of ``hid.device`` of the package hidapi."""

    def write(self, report: bytes, /) -> int:
        """Send the number of the report, 0, and its bytes; −1 where that fails."""

    def read(self, length: int, timeout_ms: int, /) -> list[int]:
        """Return the bytes of the next report; none where no report comes in time."""

    def close(self) -> None:
        """Release the device."""


class Refused(DeviceProblem):
    """The controller answers that it did not find the command, or that the command has failed."""


class HidLink:
    """Sends commands to a controller and reads its replies.

    Parameters
    ----------
    device : HidDevice
        An open device.
    name : str
        Name of the projector in messages.
    """

    def __init__(self, device: HidDevice, name: str) -> None:
        self._device: HidDevice | None = device
        self._name = name
        self._sequence = 0

    def rename(self, name: str) -> None:
        """Use another name of the projector in messages."""
        self._name = name

    def write(self, command: int, data: bytes, what: str) -> None:
        """Send a command and wait until the controller has accepted it.

        Parameters
        ----------
        command : int
            Its number in the guide, such as 0x1A24.
        data : bytes
        what : str
            What the command does, for messages.

        Raises
        ------
        Refused where the controller does not accept it; DeviceProblem where it does not answer.
        """
        self._exchange(REPLY, command, data, what)

    def read(self, command: int, data: bytes, what: str) -> bytes:
        """Ask the controller for a value of one byte or more; see ``write``."""
        reply = self._exchange(READS | REPLY, command, data, what)
        if not reply:
            raise DeviceProblem(
                f"{self._name}: expected a value from the command that {what}, got an answer "
                "without one: its firmware is another one than that of the guide; update it"
            )
        return reply

    def close(self) -> None:
        """Release the device; again without effect."""
        if self._device is not None:
            self._device.close()
            self._device = None

    def _exchange(self, flags: int, command: int, data: bytes, what: str) -> bytes:
        if self._device is None:
            raise DeviceProblem(f"{self._name}: expected an open projector, got a closed one")
        self._sequence = (self._sequence + 1) % 256
        head = HEADER.pack(flags, self._sequence, len(data) + 2)
        packet = head + struct.pack("<H", command) + data
        for start in range(0, len(packet), REPORT):
            part = packet[start : start + REPORT]
            self._sent(bytes(1) + part.ljust(REPORT, b"\0"), what)
        for _ in range(STALE):
            answered, sequence, reply = self._reply(what)
            if sequence == self._sequence:
                break
        else:
            raise DeviceProblem(
                f"{self._name}: expected a reply to the command that {what}, got replies to other "
                "commands: another program uses the projector; close it"
            )
        if answered & FAILED:
            raise Refused(
                f"{self._name}: the controller did not find the command that {what} "
                f"(0x{command:04X}), or the command has failed"
            )
        return reply

    def _sent(self, report: bytes, what: str) -> None:
        assert self._device is not None
        try:
            count = self._device.write(report)
        except (OSError, ValueError) as error:
            raise self._gone(what) from error
        if count < 0:
            raise self._gone(what)

    def _reply(self, what: str) -> tuple[int, int, bytes]:
        """Flags, sequence byte and data of the next reply."""
        first = self._report(what)
        flags, sequence, length = HEADER.unpack_from(first)
        data = first[HEADER.size :]
        while len(data) < length:
            data += self._report(what)
        return flags, sequence, data[:length]

    def _report(self, what: str) -> bytes:
        assert self._device is not None
        try:
            report = bytes(self._device.read(REPORT, ANSWER_MS))
        except (OSError, ValueError) as error:
            raise self._gone(what) from error
        if not report:
            raise DeviceProblem(
                f"{self._name}: expected a reply to the command that {what} within "
                f"{1e-3 * ANSWER_MS:g} s, got none: the controller is busy or stands still; "
                "wait, or switch the projector off and on"
            )
        return report.ljust(REPORT, b"\0")

    def _gone(self, what: str) -> DeviceProblem:
        return DeviceProblem(
            f"{self._name}: expected a projector that takes the command that {what}, got none: it "
            "was unplugged or switched off; connect it and resume"
        )


def hid_library() -> Any:
    """Return the module ``hid`` of the package hidapi.

    Raises
    ------
    MissingPackage where it is not installed, or the package hid, whose module has the same name.
    """
    try:
        found = import_module("hid")
    except ImportError as error:
        raise MissingPackage(
            "a DLP projector: expected the package hidapi, got none; "
            "pip install 'fringeworks[devices]'"
        ) from error
    if not hasattr(found, "device"):
        raise MissingPackage(
            "a DLP projector: expected the package hidapi, got another one with the module hid; "
            "pip uninstall hid, then pip install --force-reinstall hidapi"
        )
    return found


def open_hid(ids: tuple[int, int], serial: str, name: str) -> HidDevice:
    """Open a device by vendor and product, and by its name in ``hid_serials`` where that is given.

    Raises
    ------
    MissingPackage without hidapi; DeviceProblem where there is no such device, or this user may not
    use it.
    """
    library = hid_library()
    device: HidDevice = library.device()
    try:
        path = next((p for named, p in _connected(ids) if serial and named == serial), None)
        if path is None:
            device.open(*ids, serial or None)  # type: ignore[attr-defined]
        else:
            device.open_path(path)  # type: ignore[attr-defined]
    except (OSError, ValueError) as error:
        there = ", ".join(hid_serials(ids)) or "none"
        raise DeviceProblem(
            f"{name}: expected a projector that is connected and that this user may use, got none "
            f"that opens; serial numbers of those that are there: {there}. On Linux a rule of udev "
            f"for {ids[0]:04x}:{ids[1]:04x} gives users access"
        ) from error
    return device


def hid_serials(ids: tuple[int, int]) -> list[str]:
    """Return the serial numbers of the devices of a vendor and product that are connected, or their
    places where they have none."""
    return [name for name, _ in _connected(ids)]


def _connected(ids: tuple[int, int]) -> list[tuple[str, bytes | None]]:
    """Serial numbers of devices; or their places, as words and as hidapi takes them."""
    found = hid_library().enumerate(*ids)
    return [
        (one["serial_number"], None)
        if one["serial_number"]
        else (one["path"].decode(errors="replace"), one["path"])
        for one in found
    ]
