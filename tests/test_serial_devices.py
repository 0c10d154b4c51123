"""A trigger box and a turntable on serial ports: the sketch itself, and GRBL as its guide says."""

from __future__ import annotations

import os
import shutil
import sys
import time
from types import ModuleType

import pytest

from fringeworks.devices.grbl import ERRORS, GrblTable
from fringeworks.devices.trigger_box import TriggerBox
from fringeworks.types import DeviceProblem, InputError, MissingPackage

pytest.importorskip("serial", reason="needs pyserial")
if sys.platform == "win32":
    pytest.skip("pseudo terminals are not on Windows", allow_module_level=True)

from tests.serial_peers import Grbl, peer, sketch, table_peer

pytestmark = pytest.mark.system


@pytest.mark.skipif(shutil.which("g++") is None, reason="needs g++")
def test_the_sketch_makes_and_counts_pulses(tmp_path):
    """The sketch of the examples, with its output wired to its input."""
    with sketch(tmp_path) as port, TriggerBox(port) as box:
        box.pulses(50, period_us=1000, width_us=50)
        with pytest.raises(
            DeviceProblem, match="refused 'P 1 1000 100': pulses are still going on"
        ):
            box.pulses(1, period_us=1000)
        assert box.wait(2.0) == 50
        assert box.counted() == 50
        assert box.counted() == 0
        box.lamp(128)
        # Stopped in the middle.
        box.pulses(10_000, period_us=1000)
        time.sleep(0.2)
        box.stop()
        assert 50 < box.counted() < 2000
        # The end of pulses that nobody waited for does not confuse the next answer.
        box.pulses(2, period_us=500)
        time.sleep(0.1)
        assert box.counted() == 2
        box.lamp(0)
    with pytest.raises(DeviceProblem, match="expected an open device, got a closed one"):
        box.lamp(1)


def test_numbers_are_checked_before_they_are_sent():
    with peer(lambda line: "fringeworks-trigger 1\n" if line == "?" else "ok\n") as (made, port):
        box = TriggerBox(port)
        for call, said in (
            (lambda: box.pulses(0, period_us=1000), "count: expected 1 to 10000 pulses, got 0"),
            (lambda: box.pulses(1, period_us=100), "got 100 µs every 100 µs"),
            (lambda: box.pulses(1, period_us=100, width_us=5), "a width of 20 µs or more"),
            (lambda: box.lamp(256), "level: expected 0 to 255, got 256"),
        ):
            with pytest.raises(InputError, match=said):
                call()
        assert set(made.heard) == {"?"}
        box.close()


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ("error range\n", "the box refused 'L 3': a number is out of range"),
        ("error command\n", "it does not know the request; load the sketch"),
        ("error 17\n", "it says 'error 17'"),
        ("maybe\n", "expected 'ok' to 'L 3', got 'maybe'"),
        ("count 4\n", "expected 'ok' to 'L 3', got 'count 4'"),
        ("", "expected an answer to 'L 3' within 1 s, got nothing"),
        ("ok", "got 'ok' without an end"),
        ("x" * 2000, "without an end"),
    ],
)
def test_what_a_box_says_wrong_is_one_sentence(answer, said):
    def talk(line):
        return "fringeworks-trigger 1\n" if line == "?" else answer

    with peer(talk) as (_, port), TriggerBox(port) as box, pytest.raises(DeviceProblem, match=said):
        box.lamp(3)


def test_another_device_is_not_taken_for_a_box():
    with (
        peer(lambda _: "Grbl 1.1h\n") as (_, port),
        pytest.raises(DeviceProblem, match="expected 'fringeworks-trigger 1', got 'Grbl 1.1h'"),
    ):
        TriggerBox(port)
    with pytest.raises(
        DeviceProblem, match="expected a serial port /dev/none that this user may use"
    ):
        TriggerBox("/dev/none")


class OddBox:
    """A box on another board: it writes lines of its own, answers late, and ends while it counts."""

    def __init__(self, boot=(), late=0, ends=False):
        self.boot, self.late, self.ends, self.seen = list(boot), late, ends, 7

    def __call__(self, line):
        if line == "?":
            said, self.boot = "".join(f"{one}\r\n" for one in self.boot), []
            return said + "fringeworks-trigger 1\r\n"
        if line == "C":
            if self.late:
                self.late -= 1
                time.sleep(1.3)
            seen, self.seen = self.seen, 0
            return ("done 10\r\n" if self.ends else "") + f"count {seen}\r\n"
        return "ok\r\n"


def test_lines_of_the_board_before_the_greeting_are_passed_over():
    boot = ["ESP-ROM:esp32c3-api1-20210207", "entry 0x403cc710", "fringeworks-trigger 1"]
    with peer(OddBox(boot)) as (_, port), TriggerBox(port) as box:
        box.lamp(5)
        assert box.counted() == 7


