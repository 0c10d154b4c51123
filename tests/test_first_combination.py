"""White noise alone never leads to a wrong fringe order, at the ends of the range included."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import InputError, PatternPlan, Reason, decode, propose
from fringeworks.patterns import PhaseSteps, equal_steps
from fringeworks.patterns.order_chain import order_chain
from fringeworks.signal import CameraNoise
from tests.grids import quick, thinned
from tests.stacks import multi, take

pytestmark = pytest.mark.statistical

# Columns, periods, steps and modulation over noise: the noise limit of each plan.
PLANS = {
    "co-prime": (1280, (16.0, 17.0, 19.0), (6, 3, 3), 15.0),
    "two": (640, (13.81, 14.38), (4, 4), 75.0),
    "four": (512, (22.52, 30.22, 45.35, 54.92), (4, 4, 4, 4), 7.0),
    "two that repeat": (854, (28.0, 854.0), (4, 4), 40.0),
}


def plan_of(name):
    length, periods, steps, _ = PLANS[name]
    sets = zip(periods, steps, strict=True)
    return PatternPlan(length, 300, tuple(PhaseSteps("x", p, equal_steps(n)) for p, n in sets))


def measure(plan, modulation, seed=0):
    """Ok pixels, and their errors, at random coordinates; noise of one count."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-0.5, plan.width_px - 0.5, (plan.height_px, plan.width_px))
    frames = take(
        plan, noise=1.0, b=modulation, at=(np.zeros_like(x), x), seed=seed, kind=np.float32
    )
    try:
        found = decode(frames, plan, noise=CameraNoise(1.0)).x
    except InputError as error:
        if "expected pixels that can be measured, got none" not in str(error):
            raise
        return np.zeros(x.shape, bool), np.full(x.shape, np.nan)
    ok = found.reason == Reason.OK
    return ok, np.abs(found.coordinate_px - x)


@thinned(strength=1, name=list(PLANS), factor=[0.8, 1.0, 1.3, 2.0])
def test_no_order_is_wrong_near_the_noise_limit(name, factor):
    plan = plan_of(name)
    ok, off = measure(plan, factor * PLANS[name][3])
    assert not np.any(off[ok] > 0.5 * min(PLANS[name][1]))


@pytest.mark.parametrize("name", list(PLANS))
def test_nearly_all_of_a_bright_surface_is_measured(name):
    ok, off = measure(plan_of(name), 10.0 * PLANS[name][3])
    assert ok.mean() > 0.97
    assert np.nanmax(off) < 1.0


def test_a_weak_fringe_whose_modulation_is_overestimated_is_no_surprise():
    """Two fringes of a few standard deviations: noise that makes them brighter is not trusted."""
    plan = multi((1, 3), 3, (1000, 1500))
    ok, off = measure(plan, 7.0)
    assert 0.01 < ok.mean() < 0.99
    assert not np.any(off[ok] > 150.0)


@pytest.mark.parametrize("name", list(PLANS))
def test_the_stated_margin_keeps_the_ends(name):
    """At a margin of five, at most 1 % of the range is lost because the combination may wrap."""
    length, periods, steps, _ = PLANS[name]
    chain = plan_of(name).chain("x")
    start = chain.wraps
    assert start.sum() == 1
    weights = np.sqrt(np.asarray(steps) / 2.0)
    spread = np.linalg.norm(chain.combinations[0] / weights)
    sigma = chain.tolerance[start][0] / 5.0 / spread
    noise = sigma / weights * np.random.default_rng(2).standard_normal((400_000, len(periods)))
    x = np.random.default_rng(3).uniform(-0.5, length - 0.5, 400_000)
    estimate = chain.frequencies[0] * (x - 0.5 * (length - 1)) + noise @ chain.combinations[0]
    remainder = np.abs(estimate - np.rint(estimate))
    lost = remainder + 6.0 * sigma * spread > chain.alternative[start][0]
    assert 0.001 < lost.mean() < 0.01


def test_the_first_combination_cannot_wrap_where_all_phases_repeat_with_it():
    assert not order_chain([960.0, 120.0], (-0.5, 959.5)).wraps.any()
    assert order_chain([960.0, 121.0], (-0.5, 959.5)).wraps.any()
    assert not order_chain([32.0], (-0.5, 959.5), gray_step_px=16.0).wraps.any()


@pytest.mark.parametrize(("length", "frames"), quick([(1280, 12), (700, 9)], (700, 9)))
def test_proposals_are_right_down_to_the_noise_limit(length, frames):
    for proposal in propose(length, 60, frames, noise=2.0, modulation=30.0):
        shortest = min(b.period_px for b in proposal.plan.blocks if isinstance(b, PhaseSteps))
        for modulation in (15.0, 13.0, 11.0, 9.0):
            ok, off = measure(proposal.plan, modulation)
            assert ok.mean() > 0.97 or modulation < 15.0
            assert not np.any(off[ok] > 0.5 * shortest)
