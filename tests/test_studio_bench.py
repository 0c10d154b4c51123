"""What the virtual scene of the studio shows by itself, and when no further pose is asked for."""

from __future__ import annotations

import os

import numpy as np
import pytest

pytest.importorskip("nicegui", reason="nicegui is not installed")

from fringeworks.devices.bench import POSES, virtual_bench
from fringeworks.devices.clock import SimulatedClock
from fringeworks.studio.state import Studio
from fringeworks.types import DeviceProblem


@pytest.fixture
def studio(tmp_path):
    made = Studio(tmp_path / "work")
    yield made
    made.close()


def pose(studio, number):
    folder = studio.workspace.poses / f"pose-{number:02d}"
    folder.mkdir(parents=True)
    (folder / "capture.toml").write_text("")
    return folder


def test_the_virtual_scene_suits_each_step(studio):
    assert studio.words_for("set up")[1] == "virtual:plane"
    assert studio.words_for("scan")[1] == "virtual:bust"
    assert studio.words_for("scan", 45.0)[1] == "virtual:turntable-45"
    studio.scene = "sphere"
    assert {studio.words_for(purpose)[1] for purpose in ("set up", "calibrate", "scan")} == {
        "virtual:sphere"
    }


def test_the_virtual_board_moves_to_the_pose_that_is_missing(studio):
    assert studio.words_for("calibrate")[1] == "virtual:board-0"
    for number in (1, 2, 3):
        pose(studio, number)
    assert studio.words_for("calibrate")[1] == "virtual:board-3"
    studio.undo_pose("pose-02")
    assert studio.words_for("calibrate")[1] == "virtual:board-1"
    for number in (2, *range(4, POSES + 1)):
        pose(studio, number)
    assert studio.words_for("calibrate")[1] == "virtual:board-0"


def test_no_pose_is_asked_for_after_the_calibration(studio):
    assert not studio.calibrated_with_all()
    first = pose(studio, 1)
    studio.workspace.rig.write_text("")
    os.utime(first, ns=(1, 1))
    assert studio.calibrated_with_all()
    pose(studio, 2)
    os.utime(studio.workspace.rig, ns=(2, 2))
    assert not studio.calibrated_with_all()


def test_the_virtual_turntable_turns():
    white = np.ones((360, 576))
    seen = {
        angle: virtual_bench(f"turntable-{angle}", clock=SimulatedClock())[1].scene.projected(white)
        for angle in ("0", "360", "-90.5")
    }
    np.testing.assert_allclose(seen["0"], seen["360"], atol=1e-9)
    assert np.abs(seen["0"] - seen["-90.5"]).max() > 0.1
    for wrong in ("", "x", "nan", "1e9", "99999"):
        with pytest.raises(DeviceProblem, match="turntable-ANGLE"):
            virtual_bench(f"turntable-{wrong}")
