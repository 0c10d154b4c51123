"""Turntables whose motor is driven by GRBL, the firmware of small milling machines.

Notes
-----
GRBL 1.1: a line of G-code is answered by ``ok`` or ``error:N``; an alarm is ``ALARM:N`` at any
time; ``?`` is answered by a status such as ``<Idle|MPos:…>`` (github.com/gnea/grbl, doc/markdown/
interface.md).
"""

from __future__ import annotations

import math
import time

from fringeworks.devices.protocols import Closing
from fringeworks.devices.serial_line import SerialLine
from fringeworks.types import DeviceProblem, InputError, finite, positive

BAUD = 115_200
"""Speed of GRBL's serial port, bits per second."""
STARTS_S = 3.0
"""Longest wait for the greeting, s: boards restart when their port opens."""
ANSWER_S = 2.0
"""Longest wait for an answer, s."""
POLL_S = 0.1
"""Pause between two questions whether the table stands."""
SPARE_S = 5.0
"""Time beyond that of a turn at its speed until the table must stand, s: acceleration and braking
of heavy tables."""
RESET, STATUS = b"\x18", b"?"
"""Bytes that GRBL takes at once, without the end of a line: start anew, and report the state."""
PAUSE = "G4 P0.01"
"""A pause of 10 ms. GRBL answers it when all turns before it have ended (interface.md,
"Synchronization")."""
ERRORS = {
    2: "a number has a wrong format",
    3: "the setting is not known",
    8: "the table still turns",
    9: "an alarm has locked it; clear the cause and switch it off and on",
    15: "the turn is beyond its travel; switch off soft limits ($20=0)",
    20: "it does not know the command",
    22: "the speed was never set",
}
"""Meaning of GRBL's errors (interface.md, error codes); others are given by their number."""
ALARMS = {
    1: "a limit switch was hit",
    2: "the turn is beyond its travel; switch off soft limits ($20=0)",
    3: "it was reset while it turned, so that its angle is lost",
}
"""Meaning of GRBL's alarms (interface.md, alarm codes)."""


class GrblTable(Closing):
    """A turntable on a GRBL controller.

    Parameters
    ----------
    port : str
        Serial port, such as ``/dev/ttyUSB0`` or ``COM3``.
    axis : str
        Axis of the controller that turns the table.
    units_per_turn : float
        Units of that axis, mm to the controller, for a whole turn: 360 where its steps per mm are
        steps per degree. Negative for a table that turns the other way.
    speed_deg_s : float
        Speed of turning, degrees per second.

    Raises
    ------
    MissingPackage without pyserial; DeviceProblem where the port does not open or has no GRBL.

    Notes
    -----
    The angle where the table stands when it is opened is 0°.
    """

    def __init__(
        self,
        port: str,
        *,
        axis: str = "X",
        units_per_turn: float = 360.0,
        speed_deg_s: float = 20.0,
    ) -> None:
        if axis not in ("X", "Y", "Z", "A"):
            raise InputError(f"axis: expected X, Y, Z or A, got {axis!r}")
        if not (finite(units_per_turn) and units_per_turn and positive(speed_deg_s)):
            raise InputError(
                "units_per_turn: expected a number other than 0 and a speed above 0, got "
                f"{units_per_turn:g} and {speed_deg_s:g}"
            )
        self._name = f"turntable {port}"
        self._axis, self._units, self._speed = axis, units_per_turn / 360.0, speed_deg_s
        self._angle_deg, self._lost = 0.0, False
        self._line = SerialLine(port, BAUD, self._name)
        try:
            self._greet()
        except BaseException:
            self._line.close()
            raise

    @property
    def angle_deg(self) -> float:
        """Angle at which the table stands, degrees."""
        return self._angle_deg

    def turn(self, angle_deg: float) -> None:
        """Turn to an angle and return when the table stands; for ``scan_turntable``.

        Raises
        ------
        InputError for no finite angle; DeviceProblem where the table refuses, does not arrive or is
        gone.
        """
        if not finite(angle_deg):
            raise InputError(f"angle_deg: expected a finite angle, got {angle_deg}")
        if self._lost:
            raise DeviceProblem(
                f"{self._name}: expected a table whose angle is known, got one whose last turn was "
                "not seen to end; open it again where it stands at 0°"
            )
        way = abs(angle_deg - self._angle_deg)
        feed = abs(self._units) * self._speed * 60.0
        self._ask(f"G90 G1 {self._axis}{self._units * angle_deg:.4f} F{feed:.2f}")
        self._lost = True
        self._arrive(way / self._speed + SPARE_S)
        self._angle_deg, self._lost = angle_deg, False

    def close(self) -> None:
        """Release the port; again without effect."""
        self._line.close()

    def _greet(self) -> None:
        end_s = time.monotonic() + STARTS_S
        self._line.signal(RESET)
        said, wanted = "", "the greeting of GRBL"
        while not said.startswith("Grbl"):
            said = self._line.line(max(end_s - time.monotonic(), 0.0), wanted)
            wanted = f"the greeting of GRBL after {said[:40]!r}"
        # The position where it stands counts as 0; an alarm after switching on is no fault.
        self._ask("$X")
        self._ask(f"G21 G92 {self._axis}0")

    def _ask(self, command: str) -> None:
        self._line.send(command)
        while (said := self._line.line(ANSWER_S, f"an answer to {command!r}")) != "ok":
            self._heed(said, command)

    def _heed(self, said: str, command: str) -> None:
        """Raise an error or alarm; other lines are messages."""
        kind, _, number = said.partition(":")
        for word, meanings in (("error", ERRORS), ("ALARM", ALARMS)):
            if kind == word:
                code = int(number) if number.isdecimal() else -1
                known = meanings.get(code, f"it says {said!r}")
                raise DeviceProblem(f"{self._name}: the table refused {command!r}: {known}")

    def _arrive(self, within_s: float) -> None:
        """Wait until the table stands: "Idle" is also its state before a turn begins, but a pause
        is answered after the turn only."""
        end_s = time.monotonic() + within_s
        self._line.send(PAUSE)
        paused = False
        while True:
            self._line.signal(STATUS)
            said = self._line.line(ANSWER_S, "the table's state")
            while not said.startswith("<"):
                paused |= said == "ok"
                self._heed(said, "the turn")
                said = self._line.line(ANSWER_S, "the table's state")
            state = said[1:].split("|")[0].split(":")[0].rstrip(">")
            if state == "Idle" and paused:
                return
            if state in ("Alarm", "Hold", "Door") or time.monotonic() > end_s:
                raise DeviceProblem(
                    f"{self._name}: expected a table that stands within {math.ceil(within_s)} s, "
                    f"got the state {state}: something holds it, or it is too slow"
                )
            time.sleep(POLL_S)
