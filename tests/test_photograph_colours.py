"""Colour of points from photographs: of a separate camera, and of the same one under white light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.files.texture import as_srgb
from fringeworks.rig.pinhole import inverse, look_at, pose, project, rotation, transform
from fringeworks.simulate import bust, look, standard_rig
from fringeworks.types import Pinhole, Rig
from fringeworks.types.multi_rig import MultiRig, multi_rig_parameters

FIRST = standard_rig(scale=0.2)
DISTORTION = (-0.08, 0.05, 0.0005, -0.0003, 0.0)
CAMERA = Pinhole(400, 320, (620.0, 618.0), (203.0, 157.0), DISTORTION)
PLACE = look_at(np.array([130.0, -60.0, 30.0]), np.array([0.0, 0.0, 500.0]))
"""From the coordinates of the first camera to those of the colour camera."""


def albedo(xyz):
    """Paint as a function of the place, (…, 3), which varies within a few pixels."""
    x, y, z = np.moveaxis(np.nan_to_num(xyz), -1, 0)
    waves = (np.sin(x / 9 + 1), np.cos(y / 7), np.sin((x + z) / 11))
    return 0.55 + 0.35 * np.stack(waves, axis=-1)


def rig_of(camera=CAMERA, T=PLACE, covariance=None):
    return MultiRig((FIRST.camera, camera), None, None, np.stack((np.eye(4), T)), covariance)


def seen_by_both():
    """Points of a bust by the first camera, what the colour camera sees, and the points there."""
    view = look(FIRST, bust())
    reason = np.where(view.lit, 0, 1).astype(np.uint8)
    xyz = np.where(view.lit[..., None], view.points_mm, np.nan).astype(np.float32)
    sigma = np.where(view.lit, 0.02, np.nan).astype(np.float32)
    other = Rig(CAMERA, FIRST.projector, FIRST.T_projector_camera @ inverse(PLACE))
    there = look(other, bust(), T_camera_world=PLACE)
    world = transform(inverse(PLACE), np.nan_to_num(there.points_mm))
    photograph = 200.0 * albedo(world) * (there.body >= 0)[..., None]
    return fw.PointCloud(xyz, sigma, sigma, reason), photograph, there


def visible(cloud, there):
    """Points that the colour camera sees, and those that it certainly does not."""
    ok = cloud.reason == 0
    local = transform(PLACE, np.nan_to_num(cloud.xyz_mm.astype(float)))
    place = np.rint(np.nan_to_num(project(CAMERA, local), nan=-9)).astype(int)
    inside = (
        ok & (place >= 1).all(-1) & (place < (CAMERA.width_px - 1, CAMERA.height_px - 1)).all(-1)
    )
    column, row = np.where(inside[..., None], place, 1).transpose(2, 0, 1)
    depth = np.nan_to_num(there.points_mm[..., 2], nan=1e9)
    around = [depth[row + i, column + j] for i in (-1, 0, 1) for j in (-1, 0, 1)]
    behind = local[..., 2] - np.max(around, axis=0)
    return inside & (np.abs(local[..., 2] - np.median(around, axis=0)) < 1.0), inside & (
        behind > 15
    )


def test_a_separate_camera_gives_its_colour():
    cloud, photograph, there = seen_by_both()
    taken = np.rint(photograph).astype(np.uint8)
    found = fw.views.colour_by_photograph(cloud, taken, rig_of())
    assert np.array_equal(found.xyz_mm, cloud.xyz_mm, equal_nan=True)
    seen, hidden = visible(cloud, there)
    assert hidden.sum() > 50
    known = np.isfinite(found.colour).all(axis=-1)
    assert known[seen].mean() > 0.99
    assert known[hidden].mean() < 0.03
    off = (
        found.colour[seen & known] / (200.0 * albedo(cloud.xyz_mm.astype(float))[seen & known]) - 1
    )
    assert np.median(np.abs(off)) < 0.01
    assert np.mean(np.abs(off) < 0.05) > 0.97
    finding = found.findings[-1]
    assert finding.kind == "photograph"
    assert finding.figures["points without colour"] == np.sum((cloud.reason == 0) & ~known)
    assert "place / px" not in finding.figures


@pytest.mark.parametrize("seed", [3, 4])
def test_the_error_of_places_is_that_of_the_rig(seed):
    """Against photographs' cameras that differ as the covariance says."""
    cloud, photograph, _ = seen_by_both()
    names = multi_rig_parameters(2, projector=False)
    sizes = {"fx": 0.8, "fy": 0.8, "cx": 0.6, "cy": 0.6, "rotation": 6e-4, "translation": 0.1}
    sigma = np.array([next((v for k, v in sizes.items() if k in n), 1e-3) for n in names])
    said = fw.views.colour_by_photograph(cloud, photograph, rig_of(covariance=np.diag(sigma**2)))
    stated = said.findings[-1].figures["place / px"]
    rng = np.random.default_rng(seed)
    ok = cloud.reason == 0
    xyz = cloud.xyz_mm[ok].astype(float)[::50]
    right = project(CAMERA, transform(PLACE, xyz))
    squares = []
    for _ in range(200):
        d = sigma[9:] * rng.standard_normal(15)
        camera = replace(
            CAMERA,
            focal_px=(CAMERA.focal_px[0] + d[0], CAMERA.focal_px[1] + d[1]),
            principal_px=(CAMERA.principal_px[0] + d[2], CAMERA.principal_px[1] + d[3]),
            distortion=tuple(np.array(DISTORTION) + d[4:9]),
        )
        T = pose(rotation(d[9:12]) @ PLACE[:3, :3], PLACE[:3, 3] + d[12:])
        ray = xyz / np.linalg.norm(xyz, axis=1, keepdims=True)
        noisy = xyz + 0.02 * rng.standard_normal((len(xyz), 1)) * ray
        squares.append(np.sum((project(camera, transform(T, noisy)) - right) ** 2, axis=1))
    assert stated == pytest.approx(np.sqrt(np.median(np.mean(squares, axis=0))), rel=0.1)


