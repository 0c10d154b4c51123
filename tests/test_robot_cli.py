"""``hand-eye`` and ``measure --in robot``: what they refuse, and what they write."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.rig.pinhole import pose, rotation
from fringeworks.simulate import bust, fringe_plan, look, photograph, standard_rig
from tests.commands import run

PLACE = pose(rotation(np.array([0.3, 0.1, -0.8])), np.array([50.0, 20.0, 900.0]))
RIG = standard_rig(scale=0.1)


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("robot")
    plan = fringe_plan(RIG, both=False)
    fw.files.write_stack(folder / "part", photograph(look(RIG, bust()), plan), plan)
    fw.files.write_rig(folder / "rig.toml", RIG)
    for mount in ("hand", "base"):
        frame = fw.rig.RobotFrame(
            mount, PLACE, np.diag([1e-8] * 3 + [1e-2] * 3), fw.rig.RobotNoise(0.1, 0.0), "wxyz:mm"
        )
        fw.files.write_rig(folder / f"{mount}.toml", replace(RIG, robot=frame))
    (folder / "poses.csv").write_text(
        "name,x,y,z,q1,q2,q3,q4\nother,1,2,3,0,1,0,0\npart,400,300,500,0,0,0,1\n"
    )
    text = (folder / "poses.csv").read_text()
    (folder / "twice.csv").write_text(text + "part,400,300,510,0,0,0,1\n")
    return folder


def test_points_in_the_base(place):
    plain = fw.measure(place / "part", RIG).points
    done = run(
        "measure", "part", "--rig", "base.toml", "--in", "robot", "--out", "a.npz", cwd=place
    )
    assert "points in coordinates of base" in done.stdout
    found = fw.files.read_cloud(place / "a.npz")
    expected = plain.transformed(PLACE, frame="base")
    np.testing.assert_allclose(found.xyz_mm, expected.xyz_mm, atol=1e-3)
    grown = np.sqrt(found.sigma_mm**2 - plain.sigma_mm**2)
    assert np.nanmin(grown) == pytest.approx(0.1, rel=0.2)
    for given in ("poses.csv", "400,300,500,0,0,0,1"):
        run(
            *("measure", "part", "--rig", "hand.toml", "--in", "robot"),
            *("--robot-pose", given, "--out", "b.npz"),
            cwd=place,
        )
        flange = pose(np.diag([-1.0, -1.0, 1.0]), np.array([400.0, 300.0, 500.0]))
        found = fw.files.read_cloud(place / "b.npz").placement.T_frame_camera
        np.testing.assert_allclose(found, flange @ PLACE, atol=1e-9)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--rig", "rig.toml", "--in", "robot"], "where the camera is on the robot, got none"),
        (["--rig", "hand.toml", "--in", "robot"], "expected the pose of the flange"),
        (["--rig", "base.toml", "--in", "robot", "--robot-pose", "poses.csv"], "expected none"),
        (["--rig", "hand.toml", "--robot-pose", "poses.csv"], "together with --in robot"),
        (["--rig", "base.toml", "--in", "robot", "--poses-as", "ur"], "together with --robot-pose"),
        (
            ["--rig", "hand.toml", "--in", "robot", "--robot-pose", "1,2,3,10,20,30"],
            "as at the hand-eye calibration",
        ),
        (["--rig", "hand.toml", "--in", "robot", "--robot-pose", "1,2"], "robot pose: expected"),
        (
            ["--rig", "hand.toml", "--in", "robot", "--robot-pose", "twice.csv"],
            "expected one pose with the name part, got 2",
        ),
    ],
)
def test_what_is_missing_is_said(place, options, words):
    done = run("measure", "part", *options, "--out", "c.npz", cwd=place, code=2)
    assert words in done.stderr
    assert not (place / "c.npz").exists()


def test_a_scan_in_the_base_is_refused_before_and_placed_after(tmp_path):
    rig = fw.devices.virtual_rig()
    fw.files.write_rig(tmp_path / "plain.toml", rig)
    fw.files.write_rig(
        tmp_path / "base.toml",
        replace(rig, robot=fw.rig.RobotFrame("base", PLACE, None, None, None)),
    )
    fw.files.write_plan(tmp_path / "plan.toml", fringe_plan(rig, both=False))
    words = ("scan", "plan.toml", "--projector", "virtual", "--camera", "virtual:sphere")
    words += ("--in", "robot", "--capture", "part", "--out", "part.ply")
    done = run(*words, "--rig", "plain.toml", cwd=tmp_path, code=2)
    assert "where the camera is on the robot, got none" in done.stderr
    assert not (tmp_path / "part").exists()
    done = run(*words, "--rig", "base.toml", cwd=tmp_path)
    assert "points in coordinates of base" in done.stdout
    run(*words, "--rig", "base.toml", "--turntable", "60", cwd=tmp_path, code=2)


def test_hand_eye_says_what_it_needs(place):
    (place / "board").mkdir()
    given = ["--rig", "rig.toml", "--board", "chessboard:11x8:12", "--mount", "hand"]
    given += ["--robot-poses", "poses.csv", "--out", "d.toml"]
    done = run("hand-eye", "board", *given, cwd=place, code=2)
    assert "expected" in done.stderr
    for seen in ("v1.png", "v2.png", "v3.png"):
        fw.files.write_frame(place / "board" / seen, np.zeros((102, 128), np.uint8))
    done = run("hand-eye", "board", *given, cwd=place, code=2)
    assert "pose for each of the 3 views, or poses with the names of the views" in done.stderr
    twice = "name,x,y,z,q1,q2,q3,q4\nv1,1,2,3,0,1,0,0\nv2,1,2,3,0,1,0,0\nv3,1,2,3,0,1,0,0\n"
    (place / "twice-v2.csv").write_text(twice + "v2,9,2,3,0,1,0,0\n")
    again = [*given[:6], "--robot-poses", "twice-v2.csv", "--out", "d.toml"]
    done = run("hand-eye", "board", *again, cwd=place, code=2)
    assert "expected one robot pose with the name v2, got 2" in done.stderr
    done = run("hand-eye", "board", *given, "--robot-noise", "0.1", cwd=place, code=2)
    assert "--robot-noise: expected mm and degrees, as 0.05,0.01, got 1" in done.stderr
    assert not (place / "d.toml").exists()
