"""Kernels for surfaces that move, against NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import _core
from fringeworks.patterns.plan import equal_steps
from fringeworks.stack.motion import fit_moving
from tests.oracles import moving as oracle

SHAPE = (37, 211)


def moving_set(steps, seed, noise=0.0):
    """Frames of a set whose phase turns otherwise at every pixel, with some that are NaN."""
    rng = np.random.default_rng(seed)
    shifts = np.array(equal_steps(steps)) + 0.05 * rng.normal(size=steps)
    velocity = rng.uniform(-0.2, 0.2, SHAPE).astype(np.float32)
    turned = [np.float32(t) * velocity for t in np.arange(steps) - 0.5 * (steps - 1)]
    phase, b = rng.uniform(-np.pi, np.pi, SHAPE), rng.uniform(5.0, 100.0, SHAPE)
    frames = [
        (120.0 + b * np.cos(phase - d + t) + noise * rng.normal(size=SHAPE)).astype(np.float32)
        for d, t in zip(shifts, turned, strict=True)
    ]
    frames[1][3, 5:9] = np.nan
    return frames, tuple(shifts), turned


@pytest.mark.parametrize("steps", [3, 4, 7])
def test_fits_are_those_of_numpy(steps):
    frames, shifts, turned = moving_set(steps, steps, noise=2.0)
    found = fit_moving(frames, shifts, turned)
    wanted = oracle.fit_moving(frames, shifts, turned)
    for one, other, off in zip(found, wanted, (1e-3, 1e-3, 1e-3, 0.05), strict=True):
        np.testing.assert_allclose(one, other, atol=off)


def test_the_unit_of_the_angles_counts():
    frames, shifts, turned = moving_set(4, 1)
    halves = [2.0 * t for t in turned]
    for one, other in zip(
        fit_moving(frames, shifts, turned), fit_moving(frames, shifts, halves, 0.5), strict=True
    ):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("steps", [3, 5])
def test_samples_are_turned_back_in_place(steps):
    frames, shifts, turned = moving_set(steps, 10 + steps)
    _, c, s, _ = fit_moving(frames, shifts, turned)
    kept = np.random.default_rng(2).random(SHAPE) < 0.2
    wanted = oracle.turned_back(frames, shifts, turned, c, s, kept)
    before = np.stack(frames)
    angles = {"turned": turned, "per_unit": 1.0, "shifts": shifts}
    _core.turn_back(frames, angles, c, s, kept)
    np.testing.assert_allclose(frames, wanted, atol=1e-3)
    np.testing.assert_array_equal(np.stack(frames)[:, kept], before[:, kept])
    # What is turned back is a wave without turns.
    still = oracle.fit_moving(frames, shifts, [np.zeros(SHAPE)] * steps)
    square = still[3][~kept & np.isfinite(still[3])]
    assert np.abs(square).max() < 1e-3


@pytest.mark.parametrize("shape", [(1, 9), (2, 2), (5, 1), (31, 70), (90, 48)])
def test_maps_are_moved_as_by_scipy(shape):
    rng = np.random.default_rng(sum(shape))
    values = rng.uniform(0.0, 255.0, shape).astype(np.float32)
    flow = rng.normal(0.0, 0.7, (*shape, 2)).astype(np.float32)
    flow[rng.random(shape) < 0.3] = 0.0
    flow[rng.random(shape) < 0.1, 0] = 1.0
    flow[rng.random(shape) < 0.1, 1] = 0.0
    if values.size > 100:
        values[3, 4:9], values[20, 30] = np.nan, np.inf
    for time in (-2.5, 1.0, 3.25):
        found = _core.warp_by_flow(values, flow, time)
        wanted = oracle.warped(values, flow, time)
        np.testing.assert_allclose(found, wanted, atol=1e-4)
    still = np.zeros_like(flow)
    np.testing.assert_array_equal(_core.warp_by_flow(values, still, 1.0), values)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("orders", [(), (2, 3, 4)])
def test_chi_of_residuals_is_that_of_numpy(dtype, orders):
    rng = np.random.default_rng(5)
    steps = 6
    design = np.stack(
        [np.ones(steps), *(f(equal_steps(steps)) for f in (np.cos, np.sin))], axis=-1
    ).astype(np.float32)
    shown = {
        "design": design,
        "solver": np.linalg.pinv(design),
        "harmonics": (0.02 * rng.normal(size=(steps, 2 * len(orders)))).astype(np.float32),
        "orders": orders,
    }
    scatter = {"dark": 4.0, "gain": 0.02, "floor": 1e-4, "saturation": 210.0, "most": 20.0}
    phase = rng.uniform(-np.pi, np.pi, SHAPE)
    planes = []
    for delta in equal_steps(steps):
        light = 120.0 + 85.0 * np.cos(phase - delta) + rng.normal(0.0, 3.0, SHAPE)
        planes.append(np.rint(light).astype(dtype))
    if dtype is np.float32:
        planes[2][4, 7:12] = np.inf
        planes[3][5, 7:12] = np.nan
    lit = rng.random(SHAPE) < 0.9
    sums = np.ones(SHAPE, np.float32), np.zeros(SHAPE, np.float32)
    _core.add_residual_chi(planes, shown, scatter, lit, sums)
    with np.errstate(invalid="ignore"):
        chi, freedom = oracle.residual_chi(planes, shown, scatter, lit)
    np.testing.assert_allclose(sums[0], 1.0 + chi, rtol=1e-3, atol=1e-3)
    np.testing.assert_array_equal(sums[1], freedom)
    assert 0 < np.count_nonzero(freedom) < np.count_nonzero(lit)


def test_kernels_refuse_sets_that_do_not_fit():
    frames, shifts, turned = moving_set(4, 1)
    angles = {"turned": turned, "per_unit": 1.0, "shifts": shifts}
    with pytest.raises(ValueError, match="turned: expected 4 values, got 3"):
        _core.fit_moving(frames, angles | {"turned": turned[:3]})
    with pytest.raises(ValueError, match="frames: expected at least 3, got 2"):
        _core.fit_moving(frames[:2], angles)
    with pytest.raises(ValueError, match="kept: expected"):
        _core.turn_back(frames, angles, *turned[:2], np.zeros((2, 2), bool))
