"""Smoothing of maps by moving means, against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from fringeworks import _core
from fringeworks.signal.filters import smooth, smooth_known

RNG = np.random.default_rng(5)


def twin(values, sides_y, sides_x):
    """The kernel's twin: SciPy's moving means."""
    for axis, sides in enumerate((sides_y, sides_x)):
        for side in sides:
            values = scipy.ndimage.uniform_filter1d(values, side, axis, mode="nearest")
    return values


@pytest.mark.parametrize(("kind", "tolerance"), [(np.float32, 3e-6), (np.float64, 1e-12)])
@pytest.mark.parametrize("shape", [(1, 1), (1, 300), (300, 1), (257, 131), (640, 90)])
def test_moving_means(kind, tolerance, shape):
    values = (100.0 * RNG.standard_normal(shape)).astype(kind)
    for sides in (([3, 3, 5], []), ([], [7, 7, 9]), ([31, 31, 31], [5, 5, 5]), ([901], [401])):
        found = _core.moving_means(values, sides_y=sides[0], sides_x=sides[1])
        assert found.dtype == kind
        np.testing.assert_allclose(found, twin(values, *sides), rtol=0, atol=100 * tolerance)


def test_small_values_beside_large_ones():
    """Sums move on by differences: a large value must not leave its rounding behind."""
    values = np.full((600, 40), 1e-6)
    values[50] = 1.0
    found = _core.moving_means(values, sides_y=[5], sides_x=[5])
    np.testing.assert_allclose(found[60:], 1e-6, rtol=1e-8)


@pytest.mark.parametrize("width", [(6.0, 11.0), (1.5, 20.0), (20.0, 0.0), (0.0, 0.0)])
def test_smoothing_is_that_of_a_gaussian(width):
    y, x = np.mgrid[:200, :240]
    values = np.sin(x / 30.0) + np.cos(y / 25.0)
    expected = scipy.ndimage.gaussian_filter(values, width, mode="nearest")
    inner = np.s_[60:-60, 60:-60]
    np.testing.assert_allclose(smooth(values, width)[inner], expected[inner], atol=0.01)
    turned = smooth(np.asfortranarray(values), width)
    np.testing.assert_array_equal(turned, smooth(values, width))


def test_unknown_pixels_get_the_mean_around_them():
    values = np.full((80, 90), 3.0)
    known = np.ones(values.shape, bool)
    known[30:35, 40:60] = False
    found = smooth_known(np.where(known, values, 0.0), known, (8.0, 8.0))
    np.testing.assert_allclose(found, 3.0, rtol=1e-9)
