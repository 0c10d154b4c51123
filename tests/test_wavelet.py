"""Wavelet ridges: agreement with their oracle, bias, noise and refused input."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import InputError, analyse
from fringeworks.pair import wavelet_frequencies, wavelet_ridge
from tests.conftest import scene, true_displacement


def bump_frame(n=512, seed=0, noise=0.1, height=6.0):
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:n, :n].astype(float)
    centre = n / 2
    bump = height * np.exp(-((x - centre) ** 2 + (y - centre) ** 2) / (2 * 80.0**2))
    phase = 2 * np.pi * x / 16 + bump
    return np.cos(phase) + noise * rng.standard_normal(x.shape), phase


def error(phasor, phase, border=20):
    wrapped = np.angle(phasor * np.exp(-1j * phase))
    return wrapped[:, border:-border]


def transform(row, frequencies, omega):
    """Readable twin: coefficients (scale, sample) of one row, from the definition."""
    n = row.size
    x = np.arange(n)
    out = np.empty((len(frequencies), n), complex)
    for k, f in enumerate(frequencies):
        a = omega / (2 * np.pi * f)
        for b in range(n):
            t = (x - b) / a
            window = np.exp(-0.5 * t**2 + 1j * omega * t)
            out[k, b] = 2 * np.sum(row * np.conj(window)) / (a * np.sqrt(2 * np.pi))
    return out


def test_kernel_agrees_with_its_oracle():
    """A plane wave has no curvature, so no correction applies."""
    x = np.arange(256)
    row = 2.0 * np.cos(2 * np.pi * x / 15.3 + 0.7)
    frequencies = wavelet_frequencies(1 / 16, 24)
    coefficients = transform(row, frequencies, 6.0)
    best = np.abs(coefficients).argmax(axis=0)
    expected = coefficients[best, x]
    phasor, frequency = wavelet_ridge(row[None], frequencies=frequencies)
    inner = slice(90, -90)
    np.testing.assert_allclose(np.angle(phasor[0] * np.conj(expected))[inner], 0, atol=3e-3)
    np.testing.assert_allclose(frequency[0][inner], 2 * np.pi / 15.3, rtol=3e-3)
    np.testing.assert_allclose(np.abs(phasor[0])[inner], 2.0, rtol=3e-3)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("smooth_path", [False, True])
def test_phase_bump_in_noise(seed, smooth_path):
    frame, phase = bump_frame(seed=seed)
    phasor, _ = wavelet_ridge(
        frame, frequencies=wavelet_frequencies(1 / 16, span=1.8), smooth_path=smooth_path
    )
    assert np.sqrt(np.mean(error(phasor, phase) ** 2)) < 0.028


def test_no_sub_sample_bias():
    """The mean phase error of a plane wave vanishes for any period and phase."""
    rng = np.random.default_rng(0)
    x = np.arange(400)
    for period in rng.uniform(6.0, 30.0, 8):
        phases = rng.uniform(-np.pi, np.pi, (5, 1))
        truth = 2 * np.pi * x / period + phases
        phasor, _ = wavelet_ridge(np.cos(truth), frequencies=wavelet_frequencies(1 / 14.0, 32, 3.0))
        inner = error(phasor, truth, 100)
        assert abs(inner.mean()) < 1e-3
        assert np.abs(inner).max() < 0.01


def test_smooth_path_bridges_a_burst_of_noise():
    frame, phase = bump_frame(64, noise=0.05, height=1.0)
    rng = np.random.default_rng(1)
    frame = np.tile(frame, (1, 8))[:, :512]
    phase = np.tile(phase, (1, 8))[:, :512]
    x = np.arange(512)
    frame[:, 250:262] += 6.0 * np.cos(2 * np.pi * x[250:262] / 9.0) * rng.choice([-1, 1], (64, 1))
    frequencies = wavelet_frequencies(1 / 16, span=2.0)
    _, plain = wavelet_ridge(frame, frequencies=frequencies)
    _, smooth = wavelet_ridge(frame, frequencies=frequencies, smooth_path=True)
    burst = slice(246, 266)
    spread = [np.abs(f[:, burst] - 2 * np.pi / 16).mean() for f in (plain, smooth)]
    assert spread[1] <= spread[0]


@pytest.mark.parametrize("options", [{"dimensions": 2}, {"path": "smooth"}, {"omega": 8.0}])
def test_every_option_measures(options):
    pair = scene("parabola", size=240, fringes=24, height_mm=20.0, noise=1.0, bits=8, seed=1)
    result = analyse(pair, "wavelet", **options)
    error_px = result.displacement_px - true_displacement(pair)
    assert np.isnan(error_px).mean() < 0.02
    assert np.nanmean(np.abs(error_px)) < 0.12


def test_bad_input():
    row = np.ones((1, 64))
    good = wavelet_frequencies(1 / 16)
    for frame in (np.ones(5), np.full((2, 64), np.nan), np.ones((2, 64), complex), np.ones((0, 4))):
        with pytest.raises(InputError, match="frame: expected"):
            wavelet_ridge(frame, frequencies=good)
    for frequencies in (good[:2], good[::-1], good * 20, np.array([0.1, 0.2, 0.3])):
        with pytest.raises(InputError, match="frequencies: expected"):
            wavelet_ridge(row, frequencies=frequencies)
    with pytest.raises(InputError, match="omega: expected"):
        wavelet_ridge(row, frequencies=good, omega=1.0)
    pair = scene("parabola", size=240, fringes=24, height_mm=20.0, noise=1.0, bits=8, seed=1)
    for option in ({"dimensions": 3}, {"path": "magic"}, {"omega": 100.0}):
        with pytest.raises(InputError, match=next(iter(option))):
            analyse(pair, "wavelet", **option)
    for shape in ((50, 1), (1, 2), (1, 1)):
        assert np.isfinite(wavelet_ridge(np.ones(shape), frequencies=good)[0]).all()
