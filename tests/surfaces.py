"""Surfaces for the tests of the viewer: a measured bust, and simple and hostile ones."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

import fringeworks as fw
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import bust, fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look
from fringeworks.types import HeightMap, PointCloud, Reason
from tests.shared import shared

HOSTILE = "</script><script>window.hacked = 1</script><img src=x onerror='window.hacked = 1'>"


@cache
def small_rig() -> fw.Rig:
    """The standard rig with a quarter of the resolution."""
    return standard_rig(scale=0.25)


@shared
def measured_bust() -> fw.Measurement:
    rig = small_rig()
    plan = fringe_plan(rig, both=False)
    frames = list(photograph(look(rig, bust()), plan, Optics(seed=1)))
    return fw.measure(fw.Stack(frames, plan), rig)


def random_cloud(seed: int, shape=(23, 31), *, on_rays: bool = True) -> fw.PointCloud:
    """Depths with steps, holes, and σ over three decades, on the rays of the small rig or not."""
    rng = np.random.default_rng(seed)
    h, w = shape
    row, column = np.indices(shape).astype(float)
    z = 400.0 + 3.0 * column + 40.0 * (row > h / 2) + rng.normal(0, 5.0, shape)
    direction = np.stack((column / w - 0.4, row / h - 0.6, np.ones(shape)), axis=-1)
    if not on_rays:
        direction[..., :2] += rng.normal(0, 0.05, (*shape, 2))
    reason = np.where(rng.random(shape) < 0.3, rng.integers(1, 12, shape), 0).astype(np.uint8)
    sigma = np.where(reason == 0, 10.0 ** rng.uniform(-3, 0, shape), np.nan).astype(np.float32)
    xyz = np.where((reason == 0)[..., None], direction * z[..., None], np.nan).astype(np.float32)
    return fw.PointCloud(xyz, sigma, 0.5 * sigma, reason)


def height_map(seed: int = 0, *, pupil=True) -> fw.HeightMap:
    rng = np.random.default_rng(seed)
    row, column = np.indices((20, 30)).astype(float)
    values = 5.0 * np.exp(-((row - 10) ** 2 + (column - 15) ** 2) / 40) + rng.normal(
        0, 0.01, (20, 30)
    )
    reason = np.where(rng.random(values.shape) < 0.1, fw.Reason.LOW_MODULATION, 0).astype(np.uint8)
    values[reason > 0] = np.nan
    sigma = np.where(reason == 0, rng.uniform(0.01, 0.05, values.shape), np.nan)
    where = (14.5, 9.5, 600.0) if pupil else None
    return fw.HeightMap(values, sigma, reason, "height", "mm", 0.25, pupil=where)


def coordinate_map() -> fw.stack.CoordinateMap:
    return measured_bust().decoded.maps["x"]


def worn(cloud: fw.PointCloud, depth_mm: float = 0.2) -> fw.PointCloud:
    """The cloud with everything farther away by a little, and other noise."""
    length = np.linalg.norm(cloud.xyz_mm, axis=-1, keepdims=True)
    noise = (
        np.random.default_rng(5).normal(0, 1, cloud.shape)[..., None] * cloud.sigma_mm[..., None]
    )
    return replace(
        cloud, xyz_mm=(cloud.xyz_mm * (1 + (depth_mm + noise) / length)).astype(np.float32)
    )


def without_values(cloud: fw.PointCloud) -> fw.PointCloud:
    """A cloud of NaN, for a mixture of reasons."""
    nothing = np.full(cloud.shape, np.nan, np.float32)
    reason = np.random.default_rng(0).integers(1, 12, cloud.shape).astype(np.uint8)
    return fw.PointCloud(np.full_like(cloud.xyz_mm, np.nan), nothing, nothing, reason)


FOCAL_PX = 60.0
"""Focal length of the tests' camera."""


def heights(values, pitch=2.0, **more):
    values = np.asarray(values, np.float32)
    reason = np.where(np.isfinite(values), Reason.OK, Reason.SHADOW).astype(np.uint8)
    sigma = np.where(np.isfinite(values), 0.01, np.nan).astype(np.float32)
    return HeightMap(values, sigma, reason, "height", "mm", pitch, **more)


def plane_cloud(normal=(0.3, -0.1, -1.0), distance=100.0, sigma=0.05, hole=None):
    """A plane n·P = −d before a camera of 41 × 31 px."""
    y, x = np.mgrid[:31, :41].astype(float)
    ray = np.stack(((x - 20) / FOCAL_PX, (y - 15) / FOCAL_PX, np.ones_like(x)), axis=-1)
    points = ray * (-distance / (ray @ np.asarray(normal)))[..., None]
    reason = np.zeros(x.shape, np.uint8)
    if hole is not None:
        reason[hole] = Reason.SHADOW
        points[hole] = np.nan
    s = np.where(reason == 0, sigma, np.nan)
    return PointCloud(points, s, s, reason)


H, W = 60, 80
"""Shape of a small cloud."""


def cloud_of(depth):
    """A cloud of a camera of 500 px focal length that sees the depths."""
    y, x = np.mgrid[:H, :W]
    rays = np.stack(((x - W / 2) / 500, (y - H / 2) / 500, np.ones((H, W))), axis=-1)
    seen = np.isfinite(depth)
    sigma = np.where(seen, 0.02, np.nan).astype(np.float32)
    reason = np.where(seen, fw.Reason.OK, fw.Reason.SHADOW).astype(np.uint8)
    return fw.PointCloud((rays * depth[..., None]).astype(np.float32), sigma, sigma / 2, reason)
