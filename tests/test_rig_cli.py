"""Calibrate, reconstruct with a rig and evaluate as a user types them."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from fringeworks.files.rig import read_rig, write_rig
from fringeworks.files.stack import write_stack
from fringeworks.simulate.bodies import Sphere
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import board_body, fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look
from tests.commands import run
from tests.rigs import ahead, board, poses, rig, shoot

pytestmark = pytest.mark.statistical


@pytest.fixture(scope="module")
def shots(tmp_path_factory):
    """Five poses of a board, and a ball."""
    folder = tmp_path_factory.mktemp("shots")
    for k, T in enumerate(poses(5, 9)):
        _, plan, frames = shoot([board_body(board(), T)], Optics(seed=k))
        write_stack(folder / "board" / f"pose{k}", frames, plan)
    view, plan, frames = shoot([ahead(Sphere(25.0), 5, 3)], Optics(seed=50), both=False)
    write_stack(folder / "ball", frames, plan, truth=view.truth)
    return folder


@pytest.fixture(scope="module")
def two_poses(tmp_path_factory):
    """Two poses of a board in small pictures."""
    folder, small = tmp_path_factory.mktemp("two"), standard_rig(scale=0.25)
    plan = fringe_plan(small)
    for k, T in enumerate(poses(2, 9)):
        frames = photograph(look(small, [board_body(board(), T)]), plan, Optics(seed=k))
        write_stack(folder / f"pose{k}", list(frames), plan)
    return folder


@pytest.fixture(scope="module")
def calibrated(shots):
    out = shots / "rig.toml"
    done = run(
        "calibrate",
        shots / "board",
        "--board",
        "chessboard:11x8:12",
        "--out",
        out,
        "--json",
        shots / "calibration.json",
        "--figure",
        shots / "calibration.png",
    )
    assert (shots / "calibration.png").stat().st_size > 10_000
    assert "wrote" in done.stdout
    assert "baseline" in done.stdout
    assert "pose4" in done.stdout
    return out


def test_chain_from_boards_to_a_diameter(shots, calibrated, tmp_path):
    content = json.loads((shots / "calibration.json").read_text())
    assert content["baseline_mm"] == pytest.approx(rig().baseline_mm, rel=3e-4)
    assert len(content["poses"]) == 5
    assert {f["kind"] for f in content["findings"]} <= {"poses", "corners"}
    out, figure = tmp_path / "ball.ply", tmp_path / "ball.png"
    done = run("measure", shots / "ball", "--rig", calibrated, "--out", out, "--figure", figure)
    assert "points: x" in done.stdout
    assert figure.stat().st_size > 10_000
    done = run("evaluate", out, "--fit", "sphere", "--diameter-mm", 50, "--json", "-")
    body = json.loads(done.stdout)["bodies"][0]
    assert abs(body["probing_error_size_PS_mm"]) < 0.03
    assert body["standard_deviation_mm"] < 0.04
    done = run("evaluate", out, "--fit", "sphere", "--within", "5,3,500,30")
    assert "probing_error_form_PF_mm" in done.stdout


def test_rig_files_are_converted(calibrated, tmp_path):
    run("rig", "convert", calibrated, "--out", tmp_path / "rig.xml")
    run("rig", "convert", tmp_path / "rig.xml", "--out", tmp_path / "back.toml")
    assert read_rig(tmp_path / "back.toml").camera == read_rig(calibrated).camera


def test_a_wrong_board_writes_no_rig(two_poses, tmp_path):
    out = tmp_path / "rig.toml"
    shutil.copytree(two_poses / "pose0", tmp_path / "one" / "pose0")
    done = run("calibrate", tmp_path / "one", "--board", "chessboard:9x7:12", "--out", out, code=2)
    assert "3 poses or more, got 0; pose0: expected 9 × 7 inner corners, found" in done.stderr
    assert not out.exists()


def test_two_poses_write_no_rig(two_poses, tmp_path):
    out = tmp_path / "rig.toml"
    done = run("calibrate", two_poses, "--board", "chessboard:11x8:12", "--out", out, code=2)
    assert "3 poses or more, got 2" in done.stderr
    assert not out.exists()


def test_a_rig_of_another_projector_is_refused(shots, tmp_path):
    from dataclasses import replace

    other = replace(rig(), projector=replace(rig().projector, width_px=1024))
    write_rig(tmp_path / "other.toml", other)
    out = tmp_path / "p.ply"
    done = run("measure", shots / "ball", "--rig", tmp_path / "other.toml", "--out", out, code=2)
    assert "projector of 1024 × 600 px, got a plan for 960 × 600" in done.stderr
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("calibrate", "nowhere", "--board", "chessboard:9x7:75", "--out", "r.toml"),
            "stack per pose",
        ),
        (("calibrate", ".", "--board", "checkers", "--out", "r.toml"), "board: expected"),
        (
            ("calibrate", ".", "--board", "chessboard:9x7:75", "--out", "r.json"),
            "expected one of .toml",
        ),
        (("measure", "x", "--rig", "none.toml", "--out", "p.ply"), "nothing there"),
        (("measure", "x"), "--rig"),
        (("measure", "--rig", "none.toml"), "stack"),
        (("reconstruct", "x", "--rig", "r.toml"), "nothing there"),
        (("evaluate", "none.ply", "--fit", "plane"), "no such file"),
        (("evaluate", "none.ply", "--fit", "plane", "--count", "2"), "count"),
        (("evaluate", "none.ply", "--fit", "sphere", "--spacing-mm", "5"), "spacing"),
        (
            ("rig", "convert", "none.toml", "--out", "r.xml", "--projector-size", "wide"),
            "--projector-size",
        ),
    ],
)
def test_bad_input_is_one_sentence(arguments, message, tmp_path):
    assert message in run(*arguments, cwd=tmp_path, code=2).stderr
    assert not list(tmp_path.iterdir())


def test_points_are_cut_to_a_ball(tmp_path):
    path = tmp_path / "p.xyz"
    np.savetxt(path, np.random.default_rng(0).normal(size=(50, 3)))
    done = run("evaluate", path, "--fit", "plane", "--within", "9,9,9,0.1", code=2)
    assert "10 points or more there, got 0" in done.stderr
    assert (
        "within: expected x, y, z and a radius"
        in run("evaluate", path, "--fit", "plane", "--within", "9,9", code=2).stderr
    )
