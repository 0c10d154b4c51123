"""Closed meshes of merged points: watertight, near the truth, open about what was not measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.views import closing

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("skimage")


def ball(count=6000, radius_mm=10.0, noise_mm=0.01, lowest=-1.0, seed=0):
    """Points spread evenly over a ball, above a height (in radii)."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * k
    n = np.column_stack((np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z))
    n = n[z > lowest]
    off = noise_mm * np.random.default_rng(seed).standard_normal(len(n))
    sigma = np.full(len(n), noise_mm)
    return fw.surface.Points(
        n * (radius_mm + off)[:, None] + [5.0, -3.0, 40.0], sigma, sigma, normals=n, colour=sigma
    )


def distance(mesh, radius_mm=10.0):
    return np.linalg.norm(mesh.vertices_mm - [5.0, -3.0, 40.0], axis=1) - radius_mm


def test_a_ball_is_watertight_and_better_than_its_points():
    found = fw.views.closed_mesh(ball())
    shown = trimesh.Trimesh(found.vertices_mm, found.faces, process=False)
    assert shown.is_watertight
    assert shown.is_winding_consistent
    assert abs(shown.volume / (4 / 3 * np.pi * 1000) - 1.0) < 3e-3
    off = distance(found)
    assert not found.filled.any()
    assert abs(off.mean()) < 1e-3
    assert np.sqrt(np.mean(off**2)) < 0.01
    assert 0.7 < np.sqrt(np.mean((off / found.sigma_mm) ** 2)) < 1.3


def test_what_no_point_is_near_is_marked(tmp_path):
    found = fw.views.closed_mesh(ball(lowest=-0.7))
    path = tmp_path / "ball.stl"
    fw.files.write_mesh(path, found)
    assert trimesh.load(path).is_watertight
    low = (found.vertices_mm[:, 2] - 40.0) / 10.0 < -0.75
    assert found.filled[low].all()
    assert np.isnan(found.sigma_mm[found.filled]).all()
    assert np.isfinite(found.sigma_mm[~found.filled]).all()
    assert np.abs(distance(found)[~found.filled]).max() < 0.05


@pytest.mark.parametrize("channels", [1, 3])
def test_what_no_point_is_near_has_the_colour_of_the_nearest(tmp_path, channels):
    """A vertex without points may neither be black nor, by its σ, brighter than all."""
    points = ball(lowest=-0.7)
    height = (points.xyz_mm[:, 2] - 40.0) / 10.0
    colour = np.stack((120 + 60 * height, 100 - 40 * height, 80 + 0 * height)[:channels], axis=-1)
    points = replace(points, colour=colour[:, 0] if channels == 1 else colour)
    found = fw.views.closed_mesh(points)
    assert found.filled.any()
    seen = found.colour.reshape(-1, channels)
    assert seen.min() > 0.9 * colour.min()
    assert seen.max() < 1.01 * colour.max()
    path = tmp_path / "ball.glb"
    fw.files.write_mesh(path, found)
    (shown,) = trimesh.load(path).geometry.values()
    assert np.median(np.asarray(shown.visual.vertex_colors)[:, 0]) > 100


def test_specks_are_left_out():
    speck = ball(20, 0.5)
    one = ball()
    both = fw.surface.Points(
        np.concatenate((one.xyz_mm, speck.xyz_mm + 25.0)),
        np.concatenate((one.sigma_mm, speck.sigma_mm)),
        normals=np.concatenate((one.normals, speck.normals)),
    )
    shown = fw.views.closed_mesh(both, cell_mm=0.7)
    assert np.ptp(shown.vertices_mm, axis=0).max() < 20.5


@pytest.mark.parametrize(
    ("change", "cell_mm", "message"),
    [
        ({"normals": None}, None, "with normals and σ"),
        ({"sigma_mm": None}, None, "with normals and σ"),
        ({}, -1.0, "expected > 0"),
        ({}, 1e-3, "expected at most"),
    ],
)
def test_points_that_make_no_mesh(change, cell_mm, message):
    with pytest.raises(fw.InputError, match=message):
        fw.views.closed_mesh(replace(ball(500), **change), cell_mm=cell_mm)


@pytest.mark.parametrize(("seed", "lowest"), [(11, -1.0), (12, -0.7)])
def test_as_in_double_precision_and_all_at_once(monkeypatch, seed, lowest):
    from tests.oracles.closing import mesh_of

    points = ball(4000, lowest=lowest, seed=seed)
    vertices, sigma, faces = mesh_of(points, 0.5)
    monkeypatch.setattr(closing, "AT_ONCE", 700)
    found = fw.views.closed_mesh(points, cell_mm=0.5)
    assert np.array_equal(np.unique(faces, return_inverse=True)[1].reshape(-1, 3), found.faces)
    # Vertices are rounded to single precision at a distance of 40 mm.
    assert np.abs(found.vertices_mm - vertices).max() < 1e-4
    assert np.array_equal(np.isnan(sigma), found.filled)
    assert np.nanmax(np.abs(found.sigma_mm / sigma - 1.0)) < 1e-4
