"""Parts brought to their models: by datum points, by datum planes, by best fit."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.evaluate.deviation import aligned
from fringeworks.evaluate.measured_part import measured_part
from fringeworks.rig.pinhole import inverse, pose, rotation, transform
from fringeworks.surface.closest import MeshDistance, sampled
from fringeworks.views.alignment import align_points
from fringeworks.views.poses import carried, twist
from tests import parts

pytestmark = pytest.mark.statistical

SIGMA = 0.01
"""Standard deviation of made points along the normal, mm."""


@cache
def model():
    """The part with triangles of 1 mm: preparing the distances takes little time."""
    return parts.model(0.0, 1.0)


def made(seed, T, count=8000, mesh=None):
    """Points of the part with noise along its normals, in coordinates of a pose T_model_part."""
    rng = np.random.default_rng(seed)
    p, n = sampled(mesh or MeshDistance(model()), count, rng)
    kept = n[:, 2] > -0.5
    p, n = p[kept], n[kept]
    p = p + rng.normal(0.0, SIGMA, len(p))[:, None] * n
    back = inverse(T)
    sigma = np.full(len(p), SIGMA)
    return fw.surface.Points(transform(back, p), sigma, sigma, normals=n @ back[:3, :3].T)


def somewhere(seed, turn_deg=40.0):
    """A pose T_model_part with a rotation of this angle about any axis."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis *= np.radians(turn_deg) / np.linalg.norm(axis)
    return pose(rotation(axis), rng.normal(0.0, 50.0, 3))


def off_in_sigmas(alignment, truth):
    """Mean square of the error over its covariance, per direction."""
    middle = pose(np.eye(3), -np.array([40.0, 30.0, 10.0]))
    e = twist(middle @ alignment.T_model_part @ inverse(truth) @ inverse(middle))
    return float(e @ np.linalg.solve(carried(middle, alignment.covariance), e)) / 6.0


@pytest.mark.parametrize(
    "seed", [0, pytest.param(1, marks=pytest.mark.long), pytest.param(2, marks=pytest.mark.long)]
)
def test_a_part_that_is_turned_finds_its_model_without_a_start(seed):
    truth = somewhere(seed)
    found = fw.deviation(made(seed, truth), model()).alignment
    assert found.by == "best fit"
    assert found.converged
    assert found.slides == 0
    assert not found.findings
    assert off_in_sigmas(found, truth) < 4.0
    e = twist(found.T_model_part @ inverse(truth))
    assert np.degrees(np.linalg.norm(e[:3])) < 0.02


@pytest.mark.long
def test_the_covariance_of_a_best_fit_is_that_of_its_errors():
    squares = []
    for seed in range(20):
        truth = somewhere(seed, 3.0)
        align = fw.evaluate.BestFit(start=truth)
        found = fw.deviation(made(seed, truth, count=4000), model(), align=align).alignment
        squares.append(off_in_sigmas(found, truth))
    # The mean of 120 squares of normal numbers is 1 ± 0.13.
    assert 0.6 < np.mean(squares) < 1.5


def test_symmetric_parts_say_that_they_fit_in_several_poses():
    trimesh = pytest.importorskip("trimesh")
    box = trimesh.creation.box((40.0, 30.0, 20.0))
    mesh = fw.TriangleMesh(box.vertices, box.faces.astype(np.uint32))
    points = made(0, np.eye(4), mesh=MeshDistance(mesh), count=6000)
    found = fw.deviation(points, mesh)
    assert any("equally well" in finding.text for finding in found.findings)
    assert np.sqrt(np.mean(found.measured**2)) < 2 * SIGMA
    start = fw.evaluate.DatumPoints(box.vertices[:4], box.vertices[:4])
    known = fw.deviation(points, mesh, align=fw.evaluate.BestFit(start=start))
    assert not known.findings


def test_a_ball_slides_on_itself():
    trimesh = pytest.importorskip("trimesh")
    ball = trimesh.creation.icosphere(3, 20.0)
    mesh = fw.TriangleMesh(ball.vertices, ball.faces.astype(np.uint32))
    points = made(0, np.eye(4), mesh=MeshDistance(mesh), count=6000)
    found = fw.deviation(points, mesh, align=fw.evaluate.BestFit(start=np.eye(4)))
    assert found.alignment.slides == 3
    assert any("slides" in finding.text for finding in found.findings)


def test_points_far_from_the_model_cannot_be_aligned():
    points = made(0, np.eye(4), count=4000)
    far = pose(np.eye(3), np.array([0.0, 0.0, 300.0]))
    with pytest.raises(fw.InputError, match="matching points"):
        fw.deviation(points, model(), align=fw.evaluate.BestFit(start=far))
    with pytest.raises(fw.InputError, match="within"):
        fw.deviation(points, model(), align=fw.evaluate.KnownPose(far))


