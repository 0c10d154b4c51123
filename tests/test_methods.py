"""The contract that every registered method keeps."""

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

ALL = list(methods())
# Mean |error| in px that a method must keep on the ideal scene below (period 20 px).
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
# The same with the flat minima of a strong response.
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


def ideal(**changes):
    return scene("parabola", **{"size": 240, "fringes": 12, "height_mm": 40.0, **changes})


def mean_error(capture, name):
    phase = analyse(capture, name)
    error = phase.displacement_px - true_displacement(capture)
    assert np.isnan(error).mean() < 0.02
    return np.nanmean(np.abs(error))


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("axis", ["x", "y"])
def test_known_truth(name, sign, axis):
    assert mean_error(ideal(sign=sign, axis=axis), name) < IDEAL_LIMIT_PX[name]


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("sign", [1, -1])
def test_nearer_the_camera_comes_out_positive(name, sign):
    surface = reconstruct(ideal(sign=sign), name).surface
    assert surface.unit == "mm"
    assert np.nanmedian(surface.values[110:130, 110:130]) == pytest.approx(40.0, abs=2.0)
    assert np.nanmedian(surface.values[:20]) == pytest.approx(0.0, abs=1.0)


@pytest.mark.parametrize("name", ALL)
def test_carrier_is_found_along_either_axis(name):
    capture = dataclasses.replace(ideal(axis="y"), axis=None)
    phase = analyse(capture, name)
    assert phase.axis == "y"
    assert phase.period_px == pytest.approx(20.0, abs=0.01)


@pytest.mark.parametrize("name", ALL)
def test_masked_pixels_stay_masked(name):
    capture = ideal()
    mask = np.ones(capture.reference.shape, bool)
    mask[40:60, 100:140] = False
    phase = analyse(dataclasses.replace(capture, mask=mask), name)
    assert np.isnan(phase.displacement_px[~mask]).all()
    assert (phase.reason[~mask] == Reason.MASKED).all()
    assert (phase.reason[mask] != Reason.MASKED).all()


@pytest.mark.parametrize("name", ALL)
def test_gaps_in_float_frames_are_masked(name):
    capture = ideal(noise=0.5)
    frames = {"reference": capture.reference.copy(), "object": capture.object.copy()}
    frames["object"][50:53, 60:64] = np.nan
    frames["reference"][100:104, 20:30] = np.inf
    phase = analyse(dataclasses.replace(capture, **frames), name)
    assert (phase.reason[50:53, 60:64] == Reason.MASKED).all()
    assert (phase.reason[101:103, 22:28] == Reason.MASKED).all()
    assert np.isfinite(phase.displacement_px).mean() > 0.9


@pytest.mark.parametrize("name", ALL)
def test_every_pixel_has_a_value_and_sigma_or_a_reason(name):
    phase = analyse(ideal(noise=3.0, bits=8, seed=4), name)
    ok = phase.reason == Reason.OK
    assert np.isfinite(phase.displacement_px[ok]).all()
    assert (phase.sigma_px[ok] > 0).all()
    assert np.isnan(phase.displacement_px[~ok]).all()
    assert np.isnan(phase.sigma_px[~ok]).all()
    assert set(np.unique(phase.reason)) <= set(Reason)


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64])
def test_dtypes_strides_and_no_mutation(name, dtype):
    capture = ideal(bits=8)
    frames = [capture.reference.astype(dtype), capture.object.astype(dtype)]
    padded = [np.repeat(np.repeat(f, 2, axis=0), 3, axis=1)[::2, ::3] for f in frames]
    backwards = [f[::-1].copy()[::-1] for f in frames]
    expected = analyse(Pair(*frames, axis="x"), name)
    for views in (padded, backwards):
        assert not views[0].flags.c_contiguous
        found = analyse(Pair(*views, axis="x"), name)
        np.testing.assert_array_equal(found.displacement_px, expected.displacement_px)
    np.testing.assert_array_equal(frames[0], capture.reference.astype(dtype))
    np.testing.assert_array_equal(frames[1], capture.object.astype(dtype))


