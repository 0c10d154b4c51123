"""Inverse function analysis: kernels against SciPy oracles, and the dissertation's errors."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import Pair, Reason, _core, analyse, reconstruct
from fringeworks.evaluate.truth_errors import errors
from fringeworks.pair.methods.inverse_function import find_extrema
from fringeworks.signal.gamma import estimate_gamma
from tests.conftest import scene
from tests.oracles import inverse_function as oracle


def rows(gamma=1.0, n=300, period=30.0, height=5.0):
    x = np.arange(n, dtype=float)
    u = height * np.exp(-(((x - 150) / 50) ** 2))
    wave = lambda t: 255 * (0.5 + 0.5 * np.cos(2 * np.pi * (t - 4.3) / period)) ** gamma  # noqa: E731
    return wave(x), wave(x - u), u


def invert(reference, object_, method, period=30.0):
    return _core.invert_rows(
        np.ascontiguousarray(reference[None]),
        np.ascontiguousarray(object_[None]),
        np.ones((1, reference.size), np.uint8),
        {
            "method": method,
            "degree": 9,
            "n_resample": 10,
            "period": period,
            "prominence": 0.3,
            "floor": 0.0,
            "noise": 0.1,
            "max_displacement": 4 * period,
            "tolerance": 0.05,
            "albedo_tolerance": np.inf,
        },
    )


@pytest.mark.parametrize("method", ["sifa", "gsifa", "exact"])
@pytest.mark.parametrize("gamma", [1.0, 1.5])
def test_kernels_agree_with_their_oracles(method, gamma):
    s, d, _ = rows(gamma)
    found = invert(s, d, method)[0][0]
    expected = oracle.invert_row(s, d, 30.0, method)
    assert np.isnan(found).sum() == np.isnan(expected).sum() == 0
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_ifa_agrees_with_polyfit_of_the_chosen_degree():
    """A part whose position is linear in the intensity is inverted exactly."""
    x = np.arange(200.0)
    period = 40.0
    triangle = np.abs((x + 7) % period - period / 2)  # straight flanks: x is linear in I
    u = invert(triangle, triangle, "ifa", period)[0][0]
    inner = np.s_[30:170]
    away = (triangle > 2) & (triangle < 18)
    assert np.abs(u[inner][away[inner]]).max() < 1e-6


def test_extrema_agree_with_the_oracle():
    _, d, _ = rows()
    expected = np.array(oracle.extrema(d, 30.0))
    found = find_extrema(d, 30.0)
    np.testing.assert_allclose(found.position_px, expected[:, 0], atol=1e-9)
    np.testing.assert_allclose(found.value, expected[:, 1], atol=1e-9)
    assert (np.diff(found.is_maximum.astype(int)) != 0).all()


@pytest.mark.parametrize("seed", range(5))
def test_extrema_survive_noise_quantisation_and_plateaus(seed):
    rng = np.random.default_rng(seed)
    x = np.arange(1000.0)
    row = 255 * (0.5 + 0.5 * np.cos(2 * np.pi * (x - 30) / 100)) ** 2.2
    noisy = np.clip(np.rint(row + 3 * rng.standard_normal(x.size)), 0, 230)  # saturated at 230
    found = find_extrema(noisy, 100.0, noise=3.0)
    # The first and the last half period are cut off by the frame.
    inner = (found.position_px > 25) & (found.position_px < 955)
    expected = np.arange(30, 950, 50.0)
    assert inner.sum() == expected.size
    assert np.abs(found.position_px[inner] - expected).max() < 10
    assert (found.is_maximum[inner] == (np.arange(expected.size) % 2 == 0)).all()


def test_numbers_of_extrema_may_differ():
    """A hidden fringe affects its surroundings only, not the rest of the row."""
    s, _, _ = rows()
    d = s.copy()
    d[120:150] = np.linspace(d[120], d[150], 30)
    u, _, _, reason = (a[0] for a in invert(s, d, "exact"))
    away = np.r_[0:100, 170:300]
    assert (reason[away] == Reason.OK).all()
    assert np.abs(u[away]).max() < 0.05


def test_points_beyond_the_reference_frame_are_outside():
    x = np.arange(200.0)
    s = 100 + 50 * np.cos(2 * np.pi * (x - 5) / 40)
    d = 100 + 50 * np.cos(2 * np.pi * (x - 5 - 17) / 40)
    u, _, _, reason = (a[0] for a in invert(s, d, "exact", 40.0))
    assert reason[2] == Reason.OUTSIDE
    assert np.isnan(u[2])
    np.testing.assert_allclose(u[30:180], 17.0, atol=1e-2)


def test_object_without_fringes():
    s, _, _ = rows()
    *_, reason = invert(s, np.linspace(100, 110, s.size), "gsifa")
    assert (reason == Reason.LOW_MODULATION).all()


def standard_errors(method, gamma=1.0):
    """Errors of a method on the ideal standard scene."""
    pair = scene("parabola", gamma=gamma)
    return errors(reconstruct(pair, method).surface, pair.truth_mm)


def test_published_errors_are_reached():
    """The ideal standard scene (theory §3)."""
    found = {name: standard_errors(name) for name in ("ifa", "sifa", "gsifa", "exact")}
    assert found["gsifa"].mean_abs_error_mm <= 0.0023
    assert found["gsifa"].std_error_mm <= 0.0188
    assert (
        found["gsifa"].mean_abs_error_mm
        < found["sifa"].mean_abs_error_mm
        < found["ifa"].mean_abs_error_mm
    )
    assert 0.1 <= found["ifa"].mean_abs_error_mm <= 1.0
    assert found["exact"].mean_abs_error_mm <= 0.0001
    assert found["exact"].std_error_mm <= 0.001
    assert all(f.failed_fraction < 0.002 for f in found.values())


@pytest.mark.parametrize("method", ["gsifa", "exact"])
def test_published_errors_are_reached_with_a_strong_response(method):
    """γ = 2.2 as in the dissertation's files: the response is linearised before the inversion."""
    found = standard_errors(method, gamma=2.2)
    assert found.mean_abs_error_mm <= 0.0023
    assert found.std_error_mm <= 0.0188


def test_response_is_not_linearised_with_noise_or_another_albedo():
    clean = scene("parabola", size=240, fringes=12, gamma=2.2)
    assert analyse(clean, "exact").details["linearised_gamma"] == pytest.approx(2.2, abs=0.05)
    ideal = scene("parabola", size=240, fringes=12)
    assert analyse(ideal, "exact").details["linearised_gamma"] == 1.0
    noisy = scene("parabola", size=240, fringes=12, gamma=2.2, noise=1.0)
    assert analyse(noisy, "exact").details["linearised_gamma"] == 1.0
    dim = Pair(clean.reference, 20 + 0.5 * clean.object, axis="x")
    assert analyse(dim, "exact").details["linearised_gamma"] == 1.0


@pytest.mark.parametrize("gamma", [0.7, 1.0, 1.645, 2.2])
def test_exponent_is_estimated(gamma):
    wave = 0.5 + 0.5 * np.cos(2 * np.pi * (np.arange(500.0) - 3) / 37)
    assert estimate_gamma(np.tile(wave**gamma, (3, 1)), 37.0) == pytest.approx(gamma, abs=0.02)
