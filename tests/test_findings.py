"""Findings: their text, their order, and how they reach the user where a chain fails."""

from __future__ import annotations

import json
import pickle
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.batch.measure import job_of, measure_scan
from fringeworks.batch.scans import Scan
from fringeworks.batch.store import Store
from fringeworks.cli import output
from fringeworks.cli.commands import run
from fringeworks.files.findings import findings_as_json, findings_from_json
from fringeworks.patterns import PhaseSteps, equal_steps
from fringeworks.rig.calibration.board import Board
from fringeworks.rig.calibration.diagnosis import unit_findings
from fringeworks.serving.worker import _answer
from fringeworks.simulate.bodies import Plane
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import board_body
from fringeworks.types import Finding, InputError, Pixels, Region, by_effect, found_before
from tests.rigs import BOARD, ahead, board, poses, rig, shoot
from tests.stacks import take

CM = (45.0, 56.0)
"""A range of depths that somebody gave in cm: the part lies at about 500 mm."""
NOTE = Finding("noise", "noise of 2 counts", severity="note")
ERROR = Finding("frames", "they are turned", ("a wrong file",), "turn them", severity="error")
WARNING = Finding("steps", "steps are off", axis="x", frames=("x-1",), figures={"off_deg": 3.0})


@cache
def plane():
    """A plane before the rig: where it is, and its frames."""
    view, plan, frames = shoot([ahead(Plane(140, 100), turn=(0.2, 0.15, 0))], Optics(seed=1))
    return view, fw.Stack(tuple(frames), plan)


@cache
def nowhere():
    """The plane, measured with a range of depths in cm."""
    return fw.measure(plane()[1], rig(), depth_mm=CM).points


def names_the_range(line: str) -> bool:
    """Whether a line says first which range is wrong, and where the points are instead."""
    view, _ = plane()
    z = view.points_mm[view.lit][:, 2]
    first, last = (
        float(word) for word in line.split("they are at ")[1].split(" mm")[0].split(" to ")
    )
    near = abs(first - z.min()) < 2.0 and abs(last - z.max()) < 2.0
    return near and line.partition("all ")[2].partition(";")[0].endswith(
        f"lie outside the depth range of 45 to 56 mm: they are at {first:.0f} to {last:.0f} mm"
    )


def test_a_finding_is_one_line():
    assert ERROR.text == "they are turned; likely a wrong file; turn them"
    assert NOTE.text == "noise of 2 counts"
    assert NOTE.line == "note (noise): noise of 2 counts"
    assert WARNING.line == "warning (steps): steps are off"
    assert NOTE.rank < WARNING.rank < ERROR.rank


def test_findings_come_back_from_json_as_they_were():
    pixels = Pixels(3, 12, Region(1, 2, 3, 4))
    found = (NOTE, replace(WARNING, pixels=pixels), replace(ERROR, pixels=Pixels(0, 0)))
    assert findings_from_json(findings_as_json(found)) == found
    assert pixels.share == 0.25
    assert json.loads(findings_as_json(found))[2]["text"] == ERROR.text
    broken = findings_as_json(found).replace('"error"', '"fatal"')
    with pytest.raises(ValueError, match="severity"):
        findings_from_json(broken)


def test_errors_tell_the_most_severe_finding_first_and_the_refusal_last():
    with pytest.raises(fw.FileProblem) as raised, found_before([NOTE, WARNING]):
        raise fw.FileProblem("expected points, got none", findings=[WARNING, ERROR])
    error = raised.value
    assert error.findings == (NOTE, WARNING, ERROR)
    assert error.lines == (ERROR.line, WARNING.line, NOTE.line, "expected points, got none")
    assert error.__notes__ == [NOTE.text, WARNING.text, ERROR.text]
    placed = error.at("camera 2")
    assert type(placed) is fw.FileProblem
    assert placed.lines[0] == f"error (frames): camera 2: {ERROR.text}"
    assert str(placed) == "camera 2: expected points, got none"
    again = pickle.loads(pickle.dumps(placed))
    assert (str(again), again.findings) == (str(placed), placed.findings)
    assert InputError("no").lines == ("no",)


