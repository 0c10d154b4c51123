"""Results as Python's own tools take them: arrays, pictures of raw frames, what to cite."""

from __future__ import annotations

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import bust, fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look


@pytest.fixture(scope="module")
def scene():
    return fw.simulate.standard_scene("parabola", size=80, fringes=8, seed=7)


def titles(figure):
    return [axes.get_title() for axes in figure.axes if axes.get_title()]


def test_surfaces_are_arrays_of_their_values(scene):
    found = fw.reconstruct(scene, "fourier")
    np.testing.assert_array_equal(np.asarray(found.surface), found.surface.values)
    assert np.asarray(found.surface) is found.surface.values
    assert not np.shares_memory(np.array(found.surface, copy=True), found.surface.values)
    assert np.asarray(found.surface, np.float64).dtype == np.float64
    displaced = found.displacement
    np.testing.assert_array_equal(np.asarray(displaced), displaced.displacement_px)
    np.testing.assert_array_equal(np.nanmax(found.surface), np.nanmax(found.surface.values))


def test_raw_frames_are_pictures(scene):
    assert titles(scene.plot()) == ["object frame", "reference frame"]
    rig = standard_rig(scale=0.1)
    plan = fringe_plan(rig, both=False)
    stack = fw.Stack(list(photograph(look(rig, bust()), plan, Optics(seed=7))), plan)
    assert len(titles(stack.plot())) == plan.frames
    assert titles(stack.plot())[0].startswith("1: x")
    cloud = fw.measure(stack, rig).points
    np.testing.assert_array_equal(np.asarray(cloud), cloud.xyz_mm)


def test_what_to_cite(scene):
    said = fw.report.cite(fw.reconstruct(scene, "fourier"))
    assert said.splitlines()[0].startswith("The fringeworks authors")
    assert "10.1364/AO.22.003977" in said
    assert len(fw.report.cite().splitlines()) == 1
    with pytest.raises(fw.InputError, match="expected one of"):
        fw.report.cite("nothing")
