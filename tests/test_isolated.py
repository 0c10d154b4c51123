"""Pixels whose coordinate no neighbour shares: what the test removes, and what it leaves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fringeworks import Reason, _core, decode
from fringeworks.rig.pinhole import pose, rotation
from fringeworks.rig.triangulate import triangulate
from fringeworks.simulate.bodies import Body, Box, Cylinder, Plane, Sphere
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look
from fringeworks.stack import StreamingDecoder
from tests.oracles.isolated import isolated

GROSS_MM = 1.0
"""Distance along the ray to the nearest surface beyond which a point is grossly wrong."""


def marked(coordinate, sigma=0.05, repeats=np.inf):
    """True where the kernel marks a pixel; the maps must say the same."""
    values = np.array(coordinate, np.float32)
    sigmas = np.where(np.isfinite(values), np.float32(sigma), np.float32(np.nan))
    reason = np.where(np.isfinite(values), 0, Reason.SHADOW).astype(np.uint8)
    before = values.copy()
    typical = _core.typical_step(values, repeats=repeats)
    count = _core.mark_isolated(values, sigmas, reason, typical=typical, repeats=repeats)
    found = reason == Reason.ISOLATED
    assert count == found.sum()
    assert np.isnan(values[found]).all()
    assert np.isnan(sigmas[found]).all()
    np.testing.assert_array_equal(values[~found], before[~found])
    return found


def plane(shape=(40, 60), across=1.0, down=0.1):
    y, x = np.mgrid[: shape[0], : shape[1]]
    return 300.0 + across * x + down * y


@pytest.mark.parametrize("repeats", [np.inf, 40.0])
@pytest.mark.parametrize("shape", [(3, 3), (5, 40), (70, 33), (37, 64), (61, 97)])
def test_kernel_and_twin_agree(shape, repeats):
    rng = np.random.default_rng(sum(shape))
    coordinate = plane(shape) + 0.3 * rng.standard_normal(shape)
    coordinate[:, shape[1] // 2 :] += 70.0
    coordinate[rng.random(shape) < 0.1] += 30.0
    # Sparse in one part, as on a dim surface.
    lost = rng.random(shape) < np.linspace(0.0, 0.9, shape[1])
    coordinate[lost] = np.nan
    if np.isfinite(repeats):
        coordinate %= repeats
    coordinate = coordinate.astype(np.float32)
    sigma = np.where(np.isnan(coordinate), np.nan, rng.uniform(0.01, 0.5, shape))
    expected = isolated(coordinate.astype(float), sigma.astype(np.float32).astype(float), repeats)
    found = marked(coordinate, sigma, repeats)
    assert (expected.any() and not expected.all()) or shape == (3, 3)
    np.testing.assert_array_equal(found, expected)


def test_surfaces_stay():
    y, x = np.mgrid[:60, :80]
    # Steep, as seen at a grazing angle, beside a flat one.
    steep = np.where(x < 40, plane((60, 80)), 340.0 + 15.0 * (x - 40.0))
    assert not marked(steep).any()
    # The rim of a ball, where the slope has no bound.
    depth = np.sqrt(np.maximum(0.0, 25.0**2 - (x - 40.2) ** 2 - (y - 29.7) ** 2))
    ball = plane((60, 80), 1.0, 0.0) + np.where(depth > 0, 40.0 + 4.0 * depth, 0.0)
    assert marked(ball).mean() < 1e-3
    # A wire of 2 px before a wall, and a hole of 2 px in a sheet.
    wire = plane((60, 80))
    wire[:, 30:32] -= 90.0
    wire[20:22, 50:52] += 60.0
    assert not marked(wire).any()
    # The narrow strip between two shadows.
    strip = np.full((60, 80), np.nan)
    strip[:, 30:32] = plane((60, 80))[:, 30:32]
    assert not marked(strip).any()


def test_noise_and_gray_steps_stay():
    rng = np.random.default_rng(1)
    clean = plane((200, 200))
    noisy = clean + 0.8 * rng.standard_normal(clean.shape)
    assert marked(noisy, 0.8).mean() < 1e-4
    # Cells of a Gray code, several camera pixels wide, and with single pixels one cell off.
    cells = np.rint(plane((200, 200), 0.3, 0.05))
    cells[rng.random(cells.shape) < 0.01] += 1.0
    assert not marked(cells, 0.29).any()
    # Coordinates without any order, as in an experiment with random ones, are not judged.
    assert marked(rng.uniform(0.0, 1000.0, (200, 200))).mean() < 0.05


def test_the_seam_of_relative_coordinates_stays():
    relative = plane((40, 200)) % 64.0
    assert not marked(relative, repeats=64.0).any()
    relative[20, 100] = (relative[20, 100] + 20.0) % 64.0
    assert np.argwhere(marked(relative, repeats=64.0)).tolist() == [[20, 100]]


def test_a_sparse_surface_stays_and_its_mistakes_go():
    rng = np.random.default_rng(2)
    sparse = plane((100, 100))
    wrong = rng.random(sparse.shape) < 0.01
    sparse[wrong] += rng.uniform(50.0, 500.0, wrong.sum())
    sparse[rng.random(sparse.shape) < 0.5] = np.nan
    found = marked(sparse)
    assert found[wrong & np.isfinite(sparse)].all()
    assert found[~wrong & np.isfinite(sparse)].mean() < 0.02


def test_edges_along_columns_and_diagonals_go():
    """Pixels that mix alike are neighbours of each other, but form a line."""
    edge = plane((40, 60))
    edge[:, 30:] += 100.0
    edge[:, 30] -= 50.0
    found = marked(edge)
    assert found[:, 30].all()
    assert found.sum() == 40
    y, x = np.mgrid[:40, :60]
    edge = plane((40, 60)) + np.where(x > y + 10, 100.0, 0.0) + np.where(x == y + 10, 40.0, 0.0)
    np.testing.assert_array_equal(marked(edge), x == y + 10)


@pytest.mark.parametrize("shape", [(1, 1), (1, 50), (2, 3), (50, 2)])
def test_lines_are_not_judged(shape):
    coordinate = plane(shape)
    coordinate[-1, -1] += 500.0
    assert not marked(coordinate).any()


def scene(seed):
    """Bodies before a wall, of all reflectances and at all angles."""
    rng = np.random.default_rng(seed)

    def place(spread):
        turn = rotation(rng.uniform(-0.7, 0.7, 3))
        return pose(turn, np.array([*rng.uniform(-60, 60, 2), 500.0 + rng.uniform(-40, spread)]))

    shapes = (
        Sphere(rng.uniform(8, 20)),
        Box(tuple(rng.uniform(15, 40, 3))),
        Cylinder(rng.uniform(0.5, 8), 80.0),
        Plane(40.0, 30.0),
    )
    bodies = [Body(shape, place(30.0), rng.uniform(0.3, 0.9)) for shape in shapes]
    wall = pose(rotation(rng.uniform(-0.2, 0.2, 3)), np.array([0.0, 0.0, 560.0]))
    return [*bodies, Body(Plane(), wall, 0.6)]


def miss(points_mm, measured_mm):
    """Distance along the ray to the surfaces that the pixel and its eight neighbours see, mm.

    The camera blurs: at an edge, most of the light can come from the pixel beyond it.
    """
    depth = np.pad(np.linalg.norm(points_mm, axis=-1), 1, mode="edge")
    height, width = points_mm.shape[:2]
    around = [depth[y : y + height, x : x + width] for y in range(3) for x in range(3)]
    return np.abs(np.stack(around) - np.linalg.norm(measured_mm, axis=-1)).min(axis=0)


@pytest.fixture(scope="module")
def ten_views():
    """Error of every point of ten views before and after the removal, mm, (10, 2, h, w)."""
    whole = standard_rig(scale=0.5)
    rig = replace(whole, camera=standard_rig(scale=0.25).camera)
    plan = fringe_plan(rig, both=False)
    found = []
    for seed in range(10):
        view = look(rig, scene(seed))
        frames = list(photograph(view, plan, Optics(seed=seed, noise=1.0)))
        errors = []
        for remove in (False, True):
            cloud = triangulate(decode(frames, plan, remove_isolated=remove), rig)
            errors.append(miss(view.points_mm, cloud.xyz_mm))
        found.append(errors)
    return np.array(found)


def test_no_point_of_ten_views_is_grossly_wrong(ten_views):
    before, after = ten_views[:, 0], ten_views[:, 1]
    assert (before > GROSS_MM).sum() >= 50
    assert not (after > GROSS_MM).any()


def test_good_points_of_ten_views_stay(ten_views):
    good = ten_views[:, 0] < 0.5 * GROSS_MM
    assert good.mean() > 0.5
    lost = np.isnan(ten_views[:, 1]) & good
    assert lost.sum() < 1e-3 * good.sum()


def test_option_and_stream():
    rig = standard_rig(scale=0.25)
    plan = fringe_plan(rig)
    view = look(rig, scene(0))
    frames = list(photograph(view, plan, Optics(noise=0.5)))
    kept, removed = (decode(frames, plan, remove_isolated=remove) for remove in (False, True))
    stream = StreamingDecoder(plan)
    for frame in frames:
        stream.add(frame)
    for axis, found in removed.maps.items():
        before = kept.maps[axis]
        gone = found.reason == Reason.ISOLATED
        assert not (before.reason == Reason.ISOLATED).any()
        assert (before.reason[gone] == Reason.OK).all()
        assert np.isnan(found.coordinate_px[gone]).all()
        assert np.isnan(found.sigma_px[gone]).all()
        np.testing.assert_array_equal(found.coordinate_px[~gone], before.coordinate_px[~gone])
        np.testing.assert_array_equal(stream.result().maps[axis].reason, found.reason)
    assert (removed.x.reason == Reason.ISOLATED).any()