def many(count):
    """A note, an error, and warnings that concern more pixels each."""
    warnings = [replace(WARNING, seen=f"warning {k}", pixels=Pixels(k, 100)) for k in range(count)]
    return [NOTE, *warnings, ERROR]


def test_findings_are_sorted_by_their_effect():
    assert by_effect(many(3)) == [ERROR, *many(3)[3:0:-1], NOTE]
    everywhere = replace(WARNING, seen="everywhere", pixels=None)
    assert by_effect([*many(2), everywhere])[:2] == [ERROR, everywhere]


@pytest.fixture
def _as_before():
    """The options of all commands are those of a new program afterwards."""
    yield
    output.configure(quiet=False, verbose=False, log=None)


@pytest.mark.usefixtures("_as_before")
def test_a_command_prints_five_findings_and_counts_the_others(capsys, tmp_path):
    log = tmp_path / "log"
    output.configure(quiet=False, verbose=False, log=log)
    output.Output().found(many(7))
    said = capsys.readouterr().out.splitlines()
    assert said[0] == ERROR.line
    assert [line.split(": ")[1] for line in said[1:5]] == [f"warning {k}" for k in (6, 5, 4, 3)]
    assert said[5:] == ["and 4 smaller findings; `fringeworks --verbose` shows all"]
    assert log.read_text().count("(steps)") == 7
    assert NOTE.line in log.read_text()
    output.Output().found(many(3))
    assert len(capsys.readouterr().out.splitlines()) == 5
    output.Output().found([replace(ERROR, seen=f"error {k}") for k in range(8)])
    assert len(capsys.readouterr().out.splitlines()) == 8
    output.configure(quiet=False, verbose=True, log=None)
    output.Output().found(many(7))
    assert len(capsys.readouterr().out.splitlines()) == 9


@pytest.mark.usefixtures("_as_before")
def test_a_command_that_fails_prints_five_findings_and_keeps_all(capsys, tmp_path):
    path = output.want_json(tmp_path / "result.json")
    assert output.fail("expected points, got none", many(7)) == 2
    said = capsys.readouterr().err.splitlines()
    assert said[0] == ERROR.line
    assert said[5:] == [
        "and 4 smaller findings; `fringeworks --verbose` shows all",
        "fringeworks: expected points, got none",
    ]
    assert len(json.loads(path.read_text())["findings"]) == 9


def test_quiet_and_verbose_exclude_each_other(capsys):
    assert run(["-q", "-v", "devices"]) == 2
    assert "--verbose: it cannot be combined with --quiet" in capsys.readouterr().err


@pytest.mark.parametrize("kind", [np.float64, np.uint8])
def test_frames_without_noise_are_named_as_such(kind):
    plan = fw.PatternPlan(256, 8, (PhaseSteps("x", 256.0, equal_steps(4)),))
    row, column = np.mgrid[:80, :200]
    at = 0.9 * column + 0.13 * row
    frames = [np.interp(at, np.arange(256), frame[0].astype(float)) for frame in fw.encode(plan)]
    frames = [20.0 + 0.6 * frame for frame in frames]
    if kind is np.uint8:
        frames = [np.rint(frame).astype(kind) for frame in frames]
    (said,) = [f for f in fw.decode(frames, plan).findings if f.kind == "noise"]
    assert said.text.startswith("the frames show no noise above 0.")
    assert said.text.endswith("likely rendered, averaged or denoised frames")
    assert said.severity == "note"
    noisy = np.random.default_rng(0).normal(0.0, 1.0, (4, 80, 200))
    frames = [np.rint(frame + n) for frame, n in zip(frames, noisy, strict=True)]
    (said,) = [f for f in fw.decode(frames, plan).findings if f.kind == "noise"]
    assert said.text.startswith("noise of 1.")


