"""Noise that neighbouring pixels share: its estimate, and what it does to quantities."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy

from fringeworks.evaluate import shares
from fringeworks.evaluate.area_points import Term, area_points, shares_of
from fringeworks.evaluate.quantities import flatness, step_height
from fringeworks.evaluate.tolerances.measure import prepared
from fringeworks.evaluate.tolerances.neighbours import _Blur, _Field, correlations, neighbours
from fringeworks.evaluate.tolerances.uncertain import quantified
from tests.tolerance_bodies import NOISE_MM, SIDE, Case, case, grid, zone

pytestmark = pytest.mark.statistical

PIXELS = np.argwhere(np.ones((48, 48), bool))


def blurred(rng, reach, shape=(48, 48)):
    """Noise of variance 1 that a Gaussian has blurred."""
    found = scipy.ndimage.gaussian_filter(rng.normal(size=shape), reach, mode="wrap")
    kernel = scipy.ndimage.gaussian_filter(np.eye(1, 41, 20), (0.0, reach))
    return found / np.sum(kernel**2)


def total(reach):
    """Factor of the variance of a mean over many pixels by such noise."""
    kernel = scipy.ndimage.gaussian_filter(np.eye(1, 41, 20), (0.0, reach))
    return 1.0 / np.sum(kernel**2) ** 2


def form(shape=(48, 48)):
    y, x = np.mgrid[-1 : 1 : shape[0] * 1j, -1 : 1 : shape[1] * 1j]
    return 5.0 * np.exp(-0.5 * ((x - 0.2) / 0.3) ** 2) + 40.0 * x + 3.0 * y**2


@pytest.mark.parametrize("seed", [1, 2])
def test_independent_noise_stays_independent(seed):
    values = form() + np.random.default_rng(seed).normal(size=(48, 48))
    assert neighbours(PIXELS, values.ravel(), np.ones(PIXELS.shape[0])) is None


@pytest.mark.parametrize("reach", [0.5, 0.7, 1.0])
def test_blurred_noise_is_told_beside_a_form(reach):
    values = form() + blurred(np.random.default_rng(3), reach)
    found = neighbours(PIXELS, 0.02 * values.ravel(), np.full(PIXELS.shape[0], 0.02))
    assert found is not None
    assert found.level == pytest.approx(1.0, abs=0.2)
    assert found.level * found.total == pytest.approx(total(reach), rel=0.3)


def test_missing_pixels_are_no_neighbours():
    rng = np.random.default_rng(4)
    kept = rng.random(PIXELS.shape[0]) < 0.7
    values = blurred(rng, 0.7).ravel()[kept]
    found = neighbours(PIXELS[kept], values, np.ones(values.size))
    assert found is not None
    assert found.total == pytest.approx(total(0.7), rel=0.35)
    few = PIXELS[kept][:40]
    assert neighbours(few, values[:40], np.ones(40)) is None


def test_a_texture_that_is_larger_than_the_noise_is_form():
    """Waves of eight pixels on a face of 200: finer than the estimate's form."""
    rng = np.random.default_rng(5)
    y, x = np.mgrid[:200, :200]
    waves = 5.0 * np.sin(2 * np.pi * x / 8.0) * np.sin(2 * np.pi * y / 9.0)
    pixels = np.argwhere(np.ones((200, 200), bool))
    values = waves + rng.normal(size=waves.shape)
    assert neighbours(pixels, values.ravel(), np.ones(pixels.shape[0])) is None


def test_rounding_is_no_noise_that_neighbours_share():
    """Perfect data in single precision, whose stated noise is not there; and one row of pixels."""
    y, x = np.mgrid[:48, :48]
    rounded = np.float32(500.0 + 0.00001 * x + 0.00002 * y).astype(float).ravel()
    assert neighbours(PIXELS, rounded, np.full(rounded.size, 0.01)) is None
    assert neighbours(PIXELS, np.full(rounded.size, 3.0), np.full(rounded.size, 0.01)) is None
    row = np.stack((np.zeros(300, int), np.arange(300)), axis=-1)
    values = np.random.default_rng(9).normal(size=300)
    assert neighbours(row, values, np.ones(300)) is None
    smooth = scipy.ndimage.gaussian_filter1d(np.random.default_rng(9).normal(size=300), 1.0)
    found = neighbours(row, smooth / smooth.std(), np.ones(300))
    assert found is not None
    assert found.variance(row, np.full(300, 1.0 / 300)) > 2.0 / 300