@pytest.mark.parametrize("name", ALL)
@settings(max_examples=8, deadline=None, suppress_health_check=list(HealthCheck))
@given(gain=st.floats(0.3, 3.0), offset=st.floats(-20.0, 60.0))
def test_common_gain_and_offset_change_nothing(name, gain, offset):
    capture = ideal(size=120, fringes=6, noise=0.5, seed=2)
    expected = analyse(capture, name).displacement_px
    changed = Pair(offset + gain * capture.reference, offset + gain * capture.object, axis="x")
    found = analyse(changed, name).displacement_px
    both = np.isfinite(found) & np.isfinite(expected)
    assert both.mean() > 0.97
    assert np.abs(found - expected)[both].mean() < 2e-3


@pytest.mark.parametrize("name", ALL)
def test_albedo_and_ambient_light_of_the_object_hardly_matter(name):
    capture = ideal()
    dim = Pair(capture.reference, 12.0 + 0.6 * capture.object, axis="x", geometry=None)
    expected = analyse(capture, name)
    found = analyse(dim, name)
    both = np.isfinite(found.displacement_px) & np.isfinite(expected.displacement_px)
    assert both.mean() > 0.97
    assert np.abs(found.displacement_px - expected.displacement_px)[both].mean() < 0.05


@pytest.mark.parametrize("name", ALL)
@settings(max_examples=6, deadline=None, suppress_health_check=list(HealthCheck))
@given(shift=st.integers(1, 30))
def test_shift_equivariance(name, shift):
    """Rows moved along the fringes move the result with them."""
    capture = ideal(size=120, fringes=6)
    rolled = Pair(
        np.roll(capture.reference, shift, axis=0), np.roll(capture.object, shift, axis=0), axis="x"
    )
    expected = np.roll(analyse(capture, name).displacement_px, shift, axis=0)
    found = analyse(rolled, name).displacement_px
    # Rows near the seam see different neighbours.
    away = np.roll(np.arange(120), shift)
    inner = (away > 45) & (away < 75) & (np.arange(120) > 45) & (np.arange(120) < 75)
    if inner.any():
        error = np.abs(found - expected)[inner]
        assert np.nanmean(error) < 0.02


@pytest.mark.parametrize("name", ALL)
@settings(max_examples=6, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    height=st.floats(5.0, 60.0),
    gamma=st.floats(0.8, 2.4),
    x=st.floats(90.0, 150.0),
)
def test_encode_decode_identity(name, height, gamma, x):
    """What the forward model encodes, the analysis decodes."""
    from fringeworks.simulate import STANDARD_GEOMETRY, PairSettings, capture_pair, make_object

    body = make_object("parabola", (64, 240), height_mm=height / 5, radius_px=60, centre_px=(x, 32))
    capture = capture_pair(body, STANDARD_GEOMETRY, PairSettings(fringes=12, gamma=gamma))
    # Towards γ = 2.4 the minima, ten samples wide, go flat: what is left to invert is rounding.
    limit = IDEAL_LIMIT_PX[name] * 1.5 if gamma < 1.2 else FLAT_LIMIT_PX[name]
    assert mean_error(capture, name) < limit


def test_one_row_is_enough():
    from fringeworks.simulate import deformed_row, parabola_1d
    from fringeworks.types import ReferencePlaneGeometry

    geometry = ReferencePlaneGeometry(distance_mm=800.0, baseline_mm=300.0)
    row = deformed_row(parabola_1d(height_mm=40.0), geometry)
    capture = Pair(row.reference[None], row.object[None], axis="x", geometry=geometry)
    for name, limit in (("ifa", 1.0), ("sifa", 0.1), ("gsifa", 0.01), ("exact", 1e-4)):
        error = reconstruct(capture, name).surface.values[0] - row.height_mm
        assert np.nanmean(np.abs(error)) < limit, name
    with pytest.raises(InputError, match="at least 8 rows"):
        reconstruct(capture, "windowed")


def test_unknown_method_and_option():
    capture = ideal()
    with pytest.raises(InputError, match=r"expected one of .*gsifa"):
        analyse(capture, "magic")
    with pytest.raises(InputError, match="unknown option speed"):
        analyse(capture, "gsifa", speed=3)
    with pytest.raises(InputError, match="n_resample"):
        analyse(capture, "gsifa", n_resample=0)
    with pytest.raises(InputError, match="degree"):
        analyse(capture, "ifa", degree=99)
    with pytest.raises(InputError, match="max_displacement_px"):
        analyse(capture, "exact", max_displacement_px=-1.0)
    with pytest.raises(InputError, match="width"):
        analyse(capture, "fourier", width=2.0)
    with pytest.raises(InputError, match="dimensions"):
        analyse(capture, "fourier", dimensions=3)


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
