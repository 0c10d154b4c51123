"""Captures with virtual devices: complete, or kept and resumed."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import FileProblem, InputError, encode, read_stack
from fringeworks.scan.capture import capture
from fringeworks.scan.delay import measure_delay
from fringeworks.scan.frames import take_frames
from fringeworks.types import CameraSettings, DeviceProblem
from tests.virtual_devices import bench, plan


def expected(picture):
    """What the camera of the tests sees of a picture, counts."""
    return 255 * (0.6 * picture[::2, ::2] / 255.0 + 0.03)


def test_a_capture_is_what_was_shown(tmp_path):
    b = bench({"delay_s": 0.03}, {"delay_s": 0.05})
    steps = []
    folder = capture(b.projector, b.camera, plan(), tmp_path / "c", progress=steps.append)
    stack = read_stack(folder)
    assert steps == plan().labels()
    assert stack.camera == stack.projector == "virtual"
    assert stack.saturation == 255
    for frame, picture in zip(stack.frames, encode(plan()), strict=True):
        assert np.abs(frame - expected(picture)).mean() < 2
    assert "exposure_ms = 16.667" in (folder / "capture.toml").read_text()


def test_fast_and_averaged(tmp_path):
    b = bench({"delay_s": 0.03}, {"fps": 60})
    delay = measure_delay(b.projector, b.camera, triggered=True)
    folder = capture(b.projector, b.camera, plan(), tmp_path / "c", delay=delay, average=9)
    stack = read_stack(folder)
    slow = capture(
        b.projector,
        b.camera,
        plan(),
        tmp_path / "d",
        average=9,
        settings=CameraSettings(triggered=False),
    )
    for frame, other, picture in zip(
        stack.frames, read_stack(slow).frames, encode(plan()), strict=True
    ):
        assert frame.dtype == np.float32
        for values in (frame, other):
            # Nine frames have a third of the noise of one.
            assert np.std(values - expected(picture)) < 0.45 * np.sqrt(1 + 0.02 * 90 + 1 / 12)
    assert stack.saturation == pytest.approx(0.98 * 255)


class Interrupting:
    """A camera that goes away after some frames, or asks for an interruption."""

    def __init__(self, camera, after, error):
        self._camera, self._left, self._error = camera, after, error

    def __getattr__(self, name):
        return getattr(self._camera, name)

    def grab(self, timeout_s=5.0):
        self._left -= 1
        if self._left < 0:
            raise self._error
        return self._camera.grab(timeout_s)


@pytest.mark.parametrize("error", [DeviceProblem("camera: gone"), KeyboardInterrupt()])
def test_an_interrupted_capture_is_resumed(tmp_path, error):
    b = bench({}, {"delay_s": 0.02}, seed=3)
    folder = tmp_path / "c"
    with pytest.raises(type(error)):
        capture(b.projector, Interrupting(b.camera, 30, error), plan(), folder)
    taken = {p.name: p.read_bytes() for p in folder.glob("*.png")}
    assert 0 < len(taken) < plan().frames
    with pytest.raises(FileProblem, match="interrupted"):
        read_stack(folder)
    with pytest.raises(InputError, match="the settings of the interrupted capture"):
        capture(
            b.projector,
            b.camera,
            plan(),
            folder,
            settings=CameraSettings(exposure_ms=5.0),
            resume=True,
        )
    b.camera.configure(CameraSettings(exposure_ms=16.667))
    with pytest.raises(InputError, match="the plan of the interrupted capture"):
        capture(b.projector, b.camera, plan(2), folder, resume=True)
    steps = []
    capture(b.projector, b.camera, plan(), folder, resume=True, progress=steps.append)
    assert len(steps) == plan().frames - len(taken)
    for name, content in taken.items():
        assert (folder / name).read_bytes() == content
    for frame, picture in zip(read_stack(folder).frames, encode(plan()), strict=True):
        assert np.abs(frame - expected(picture)).mean() < 2
    with pytest.raises(FileProblem, match="got a complete one"):
        capture(b.projector, b.camera, plan(), folder, resume=True)


def test_nothing_to_resume(tmp_path):
    b = bench()
    with pytest.raises(FileProblem, match="to resume, got none"):
        capture(b.projector, b.camera, plan(), tmp_path / "c", resume=True)


def test_a_full_disk_keeps_what_was_taken(tmp_path, monkeypatch):
    from fringeworks.files import capture_writer

    real, count = capture_writer.write_frame, [0]

    def full(path, frame):
        count[0] += 1
        if count[0] == 5:
            raise OSError(28, "No space left on device")
        real(path, frame)

    monkeypatch.setattr(capture_writer, "write_frame", full)
    b = bench()
    with pytest.raises(FileProblem, match="No space left on device"):
        capture(b.projector, b.camera, plan(), tmp_path / "c")
    assert len(list((tmp_path / "c").glob("*.png"))) == 4
    capture(b.projector, b.camera, plan(), tmp_path / "c", resume=True)
    assert len(read_stack(tmp_path / "c").frames) == 12


def test_plans_that_cannot_be_shown(tmp_path):
    b = bench({"width_px": 64, "height_px": 40})
    with pytest.raises(InputError, match="expected 64 × 40 px or fewer, .* got 128 × 96"):
        capture(b.projector, b.camera, plan(), tmp_path / "c")
    assert not (tmp_path / "c").exists()
    with pytest.raises(InputError, match="pictures of 10 bit"):
        list(take_frames(bench({"bits": 10}).projector, b.camera, plan()))
    with pytest.raises(InputError, match="1 to 255 frames"):
        list(take_frames(bench().projector, b.camera, plan(), average=0))


def test_a_smaller_plan_is_shown_in_the_corner():
    b = bench()
    small = plan(1, width=64, height=48)
    frames = dict(take_frames(b.projector, b.camera, small))
    for n, picture in enumerate(encode(small)):
        assert np.abs(frames[n][:24, :32] - expected(picture)).mean() < 2
        assert frames[n][26:].max() < 25
