"""Captures with virtual devices: complete, or kept and resumed."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np
import pytest

from fringeworks import FileProblem, InputError, encode
from fringeworks.cli.commands import run
from fringeworks.devices.virtual_camera import VirtualCamera
from fringeworks.files import read_stack, write_pair, write_stack
from fringeworks.scan.capture import capture
from fringeworks.scan.delay import measure_delay
from fringeworks.scan.frames import take_frames
from fringeworks.scan.together import capture_together
from fringeworks.simulate.scene import standard_scene
from fringeworks.types import CameraSettings, DeviceProblem
from tests.virtual_devices import Interrupting, Screen, bench, plan


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
    with pytest.raises(InputError, match="the settings of the capture that is there"):
        capture(
            b.projector,
            b.camera,
            plan(),
            folder,
            settings=CameraSettings(exposure_ms=5.0),
            resume=True,
        )
    b.camera.configure(CameraSettings(exposure_ms=16.667))
    with pytest.raises(InputError, match="the plan of the capture that is there"):
        capture(b.projector, b.camera, plan(2), folder, resume=True)
    steps = []
    capture(b.projector, b.camera, plan(), folder, resume=True, progress=steps.append)
    assert len(steps) == plan().frames - len(taken)
    for name, content in taken.items():
        assert (folder / name).read_bytes() == content
    for frame, picture in zip(read_stack(folder).frames, encode(plan()), strict=True):
        assert np.abs(frame - expected(picture)).mean() < 2
    # A complete capture has nothing to resume.
    before = {p: p.read_bytes() for p in folder.glob("[!.]*")}
    none = Interrupting(b.camera, 0, AssertionError("no frame is needed"))
    capture(b.projector, none, plan(), folder, resume=True)
    capture(b.projector, none, plan(), folder, resume=True, exposure="auto")
    assert {p: p.read_bytes() for p in folder.glob("[!.]*")} == before
    with pytest.raises(InputError, match="the settings of the capture that is there"):
        capture(b.projector, none, plan(), folder, resume=True, average=2)


def test_a_damaged_frame_is_taken_again(tmp_path):
    b = bench(seed=3)
    folder = tmp_path / "c"
    with pytest.raises(DeviceProblem):
        capture(b.projector, Interrupting(b.camera, 40, DeviceProblem("gone")), plan(), folder)
    damaged = sorted(folder.glob("*.png"))[1]
    damaged.write_bytes(damaged.read_bytes()[:200])
    steps = []
    capture(b.projector, b.camera, plan(), folder, resume=True, progress=steps.append)
    assert plan().labels()[1] in steps
    for frame, picture in zip(read_stack(folder).frames, encode(plan()), strict=True):
        assert np.abs(frame - expected(picture)).mean() < 2


def test_two_captures_in_one_folder(tmp_path):
    """The second one is refused at once, and the first one ends as if nothing had happened."""
    one, other = bench(seed=3), bench(seed=4)
    folder = tmp_path / "c"
    refused = []

    def also(_):
        with pytest.raises(FileProblem, match="nothing else writes") as problem:
            capture(other.projector, other.camera, plan(), folder)
        refused.append(problem)

    capture(one.projector, one.camera, plan(), folder, progress=also)
    assert len(refused) == plan().frames
    assert len(read_stack(folder).frames) == plan().frames
    with pytest.raises(FileProblem, match="a finished capture, whose frames would be lost"):
        capture(other.projector, other.camera, plan(), folder)
    before = read_stack(folder).frames
    capture(other.projector, other.camera, plan(), folder, force=True)
    assert not np.array_equal(read_stack(folder).frames, before)


def test_simulated_frames_do_not_replace_taken_ones(tmp_path):
    """A simulation or a conversion into the folder of a capture would lose what nobody can take again."""
    b, folder = bench(seed=3), tmp_path / "c"
    capture(b.projector, b.camera, plan(), folder)
    taken = read_stack(folder)
    pair = standard_scene("parabola", size=32, fringes=4, bits=8)
    for write in (
        lambda **how: write_pair(folder, pair, **how),
        lambda **how: write_stack(folder, list(taken.frames), taken.plan, **how),
    ):
        with pytest.raises(FileProblem, match="frames that a camera took"):
            write()
        np.testing.assert_array_equal(read_stack(folder).frames, taken.frames)
    assert run(["-q", "simulate", "--size", "32", "--fringes", "4", "--out", str(folder)]) == 2
    np.testing.assert_array_equal(read_stack(folder).frames, taken.frames)
    write_pair(folder, pair, force=True)
    # What no device took is replaced as any other result.
    write_pair(folder, pair)


def test_nothing_to_resume(tmp_path):
    b = bench()
    with pytest.raises(FileProblem, match="to resume, got none"):
        capture(b.projector, b.camera, plan(), tmp_path / "c", resume=True)


def test_resuming_without_the_plan(tmp_path):
    b, folder = bench(), tmp_path / "c"
    with pytest.raises(DeviceProblem):
        gone = Interrupting(b.camera, 30, DeviceProblem("camera: gone"))
        capture(b.projector, gone, plan(), folder)
    (folder / "plan.toml").unlink()
    with pytest.raises(FileProblem, match="plan.toml of the capture that is there"):
        capture(b.projector, b.camera, plan(), folder, resume=True)


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


@pytest.mark.parametrize("fast", [False, True])
def test_saturated_frames_are_refused_with_the_share(tmp_path, fast):
    """White reaches 1.6 times full scale: bright phases of every fringe are cut off."""
    b = bench(scene=Screen(white=1.6))
    b.camera.configure(CameraSettings(exposure_ms=16.667, triggered=False))
    delay = None
    if fast:
        dim = bench()
        delay = measure_delay(dim.projector, dim.camera)
    with pytest.raises(
        DeviceProblem, match=r"50% of the lit pixels to be saturated, got (100|9\d)%"
    ):
        capture(b.projector, b.camera, plan(), tmp_path / "c", delay=delay)
    assert not list(tmp_path.glob("c/*.png"))
    b = bench(scene=Screen(white=1.6))
    frames = take_frames(b.projector, b.camera, plan(), delay=delay, most_saturated=1.0)
    assert len(list(frames)) == plan().frames
    with pytest.raises(InputError, match="most_saturated: expected 0 to 1, got 2"):
        list(take_frames(b.projector, b.camera, plan(), most_saturated=2))


def test_a_highlight_is_not_refused():
    """A tenth of the pixels is saturated; so is a lamp that the projector does not light."""
    white = np.full((48, 64), 0.6)
    white[:10, :10] = 3.0
    scene = Screen(white=white)
    scene.ambient[20:, :] = 1.5
    b = bench(scene=scene)
    frames = list(take_frames(b.projector, b.camera, plan()))
    assert np.mean(frames[0][1] == 255) > 0.5


def test_the_fast_way_says_why_frames_were_not_used():
    b = bench(None, {"fps": 60})
    delay = measure_delay(b.projector, b.camera)
    late = bench({"delay_s": 0.3}, {"fps": 60})
    late.camera.grab = incomplete(late.camera.grab)
    with pytest.raises(DeviceProblem, match=r"could not be used: \d+ incomplete"):
        list(take_frames(late.projector, late.camera, plan(), delay=delay))


def incomplete(grab):
    """A grab of which a part of the pixels is missing."""
    return lambda timeout_s=5.0: replace(grab(timeout_s), complete=False)


def test_resuming_sets_a_camera_that_forgot_its_settings(tmp_path):
    """A camera that was switched off has another gain; only the exposure is asked for again."""
    b = bench({}, {"delay_s": 0.02}, seed=3)
    b.camera.configure(CameraSettings(gain_db=2.0))
    asked = CameraSettings(exposure_ms=16.0)
    broken = Interrupting(b.camera, 30, DeviceProblem("camera: gone"))
    with pytest.raises(DeviceProblem):
        capture(b.projector, broken, plan(), tmp_path / "c", settings=asked)
    b.camera.configure(CameraSettings(exposure_ms=20.0, gain_db=0.0))
    with pytest.raises(InputError, match="the settings of the"):
        other = CameraSettings(gain_db=1.0)
        capture(b.projector, b.camera, plan(), tmp_path / "c", settings=other, resume=True)
    capture(b.projector, b.camera, plan(), tmp_path / "c", settings=asked, resume=True)
    assert b.camera.configure(CameraSettings()).gain_db == 2.0


class Late:
    """A camera whose frames arrive several frames late."""

    def __init__(self, camera, frames):
        self._camera, self._frames, self._kept = camera, frames, deque()

    def __getattr__(self, name):
        return getattr(self._camera, name)

    def grab(self, timeout_s=5.0):
        while len(self._kept) <= self._frames:
            self._kept.append(self._camera.grab(timeout_s))
        return self._kept.popleft()


def test_one_of_two_cameras_may_be_late(tmp_path):
    """Its frames of the picture before agree with each other as well as those of the new one."""
    b = bench({"delay_s": 0.03}, {"delay_s": 0.05})
    late = Late(VirtualCamera(b.camera.scene, b.projector, b.camera.model, seed=1), 3)
    folders = [tmp_path / "one", tmp_path / "other"]
    for folder in capture_together(b.projector, [b.camera, late], plan(), folders):
        for frame, picture in zip(read_stack(folder).frames, encode(plan()), strict=True):
            assert np.abs(frame - expected(picture)).mean() < 2


def test_two_cameras_go_on_where_one_was_unplugged(tmp_path):
    """What both have is kept; a frame that one lost is taken again for that one alone."""
    b = bench()
    other = VirtualCamera(b.camera.scene, b.projector, b.camera.model, seed=1)
    asked = CameraSettings(gain_db=2.0)
    folders = [tmp_path / "one", tmp_path / "other"]
    with pytest.raises(InputError, match="folders: expected another one for each camera"):
        capture_together(b.projector, [b.camera, other], plan(), [folders[0]] * 2)

    def stop(label, told=[]):  # noqa: B006, counts over calls
        told.append(label)
        if len(told) == 5:
            raise DeviceProblem("other: it was unplugged")

    with pytest.raises(DeviceProblem, match="unplugged"):
        capture_together(
            b.projector, [b.camera, other], plan(), folders, settings=asked, progress=stop
        )
    kept = {p: p.read_bytes() for folder in folders for p in folder.glob("*.png")}
    assert len(kept) in (8, 10)
    lost = sorted(folders[1].glob("*.png"))[0]
    lost.unlink()
    taken = []
    capture_together(
        b.projector, [b.camera, other], plan(), folders, resume=True, progress=taken.append
    )
    assert len(taken) == len(plan().labels()) - len(kept) // 2 + 1
    assert all(path.read_bytes() == content for path, content in kept.items() if path != lost)
    for folder in folders:
        assert read_stack(folder).frames[0].shape == b.camera.scene.shape
    assert other.configure(CameraSettings()).gain_db == 2.0
    again = []
    capture_together(
        b.projector, [b.camera, other], plan(), folders, resume=True, progress=again.append
    )
    assert not again