def test_pulses_that_end_while_they_are_counted_are_not_waited_for():
    with peer(OddBox(ends=True)) as (_, port), TriggerBox(port) as box:
        box.pulses(10, period_us=1000)
        assert box.counted() == 7
        begun = time.monotonic()
        assert box.wait(2.0) == 10
        assert time.monotonic() - begun < 0.1


def test_a_late_answer_is_not_that_to_the_next_request():
    with peer(OddBox(late=1)) as (_, port), TriggerBox(port) as box:
        with pytest.raises(DeviceProblem, match="expected an answer to 'C' within 1 s"):
            box.counted()
        box.lamp(3)
        # The pulses that the late answer counted are not lost.
        assert box.counted() == 7
        assert box.counted() == 0


def test_an_unplugged_box_is_said_within_a_second():
    with peer(lambda line: "fringeworks-trigger 1\n" if line == "?" else "ok\n") as (made, port):
        box = TriggerBox(port)
        made.stop()
        os.close(made._ours)
        begun = time.monotonic()
        with pytest.raises(DeviceProblem, match="unplugged|got nothing"):
            box.lamp(1)
        assert time.monotonic() - begun < 1.2
        box.close()


def test_a_table_turns_and_stands():
    board = Grbl()
    with table_peer(board) as (_, port):
        table = GrblTable(port, units_per_turn=-720.0, speed_deg_s=400.0)
        begun = time.monotonic()
        table.turn(90.0)
        assert time.monotonic() - begun > 0.2
        table.turn(45.0)
        assert board.moves == [(-180.0, 48000.0), (-90.0, 48000.0)]
        assert table.angle_deg == 45.0
        table.close()
        with pytest.raises(DeviceProblem, match="expected an open device"):
            table.turn(0.0)


@pytest.mark.parametrize("code", sorted(ERRORS))
def test_grbls_errors_are_one_sentence(code):
    with (
        table_peer(Grbl(f"error:{code}")) as (_, port),
        GrblTable(port) as table,
        pytest.raises(DeviceProblem) as said,
    ):
        table.turn(10.0)
    begins = f"turntable {port}: the table refused 'G90 G1 X10.0000 F1200.00': "
    assert str(said.value) == begins + ERRORS[code]


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("ALARM:1", "a limit switch was hit"),
        ("ALARM:77", "it says 'ALARM:77'"),
        ("error:33", "it says 'error:33'"),
        ("Hold", "got the state Hold: something holds it"),
        ("Alarm", "got the state Alarm"),
    ],
)
def test_a_table_that_does_not_arrive(fault, said):
    with (
        table_peer(Grbl(fault)) as (_, port),
        GrblTable(port, speed_deg_s=400.0) as t,
        pytest.raises(DeviceProblem, match=said),
    ):
        t.turn(10.0)


def test_a_table_that_has_not_begun_to_turn_is_waited_for():
    """Until its motion begins, GRBL says "Idle"."""
    with table_peer(Grbl(begins_s=0.15)) as (_, port), GrblTable(port, speed_deg_s=100.0) as table:
        begun = time.monotonic()
        table.turn(30.0)
        assert time.monotonic() - begun > 0.45


def test_after_a_turn_that_was_held_the_angle_is_unknown():
    with table_peer(Grbl("Hold")) as (_, port), GrblTable(port, speed_deg_s=400.0) as table:
        with pytest.raises(DeviceProblem, match="something holds it"):
            table.turn(10.0)
        with pytest.raises(DeviceProblem, match="expected a table whose angle is known"):
            table.turn(20.0)
        assert table.angle_deg == 0.0


def test_tables_that_are_none():
    with (
        peer(lambda _: "") as (_, port),
        pytest.raises(DeviceProblem, match="expected the greeting of GRBL within .*got nothing"),
    ):
        GrblTable(port)
    for options, said in (
        ({"axis": "Q"}, "axis: expected X, Y, Z or A, got 'Q'"),
        ({"units_per_turn": 0.0}, "expected a number other than 0"),
        ({"speed_deg_s": -1.0}, "a speed above 0"),
    ):
        with pytest.raises(InputError, match=said):
            GrblTable("/dev/none", **options)
    with (
        table_peer(Grbl()) as (_, port),
        GrblTable(port) as t,
        pytest.raises(InputError, match="a finite angle"),
    ):
        t.turn(float("nan"))


def test_without_pyserial(monkeypatch):
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(
        MissingPackage, match="expected the package pyserial, got none; pip install"
    ):
        TriggerBox("/dev/none")


def test_another_package_with_the_module_serial(monkeypatch):
    """The package serial has nothing to do with ports."""
    monkeypatch.setitem(sys.modules, "serial", ModuleType("serial"))
    with pytest.raises(MissingPackage, match="pyserial, got another one .* uninstall serial"):
        TriggerBox("/dev/none")
