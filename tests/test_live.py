"""Live measurement on virtual devices, and the example."""

from __future__ import annotations

import runpy
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


def test_the_example(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(Path(__file__).parent.parent / "examples" / "live.py"))
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 5
    assert all("million points/s" in line for line in lines)
