"""Colours of merged views: no seams, whatever light, incidence and exposure each view had."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

import fringeworks as fw
from fringeworks.rig.pinhole import inverse, look_at, transform
from fringeworks.simulate import Optics, fringe_plan, look, photograph
from fringeworks.views import closed_mesh
from fringeworks.views.even_colours import even_colours
from fringeworks.views.fusion import _voxels, fuse_points
from fringeworks.views.poses import TurntableAxis, ViewPose
from fringeworks.views.surface_points import SurfacePoints
from tests.turntable import bust_on_table, on_table, turned_poses, turntable_pose
from tests.turntables import rig

VOXEL_MM = 1.5
LAMP_MM = np.array([150.0, 10.0, 20.0])


def _radius(d):
    wave = np.sin(6 * d[..., 0] + 1) * np.cos(4 * d[..., 1])
    return 40 * (1 + 0.12 * wave + 0.06 * np.sin(9 * d[..., 2]))


def _surface(d, step: float = 1e-4):
    """Places and outward normals of a bust-like body in directions d."""
    x = d * _radius(d)[..., None]

    def off(p):
        r = np.linalg.norm(p, axis=-1)
        return r - _radius(p / r[..., None])

    normal = np.stack([off(x + step * e) - off(x - step * e) for e in np.eye(3)], axis=-1)
    return x, normal / np.linalg.norm(normal, axis=-1, keepdims=True)


def albedo(x):
    """Smooth colours, and darker stripes."""
    colour = np.stack(
        (
            0.5 + 0.3 * np.sin(x[:, 0] / 6),
            0.5 + 0.3 * np.sin(x[:, 1] / 8 + 1),
            0.5 + 0.3 * np.cos(x[:, 2] / 7),
        ),
        axis=-1,
    )
    return np.where((np.floor(x[:, 1:2] / 9) % 2 == 0), 0.6, 1.0) * colour


def views_of(
    seed: int,
    *,
    count: int = 8,
    turn_deg: float = 45.0,
    points: int = 40000,
    heights: tuple[float, float] = (-0.25, -0.15),
    lamp_mm=LAMP_MM,
):
    """Views of a matt body by a lamp beside the camera, with uneven light and unequal exposure."""
    rng = np.random.default_rng(seed)
    views, poses = [], []
    for k in range(count):
        a = np.radians(turn_deg) * k
        eye = 400 * np.array([np.sin(a), heights[k % 2], -np.cos(a)])
        T = look_at(eye, np.zeros(3))
        d = rng.standard_normal((points, 3))
        x, normal = _surface(d / np.linalg.norm(d, axis=1, keepdims=True))
        to, beam = eye - x, transform(inverse(T), np.asarray(lamp_mm)) - x
        seen = np.sum(normal * to, axis=1) / np.linalg.norm(to, axis=1)
        far = np.linalg.norm(beam, axis=1)
        lit = np.sum(normal * beam, axis=1) / far
        good = (seen > 0.3) & (lit > 0.15)
        x, normal, seen, lit, far = (part[good] for part in (x, normal, seen, lit, far))
        local = transform(T, x)
        u, v = (local[:, :2] / local[:, 2:]).T
        uneven = (1 - 10.0 * ((u - 0.03) ** 2 + v**2) + 1.2 * u) * (1 + 0.25 * np.sin(2.0 * k))
        light = 150 * lit * (400 / far) ** 2 * uneven
        noise = 1 + 0.01 * rng.standard_normal((len(x), 3))
        colour = albedo(x) * light[:, None] * noise
        sigma = 0.02 / seen
        own = normal @ T[:3, :3].T
        views.append(SurfacePoints(local, own, sigma, sigma, np.zeros(len(x)), colour))
        poses.append(ViewPose(inverse(T), np.zeros((6, 6)), np.zeros((6, 6))))
    return views, poses


def places(views, poses):
    """Number of the place and of the view of every point."""
    moved = [v.moved(p.T_part_camera) for v, p in zip(views, poses, strict=True)]
    xyz, normal = (
        np.concatenate([getattr(m, name) for m in moved]) for name in ("xyz_mm", "normals")
    )
    index, _ = _voxels(xyz, normal, VOXEL_MM)
    return index, np.repeat(np.arange(len(views)), [len(v.xyz_mm) for v in views])


def seams(fused, index, of_view) -> np.ndarray:
    """Median jumps of the colour over the albedo where the set of views changes, by pair of sets."""
    points, count = fused.points, len(fused.points.xyz_mm)
    sets = np.zeros(count, np.int64)
    for k in np.unique(of_view):
        sets[np.unique(index[of_view == k])] |= 1 << int(k)
    over = points.colour.reshape(count, -1).mean(axis=1) / albedo(points.xyz_mm).mean(axis=1)
    many = np.bincount(index, minlength=count) > 4
    pairs = cKDTree(points.xyz_mm).query_pairs(1.6 * VOXEL_MM, output_type="ndarray")
    pairs = pairs[many[pairs].all(axis=1) & (sets[pairs[:, 0]] != sets[pairs[:, 1]])]
    pairs = np.where((sets[pairs[:, 0]] > sets[pairs[:, 1]])[:, None], pairs[:, ::-1], pairs)
    _, group = np.unique(sets[pairs], axis=0, return_inverse=True)
    jump = np.log(over[pairs[:, 1]] / over[pairs[:, 0]])
    number = np.bincount(group.ravel())
    return np.array([abs(np.median(jump[group.ravel() == i])) for i in np.flatnonzero(number > 80)])


@pytest.mark.parametrize("seed", [11, 12])
def test_eight_views_show_no_seams(seed):
    views, poses = views_of(seed)
    index, of_view = places(views, poses)
    fused = fuse_points(views, poses, voxel_mm=VOXEL_MM)
    found = seams(fused, index, of_view)
    assert len(found) > 10
    assert np.quantile(found, 0.95) < 0.01
    over = fused.points.colour / albedo(fused.points.xyz_mm)
    off = np.log(over / np.median(over))
    assert np.median(np.abs(off)) < 0.02


@pytest.mark.parametrize("seed", [14, 15])
def test_a_turntable_seen_from_its_own_height_keeps_its_colours(seed):
    """Every place stays in its rows: the views hardly tell how the light changes along them."""
    views, poses = views_of(seed, heights=(0.0, 0.0), lamp_mm=(280.0, 8.0, 0.0))
    index, of_view = places(views, poses)
    fused = fuse_points(views, poses, voxel_mm=VOXEL_MM)
    assert np.quantile(seams(fused, index, of_view), 0.95) < 0.01
    over = np.log(fused.points.colour / albedo(fused.points.xyz_mm)).mean(axis=1)
    assert np.median(np.abs(over - np.median(over))) < 0.03
    slope = np.polyfit(fused.points.xyz_mm[:, 1], over, 1)[0]
    assert abs(slope * 80) < 0.06


def rings(x, seed):
    """Paint of a bust on a table: smooth, with darker rings around it; about 1 on the mean."""
    base = 0.5 + 0.2 * np.sin(x[..., 0] / 11 + seed) + 0.2 * np.cos(x[..., 2] / 13)
    return np.where(np.floor((x[..., 2] + seed) / 9) % 3 == 0, 0.25, base)


@pytest.mark.parametrize("seed", [5, 18])
def test_a_turntable_seen_from_above_keeps_its_colours(seed):
    """The head is nearer to the camera and the lamp in every view: the law of distance tells by how
    much."""
    T, plan, clouds = turntable_pose(elevation_deg=35.0), fringe_plan(rig(), both=False), []
    poses = turned_poses(T, [45.0 * k for k in range(8)])
    for k, pose in enumerate(poses):
        view = look(rig(), on_table(bust_on_table(), pose))
        paint = rings(transform(inverse(pose), np.nan_to_num(view.points_mm)), seed)
        painted = replace(view, albedo=view.albedo * paint)
        optics = Optics(exposure=1.0 - 0.04 * k, noise=0.7, ambient=0.01, seed=100 * seed + k)
        frames = np.stack(list(photograph(painted, plan, optics)))
        clouds.append(fw.measure(fw.Stack(frames, plan), rig()).points)
    axis = TurntableAxis(T[:3, 3], T[:3, 2], np.diag([1e-6] * 3 + [1e-2] * 3), 0.05, 0.02)
    merged = fw.merge(clouds, poses="turntable", step_deg=45.0, axis=axis)
    first = transform(inverse(merged.poses[0].T_part_camera), merged.points.xyz_mm)
    place = transform(inverse(poses[0]), first)
    over = np.log(np.ravel(merged.points.colour) / rings(place, seed))
    off = np.abs(over - np.median(over))
    assert np.median(off) < 0.03
    kept = off < 0.3
    slope = np.polyfit(place[kept, 2], over[kept], 1)[0]
    assert abs(slope) * np.ptp(place[:, 2]) < 0.1


def test_seams_stay_away_in_brightness_and_under_a_bent_response():
    views, poses = views_of(13)
    grey = [replace(v, colour=v.colour.mean(axis=1)) for v in views]
    index, of_view = places(views, poses)
    fused = fuse_points(grey, poses, voxel_mm=VOXEL_MM)
    assert fused.points.colour.ndim == 1
    assert np.quantile(seams(fused, index, of_view), 0.95) < 0.01
    bent = [replace(v, colour=150 * (v.colour / 150) ** 0.45) for v in views]
    factor = even_colours(bent, index)
    level = np.log(np.concatenate([v.colour.mean(axis=1) for v in bent]) * factor)
    placed = [transform(p.T_part_camera, v.xyz_mm) for v, p in zip(bent, poses, strict=True)]
    light = level - 0.45 * np.log(albedo(np.concatenate(placed)).mean(axis=1))
    means = [light[of_view == k].mean() for k in range(len(views))]
    assert np.ptp(means) < 0.05


def test_a_closed_mesh_has_the_colours_of_one_light():
    views, poses = views_of(14)
    fused = fuse_points(views, poses, voxel_mm=VOXEL_MM)
    mesh = closed_mesh(fused.points, cell_mm=2.0)
    known = np.isfinite(mesh.sigma_mm)
    over = mesh.colour[known].mean(axis=1) / albedo(mesh.vertices_mm[known]).mean(axis=1)
    assert np.median(np.abs(np.log(over / np.median(over)))) < 0.03


def test_views_that_share_little_are_not_made_worse():
    views, poses = views_of(15, count=2, turn_deg=70.0)
    index, _ = places(views, poses)
    factor = even_colours(views, index)
    truth = albedo(
        np.concatenate(
            [transform(p.T_part_camera, v.xyz_mm) for v, p in zip(views, poses, strict=True)]
        )
    ).mean(axis=1)
    seen = np.concatenate([v.colour.mean(axis=1) for v in views])
    before, after = (np.std(np.log(one / truth)) for one in (seen, seen * factor))
    assert after < 0.5 * before
    apart, other = views_of(16, count=2, turn_deg=180.0)
    assert even_colours(apart, places(apart, other)[0]) is None
    plain = [replace(views[0], colour=None), views[1]]
    assert fuse_points(plain, poses, voxel_mm=VOXEL_MM).points.colour is None
