"""Errors of the points of areas, their pieces of surface, and what lies at the ends of values."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import _core
from fringeworks.evaluate.area_points import AreaPoints, Term, _slope, shares_of
from fringeworks.evaluate.quantities import narrowest_range
from fringeworks.evaluate.shares import total
from fringeworks.statistics.quantiles import SAMPLED, smallest
from tests.oracles import area_points as twin


def area(rng, n=700, *, parts=None):
    """Points with errors of every kind; ``parts`` of a rig's covariance."""
    ray = rng.normal(size=(n, 3))
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    cell = rng.integers(0, 5, n)
    return AreaPoints(
        points=rng.normal(size=(n, 3)),
        by_value=ray,
        noise=rng.uniform(0, 1, n),
        common=rng.uniform(0, 1, n),
        blur=rng.normal(size=n),
        patch=rng.integers(0, 9, n),
        pieces=lambda: np.empty((n, 3)),
        wanted=n,
        up=np.array([0.0, 0.0, -1.0]),
        cell=cell,
        inner=np.ones(n, bool),
        by_rig=None if parts is None else rng.normal(size=(5, 3, parts)),
    )


@pytest.mark.parametrize("parts", [None, 7])
@pytest.mark.parametrize("turned", [False, True])
def test_errors_add_up_as_array_by_array(parts, turned):
    rng = np.random.default_rng(31)
    terms = []
    # More points than one task of the kernel has, and a number that tasks do not divide.
    for n in (700, 40_001):
        direction = rng.normal(size=(n, 3) if turned else 3)
        weights = rng.normal(size=(n, 2))[:, 0]
        terms.append(Term(area(rng, n, parts=parts), weights, direction))
    for some in (terms, terms[1:], [Term(terms[0].area.without_noise(), *terms[0][1:])]):
        np.testing.assert_allclose(total(shares_of(some)), twin.sigma_of(some), rtol=1e-12)


def test_numbers_of_groups_that_are_none_are_refused():
    one = area(np.random.default_rng(32))
    errors = (one.by_value, one.noise, one.common, one.blur, one.patch)
    for groups in (8, 10**6):
        with pytest.raises(ValueError, match="group"):
            _core.error_sums(errors, np.ones(700), np.ones((1, 3)), groups)
    with pytest.raises(ValueError, match="directions"):
        _core.error_sums(errors, np.ones(700), np.ones((2, 3)), 9)


def test_slopes_are_central_and_one_sided_at_gaps():
    rng = np.random.default_rng(33)
    for shape in ((1, 1), (1, 9), (9, 1), (2, 3), (40, 50)):
        points = rng.normal(size=(*shape, 3))
        points[rng.random(shape) < 0.3] = np.nan
        for axis in (0, 1):
            np.testing.assert_array_equal(_slope(points, axis), twin.slope(points, axis))


@pytest.mark.parametrize("seed", range(3))
def test_smallest_values_are_those_of_a_sort(seed):
    rng = np.random.default_rng(seed)
    for n in (1, 7, SAMPLED - 1, 9 * SAMPLED + 3):
        for values in (
            rng.normal(size=n),
            np.sort(rng.normal(size=n)),
            np.round(rng.normal(size=n)),
            np.zeros(n),
            np.where(np.arange(n) % max(n // SAMPLED, 1) == 0, 100.0, rng.normal(size=n)),
        ):
            for count in {1, max(n // 300, 1), (n + 1) // 2, max(n - n // 300, 1), n}:
                marked = smallest(values, count)
                assert np.count_nonzero(marked) == count
                assert np.array_equal(np.sort(values[marked]), np.sort(values)[:count])


@pytest.mark.parametrize("n", [10, 400, 50_000])
def test_the_narrowest_range_is_that_of_all_ranges(n):
    values = np.random.default_rng(n).standard_t(3, n)
    kept = int(np.ceil(0.997 * n))
    ordered = np.sort(values)
    ranges = ordered[kept - 1 :] - ordered[: n - kept + 1]
    size, top, bottom = narrowest_range(values)
    assert size == ranges.min()
    assert values[top] - values[bottom] == size
