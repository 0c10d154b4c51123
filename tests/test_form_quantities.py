"""Parallelism, angle and roundness of areas: true values, and σ over noise and calibrations."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.evaluate.area_points import area_points
from fringeworks.evaluate.quantities import MEASURED
from fringeworks.rig.pinhole import pose, rotation
from fringeworks.simulate.bodies import Body, Box, Cylinder, Plane
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look
from tests import parts

pytestmark = pytest.mark.statistical

ANGLE_DEG = 20.0
"""Tilt of the plate against the base."""
KEYS = (
    ("step_height", "top", "base"),
    ("distance", "top", "plate"),
    ("angle", "plate", "base"),
    ("flatness", "base"),
    ("parallelism", "top", "base"),
    ("roundness", "tube"),
)


@cache
def scene():
    """A block of 10 mm, a tilted plate and a cylinder on a plane; frames of 384 × 307 px."""
    rig = standard_rig(scale=0.3)
    lying = pose(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), np.array([-15.0, 48.0, 520.0]))
    tilted = pose(rotation(np.radians([0.0, ANGLE_DEG, 0.0])), np.array([55.0, 0.0, 500.0]))
    bodies = [
        Body(Plane(), pose(np.eye(3), np.array([0.0, 0.0, 520.0])), 0.7),
        Body(Box((40.0, 40.0, 10.0)), pose(np.eye(3), np.array([0.0, 0.0, 515.0])), 0.8),
        Body(Box((40.0, 40.0, 2.0)), tilted, 0.8),
        Body(Cylinder(15.0, 60.0), lying, 0.8),
    ]
    view = look(rig, bodies)
    return rig, fringe_plan(rig, both=False), view, areas(view.points_mm)


def areas(xyz):
    """Areas by where their points lie."""
    x, y, z = np.moveaxis(np.nan_to_num(xyz), -1, 0)
    flat = np.abs(z - 510.0) < 1e-6
    # The axis of the cylinder is y = 48, z = 520; its ends are at x = -45 and 15.
    tube = (np.abs(np.hypot(y - 48.0, z - 520.0) - 15.0) < 1e-6) & (np.abs(y - 48.0) < 11.0)
    plate = (
        np.abs(
            (x - 55.0) * np.sin(np.radians(ANGLE_DEG))
            + (z - 500.0) * np.cos(np.radians(ANGLE_DEG))
            + 1.0
        )
        < 1e-6
    )
    return {
        "top": fw.evaluate.Area(mask=flat & (np.abs(x) < 17) & (np.abs(y) < 17)),
        "base": fw.evaluate.Area(mask=(np.abs(z - 520.0) < 1e-6) & (x < -45) & (x > -80)),
        "plate": fw.evaluate.Area(mask=plate & (np.abs(x - 55) < 15) & (np.abs(y) < 17)),
        "tube": fw.evaluate.Area(mask=tube & (x > -42) & (x < 12)),
    }


@cache
def covariance():
    """Covariance of a usual calibration from boards; all parameters are correlated."""
    sigma = np.array(
        [0.15, 0.15, 0.1, 0.1, 2e-4, 2e-3, 2e-5, 2e-5, 0.0] * 2 + [1e-4] * 3 + [0.05, 0.05, 0.1]
    )
    mixing = np.random.default_rng(1).normal(size=(24, 24))
    correlation = mixing @ mixing.T + 6.0 * np.eye(24)
    scale = sigma / np.sqrt(np.diag(correlation))
    return scale[:, None] * correlation * scale


def true_value(key):
    """Of exactly the pixels that were measured, where it depends on them."""
    _, _, view, known = scene()
    middle = {n: view.points_mm[known[n].mask].mean(axis=0) for n in ("top", "plate")}
    return {
        "step_height": 10.0,
        "distance": float(np.linalg.norm(middle["top"] - middle["plate"])),
        "angle": ANGLE_DEG,
    }.get(key[0], 0.0)


@cache
def found(seed):
    """All quantities, measured with noise and a calibration of this number."""
    rig, plan, view, known = scene()
    frames = list(photograph(view, plan, Optics(noise=2.0, seed=seed)))
    used = parts.drawn(seed, rig, covariance())
    cloud = fw.triangulate(fw.decode(frames, plan), used)
    return {
        key: MEASURED[key[0]](*(area_points(cloud, known[n], used) for n in key[1:]))
        for key in KEYS
    }


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
def test_quantities_have_their_true_value(seed):
    for key, one in found(seed).items():
        assert abs(one.value - true_value(key)) <= 3.5 * one.sigma, key


@pytest.mark.long
@pytest.mark.parametrize("key", KEYS, ids=lambda key: key[0])
def test_sigma_covers_noise_and_calibration(key):
    """Twenty-four pairs of noise and calibration: errors over σ have a scatter of 1."""
    every = [found(seed)[key] for seed in range(24)]
    off = [one.value - true_value(key) for one in every]
    over = np.abs(np.array(off)) / [one.sigma for one in every]
    if key[0] in ("step_height", "distance", "angle"):
        # 24 values know their scatter to 14 %.
        assert 0.6 < np.sqrt(np.mean(over**2)) < 1.4
    assert np.mean(over < 2.0) >= 0.83


def test_parallel_planes_have_no_angle():
    """An angle of 0 cannot be measured below 0: noise raises it, and that is said."""
    rig, plan, view, known = scene()
    frames = list(photograph(view, plan, Optics(noise=2.0, seed=3)))
    cloud = fw.triangulate(fw.decode(frames, plan), rig)
    one = MEASURED["angle"](*(area_points(cloud, known[n]) for n in ("top", "base")))
    assert one.unit == "°"
    assert one.value <= 2.0 * one.sigma
    assert one.seen < 0.1


def test_a_tilted_block_is_not_parallel():
    _, _, view, known = scene()
    shape = view.points_mm.shape[:2]
    rng = np.random.default_rng(0)
    noise = rng.normal(0.0, 0.01, shape)
    xyz = np.nan_to_num(view.points_mm)
    ray = xyz / np.linalg.norm(xyz, axis=-1, keepdims=True)
    moved = xyz + noise[..., None] * ray
    top = known["top"].mask
    moved[top, 2] += 0.01 * (xyz[top, 0] - xyz[top, 0].min())
    some = np.full(shape, 0.01, np.float32)
    cloud = fw.PointCloud(moved.astype(np.float32), some, some, np.zeros(shape, np.uint8))
    one = MEASURED["parallelism"](*(area_points(cloud, known[n]) for n in ("top", "base")))
    assert one.value == pytest.approx(0.01 * np.ptp(xyz[top, 0]), rel=0.08)
    flat = MEASURED["flatness"](area_points(cloud, known["top"]))
    assert flat.value < 0.05


def test_an_oval_tube_is_not_round():
    """Radius 15 mm ± 0.1 mm, three lobes: the part in view holds more than one of them."""
    _, _, view, known = scene()
    tube = known["tube"].mask
    xyz = np.nan_to_num(view.points_mm)
    across = xyz[tube][:, 1:] - (48.0, 520.0)
    turn = np.arctan2(across[:, 0], -across[:, 1])
    radius = 15.0 + 0.1 * np.cos(6.0 * turn)
    xyz[tube, 1:] = (48.0, 520.0) + across / 15.0 * radius[:, None]
    some = np.full(tube.shape, 1e-4, np.float32)
    cloud = fw.PointCloud(xyz.astype(np.float32), some, some, np.zeros(tube.shape, np.uint8))
    one = MEASURED["roundness"](area_points(cloud, known["tube"]))
    assert one.value == pytest.approx(0.2, rel=0.15)


@pytest.mark.parametrize(("limit", "verdict"), [(0.23, "fail"), (0.28, "pass")])
def test_a_plainly_bent_face_is_decided(limit, verdict):
    """A bow of 0.3 mm, of which 0.26 mm are flatness without the farthest 0.3 %."""
    y, x = np.mgrid[:100, :100] * 0.3
    u = x / x.max() * 2.0 - 1.0
    z = 500.0 + 0.3 * u * u + np.random.default_rng(8).normal(0.0, 0.02, x.shape)
    xyz = np.stack((x - 15.0, y - 15.0, z), -1).astype(np.float32)
    sigma = np.full(x.shape, 0.02, np.float32)
    cloud = fw.PointCloud(xyz, sigma, sigma, np.zeros(x.shape, np.uint8))
    area = fw.evaluate.Area(box=(3, 3, 96, 96))
    flat = fw.evaluate.PartTolerance("flat", "flatness", ("face",), None, limit)
    (check,) = fw.evaluate.judge_part(cloud, fw.Recipe(areas={"face": area}, tolerances=(flat,)))
    inner = 0.3 * u[3:97, 3:97] ** 2
    assert check.verdict == verdict
    assert check.value == pytest.approx(np.ptp(inner), abs=0.01)
    assert check.sigma < 0.003
