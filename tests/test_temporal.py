"""Chains of roundings that resolve the fringe orders of several periods."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import InputError
from fringeworks.patterns.order_chain import order_chain, repeat_distance, separation

RANGE = (-0.5, 959.5)


def resolve(chain, turns, start=None):
    """Coordinate of phases in turns, by the roundings of a chain."""
    x = 0.5 * (chain.low_px + chain.high_px) if start is None else start
    for row, g in zip(chain.combinations, chain.frequencies, strict=True):
        off = row @ turns - g * x
        x = x + (off - np.rint(off)) / g
    return x


CHOICES = {
    "hierarchical": [960.0, 120.0, 15.0],
    "heterodyne": [960 / 29, 960 / 32, 960 / 36],
    "two": [960 / 13, 960 / 12],
    "co-prime": [13.0, 16.0, 17.0],
    "odd": [1000.0, 83.7, 9.1],
    "four": [962.0, 190.0, 40.0, 9.0],
}


@pytest.mark.parametrize("name", list(CHOICES))
def test_every_coordinate_is_found_within_the_stated_noise(name):
    periods = np.array(CHOICES[name])
    chain = order_chain(periods, RANGE)
    rng = np.random.default_rng(1)
    sigma = chain.margin(1.0) / 5.0
    x = rng.uniform(0, 959, 4000)
    if np.isinf(chain.repeats_px):
        # Without a finite repeat distance, noise can wrap the first combination past either end.
        first = np.linalg.norm(chain.combinations[0]) * sigma / (2 * np.pi) / chain.frequencies[0]
        reach = 0.5 / chain.frequencies[0] - 5 * first
        x = x[np.abs(x - 479.5) < reach]
        assert x.size > 2000
    assert chain.margin(sigma) == pytest.approx(5.0)
    noise = sigma * rng.standard_normal((len(periods), x.size))
    turns = x / periods[:, None] + noise / (2 * np.pi)
    turns = turns - np.rint(turns)
    found = np.array([resolve(chain, turns[:, k]) for k in range(x.size)])
    off = found - x
    if np.isfinite(chain.repeats_px):
        off -= chain.repeats_px * np.rint(off / chain.repeats_px)
    assert np.abs(off).max() < 0.5 * periods.min()


@pytest.mark.parametrize("name", ["hierarchical", "heterodyne", "two"])
def test_the_margin_of_a_chain_is_close_to_that_of_maximum_likelihood(name):
    chain = order_chain(CHOICES[name], RANGE)
    limit = 0.5 * 2 * np.pi * separation(CHOICES[name], 960.0)
    assert 0.95 * limit < chain.margin(1.0) <= limit * (1 + 1e-9)


def test_weights_count():
    even = order_chain(CHOICES["heterodyne"], RANGE)
    fine = order_chain(CHOICES["heterodyne"], RANGE, weights=[1.0, 1.0, 9.0])
    assert fine.margin([1.0, 1.0, 1 / 3]) >= even.margin([1.0, 1.0, 1 / 3]) * (1 - 1e-9)


def test_repeat_distance():
    assert repeat_distance([200 / 3, 100.0], 1920) == pytest.approx(200.0)
    assert repeat_distance([30.0, 60.0], 960) == pytest.approx(60.0)
    assert np.isinf(repeat_distance([np.pi * 10, 31.0], 100))


def test_gray_code_starts_the_chain():
    chain = order_chain([32.0], RANGE, gray_step_px=16.0)
    turns = np.array([100.2 / 32.0])
    assert resolve(chain, turns - np.rint(turns), start=103.0) == pytest.approx(100.2)
    assert chain.tolerance[0] == pytest.approx(0.5 - 0.6 * 16 / 32)


@pytest.mark.parametrize(
    ("periods", "gray_step", "words"),
    [
        ([30.0, 60.0], None, "30, 60 px repeat after 60 px, but the projector has 960 px"),
        ([100.0], None, "repeat after 100 px"),
        ([100.0], 120.0, "span 100 px, expected 120 px or more for Gray-code cells of 120 px"),
        ([100 * np.pi], None, "314.159 px repeat after 314.159 px"),
    ],
)
def test_ambiguous_periods_are_refused(periods, gray_step, words):
    with pytest.raises(InputError, match=words):
        order_chain(periods, RANGE, gray_step_px=gray_step)
