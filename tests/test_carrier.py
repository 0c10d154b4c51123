"""The carrier: accurate below one bin in any direction, and refused where it cannot be measured."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fringeworks import InputError, Pair, analyse
from fringeworks.pair.carrier import find_carrier


def wave(fx, fy, shape=(200, 260), noise=0.0, seed=0):
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: shape[0], : shape[1]]
    clean = 100 + 60 * np.cos(2 * np.pi * (fx * x + fy * y) + 0.6)
    return clean + noise * rng.standard_normal(shape)


@settings(max_examples=40, deadline=None)
@given(period=st.floats(6.0, 40.0), angle=st.floats(-40.0, 40.0), axis=st.sampled_from("xy"))
def test_any_direction_sub_bin(period, angle, axis):
    fast, slow = np.cos(np.radians(angle)) / period, np.sin(np.radians(angle)) / period
    frame = wave(fast, slow) if axis == "x" else wave(slow, fast)
    carrier = find_carrier(frame)
    assert carrier.axis == axis
    assert 1 / carrier.period_px == pytest.approx(fast, abs=3e-5)
    assert carrier.cross_frequency == pytest.approx(slow, abs=3e-5)
    assert carrier.tilt_deg == pytest.approx(angle, abs=0.2)


def test_noise_and_shading():
    y, x = np.mgrid[:200, :260]
    frame = wave(1 / 13.3, 0.01, noise=20.0) + 0.004 * (x - 90.0) ** 2 + 0.4 * y
    carrier = find_carrier(frame)
    assert carrier.period_px == pytest.approx(13.3, abs=0.01)
    assert carrier.cross_frequency == pytest.approx(0.01, abs=2e-5)


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        (wave(0.4, 0.0), "got a period of 2.5 px"),
        (wave(2 / 260, 0.0), r"\d\.\d periods"),
        (np.full((50, 50), 3.0), "got the constant 3"),
        (np.random.default_rng(0).standard_normal((200, 200)), "no dominant line"),
        (np.random.default_rng(0).random((40, 1)), "expected fringes"),
    ],
)
def test_frames_without_a_measurable_carrier_are_refused(frame, message):
    with pytest.raises(InputError, match=message):
        find_carrier(frame)


@pytest.mark.parametrize("method", ["fourier", "windowed_fourier", "wavelet", "windowed"])
def test_tilted_fringes_are_measured(method):
    y, x = np.mgrid[:240, :240].astype(float)
    u = 4.0 * np.exp(-((x - 120) ** 2 + (y - 120) ** 2) / 3000)

    def frame(shift):
        return 120 + 100 * np.cos(2 * np.pi * ((x - shift) / 16 + y / 45))

    result = analyse(Pair(frame(0.0), frame(u)), method)
    assert result.axis == "x"
    assert result.tilt_deg == pytest.approx(np.degrees(np.arctan(16 / 45)), abs=0.1)
    error = result.displacement_px - u
    assert np.nanmean(np.abs(error)) < 0.08
    assert np.isnan(error).mean() < 0.02
