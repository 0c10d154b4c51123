"""The virtual rig before the virtual camera: the same light as in a photograph."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import InputError, PatternPlan, encode
from fringeworks.devices.clock import SimulatedClock
from fringeworks.devices.virtual_camera import CameraModel, VirtualCamera
from fringeworks.devices.virtual_projector import ProjectorModel, VirtualProjector
from fringeworks.devices.virtual_scene import RigScene
from fringeworks.patterns import PhaseSteps, equal_steps
from fringeworks.scan.frames import take_frames
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import bust, standard_rig
from fringeworks.simulate.virtual_rig import highlight, look

PLAN = PatternPlan(192, 120, (PhaseSteps("x", 16.0, equal_steps(3)),))


@pytest.fixture(scope="module")
def view():
    return look(standard_rig(scale=0.1), bust())


def test_frames_are_those_of_a_photograph(view):
    optics = Optics(exposure=0.8, ambient=0.1)
    projector = VirtualProjector(
        ProjectorModel(width_px=192, height_px=120, gamma=2.2, black=0.02), clock=SimulatedClock()
    )
    camera = VirtualCamera(RigScene(view, optics), projector, CameraModel(noise=0, shot_gain=0))
    expected = photograph(
        view, PLAN, Optics(exposure=0.8, ambient=0.1, gamma=2.2, black=0.02, noise=0)
    )
    for (_, frame), reference in zip(take_frames(projector, camera, PLAN), expected, strict=True):
        # Black is added before the projector's blur here, and after it in photographs.
        assert np.abs(frame.astype(float) - reference).max() <= 2
        assert np.mean(frame != reference) < 0.03


def test_highlights_are_where_the_surface_mirrors(view):
    lobe = highlight(view, strength=20.0)
    assert (lobe[~view.lit] == 0).all()
    lobe[view.body != 0] = 0.0  # only the head is glossy
    glossy, matt = RigScene(view, highlight=lobe), RigScene(view)
    white = np.ones((120, 192))
    added = glossy.projected(white) - matt.projected(white)
    assert added.max() > 1
    assert 0 < np.mean(added > 0.5) < 0.05
    assert np.array_equal(glossy.ambient, matt.ambient)
    picture = next(encode(PLAN)) / 255.0
    assert np.all(glossy.projected(picture) >= matt.projected(picture))


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda view: RigScene(view, Optics(gamma=2.2)), "default of gamma"),
        (lambda view: RigScene(view, highlight=np.zeros((2, 2))), "highlight: expected shape"),
        (lambda view: RigScene(view).projected(np.ones((4, 4))), "size of the view's projector"),
        (lambda view: highlight(view, strength=-1.0), "strength"),
        (lambda view: highlight(view, shininess=0.0), "shininess"),
    ],
)
def test_what_does_not_fit_is_refused(view, make, said):
    with pytest.raises(InputError, match=said):
        make(view)
