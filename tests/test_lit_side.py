"""Frames whose surfaces the projector would have to light from behind."""

from dataclasses import replace

import pytest

import fringeworks as fw
from fringeworks.simulate.bodies import Plane, Sphere
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import standard_rig
from fringeworks.simulate.virtual_rig import look
from tests import rigs

RIG = standard_rig(scale=0.25)
SCENES = {
    "ball": [rigs.ahead(Sphere(45.0), 5, 3)],
    "plane": [rigs.ahead(Plane(150, 120), turn=(0.25, -0.3, 0.1))],
}


@pytest.fixture(scope="module", params=SCENES)
def taken(request):
    plan = fw.simulate.fringe_plan(RIG, both=False)
    view = look(RIG, SCENES[request.param])
    return plan, list(photograph(view, plan, Optics(seed=4, noise=4.0)))


@pytest.mark.parametrize("turned", [False, True])
def test_frames_of_a_mirrored_camera_along_one_axis_are_refused(taken, turned):
    plan, frames = taken
    mirrored = [f[:: -1 if turned else 1, ::-1] for f in frames]
    with pytest.raises(fw.RigMismatch, match="from behind: .* mirrored camera"):
        fw.measure(fw.Stack(mirrored, plan), RIG)
    assert (fw.measure(fw.Stack(frames, plan), RIG).points.reason == 0).sum() > 5000


def test_a_projector_that_mirrors_is_refused_unless_the_plan_says_it(taken):
    plan, _ = taken
    view = look(RIG, SCENES["ball"])
    said = replace(plan, mirrored=("x",))
    frames = list(photograph(view, said, Optics(seed=5)))
    assert (fw.measure(fw.Stack(frames, said), RIG).points.reason == 0).sum() > 5000
    with pytest.raises(fw.InputError):
        fw.measure(fw.Stack(frames, plan), RIG)
