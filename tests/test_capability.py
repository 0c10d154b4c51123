"""Cp and Cpk: their intervals hold the process's own index as often as they say."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks.evaluate.capability import capability, control_limits


def test_indices_of_known_parts():
    values = np.array([9.0, 11.0, np.nan, 9.0, 11.0])
    found = capability(values, 4.0, 16.0)
    assert found.count == 4
    assert found.mean == pytest.approx(10.0)
    assert found.within == pytest.approx(2.0 / 1.128)
    assert found.overall == pytest.approx(np.sqrt(4.0 / 3.0))
    assert found.cp == found.cpk == pytest.approx(12.0 / (6.0 * found.within))
    assert found.pp == pytest.approx(12.0 / (6.0 * found.overall))
    one_sided = capability(values, None, 16.0)
    assert np.isnan(one_sided.cp)
    assert one_sided.cpk == pytest.approx(found.cpk)
    assert control_limits(values)[1] == pytest.approx(10.0 - 3.0 * found.within)


@pytest.mark.parametrize("values", [[], [1.0], [np.nan, 2.0], [3.0, 3.0, 3.0]])
def test_too_few_parts_and_equal_ones_have_no_index(values):
    found = capability(np.array(values, float), 0.0, 5.0)
    assert np.isnan([found.cp, found.cpk, found.pp, found.ppk, *found.cp_interval]).all()


@pytest.mark.parametrize(("count", "seed"), [(20, 11), (50, 12), (200, 13)])
def test_intervals_hold_the_true_index(count, seed):
    rng = np.random.default_rng(seed)
    true = {"cp": 4.0 / 3.0, "cpk": 1.0, "pp": 4.0 / 3.0, "ppk": 1.0}
    held = dict.fromkeys(true, 0)
    runs = 600
    for _ in range(runs):
        found = capability(rng.normal(1.0, 1.0, count), -4.0, 4.0)
        for name, value in true.items():
            low, high = getattr(found, f"{name}_interval")
            held[name] += low <= value <= high
    for name, hits in held.items():
        assert 0.925 <= hits / runs <= 0.985, name
