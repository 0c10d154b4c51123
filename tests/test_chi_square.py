"""The χ² distribution in closed form against SciPy's."""

from __future__ import annotations

import pytest
from scipy import special

from fringeworks.statistics.chi_square import chi_square_above, chi_square_quantile

FREEDOM = [1, 2, 3, 4, 5, 8, 21, 62, 200]


@pytest.mark.parametrize("freedom", FREEDOM)
def test_quantiles(freedom):
    for share in (1e-6, 0.01, 0.5, 0.9, 0.99, 0.9995, 1.0 - 1e-6):
        expected = 2.0 * special.gammaincinv(0.5 * freedom, share)
        assert chi_square_quantile(share, freedom) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("freedom", FREEDOM)
def test_shares(freedom):
    for x in (0.0, 1e-3, 0.5, 3.0, 20.0, 80.0, 700.0):
        expected = special.gammaincc(0.5 * freedom, 0.5 * x)
        assert chi_square_above(x, freedom) == pytest.approx(expected, rel=1e-9)
