"""A projector that runs at its own pace, and a camera on its trigger output."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.devices import dlpc900 as driver
from fringeworks.devices.dlpc900 import Dlpc900
from fringeworks.devices.protocols import Grab, LineCamera
from fringeworks.devices.sequencer import SequenceSettings
from fringeworks.devices.virtual_scene import RigScene
from fringeworks.files import read_stack
from fringeworks.patterns.plan import PatternPlan, PhaseSteps, equal_steps
from fringeworks.scan.capture import capture
from fringeworks.scan.frames import taker_of
from fringeworks.scan.pulses import MAX_ROUNDS, PulseTaker, places
from fringeworks.simulate import bust, look, standard_rig
from fringeworks.types import CameraSettings, Delay, DeviceProblem, InputError
from tests import fake_dlp
from tests.virtual_devices import Screen, bench
from tests.wired_camera import WiredCamera

SIZE = (128, 96)
SETTINGS = SequenceSettings(exposure_us=8000, period_us=10_000)


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """A micromirror device of few mirrors, where the size does not matter."""
    monkeypatch.setitem(driver.SIZES_PX, 5, SIZE)
    monkeypatch.setitem(fake_dlp.SIZES, 5, SIZE)


def short_plan(frames=24):
    periods = np.linspace(40.0, 16.0, frames // 4)
    return PatternPlan(*SIZE, tuple(PhaseSteps("x", float(p), equal_steps(4)) for p in periods))


def wired(settings=SETTINGS, scene=None, **faults):
    board = fake_dlp.Dlpc900(hardware=5)
    projector = Dlpc900(settings=settings, device=board)
    camera = WiredCamera(scene or Screen(), board, **faults)
    assert isinstance(camera, LineCamera)
    return projector, camera


def taken(folder, plan, **faults):
    steps = []
    projector, camera = wired(**faults)
    capture(projector, camera, plan, folder, progress=steps.append)
    return read_stack(folder), steps, camera


def test_frames_are_those_of_their_pictures(tmp_path):
    plan = short_plan()
    stack, steps, camera = taken(tmp_path / "c", plan)
    assert camera.pulses == plan.frames == len(stack.frames)
    assert steps == plan.labels()
    assert (stack.projector, stack.camera) == ("DLP5500 (DLPC900)", "wired")
    for frame, picture in zip(stack.frames, fw.encode(plan), strict=True):
        assert np.abs(frame - 255 * (0.6 * picture[::2, ::2] / 255.0 + 0.03)).mean() < 2


@pytest.mark.parametrize("fault", ["missed", "torn", "dropped"])
def test_a_lost_pulse_is_named_and_taken_again(tmp_path, fault):
    """In the first portion of 50 and in the second; twice in one portion; in the second round."""
    plan = short_plan(80)
    whole, _, _ = taken(tmp_path / "whole", plan)
    lost = {17, 31, 50 + 17, 150 + 9}
    stack, steps, camera = taken(tmp_path / fault, plan, **{fault: lost})
    for frame, expected in zip(stack.frames, whole.frames, strict=True):
        np.testing.assert_array_equal(frame, expected)
    # The first portion of 50 pictures was played three times, the second of 30 twice.
    labels = plan.labels()
    assert camera.pulses == 3 * 50 + 2 * 30
    again = {n: step for n, step in enumerate(steps) if step != labels[n]}
    named = f"pulse 18 ({labels[17]}), 32 ({labels[31]}) of 50 got no frame"
    assert again == {
        17: f"{labels[17]} (taken again: pulse 18 ({labels[17]}) of 50 got no frame)",
        31: f"{labels[31]} (taken again: {named})",
        59: f"{labels[59]} (taken again: pulse 10 ({labels[59]}) of 30 got no frame)",
    }


def test_one_of_200_pulses_is_lost(tmp_path, monkeypatch):
    """The bar: named, taken again, and the same points as without the loss."""
    rig = standard_rig(scale=0.2)
    columns, rows = rig.projector.width_px, rig.projector.height_px
    scene = RigScene(look(rig, bust()))
    # A device of 1024 × 768 mirrors, of which the plan uses the upper left corner.
    monkeypatch.undo()
    base = fw.simulate.fringe_plan(rig, both=False)
    blocks = (*base.blocks, PhaseSteps("x", 24.0, equal_steps(64)))
    fill = 200 - sum(block.frames for block in blocks)
    more = (PhaseSteps("x", 24.0, equal_steps(k)) for k in _parts(fill))
    plan = replace(base, blocks=(*blocks, *more), bits=8)
    assert plan.frames == 200

    class Window:
        """The scene in the upper left corner of the micromirror device."""

        shape, ambient = scene.shape, scene.ambient

        def projected(self, light):
            return scene.projected(light[:rows, :columns])

    results = {}
    for name, missed in (("whole", ()), ("lost", (136,))):
        stack, steps, camera = taken(tmp_path / name, plan, scene=Window(), missed=missed)
        results[name] = fw.measure(stack, rig).points
        extra = [step for step in steps if "taken again" in step]
        assert len(extra) == len(missed)
        if missed:
            # Pulse 137 of all is number 37 of the third portion of 50.
            named = f"pulse 37 ({plan.labels()[136]}) of 50 got no frame"
            assert extra == [f"{plan.labels()[136]} (taken again: {named})"]
            assert camera.pulses == 250
    np.testing.assert_array_equal(results["whole"].xyz_mm, results["lost"].xyz_mm)
    assert (results["whole"].reason == 0).sum() > 3000


def _parts(count):
    """Numbers of steps, 3 to 64, that add up to a count."""
    while count > 64:
        yield 61
        count -= 61
    yield count


@pytest.mark.parametrize("lost", [0, 49])
def test_a_loss_at_the_end_leaves_no_gap(tmp_path, lost):
    plan = short_plan(80)
    whole, _, _ = taken(tmp_path / "whole", plan)
    stack, steps, _ = taken(tmp_path / "lost", plan, missed=(lost,))
    np.testing.assert_array_equal(stack.frames, whole.frames)
    assert steps[5].endswith(
        "(taken again: one of the first or the last of 50 pulses got no frame)"
    )
    assert steps[50:] == plan.labels()[50:]


def test_without_a_clock_the_numbers_tell(tmp_path):
    """A frame that was counted and dropped leaves a gap in the numbers."""
    plan = short_plan()
    projector, camera = wired(dropped=(5,))
    camera.stamps = False
    steps = []
    capture(projector, camera, plan, tmp_path / "c", progress=steps.append)
    assert [n for n, step in enumerate(steps) if "taken again" in step] == [5]
    # A pulse that exposed nothing leaves none: all is taken again.
    projector, camera = wired(missed=(5,))
    camera.stamps = False
    capture(projector, camera, plan, tmp_path / "d", progress=steps.append)
    assert camera.pulses == 48
    np.testing.assert_array_equal(
        read_stack(tmp_path / "c").frames, read_stack(tmp_path / "d").frames
    )


def test_averages_take_more_rounds(tmp_path):
    plan = short_plan()
    projector, camera = wired(missed=(7,))
    capture(projector, camera, plan, tmp_path / "c", average=3)
    assert camera.pulses == 4 * 24


def test_what_cannot_be_taken_is_said(tmp_path):
    plan = short_plan()

    def refused(prepare, match, **faults):
        projector, camera = wired(**faults)
        prepare(camera)
        with pytest.raises(DeviceProblem, match=match):
            capture(projector, camera, plan, tmp_path / "c", force=True)
        return camera

    refused(lambda c: setattr(c, "every", 2), "got 12: the camera is too slow for one every 10 ms")
    refused(lambda c: setattr(c, "extra", 1), "expected 24 frames for 24 pulses, got more")
    refused(lambda _: None, "got none: connect the trigger output of DLP5500", missed=range(24))
    projector, camera = wired(missed=range(24))
    board = projector._link._device
    board.hardware_status, board.parked = 0b01000001, True
    with pytest.raises(
        DeviceProblem, match="sequencer has stopped after an error; its mirrors are"
    ):
        capture(projector, camera, plan, tmp_path / "c", force=True)
    always = {24 * k + 5 for k in range(MAX_ROUNDS)}
    refused(lambda _: None, r"in 6 rounds, got none of some; pulse 6 \(", missed=always)
    camera = refused(lambda c: setattr(c, "gone", True), "it was unplugged")
    assert camera.pulses == 0


def test_a_camera_that_goes_away_in_the_middle(tmp_path):
    """It is said within a second, what was taken is kept, and the capture goes on."""
    plan = short_plan(80)
    projector, camera = wired()
    real, count = camera.grab, []

    def grab(timeout_s=5.0):
        count.append(1)
        if len(count) > 60:
            camera.gone = True
            camera._coming.clear()
            at = camera.clock.now_s()
            count[:] = [at]
            raise DeviceProblem("wired: it was unplugged")
        return real(timeout_s)

    camera.grab = grab
    with pytest.raises(DeviceProblem, match="unplugged"):
        capture(projector, camera, plan, tmp_path / "c")
    taken_first = camera.pulses
    projector, camera = wired()
    capture(projector, camera, plan, tmp_path / "c", resume=True)
    assert (taken_first, camera.pulses) == (80, 30)
    whole, _, _ = taken(tmp_path / "whole", plan)
    np.testing.assert_array_equal(read_stack(tmp_path / "c").frames, whole.frames)


def test_silence_is_found_within_a_second():
    projector, camera = wired()
    taker = PulseTaker(projector, camera)
    real = camera._frame

    def frame(picture, entry, at_s, pulse):
        if pulse < 10:
            real(picture, entry, at_s, pulse)

    camera._frame = frame
    camera.limits = lambda: (_ for _ in ()).throw(DeviceProblem("wired: no answer"))
    pictures = list(fw.encode(short_plan(40)))
    projector.load(pictures, range(40))
    projector.start()
    begun = camera.clock.now_s()
    with pytest.raises(DeviceProblem, match="no answer"):
        taker._collected(40)
    # Its last frame came 0.105 s after the start.
    assert camera.clock.now_s() - begun < 0.105 + 1.0


@pytest.mark.parametrize(
    ("options", "exposure_ms", "said"),
    [
        (
            {},
            7.9,
            "wired: exposure_ms: expected 8 to 10 ms, so that a frame holds a whole picture of 8",
        ),
        ({}, 10.1, "nothing of the next one, got 10.1 ms"),
        (
            {"trigger_out_delay_us": 50},
            8.0,
            "trigger_out_delay_us: expected a pulse that begins with",
        ),
        ({"trigger_out_delay_us": -20}, 8.0, "exposure_ms: expected 8.02 to 10.02 ms"),
        ({"bits": 1}, 12.0, "expected 0 to 10 ms, so that a frame holds nothing of the next one"),
    ],
)
def test_exposures_that_mix_or_cut_pictures_are_refused(tmp_path, options, exposure_ms, said):
    """They would be wrong by less than a residual shows."""
    projector, camera = wired(replace(SETTINGS, **options))
    plan = replace(short_plan(), bits=projector.bits)
    with pytest.raises(InputError, match=said):
        capture(projector, camera, plan, tmp_path / "c", settings=CameraSettings(exposure_ms))
    assert camera.pulses == 0


@pytest.mark.parametrize(("bits", "exposure_ms"), [(8, 8.0), (8, 10.0), (1, 0.1), (1, 10.0)])
def test_exposures_that_hold_one_picture(tmp_path, bits, exposure_ms):
    projector, camera = wired(replace(SETTINGS, bits=bits))
    plan = replace(short_plan(), bits=bits)
    capture(projector, camera, plan, tmp_path / "c", settings=CameraSettings(exposure_ms))
    assert camera.pulses == plan.frames
    camera.configure = lambda _: CameraSettings()
    assert PulseTaker(projector, camera)._check_exposure() is None


def test_frames_of_another_pace_are_refused():
    frames = [Grab(np.zeros((1, 1), np.uint8), 0.0, at) for at in (0.0, 0.0166, 0.0333)]
    with pytest.raises(DeviceProblem, match="every 10 ms, got some every 16.65 ms"):
        places(frames, 3, 0.01, "camera")
    bare = [Grab(np.zeros((1, 1), np.uint8), 0.0)] * 3
    assert places(bare, 3, 0.01, "camera") == [0, 1, 2]
    assert places(bare, 4, 0.01, "camera") is None
    double = [Grab(np.zeros((1, 1), np.uint8), 0.0, at) for at in (0.0, 0.0001, 0.02)]
    assert places(double, 3, 0.01, "camera") is None
    assert places([], 3, 0.01, "camera") is None


def test_other_cameras_and_a_delay_are_refused():
    projector, camera = wired()
    with pytest.raises(InputError, match="expected a camera with a trigger input"):
        taker_of(projector, bench().camera)
    with pytest.raises(InputError, match="delay: expected none"):
        taker_of(projector, camera, Delay(*[np.zeros(1)] * 4, 1 / 60, 1 / 30))


@pytest.mark.parametrize("stamps", [True, False])
def test_frames_never_move_to_another_picture(tmp_path, stamps):
    """Pulses lost at random, also at the ends and in later rounds: each frame is its picture's."""
    plan = short_plan()
    whole, _, _ = taken(tmp_path / "whole", plan)
    refused, said = 0, []
    for seed in range(12):
        rng = np.random.default_rng(100 + seed)
        missed, dropped = (
            set(rng.choice(24 * 6, rng.integers(1, most), replace=False).tolist())
            for most in (12, 6)
        )
        projector, camera = wired(missed=missed, dropped=dropped)
        camera.stamps = stamps
        try:
            capture(projector, camera, plan, tmp_path / "c", force=True)
        except DeviceProblem as error:
            refused += 1
            said.append(str(error))
            continue
        np.testing.assert_array_equal(read_stack(tmp_path / "c").frames, whole.frames)
    assert refused <= (2 if stamps else 9)
    assert all("rounds" in line or "too slow" in line for line in said)