def test_a_depth_range_in_cm_is_the_first_thing_that_is_said(tmp_path, capsys):
    _, stack = plane()
    fw.files.write_rig(tmp_path / "rig.toml", rig())
    fw.files.write_stack(tmp_path / "shots", list(stack.frames), stack.plan)
    figures, log = tmp_path / "m.json", tmp_path / "log.txt"
    command = ["--log", log, "measure", tmp_path / "shots", "--rig", tmp_path / "rig.toml"]
    command += ["--depth", "45:56", "--out", tmp_path / "p.ply", "--json", figures]
    assert run([str(word) for word in command]) == 2
    said = capsys.readouterr().err.splitlines()
    assert said[0].startswith("error (depth range): all ")
    assert names_the_range(said[0])
    assert "likely the range was given in cm" in said[0]
    assert said[-1] == f"fringeworks: {tmp_path / 'p.ply'}: expected points to write, got none"
    content = json.loads(figures.read_text())
    assert content["error"] in said[-1]
    (depth, *_) = [f for f in content["findings"] if f["severity"] == "error"]
    assert (depth["figures"]["near_mm"], depth["figures"]["far_mm"]) == CM
    assert depth["pixels"]["count"] == depth["pixels"]["of"] > 0
    assert said[0] in log.read_text()
    assert not (tmp_path / "p.ply").exists()


def test_a_range_that_holds_the_part_is_a_note():
    found = fw.measure(plane()[1], rig(), depth_mm=(400.0, 600.0)).points
    ranges = [f for f in found.findings if f.kind == "depth range"]
    assert {f.severity for f in ranges} == {"note"}
    assert {f.text.partition(" of ")[0] for f in ranges} == {"0.0%"}


def test_merging_empty_views_names_their_cause():
    with pytest.raises(InputError) as raised:
        fw.merge([nowhere(), nowhere()], poses="shape")
    assert raised.value.lines[0].startswith("error (depth range): view 1: all ")
    assert names_the_range(raised.value.lines[0])


def test_a_deviation_without_points_names_the_cause():
    corners = np.array([[0, 0, 500], [9, 0, 500], [9, 9, 500], [0, 9, 500.0]])
    plate = fw.TriangleMesh(corners, np.array([[0, 1, 2], [0, 2, 3]]))
    with pytest.raises(InputError, match="expected measured points, got none") as raised:
        fw.deviation(nowhere(), plate, align=fw.evaluate.KnownPose(np.eye(4)))
    assert names_the_range(raised.value.lines[0])


def test_a_form_of_points_in_another_unit_names_the_cause():
    unit = Finding("unit", "camera and projector are 0.1 mm apart", advice="read it with unit_mm")
    x = np.linspace(0, 1, 50)
    line = fw.surface.Points(np.column_stack((x, x, x)), None, findings=(unit,))
    with pytest.raises(InputError, match="points that determine a body") as raised:
        fw.fit(line, "plane")
    assert raised.value.lines[0] == unit.line


def test_frames_that_cannot_be_decoded_name_the_cause():
    periods = zip((16.0, 17.0, 19.0), (6, 3, 3), strict=True)
    sets = tuple(fw.patterns.PhaseSteps("x", p, fw.patterns.equal_steps(n)) for p, n in periods)
    plan = fw.PatternPlan(1280, 60, sets)
    # Neighbours help on surfaces only.
    x = np.random.default_rng(0).uniform(-0.5, 1279.5, (60, 1280))
    frames = take(plan, noise=1.0, b=4.0, at=(np.zeros_like(x), x), kind=np.float32)
    stack = fw.Stack(tuple(frames), plan, lossy=True)
    with pytest.raises(InputError, match="expected pixels that can be measured") as raised:
        fw.decode(stack, noise=fw.signal.CameraNoise(1.0))
    found = raised.value.findings
    assert "JPEG" in found[0].text
    most = max((f for f in found if f.kind == "unmeasured"), key=lambda f: f.figures["share"])
    assert most.causes[0] == "too much noise for the plan's periods"
    assert most.figures["share"] > 0.5
    assert raised.value.lines[-1] == str(raised.value)


