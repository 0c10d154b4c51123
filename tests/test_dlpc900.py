"""A DLPC900 over USB HID: what it is sent, decoded by an emulator, and what it says."""

from __future__ import annotations

import sys
from types import ModuleType

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.devices import dlpc900 as driver
from fringeworks.devices.dlp_image import encoded
from fringeworks.devices.dlpc900 import Dlpc900
from fringeworks.devices.protocols import Projector
from fringeworks.devices.sequencer import SequenceProjector, SequenceSettings, settings_of
from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps, equal_steps
from fringeworks.types import DeviceProblem, InputError, MissingPackage
from tests import fake_dlp, fake_erle

FAST = SequenceSettings(exposure_us=105, bits=1)


def plan_of(columns, rows):
    """64 pictures of fringes along both axes."""
    blocks = [
        PhaseSteps(axis, period, equal_steps(16))
        for axis, period in (("x", 20.0), ("y", 24.0), ("x", 333.3), ("y", 180.0))
    ]
    return PatternPlan(columns, rows, tuple(blocks))


def gray(count, columns, rows):
    """Pictures of one bit: Gray codes along both axes, then noise."""
    codes = (GrayCode("x", 8.0, columns), GrayCode("y", 8.0, rows))
    lit = [p // 255 for p in fw.encode(PatternPlan(columns, rows, codes))]
    rng = np.random.default_rng(count)
    noise = [rng.integers(0, 2, (rows, columns), dtype=np.uint8) for _ in range(count - len(lit))]
    return (lit + noise)[:count]


@pytest.mark.parametrize("hardware", [1, 5])
def test_uploads_give_the_pictures_back(hardware):
    """12 and 64 pictures, of 1 and 8 bit: what the emulator decodes is what was sent."""
    columns, rows = fake_dlp.SIZES[hardware]
    plan = plan_of(columns, rows)
    grey = list(fw.encode(plan))
    for bits, count, pictures in (
        (8, 12, grey[10:22]),
        (1, 12, gray(12, columns, rows)),
        (1, 64, gray(64, columns, rows)),
        (8, 64, grey),
    ):
        board = fake_dlp.Dlpc900(hardware)
        projector = Dlpc900(settings=SequenceSettings(exposure_us=5000, bits=bits), device=board)
        assert isinstance(projector, Projector)
        assert isinstance(projector, SequenceProjector)
        for part in projector.portions(range(count)):
            projector.load([pictures[k] for k in part], part)
            projector.start()
        played = [picture for one in board.played for picture in one]
        assert len(played) == count
        for sent, seen in zip(pictures, played, strict=True):
            np.testing.assert_array_equal(sent, seen)
        # A memory of 400 planes holds 50 pictures of 8 bit: the last 14 come in a second load.
        assert [len(one) for one in board.played] == ([50, 14] if count * bits > 400 else [count])


def test_two_controllers_get_a_half_each():
    board = fake_dlp.Dlpc900(hardware=2)
    projector = Dlpc900(settings=FAST, device=board)
    assert (projector.size_px, projector.name) == ((2560, 1600), "DLP9000 (DLPC900)")
    pictures = gray(3, 2560, 1600)
    projector.load(pictures, range(3))
    projector.start()
    np.testing.assert_array_equal(board.played[0], pictures)


def test_images_of_every_kind_are_compressed_without_loss():
    rng = np.random.default_rng(7)
    for trial in range(60):
        rows, columns = rng.integers(1, 40), rng.integers(1, 700)
        words = rng.integers(0, 2 ** rng.integers(1, 25), (rows, columns)).astype(np.uint32)
        if trial % 2:
            words = np.repeat(words, rng.integers(1, 300), axis=1)[:, :columns]
        if trial % 3 == 0:
            words[rng.random(rows) < 0.5] = words[0]
        if trial % 5 == 0:
            keep = rng.random((rows, columns)) < 0.9
            words = np.where(keep, words[:1], words)
        np.testing.assert_array_equal(fake_erle.image(encoded(words)), words)


def test_the_sequence_is_defined_as_the_guide_says():
    settings = SequenceSettings(
        exposure_us=8000, period_us=10_000, colour="cyan", trigger_in="falling",
        trigger_in_delay_us=200, trigger_out="low", trigger_out_delay_us=-15,
        trigger_out_end_delay_us=40,
    )  # fmt: skip
    board = fake_dlp.Dlpc900(hardware=5)
    pulses = []
    projector = Dlpc900(settings=settings, device=board, pulses=pulses.append)
    projector.load([np.full((768, 1024), k, np.uint8) for k in range(5)], range(5))
    assert [board.lut[k]["image"] for k in range(5)] == [0, 0, 0, 1, 1]
    assert [board.lut[k]["bit"] for k in range(5)] == [0, 8, 16, 0, 8]
    entry = board.lut[4]
    assert (entry["exposure"], entry["dark"], entry["depth"]) == (8000, 2000, 8)
    assert (entry["leds"], entry["waits"], entry["clears"], entry["extra"]) == (6, 1, 1, 0)
    assert (board.trigger_out, board.trigger_in) == ((1, -15, 40), (200, 1))
    assert (board.entries, board.count) == (5, 5)
    # The images are loaded from the last to the first.
    assert [d[0] for c, d in board.commands if c == 0x1A2A] == [1, 0]
    assert not projector.status().running
    projector.start()
    assert pulses == [5]
    assert projector.status().running
    projector.stop()
    assert (projector.status().running, projector.status().problems) == (False, ())
    assert projector.period_s == pytest.approx(0.01)
    projector.close()
    assert board.closed
    projector.close()
    with pytest.raises(DeviceProblem, match="DLP5500 \\(DLPC900\\): expected an open projector"):
        projector.start()


def test_one_picture_is_shown_until_the_next():
    board = fake_dlp.Dlpc900(hardware=5)
    projector = Dlpc900(device=board)
    picture = np.arange(1024 * 768, dtype=np.uint32).astype(np.uint8).reshape(768, 1024)
    projector.show(picture)
    assert (board.count, board.running) == (0, True)
    np.testing.assert_array_equal(board.played[-1], [picture])


@pytest.mark.parametrize("code", sorted(driver.ERRORS))
@pytest.mark.parametrize("quiet", [False, True])
def test_every_error_code_is_one_sentence(code, quiet):
    board = fake_dlp.Dlpc900(hardware=5)
    projector = Dlpc900(settings=FAST, device=board)
    (board.quiet_errors if quiet else board.refused)[0x1A31] = code
    with pytest.raises(DeviceProblem) as said:
        projector.load(gray(2, 1024, 768), range(2))
    begins = "DLP5500 (DLPC900): the controller refused the command that defines the sequence: "
    assert str(said.value) == begins + driver.ERRORS[code]
    assert "\n" not in str(said.value)


def test_what_the_guide_refuses_is_refused_in_words():
    """Errors that the emulator finds by itself, and codes that the guide does not have."""
    board = fake_dlp.Dlpc900(hardware=5, planes=2)
    projector = Dlpc900(settings=FAST, device=board)
    with pytest.raises(DeviceProblem, match="defines picture 3: the number of a picture is out"):
        projector.load(gray(3, 1024, 768), range(3))
    board = fake_dlp.Dlpc900(hardware=5)
    projector = Dlpc900(settings=FAST, device=board)
    board.refused[0x1A24] = 99
    with pytest.raises(DeviceProblem, match="stops the sequence: it gives the error code 99"):
        projector.stop()
    board.refused[0x1A24] = 0
    with pytest.raises(DeviceProblem, match="did not find the command that stops the sequence"):
        projector.stop()
    # In the middle of an image.
    board = fake_dlp.Dlpc900(hardware=5)
    projector = Dlpc900(settings=FAST, device=board)
    board.refused[0x1A2B] = 8
    with pytest.raises(DeviceProblem, match="loads image 1: its memory is full; load fewer"):
        projector.load(gray(1, 1024, 768), range(1))
    with pytest.raises(DeviceProblem, match="expected pictures in its memory, got none"):
        projector.start()


def test_busy_unplugged_and_crowded():
    board = fake_dlp.Dlpc900(hardware=5)
    projector = Dlpc900(settings=FAST, device=board)
    board.silent.add(0x1A24)
    with pytest.raises(DeviceProblem, match="within 2 s, got none: the controller is busy or"):
        projector.stop()
    board.silent.clear()
    # Replies that a program which was interrupted left behind are thrown away.
    board.stale = [b"\x40\xf0\0\0".ljust(64, b"\0")] * 3
    projector.stop()
    board.stale = [b"\x40\xf0\0\0".ljust(64, b"\0")] * 9
    with pytest.raises(DeviceProblem, match="another program uses the projector"):
        projector.stop()
    board.unplugged = True
    with pytest.raises(DeviceProblem, match="it was unplugged or switched off; connect it"):
        projector.stop()
    projector.close()


@pytest.mark.parametrize("command", [0x0206, 0x1A0A, 0x0100])
def test_an_answer_without_its_value(command):
    board = fake_dlp.Dlpc900(hardware=5)
    board.empty.add(command)
    with pytest.raises(DeviceProblem, match="expected a value from the command that .*firmware"):
        Dlpc900(device=board)
    assert board.closed


def test_status_says_what_is_wrong():
    board = fake_dlp.Dlpc900(hardware=5)
    projector = Dlpc900(device=board)
    board.hardware_status, board.parked = 0b11001110, True
    status = projector.status()
    assert status.parked
    assert status.problems == ("the controller did not start", *driver.HARDWARE.values())


def test_what_the_light_engine_cannot_show():
    board = fake_dlp.Dlpc900()
    with pytest.raises(
        InputError, match="expected 4046 µs or more.*8 bit, got 4000 µs; pictures of 1 bit take 105"
    ):
        Dlpc900(settings=SequenceSettings(exposure_us=4000), device=board)
    with pytest.raises(InputError, match="expected 105 µs or more.*1 bit, got 104"):
        Dlpc900(settings=SequenceSettings(exposure_us=104, bits=1), device=board)
    assert not board.commands
    for options, said in (
        ({"trigger_out_delay_us": 30_000}, "trigger_out_delay_us: expected whole µs from -20 to"),
        ({"trigger_out_delay_us": 0.5}, "expected whole µs"),
        ({"trigger_in": "rising", "trigger_in_delay_us": 9}, "trigger_in_delay_us: expected whole"),
    ):
        with pytest.raises(InputError, match=said):
            Dlpc900(settings=SequenceSettings(**options), device=fake_dlp.Dlpc900())
    board.hardware = 77
    with pytest.raises(DeviceProblem, match="expected one of DLP6500, .*, got hardware number 77"):
        Dlpc900(device=board)
    projector = Dlpc900(settings=FAST, device=fake_dlp.Dlpc900(hardware=5))
    for pictures, said in (
        ([], "expected 1 to 400 pictures of 1 bit at a time, got 0"),
        ([np.zeros((5, 5), np.uint8)], "expected 1024 × 768 px of uint8, got 5 × 5 px"),
        ([np.full((768, 1024), 2, np.uint8)], r"expected counts below 2 \(a projector of 1 bits\)"),
    ):
        with pytest.raises(InputError, match=said):
            projector.load(pictures, range(len(pictures)))


def test_words_give_settings():
    which, settings = settings_of("7,exposure_us=8000,trigger_out=low,trigger_out_delay_us=-3", "k")
    assert (which, settings.exposure_us, settings.trigger_out) == ("7", 8000, "low")
    assert settings.trigger_out_delay_us == -3.0
    assert settings_of("", "k") == ("", SequenceSettings())
    for words, said in (
        ("exposure=5", "k: expected name=value with one of exposure_us, period_us, .*'exposure=5'"),
        ("exposure_us=fast", "k: exposure_us: expected a number, got 'fast'"),
        ("exposure_us=0", "k: exposure_us: expected 1 to 16777215 µs, got 0"),
        ("period_us=5", "k: period_us: expected the exposure or more, got 5"),
        ("a,b", "k: expected name=value"),
        ("colour=mauve", "k: colour: expected one of off, red"),
    ):
        with pytest.raises(DeviceProblem, match=said):
            settings_of(words, "k")


class Library:
    """The package hidapi with one projector, or with one that this user may not use."""

    def __init__(self, board=None):
        self._board = board
        self.opened = []

    def device(self):
        return self

    def open(self, vendor, product, serial):
        self.opened.append((vendor, product, serial))
        if self._board is None or serial not in (None, "S7"):
            raise OSError("open failed")

    def open_path(self, path):
        self.opened.append(path)

    def enumerate(self, *_):
        return [{"serial_number": "", "path": b"1-2:1.0"}, {"serial_number": "S7", "path": b""}]

    def __getattr__(self, name):
        return getattr(self._board, name)


def test_the_words_open_it(monkeypatch):
    library = Library(fake_dlp.Dlpc900(hardware=5))
    monkeypatch.setitem(sys.modules, "hid", library)
    with fw.devices.open_projector("dlpc900:S7,exposure_us=6000") as projector:
        assert projector.period_s == pytest.approx(0.006)
    assert library.opened == [(0x0451, 0xC900, "S7")]
    listed = [one.words for one in fw.devices.list_devices()[0] if "dlpc900" in one.words]
    assert listed == ["dlpc900:1-2:1.0", "dlpc900:S7"]
    library = Library(fake_dlp.Dlpc900(hardware=5))
    monkeypatch.setitem(sys.modules, "hid", library)
    with fw.devices.open_projector(listed[0]):
        assert library.opened == [b"1-2:1.0"]
    monkeypatch.setitem(sys.modules, "hid", Library())
    with pytest.raises(
        DeviceProblem, match="dlpc900: .*of those that are there: 1-2:1.0, S7. On L"
    ):
        fw.devices.open_projector("dlpc900")
    monkeypatch.setitem(sys.modules, "hid", None)
    with pytest.raises(MissingPackage, match=r"expected the package hidapi, got none; pip install"):
        fw.devices.open_projector("dlpc900")


def test_another_package_with_the_module_hid(monkeypatch):
    """The package hid binds the same library in another way; ``devices`` lists the others."""
    monkeypatch.setitem(sys.modules, "hid", ModuleType("hid"))
    with pytest.raises(MissingPackage, match="hidapi, got another one .* uninstall hid"):
        fw.devices.open_projector("dlpc900")
    listed = {one.words: one for one in fw.devices.list_devices()[0]}
    assert "got another one with the module hid" in listed["dlpc900"].description
