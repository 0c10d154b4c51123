"""What a scene itself says about whole periods that a range of depths has told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.rig.depth_range import coordinates_at
from fringeworks.rig.pinhole import pose, rotation
from fringeworks.rig.ray_depth import inverse_depth
from fringeworks.simulate.bodies import Box, Plane, Sphere
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import standard_rig
from fringeworks.simulate.virtual_rig import look
from tests.rigs import ahead

RIG = standard_rig(scale=0.25)
LOW = replace(
    RIG,
    projector=replace(RIG.projector, height_px=90),
    T_projector_camera=pose(rotation(np.array([0.0, 0.0, 0.2])), np.zeros(3))
    @ RIG.T_projector_camera,
)
"""The same with a turned projector of 90 rows: the lower border of its light crosses the scene."""
PERIOD = 60.0
PLAN = (fw.patterns.PhaseSteps("x", PERIOD, fw.patterns.equal_steps(4)),)


def depth_off(z_mm, periods, rig=RIG):
    """Depth in the middle of the frame at which the coordinate is whole periods more."""
    middle = np.array([[0.5 * rig.camera.width_px, 0.5 * rig.camera.height_px]])
    x = coordinates_at(rig, middle, z_mm, "x")
    return float(1.0 / inverse_depth(rig, middle, x + periods * PERIOD, "x")[0])


def measured(bodies, range_mm, rig=RIG, seed=0):
    plan = fw.PatternPlan(rig.projector.width_px, rig.projector.height_px, PLAN)
    shots = fw.Stack(tuple(photograph(look(rig, bodies), plan, Optics(seed=seed))), plan)
    return fw.measure(shots, rig, depth_mm=range_mm)


def told(found):
    return [f for f in found.findings if f.kind == "whole periods"]


@pytest.mark.parametrize("periods", [-1, 1])
def test_a_body_a_period_off_is_told_with_the_depths_that_fit_as_well(periods):
    body = [ahead(Sphere(25.0), z=520)]
    there = depth_off(500.0, periods)
    found = measured(body, (there - 14.0, there + 14.0))
    z = found.points.xyz_mm[..., 2]
    assert np.nanmedian(np.abs(z - there)) < 14.0  # all of it is wrong
    (finding,) = told(found)
    assert finding.severity == "note"
    name = "farther_mm" if there < 500.0 else "nearer_mm"
    assert finding.figures[name] == pytest.approx(abs(there - 500.0), abs=6.0)
    assert "nothing but the depth range tells" in finding.text


def test_light_that_meets_two_surfaces_is_named():
    """A box whose top wraps behind the wall that it stands on."""
    top = depth_off(545.0, -1 if depth_off(545.0, -1) < 545.0 else 1)
    bodies = [ahead(Plane(), z=530), ahead(Box((60.0, 60.0, 2 * (530 - top))), z=530)]
    found = measured(bodies, (520.0, 552.0))
    hidden = [f for f in told(found) if f.severity == "warning"]
    assert len(hidden) == 1
    assert "meets two surfaces" in hidden[0].text


@pytest.mark.parametrize("periods", [-1, 1])
def test_the_border_of_the_light_tells_the_period(periods):
    body = [ahead(Plane(150.0, 160.0), z=500)]
    there = depth_off(500.0, periods, LOW)
    found = measured(body, (there - 14.0, there + 14.0), LOW)
    (finding,) = told(found)
    assert finding.severity == "error"
    assert finding.figures["periods"] == -periods
    assert finding.figures["away_mm"] == pytest.approx(500.0 - there, abs=6.0)


def test_the_border_of_the_light_confirms_the_period():
    body = [ahead(Plane(150.0, 160.0), z=500)]
    assert not told(measured(body, (486.0, 514.0), LOW))
