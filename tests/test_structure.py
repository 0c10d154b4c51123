"""Errors of devices that depend on the place in the frame, in the residuals of a calibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fringeworks.rig.calibration.bundle import adjust
from fringeworks.rig.calibration.diagnosis import diagnose
from fringeworks.rig.calibration.structure import structures_px
from fringeworks.simulate.standard import board_poses
from tests.rigs import board, calibrated, rig, sighting

pytestmark = pytest.mark.statistical


def structures(seed, bend_px=0.0, periods=4.0, poses=8):
    """What a calibration finds whose projector's columns are off by a sine."""
    rng = np.random.default_rng(seed)
    real = board().points_mm + rng.normal(0, 0.02, board().points_mm.shape)
    places, seen = board_poses(board(), poses, seed=seed), []
    for T in places:
        s = sighting(rig(), board(), T, rng, corner=0.015, phase=0.008, real_mm=real)
        moved = s.projector_px.copy()
        phase = 2 * np.pi * periods * moved[:, 0] / rig().projector.width_px
        moved[:, 0] += bend_px * np.sin(phase + seed)
        seen.append(replace(s, projector_px=moved))
    return structures_px(seen, adjust(seen, rig(), places))


@pytest.mark.parametrize("bend_px", [0.075, 0.025])
def test_a_projector_that_the_lens_model_does_not_hold_is_found(bend_px):
    camera, projector = structures(0, bend_px)
    assert camera == 0.0
    # A sine along one of two axes; the lens model and the poses take up a part.
    assert 0.5 * bend_px / 2.0 < projector < bend_px / 2.0


@pytest.mark.parametrize("seeds", [4, pytest.param(60, marks=pytest.mark.long)])
def test_noise_and_print_are_no_structure(seeds):
    assert all(structures(seed) == (0.0, 0.0) for seed in range(10, 10 + seeds))


def test_structure_is_reported():
    good = calibrated()
    assert good.structure_px == (0.0, 0.0)
    assert "structure" not in {f.kind for f in diagnose(good)}
    (found,) = (
        f for f in diagnose(replace(good, structure_px=(0.0, 0.04))) if f.kind == "structure"
    )
    assert "the projector has errors of 0.040 px that depend on the place" in found.text
    assert found.figures["structure_px"] == 0.04
