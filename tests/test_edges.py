"""Coordinates beside edges of paint and depth, before a lens that blurs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

import fringeworks as fw
from fringeworks import _core
from fringeworks.patterns import GrayCode, PhaseSteps, equal_steps
from fringeworks.stack.edges import Light, line_shift, remove_blur_shift
from tests.grids import thinned
from tests.oracles import edges as oracle

FINE = 4
"""Samples per camera pixel, along rows and columns."""
MARGIN = 8
"""Pixels around the picture, which blur reaches into."""
SHAPE = (160, 220)
WIDTH = 912
NEAR_PX = 3.0
KINDS = ("modulation", "background")


def plan_of(*blocks):
    return fw.PatternPlan(WIDTH, 570, blocks)


PLANS = {
    "gray-3": plan_of(PhaseSteps("x", 16.0, equal_steps(3)), GrayCode("x", 8.0, WIDTH)),
    "gray-4": plan_of(PhaseSteps("x", 16.0, equal_steps(4)), GrayCode("x", 8.0, WIDTH)),
    "hierarchy": plan_of(*(PhaseSteps("x", p, equal_steps(4)) for p in (912.0, 96.0, 16.0))),
}


class Scene:
    """A curved surface with discs and stripes of paint or of another depth, finely sampled."""

    def __init__(self, seed, dark=None, depth=False):
        rng = np.random.default_rng(seed)
        h, w = SHAPE
        rows, columns = ((n + 2 * MARGIN) * FINE for n in SHAPE)
        y, x = np.mgrid[:rows, :columns] / FINE - (FINE - 1) / (2 * FINE) - MARGIN
        self.column = 60.0 + rng.uniform(0.7, 1.6) * x + 0.05 * y + 0.0006 * (x - w / 2) ** 2
        self.column += 4.0 * np.sin(y / 37.0 + x / 53.0)
        self.albedo = np.full(x.shape, 0.9)
        for k in range(8):
            cx, cy, radius = rng.uniform(0, w), rng.uniform(0, h), rng.uniform(6, 30)
            angle = rng.uniform(0, np.pi)
            across = (x - cx) * np.cos(angle) + (y - cy) * np.sin(angle)
            shape = np.abs(across) < radius / 3 if k % 2 else np.hypot(x - cx, y - cy) < radius
            if dark is not None:
                self.albedo[shape] = 0.9 + dark - self.albedo[shape]
            if depth and k % 2 == 0:
                self.column[shape] += rng.uniform(8, 60)

    @staticmethod
    def inner(values):
        """Samples of every pixel, (h, w, 16)."""
        edge = MARGIN * FINE
        inside = values[edge:-edge, edge:-edge]
        blocks = inside.reshape(SHAPE[0], FINE, SHAPE[1], FINE).transpose(0, 2, 1, 3)
        return blocks.reshape(*SHAPE, -1)

    def frames(self, plan, blur_px, seed, noise=0.7):
        rng = np.random.default_rng([seed, 99])
        for pattern in fw.encode(plan):
            row = np.asarray(pattern, float)[0] / 255.0
            light = np.interp(self.column, np.arange(row.size), row) + 0.05
            seen = ndimage.gaussian_filter(self.albedo * light, blur_px * FINE)
            counts = 4.0 + 200.0 * self.inner(seen).mean(axis=-1)
            counts += noise * rng.standard_normal(SHAPE)
            counts += np.sqrt(0.02 * counts.clip(0.0)) * rng.standard_normal(SHAPE)
            yield np.clip(np.rint(counts), 0, 255).astype(np.uint8)

    def near(self, values):
        """Pixels within 3 px of a jump of the values."""
        jump = ndimage.morphological_gradient(values, 3) > 0.05 * np.abs(values).max()
        distance = ndimage.distance_transform_edt(~self.inner(jump).any(axis=-1))
        return distance <= NEAR_PX


def decoded(scene, name, blur_px, seed):
    found = fw.decode(list(scene.frames(PLANS[name], blur_px, seed)), PLANS[name])
    return found, found.x.coordinate_px.astype(float), found.x.sigma_px


@pytest.mark.statistical
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
@thinned(strength=1, thorough=2, name=list(PLANS), blur_px=[0.4, 0.8, 1.3], dark=[0.08, 0.3])
def test_paint_hardly_shifts_coordinates(name, blur_px, dark, seed):
    scene = Scene(seed, dark=dark)
    found, column, sigma = decoded(scene, name, blur_px, seed)
    truth, near = scene.inner(scene.column).mean(axis=-1), scene.near(scene.albedo)
    ok = np.isfinite(column)
    assert ok.mean() > 0.99
    z = np.abs(column - truth) / sigma
    assert np.mean(z[ok & near] < 2.0) >= 0.88
    assert np.mean(z[ok & near] > 5.0) <= 1e-3
    assert 0.64 < np.mean(z[ok & ~near] < 1.0) < 0.85
    # Blur alone would shift the coordinates beside edges by half a pixel and more.
    assert np.sqrt(np.mean((column - truth)[ok & near] ** 2)) < 0.25
    assert not {f.kind for f in found.findings if f.severity != "note"} - {"correlated noise"}


@pytest.mark.statistical
@pytest.mark.parametrize(("blur_px", "seed"), [(0.9, 4), (1.2, 5)])
def test_paint_under_orders_that_neighbours_decide(blur_px, seed):
    """Periods so alike that single pixels do not tell the order: their lines show blur and scatter
    all the same."""
    plan = plan_of(*(PhaseSteps("x", p, equal_steps(5)) for p in (32.0, 33.0)))
    scene = Scene(seed, dark=0.3)
    found = fw.decode(list(scene.frames(plan, blur_px, seed, noise=2.5)), plan).x
    truth, near = scene.inner(scene.column).mean(axis=-1), scene.near(scene.albedo)
    ok = np.isfinite(found.coordinate_px)
    assert ok.mean() > 0.9
    z = np.abs(found.coordinate_px - truth) / found.sigma_px
    assert np.mean(z[ok & near] < 2.0) >= 0.88
    assert np.mean(z[ok & near] > 5.0) <= 1e-3


@pytest.mark.statistical
@pytest.mark.parametrize(
    ("name", "blur_px", "most"),
    [
        ("gray-4", 0.4, 1e-4),
        pytest.param("gray-4", 0.8, 1e-4, marks=pytest.mark.long),
        pytest.param("hierarchy", 0.4, 1e-4, marks=pytest.mark.long),
        # Sets that disagree take most mixed pixels out; what is left has long tails.
        pytest.param("hierarchy", 0.8, 5e-4, marks=pytest.mark.long),
    ],
)
@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.long) for k in (1, 2))])
def test_sigma_covers_mixed_depths(name, blur_px, most, seed):
    scene = Scene(seed, depth=True)
    _, column, sigma = decoded(scene, name, blur_px, seed)
    samples = scene.inner(scene.column)
    # A pixel that a step crosses sees both depths: either is right.
    crossed = np.ptp(samples, axis=-1, keepdims=True) > 4.0
    right = np.where(crossed, samples, samples.mean(axis=-1, keepdims=True))
    z = np.abs(column[..., None] - right).min(axis=-1) / sigma
    ok = np.isfinite(column)
    assert np.mean(z[ok] > 5.0) <= most
    assert np.median(sigma[ok & ~scene.near(scene.column)]) < 0.05


def random_maps(shape, seed):
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    column = 1.3 * x + 0.4 * y + np.where(x > 0.6 * shape[1], 30.0, 0.0)
    column += np.where(y > 0.7 * shape[0], 5.0, 0.0) + 0.03 * rng.standard_normal(shape)
    light = np.log(rng.uniform(5.0, 50.0, shape))
    sigma = rng.uniform(0.02, 0.05, shape)
    hole = rng.random(shape) < 0.05
    column[hole] = sigma[hole] = np.nan
    light[rng.random(shape) < 0.02] = np.nan
    return [values.astype(np.float32) for values in (column, sigma, light)]


def lights_of(modulation, background, faint=0.0):
    shift, told = np.empty((2, *background.shape), np.float32)
    maps = {"modulation": modulation, "background": background, "shift": shift, "told": told}
    return {**maps, "faint": faint}


def test_places_without_edges_are_left_out():
    """A ramp whose left half is even: in places of 16 pixels there, nothing is computed."""
    column = np.tile(1.5 * np.arange(128, dtype=np.float32), (30, 1))
    light = np.tile(np.fmax(0.0, 0.1 * (np.arange(128, dtype=np.float32) - 64)), (30, 1))
    sigma, slope = np.full_like(column, 0.01), np.empty_like(column)
    steps = {"most": 8.0, "repeats": np.inf}
    exact, lights = lights_of(light, light), lights_of(light, light, faint=0.04)
    for some in (exact, lights):
        _core.blur_shift(column, sigma, some, steps, slope)
    assert (slope[:, :48] == 0.0).all()
    np.testing.assert_array_equal(lights["shift"][:, 64:], exact["shift"][:, 64:])
    np.testing.assert_allclose(lights["shift"][:, 66:-1], 0.15, rtol=1e-4)


@pytest.mark.parametrize("repeats", [np.inf, 40.0])
@pytest.mark.parametrize("shape", [(1, 1), (2, 9), (40, 70), (21, 130)])
def test_kernels_agree_with_their_oracles(shape, repeats):
    column, sigma, light = random_maps(shape, 3)
    if np.isfinite(repeats):
        column %= np.float32(repeats)
    slope = np.empty(shape, np.float32)
    other = np.roll(light, 3)
    lights = lights_of(light, other)
    _core.blur_shift(column, sigma, lights, {"most": 8.0, "repeats": repeats}, slope)
    shift = lights["shift"]
    exact = [v.astype(float) for v in (column, sigma, light)]
    expected = oracle.blur_shift(*exact, 8.0, repeats)
    np.testing.assert_allclose(shift, expected[0], rtol=1e-3, atol=1e-3)
    told, _ = oracle.blur_shift(exact[0], exact[1], other.astype(float), 8.0, repeats)
    np.testing.assert_allclose(lights["told"], told, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(slope, expected[1], rtol=1e-3, atol=1e-3)
    rings = np.empty(shape, np.uint8)
    sums = _core.edge_rings(column, sigma, {"most": 4.0, "repeats": repeats}, rings)
    expected_rings, expected_sums = oracle.edge_rings(*exact[:2], 4.0, repeats)
    np.testing.assert_array_equal(rings, expected_rings)
    np.testing.assert_allclose(sums, expected_sums, rtol=1e-3, atol=1e-3)
    if min(shape) > 20:
        assert set(np.unique(rings)) == {0, 1, 2, 3, 4}


def test_kernels_refuse_what_does_not_fit():
    one, byte = np.ones((4, 5), np.float32), np.ones((4, 5), np.uint8)
    steps = {"most": 8.0, "repeats": np.inf}
    with pytest.raises(ValueError, match=r"light: expected shape \(4, 5\), got \(2, 5\)"):
        _core.blur_shift(one, one, lights_of(one[:2].copy(), one), steps, one.copy())
    with pytest.raises(ValueError, match="most: expected above 0 px, got 0"):
        _core.blur_shift(one, one, lights_of(one, one), {**steps, "most": 0.0}, one.copy())
    with pytest.raises(ValueError, match="sigma: expected shape"):
        _core.edge_rings(one, one[:2].copy(), steps, byte)


def test_even_light_shows_no_blur():
    rng = np.random.default_rng(5)
    y, x = np.mgrid[:120, :200].astype(float)
    column = (1.3 * x + 3.0 * np.sin(y / 20.0) + 0.05 * rng.standard_normal(x.shape)).astype("f4")
    sigma = np.full(x.shape, 0.05, np.float32)
    light = Light.of({k: 60.0 + 0.5 * rng.standard_normal(x.shape).astype("f4") for k in KINDS})
    before = column.copy()
    fringes = {"period_px": 16.0, "repeats_px": np.inf, "light_noise": 2.0 * np.pi / 16.0}
    assert remove_blur_shift(column, sigma, light, **fringes) == 0.0
    assert line_shift(column, sigma, light, **fringes) is None
    np.testing.assert_array_equal(column, before)
    assert (sigma == np.float32(0.05)).all()
