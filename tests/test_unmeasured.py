"""A large share of pixels without a result is a finding with its likely causes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fringeworks import Reason, Stack, measure
from fringeworks.simulate.bodies import Plane
from fringeworks.simulate.optics import Optics
from fringeworks.stack.unmeasured import WORDS, unmeasured
from tests.rigs import ahead, rig, scene, shoot


@pytest.mark.parametrize("reason", list(WORDS))
def test_every_reason_of_decoding_is_explained(reason):
    _, decoded = scene("plane")
    assert not unmeasured(decoded)
    codes = decoded.x.reason.copy()
    lit = np.flatnonzero(codes.ravel() != Reason.SHADOW)
    codes.ravel()[lit[: len(lit) // 4]] = reason
    (found,) = unmeasured(replace(decoded, x=replace(decoded.x, reason=codes)))
    assert found.axis == "x"
    assert found.causes
    assert found.advice
    assert found.figures["share"] == pytest.approx(0.25, abs=0.03)


def test_a_camera_that_moves_during_the_capture_is_noted():
    """A rig without stated uncertainty takes the scatter of the epipolar error, not its mean."""
    _, plan, frames = shoot([ahead(Plane(140, 100), turn=(0.2, 0.15, 0))], Optics(seed=1))
    half = len(frames) // 2
    moved = [*frames[:half], *(np.roll(f, 3, axis=0) for f in frames[half:])]
    assert not any("epipolar" in n for n in measure(Stack(tuple(frames), plan), rig()).notes)
    notes = measure(Stack(tuple(moved), plan), rig()).notes
    assert any("the epipolar error of the points is 3.4 px" in note for note in notes)


def test_saturated_pixels_are_noted():
    _, plan, frames = shoot([ahead(Plane(140, 100))], Optics(seed=1), both=False)
    bright = tuple(np.clip(1.9 * f, 0, 255).astype(np.uint8) for f in frames)
    notes = measure(Stack(bright, plan), rig()).notes
    assert any("saturated" in note and "exposure is too long" in note for note in notes)
