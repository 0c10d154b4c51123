"""The kernel that fits a linear model to values of which a part may be wrong, and its twin."""

import numpy as np
import pytest

from fringeworks import _core
from tests.oracles.robust_surface import robust_fit

HOW = {"fits": 12, "least": 0.1, "most": 4.7}


def window(seed, half=18, wrong=0.1, noise=0.01):
    """A quadratic surface of pixels, of which some are off by whole periods."""
    rng = np.random.default_rng(seed)
    v, u = (a.ravel() for a in np.mgrid[-half : half + 1, -half : half + 1] / half)
    design = np.column_stack((np.ones_like(u), u, v, u * u, u * v, v * v))
    true = rng.normal(0.0, 30.0, 6)
    sigma = noise * rng.uniform(0.5, 3.0, len(u))
    off = np.where(rng.random(len(u)) < wrong, 16.0 * rng.integers(-3, 4, len(u)), 0.0)
    return design, design @ true + sigma * rng.normal(size=len(u)) + off, 1.0 / sigma, true


@pytest.mark.parametrize("seed", range(6))
def test_kernel_agrees_with_its_twin(seed):
    design, q, certainty, true = window(seed, half=5 + 3 * seed)
    coefficients, scatter, normals, weight = _core.robust_fit(design.T.copy(), q, certainty, HOW)
    twin, sigma, kept = robust_fit(design, q, certainty)
    np.testing.assert_allclose(coefficients, twin, rtol=0, atol=1e-11)
    assert np.array_equal(weight > 0, kept)
    normal = normals[-1].reshape(6, 6)
    assert scatter * np.sqrt(np.linalg.inv(normal)[0, 0]) == pytest.approx(sigma, rel=1e-10)
    assert np.abs(coefficients - true).max() < 0.05
    assert 0.85 < kept.mean() < 0.97


def test_unknown_shapes_are_refused():
    with pytest.raises(ValueError, match="values: expected 4 values"):
        _core.robust_fit(np.ones((2, 4)), np.ones(3), np.ones(4), HOW)
    with pytest.raises(ValueError, match="certainty: expected 4 values"):
        _core.robust_fit(np.ones((2, 4)), np.ones(4), np.ones(5), HOW)
    with pytest.raises(ValueError, match="1 to 16 coefficients"):
        _core.robust_fit(np.ones((17, 4)), np.ones(4), np.ones(4), HOW)


def test_values_that_determine_nothing_have_no_coefficients():
    found = _core.robust_fit(np.ones((2, 9)), np.arange(9.0), np.ones(9), HOW)
    assert not np.isfinite(found[0]).all()
