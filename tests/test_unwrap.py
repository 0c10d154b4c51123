"""Unwrapping: the kernel against its oracle, and exactness modulo 2π."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fringeworks import InputError, unwrap
from tests.oracles.unwrap import unwrap_reliability, wrap


@pytest.mark.parametrize("seed", range(4))
def test_kernel_agrees_with_its_oracle(seed):
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:24, :30]
    truth = 0.9 * x + 0.03 * y**2 + 0.5 * rng.standard_normal(x.shape)
    mask = rng.random(x.shape) > 0.1
    phase = wrap(truth).astype(np.float32)
    found, region = unwrap(phase, mask)
    expected = unwrap_reliability(phase.astype(float), mask)
    largest = region == 1
    difference = (found - expected)[largest] / (2 * np.pi)
    assert np.ptp(np.round(difference)) == 0
    np.testing.assert_allclose(difference, np.round(difference), atol=1e-5)
    assert np.isnan(found[~mask]).all()


@settings(max_examples=20, deadline=None)
@given(
    slope_x=st.floats(-2.0, 2.0),
    slope_y=st.floats(-2.0, 2.0),
    bend=st.floats(-0.01, 0.01),
    h=st.integers(2, 40),
    w=st.integers(2, 40),
)
def test_smooth_phase_is_exact(slope_x, slope_y, bend, h, w):
    y, x = np.mgrid[:h, :w].astype(float)
    truth = slope_x * x + slope_y * y + bend * (x - w / 2) ** 2
    found, region = unwrap(wrap(truth))
    assert (region == 1).all()
    offset = (found - truth) / (2 * np.pi)
    np.testing.assert_allclose(offset, np.round(offset.flat[0]), atol=1e-4)


def test_noise_leaves_no_error_where_steps_stay_below_pi():
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:512, :512]
    truth = 0.5 * x + 40 * np.exp(-((x - 256) ** 2 + (y - 200) ** 2) / 20000)
    truth = truth + 0.3 * rng.standard_normal(x.shape)
    found, _ = unwrap(wrap(truth))
    offset = (found - truth) / (2 * np.pi)
    assert np.abs(offset - np.round(np.median(offset))).max() < 1e-3


def test_separate_regions_are_numbered_by_size():
    phase = np.zeros((20, 40), np.float32)
    mask = np.ones(phase.shape, bool)
    mask[:, 10] = False
    _, region = unwrap(phase, mask)
    assert (region[:, 11:] == 1).all()
    assert (region[:, :10] == 2).all()
    assert (region[:, 10] == 0).all()


def test_bad_input():
    with pytest.raises(InputError, match="phase: expected shape"):
        unwrap(np.zeros(5))
    with pytest.raises(InputError, match="mask: expected shape"):
        unwrap(np.zeros((5, 5)), np.ones((4, 5), bool))
    with pytest.raises(InputError, match="at least one valid pixel"):
        unwrap(np.full((5, 5), np.nan))
    wrapped = np.zeros((5, 5))
    unwrap(wrapped, np.ones((5, 5), bool))
    assert not wrapped.any()