def test_a_fit_within_a_ball_follows_that_part_alone():
    truth = somewhere(1)
    points = made(1, truth, count=30_000)
    moved = np.array(points.xyz_mm)
    placed = transform(truth, moved)
    block = placed[:, 2] > 15.0
    moved[block] += 0.4 * truth[:3, :3].T @ np.array([0.0, 0.0, 1.0])
    bent = replace(points, xyz_mm=moved)
    middle = transform(inverse(truth), np.array([[60.0, 30.0, 10.0]]))[0]
    align = fw.evaluate.BestFit(start=truth, within=(*middle, 32.0))
    found = fw.deviation(bent, model(), align=align)
    top = np.abs(found.points_mm[:, :2] - (16.0, 44.0)).max(axis=1) < 8.0
    assert np.median(found.distance_mm[top]) == pytest.approx(0.4, abs=0.01)
    with pytest.raises(fw.InputError, match="area"):
        fw.deviation(
            bent, model(), align=fw.evaluate.BestFit(within=fw.evaluate.Area(box=(0, 0, 9, 9)))
        )


@pytest.mark.parametrize("count", [3, 6])
def test_datum_points_give_the_pose_with_its_covariance(count):
    corners = np.array(
        [[0, 0, 10], [80, 0, 10], [80, 60, 10], [0, 60, 10], [16, 44, 16], [40, 0, 0.0]]
    )[:count]
    squares = []
    for seed in range(40):
        truth = somewhere(seed)
        rng = np.random.default_rng(seed)
        seen = transform(inverse(truth), corners) + rng.normal(0, 0.05, corners.shape)
        datum = fw.evaluate.DatumPoints(seen, corners, sigma_mm=0.05)
        found = align_points(datum, None, None)
        squares.append(off_in_sigmas(found, truth))
    # The mean of 240 squares of normal numbers is 1 ± 0.09.
    assert 0.7 < np.mean(squares) < 1.3


def test_datums_that_hold_nothing_are_refused():
    line = np.array([[0.0, 0, 0], [1, 1, 1], [2, 2, 2]])
    points = made(0, np.eye(4), count=40_000)
    with pytest.raises(fw.InputError, match="on a line"):
        fw.deviation(points, model(), align=fw.evaluate.DatumPoints(line, line))
    with pytest.raises(fw.InputError, match="3 pairs or more"):
        fw.evaluate.DatumPoints(line[:2], line[:2])
    with pytest.raises(fw.InputError, match="shape"):
        fw.evaluate.DatumPoints(line, line[:2])
    same = ((60.0, 12.0, 10.0, 9.0),) * 3
    on_model = np.array([[60.0, 12, 10], [70, 10, 10], [70, 20, 10]])
    with pytest.raises(fw.InputError, match="nearly parallel"):
        fw.deviation(points, model(), align=fw.evaluate.DatumPlanes(same, on_model))
    with pytest.raises(fw.InputError, match="rotation"):
        fw.evaluate.KnownPose(2.0 * np.eye(4))


def planes(truth):
    """Balls around three faces in the part's coordinates, and points of the faces."""
    on_model = np.array([[60.0, 12.0, 10.0], [40.0, 0.0, 5.0], [0.0, 30.0, 5.0]])
    centres = transform(inverse(truth), on_model)
    return fw.evaluate.DatumPlanes(
        tuple((*c, r) for c, r in zip(centres, (9.0, 4.9, 4.9), strict=True)), on_model
    )


@pytest.mark.long
def test_datum_planes_hold_three_two_and_one_directions():
    squares = []
    distance = MeshDistance(model())
    for seed in range(24):
        truth = somewhere(seed)
        seen = measured_part(made(seed, truth, count=20_000, mesh=distance), None)
        found = aligned(seen, distance, planes(truth))
        assert found.converged
        squares.append(off_in_sigmas(found, truth))
    # The mean of 144 squares of normal numbers is 1 ± 0.12.
    assert 0.6 < np.mean(squares) < 1.5


def test_the_primary_datum_rules():
    """The secondary plane is off its angle by 1°: it may turn the part about the first only."""
    truth = np.eye(4)
    points = made(3, truth, count=60_000)
    xyz = np.array(points.xyz_mm)
    side = np.abs(xyz[:, 1]) < 0.1
    xyz[side, 1] += np.tan(np.radians(1.0)) * (xyz[side, 2] - 5.0)
    found = fw.deviation(replace(points, xyz_mm=xyz), model(), align=planes(truth)).alignment
    normal = found.T_model_part[:3, :3] @ (0.0, 0.0, 1.0)
    assert np.degrees(np.hypot(*normal[:2])) < 0.02
    assert np.degrees(np.linalg.norm(twist(found.T_model_part)[:3])) < 0.05