def test_whitening_makes_noise_independent():
    pixels = np.argwhere(np.ones((9, 11), bool))
    field = _Field(pixels, np.zeros(pixels.shape[0]), np.ones(pixels.shape[0]))
    blur = _Blur(0.6, 0.8, 0.1)
    steps = np.mgrid[-6:7, -6:7].transpose(1, 2, 0).astype(float)
    shared = correlations(pixels, blur.common(steps)).toarray()
    white, volume = field.whitening(blur)
    identity = white @ shared @ white.toarray().T
    np.testing.assert_allclose(identity, np.eye(pixels.shape[0]), atol=0.05)
    assert volume == pytest.approx(np.linalg.slogdet(shared)[1], abs=0.5)


def test_draws_and_variances_are_those_of_the_correlations():
    rng = np.random.default_rng(6)
    found = neighbours(PIXELS, blurred(rng, 0.8).ravel(), np.ones(PIXELS.shape[0]))
    assert found is not None
    some = PIXELS[rng.random(PIXELS.shape[0]) < 0.5][:400]
    weights = rng.random(400)
    exact = weights @ (correlations(some, found.common) @ weights)
    assert found.variance(some, weights) == pytest.approx(exact, rel=1e-3)
    drawn = [weights @ found.draw(some, rng) for _ in range(800)]
    assert np.var(drawn) == pytest.approx(exact, rel=0.2)


def measured(points, noise):
    """The area of one body under noise of variance 1, times ``NOISE_MM``."""
    one = Case(zone("iso_flatness", (next(iter(points)),)), points, {})
    clean = one.cloud(np.random.default_rng(0), 0.0)
    ray = clean.xyz_mm / np.linalg.norm(clean.xyz_mm, axis=-1, keepdims=True)
    sigma = np.full(noise.shape, NOISE_MM, np.float32)
    moved = (clean.xyz_mm + NOISE_MM * noise[..., None] * ray).astype(np.float32)
    return replace(clean, xyz_mm=moved, sigma_mm=sigma, noise_mm=sigma), one.recipe()


def test_means_are_as_unsure_as_shared_noise_makes_them():
    """The mean height of a face, and a step to another: twelve draws of blurred noise."""
    u, v = grid()
    face = np.stack((20.0 * u, 20.0 * v, np.full_like(u, 500.0)), axis=-1)
    over, mean_over = [], []
    for seed in range(12):
        noise = blurred(np.random.default_rng([seed, 8]), 0.7, (SIDE, 2 * SIDE))
        cloud, recipe = measured({"one": face, "two": face}, noise)
        one, two = (area_points(cloud, recipe.areas[name]) for name in ("one", "two"))
        found = step_height(one, two)
        over.append(found.value / found.sigma)
        n = len(one.points)
        up = np.array([0.0, 0.0, 1.0])
        sigma = shares.total(shares_of([Term(one, np.full(n, 1.0 / n), up)]))
        mean_over.append((one.middle[2] - 500.0) / sigma)
    # With independent noise, they were 2.4 times as large.
    for each in (over, mean_over):
        assert 0.5 < np.sqrt(np.mean(np.square(each))) < 1.6


def test_ranges_of_points_are_freed_of_shared_noise():
    u, v = grid()
    face = np.stack((20.0 * u, 20.0 * v, np.full_like(u, 500.0)), axis=-1)
    noise = blurred(np.random.default_rng(11), 1.0, (SIDE, SIDE))
    cloud, recipe = measured({"one": face}, noise)
    found = flatness(area_points(cloud, recipe.areas["one"]))
    assert found.value < 2.5 * found.sigma


@pytest.mark.parametrize(("quantity", "seed"), [("iso_parallelism", 1), ("iso_flatness", 2)])
def test_tolerances_hold_their_sigma_under_shared_noise(quantity, seed):
    rng = np.random.default_rng([seed, 91])
    one = case(quantity, rng)
    recipe = one.recipe()
    values = []
    shape = SIDE, SIDE * len(one.points)
    for noise in (np.zeros(shape), rng.normal(size=shape), blurred(rng, 0.7, shape)):
        cloud, _ = measured(one.points, noise)

        def of_area(name, cloud=cloud):
            return area_points(cloud, recipe.areas[name])

        values.append(quantified(*prepared(one.tolerance, recipe, of_area, of_area)))
    true, alone, shared = values
    assert shared.sigma > 1.3 * alone.sigma
    assert abs(shared.value - true.value) < 3.0 * shared.sigma
