"""Windowed Fourier filter and ridge: oracles, noise, borders, and quadratic phase."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import InputError
from fringeworks.pair import windowed_fourier_filter, windowed_fourier_ridge
from fringeworks.pair.lattice import Lattice
from tests.oracles import windowed_fourier as oracle

CURVATURE = 0.0018


def four_step_field(n, noise, seed=0, curvature=CURVATURE):
    """Complex field of four noisy frames of a quadratic phase, and that phase."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:n, :n] - n / 2
    phase = 0.5 * curvature * (x**2 + y**2)
    frames = [np.cos(phase - k * np.pi / 2) + noise * rng.standard_normal((n, n)) for k in range(4)]
    field = 0.5 * ((frames[0] - frames[2]) + 1j * (frames[1] - frames[3]))
    return field.astype(np.complex64), phase


def error(phasor, phase, border=20):
    inner = slice(border, -border)
    return np.angle(phasor * np.exp(-1j * phase))[inner, inner]


@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_filter_agrees_with_its_oracle(noise):
    field, _ = four_step_field(90, noise, curvature=0.004)
    settings = {"sigma": 6.0, "limit": 0.4, "step": 0.1}
    expected = oracle.wff(field, threshold=2.0, **settings)
    lattice = Lattice(field.shape, 6.0, 0.4, 0.1)
    found = lattice.filtered(lattice.pad(field), 2.0)
    # The lattice applies the threshold at fewer points than the oracle.
    assert np.abs(found[:90, :90] - expected).max() < 0.02 * np.abs(expected).max()


def test_ridge_agrees_with_its_oracle():
    """At a frequency of the grid and without curvature, no correction applies."""
    y, x = np.mgrid[:90, :80]
    field = 3.0 * np.exp(1j * (0.2 * x - 0.3 * y + 0.4))
    value, frequency = oracle.wfr(field, 6.0, 0.4, 0.1)
    found = windowed_fourier_ridge(field, sigma_px=6.0, limit=0.4, step=0.1)
    inner = (slice(20, -20), slice(20, -20))
    np.testing.assert_allclose(np.angle(found.phasor * np.conj(value))[inner], 0, atol=2e-3)
    np.testing.assert_allclose(found.frequency_y[inner], frequency[0][inner], atol=2e-3)
    np.testing.assert_allclose(found.frequency_x[inner], frequency[1][inner], atol=2e-3)
    np.testing.assert_allclose(np.abs(found.phasor)[inner], 3.0, rtol=5e-3)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("noise", "limit"), [(0.3, 0.016), (1.0, 0.0385)])
def test_filter_on_four_noisy_frames(noise, limit, seed):
    field, phase = four_step_field(512, noise, seed)
    found = error(windowed_fourier_filter(field), phase)
    assert np.sqrt(np.mean(found**2)) < limit


@pytest.mark.parametrize("seed", range(3))
def test_ridge_on_four_noisy_frames(seed):
    field, phase = four_step_field(512, 1.0, seed)
    found = error(windowed_fourier_ridge(field).phasor, phase)
    assert np.sqrt(np.mean(found**2)) < 0.024
    assert abs(found.mean()) < 0.002


def test_border_is_as_good_as_the_inside():
    y, x = np.mgrid[:200, :240]
    wave = np.exp(1j * (0.02 * x - 0.11 * y))
    assert np.abs(error(windowed_fourier_ridge(wave).phasor, np.angle(wave), 1)).max() < 0.02
    field, phase = four_step_field(256, 0.3)
    whole = np.angle(windowed_fourier_ridge(field).phasor * np.exp(-1j * phase))
    assert np.sqrt(np.mean(whole**2)) < 0.016


@pytest.mark.parametrize(("cxx", "cyy", "cxy"), [(0.003, -0.002, 0), (0.002, 0.001, 0.001)])
def test_curvature_bias_vanishes_on_a_quadratic_phase(cxx, cyy, cxy):
    y, x = np.mgrid[:300, :300] - 150.0
    phase = 0.5 * (cxx * x**2 + cyy * y**2) + cxy * x * y
    raw = 0.5 * (np.arctan(100 * cxx) + np.arctan(100 * cyy))
    found = error(windowed_fourier_ridge(np.exp(1j * phase)).phasor, phase, 50)
    assert abs(found.mean()) < 1e-3
    assert np.abs(found).max() < 0.01
    if cxy == 0:
        value, _ = oracle.wfr(np.exp(1j * phase)[100:200, 100:200], 10.0, 0.5, 0.1)
        centre = error(value, phase[100:200, 100:200], 45)
        assert centre.mean() == pytest.approx(raw, abs=0.03)


def test_real_fringes():
    """With their carrier as the centre, real fringes yield their analytic signal."""
    y, x = np.mgrid[:256, :256]
    phase = 2 * np.pi * (x / 8.0 + y / 40.0) + 2.0 * np.exp(
        -((x - 128) ** 2 + (y - 128) ** 2) / 3000
    )
    rng = np.random.default_rng(0)
    fringes = 2.0 * np.cos(phase) + 0.2 * rng.standard_normal(x.shape)
    centre = (1 / 8.0, 1 / 40.0)
    for found in (
        windowed_fourier_filter(fringes, centre=centre),
        windowed_fourier_ridge(fringes, centre=centre).phasor,
    ):
        assert np.sqrt(np.mean(error(found, phase) ** 2)) < 0.03
    ridge = windowed_fourier_ridge(fringes, centre=centre)
    assert np.median(ridge.frequency_x) == pytest.approx(2 * np.pi / 8, abs=2e-3)


@pytest.mark.parametrize("function", [windowed_fourier_filter, windowed_fourier_ridge])
def test_bad_input(function):
    field = np.ones((40, 40), complex)
    for bad, message in (
        (np.ones(5), "field: expected shape"),
        (np.full((40, 40), np.nan), "finite values"),
        (np.full((40, 40), np.inf), "finite values"),
        (np.array([["a"]]), "expected numbers"),
    ):
        with pytest.raises(InputError, match=message):
            function(bad)
    for option in ({"sigma_px": 0.1}, {"limit": 4.0}, {"step": 0.0}):
        with pytest.raises(InputError, match=next(iter(option))):
            function(field, **option)
    for shape in ((1, 50), (50, 1), (1, 1)):
        assert np.isfinite(np.asarray(function(np.ones(shape))[0])).all()
