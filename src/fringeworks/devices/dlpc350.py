"""Texas Instruments' controller DLPC350 (LightCrafter 4500) over USB.

Notes
-----
Commands and their data are those of the programmer's guide DLPU010, sections "Status Commands" and
"Pattern Sequence Commands", and of Texas Instruments' program for it (dlpc350_api.cpp), which
states the bits of the table of patterns and the order of two images.
"""

from __future__ import annotations

import os
import struct
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from fringeworks.devices.dlpc900 import DlpStatus
from fringeworks.devices.hid_link import HidDevice, HidLink, open_hid
from fringeworks.devices.protocols import checked_picture
from fringeworks.devices.sequencer import LEDS, SequenceSettings, Timed, least_exposure
from fringeworks.files.plan import PLAN_FILE, read_plan
from fringeworks.patterns.binary import PLANES
from fringeworks.patterns.encode import grey_pictures
from fringeworks.patterns.plan import PatternPlan
from fringeworks.types import DeviceProblem, InputError

IDS = (0x0451, 0x6401)
"""Vendor and product on USB."""
SIZE_PX = (912, 1140)
"""Columns and rows of the micromirror device DLP4500."""
LEAST_US = {1: 235, 8: 8333}
"""Shortest exposures by the depth, µs (DLPU010, Pattern Display Exposure and Frame Period)."""
SPARE_US = 230
"""Shortest dark time after a picture where there is any, µs (DLPU010, Validate Data)."""
MOST_ENTRIES = 128
"""Entries of the table of patterns (DLPU010, Pattern Display LUT Control)."""
READY_IMAGES = 2
"""Images that its memory holds at a time: 48 planes (DLPU011, section 4.1)."""
LOAD_S = 0.2
"""Longest time that it takes to load an image from its flash, s (DLPU011, section 4.1). Where a
sequence has more than two images, the pictures of each are shown for longer than that."""
TICK_US = 0.1072
"""Unit of the delays of triggers, µs (DLPU010, Trigger Out 1)."""
NO_DELAY = 0xBB
"""Number of the trigger outputs' delays that means none; the least is 0 and the largest 0xD5."""
LARGEST_DELAY = 0xD5
"""Largest number of the trigger outputs' delays, +2.787 µs."""
FROM_FLASH, STOP, START = 3, 0, 2
"""Source of the pictures; actions of the start command."""
IMAGES, PATTERNS, CLOSED = 1, 2, 0
"""Mailboxes: table of images, table of patterns, none."""
BUSY = 0x80
"""Bit of the answer to a check that says that it is still going on."""
CHECKED_S = 3.0
"""Longest wait for a check of the sequence, s; it takes about a second."""
PAUSE_S = 0.02
"""Pause between two questions whether the check has ended, s."""
INVALID = {
    0: "the exposure or the period is out of range; lengthen them, or use pictures of 1 bit",
    1: "a number of a picture is out of range",
    2: "the trigger output would never fall between pictures",
    3: "dark time is missing before a picture that waits for a trigger; lengthen the period",
    4: "the period exceeds the exposure by less than 230 µs; lengthen it",
}
"""Meaning of the bits that the check of a sequence answers with (DLPU010, Validate Data)."""
HARDWARE = {
    2: "operations of the micromirror device overlapped",
    3: "a forced swap of buffers has failed",
    6: "the sequencer has stopped after an error",
    7: "the sequencer has detected an error",
}
"""Meaning of the bits of the hardware status that say an error (DLPU010, section 2.1.1)."""


