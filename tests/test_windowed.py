"""Windowed inversion: the kernel against its oracle, accuracy, σ and reasons."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import InputError, Pair, Reason, _core, analyse, reconstruct
from fringeworks.evaluate.truth_errors import errors
from fringeworks.pair.methods.window_start import start_field
from fringeworks.pair.prepared import prepare
from fringeworks.pair.reference_plane import to_surface
from fringeworks.pair.windows import smooth_reference, spline_coefficients
from tests.conftest import scene, true_displacement
from tests.grids import quick, thinned
from tests.oracles import windowed as oracle
from tests.oracles.windowed import LIMITS, options_of, pair_of
from tests.two_frames import Bench


def _problem(size=(60, 90), period=20.0, seed=3):
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: size[0], : size[1]].astype(float)
    u = 2.0 * np.exp(-((x - 45) ** 2 + (y - 30) ** 2) / 800.0)
    s = np.cos(2 * np.pi * x / period) + 0.02 * rng.standard_normal(size)
    d = 0.05 + 0.8 * np.cos(2 * np.pi * (x - u) / period) + 0.016 * rng.standard_normal(size)
    return spline_coefficients(s), d.astype(np.float32), u


@thinned(strength=1, scales=[(8.0,), (3.0,), (8.0, 4.0, 2.0)], iterations=[1, 2])
def test_kernel_agrees_with_its_oracle(scales, iterations):
    spline, d, _ = _problem()
    start = np.zeros(d.shape, np.float32)
    solved = _core.invert_windowed(pair_of(spline, d), start, options_of(scales, iterations))
    expected = oracle.invert(
        spline.astype(float),
        d.astype(float),
        start.astype(float),
        scales,
        iterations,
        20.0,
        2.5,
        LIMITS,
    )
    assert solved[7] == pytest.approx(expected[5], rel=1e-3)
    same = solved[6] == expected[4]
    assert same.mean() > 0.995  # ties at a threshold may differ
    for k, map_ in ((0, 0), (1, 1), (2, 2), (5, 3)):
        np.testing.assert_allclose(
            solved[k][same], expected[map_][same], rtol=1e-3, atol=2e-4, equal_nan=True
        )


def test_kernel_measures_the_truth_within_its_sigma():
    spline, d, u = _problem(size=(120, 160))
    displacement, sigma, modulation_ratio, *_ = _core.invert_windowed(
        pair_of(spline, d), np.zeros(d.shape, np.float32), options_of([16.0, 8.0, 4.0, 2.0], 2)
    )
    inner = np.s_[10:-10, 10:-10]
    error = (displacement - u)[inner]
    assert np.abs(error).mean() < 0.03
    assert np.median(modulation_ratio[inner]) == pytest.approx(0.8, abs=0.005)
    assert 0.45 < np.mean(np.abs(error) <= sigma[inner]) < 0.9


@pytest.mark.parametrize("fringes", [10, pytest.param(40, marks=pytest.mark.long)])
@pytest.mark.parametrize("gamma", quick([1.0, 2.2], 2.2))
def test_error_is_half_of_fouriers_on_a_noisy_scene(fringes, gamma):
    """The standard scene with 8 bit and a noise of 2 counts."""
    for seed in (1, 7):
        pair = scene(
            "parabola", height_mm=30.0, fringes=fringes, gamma=gamma, noise=2.0, bits=8, seed=seed
        )
        prepared = prepare(pair)
        windowed, fourier = (
            errors(to_surface(analyse(prepared, method), pair.geometry), pair.truth_mm)
            for method in ("windowed", "fourier")
        )
        assert windowed.failed_fraction < 0.01
        assert windowed.mean_abs_error_mm <= 0.5 * fourier.mean_abs_error_mm
        assert windowed.within_1_sigma > 0.5


def test_cliffs_are_not_smeared():
    """A cube: no wrong order, and no error away from the edges."""
    pair = scene("cube", size=500, gamma=2.2, noise=2.0, bits=8, seed=1)
    surface = reconstruct(pair).surface
    windowed = errors(surface, pair.truth_mm)
    fourier = errors(reconstruct(pair, "fourier").surface, pair.truth_mm)
    assert windowed.inner_mean_abs_error_mm < 0.6 * fourier.inner_mean_abs_error_mm
    assert windowed.edge_mean_abs_error_mm < fourier.edge_mean_abs_error_mm
    far = np.abs(surface.values - pair.truth_mm)[150:350, 150:350]
    assert far.max() < 2.0


def test_smoothing_keeps_the_fringe():
    x = np.arange(200.0)
    fringe = np.tile(
        100 + 50 * np.cos(2 * np.pi * x / 20) + 15 * np.cos(4 * np.pi * x / 20), (50, 1)
    )
    smooth = smooth_reference(fringe, 20 / 30)
    # Near the border the filter uses reflected data; inside, only its own error remains.
    assert np.abs(smooth - fringe)[:, 30:-30].max() < 0.005
    noise = np.random.default_rng(0).standard_normal((200, 200))
    assert smooth_reference(noise, 2.0).std() < 0.3


def test_start_is_finite_everywhere():
    pair = scene("parabola", size=200, fringes=10, noise=1.0, bits=8)
    dark = pair.object.copy()
    dark[80:120, 80:120] = 0
    prepared = prepare(Pair(pair.reference, dark, axis="x"))
    assert np.isfinite(start_field(prepared, 8.0).displacement_px).all()


def test_shadow_is_not_measured():
    pair = scene("parabola", size=300, fringes=15, noise=1.0, bits=8, height_mm=30.0)
    rng = np.random.default_rng(0)
    dark = pair.object.copy()
    dark[100:200, 120:180] = rng.integers(3, 6, (100, 60))
    result = analyse(Pair(pair.reference, dark, axis="x"))
    shadow = result.reason[125:175, 140:160]
    assert np.isnan(result.displacement_px[125:175, 140:160]).all()
    assert (shadow == Reason.LOW_MODULATION).all()
    assert np.isfinite(result.displacement_px[:60]).all()


def test_saturated_patch_has_its_reason():
    pair = scene("parabola", size=300, fringes=15, noise=1.0, bits=8, height_mm=30.0)
    bright = pair.object.copy()
    bright[100:200, 120:200] = 255
    result = analyse(Pair(pair.reference, bright, axis="x"))
    assert (result.reason[130:170, 145:175] == Reason.SATURATED).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"scales": []}, "scales"),
        ({"scales": [2.0, 8.0]}, "scales"),
        ({"scales": [0.1]}, "scales"),
        ({"iterations": 0}, "iterations"),
        ({"confidence": 0.0}, "confidence"),
    ],
)
def test_bad_options_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        analyse(scene("parabola", size=100, fringes=10), "windowed", **options)


def test_single_scale_and_iterations():
    pair = scene("parabola", size=200, fringes=20, noise=1.0, bits=8, height_mm=30.0)
    result = analyse(pair, "windowed", scales=[6.0], iterations=3)
    assert set(np.unique(result.iterations)) == {3}
    error = result.displacement_px - true_displacement(pair)
    assert np.nanmean(np.abs(error)) < 0.05


@pytest.mark.parametrize("height", [6.0, 14.0])
def test_creases_of_low_contrast_are_within_sigma(height):
    """Fringes of 7 counts with a noise of 1.5: windows do not give back what the start smooths."""

    def tent(x, y):
        return height * np.maximum(0.0, 1.0 - np.maximum(np.abs(x + 5.0), np.abs(y)) / 34.0)

    inside = []
    for seed in (21, 22):
        bench = Bench(shape=(170, 230), period=14.0, contrast=0.1, light=78.0, noise=1.5, seed=seed)
        reference, object_, u, lit = bench.pair(tent)
        found = analyse(Pair(reference, object_, axis="x"))
        lit[:8] = lit[-8:] = lit[:, :8] = lit[:, -8:] = False
        inside.append(np.abs(found.displacement_px - u)[lit] / found.sigma_px[lit])
    z = np.concatenate(inside)
    assert np.mean(z < 2) >= 0.9
    assert np.mean(z > 5) <= 0.005
