"""A box that makes pulses, counts pulses and dims a lamp: a microcontroller on a serial port.

Notes
-----
The protocol has one request and one answer a line, ASCII, at 115,200 baud:

===================== ================================ ===========================================
request               answer                           meaning
===================== ================================ ===========================================
``?``                 ``fringeworks-trigger 1``        which device this is, and its protocol
``P n period width``  ``ok``, later ``done n``         n pulses, one every ``period`` µs, each
                                                       ``width`` µs long
``S``                 ``ok``                           stop; ``done`` with the number made follows
                                                       where pulses were going on
``C``                 ``count n``                      pulses on the input since the last ``C``
``L level``           ``ok``                           lamp, 0 to 255
===================== ================================ ===========================================

Errors are ``error busy``, ``error range`` and ``error command``. The sketch
``examples/trigger_box/trigger_box.ino`` speaks it on an Arduino.
"""

from __future__ import annotations

import time

from fringeworks.devices.protocols import Closing
from fringeworks.devices.serial_line import SerialLine
from fringeworks.types import DeviceProblem, InputError, whole

BAUD = 115_200
"""Speed of the serial port, bits per second."""
GREETING = "fringeworks-trigger 1"
"""Name of the device and number of the protocol."""
STARTS_S = 4.0
"""Longest wait for the greeting, s: boards that restart when their port opens take two."""
ANSWER_S = 1.0
"""Longest wait for an answer, s."""
SILENCE_S = 0.3
"""Pause after which a board that restarts has written its last line, s: an ESP32 writes its lines
at once, and each takes 5 ms."""
SHORTEST_US = 20
"""Shortest width of a pulse and shortest time between two, µs: what an Arduino of 16 MHz keeps."""
LONGEST_US = 2**24 - 1
"""Longest period, µs; the protocol's numbers have 32 bits, and no scan needs longer pauses."""
MOST = 10_000
"""Largest number of pulses of a request."""
WORDS = {
    "error busy": "pulses are still going on; stop it first",
    "error range": "a number is out of range",
    "error command": "it does not know the request; load the sketch of this version",
}
"""What the box's errors mean."""


class TriggerBox(Closing):
    """A box that makes pulses for a projector or a camera.

    Parameters
    ----------
    port : str
        Serial port, such as ``/dev/ttyACM0`` or ``COM3``.

    Raises
    ------
    MissingPackage without pyserial; DeviceProblem where the port does not open or another device
    is there.
    """

    def __init__(self, port: str) -> None:
        self._name = f"trigger box {port}"
        self._line = SerialLine(port, BAUD, self._name)
        self._running = self._owes = False
        self._made: int | None = None
        self._counted = 0
        try:
            self._greet()
        except BaseException:
            self._line.close()
            raise

    def _greet(self) -> None:
        """Ask for the greeting until it comes, and take what came before it."""
        end_s = time.monotonic() + STARTS_S
        others: set[str] = set()
        # A board that restarts when its port is opened misses the first request, and may write
        # lines of its own.
        while True:
            self._line.send("?")
            within_s, heard = ANSWER_S, ""
            while True:
                try:
                    said = self._line.line(within_s, repr(GREETING))
                except DeviceProblem:
                    if time.monotonic() > end_s or self._line.endless:
                        raise
                    break
                if said == GREETING:
                    self._owes = False
                    return
                within_s, heard = SILENCE_S, said
                self._note(said)
            if heard in others or (heard and time.monotonic() > end_s):
                raise DeviceProblem(f"{self._name}: expected {GREETING!r}, got {heard!r}")
            others |= {heard} - {""}

    def pulses(self, count: int, *, period_us: int, width_us: int = 100) -> None:
        """Begin to make pulses; ``wait`` returns when they have been made.

        Parameters
        ----------
        count : int
            Number of pulses, 1 to 10,000.
        period_us, width_us : int
            Time from one pulse to the next, and length of a pulse, µs.

        Raises
        ------
        InputError for a number out of range; DeviceProblem where the box refuses or is gone.
        """
        if not whole(count, 1, MOST):
            raise InputError(f"count: expected 1 to {MOST} pulses, got {count}")
        fits = whole(width_us, SHORTEST_US, LONGEST_US) and whole(period_us, 1, LONGEST_US)
        if not fits or period_us - width_us < SHORTEST_US:
            raise InputError(
                f"period_us: expected a width of {SHORTEST_US} µs or more, and a period that is "
                f"longer by {SHORTEST_US} µs or more, got {width_us} µs every {period_us} µs"
            )
        self._ask(f"P {count} {period_us} {width_us}")
        self._running, self._made = True, None

    def wait(self, timeout_s: float) -> int:
        """Return the number of pulses that were made, once they are.

        Raises
        ------
        DeviceProblem where they have not ended in time.
        """
        while self._made is None:
            said = self._line.line(timeout_s, "the end of the pulses")
            if said != GREETING:
                self._made, self._running = self._number(said, "done"), False
        return self._made

    def stop(self) -> None:
        """Make no more pulses."""
        self._ask("S")
        if self._running:
            self.wait(ANSWER_S)

    def counted(self) -> int:
        """Return the number of pulses on the input since the last call that returned."""
        found = self._number(self._ask("C", "count"), "count") + self._counted
        self._counted = 0
        return found

    def lamp(self, level: int) -> None:
        """Dim the lamp: 0 for off, 255 for full light."""
        if not whole(level, 0, 255):
            raise InputError(f"level: expected 0 to 255, got {level}")
        self._ask(f"L {level}")

    def close(self) -> None:
        """Release the port; again without effect. Pulses that are going on are made."""
        self._line.close()

    def _ask(self, request: str, wanted: str = "ok") -> str:
        """Send a request; its answer, which begins with the wanted word."""
        if self._owes:
            # The answer to an earlier request may come yet, and is not the one to this.
            self._greet()
        self._line.send(request)
        self._owes = True
        said = self._line.line(ANSWER_S, f"an answer to {request!r}")
        while said == GREETING or said.startswith("done"):
            # The pulses of an earlier request ended before this one arrived.
            self._note(said)
            said = self._line.line(ANSWER_S, f"an answer to {request!r}")
        self._owes = False
        if said.startswith("error"):
            known = WORDS.get(said, f"it says {said!r}")
            raise DeviceProblem(f"{self._name}: the box refused {request!r}: {known}")
        if said.partition(" ")[0] != wanted:
            self._owes = True
            raise DeviceProblem(f"{self._name}: expected {wanted!r} to {request!r}, got {said!r}")
        return said

    def _note(self, said: str) -> None:
        """Keep what a line says that is not the answer: pulses that were made or counted."""
        word, _, number = said.partition(" ")
        if not number.isdecimal():
            return
        if word == "done" and self._running:
            self._made, self._running = int(number), False
        elif word == "count":
            self._counted += int(number)

    def _number(self, said: str, word: str) -> int:
        name, _, number = said.partition(" ")
        if name != word or not number.isdecimal():
            raise DeviceProblem(f"{self._name}: expected '{word}' and a number, got {said!r}")
        return int(number)
