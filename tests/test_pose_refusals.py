"""Poses of a board that cannot be used, or of which few corners can: named, with the cause."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fringeworks import FileProblem, Finding, InputError, PatternPlan, Reason, decode
from fringeworks import calibrate as calibrate_any
from fringeworks.patterns import GrayCode
from fringeworks.pipeline import boards
from fringeworks.pipeline.cameras import calibrate_camera_stacks
from fringeworks.report.kinds.cameras import calibration_figures, calibration_words
from fringeworks.rig.calibration.calibrate import calibrate, observe
from fringeworks.rig.calibration.diagnosis import diagnose, few_corners
from fringeworks.scan import live_calibration
from fringeworks.scan.live_calibration import PoseTaker
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import board_body
from fringeworks.stack.even_light import texture
from fringeworks.stack.frames import Stack
from tests.rigs import board, observation, observations, poses, shoot

pytestmark = pytest.mark.statistical

PLAN = PatternPlan(64, 64, (GrayCode("x", 2.0, 64), GrayCode("y", 2.0, 64)))
FOUND = (
    Finding("frames", "frames are of 8 bits", ("nothing bad",), severity="note"),
    Finding("noise", "noise of 25 counts", ("automatic exposure",)),
)
REFUSED = "frames along x: expected pixels that can be measured, got none"
GOOD = [f"pose{k}" for k in range(4)]


def stack_of(name):
    """A stack that only the decoder below knows, by the name of its camera."""
    return Stack([np.zeros((4, 4), np.uint8) for _ in PLAN.labels()], PLAN, camera=name)


def stacks(*names):
    return [(name, stack_of(name)) for name in names]


@pytest.fixture
def _decoder(monkeypatch):
    """The decoder refuses poses called "dim"; those called "torn" cannot be read."""
    seen = {o.name: o for o in observations()}

    def decoded(stack, _):
        if stack.camera.startswith("dim"):
            raise InputError(REFUSED, findings=FOUND)
        if stack.camera.startswith("torn"):
            raise FileProblem("torn/12.png: damaged")
        return SimpleNamespace()

    monkeypatch.setattr(boards, "texture", lambda frames, _: frames[0])
    monkeypatch.setattr(boards, "decoded", decoded)
    monkeypatch.setattr(boards, "observe", lambda *_, name, **__: seen[name])


@pytest.mark.usefixtures("_decoder")
def test_a_refused_pose_is_skipped_and_named_with_its_cause():
    found = calibrate_any(stacks("dim1", *GOOD, "dim2"), board(), distortion=0)
    assert [o.name for o in found.observations] == GOOD
    said = [finding.text for finding in diagnose(found) if finding.kind == "skipped"]
    assert said == [
        f"pose not used: {name}: {REFUSED}; likely automatic exposure" for name in ("dim1", "dim2")
    ]


@pytest.mark.usefixtures("_decoder")
def test_with_too_few_poses_left_the_error_tells_of_every_pose():
    with pytest.raises(InputError, match="3 poses or more, got 2; dim1, dim2: ") as refused:
        calibrate_any(stacks("dim1", *GOOD[:2], "dim2"), board())
    assert str(refused.value).endswith(f"; dim1, dim2: {REFUSED}; likely automatic exposure")
    told = {finding.seen for finding in refused.value.findings}
    assert {"dim1: noise of 25 counts", "dim2: noise of 25 counts"} <= told
    with pytest.raises(FileProblem, match="torn/12"):
        calibrate_any(stacks(*GOOD, "torn"), board())


@pytest.mark.usefixtures("_decoder")
def test_several_cameras_name_the_pose_and_the_camera():
    found = calibrate_camera_stacks(
        [stacks(*GOOD), stacks("dim1", *GOOD[:3])], board(), distortion=0
    )
    words = list(calibration_words(found, calibration_figures(found)))
    expected = f"pose not used: camera 2, dim1: {REFUSED}; likely automatic exposure"
    assert expected in [word.seen for word in words if isinstance(word, Finding)]
    few = replace(found.observations[1][2], found=without(found.observations[1][2].found, 60))
    lost = replace(found, observations=(found.observations[0], (few,)))
    words = list(calibration_words(lost, calibration_figures(lost)))
    said = [word.seen for word in words if isinstance(word, Finding)]
    assert any(seen.startswith("camera 2, pose2: only 28 of the 88 corners") for seen in said)


def without(found, count):
    """A correspondence without the coordinates of its first corners."""
    px = found.projector_px.copy()
    px[:count] = np.nan
    return replace(found, projector_px=px)


@pytest.mark.usefixtures("_decoder")
def test_a_refused_pose_is_taken_again(monkeypatch, tmp_path):
    names = iter(["dim1", "pose0"])
    monkeypatch.setattr(live_calibration, "take", lambda _, path, *__, **___: path)
    monkeypatch.setattr(live_calibration, "read_stack", lambda _: stack_of(next(names)))
    one = replace(observation(0), found=without(observation(0).found, 60), unread="too dim")
    monkeypatch.setattr(boards, "observe", lambda *_, **__: one)
    taker, bench = PoseTaker(tmp_path, board()), SimpleNamespace(plan=PLAN)
    taken = taker.take(bench)
    assert (taken.name, taken.corners) == ("pose-01", 0)
    assert taken.problem == f"pose-01: {REFUSED}; likely automatic exposure"
    again = taker.take(bench)
    assert (again.name, again.corners, again.problem) == ("pose-01", 28, "")
    assert "only 28 of the 88 corners" in str(again)
    assert "likely too dim" in str(again)


def test_few_corners_of_a_pose_are_said_with_their_cause():
    """The fringes are too weak on two thirds of the board; the camera sees all of it."""
    _, plan, frames = shoot([board_body(board(), poses()[0])], Optics())
    found = decode(frames, plan)
    size = (plan.width_px, plan.height_px)
    image = texture(frames, plan)
    whole = observe(image, found, board(), projector_size=size, name="pose0")
    assert whole.unread == ""
    cut = int(np.percentile(whole.view.pixels[:, 0], 33))
    weak = {}
    for axis, coordinates in found.maps.items():
        px, reason = coordinates.coordinate_px.copy(), coordinates.reason.copy()
        px[:, cut:], reason[:, cut:] = np.nan, Reason.LOW_MODULATION
        weak[axis] = replace(coordinates, coordinate_px=px, reason=reason)
    part = observe(image, replace(found, **weak), board(), projector_size=size, name="pose0")
    kept = int(part.found.read.sum())
    assert 20 < kept < 40
    result = calibrate([part, *observations()[1:4]], board(), distortion=0)
    said = [f for f in diagnose(result) if "projector coordinates" in f.seen]
    assert [f.kind for f in said] == ["corners"]
    assert f"pose0: only {kept} of the 88 corners that the camera sees" in said[0].seen
    assert said[0].causes == (
        "the projector lights the board, but the fringes there are too weak; a longer exposure, "
        "less room light, a sharper projector or wider fringes make them stronger",
    )
    assert said[0].figures == {"corners": kept, "corners_found": 88}
    assert not few_corners(observations())
