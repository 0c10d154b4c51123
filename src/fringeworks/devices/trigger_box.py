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
        self._running = False
        try:
            self._greet()
        except BaseException:
            self._line.close()
            raise

    def _greet(self) -> None:
        problem = DeviceProblem(f"{self._name}: expected {GREETING!r}, got nothing")
        # A board that restarts when its port is opened misses the first request.
        for _ in range(int(STARTS_S / ANSWER_S)):
            self._line.send("?")
            try:
                said = self._line.line(ANSWER_S, repr(GREETING))
            except DeviceProblem as error:
                problem = error
                continue
            if said != GREETING:
                raise DeviceProblem(f"{self._name}: expected {GREETING!r}, got {said!r}")
            self._line.forget()
            return
        raise problem

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
        self._running = True

    def wait(self, timeout_s: float) -> int:
        """Return the number of pulses that were made, once they are.

        Raises
        ------
        DeviceProblem where they have not ended in time.
        """
        said = self._line.line(timeout_s, "the end of the pulses")
        self._running = False
        return self._number(said, "done")

    def stop(self) -> None:
        """Make no more pulses."""
        self._ask("S")
        if self._running:
            self.wait(ANSWER_S)

    def counted(self) -> int:
        """Return the number of pulses on the input since the last call."""
        return self._number(self._ask("C"), "count")

    def lamp(self, level: int) -> None:
        """Dim the lamp: 0 for off, 255 for full light."""
        if not whole(level, 0, 255):
            raise InputError(f"level: expected 0 to 255, got {level}")
        self._ask(f"L {level}")

    def close(self) -> None:
        """Release the port; again without effect. Pulses that are going on are made."""
        self._line.close()

    def _ask(self, request: str) -> str:
        self._line.send(request)
        said = self._line.line(ANSWER_S, f"an answer to {request!r}")
        while said.startswith("done"):
            # The pulses of an earlier request ended before this one arrived.
            self._running = False
            said = self._line.line(ANSWER_S, f"an answer to {request!r}")
        if said.startswith("error"):
            known = WORDS.get(said, f"it says {said!r}")
            raise DeviceProblem(f"{self._name}: the box refused {request!r}: {known}")
        if said != "ok" and not said.startswith("count "):
            raise DeviceProblem(f"{self._name}: expected 'ok' to {request!r}, got {said!r}")
        return said

    def _number(self, said: str, word: str) -> int:
        name, _, number = said.partition(" ")
        if name != word or not number.isdecimal():
            raise DeviceProblem(f"{self._name}: expected '{word}' and a number, got {said!r}")
        return int(number)
