"""Pictures that play from a projector's own memory, with a triggered camera."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import FileProblem, InputError, encode
from fringeworks.devices.memory_projector import MemoryProjector
from fringeworks.devices.protocols import Projector
from fringeworks.files import read_stack, write_patterns
from fringeworks.scan.capture import capture
from fringeworks.scan.delay import measure_delay
from fringeworks.scan.exposure import auto_exposure
from fringeworks.scan.frames import take_frames
from fringeworks.types import CameraSettings, DeviceProblem
from tests.virtual_devices import bench, plan


class Board:
    """A projector with a memory: every pulse shows the next picture that was loaded."""

    def __init__(self, shows, pictures):
        self._shows, self._pictures, self.pulses = shows, pictures, 0

    def pulse(self):
        self._shows.show(self._pictures[self.pulses % len(self._pictures)])
        self.pulses += 1


def loaded(camera=None, **projector):
    b = bench(projector, camera)
    board = Board(b.projector, list(encode(plan())))
    return b, board


def test_a_plan_is_captured_with_triggers(tmp_path):
    b, board = loaded()
    write_patterns(tmp_path / "patterns", plan())
    steps = []
    with MemoryProjector(tmp_path / "patterns", advance=board.pulse) as projector:
        assert isinstance(projector, Projector)
        assert projector.plan == plan()
        for n in range(2):
            # The sequence starts again after the last picture.
            folder = capture(
                projector,
                b.camera,
                plan(),
                tmp_path / "c",
                settings=CameraSettings(exposure_ms=16.667),
                force=True,
                progress=steps.append,
            )
            assert board.pulses == (n + 1) * plan().frames
    stack = read_stack(folder)
    assert (stack.camera, stack.projector, stack.saturation) == ("virtual", "memory", 255)
    assert steps == plan().labels() * 2
    for frame, picture in zip(stack.frames, encode(plan()), strict=True):
        assert np.abs(frame - 255 * (0.6 * picture[::2, ::2] / 255.0 + 0.03)).mean() < 2
    with pytest.raises(DeviceProblem, match="got a closed one"):
        projector.show(next(iter(encode(plan()))))


def test_the_camera_may_advance_the_projector(tmp_path):
    b, board = loaded()
    trigger = b.camera.trigger

    def trigger_output():
        board.pulse()
        return trigger()

    b.camera.trigger = trigger_output
    folder = capture(MemoryProjector(plan()), b.camera, plan(), tmp_path / "c")
    assert len(read_stack(folder).frames) == board.pulses == plan().frames


def test_only_the_next_picture_is_accepted():
    pulses = []
    projector = MemoryProjector(plan(), advance=lambda: pulses.append(1), refresh_s=0.01)
    assert (projector.size_px, projector.bits, projector.refresh_s) == ((128, 96), 8, 0.01)
    pictures = list(encode(plan()))
    projector.show(pictures[0])
    for wrong in (pictures[0], pictures[2], np.zeros_like(pictures[0])):
        with pytest.raises(DeviceProblem, match="expected picture 2 of 12 .* got another one"):
            projector.show(wrong)
    assert len(pulses) == projector.position == 1
    projector.show(pictures[1])
    projector.restart()
    projector.show(pictures[0])


def test_a_sequence_that_was_disturbed(tmp_path):
    b, board = loaded({"torn": 0.3})
    projector = MemoryProjector(plan(), advance=board.pulse)
    with pytest.raises(DeviceProblem, match="expected one complete frame of picture .* got an inc"):
        capture(projector, b.camera, plan(), tmp_path / "c")
    with pytest.raises(FileProblem, match="interrupted"):
        read_stack(tmp_path / "c")
    with pytest.raises(DeviceProblem, match="expected the first picture .* to come next, got"):
        capture(projector, b.camera, plan(), tmp_path / "c")
    projector.restart()
    b, board = loaded()
    projector = MemoryProjector(plan(), advance=board.pulse)
    capture(projector, b.camera, plan(), tmp_path / "c", force=True)
    assert len(read_stack(tmp_path / "c").frames) == plan().frames


def test_what_a_sequence_cannot_do(tmp_path):
    b, board = loaded()
    projector = MemoryProjector(plan(), advance=board.pulse, refresh_s=1 / 60)
    with pytest.raises(InputError, match="expected the plan whose pictures the projector"):
        capture(projector, b.camera, plan(2), tmp_path / "c")
    with pytest.raises(InputError, match="delay: expected none"):
        one = bench()
        delay = measure_delay(one.projector, one.camera)
        list(take_frames(projector, b.camera, plan(), delay=delay))
    with pytest.raises(DeviceProblem, match="shows no test pictures"):
        auto_exposure(projector, b.camera)

    class Free:
        """A camera without trigger."""

        name = "free"

    with pytest.raises(InputError, match="free: expected a camera with a trigger"):
        list(take_frames(projector, Free(), plan()))


def test_a_sequence_is_resumed_and_averaged(tmp_path):
    """The whole sequence plays again, and frames that are there stay."""
    b, board = loaded()
    projector = MemoryProjector(plan(), advance=board.pulse)
    grab, left = b.camera.grab, [plan().frames + 7]

    def failing(timeout_s=5.0):
        left[0] -= 1
        if left[0] == 0:
            raise DeviceProblem("camera: gone")
        return grab(timeout_s)

    b.camera.grab = failing
    with pytest.raises(DeviceProblem, match="gone"):
        capture(projector, b.camera, plan(), tmp_path / "c", average=2)
    with pytest.raises(FileProblem, match="interrupted"):
        read_stack(tmp_path / "c")
    # The operator starts the projector's sequence again.
    board.pulses = 0
    projector.restart()
    capture(projector, b.camera, plan(), tmp_path / "c", average=2, resume=True)
    stack = read_stack(tmp_path / "c")
    assert stack.frames[0].dtype == np.float32
    for frame, picture in zip(stack.frames, encode(plan()), strict=True):
        assert np.abs(frame - 255 * (0.6 * picture[::2, ::2] / 255.0 + 0.03)).mean() < 2


def test_a_folder_without_a_plan(tmp_path):
    with pytest.raises(FileProblem, match=r"plan\.toml"):
        MemoryProjector(tmp_path)
