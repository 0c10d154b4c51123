"""A projector from the points of calibrated cameras: parameters within σ, refusals, the command."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.rig.calibration.from_points import (
    _moved,
    _points_of,
    calibrated_projector,
    lit_points,
)
from fringeworks.rig.calibration.parameters import pose_change
from fringeworks.rig.pinhole import project, rays, transform
from tests.commands import run
from tests.two_cameras import alone, captures, plan_of, rig_of_two, scene_of

SIGMAS = np.array([0.15, 0.15, 0.3, 0.3, 3e-4, 3e-3, 5e-5, 5e-5, 0.0])
"""Standard deviations of a camera's parameters, as a board in ten poses leaves them."""
SIGMA = np.concatenate((SIGMAS, SIGMAS, [5e-5] * 3, [0.02] * 3))


def erring(true, rng):
    """The cameras of a rig with errors, and the covariance that these were drawn from."""
    found = _moved(alone(true), rng.standard_normal(24) * SIGMA)
    return replace(found, covariance=np.diag(SIGMA**2), residual_px=(0.1, 0.1))


def surface(shape, seed):
    """Depth of a smooth, deep scene, (h, w), mm."""
    v, u = np.mgrid[: shape[0], : shape[1]] / max(shape)
    return 500.0 + 40.0 * np.sin(5.0 * u + seed) * np.cos(4.0 * v) + 60.0 * (u - 0.4) * np.cos(seed)


def seen_by(rig, true, depth, rng, noise_px=0.03):
    """What the first camera of a rig that may be wrong measures of true pixels and matches."""
    v, u = np.nonzero(np.isfinite(depth))
    pixels = np.stack((u, v), axis=-1).astype(float)
    points = rays(true.cameras[0], pixels) * depth[v, u, None]
    match = project(true.cameras[1], transform(true.T_camera_first[1], points))
    every, one = np.ones((len(u), 1)), [(1, points)]
    for _ in range(3):
        xyz = _points_of(rig, one, [match], every, pixels)
        one = [(1, xyz)]
    lit = project(true.projector, transform(true.T_projector_camera, points))
    lit += noise_px * rng.standard_normal(lit.shape)
    shape = depth.shape
    cloud = SimpleNamespace(
        xyz_mm=xyz.reshape(*shape, 3),
        reason=np.zeros(shape, np.uint8),
        sigma_mm=np.full(shape, 1e-3),
        noise_mm=np.full(shape, 1e-3),
    )
    camera = SimpleNamespace(
        points=cloud, devices=(1,), pairs=(cloud,), weights=np.ones((*shape, 1), np.float32)
    )
    maps = [
        SimpleNamespace(
            coordinate_px=lit[:, k].reshape(shape),
            sigma_px=np.full(shape, noise_px),
            reason=np.zeros(shape, np.uint8),
        )
        for k in (0, 1)
    ]
    return camera, SimpleNamespace(x=maps[0], y=maps[1])


def size_of(rig):
    return rig.projector.width_px, rig.projector.height_px


def chi_square(found, true):
    """χ² of the 15 parameters of the projector, by their covariance."""
    error = np.concatenate(
        (
            found.projector.parameters - true.projector.parameters,
            pose_change(found.T_projector_camera, true.T_projector_camera),
        )
    )
    covariance = found.covariance[9:24, 9:24]
    sigma = np.sqrt(np.diag(covariance))
    z = error / sigma
    return z @ np.linalg.solve(covariance / np.outer(sigma, sigma), z)


def test_parameters_lie_within_their_sigma_where_cameras_err():
    true, found = rig_of_two(0.2), []
    for seed in range(8):
        rng = np.random.default_rng(900 + seed)
        rig = erring(true, rng)
        scenes = [
            lit_points(rig, *seen_by(rig, true, surface(true.cameras[0].shape, seed + k), rng))
            for k in (0, 4)
        ]
        rig = calibrated_projector(rig, scenes, size_of(true), 5)
        assert rig.residual_px[-1] == pytest.approx(0.03 * 2**0.5, rel=0.1)
        found.append(chi_square(rig, true))
    # The noise is raised beyond what these errors need; 8 × 15 degrees of freedom.
    assert 0.3 * 120 < sum(found) < 1.4 * 120


