"""A DLPC350 over USB HID: the pictures of its flash, played by an emulator, and what it says."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from PIL import Image

import fringeworks as fw
from fringeworks.devices import dlpc350 as driver
from fringeworks.devices.dlpc350 import Dlpc350
from fringeworks.devices.protocols import Projector
from fringeworks.devices.sequencer import SequenceProjector, SequenceSettings
from fringeworks.files import read_stack
from fringeworks.files.flash_images import write_flash_images
from fringeworks.patterns.plan import PatternPlan, PhaseSteps, equal_steps
from fringeworks.scan.capture import capture
from fringeworks.types import DeviceProblem, InputError
from tests import fake_dlp
from tests.virtual_devices import Screen
from tests.wired_camera import WiredCamera

SLOW = SequenceSettings(exposure_us=9000, period_us=10_000)


def plan_of(frames, bits=8):
    blocks, left = [], frames
    while left:
        steps = min(left if left < 16 else 12, 12)
        blocks.append(PhaseSteps("y" if len(blocks) % 2 else "x", 20.0 + left, equal_steps(steps)))
        left -= steps
    return PatternPlan(912, 1140, tuple(blocks), bits=bits)


def flashed(folder, plan):
    """A controller whose flash holds what was written to a folder."""
    written = write_flash_images(folder, plan, force=True)
    return fake_dlp.Dlpc350([np.array(Image.open(path)) for path in written])


@pytest.mark.parametrize(("bits", "count"), [(8, 12), (8, 64), (1, 12), (1, 64)])
def test_pictures_of_the_flash_are_those_of_the_plan(tmp_path, bits, count):
    plan = plan_of(count, bits)
    assert plan.frames == count
    board = flashed(tmp_path, plan)
    assert len(board.flash) == -(-count * bits // 24)
    settings = SequenceSettings(exposure_us=100_000 if bits == 8 else 9000)
    projector = Dlpc350(tmp_path, settings, device=board)
    assert isinstance(projector, Projector)
    assert isinstance(projector, SequenceProjector)
    pictures = list(fw.encode(plan))
    played = []
    for part in projector.portions(range(count)):
        projector.load([pictures[n] for n in part], part)
        projector.start()
        projector.stop()
        played += board.played[-1]
    assert len(board.played) == 1
    for sent, seen in zip(pictures, played, strict=True):
        np.testing.assert_array_equal(sent, seen)


def test_fast_sequences_are_cut_where_the_flash_is_slow(tmp_path):
    """Two images are ready; three pictures of 10 ms are shorter than loading the next image."""
    plan = plan_of(24)
    projector = Dlpc350(plan, SLOW, device=flashed(tmp_path, plan))
    assert [len(part) for part in projector.portions(range(24))] == [6, 6, 6, 6]
    assert projector.portions([1, 4, 5, 20]) == [[1, 4, 5], [20]]
    slow = Dlpc350(plan, SequenceSettings(exposure_us=70_000), device=flashed(tmp_path, plan))
    assert [len(part) for part in slow.portions(range(24))] == [24]
    fast = plan_of(200, 1)
    settings = SequenceSettings(exposure_us=9000)
    projector = Dlpc350(fast, settings, device=flashed(tmp_path, fast))
    assert [len(part) for part in projector.portions(range(200))] == [128, 72]


def test_a_capture_with_a_lost_pulse(tmp_path):
    plan = plan_of(12)
    stacks = {}
    for name, missed in (("whole", ()), ("lost", (4,))):
        board = flashed(tmp_path / "p", plan)
        camera = WiredCamera(Screen(1140, 912), board, missed=missed)
        steps = []
        capture(
            Dlpc350(plan, SLOW, device=board), camera, plan, tmp_path / name, progress=steps.append
        )
        stacks[name] = read_stack(tmp_path / name).frames
    np.testing.assert_array_equal(stacks["whole"], stacks["lost"])
    assert [n for n, step in enumerate(steps) if "pulse 5 (" in step] == [4]
    assert camera.pulses == 18


def test_the_tables_are_written_as_the_guide_says(tmp_path):
    plan = plan_of(7)
    board = flashed(tmp_path, plan)
    settings = SequenceSettings(
        exposure_us=9000, period_us=9500, colour="red", trigger_in="falling",
        trigger_in_delay_us=150, trigger_out="low", trigger_out_delay_us=-10,
        trigger_out_end_delay_us=2,
    )  # fmt: skip
    pulses = []
    board.flash = [board.flash[0] * 0] * 5 + board.flash
    projector = Dlpc350(plan, settings, first_image=5, device=board, pulses=pulses.append)
    pictures = list(fw.encode(plan))
    projector.load(pictures, range(7))
    assert list(board.tables[1]) == [5, 6, 7]
    entries = board.entries()
    assert [e["number"] for e in entries] == [0, 1, 2, 0, 1, 2, 0]
    assert [e["image"] for e in entries] == [0, 0, 0, 1, 1, 1, 2]
    last = entries[-1]
    assert (last["trigger"], last["depth"], last["leds"], last["black"], last["inverts"]) == (
        2,
        8,
        1,
        1,
        0,
    )
    assert board.times == (9000, 9500)
    assert board.shape == (6, 0, 6, 2)
    assert board.trigger_out == (1, 0xBB - 93, 0xBB + 19)
    assert board.trigger_in == 1399
    projector.start()
    assert pulses == [7]
    assert projector.status().running
    np.testing.assert_array_equal(board.played[-1], pictures)
    projector.show(pictures[3])
    np.testing.assert_array_equal(board.played[-1], [pictures[3]])
    assert board.shape == (0, 1, 0, 0)
    projector.close()
    projector.close()
    assert board.closed


@pytest.mark.parametrize("bit", sorted(driver.INVALID))
def test_every_finding_of_its_check_is_one_sentence(tmp_path, bit):
    plan = plan_of(3)
    board = flashed(tmp_path, plan)
    projector = Dlpc350(plan, SLOW, device=board)
    board.extra_faults = 1 << bit
    with pytest.raises(DeviceProblem) as said:
        projector.load(list(fw.encode(plan)), range(3))
    begins = "DLP4500 (DLPC350): the controller refused the sequence: "
    assert str(said.value) == begins + driver.INVALID[bit]
    with pytest.raises(DeviceProblem, match="expected pictures to play, got none"):
        projector.start()


def test_busy_refused_and_wrong(tmp_path, monkeypatch):
    plan = plan_of(3)
    board = flashed(tmp_path, plan)
    projector = Dlpc350(plan, SLOW, device=board)
    pictures = list(fw.encode(plan))
    monkeypatch.setattr(driver, "CHECKED_S", 0.1)
    board.busy_for = 10**6
    with pytest.raises(DeviceProblem, match="end within 0.1 s, got a controller that is busy"):
        projector.load(pictures, range(3))
    board.busy_for = 0
    board.refused[0x1A31] = 1
    with pytest.raises(
        DeviceProblem, match=r"did not find the command that defines the sequence \(0x1A31\)"
    ):
        projector.load(pictures, range(3))
    board.refused.clear()
    with pytest.raises(DeviceProblem, match="expected picture 2 of the plan in its flash, got ano"):
        projector.load([pictures[0]], [1])
    with pytest.raises(DeviceProblem, match="expected a picture of the plan in its flash"):
        projector.show(np.zeros((1140, 912), np.uint8))
    board.hardware_status, board.memory_ok, board.parked = 0b11001100, 0, True
    status = projector.status()
    assert status.parked
    assert status.problems == (
        "the controller did not start", *driver.HARDWARE.values(), "the test of its memory has failed",
    )  # fmt: skip
    with pytest.raises(DeviceProblem, match="expected 1 images in its flash for the plan, got 0"):
        Dlpc350(plan, SLOW, device=fake_dlp.Dlpc350([]))


def test_an_answer_without_its_value(tmp_path):
    board = flashed(tmp_path, plan_of(3))
    board.empty.add(0x1A42)
    with pytest.raises(DeviceProblem, match="expected a value from the command that counts"):
        Dlpc350(plan_of(3), SLOW, device=board)


def test_what_it_cannot_show(tmp_path):
    plan = plan_of(3)
    board = flashed(tmp_path, plan)
    for settings, said in (
        (SequenceSettings(exposure_us=8000), "expected 8333 µs or more.*of 8 bit, got 8000"),
        (
            SequenceSettings(exposure_us=9000, period_us=9100),
            "period_us: expected the exposure, or 230 µs more",
        ),
        (
            SequenceSettings(trigger_out_delay_us=5),
            "trigger_out_delay_us: expected -20.05 to 2.787 µs, got 5",
        ),
    ):
        with pytest.raises(InputError, match=said):
            Dlpc350(plan, settings, device=board)
    for other in (
        PatternPlan(800, 600, plan.blocks),
        PatternPlan(912, 1140, plan.blocks, bits=10),
    ):
        with pytest.raises(InputError, match="plan: expected 912 × 1140 px and 1 or 8 bit"):
            Dlpc350(other, SLOW, device=board)
    with pytest.raises(InputError, match="expected pictures of 1 or 8 bit, got 10"):
        write_flash_images(tmp_path, PatternPlan(912, 1140, plan.blocks, bits=10))


def test_the_words_open_it(tmp_path, monkeypatch):
    plan = plan_of(3)
    board = flashed(tmp_path, plan)

    class Library:
        def device(self):
            return self

        def open(self, vendor, product, serial):
            assert (vendor, product, serial) == (0x0451, 0x6401, None)

        def enumerate(self, *_):
            return [{"serial_number": "LC1"}]

        def __getattr__(self, name):
            return getattr(board, name)

    monkeypatch.setitem(sys.modules, "hid", Library())
    with fw.devices.open_projector(f"dlpc350:{tmp_path},exposure_us=9000") as projector:
        assert projector.plan == plan
        assert projector.period_s == pytest.approx(0.009)
    with pytest.raises(DeviceProblem, match="dlpc350: expected dlpc350:FOLDER"):
        fw.devices.open_projector("dlpc350:exposure_us=9000")
    listed = [str(one) for one in fw.devices.list_devices()[0] if "dlpc350" in one.words]
    assert listed == ["dlpc350: a projector with the controller DLPC350, serial number LC1"]
