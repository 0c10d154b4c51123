"""Fringe orders from two independent estimates."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import Pair, Reason, analyse
from fringeworks.pair.counting import Inverted, RowInversion
from fringeworks.pair.orders import compare_orders, invert_again
from fringeworks.pair.prepared import prepare
from fringeworks.simulate.scene import standard_scene

PERIOD = 20.0


def two_estimates():
    """A true displacement, and one with the scatter of counting."""
    y, x = np.mgrid[:120, :160].astype(float)
    smooth = 30.0 * np.exp(-((x - 80) ** 2 + (y - 60) ** 2) / 2000)
    return smooth, smooth + 0.3 * np.sin(x)


def test_a_region_with_a_wrong_order_is_moved_back():
    truth, counted = two_estimates()
    band = truth.copy()
    band[40:80, 50:90] -= PERIOD
    orders, undecided = compare_orders(band, counted, PERIOD)
    assert not undecided.any()
    np.testing.assert_allclose(band + orders * PERIOD, truth)


def test_a_slip_of_the_second_estimate_changes_nothing():
    truth, counted = two_estimates()
    counted[20:60] += PERIOD
    orders, undecided = compare_orders(truth, counted, PERIOD)
    assert not undecided.any()
    assert not orders.any()


def test_a_common_offset_is_no_disagreement():
    truth, counted = two_estimates()
    orders, undecided = compare_orders(truth, counted + 2 * PERIOD, PERIOD)
    assert not orders.any()
    assert not undecided.any()


def test_a_region_that_continues_neither_side_is_undecided():
    truth, counted = two_estimates()
    band = truth.copy()
    # At the upper border of the region one order is smooth, at the lower border the other.
    counted[40:] += PERIOD
    band[80:] += PERIOD
    _, undecided = compare_orders(band, counted, PERIOD)
    assert undecided[40:80].all()
    assert not undecided[:40].any()
    assert not undecided[80:].any()


def test_small_regions_are_ignored():
    truth, counted = two_estimates()
    counted[60:64, 70:74] += PERIOD
    orders, undecided = compare_orders(truth, counted, PERIOD)
    assert not orders.any()
    assert not undecided.any()


@pytest.mark.parametrize("method", ["gsifa", "exact", "fourier", "windowed", "wavelet"])
def test_stretched_faint_fringes_and_an_albedo_step_keep_the_order(method):
    """A steep face in grazing light: its fringes are twice as wide and a quarter as bright."""
    y, x = np.mgrid[:240, :400].astype(float)
    u = np.interp(x, [80, 200, 300], [0.0, 60.0, 0.0]) * np.clip((110 - np.abs(y - 120)) / 30, 0, 1)
    albedo = np.where((x > 80) & (x < 200) & (np.abs(y - 120) < 110), 0.25, 1.0)
    rng = np.random.default_rng(0)
    reference = 110 + 90 * np.cos(2 * np.pi * x / PERIOD)
    object_ = 5 + albedo * (105 + 90 * np.cos(2 * np.pi * (x - u) / PERIOD))
    frames = [np.round(f + rng.standard_normal(x.shape)) for f in (reference, object_)]
    result = analyse(Pair(*frames), method)
    error = (result.displacement_px - u) / PERIOD
    # A wrong order is an error of about a period over an area; along an edge it is only a line.
    wrong = np.abs(error) > 0.7
    assert np.mean(wrong[np.isfinite(error)]) < 0.02
    assert np.isfinite(error).mean() > 0.9
    assert (result.reason[np.isnan(error)] != Reason.OK).all()


def test_the_chosen_algorithm_is_reported():
    from fringeworks import reconstruct
    from tests.conftest import scene

    result = reconstruct(scene("parabola", size=160, fringes=8, height_mm=20.0), "fourier")
    assert any("unwrapped by reliability: 0 residues, 1 connected" in note for note in result.notes)


@pytest.mark.parametrize("rows", [[0], [2, 3], [50, 51, 70], [118, 119], range(120)])
def test_rows_that_are_inverted_again_are_those_of_the_whole_frame(rows):
    scene = standard_scene("parabola", height_mm=30, size=120, fringes=8, noise=2, bits=8, seed=1)
    counting = RowInversion(prepare(scene), "gsifa")
    limit_px = counting.limit_px(None)
    first = counting.rows(slice(None), limit_px)
    whole = counting.rows(slice(None), limit_px, first.displacement_px)
    wrong = np.zeros(120, bool)
    wrong[list(rows)] = True
    found = Inverted(*(np.array(values) for values in first))
    # What a slip leaves: its own rows are wrong, and those nearby were judged by them.
    for row in np.flatnonzero(wrong):
        near = slice(max(0, row - 3), row + 4)
        found.displacement_px[near] = np.nan
        found.sigma_px[near] = 1e3
        found.modulation_ratio[near] = 1e3
        found.reason[near] = Reason.ORDER_AMBIGUOUS
    invert_again(counting, found, wrong, limit_px, first.displacement_px)
    for name in Inverted._fields:
        np.testing.assert_array_equal(getattr(found, name), getattr(whole, name), name)
