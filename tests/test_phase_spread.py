"""Ripple of a response from how evenly phases are spread, over relief that hides it along lines."""

from dataclasses import replace

import numpy as np
import pytest

from fringeworks.stack.phase_spread import spread_of, with_spread
from fringeworks.stack.ripple import Ripple, unknown_ripple
from tests.grids import quick

ORDERS = (1, 2, 3, 6)
AMPLITUDE = {3: -0.32j, 6: 0.05j}
FEW = Ripple(
    ORDERS,
    np.array([0.0, 0.0, -0.30j, 0.04j]),
    np.array([0.03, 0.02, 0.03, 0.02]),
    1.0,
    error_rad=0.03,
    places=2,
)
"""What lines show at two places of a smooth surface."""
ROUGH = replace(
    FEW,
    phasors_rad=np.array([0.05, 0.02, 0.09j, 0.01]),
    errors_rad=np.array([0.06, 0.02, 0.007, 0.005]),
    excess=300.0,
    error_rad=0.06,
)
"""What they show where the surface is rough: its relief, which few places take for ripple."""


def lines(seed, fringes=20.0, ripple=AMPLITUDE, rows=24, length=1200):
    """Phases along lines over a rough surface with edges, alike along all lines, and their lit
    pixels."""
    rng = np.random.default_rng(seed)
    u = np.linspace(0.0, 1.0, length)
    phase = 2.0 * np.pi * fringes * u
    for k in range(1, 12):
        phase = phase + rng.normal(0.0, 2.0 * fringes / 20.0) * np.sin(np.pi * k * u) / k**0.5
    for edge in rng.integers(0, length, 12):
        phase[edge:] += rng.uniform(-3.0, 3.0)
    phase = phase + np.linspace(0.0, rng.uniform(-3.0, 3.0), rows)[:, None]
    lit = np.ones(phase.shape, bool)
    for first in rng.integers(0, length, 4):
        lit[:, first : first + 60] = False
    error = sum(np.real(z * np.exp(-1j * k * phase)) for k, z in ripple.items())
    measured = phase + error + rng.normal(0.0, 0.03, phase.shape)
    return np.angle(np.exp(1j * measured)).astype(np.float32), lit


def told_by(ripple, phase, used, steps, near_limits=0.0):
    """A ripple with what the spread of the phases tells."""
    return with_spread(ripple, spread_of(ripple, phase, used, steps, near_limits), steps)


def off(found):
    """Errors of the amplitudes of a response, in standard errors."""
    at = [ORDERS.index(k) for k in AMPLITUDE]
    return np.abs(found.phasors_rad[at] - list(AMPLITUDE.values())) / found.errors_rad[at]


@pytest.mark.parametrize("first", quick([0, 20, 40], 0))
def test_spread_tells_the_response_within_its_error(first):
    every = [told_by(FEW, *lines(seed), 3) for seed in range(first, first + 20)]
    told = [found for found in every if found.repeated]
    assert len(told) >= 15
    assert all((found.errors_rad < FEW.errors_rad)[2:].all() for found in told)
    # Sizes of complex errors, relative to the standard error of each part.
    assert np.sqrt(np.mean([off(found) ** 2 for found in told]) / 2.0) < 1.0
    assert max(off(found).max() for found in told) < 3.0


def test_other_orders_stay_those_of_the_lines():
    found = told_by(FEW, *lines(0), 3)
    assert np.array_equal(found.phasors_rad[:2], FEW.phasors_rad[:2])
    assert np.array_equal(found.errors_rad[:2], FEW.errors_rad[:2])


@pytest.mark.parametrize("fringes", [0.4, 1.3])
def test_few_fringes_tell_hardly_anything(fringes):
    """They do where each line begins at another phase, so that all phases are seen."""
    every = [told_by(FEW, *lines(seed, fringes), 3) for seed in range(40)]
    told = [found for found in every if found.repeated]
    assert len(told) < 12
    assert all(off(found).max() < 3.0 for found in told)


def test_no_response_is_found_where_there_is_none():
    """Relief once made a ripple along lines; the spread contradicts it."""
    for seed in range(40):
        assert told_by(FEW, *lines(seed, ripple={}), 3) is FEW
        assert told_by(ROUGH, *lines(seed, ripple={}), 3) is ROUGH


@pytest.mark.parametrize("first", quick([0, 20, 40], 0))
def test_rough_lines_do_not_hide_what_the_spread_tells(first):
    """Relief along the lines once contradicted the response, or made it unsure, so that it stayed
    in the coordinates and out of σ."""
    every = [told_by(ROUGH, *lines(seed), 3) for seed in range(first, first + 20)]
    told = [found for found in every if found.repeated]
    assert len(told) >= 15
    assert np.mean([found.sure for found in told]) > 0.9
    assert max(off(found).max() for found in told) < 3.0


def test_smooth_lines_that_contradict_the_spread_count():
    smooth = replace(ROUGH, excess=1.0)
    assert all(told_by(smooth, *lines(seed), 3) is smooth for seed in range(20))


def test_spread_serves_where_lines_hold_too_few_whole_fringes():
    unknown = unknown_ripple(ORDERS, 3)
    found = told_by(unknown, *lines(1), 3)
    assert found.repeated
    assert off(found).max() < 3.0
    assert found.significant(1) == 0.0 == found.significant(2)


def test_lines_along_the_fringes_tell_nothing():
    """Each line has one phase, and all places of it are alike."""
    phase = np.repeat(np.linspace(0.0, 40.0, 24)[:, None], 1200, axis=1)
    phase = np.angle(np.exp(1j * (phase - 0.32 * np.sin(3.0 * phase)))).astype(np.float32)
    unknown = unknown_ripple(ORDERS, 3)
    assert told_by(unknown, phase, np.ones(phase.shape, bool), 3) is unknown


def test_phases_that_are_missing_near_limits_are_no_response():
    """Saturation leaves out some phases of bright surfaces."""
    unknown = unknown_ripple(ORDERS, 3)
    for seed in (1, 2):
        phase, lit = lines(seed, ripple={})
        kept = lit & (np.cos(3.0 * phase) < 0.3)
        assert told_by(unknown, phase, kept, 3) is not unknown
        assert told_by(unknown, phase, kept, 3, 1.0) is unknown
