"""Statistics of maps: groups of similar σ, robust σ, and scatter against the stated one."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy import ndimage

from fringeworks.statistics.groups import ordered_groups, similar_groups
from fringeworks.statistics.local_scatter import scatter_factor
from fringeworks.statistics.quantiles import robust_sigma
from fringeworks.statistics.third_difference import scatter_ratio


def test_groups_hold_similar_values_in_rising_order():
    rng = np.random.default_rng(0)
    sigma, values = rng.uniform(1, 2, 1000), rng.normal(size=1000)
    parts = [(sigma[k], values[k]) for k in ordered_groups(sigma, 8, 100)]
    for groups in (parts, similar_groups(sigma, values, 8, 100)):
        assert [g[0].size for g in groups] == [125] * 8
        assert all(a[0].max() <= b[0].min() for a, b in pairwise(groups))
        pairs = {(s, v) for g in groups for s, v in zip(*g, strict=True)}
        assert pairs == set(zip(sigma, values, strict=True))
    assert len(ordered_groups(sigma, 8, 300)) == 3
    assert ordered_groups(sigma, 8, 2000) == []
    assert similar_groups(sigma, values, 8, 126) == []


def test_outliers_do_not_change_a_robust_sigma():
    errors = np.random.default_rng(1).normal(0, 2.0, 20_000)
    errors[::50] = 1e6
    assert robust_sigma(errors) == pytest.approx(2.0, rel=0.05)


@pytest.mark.parametrize("width", [0.0, 2.0])
@pytest.mark.parametrize("truth", [0.5, 3.0])
def test_scatter_is_measured_against_the_stated_sigma(width, truth):
    """Noise on a sphere: white, and correlated by a Gaussian kernel; two factors on its σ."""
    rng = np.random.default_rng(2)
    y, x = np.mgrid[:240, :240] / 240.0
    noise = rng.standard_normal(x.shape)
    if width:
        noise = ndimage.gaussian_filter(noise, width)
        noise /= noise.std()
    sigma = 0.01 * (1.0 + x)
    values = np.sqrt(4.0 - x**2 - y**2) + truth * sigma * noise
    found = scatter_ratio(values, sigma, max(1.0, 4.0 * width), (width, width), (0, 1))
    assert found == pytest.approx(truth, rel=0.1)
    if not width:
        assert np.median(scatter_factor(values, sigma)) == pytest.approx(truth, rel=0.05)


def test_few_pixels_show_no_scatter():
    few = np.zeros((20, 20))
    assert scatter_ratio(few, few + 1.0, 2.0, (0.0, 0.0), (0, 1)) is None
    assert (scatter_factor(few[:10], few[:10] + 1.0) == 1.0).all()
