"""Whole periods of surfaces between cliffs: the minimum of the sum, and what stays undecided."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from fringeworks import Pair, reconstruct
from fringeworks.pair import shadow_orders
from fringeworks.pair.analyse import analyse
from fringeworks.pair.order_regions import (
    LEAST,
    Links,
    Orders,
    _Graph,
    continuity,
    likely_orders,
)
from fringeworks.pair.prepared import prepare
from tests.cliff_scenes import PERIOD, SHAPE, X, Y, boxed, photographed
from tests.two_frames import Bench, box

BLOCK_PX = 2
ONE_BLOCK = 6.0 * BLOCK_PX
"""Period whose blocks are that large, px."""


def links(*places):
    """Links from (row, column, row, column, whole)."""
    found = np.array(places, np.int64).reshape(-1, 5)
    return Links(found[:, [0, 2]], found[:, [1, 3]], found[:, 4])


@pytest.mark.parametrize("seed", range(4))
def test_the_minimum_is_that_of_all_orders(seed):
    rng = np.random.default_rng(seed)
    side = 3 * BLOCK_PX
    continues = rng.uniform(LEAST, 0.6, (side, side)).astype(np.float32)
    ends = rng.integers(0, side, (12, 4))
    known = links(*np.column_stack((ends, rng.integers(-1, 2, 12))))
    graph = _Graph.of(continues, known, ONE_BLOCK)
    assert graph.count == 9
    orders = np.array(list(product(range(-1, 2), repeat=9)), np.int8)
    orders = np.column_stack((orders, np.zeros(len(orders), np.int8)))
    total = np.zeros(len(orders))
    for first, second, weight, whole in zip(*graph.ends, graph.weight, graph.whole, strict=True):
        total += weight * np.abs(orders[:, second] - orders[:, first] - whole)
    found = np.append(graph.minimum(1.0, np.zeros(9, np.int64)), 0)
    apart = found[graph.ends[1]] - found[graph.ends[0]] - graph.whole
    assert np.sum(graph.weight * np.abs(apart)) == pytest.approx(total.min(), abs=0.1)


def test_orders_that_hang_on_the_weight_of_the_evidence_are_undecided():
    # An island of 16 × 16 px, whose border of 64 px is as continuous as a parameter says.
    at = np.arange(40)
    inside = (at >= 12) & (at < 28)
    island = inside[:, None] & inside[None, :]
    known = links(*((row, 4, row, 20, 2) for row in range(13, 27)))
    for border, decided in ((LEAST, 2), (0.2, None), (1.0, 0)):
        continues = np.ones((40, 40), np.float32)
        wide = (at >= 10) & (at < 30)
        continues[(wide[:, None] & wide[None, :]) & ~island] = border
        found = likely_orders(continues, known, ONE_BLOCK)
        assert not found.whole[~(wide[:, None] & wide[None, :])].any()
        if decided is None:
            assert found.undecided[island].mean() > 0.9
        else:
            assert not found.undecided[island].any()
            assert (found.whole[island] == decided).mean() > 0.9


def test_fringes_continue_everywhere_but_at_cliffs():
    pair, u, _ = boxed(0.7)
    prepared = prepare(pair)
    found = continuity(prepared, analyse(prepared, "fourier").displacement_px.astype(float))
    on = u < 0
    rim = np.zeros(SHAPE, bool)
    for axis in (0, 1):
        for by in (-1, 1):
            rim |= on != np.roll(on, by, axis)
    assert np.mean(found[rim] < 0.5) > 0.95
    slope = photographed(0.25 * (X - 110) * (np.abs(X - 110) < 1e9), seed=1)
    smooth = prepare(Pair(photographed(0.0), slope, axis="x"))
    assert np.mean(continuity(smooth, 0.25 * (X - 110)) > 0.9) > 0.95


def wedge(periods):
    """A turned ramp that rises to so many periods at a cliff, lit from the left, and what is lit."""
    along, across = 0.9 * (X - 90) + 0.436 * (Y - 75), 0.9 * (Y - 75) - 0.436 * (X - 90)
    on = (np.abs(along) < 40) & (np.abs(across) < 32)
    u = np.where(on, -periods * PERIOD * (along + 40) / 80, 0.0)
    light, lit = X - u, np.ones(SHAPE, bool)
    # The light of a place further on may meet the ramp first.
    for t in np.arange(0.5, periods * PERIOD, 0.5):
        there = np.clip(np.rint(X - t), 0, SHAPE[1] - 1).astype(int)
        lit &= np.take_along_axis(light, there, axis=1) < light + t * 0.02
    return u, lit


@pytest.mark.parametrize("method", ["fourier", pytest.param("windowed", marks=pytest.mark.long)])
@pytest.mark.parametrize("periods", [1.3, 1.6])
def test_a_ramp_that_ends_at_a_cliff_of_a_period_is_right_or_not_measured(periods, method):
    u, lit = wedge(periods)
    pair = Pair(photographed(0.0), photographed(u, lit=lit, seed=1), axis="x")
    error = (reconstruct(pair, method).displacement.displacement_px - u) / PERIOD
    known = np.isfinite(error) & lit
    assert np.mean(np.abs(error[known]) > 0.75) < 0.005
    assert known.mean() > 0.6


def test_an_order_that_only_a_shadow_tells_is_named():
    """The fringes of a box of about a period continue those of the plane on three sides."""
    pair, _, _ = boxed(1.04)
    found = {f.kind: f for f in reconstruct(pair, "fourier").warnings}["shadows"]
    assert found.figures["open_lines"] > 30
    assert "may be off by whole periods" in found.seen


def creased(*, lines):
    """Surfaces in a net of creases, of which so many lines leave one undecided: what is refused.

    Shadows that fit join the others in rows.
    """
    at = np.arange(120)
    crease = (at % 20) < 4
    on = ~(crease[:, None] | crease[None, :])
    undecided = np.zeros(on.shape, bool)
    undecided[44:60, 44:60] = True
    fitting = [(row, at, row, at + 20, 0) for row in range(10, 111, 20) for at in (10, 50, 90)]
    doubtful = [(row, 30, row, 50, 1) for row in range(44, 44 + lines)]
    known = links(*doubtful, *fitting)
    orders = Orders(np.zeros(on.shape, np.int16), undecided)
    told = shadow_orders._told(orders, known)
    return shadow_orders._undecided(told, on, known, known.whole != 0, links(), 8.0)


def test_a_few_lines_take_no_surface_in_a_net_of_creases():
    assert not creased(lines=2).any()


def test_the_doubt_about_a_surface_ends_within_reach_of_it():
    refused = creased(lines=16)
    assert refused[44:60, 44:60].all()
    assert not refused[70:].any()


@pytest.mark.parametrize("method", ["fourier", "windowed"])
def test_a_surface_in_perspective_moves_by_the_periods_of_its_place(method):
    """A box of 1.4 periods of a ray-caster, where the period differs by 2 % from the mean one."""
    bench = Bench(shape=(160, 220), period=12.0)
    reference, object_, u, lit = bench.pair(box(30.0, 45.0))
    result = reconstruct(Pair(reference, object_, axis="x"), method)
    found = result.displacement
    on = (np.abs(u) > 0.6 * found.period_px) & lit & np.isfinite(found.displacement_px)
    z = np.abs(found.displacement_px - u)[on] / found.sigma_px[on]
    assert on.sum() > 1000
    assert np.mean(z < 2.0) > 0.95
    assert next(f for f in result.warnings if f.kind == "shadows").figures["moved_share"] > 0.04