def test_points_with_the_calibrated_projector_agree_with_those_of_the_cameras():
    """The covariance ties cameras and projector: a pair of both is as good as the cameras."""
    true, rng = rig_of_two(0.2), np.random.default_rng(17)
    rig = erring(true, rng)
    scene = lit_points(rig, *seen_by(rig, true, surface(true.cameras[0].shape, 1), rng))
    found = calibrated_projector(rig, [scene], size_of(true), 5)
    seen = project(found.projector, transform(found.T_projector_camera, scene.xyz_mm))
    assert np.sqrt(np.mean((seen - scene.lit_px) ** 2)) < 0.033
    pair = fw.rig.camera_pair(found, 0)
    assert np.linalg.eigvalsh(pair.covariance).min() > -1e-9


def test_what_does_not_determine_a_projector_is_refused():
    true, rng = rig_of_two(0.2), np.random.default_rng(3)
    rig, shape = erring(true, rng), true.cameras[0].shape
    places = np.stack(np.mgrid[: shape[0], : shape[1]][::-1], axis=-1).astype(float)
    ray = rays(true.cameras[0], places)
    flat = 500.0 / (1.0 + 0.3 * ray[..., 0])
    plane = lit_points(rig, *seen_by(rig, true, flat, rng))
    with pytest.raises(fw.InputError, match="at several depths, got those of a plane"):
        calibrated_projector(rig, [plane], size_of(true), 5)
    camera, decoded = seen_by(rig, true, surface(shape, 1), rng)
    camera.points.reason[:, 1:], camera.points.reason[100:] = 1, 1
    with pytest.raises(fw.InputError, match="expected 200 or more that the projector lights"):
        calibrated_projector(rig, [lit_points(rig, camera, decoded)], size_of(true), 5)
    with pytest.raises(fw.InputError, match="codes along x and y"):
        lit_points(rig, camera, SimpleNamespace(x=decoded.x, y=None))
    with pytest.raises(fw.InputError, match="whose projector only codes"):
        fw.rig.calibrate_projector([[]], true)
    with pytest.raises(fw.InputError, match="expected one scene or more"):
        fw.rig.calibrate_projector([], rig)
    with pytest.raises(fw.InputError, match="expected 0, 2, 4 or 5"):
        fw.rig.calibrate_projector([[]], rig, distortion=3)
    with pytest.raises(fw.InputError, match="scene 1: stacks: expected one for each"):
        fw.rig.calibrate_projector([[]], rig)


@pytest.mark.statistical
def test_captures_calibrate_a_projector_by_the_command(tmp_path):
    """Ray-cast scenes of a sheet, a ball and two tubes at three distances, by erring cameras."""
    true = rig_of_two(0.2)
    rig = erring(true, np.random.default_rng(41))
    fw.files.write_multi_rig(tmp_path / "cameras.toml", rig)
    for k in range(3):
        bodies, T = scene_of(410 + k), np.eye(4)
        T[2, 3] = (0.0, -30.0, -90.0)[k]
        bodies[0] = replace(bodies[0], pose=bodies[0].pose @ T)
        stacks, _ = captures(true, bodies, plan_of(true, "both"), seed=410 + k)
        for name, stack in zip(("left", "right"), stacks, strict=True):
            fw.write(tmp_path / name / f"scene{k}", stack)
    out = tmp_path / "rig.toml"
    rig_file = ("--rig", tmp_path / "cameras.toml")
    done = run("rig", "projector", tmp_path / "left", tmp_path / "right", *rig_file, "--out", out)
    assert "residual of its coordinates: 0.0" in done.stdout
    found = fw.files.read_multi_rig(out)
    assert found.provenance.call == "calibrate_projector"
    frames = [one for one in found.provenance.inputs if one.name.endswith(".png")]
    assert len(frames) == 6 * plan_of(true, "both").frames
    # 99.9 % of χ² with 15 degrees of freedom are below 37.7.
    assert chi_square(found, true) < 37.7
    (tmp_path / "right" / "scene2").rename(tmp_path / "right" / "other")
    done = run(
        *("rig", "projector", tmp_path / "left", tmp_path / "right", *rig_file, "--out", out),
        code=2,
    )
    assert "expected the scenes scene0, scene1, scene2" in done.stderr
