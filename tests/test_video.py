"""Videos in place of frames: as a stack with its plan, or as a sequence."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.files.video import still_parts
from fringeworks.patterns.plan import PatternPlan, PhaseSteps, equal_steps
from tests.commands import run

cv2 = pytest.importorskip("cv2")

PLAN = PatternPlan(320, 200, tuple(PhaseSteps("x", p, equal_steps(4)) for p in (20.0, 320.0)))
CODECS = {".avi": "MJPG", ".mp4": "mp4v"}


def shown(seed=0):
    """Frames of the plan with noise, 8 bits."""
    rng = np.random.default_rng(seed)
    return [
        np.clip(np.rint(20 + 0.7 * f + rng.normal(0, 1, f.shape)), 0, 255).astype(np.uint8)
        for f in fw.encode(PLAN)
    ]


def video(path, frames):
    height, width = frames[0].shape
    code = cv2.VideoWriter.fourcc(*CODECS[path.suffix])
    writer = cv2.VideoWriter(str(path), code, 30, (width, height))
    if not writer.isOpened():
        pytest.skip(f"this OpenCV writes no {path.suffix}")
    for frame in frames:
        writer.write(np.repeat(frame[..., None], 3, axis=2))
    writer.release()
    return path


def error_px(found):
    """Error of the projector coordinates: the camera sees the projector's pixels as they are."""
    x = found.x.coordinate_px
    return np.abs(x - np.arange(320))[found.x.reason == 0]


@pytest.mark.parametrize("suffix", CODECS)
@pytest.mark.parametrize("held", [1, 2, 5])
def test_a_video_is_a_stack(tmp_path, suffix, held):
    """With the plan's frames, or with every pattern held for some frames."""
    rng = np.random.default_rng(held)
    frames = [f for f in shown() for _ in range(held)]
    frames = [np.clip(f + rng.integers(-1, 2, f.shape), 0, 255).astype(np.uint8) for f in frames]
    path = video(tmp_path / f"clip{suffix}", frames)
    fw.write(tmp_path / "plan.toml", PLAN)
    stack = fw.read(path)
    assert isinstance(stack, fw.Stack)
    assert (len(stack.frames), stack.lossy) == (8, True)
    for frame, expected in zip(stack.frames, shown(), strict=True):
        assert np.abs(frame.astype(float) - expected).mean() < 3
    assert "a video in grey" in stack.notes[0]
    assert ("middle ones of 8 still parts" in stack.notes[0]) == (held > 1)
    found = fw.decode(stack)
    assert (found.x.reason == 0).mean() > 0.9
    assert np.median(error_px(found)) < 0.2
    assert any("a video in grey" in note for note in found.notes)


def test_a_frame_between_two_patterns_is_left_out(tmp_path):
    """A camera with a rolling shutter shows half of both."""
    frames = []
    for k, frame in enumerate(shown()):
        if k:
            half = frame.copy()
            half[100:] = frames[-1][100:]
            frames.append(half)
        frames += [frame] * 3
    path = video(tmp_path / "clip.avi", frames)
    stack = fw.files.read_stack(path, PLAN)
    for frame, expected in zip(stack.frames, shown(), strict=True):
        assert np.abs(frame.astype(float) - expected).mean() < 3


def test_a_video_without_a_plan_is_a_sequence(tmp_path):
    path = video(tmp_path / "clip.avi", shown() * 2)
    found = fw.read(path)
    assert isinstance(found, fw.files.FrameSequence)
    assert (len(found), next(iter(found)).shape) == (16, (200, 320))


def test_a_folder_with_one_video_is_a_capture(tmp_path):
    folder = tmp_path / "shots"
    folder.mkdir()
    video(folder / "clip.avi", shown())
    assert len(fw.files.read_sequence(folder)) == 8
    fw.write(folder / "plan.toml", PLAN)
    assert len(fw.read(folder).frames) == 8
    (folder / "capture.toml").write_text('kind = "stack"\nframes = "clip.avi"\n')
    assert len(fw.read(folder).frames) == 8


def test_the_command_decodes_a_video(tmp_path):
    video(tmp_path / "clip.avi", shown())
    fw.write(tmp_path / "plan.toml", PLAN)
    done = run("decode", tmp_path / "clip.avi", "--out", tmp_path / "x.npz")
    assert "a video in grey" in done.stdout
    assert (fw.read(tmp_path / "x.npz").x.reason == 0).mean() > 0.9


@pytest.mark.parametrize("extra", [3, 9])
def test_other_numbers_of_patterns_are_said(tmp_path, extra):
    """Frames before the first pattern, or too few patterns."""
    held = [f for f in shown() for _ in range(3)]
    frames = [np.full((200, 320), 10, np.uint8)] * extra + held if extra == 3 else held[:-9]
    path = video(tmp_path / "clip.avi", frames)
    with pytest.raises(fw.FramesContradictPlan, match="8 frames, got a video of .* still parts"):
        fw.files.read_stack(path, PLAN)
    with pytest.raises(fw.FileProblem, match="channels, got a video"):
        fw.files.read_stack(path, PLAN, channels="g")


def test_damaged_and_huge_videos_are_one_sentence(tmp_path, capfd):
    path = video(tmp_path / "clip.mp4", shown())
    whole = path.read_bytes()
    for content in (b"", b"no video", whole[: len(whole) // 3]):
        path.write_bytes(content)
        with pytest.raises(fw.FileProblem, match="expected a readable video") as caught:
            fw.read(path)
        assert "\n" not in str(caught.value)
    path.write_bytes(whole)
    with fw.files.file_limits(max_gb=1e-4), pytest.raises(fw.FileProblem, match="more frames"):
        fw.read(path)
    assert capfd.readouterr() == ("", "")


def test_without_opencv_a_video_says_what_to_install(tmp_path, monkeypatch):
    path = video(tmp_path / "clip.avi", shown())
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(fw.MissingPackage, match=r"a video: .* pip install 'fringeworks\[calibrat"):
        fw.read(path)


@pytest.mark.parametrize("seed", range(5))
def test_still_parts_beside_key_frames(seed):
    """Compressed: a key frame changes a still picture 50 times as much as the other frames."""
    rng = np.random.default_rng(200 + seed)
    frames = []
    for k in range(9):
        scene = np.rint(120 + 80 * np.cos(np.arange(90) / 5 + 2.1 * k) * np.ones((60, 1)))
        frames += [scene] * 6
    at = rng.choice([k for k in range(54) if 0 < k % 6 < 5], 4, replace=False)
    for k in at:
        end = k // 6 * 6 + 6
        key = rng.choice([-1, 0, 1], frames[k].shape)
        frames[k:end] = [f + key for f in frames[k:end]]
    parts = still_parts(np.array(frames).astype(np.uint8), 9)
    assert parts == [(6 * k, 6 * k + 5) for k in range(9)]


@pytest.mark.parametrize("seed", range(5))
def test_still_parts_in_noise(seed):
    """Parts of random lengths, with noise that differs from scene to scene."""
    rng = np.random.default_rng(100 + seed)
    lengths = rng.integers(2, 9, 12)
    frames = []
    for k, length in enumerate(lengths):
        scene = 120 + 80 * np.cos(np.arange(80) / 5 + 2.1 * k) * np.ones((60, 1))
        frames += [scene + rng.normal(0, 0.5 + seed, scene.shape) for _ in range(length)]
    parts = still_parts(np.clip(frames, 0, 255).astype(np.uint8), 12)
    ends = np.cumsum(lengths)
    assert parts == [(int(b - n), int(b) - 1) for n, b in zip(lengths, ends, strict=True)]
