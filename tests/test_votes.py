"""Fringe orders by the votes of neighbours: what noise leaves ambiguous, and what no vote may bridge."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import InputError, PatternPlan, Reason, _core, decode
from fringeworks.patterns.plan import PhaseSteps, equal_steps
from fringeworks.signal.noise import CameraNoise
from fringeworks.stack import neighbours
from fringeworks.stack.kernel_settings import Limits, decoding_of
from fringeworks.statistics.chi_square import chi_square_quantile
from tests.oracles.vote import UNDECIDED, Votes
from tests.stacks import take

SIZE = (120, 240)
"""Height and width of the images, px."""

Y, X = np.mgrid[: SIZE[0], : SIZE[1]].astype(float)


def plan_of(sets, width=576):
    blocks = tuple(PhaseSteps("x", float(p), equal_steps(n)) for p, n in sets)
    return PatternPlan(width, 400, blocks)


FINE_AND_SINGLE = plan_of(((36, 3), (576, 3)))
SIMILAR = plan_of(((25, 3), (28, 3), (31, 3)))


def shown(plan, x, noise, b=30.0, albedo=1.0, seed=0):
    return take(plan, noise=noise, a=40.0, b=b, at=(np.zeros_like(x), x), albedo=albedo, seed=seed)


def relief():
    return 40.0 + 2.0 * X + 12.0 * np.sin(Y / 17.0) * np.cos(X / 23.0)


def plainly_right(plan, frames, x):
    """Pixels whose nearest order by their own phases alone is the right one."""
    found = decode(frames, plan, keep_phases=True).x
    turns = found.phase_rad / (2.0 * np.pi)
    finest = int(np.argmin(found.periods_px))
    period = found.periods_px[finest]
    off, at = np.full(x.shape, np.inf), np.zeros(x.shape)
    for k in range(-1, int(plan.width_px / period) + 2):
        tried = (turns[finest] + k) * period
        square = sum(
            (t - tried / p - np.rint(t - tried / p)) ** 2
            for t, p in zip(turns, found.periods_px, strict=True)
        )
        better = (square < off) & (tried > -1.0) & (tried < plan.width_px)
        off, at = np.where(better, square, off), np.where(better, tried, at)
    return np.abs(at - x) < 0.5 * period


@pytest.mark.parametrize("plan", [FINE_AND_SINGLE, SIMILAR])
@pytest.mark.parametrize("noise", [2.5, 4.0])
def test_what_plain_rounding_gets_right_is_measured(plan, noise):
    x = relief()
    frames = shown(plan, x, noise)
    found = decode(frames, plan).x
    ok = found.reason == Reason.OK
    right = plainly_right(plan, frames, x)
    assert right.mean() > 0.85
    assert (ok & right).sum() >= 0.95 * right.sum()
    off = np.abs(found.coordinate_px - x)[ok]
    assert not np.any(off > 0.5 * min(found.periods_px))
    assert 0.6 < np.mean(off < found.sigma_px[ok]) < 0.8


@pytest.mark.parametrize("periods", [1.0, 2.0, 0.5, 1.02])
def test_no_order_crosses_a_step(periods):
    x = 60.0 + 1.5 * X
    box = (abs(Y - 60) < 25) & (abs(X - 120) < 60)
    x[box] += 36.0 * periods
    found = decode(shown(FINE_AND_SINGLE, x, 2.0), FINE_AND_SINGLE).x
    ok = found.reason == Reason.OK
    wrong = ok & (np.abs(found.coordinate_px - x) > 12.0)
    assert wrong.sum() <= 1
    assert ok.mean() > 0.95
    assert ok[box].mean() > 0.9


def test_a_thin_object_keeps_its_depth_or_has_none():
    x = 60.0 + 1.5 * X
    x[30:90, 100:103] += 36.0
    found = decode(shown(FINE_AND_SINGLE, x, 2.0), FINE_AND_SINGLE).x
    ok = found.reason == Reason.OK
    assert not np.any(np.abs(found.coordinate_px - x)[ok] > 12.0)


def test_light_that_the_lens_spreads_into_a_shadow_is_no_surface():
    x = relief()
    albedo = np.where(X < 120, 1.0, 0.0)
    albedo[:, 120] = 0.35
    found = decode(shown(FINE_AND_SINGLE, x, 2.0, albedo=albedo), FINE_AND_SINGLE).x
    assert (found.reason[:, 120] == Reason.OK).mean() < 0.05
    assert (found.reason[:, :119] == Reason.OK).mean() > 0.98


def test_frames_of_double_precision_are_decided_by_regions():
    """Every part of the decoding reads them."""
    frames = shown(FINE_AND_SINGLE, relief(), 3.0)
    found = [decode([np.asarray(f, kind) for f in frames], FINE_AND_SINGLE).x for kind in "fd"]
    assert np.array_equal(found[0].reason, found[1].reason)


def voted(plan, phases, variances, reason, radius):
    """Coordinates and reasons of the kernel, and those of the twin."""
    decoding = decoding_of(plan, "x", absolute=True, response=None)
    kernel = decoding.kernel(CameraNoise(1.0), Limits(float("inf")))
    freedom = len(phases) - 1
    rules = {
        "radius": radius,
        "error_rate": 1e-5,
        "near_error_rate": 1e-3,
        "largest_misfit": chi_square_quantile(0.999, freedom),
        "own_doubt": 2.0,
        "usual_misfit": tuple(chi_square_quantile(q, freedom) for q in (0.5, 0.9)),
    }
    maps = {
        "coordinate": np.full(reason.shape, np.nan, np.float32),
        "sigma": np.full(reason.shape, np.nan, np.float32),
        "reason": reason.copy(),
        "phases": list(phases.astype(np.float32)),
        "variances": list(variances.astype(np.float32)),
    }
    _core.vote_orders(kernel, maps, rules)
    periods = [phases.period_px for phases in decoding.sets]
    lit = reason == Reason.ORDER_AMBIGUOUS
    span = (-0.5, plan.width_px - 0.5)
    twin = Votes(phases, variances, lit, periods, span)
    orders, _ = twin.orders(np.full(reason.shape, UNDECIDED), rules)
    expected = np.where(orders == UNDECIDED, np.nan, (twin.fine + orders) * twin.period)
    return maps, expected


@pytest.mark.parametrize("plan", [FINE_AND_SINGLE, SIMILAR])
@pytest.mark.parametrize("radius", [1, 2, 4])
def test_kernel_and_twin_agree(plan, radius):
    rng = np.random.default_rng(radius)
    shape = (37, 61)
    x = (40.0 + 2.0 * X + 12.0 * np.sin(Y / 17.0))[: shape[0], : shape[1]]
    x[:, 30:] += 36.0
    variance = rng.uniform(0.002, 0.03, (len(plan.blocks), *shape))
    periods = [block.period_px for block in plan.blocks]
    turns = np.stack([x / p for p in periods])
    phases = 2.0 * np.pi * (turns - np.rint(turns))
    phases += np.sqrt(variance) * rng.standard_normal(phases.shape)
    reason = np.full(shape, Reason.ORDER_AMBIGUOUS, np.uint8)
    reason[rng.random(shape) < 0.1] = Reason.SHADOW
    maps, expected = voted(plan, phases, variance, reason, radius)
    known = np.isfinite(expected)
    assert known.mean() > 0.3
    same = (maps["reason"] == Reason.OK) == known
    # Single precision moves pixels that lie at a threshold.
    assert np.mean(~same) < 0.003
    both = known & same
    period = min(periods)
    assert np.abs(maps["coordinate"] - expected)[both].max() < 0.5 * period


def test_a_measured_pixel_that_its_neighbours_contradict_is_ambiguous():
    plan = FINE_AND_SINGLE
    x = 60.0 + 1.5 * X
    decoding = decoding_of(plan, "x", absolute=True, response=None)
    frames = list(shown(plan, x, 2.5))
    maps = neighbours_maps(decoding, frames)
    wrong = (slice(40, 50), slice(100, 110))
    maps["coordinate"][wrong] += 36.0
    neighbours.vote(decoding, kernel_of(decoding), maps)
    assert (maps["reason"][wrong] == Reason.ORDER_AMBIGUOUS).mean() > 0.9
    assert np.isnan(maps["coordinate"][wrong]).mean() > 0.9


@pytest.mark.parametrize("reason", [Reason.OK, Reason.SHADOW])
def test_neighbours_may_vote_where_nothing_is_ambiguous(reason):
    """The noise of uneven scenes is known only after it was decided that they should."""
    decoding = decoding_of(SIMILAR, "x", absolute=True, response=None)
    phases, variances = np.zeros((2, 3, 9, 9), np.float32) + np.float32(1e-4)
    maps = {
        "phases": list(phases),
        "variances": list(variances),
        "reason": np.full((9, 9), reason, np.uint8),
    }
    assert 1 <= neighbours._radius(decoding, maps) <= neighbours.MOST_RADIUS


def kernel_of(decoding):
    return decoding.kernel(CameraNoise(2.5), Limits(float("inf")))


def neighbours_maps(decoding, frames):
    """Maps of the kernel with phases and variances, all pixels measured at their true orders."""
    from fringeworks.stack.kernel_settings import empty_maps

    maps = empty_maps(frames[0].shape, sets=len(decoding.sets))
    maps["variances"] = list(np.empty_like(np.asarray(maps["phases"])))
    _core.decode_frames(frames, kernel_of(decoding), maps)
    neighbours.vote(decoding, kernel_of(decoding), maps)
    assert (maps["reason"] == Reason.OK).mean() > 0.98
    return maps


def test_neighbours_are_not_asked_where_orders_are_clear(monkeypatch):
    monkeypatch.setattr(neighbours._core, "vote_orders", None)
    found = decode(shown(FINE_AND_SINGLE, relief(), 0.5), FINE_AND_SINGLE).x
    assert found.failed_fraction < 0.01


def test_coordinates_that_repeat_are_voted_on():
    plan = plan_of(((24, 3), (27, 3)))  # they repeat after 216 px
    x = relief()
    found = decode(shown(plan, x, 3.0), plan, absolute=False).x
    ok = found.reason == Reason.OK
    off = found.coordinate_px - x
    off -= found.repeats_px * np.rint(off / found.repeats_px)
    assert ok.mean() > 0.9
    assert not np.any(np.abs(off[ok]) > 12.0)


def test_a_refusal_tells_the_margin_that_the_plan_lacks():
    x = np.random.default_rng(0).uniform(0.0, 570.0, SIZE)
    with pytest.raises(InputError, match=r"margin of 1\.\d standard deviations") as raised:
        decode(shown(FINE_AND_SINGLE, x, 4.0), FINE_AND_SINGLE, noise=CameraNoise(4.0))
    assert "5 are needed" in str(raised.value)


def test_sets_that_are_shifted_against_each_other_are_not_voted_on():
    """A constant error of the single period, as by motion: all neighbours share it."""
    x = relief()
    frames = shown(FINE_AND_SINGLE, x, 2.5)
    moved = shown(FINE_AND_SINGLE, x + 8.0, 2.5)
    with pytest.raises(InputError, match="expected pixels that can be measured"):
        decode([*frames[:3], *moved[3:]], FINE_AND_SINGLE)
