"""Errors of phases in two parts: the least squares behind them, against SciPy's."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from fringeworks.statistics.phase_errors import non_negative


def test_least_squares_that_are_not_negative():
    rng = np.random.default_rng(3)
    on_an_axis = 0
    for _ in range(500):
        design = np.abs(rng.standard_normal((6, 2))) * 10.0 ** rng.uniform(-3, 3, 2)
        values = rng.standard_normal(6) + rng.uniform(-0.5, 2.0)
        found, expected = non_negative(design, values), nnls(design, values)[0]
        np.testing.assert_allclose(
            found, expected, rtol=1e-9, atol=1e-12 / design.max(axis=0).min()
        )
        on_an_axis += int((expected == 0).any())
    assert 50 < on_an_axis < 450


def test_nothing_gives_nothing():
    np.testing.assert_array_equal(non_negative(np.zeros((4, 2)), np.ones(4)), [0.0, 0.0])
    np.testing.assert_array_equal(non_negative(np.ones((4, 2)), -np.ones(4)), [0.0, 0.0])