def test_white_light_after_the_scan_and_files(tmp_path):
    cloud, _, _ = seen_by_both()
    true = albedo(cloud.xyz_mm.astype(float))
    light = fw.views.colour_by_photograph(cloud, (200 * true).astype(np.float32))
    counts = fw.views.colour_by_photograph(cloud, as_srgb(true), srgb=True)
    ok = cloud.reason == 0
    np.testing.assert_allclose(light.colour[ok], 200 * true[ok], rtol=1e-5)
    np.testing.assert_allclose(counts.colour[ok] / 255, true[ok], rtol=0.02)
    part = replace(
        light, colour=np.where(np.arange(ok.shape[1])[:, None] < 90, np.nan, light.colour)
    )
    for name in ("a.ply", "a.glb", "a.csv", "a.npz", "a.e57", "a.las"):
        thing = fw.surface.cloud_mesh(part) if name == "a.glb" else part
        assert fw.write(tmp_path / name, thing).stat().st_size > 1000


def test_photographs_that_do_not_fit_are_refused():
    cloud, photograph, _ = seen_by_both()
    for arguments, words in (
        ((cloud, photograph), "expected the size of the points' camera"),
        ((cloud, photograph[:-1], rig_of()), "the size of camera 2 of the rig"),
        ((cloud, photograph[..., 0], rig_of()), "expected colours"),
        ((cloud, np.ma.array(photograph, mask=photograph > 100), rig_of()), "mask"),
    ):
        with pytest.raises(fw.InputError, match=words):
            fw.views.colour_by_photograph(*arguments)
    with pytest.raises(fw.InputError, match="camera: expected 1 to 2, got 3"):
        fw.views.colour_by_photograph(cloud, photograph, rig_of(), camera=3)
    with pytest.raises(fw.InputError, match="srgb: expected unsigned counts"):
        fw.views.colour_by_photograph(cloud, photograph, rig_of(), srgb=True)


def test_a_photograph_that_shows_nothing_is_said():
    cloud, photograph, _ = seen_by_both()
    away = look_at(np.array([130.0, -60.0, 30.0]), np.array([900.0, 0.0, 30.0]))
    found = fw.views.colour_by_photograph(cloud, photograph, rig_of(T=away))
    assert not np.isfinite(found.colour).any()
    assert found.findings[-1].severity == "warning"
