"""Reference-plane geometry: (1) and (3) of theory §2 are inverse to each other for both signs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fringeworks import InputError, Reason
from fringeworks.pair import (
    DisplacementMap,
    ReferencePlaneGeometry,
    displacement_from_height,
    height_from_displacement,
    to_surface,
)

geometries = st.builds(
    ReferencePlaneGeometry,
    distance_mm=st.floats(100, 10000),
    baseline_mm=st.floats(10, 5000),
    pitch_mm_per_px=st.floats(0.01, 10),
    sign=st.sampled_from([1, -1]),
)


@given(geometry=geometries, share=st.floats(-0.9, 0.9))
def test_height_and_displacement_are_inverse(geometry, share):
    height = np.array([share * geometry.distance_mm])
    there = displacement_from_height(height, geometry)
    back = height_from_displacement(there, geometry)
    np.testing.assert_allclose(back, height, rtol=1e-9, atol=1e-9)
    assert np.sign(there[0]) == geometry.sign * np.sign(share)


def test_height_at_the_pupils_is_refused():
    geometry = ReferencePlaneGeometry(distance_mm=800, baseline_mm=300)
    for height in (800.0, 900.0):
        with pytest.raises(InputError, match="below the pupils"):
            displacement_from_height(np.array([0.0, height]), geometry)


def test_displacement_beyond_the_baseline_has_no_height():
    geometry = ReferencePlaneGeometry(distance_mm=800, baseline_mm=300, pitch_mm_per_px=0.5)
    u = np.array([[-601.0, -600.0, -599.0, 0.0]])
    height = height_from_displacement(u, geometry)
    assert np.isnan(height[0, :2]).all()
    assert np.isfinite(height[0, 2:]).all()
    result = DisplacementMap(
        displacement_px=u,
        sigma_px=np.full(u.shape, 0.1),
        modulation_ratio=np.ones(u.shape),
        reason=np.zeros(u.shape, np.uint8),
        period_px=20.0,
        axis="x",
        method="test",
    )
    surface = to_surface(result, geometry)
    assert list(surface.reason[0]) == [Reason.BEYOND_GEOMETRY] * 2 + [Reason.OK] * 2
    assert np.isnan(surface.sigma[0, :2]).all()
    # σ_h = l d₀ / (d₀ + u)² σ_u, at u = 0: l/d₀ · σ_u
    assert surface.sigma[0, 3] == pytest.approx(800 / 300 * 0.1 * 0.5)
    np.testing.assert_allclose(result.phase_rad, u * 2 * np.pi / 20)


def test_without_geometry_the_result_is_a_displacement_in_px():
    zero = np.zeros((2, 3))
    result = DisplacementMap(zero, zero, zero, zero.astype(np.uint8), 10.0, "x", "test")
    surface = to_surface(result, None)
    assert (surface.quantity, surface.unit) == ("displacement", "px")


@pytest.mark.parametrize(
    "changes",
    [{"distance_mm": 0}, {"baseline_mm": -1}, {"pitch_mm_per_px": float("nan")}, {"sign": 2}],
)
def test_impossible_geometry(changes):
    with pytest.raises(InputError, match="geometry: expected"):
        ReferencePlaneGeometry(**{"distance_mm": 800, "baseline_mm": 300, **changes})
