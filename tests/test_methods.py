"""The contract that every registered method must keep."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fringeworks import InputError, Pair, Reason, analyse, methods, reconstruct
from fringeworks.pair.analyse import get_method
from fringeworks.pair.registry import method
from tests.conftest import scene, true_displacement
from tests.grids import thinned

ALL = list(methods())
IDEAL_LIMIT_PX = {
    "ifa": 0.3,
    "sifa": 0.1,
    "gsifa": 0.01,
    "exact": 0.002,
    "fourier": 0.15,
    "windowed_fourier": 0.15,
    "wavelet": 0.2,
    "windowed": 0.05,
}
"""Largest mean |error| of each method on the ideal scene below (period 20 px), px."""
FLAT_LIMIT_PX = {
    "ifa": 1.0,
    "sifa": 3.0,
    "gsifa": 0.1,
    "exact": 0.05,
    "fourier": 0.2,
    "windowed_fourier": 0.25,
    "wavelet": 0.5,
    "windowed": 0.15,
}
"""The same for a strong response, whose minima are flat, px."""


def ideal(**changes):
    return scene("parabola", **{"size": 240, "fringes": 12, "height_mm": 40.0, **changes})


def mean_error(pair, name):
    result = analyse(pair, name)
    error = result.displacement_px - true_displacement(pair)
    assert np.isnan(error).mean() < 0.02
    return np.nanmean(np.abs(error))


@thinned(name=ALL, sign=[1, -1], axis=["x", "y"])
def test_known_truth(name, sign, axis):
    assert mean_error(ideal(sign=sign, axis=axis), name) < IDEAL_LIMIT_PX[name]


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("sign", [1, -1])
def test_heights_towards_the_camera_are_positive(name, sign):
    surface = reconstruct(ideal(sign=sign), name).surface
    assert surface.unit == "mm"
    assert np.nanmedian(surface.values[110:130, 110:130]) == pytest.approx(40.0, abs=2.0)
    assert np.nanmedian(surface.values[:20]) == pytest.approx(0.0, abs=1.0)


@pytest.mark.parametrize("name", ALL)
def test_the_carrier_is_detected_along_y(name):
    pair = dataclasses.replace(ideal(axis="y"), axis=None)
    result = analyse(pair, name)
    assert result.axis == "y"
    assert result.period_px == pytest.approx(20.0, abs=0.01)


@pytest.mark.parametrize("name", ALL)
def test_masked_pixels_stay_masked(name):
    pair = ideal()
    mask = np.ones(pair.reference.shape, bool)
    mask[40:60, 100:140] = False
    result = analyse(dataclasses.replace(pair, mask=mask), name)
    assert np.isnan(result.displacement_px[~mask]).all()
    assert (result.reason[~mask] == Reason.MASKED).all()
    assert (result.reason[mask] != Reason.MASKED).all()


@pytest.mark.parametrize("name", ALL)
def test_gaps_in_float_frames_are_masked(name):
    pair = ideal(noise=0.5)
    frames = {"reference": pair.reference.copy(), "object": pair.object.copy()}
    frames["object"][50:53, 60:64] = np.nan
    frames["reference"][100:104, 20:30] = np.inf
    result = analyse(dataclasses.replace(pair, **frames), name)
    assert (result.reason[50:53, 60:64] == Reason.MASKED).all()
    assert (result.reason[101:103, 22:28] == Reason.MASKED).all()
    assert np.isfinite(result.displacement_px).mean() > 0.9


@pytest.mark.parametrize("name", ALL)
def test_every_pixel_has_a_value_and_sigma_or_a_reason(name):
    result = analyse(ideal(noise=3.0, bits=8, seed=4), name)
    ok = result.reason == Reason.OK
    assert np.isfinite(result.displacement_px[ok]).all()
    assert (result.sigma_px[ok] > 0).all()
    assert np.isnan(result.displacement_px[~ok]).all()
    assert np.isnan(result.sigma_px[~ok]).all()
    assert set(np.unique(result.reason)) <= set(Reason)


@thinned(strength=1, name=ALL, dtype=[np.uint8, np.uint16, np.float32, np.float64])
def test_dtypes_strides_and_no_mutation(name, dtype):
    pair = ideal(bits=8)
    frames = [pair.reference.astype(dtype), pair.object.astype(dtype)]
    padded = [np.repeat(np.repeat(f, 2, axis=0), 3, axis=1)[::2, ::3] for f in frames]
    backwards = [f[::-1].copy()[::-1] for f in frames]
    expected = analyse(Pair(*frames, axis="x"), name)
    for views in (padded, backwards):
        assert not views[0].flags.c_contiguous
        measured = analyse(Pair(*views, axis="x"), name)
        np.testing.assert_array_equal(measured.displacement_px, expected.displacement_px)
    np.testing.assert_array_equal(frames[0], pair.reference.astype(dtype))
    np.testing.assert_array_equal(frames[1], pair.object.astype(dtype))


@pytest.mark.parametrize("name", ALL)
@settings(max_examples=8, deadline=None, suppress_health_check=list(HealthCheck))
@given(factor=st.floats(0.3, 3.0), offset=st.floats(-20.0, 60.0))
def test_common_factor_and_offset_change_nothing(name, factor, offset):
    pair = ideal(size=120, fringes=6, noise=0.5, seed=2)
    expected = analyse(pair, name).displacement_px
    changed = Pair(offset + factor * pair.reference, offset + factor * pair.object, axis="x")
    measured = analyse(changed, name).displacement_px
    both = np.isfinite(measured) & np.isfinite(expected)
    assert both.mean() > 0.97
    assert np.abs(measured - expected)[both].mean() < 2e-3


@pytest.mark.parametrize("name", ALL)
def test_albedo_and_ambient_light_of_the_object_change_little(name):
    pair = ideal()
    dim = Pair(pair.reference, 12.0 + 0.6 * pair.object, axis="x", geometry=None)
    expected = analyse(pair, name)
    measured = analyse(dim, name)
    both = np.isfinite(measured.displacement_px) & np.isfinite(expected.displacement_px)
    assert both.mean() > 0.97
    assert np.abs(measured.displacement_px - expected.displacement_px)[both].mean() < 0.05


@pytest.mark.parametrize("name", ALL)
@settings(max_examples=6, deadline=None, suppress_health_check=list(HealthCheck))
@given(shift=st.integers(1, 30))
def test_shift_equivariance(name, shift):
    """Shifting the frames along the fringes shifts the result by the same rows."""
    pair = ideal(size=120, fringes=6)
    rolled = Pair(
        np.roll(pair.reference, shift, axis=0), np.roll(pair.object, shift, axis=0), axis="x"
    )
    expected = np.roll(analyse(pair, name).displacement_px, shift, axis=0)
    measured = analyse(rolled, name).displacement_px
    # Rows near the seam have other neighbours.
    away = np.roll(np.arange(120), shift)
    inner = (away > 45) & (away < 75) & (np.arange(120) > 45) & (np.arange(120) < 75)
    if inner.any():
        error = np.abs(measured - expected)[inner]
        assert np.nanmean(error) < 0.02


@pytest.mark.parametrize("name", ALL)
@settings(max_examples=6, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    height=st.floats(5.0, 60.0),
    gamma=st.floats(0.8, 2.4),
    x=st.floats(90.0, 150.0),
)
def test_encode_decode_identity(name, height, gamma, x):
    """The analysis returns the height that the forward model encoded."""
    from fringeworks.simulate.fringes import PairSettings, capture_pair
    from fringeworks.simulate.objects import make_object
    from fringeworks.simulate.scene import STANDARD_GEOMETRY

    body = make_object("parabola", (64, 240), height_mm=height / 5, radius_px=60, centre_px=(x, 32))
    pair = capture_pair(body, STANDARD_GEOMETRY, PairSettings(fringes=12, gamma=gamma))
    # Near γ = 2.4 the minima are flat over ten samples, so only rounding is left to invert.
    limit = IDEAL_LIMIT_PX[name] * 1.5 if gamma < 1.2 else FLAT_LIMIT_PX[name]
    assert mean_error(pair, name) < limit


def test_one_row_is_enough():
    from fringeworks.simulate.fringes import deformed_row
    from fringeworks.simulate.objects import parabola_1d
    from fringeworks.types import ReferencePlaneGeometry

    geometry = ReferencePlaneGeometry(distance_mm=800.0, baseline_mm=300.0)
    row = deformed_row(parabola_1d(height_mm=40.0), geometry)
    pair = Pair(row.reference[None], row.object[None], axis="x", geometry=geometry)
    for name, limit in (("ifa", 1.0), ("sifa", 0.1), ("gsifa", 0.01), ("exact", 1e-4)):
        error = reconstruct(pair, name).surface.values[0] - row.height_mm
        assert np.nanmean(np.abs(error)) < limit, name
    with pytest.raises(InputError, match="at least 8 rows"):
        reconstruct(pair, "windowed")


def test_unknown_method_and_option():
    pair = ideal()
    with pytest.raises(InputError, match=r"expected one of .*gsifa"):
        analyse(pair, "magic")
    with pytest.raises(InputError, match="unknown option speed"):
        analyse(pair, "gsifa", speed=3)
    with pytest.raises(InputError, match="n_resample"):
        analyse(pair, "gsifa", n_resample=0)
    with pytest.raises(InputError, match="degree"):
        analyse(pair, "ifa", degree=99)
    with pytest.raises(InputError, match="max_displacement_px"):
        analyse(pair, "exact", max_displacement_px=-1.0)
    with pytest.raises(InputError, match="width"):
        analyse(pair, "fourier", width=2.0)
    with pytest.raises(InputError, match="dimensions"):
        analyse(pair, "fourier", dimensions=3)


def test_a_new_method_is_one_function(monkeypatch):
    from fringeworks.pair import registry

    monkeypatch.setattr(registry, "REGISTERED", dict(registry.REGISTERED))

    @method("nothing")
    def nothing(pair, *, depth: int = 1):  # noqa: ARG001
        """Measures nothing."""
        empty = np.full(pair.reference.shape, np.nan)
        return registry.Solution(empty, empty, empty, np.zeros(empty.shape, np.uint8))

    assert get_method("nothing").summary == "Measures nothing."
    assert get_method("nothing").options == {"depth": 1}
    phase = analyse(ideal(), "nothing")
    assert (phase.reason == Reason.UNDETERMINED).all()
