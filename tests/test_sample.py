"""The kernels that judge a sample of pixels, against their twins with NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import _core
from fringeworks.patterns.plan import step_design
from fringeworks.signal import CameraNoise
from fringeworks.stack.fits import fit_matrices, fit_samples
from fringeworks.statistics.chi_square import residual_variance
from fringeworks.statistics.quantiles import median, quantile
from tests.oracles import sample as oracle

ORDERS = [1, 2, 3, 4, 8]


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("count", [1, 2, 7, 1000, 1001])
def test_quantiles(rng, kind, count):
    values = rng.normal(size=count).astype(kind)
    shares = [0.0, 0.1, 0.5, 0.5, 0.97, 1.0]
    wanted = np.quantile(values.astype(float), shares)
    np.testing.assert_allclose(_core.quantiles(values, shares), wanted, rtol=1e-12)
    assert median(values) == pytest.approx(float(np.median(values)), rel=1e-6)
    assert quantile(values[::-1], 0.3) == quantile(values, 0.3)
    assert np.isnan(median(np.append(values, kind(np.nan))))
    assert np.isnan(median(values[:0]))


def test_quantiles_of_equal_signed_and_infinite_values():
    values = np.array([0.0, -0.0, np.inf, -np.inf, 1.0, 1.0, -2.0])
    assert _core.quantiles(values, [0.0, 0.5, 1.0]) == [-np.inf, 0.0, np.inf]
    for shares in ([0.5, 0.1], [-0.1], [1.1], [np.nan]):
        with pytest.raises(ValueError, match="rising shares"):
            _core.quantiles(values, shares)


@pytest.mark.parametrize("freedom", [1, 2, 5])
def test_trimmed_variance(rng, freedom):
    square = 3.0 * rng.chisquare(freedom, 5003)
    square[::50] *= 1e4
    found = residual_variance(square, freedom)
    assert found == pytest.approx(oracle.residual_variance(square, freedom), rel=1e-9)
    assert found == pytest.approx(3.0, rel=0.1)
    assert residual_variance(np.zeros(300), freedom) == 0.0


@pytest.mark.parametrize("count", [0, 3, 8, 400, 1003])
@pytest.mark.parametrize("groups", [1, 6, 8])
def test_similar_groups_are_those_of_a_stable_sort(rng, count, groups):
    key = np.rint(rng.normal(0, 3, count))  # many equal ones
    values = np.arange(count, dtype=float)
    found = _core.similar_groups(key, values, groups)
    parts = zip(*(np.array_split(part, groups) for part in found), strict=True)
    for wanted, (keys, inside) in zip(oracle.similar_groups(key, groups), parts, strict=True):
        np.testing.assert_array_equal(np.sort(inside), np.sort(values[wanted]))
        np.testing.assert_array_equal(keys, key[inside.astype(int)])


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("steps", [3, 4, 7])
def test_fits(rng, kind, steps):
    rows = step_design(2.0 * np.pi * np.arange(steps) / steps + 0.1)
    rows += rng.normal(0, 0.01, rows.shape)
    planes = [rng.uniform(0, 250, (1, 331)).astype(kind) for _ in rows]
    values = np.concatenate(planes).astype(float)
    found = fit_samples(planes, tuple(map(tuple, rows.tolist())))
    fitted, square = oracle.solve(values, rows)
    np.testing.assert_allclose(found.fitted, fitted, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.square, square, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.power, fitted[1] ** 2 + fitted[2] ** 2, rtol=1e-9, atol=1e-9)
    for seen, wanted in (
        (found.mean, values.mean(axis=0)),
        (found.variance, values.var(axis=0)),
        (found.largest, values.max(axis=0)),
        (found.smallest, values.min(axis=0)),
    ):
        np.testing.assert_allclose(seen, wanted, rtol=1e-12, atol=1e-9)
    shown = rows @ found.fitted
    inside = _core.fitted_inside(
        tuple(np.ascontiguousarray(row) for row in found.fitted),
        fit_matrices(tuple(map(tuple, rows.tolist())))[0],
        low=20.0,
        high=200.0,
    )
    np.testing.assert_array_equal(inside, (shown > 20.0) & (shown < 200.0))
    assert 0 < inside.sum() < inside.size


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_sample_that_is_not_finite_marks_its_pixel(rng, bad):
    planes = [rng.uniform(0, 250, (1, 20)).astype(np.float32) for _ in range(4)]
    planes[2][0, 5] = bad
    rows = tuple(map(tuple, step_design(np.pi / 2 * np.arange(4)).tolist()))
    finite = fit_samples(planes, rows).finite
    np.testing.assert_array_equal(np.flatnonzero(~finite), [5])


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_differences_of_neighbours(rng, kind):
    frame = rng.normal(size=(19, 33)).astype(kind)
    wanted = oracle.second_magnitudes(frame)
    np.testing.assert_allclose(_core.second_magnitudes(frame), wanted, atol=1e-5)
    assert _core.second_magnitudes(frame[:2]).size == 0
    sigma = rng.uniform(0.1, 0.4, frame.shape).astype(np.float32)
    lines = frame.astype(np.float32)
    lines[3, 7] = np.nan
    found = _core.third_chi_squares(lines, sigma, most=5.0)
    np.testing.assert_allclose(found, oracle.third_chi_squares(lines, sigma, 5.0), rtol=1e-4)
    assert 0 < found.size < 19 * 30 - 4


def test_phase_residuals(rng):
    shape = (3, 101)
    x, background, phase, modulation = (
        rng.uniform(low, high, shape).astype(np.float32)
        for low, high in ((0, 500), (5, 90), (-np.pi, np.pi), (3, 40))
    )
    used = rng.uniform(size=shape) < 0.6
    x[~used] = np.nan
    noise = CameraNoise(0.7, 0.03)
    found = _core.phase_residuals(
        {"coordinate": x, "background": background, "used": used},
        {"phase": phase, "modulation": modulation, "period": 31.5, "variance": 0.25},
        {"read_variance": 0.49, "gain": 0.03, "min_modulation": 1e-6},
    )
    wanted = oracle.phase_residuals(x, background, used, phase, modulation, 31.5, 0.25, noise)
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(("fringes_per_px", "windows"), [(0.11, (12, 40)), (0.021, (2, 120))])
def test_windows(rng, fringes_per_px, windows):
    x = np.arange(700)
    turns = np.tile(fringes_per_px * x + 3.0 * (x > 300), (6, 1)) + rng.normal(0, 0.01, (6, 700))
    turns = (turns + 0.4 * (x > 420) - np.rint(turns)).astype(np.float32)
    usable = rng.uniform(size=turns.shape) < 0.999
    usable[4] = False
    turns[~usable] = 0.0
    options = {"fringes": 3.0, "least": 16, "most": 64, "windows": windows, "jump": 0.2}
    found = _core.smooth_windows(turns, usable, options)
    wanted = oracle.smooth_windows(turns, usable, *options.values())
    assert found is not None
    assert wanted is not None
    np.testing.assert_array_equal(found[1], wanted[1])
    np.testing.assert_allclose(found[0], wanted[0], atol=1e-9)


@pytest.mark.parametrize("slope", [0.0, 0.002, 5.0])
def test_lines_with_too_few_fringes_have_no_windows(slope):
    turns = np.tile(slope * np.arange(300) % 1.0, (3, 1)).astype(np.float32)
    usable = np.ones(turns.shape, bool)
    options = {"fringes": 3.0, "least": 16, "most": 64, "windows": (12, 120), "jump": 0.2}
    assert _core.smooth_windows(turns, usable, options) is None


@pytest.mark.parametrize("length", [16, 37, 64])
def test_sums_of_windows(rng, length):
    phase = np.cumsum(rng.uniform(0.0, 0.9, (13, length)), axis=1) + rng.uniform(-99, 99, (13, 1))
    basis, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, length), 4))
    found = _core.window_sums(phase, np.ascontiguousarray(basis.T), ORDERS)
    for seen, wanted in zip(found, oracle.window_sums(phase, ORDERS), strict=True):
        np.testing.assert_allclose(seen, wanted, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("shape", [(0, 9), (3, 0), (1, 1), (5, 7), (42, 1003)])
def test_gram_matrix(rng, shape):
    rows = rng.normal(size=shape)
    np.testing.assert_allclose(_core.gram(rows), oracle.gram(rows), rtol=1e-12, atol=1e-12)


SETS = ((1, 2, 3, 4, 8), (1,), (3, 6))


@pytest.fixture(params=[1, 127, 128, 129, 1003])
def waves(request, rng):
    """Phases of three sets, as the kernels take them."""
    return {"phase": rng.uniform(-60.0, 60.0, (len(SETS), request.param)), "orders": SETS}


@pytest.mark.parametrize("rows", [0, 1, 3])
def test_sums_of_ripples(rng, waves, rows):
    values = rng.normal(size=(rows, waves["phase"].shape[1]))
    wanted = oracle.ripple_sums(**waves, values=values)
    np.testing.assert_allclose(_core.ripple_sums(waves, values), wanted, rtol=1e-11, atol=1e-11)


def test_values_of_ripples(rng, waves):
    coefficients = rng.normal(size=2 * sum(map(len, SETS)))
    wanted = oracle.ripple_values(**waves, coefficients=coefficients)
    np.testing.assert_allclose(_core.ripple_values(waves, coefficients), wanted, atol=1e-11)


@pytest.mark.parametrize("size", [1, 5, 128, 200, 5000])
def test_scores_of_ripples(rng, waves, size):
    """Groups go on over the blocks of pixels that the kernel computes together."""
    factors = rng.normal(size=waves["phase"].shape)
    mean = rng.normal(size=2 * sum(map(len, SETS)))
    group = np.sort(rng.integers(0, 1 + factors.shape[1] // size, factors.shape[1]))
    wanted = oracle.ripple_scores(**waves, factors=factors, mean=mean, group=group)
    found = _core.ripple_scores(waves, factors, mean, group)
    np.testing.assert_allclose(found, wanted, rtol=1e-10, atol=1e-10)


def test_ripples_of_other_sizes_are_refused(waves):
    count = waves["phase"].shape[1]
    with pytest.raises(ValueError, match="values"):
        _core.ripple_sums(waves, np.zeros((1, count + 1)))
    with pytest.raises(ValueError, match="coefficients"):
        _core.ripple_values(waves, np.zeros(3))
    with pytest.raises(ValueError, match="orders"):
        _core.ripple_values({**waves, "orders": SETS[:2]}, np.zeros(12))


@pytest.mark.parametrize("shape", [(1, 1), (3, 127), (24, 300)])
def test_harmonics_of_columns(rng, shape):
    phase = rng.uniform(-3.2, 3.2, shape).astype(np.float32)
    used = rng.uniform(size=shape) > 0.3
    wanted = oracle.column_harmonics(phase, used, (1, 2, 3, 6))
    phase[~used] = np.nan  # pixels without a phase do not count
    found = _core.column_harmonics(phase, used, (1, 2, 3, 6))
    for seen, expected in zip(found, wanted, strict=True):
        np.testing.assert_allclose(seen, expected, atol=1e-11)
