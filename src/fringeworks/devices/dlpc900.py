"""Texas Instruments' controller DLPC900 (LightCrafter 6500 and 9000) over USB.

Notes
-----
Commands, their data and the error codes are those of the programmer's guide DLPU018, sections
"Status Commands" and "Display Mode Commands".
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.devices.dlp_image import encoded
from fringeworks.devices.hid_link import HidDevice, HidLink, Refused, open_hid
from fringeworks.devices.protocols import checked_picture
from fringeworks.devices.sequencer import LEDS, SequenceSettings, Timed, least_exposure
from fringeworks.patterns.binary import PLANES, packed
from fringeworks.types import DeviceProblem, InputError

IDS = (0x0451, 0xC900)
"""Vendor and product on USB."""
LEAST_US = {1: 105, 8: 4046}
"""Shortest exposures by the depth, µs: Texas Instruments' support forum, thread 953168. The
controller itself refuses what its light engine cannot show."""
SIZES_PX = {1: (1920, 1080), 2: (2560, 1600), 3: (2716, 1600), 4: (2048, 1200), 5: (1024, 768)}
"""Columns and rows by the number of the hardware (DLPU018, "Reading Hardware Configuration"):
DLP6500, DLP9000, DLP670S, DLP500YX and DLP5500."""
MODELS = {1: "DLP6500", 2: "DLP9000", 3: "DLP670S", 4: "DLP500YX", 5: "DLP5500"}
"""Micromirror devices by the number of the hardware."""
MOST_PLANES = 400
"""Planes of one bit that the memory holds: entries of the table of patterns (DLPU018, Table 2-139),
and 50 pictures of 8 bit (DLPU102)."""
CHUNK = 504
"""Bytes of an image in a command: 512 of a packet less header, command and length (DLPU018, Pattern
BMP Load)."""
TRIGGER_OUT_US = (-20, 20_000)
"""Range of the delays of the trigger outputs, µs (DLPU018, Trigger Out 1)."""
TRIGGER_IN_US = (105, 65_535)
"""Range of the delay of the trigger input, µs: the time that loading a plane takes, and two
bytes (DLPU018, Trigger In 1)."""
ON_THE_FLY, STOP, START = 3, 0, 2
"""Display mode with pictures from USB; actions of the start command."""
HARDWARE = {
    1: "the controller and the micromirror device do not fit, or the firmware is that of another",
    2: "operations of the micromirror device overlapped",
    3: "a forced swap of buffers has failed",
    6: "the sequencer has stopped after an error",
    7: "the sequencer has detected an error",
}
"""Meaning of the bits of the hardware status that say an error (DLPU018, section 2.1.1)."""
ERRORS = {
    1: "the sum of a batch file is wrong",
    2: "the device has failed; switch the projector off and on",
    3: "its firmware does not know this command; update the firmware",
    4: "the controller and the micromirror device do not fit",
    5: "the command is not allowed in the present mode; stop other programs that use the projector",
    6: "a value of the command is not allowed",
    7: "what the command refers to is not there",
    8: "its memory is full; load fewer pictures",
    9: "it does not know the compression of the image",
    10: "the bit of a picture lies outside its image",
    11: "an image that the sequence needs is not in its memory",
    12: "the dark time after a picture is out of range; change the period",
    13: "the delay of a trigger is out of range",
    14: "the exposure is out of range; expose for a longer time or use pictures of 1 bit",
    15: "the number of a picture is out of range",
    16: "the definition of a picture is not valid",
    17: "the address of an image lies outside its memory",
    255: "its firmware has failed; switch the projector off and on",
}
"""Error codes of the controller (DLPU018, section 2.1.6, Read Error Code)."""


@dataclass(frozen=True)
class DlpStatus:
    """What a controller says about itself."""

    running: bool
    """Whether a sequence is playing."""
    parked: bool
    """Whether the micromirrors are parked, so that no picture is shown."""
    problems: tuple[str, ...]
    """Errors of the hardware, a sentence each; empty where there are none."""


class Dlpc900(Timed):
    """A projector with the controller DLPC900, which plays pictures from its memory.

    Parameters
    ----------
    serial : str, optional
        Serial number on USB; any projector by default.
    settings : SequenceSettings, optional
    pulses : callable, optional
        Called with the number of pictures after a sequence with ``trigger_in`` was started; makes
        the pulses on the trigger input, such as ``TriggerBox.pulses``.
    device : HidDevice, optional
        An open device in place of one of this computer.

    Raises
    ------
    MissingPackage without hidapi; DeviceProblem where there is no such projector; InputError for
    settings that it cannot follow.

    Notes
    -----
    Pictures are loaded over USB while the projector runs ("pattern on the fly"). With pictures of
    1 bit up to 400, with 8 bit up to 50 are loaded at a time, and further ones are loaded when
    these have been played. TRIG_OUT_1 is active while a picture is shown: connect it to the
    camera's trigger input.
    """

    def __init__(
        self,
        serial: str = "",
        settings: SequenceSettings | None = None,
        *,
        pulses: Callable[[int], object] | None = None,
        device: HidDevice | None = None,
    ) -> None:
        self.settings = settings or SequenceSettings()
        self._pulses = pulses
        self._name = "DLPC900"
        least_exposure(self._name, self.settings, LEAST_US)
        self._link = HidLink(device or open_hid(IDS, serial, "dlpc900"), self._name)
        try:
            self._greet()
        except BaseException:
            self._link.close()
            raise
        self._entries = 0

    def _greet(self) -> None:
        """Learn what the projector is, and prepare it."""
        number = self._link.read(0x0206, b"", "reads the hardware")[0]
        if number not in SIZES_PX:
            raise DeviceProblem(
                f"{self._name}: expected one of {', '.join(MODELS.values())}, got hardware number "
                f"{number}"
            )
        self._size_px = SIZES_PX[number]
        self._name = f"{MODELS[number]} (DLPC900)"
        self._link.rename(self._name)
        state = self._link.read(0x1A0A, b"", "reads the hardware status")[0]
        self._dual = bool(state & 0x10)
        self._command(0x1A24, bytes((STOP,)), "stops the sequence")
        self._command(0x1A1B, bytes((ON_THE_FLY,)), "takes pictures from USB")
        self._set_triggers()

    @property
    def name(self) -> str:
        """Micromirror device and controller."""
        return self._name

    @property
    def size_px(self) -> tuple[int, int]:
        """Columns and rows of the micromirror device."""
        return self._size_px

    def portions(self, numbers: Sequence[int]) -> list[list[int]]:
        """Numbers of pictures in the portions that its memory holds at a time."""
        most = MOST_PLANES // self.bits
        return [list(numbers[k : k + most]) for k in range(0, len(numbers), most)]

    def load(self, pictures: Sequence[NDArray[Any]], numbers: Sequence[int]) -> None:
        """Load pictures into its memory, to be played once in their order."""
        del numbers
        self._load(pictures, repeat=False)

    def start(self) -> None:
        """Play the loaded pictures once, from the first one on."""
        if not self._entries:
            raise DeviceProblem(
                f"{self.name}: expected pictures in its memory, got none: load some"
            )
        self._command(0x1A24, bytes((START,)), "starts the sequence")
        if self._pulses is not None and self.settings.trigger_in is not None:
            self._pulses(self._entries)

    def stop(self) -> None:
        """Stop the sequence: the next start begins with the first picture."""
        self._command(0x1A24, bytes((STOP,)), "stops the sequence")

    def show(self, picture: NDArray[Any]) -> float:
        """Load one picture and show it until the next one is; see ``Projector.show``.

        Loading takes from a tenth of a second to a minute, by how well the picture compresses.
        """
        self._load([picture], repeat=True)
        self._command(0x1A24, bytes((START,)), "starts the sequence")
        return time.monotonic()

    def status(self) -> DlpStatus:
        """Ask the controller how it is."""
        hardware = self._link.read(0x1A0A, b"", "reads the hardware status")[0]
        main = self._link.read(0x1A0C, b"", "reads the main status")[0]
        problems = [said for bit, said in HARDWARE.items() if hardware >> bit & 1]
        if not hardware & 1:
            problems.insert(0, "the controller did not start")
        return DlpStatus(bool(main & 2), bool(main & 1), tuple(problems))

    def close(self) -> None:
        """Stop the sequence and release the device; again without effect."""
        try:
            self._link.write(0x1A24, bytes((STOP,)), "stops the sequence")
        except DeviceProblem:
            pass
        finally:
            self._link.close()

    def _command(self, command: int, data: bytes, what: str) -> None:
        """Send a command, and say in words why the controller refuses it."""
        self._sent(command, data, what)
        self._explain(what)

    def _sent(self, command: int, data: bytes, what: str) -> None:
        try:
            self._link.write(command, data, what)
        except Refused:
            self._explain(what)
            raise

    def _set_triggers(self) -> None:
        settings = self.settings
        out = settings.trigger_out_delay_us, settings.trigger_out_end_delay_us
        begin, end = (self._whole("trigger_out_delay_us", d, TRIGGER_OUT_US) for d in out)
        low = settings.trigger_out == "low"
        self._command(0x1A1D, struct.pack("<Bhh", low, begin, end), "sets the first trigger output")
        if settings.trigger_in is not None:
            delay = self._whole("trigger_in_delay_us", settings.trigger_in_delay_us, TRIGGER_IN_US)
            falling = settings.trigger_in == "falling"
            self._command(0x1A35, struct.pack("<HB", delay, falling), "sets the trigger input")

    def _whole(self, what: str, value: float, bounds: tuple[int, int]) -> int:
        """A delay in whole µs, as the controller takes it."""
        if not bounds[0] <= value <= bounds[1] or value != round(value):
            raise InputError(
                f"{self._name}: {what}: expected whole µs from {bounds[0]} to {bounds[1]}, got "
                f"{value:g}"
            )
        return round(value)

    def _load(self, pictures: Sequence[NDArray[Any]], *, repeat: bool) -> None:
        most = MOST_PLANES // self.bits
        if not 1 <= len(pictures) <= most:
            raise InputError(
                f"{self.name}: expected 1 to {most} pictures of {self.bits} bit at a time, got "
                f"{len(pictures)}"
            )
        checked = [checked_picture(picture, self.size_px, self.bits) for picture in pictures]
        self._entries = 0
        self.stop()
        self._command(0x1A1B, bytes((ON_THE_FLY,)), "takes pictures from USB")
        for k in range(len(checked)):
            self._command(0x1A34, self._definition(k), f"defines picture {k + 1}")
        shown = struct.pack("<HI", len(checked), 0 if repeat else len(checked))
        self._command(0x1A31, shown, "defines the sequence")
        each = PLANES // self.bits
        images = [packed(checked[k : k + each], self.bits) for k in range(0, len(checked), each)]
        # The guide wants the last image first.
        for index, image in reversed(list(enumerate(images))):
            self._send_image(index, image)
        self._entries = len(checked)

    def _definition(self, number: int) -> bytes:
        """One entry of the table of patterns (DLPU018, Pattern Display LUT Definition)."""
        settings = self.settings
        image, place = divmod(number, PLANES // self.bits)
        options = 1 | (self.bits - 1) << 1 | LEDS.index(settings.colour) << 4
        options |= (settings.trigger_in is not None) << 7
        exposure, dark = (t.to_bytes(3, "little") for t in (settings.exposure_us, settings.dark_us))
        where = struct.pack("<H", image | place * self.bits << 11)
        return struct.pack("<H", number) + exposure + bytes((options,)) + dark + b"\0" + where

    def _send_image(self, index: int, image: NDArray[np.uint32]) -> None:
        """Load an image; each controller of two gets its half."""
        halves: Iterable[NDArray[np.uint32]] = [image]
        if self._dual:
            halves = np.hsplit(image, 2)
        for half, first in zip(halves, (0x1A2A, 0x1A2C), strict=False):
            data = encoded(np.ascontiguousarray(half))
            what = f"loads image {index + 1}"
            self._command(first, struct.pack("<HI", index, len(data)), what)
            for start in range(0, len(data), CHUNK):
                part = data[start : start + CHUNK]
                chunk = struct.pack("<H", len(part)) + part
                if start + CHUNK < len(data):
                    # A refusal shows in the reply; the error code is read at the end.
                    self._sent(first + 1, chunk, what)
                else:
                    self._command(first + 1, chunk, what)

    def _explain(self, what: str) -> None:
        """Raise what the controller has to say about the last commands, if anything."""
        code = self._link.read(0x0100, b"", "reads the error code")[0]
        if code:
            unknown = f"it gives the error code {code}, which the guide does not list"
            said = ERRORS.get(code, unknown)
            raise DeviceProblem(
                f"{self._name}: the controller refused the command that {what}: {said}"
            )