def test_a_calibration_with_overexposed_frames_names_the_pose_and_the_cause():
    _, plan, frames = shoot([board_body(board(), poses()[0])], Optics(seed=1))
    # Where the board is dim enough to be measured, there is noise only.
    noise = np.random.default_rng(0).normal(0.0, 20.0, (len(frames), *frames[0].shape))
    white = 2.5 * np.max(frames, axis=0) >= 255
    seen = 2.5 * np.stack(frames) + np.where(white, 0.0, noise)
    bright = tuple(np.clip(seen, 0, 255).astype(np.uint8))
    with pytest.raises(InputError, match="pose0: expected 8 or more corners") as raised:
        fw.calibrate([("pose0", fw.Stack(bright, plan))], BOARD)
    assert raised.value.lines[0].startswith("warning (saturated): pose0: ")
    assert "saturated" in raised.value.lines[0]
    assert "likely the exposure is too long" in raised.value.lines[0]


def test_a_calibration_without_boards_keeps_what_was_found_in_the_poses():
    _, stack = plane()
    stacks = [(f"pose{k}", replace(stack, lossy=True)) for k in range(2)]
    with pytest.raises(InputError, match="expected the board in 3 poses or more") as raised:
        fw.calibrate(stacks, BOARD)
    said = raised.value.lines
    for k in range(2):
        assert any(f"pose{k}: the frames were compressed with loss" in line for line in said[:-1])


def test_a_raw_colour_frame_is_named_where_no_fringes_are_found():
    frame = np.full((80, 100), 40.0)
    frame[::2, ::2] = 120.0
    with pytest.raises(InputError) as raised:
        fw.reconstruct(fw.Pair(None, frame))
    assert "raw frame of a colour camera" in raised.value.lines[0]


def test_a_batch_tables_the_cause(tmp_path):
    _, stack = plane()
    fw.files.write_stack(tmp_path / "part", list(stack.frames), stack.plan)
    recipe = fw.Recipe(rig=rig(), options={"depth_mm": list(CM)})
    store = Store(tmp_path / "results")
    store.begin({})
    row = measure_scan(Scan("part", str(tmp_path / "part")), job_of(recipe, str(store.folder)))
    assert row["error"].startswith("error (depth range): all ")
    assert names_the_range(row["error"])
    assert row["error"].endswith("expected points to write, got none")


def test_the_studio_shows_the_cause_above_the_refusal():
    def refused(_):
        raise InputError("expected points, got none", findings=[NOTE, ERROR])

    state, said = _answer(None, refused, ())
    assert state == "failed"
    assert said.splitlines() == [ERROR.line, NOTE.line, "expected points, got none"]


@pytest.mark.parametrize(
    ("pitch", "distance", "words"),
    [
        (0.025, 0.6, "metres, all lengths are 1000 times too small"),
        (0.04, 1.1, "metres, all lengths are 1000 times too small"),
        (2.5, 55.0, "cm or inches, all lengths are 10 or 25.4 times too small"),
        (0.787, 19.0, "cm or inches"),
        (25.0, 600.0, None),
        (10.0, 120.0, None),
        (3.0, 300.0, None),
    ],
)
def test_a_board_in_another_unit_is_named(pitch, distance, words):
    poses = []
    for k in range(5):
        pose = np.eye(4)
        pose[2, 3] = distance * (1.0 + 0.1 * k)
        poses.append(pose)
    found = unit_findings(Board("chessboard", 9, 6, pitch), poses)
    assert [f.kind for f in found] == (["unit"] if words else [])
    if words:
        assert words in found[0].seen
        assert "give the board's size in mm" in found[0].text
