"""Cameras under a projector that only codes: matches, σ, calibration without it, wrong rigs."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import fringeworks as fw
from fringeworks.patterns import GrayCode, Uniform
from fringeworks.rig import camera_pair
from fringeworks.rig.calibration.parameters import pose_change
from fringeworks.rig.device_pairs import pair_by_parameters
from fringeworks.rig.light_sheets import LightSheets
from fringeworks.rig.pinhole import inverse, project, transform
from fringeworks.rig.stereo_match import CoordinateField
from fringeworks.types import CameraNoise, CoordinateMap, Decoded, Reason, RigMismatch
from tests.commands import run
from tests.two_cameras import (
    BOARD,
    alone,
    captures,
    errors_mm,
    plan_of,
    rig_of_two,
    scene_of,
    write_boards,
)

pytestmark = pytest.mark.statistical


def coded(q, sigma: float = 0.01, axis: str = "x") -> CoordinateMap:
    q = np.asarray(q, np.float32)
    known = np.isfinite(q)
    light = np.full(q.shape, 100.0, np.float32)
    reason = np.where(known, Reason.OK, Reason.SHADOW).astype(np.uint8)
    return CoordinateMap(q, np.where(known, sigma, np.nan), light, light, reason, axis, (16.0,))


def field_of(q, sigma: float = 0.01) -> CoordinateField:
    return CoordinateField.of(Decoded(coded(q, sigma), None, CameraNoise(1.0, 0.0)), ("x",))


def test_a_pair_of_cameras_has_the_parameters_of_its_rig():
    rig = alone(rig_of_two())
    by = pair_by_parameters(rig, 0, 1)
    assert by.shape == (24, 24)
    assert np.allclose(by, np.eye(24))
    assert len(fw.rig.camera_pair(rig, 1, 0).T_projector_camera) == 4
    with pytest.raises(fw.InputError, match="calibrated projector"):
        camera_pair(rig, 0)
    with pytest.raises(fw.InputError, match="two cameras"):
        replace(rig, cameras=rig.cameras[:1], T_camera_first=rig.T_camera_first[:1])
    with pytest.raises(fw.InputError, match="together with its pose"):
        replace(rig_of_two(), T_projector_camera=None)


def test_a_rig_without_a_projector_is_read_as_it_was_written(tmp_path):
    A = np.random.default_rng(0).normal(size=(24, 24)) * np.logspace(-6, 0, 24)[:, None]
    rig = replace(alone(rig_of_two()), covariance=A @ A.T, residual_px=(0.1, 0.2))
    found = fw.files.read_multi_rig(fw.files.write_multi_rig(tmp_path / "rig.toml", rig))
    assert found.projector is None
    assert found.cameras == rig.cameras
    assert found.residual_px == rig.residual_px
    scale = np.sqrt(np.diag(rig.covariance))
    assert np.abs((found.covariance - rig.covariance) / np.outer(scale, scale)).max() < 1e-11


def test_splines_do_not_ring_beside_a_step():
    x = np.arange(80.0)
    q = np.tile(np.where(x < 40, 0.8 * x, 0.8 * x + 30.0), (60, 1))
    field = field_of(q)
    place = np.stack(np.meshgrid(np.arange(44.5, 70), np.arange(10.0, 50.0)), -1).reshape(-1, 2)
    place = place[field.usable_at(place)]
    assert (place[:, 0] < 46).any()
    assert np.abs(field.at(place)[:, 0] - 0.8 * place[:, 0] - 30.0).max() < 1e-3


def test_a_small_step_is_an_edge_and_a_crease_is_none():
    x, rng = np.arange(80.0), np.random.default_rng(0)
    noise = rng.normal(0.0, 0.01, (60, 80))
    step = field_of(0.8 * x + 1.0 * (x > 40) + noise)
    assert not step.usable[10:50, 39:42].any()
    crease = field_of(0.8 * x + 0.4 * np.maximum(x - 40, 0.0) + noise)
    assert crease.usable[10:50, 30:50].mean() > 0.98


def test_a_missing_pixel_is_no_gap():
    x, rng = np.arange(80.0), np.random.default_rng(0)
    q = 0.8 * x + rng.normal(0.0, 0.01, (60, 80))
    q[30, 40] = np.nan
    assert field_of(q).usable[25:35, 35:45].all()
    q[29:32, 39:42] = np.nan
    assert not field_of(q).usable[30, 40]


def test_sheets_of_light_follow_a_projector():
    rig, rng = rig_of_two(), np.random.default_rng(3)
    points = rng.uniform([-60, -50, 450], [60, 50, 560], (6000, 3))
    q = project(rig.projector, transform(rig.T_projector_camera, points))[:, 0]
    off = q + rng.normal(0.0, 0.05, len(q))
    off[::20] += 8.0
    found = LightSheets.fit(points, off)
    assert found.scatter_px == pytest.approx(0.05, rel=0.2)
    assert np.abs(found.at(points) - q).max() < 0.1
    assert LightSheets.fit(points[:50], q[:50]) is None


@pytest.mark.parametrize("kind", ["both", "one", "gray"])
@pytest.mark.parametrize("seed", [21, 22])
def test_points_of_codes_alone_lie_within_their_sigma(kind, seed):
    rig = rig_of_two()
    stacks, bodies = captures(rig, scene_of(seed), plan_of(rig, kind), seed=seed)
    found = fw.measure(stacks, alone(rig))
    for k, seen in enumerate(found.cameras):
        good = seen.points.reason == Reason.OK
        off = np.abs(errors_mm(seen.points, rig.cameras[k], bodies[k])[good])
        z = off / seen.points.sigma_mm[good]
        decoded = np.isfinite(found.decoded[k].maps["x"].coordinate_px)
        assert good.sum() > 0.4 * decoded.sum()
        assert 0.62 < np.mean(z < 1.0) < 0.78
        assert np.mean(z < 2.0) > 0.91
        # One pixel of a rim among 10⁴ is off; none of many.
        assert np.sum((z > 6.0) & (off > 1.0)) <= 4e-4 * good.sum() + 2
    assert len(found.points.xyz_mm) == (found.cameras[0].points.reason == Reason.OK).sum()


def test_a_wrong_rig_is_refused_or_its_misfit_is_in_sigma():
    rig = rig_of_two()
    stacks, bodies = captures(rig, scene_of(5), plan_of(rig, "both"), seed=5)
    with pytest.raises(RigMismatch, match=r"epipolar lines|frames of"):
        fw.measure(stacks[::-1], alone(rig))
    back = np.stack((np.eye(4), inverse(rig.T_camera_first[1])))
    with pytest.raises(RigMismatch, match="epipolar lines"):
        fw.measure(stacks, replace(alone(rig), T_camera_first=back))
    knocked = rig.T_camera_first.copy()
    turn = np.eye(4)
    turn[1:3, 1:3] = [[np.cos(3e-3), -np.sin(3e-3)], [np.sin(3e-3), np.cos(3e-3)]]
    knocked[1] = turn @ knocked[1]
    found = fw.measure(stacks, replace(alone(rig), T_camera_first=knocked))
    seen = found.cameras[0]
    assert 1.0 < seen.misfit_px < 2.0
    assert any("epipolar lines" in f.seen for f in found.findings)
    good = seen.points.reason == Reason.OK
    off = np.abs(errors_mm(seen.points, rig.cameras[0], bodies[0])[good])
    assert np.mean(off < 2.0 * seen.points.sigma_mm[good]) > 0.9


def test_a_gray_code_alone_is_covered_too():
    rig = rig_of_two(0.25)
    w, h = rig.projector.width_px, rig.projector.height_px
    codes = (GrayCode("x", 1.0, w, inverse=True), GrayCode("y", 1.0, h, inverse=True))
    plan = fw.PatternPlan(w, h, (Uniform("white"), Uniform("black"), *codes))
    stacks, bodies = captures(rig, scene_of(34), plan, seed=34)
    with pytest.raises(fw.InputError, match="got one Stack"):
        fw.measure(stacks[0], alone(rig))
    found = fw.measure(stacks, alone(rig))
    for k, seen in enumerate(found.cameras):
        good = seen.points.reason == Reason.OK
        off = np.abs(errors_mm(seen.points, rig.cameras[k], bodies[k])[good])
        assert np.mean(off < seen.points.sigma_mm[good]) > 0.64
        assert np.mean(off < 2.0 * seen.points.sigma_mm[good]) > 0.92


def test_codes_that_repeat_are_refused():
    from fringeworks.rig.coded_points import coded_points

    rig = alone(rig_of_two())
    q = np.tile(np.arange(256.0), (204, 1))
    decoded = [
        Decoded(replace(coded(q), repeats_px=16.0), None, CameraNoise(1.0, 0.0)) for _ in range(2)
    ]
    with pytest.raises(fw.InputError, match="repeat"):
        coded_points(rig, 0, decoded, {}, ("x",))


def test_two_cameras_are_calibrated_from_photographs(tmp_path):
    rig = rig_of_two(0.3)
    write_boards(rig, tmp_path, seed=7, poses=6)
    out = tmp_path / "rig.toml"
    done = run(
        *("calibrate", tmp_path / "left", tmp_path / "right", "--board", BOARD),
        *("--out", out, "--json", tmp_path / "rig.json"),
    )
    assert "camera 2: 6 poses" in done.stdout
    assert "projector:" not in done.stdout
    assert json.loads((tmp_path / "rig.json").read_text())["projector_rms_px"] is None
    found = fw.files.read_multi_rig(out)
    assert found.projector is None
    error = np.concatenate(
        (
            *(a.parameters - b.parameters for a, b in zip(found.cameras, rig.cameras, strict=True)),
            pose_change(found.T_camera_first[1], rig.T_camera_first[1]),
        )
    )
    sigma = np.sqrt(np.diag(found.covariance))
    free = sigma > 0
    scaled = found.covariance[np.ix_(free, free)] / np.outer(sigma[free], sigma[free])
    chi = error[free] / sigma[free]
    # 99.9 % of χ² with 22 to 24 degrees of freedom are below 52.
    assert chi @ np.linalg.solve(scaled, chi) < 52.0


def test_photographs_are_paired_by_their_names(tmp_path):
    from fringeworks.pipeline.photographs import holds_photographs, photograph_pairs

    for folder, names in {
        "a": ["left_1", "left_2", "left_10"],
        "b": ["right_1", "right_2", "right_11"],
        "c": ["left_2"],
        "d": ["front", "back"],
    }.items():
        (tmp_path / folder).mkdir()
        for name in names:
            Image.new("L", (8, 8)).save(tmp_path / folder / f"{name}.png")
    assert list(photograph_pairs(tmp_path / "a", tmp_path / "b")) == ["left_1", "left_2"]
    assert list(photograph_pairs(tmp_path / "a", tmp_path / "c")) == ["left_2"]
    with pytest.raises(fw.InputError, match="equal names"):
        photograph_pairs(tmp_path / "a", tmp_path / "d")
    assert holds_photographs(tmp_path / "a")
    (tmp_path / "a" / "pose1").mkdir()
    assert not holds_photographs(tmp_path / "a")
