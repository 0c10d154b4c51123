"""Calibration while the board is moved, on virtual devices."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import InputError
from fringeworks.devices.bench import BOARD, MODEL
from fringeworks.devices.clock import SimulatedClock
from fringeworks.devices.virtual_camera import VirtualCamera
from fringeworks.devices.virtual_projector import ProjectorModel, VirtualProjector
from fringeworks.devices.virtual_scene import RigScene
from fringeworks.rig.calibration.board import parse_board
from fringeworks.scan.bench import Bench
from fringeworks.scan.live_calibration import calibrate_live
from fringeworks.simulate.bodies import Body, Sphere
from fringeworks.simulate.standard import board_body, board_poses, fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look

pytestmark = pytest.mark.system

RIG = standard_rig(scale=0.3)
PLACES = board_poses(parse_board(BOARD), 14, seed=3)


class Hand:
    """Moves the board before the virtual camera; the second time it holds up a ball instead."""

    def __init__(self, camera, most=14):
        self.camera, self.most, self.moves = camera, most, 0
        self.asked = []

    def __call__(self, judgement):
        self.asked += list(judgement.missing[:1])
        if self.moves == self.most:
            return False
        ball = [Body(Sphere(60.0), PLACES[0])]
        bodies = ball if self.moves == 1 else [board_body(parse_board(BOARD), PLACES[self.moves])]
        self.camera.scene = RigScene(look(RIG, bodies))
        self.moves += 1
        return True


def devices():
    projector = VirtualProjector(
        ProjectorModel(RIG.projector.width_px, RIG.projector.height_px), clock=SimulatedClock()
    )
    scene = RigScene(look(RIG, [board_body(parse_board(BOARD), PLACES[0])]))
    return projector, VirtualCamera(scene, projector, MODEL)


@pytest.mark.long
def test_poses_until_it_is_enough(tmp_path):
    projector, camera = devices()
    hand, taken = Hand(camera), []
    bench = Bench(projector, camera, chosen_plan=fringe_plan(RIG))
    found = calibrate_live(bench, BOARD, tmp_path / "board", ready=hand, taken=taken.append)
    assert [bool(pose.problem) for pose in taken].count(True) == 1
    assert "pose-02: " in taken[1].problem
    assert len(set(hand.asked)) >= 3
    assert np.allclose(found.rig.camera.focal_px, RIG.camera.focal_px, rtol=2e-3)
    poses = len(found.observations)
    # Interrupted and begun again: the poses that lie there count.
    again = calibrate_live(bench, BOARD, tmp_path / "board", ready=lambda _: False)
    assert len(again.observations) == poses
    np.testing.assert_allclose(again.rig.camera.parameters, found.rig.camera.parameters, rtol=1e-9)


def test_one_axis_is_refused(tmp_path):
    projector, camera = devices()
    with pytest.raises(InputError, match="along x and y, got x only"):
        calibrate_live(
            Bench(projector, camera, chosen_plan=fringe_plan(RIG, both=False)),
            BOARD,
            tmp_path,
            ready=Hand(camera),
        )
