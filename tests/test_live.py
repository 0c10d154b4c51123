"""Live measurement on virtual devices, and the example."""

from __future__ import annotations

import runpy
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.devices.bench import RADIUS_MM, SCALE, virtual_bench
from fringeworks.devices.clock import SimulatedClock
from fringeworks.simulate.standard import fringe_plan, standard_rig
from tests.grids import quick

pytestmark = pytest.mark.system

RIG = standard_rig(scale=SCALE)
PLAN = fringe_plan(RIG, both=False)


@pytest.mark.parametrize("fast", quick([False, True], False))
def test_every_cloud_is_the_sphere_in_the_same_memory(fast):
    projector, camera = virtual_bench("sphere", clock=SimulatedClock())
    delay = fw.scan.measure_delay(projector, camera, triggered=True) if fast else None
    memory, judged = set(), []
    for cloud in islice(fw.live(projector, camera, PLAN, RIG, delay=delay), 3):
        xyz = cloud.points.xyz_mm[cloud.points.reason == 0]
        found = fw.surface.fit_region(np.array(xyz, float), "sphere")
        assert found.parameters["radius_mm"] == pytest.approx(RADIUS_MM, abs=0.05)
        assert cloud.points_per_s > 0
        judged.append(cloud.judged)
        memory.add(cloud.points.xyz_mm.__array_interface__["data"][0])
    assert len(memory) == 1
    assert judged == [True, False, False]


def test_points_in_the_base_of_a_robot():
    place = np.eye(4)
    place[:3, 3] = 100.0, -50.0, 30.0
    rig = replace(RIG, robot=fw.rig.RobotFrame("hand", place, None, None, None))
    poses = []

    def pose():
        flange = np.eye(4)
        flange[2, 3] = 10.0 * len(poses)
        poses.append(flange)
        return flange

    for k, cloud in enumerate(islice(live_of(rig, pose), 2), 1):
        assert cloud.points.frame == "base"
        expected = place[:3, 3] + [0.0, 0.0, 10.0 * k]
        np.testing.assert_allclose(cloud.points.placement.T_frame_camera[:3, 3], expected)
    # Without the robot in the rig, no frame is taken.
    with pytest.raises(fw.InputError, match="expected where the camera is on the robot, got none"):
        next(live_of(RIG, lambda: None))


def live_of(rig, pose):
    projector, camera = virtual_bench("sphere", clock=SimulatedClock())
    return fw.live(projector, camera, PLAN, rig, robot_pose=pose)


def test_the_example(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(Path(__file__).parent.parent / "examples" / "live.py"))
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 5
    assert all("million points/s" in line for line in lines)


class Unplugged:
    """A camera that is gone after some frames."""

    def __init__(self, camera, frames):
        self._camera, self._left = camera, frames

    def __getattr__(self, name):
        return getattr(self._camera, name)

    def grab(self, *args, **options):
        self._left -= 1
        if self._left < 0:
            raise fw.DeviceProblem("camera: gone")
        return self._camera.grab(*args, **options)


def test_live_goes_on_when_the_camera_is_back():
    projector, camera = virtual_bench("sphere", clock=SimulatedClock())
    attempts, opened, said = [], [], []

    def reopen():
        attempts.append(len(attempts))
        if len(attempts) % 3:
            raise fw.DeviceProblem("camera: not there")
        opened.append(virtual_bench("sphere", clock=SimulatedClock()))
        return opened[-1][0], Unplugged(opened[-1][1], 10**6 if len(opened) > 1 else 60)

    clouds = fw.live(
        projector, Unplugged(camera, 60), PLAN, RIG, reopen=reopen, retry_s=0, progress=said.append
    )
    judged = []
    for cloud in islice(clouds, 6):
        xyz = cloud.points.xyz_mm[cloud.points.reason == 0]
        found = fw.surface.fit_region(np.array(xyz, float), "sphere")
        assert found.parameters["radius_mm"] == pytest.approx(RADIUS_MM, abs=0.05)
        judged.append(cloud.judged)
        if len(opened) == 2:
            break
    assert len(opened) == 2
    assert sum(judged) == 3
    assert said[0] == "camera: gone; waiting for the devices"
    assert said[1] == "camera: not there; waiting for the devices"
    assert said.count("the devices are back; measuring goes on") == 2
    clouds.close()
    for shown, films in opened:
        with pytest.raises(fw.DeviceProblem, match="closed"):
            films.grab()
        shown.close()


def test_live_stops_where_nobody_opens_the_camera_again():
    projector, camera = virtual_bench("sphere", clock=SimulatedClock())
    clouds = fw.live(projector, Unplugged(camera, 3), PLAN, RIG)
    with pytest.raises(fw.DeviceProblem, match="gone"):
        next(clouds)
    with pytest.raises(fw.InputError, match="retry_s: expected 0 or more, got -1"):
        next(fw.live(projector, camera, PLAN, RIG, retry_s=-1.0))