class Dlpc350(Timed):
    """A projector with the controller DLPC350, which plays the pictures of a plan from its flash.

    Parameters
    ----------
    plan : PatternPlan or path
        The plan, or the folder into which ``write_flash_images`` has written its images.
    settings : SequenceSettings, optional
        Their depth is that of the plan.
    serial : str, optional
        Serial number on USB; any projector by default.
    first_image : int
        Number of the plan's first image in the flash.
    pulses : callable, optional
        As for ``Dlpc900``.
    device : HidDevice, optional
        An open device in place of one of this computer.

    Raises
    ------
    MissingPackage without hidapi; DeviceProblem where there is no such projector, or its flash
    holds fewer images; InputError for a plan or settings that it cannot follow.

    Notes
    -----
    Its pictures cannot be loaded while it runs: write them with ``write_flash_images``, make a
    firmware of them with Texas Instruments' program, and load that once. An image of 24 bit holds
    24 pictures of 1 bit or three of 8 bit.
    """

    def __init__(
        self,
        plan: PatternPlan | str | os.PathLike[str],
        settings: SequenceSettings | None = None,
        *,
        serial: str = "",
        first_image: int = 0,
        pulses: Callable[[int], object] | None = None,
        device: HidDevice | None = None,
    ) -> None:
        self.plan = plan if isinstance(plan, PatternPlan) else read_plan(Path(plan) / PLAN_FILE)
        """The plan whose pictures lie in its flash."""
        if self.plan.bits not in LEAST_US or (self.plan.width_px, self.plan.height_px) != SIZE_PX:
            raise InputError(
                f"plan: expected {SIZE_PX[0]} × {SIZE_PX[1]} px and 1 or 8 bit for a DLPC350, got "
                f"{self.plan.width_px} × {self.plan.height_px} px and {self.plan.bits} bit"
            )
        bits: Literal[1, 8] = 1 if self.plan.bits == 1 else 8
        self.settings = replace(settings or SequenceSettings(), bits=bits)
        least_exposure("DLPC350", self.settings, LEAST_US, SPARE_US)
        self._first, self._pulses, self._entries = first_image, pulses, 0
        self._pictures: list[NDArray[Any]] = list(grey_pictures(self.plan))
        self._link = HidLink(device or open_hid(IDS, serial, "dlpc350"), "DLPC350")
        try:
            self._greet()
        except BaseException:
            self._link.close()
            raise

    def _greet(self) -> None:
        """See that the flash holds the images, and prepare the projector."""
        there = self._link.read(0x1A42, b"", "counts the images")[0]
        needed = self._first + self._image(self.plan.frames - 1)[0] + 1
        if there < needed:
            raise DeviceProblem(
                f"{self.name}: expected {needed} images in its flash for the plan, got {there}: "
                "load a firmware with the images of write_flash_images"
            )
        self.stop()
        self._link.write(0x1A1B, b"\1", "switches to sequences")
        self._link.write(0x1A22, bytes((FROM_FLASH,)), "takes pictures from the flash")
        self._link.write(0x1A23, b"\1", "shows pictures by time or trigger")
        self._set_triggers()

    @property
    def name(self) -> str:
        """``DLP4500 (DLPC350)``."""
        return "DLP4500 (DLPC350)"

    @property
    def size_px(self) -> tuple[int, int]:
        """Columns and rows of the micromirror device."""
        return SIZE_PX

    def portions(self, numbers: Sequence[int]) -> list[list[int]]:
        """Numbers of pictures that can be played without a pause for the flash."""
        parts: list[list[int]] = []
        for number in numbers:
            if parts and self._fits([*parts[-1], number]):
                parts[-1].append(number)
            else:
                parts.append([number])
        return parts

    def load(self, pictures: Sequence[NDArray[Any]], numbers: Sequence[int]) -> None:
        """Choose pictures of its flash, to be played once in their order.

        Raises
        ------
        DeviceProblem for a picture that is not that of the plan with its number.
        """
        for picture, number in zip(pictures, numbers, strict=True):
            picture = checked_picture(picture, self.size_px, self.bits)
            if not (0 <= number < self.plan.frames) or not np.array_equal(
                picture, self._pictures[number]
            ):
                raise DeviceProblem(
                    f"{self.name}: expected picture {number + 1} of the plan in its flash, got "
                    "another one: it shows no pictures that it does not hold"
                )
        self._load(numbers, repeat=False)

    def start(self) -> None:
        """Play the chosen pictures once, from the first one on."""
        if not self._entries:
            raise DeviceProblem(f"{self.name}: expected pictures to play, got none: load some")
        self._link.write(0x1A24, bytes((START,)), "starts the sequence")
        if self._pulses is not None and self.settings.trigger_in is not None:
            self._pulses(self._entries)

    def stop(self) -> None:
        """Stop the sequence: the next start begins with the first picture."""
        self._link.write(0x1A24, bytes((STOP,)), "stops the sequence")

    def show(self, picture: NDArray[Any]) -> float:
        """Show a picture of the plan until another one is; see ``Projector.show``."""
        picture = checked_picture(picture, self.size_px, self.bits)
        for number, held in enumerate(self._pictures):
            if np.array_equal(picture, held):
                self._load([number], repeat=True)
                self.start()
                return time.monotonic()
        raise DeviceProblem(
            f"{self.name}: expected a picture of the plan in its flash, got another one: it shows "
            "no test pictures, so its exposure is set by hand"
        )

    def status(self) -> DlpStatus:
        """Ask the controller how it is."""
        hardware = self._link.read(0x1A0A, b"", "reads the hardware status")[0]
        memory = self._link.read(0x1A0B, b"", "reads the system status")[0]
        main = self._link.read(0x1A0C, b"", "reads the main status")[0]
        problems = [said for bit, said in HARDWARE.items() if hardware >> bit & 1]
        if not hardware & 1:
            problems.insert(0, "the controller did not start")
        if not memory & 1:
            problems.append("the test of its memory has failed")
        return DlpStatus(bool(main & 2), bool(main & 1), tuple(problems))

    def close(self) -> None:
        """Stop the sequence and release the device; again without effect."""
        try:
            self.stop()
        except DeviceProblem:
            pass
        finally:
            self._link.close()

    def _image(self, number: int) -> tuple[int, int]:
        """Image of a picture, from the plan's first one, and its place there."""
        return divmod(number, PLANES // self.bits)

    def _images(self, numbers: Sequence[int]) -> list[int]:
        """Images in the order in which pictures need them."""
        images = [self._image(number)[0] for number in numbers]
        return [i for k, i in enumerate(images) if k == 0 or i != images[k - 1]]

    def _fits(self, numbers: Sequence[int]) -> bool:
        """Whether pictures can be played in one go."""
        images = self._images(numbers)
        if len(numbers) > MOST_ENTRIES:
            return False
        if len(images) <= READY_IMAGES:
            return True
        shown = [sum(self._image(n)[0] == i for n in numbers) for i in images]
        # An image is loaded while the one before it is shown; the first two are ready.
        return all(count * self.period_s > LOAD_S for count in shown[1:-1])

    def _set_triggers(self) -> None:
        settings = self.settings
        delays = []
        for name in ("trigger_out_delay_us", "trigger_out_end_delay_us"):
            value = getattr(settings, name)
            ticks = NO_DELAY + round(value / TICK_US)
            if not 0 <= ticks <= LARGEST_DELAY:
                low, high = (TICK_US * (n - NO_DELAY) for n in (0, LARGEST_DELAY))
                raise InputError(
                    f"{self.name}: {name}: expected {low:.4g} to {high:.4g} µs, got {value:g} µs"
                )
            delays.append(ticks)
        low = settings.trigger_out == "low"
        self._link.write(0x1A1D, bytes((low, *delays)), "sets the first trigger output")
        if settings.trigger_in is not None:
            ticks = round(settings.trigger_in_delay_us / TICK_US)
            self._link.write(0x1A35, struct.pack("<I", ticks), "sets the trigger input")

    def _load(self, numbers: Sequence[int], *, repeat: bool) -> None:
        """Write the tables of patterns and images, and have them checked."""
        self._entries = 0
        self.stop()
        images = [self._first + image for image in self._images(numbers)]
        shape = bytes((len(numbers) - 1, repeat, len(numbers) - 1, len(images) - 1))
        self._link.write(0x1A31, shape, "defines the sequence")
        settings = self.settings
        period = settings.exposure_us + settings.dark_us
        times = struct.pack("<II", settings.exposure_us, period)
        self._link.write(0x1A29, times, "sets exposure and period")
        # Two images are written in the reverse order, as the maker's program does.
        ordered = images[::-1] if len(images) == READY_IMAGES else images
        self._mail(IMAGES, bytes(ordered), "chooses the images")
        before, entries = None, b""
        for number in numbers:
            image, place = self._image(number)
            entries += self._entry(place, swaps=image != before)
            before = image
        self._mail(PATTERNS, entries, "defines the pictures")
        self._check()
        self._entries = len(numbers)

    def _entry(self, place: int, *, swaps: bool) -> bytes:
        """One entry of the table of patterns, three bytes."""
        settings = self.settings
        trigger = {None: 0, "rising": 1, "falling": 2}[settings.trigger_in]
        word = trigger | place << 2 | self.bits << 8 | LEDS.index(settings.colour) << 12
        dark = settings.dark_us > 0 or settings.trigger_in is not None
        return (word | dark << 17 | swaps << 18).to_bytes(3, "little")

    def _mail(self, box: int, data: bytes, what: str) -> None:
        self._link.write(0x1A33, bytes((box,)), what)
        self._link.write(0x1A32, b"\0", what)
        self._link.write(0x1A34, data, what)
        self._link.write(0x1A33, bytes((CLOSED,)), what)

    def _check(self) -> None:
        """Let the controller check the sequence, and say what it finds."""
        self._link.write(0x1A1A, b"\0", "checks the sequence")
        end_s = time.monotonic() + CHECKED_S
        while (found := self._link.read(0x1A1A, b"", "checks the sequence")[0]) & BUSY:
            if time.monotonic() > end_s:
                raise DeviceProblem(
                    f"{self.name}: expected its check of the sequence to end within "
                    f"{CHECKED_S:g} s, got a controller that is busy; switch it off and on"
                )
            time.sleep(PAUSE_S)
        wrong = [said for bit, said in INVALID.items() if found >> bit & 1]
        if wrong:
            raise DeviceProblem(f"{self.name}: the controller refused the sequence: {wrong[0]}")
