"""Errors of devices that depend on the place in the frame, in the residuals of a calibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fringeworks.files.rig import read_rig, write_rig
from fringeworks.rig.calibration.bundle import adjust
from fringeworks.rig.calibration.diagnosis import diagnose
from fringeworks.rig.calibration.structure import in_projector_px, structures_px
from fringeworks.rig.pinhole import project
from fringeworks.rig.point_errors import point_errors
from fringeworks.rig.ray_depth import NODES, calibration_spread, inverse_depth_by_px, main_axis
from fringeworks.simulate.standard import board_poses
from fringeworks.types import InputError, PointCloud
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
    # The lens model and the poses take up a part of the sine.
    assert 0.5 * bend_px / np.sqrt(2.0) < projector < bend_px / np.sqrt(2.0)


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


def test_points_hold_the_structure(tmp_path):
    good = calibrated().rig
    bent = replace(good, structure_px=0.05)
    path = write_rig(tmp_path / "rig.toml", bent)
    assert read_rig(path).structure_px == 0.05
    assert "structure_px" not in write_rig(tmp_path / "good.toml", good).read_text()
    spread = [2.0 ** calibration_spread(of, "x", "x")[..., 0] for of in (good, bent)]
    pixel = np.array([[320.0, 256.0]])
    w = np.array([1.0 / 500.0])
    added = (spread[1] - spread[0])[NODES[0] // 2, NODES[1] // 2]
    expected = 0.05**2 * inverse_depth_by_px(good, pixel, w, "x")[0]
    assert added == pytest.approx(expected, rel=0.2)
    with pytest.raises(InputError, match="structure_px >= 0"):
        replace(good, structure_px=-1.0)
    assert in_projector_px(good, (0.0, 0.03)) == 0.03


def test_errors_of_points_hold_the_structure():
    good = calibrated().rig
    x, y = np.meshgrid(np.linspace(-30, 30, 9), np.linspace(-30, 30, 9))
    points = np.stack((x, y, np.full_like(x, 500.0)), axis=-1).reshape(-1, 3)
    sigma = np.full((9, 9), 0.01)
    cloud = PointCloud(points.reshape(9, 9, 3), sigma, sigma, np.zeros((9, 9), np.uint8))
    before, after = (
        point_errors(of, points, cloud) for of in (good, replace(good, structure_px=0.05))
    )
    added = np.sum(after[:, 2] ** 2, axis=1) - np.sum(before[:, 2] ** 2, axis=1)
    pixel = project(good.camera, points)
    along = inverse_depth_by_px(good, pixel, 1.0 / points[:, 2], main_axis(good))
    np.testing.assert_allclose(added, 0.05**2 * along * 500.0**4, rtol=1e-9)
    # Points side by side share nearly all of it, points of opposite corners half.
    shared = after[:, 2] @ after[0, 2] - before[:, 2] @ before[0, 2]
    assert shared[1] > 0.9 * added[0]
    assert shared[-1] == pytest.approx(0.5 * added[0], rel=0.1)
