"""Scans on a turntable: the table turns between captures, and the views become one part."""

from __future__ import annotations

import shlex
import time

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.cli.devices import _turn
from fringeworks.rig.pinhole import pose
from fringeworks.simulate.bodies import Body, Sphere
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import fringe_plan
from fringeworks.simulate.virtual_rig import look
from tests.turntable import board_on_table, on_table, turned_poses, turntable_pose
from tests.turntables import BOARD, T_table_board, rig

pytestmark = pytest.mark.statistical


class Table:
    """A virtual table with a ball, and a camera that takes what stands there."""

    def __init__(self):
        self.angle_deg, self.taken = 0.0, []
        ball = Body(Sphere(25.0), pose(np.eye(3), np.array([3.0, 2.0, -45.0])), 0.6)
        self.bodies = [ball, board_on_table(BOARD, T_table_board)]

    def turn(self, angle_deg):
        self.angle_deg = angle_deg

    def take(self, place):
        self.taken.append((place.name, self.angle_deg))
        (T,) = turned_poses(turntable_pose(distance_mm=520.0), [self.angle_deg])
        plan = fringe_plan(rig(), both=False)
        optics = Optics(exposure=1.1, noise=1.0, seed=int(self.angle_deg))
        frames = photograph(look(rig(), on_table(self.bodies, T)), plan, optics)
        fw.files.write_stack(place, frames, plan)


@pytest.mark.long
def test_a_ball_is_scanned_from_four_sides(tmp_path):
    table = Table()
    part = fw.scan.scan_turntable(
        table.take, table.turn, tmp_path, rig(), step_deg=90.0, board=BOARD.name
    )
    assert table.taken == [(f"view_{k:02d}", 90.0 * k) for k in range(4)]
    assert len(part.poses) == 4
    form = fw.surface.fit_form(part.points.xyz_mm, "sphere", sigma_mm=part.points.sigma_mm)
    assert abs(2.0 * form.parameters["radius_mm"] - 50.0) < 0.02


@pytest.mark.parametrize("step_deg", [0.0, 50.0, 180.0])
def test_steps_divide_a_turn(tmp_path, step_deg):
    table = Table()
    with pytest.raises(fw.InputError, match="whole number of steps"):
        fw.scan.scan_turntable(table.take, table.turn, tmp_path, rig(), step_deg=step_deg)
    assert not table.taken


def test_a_command_turns_the_table(tmp_path):
    place = tmp_path / "angle"
    _turn(30.0, f"sh -c 'echo {{angle}} > {place}'")
    assert place.read_text().strip() == "30"
    with pytest.raises(fw.InputError, match="ends with 0, got 1"):
        _turn(30.0, "false")


@pytest.mark.long
def test_the_studio_merges_the_views_of_a_series(tmp_path, monkeypatch):
    pytest.importorskip("nicegui", reason="nicegui is not installed")
    from fringeworks.studio.state import Studio

    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    table = Table()
    views = [f"ball-{angle:03d}" for angle in (0, 90, 180, 270)]
    for k, view in enumerate(views):
        table.turn(90.0 * k)
        table.take(tmp_path / view)
    studio = Studio(tmp_path)
    try:
        session = studio.session("one")
        with pytest.raises(fw.InputError, match="no rig"):
            studio.merge_views(session, views, BOARD.name, 90.0, "ball")
        fw.files.write_rig(tmp_path / "rig.toml", rig())
        with pytest.raises(fw.InputError, match="two views or more"):
            studio.merge_views(session, views[:1], BOARD.name, 90.0, "ball")
        with pytest.raises(fw.InputError, match="Turntable step: expected degrees"):
            studio.merge_views(session, views, BOARD.name, 0.0, "ball")
        with pytest.raises(fw.FileProblem, match="got one outside"):
            studio.merge_views(session, [*views, "../other"], BOARD.name, 90.0, "ball")
        job = studio.merge_views(session, views, BOARD.name, 90.0, "ball")
        while job.open:
            time.sleep(0.05)
        assert job.state == "done", job.problem
        assert job.result["file"] == "ball.ply"
        assert job.result["views"] == 4
        shown = studio.look(session, "ball.ply", "windowed", {})
        while shown.open:
            time.sleep(0.05)
        assert shown.state == "done", shown.problem
        made = (tmp_path / "ball.ply").read_bytes()
        monkeypatch.chdir(tmp_path)
        for line in studio.log.done[0].shell.splitlines():
            assert run(["-q", *shlex.split(line)[1:]]) == 0, line
        # Commands merge files, whose names are part of the points' origin.
        end = b"end_header\n"
        same = (tmp_path / "ball.ply").read_bytes()
        assert same.partition(end)[2] == made.partition(end)[2] != b""
        (tmp_path / "ball.ply").unlink()
        exec(f"import fringeworks as fw\n{studio.log.done[0].python}", {})
        assert (tmp_path / "ball.ply").read_bytes() == made
    finally:
        studio.close()
    points = fw.files.read_points(tmp_path / "ball.ply")
    assert len(points.xyz_mm) == job.result["points"]
    form = fw.surface.fit_form(points.xyz_mm, "sphere", sigma_mm=points.sigma_mm)
    assert abs(2.0 * form.parameters["radius_mm"] - 50.0) < 0.02
