"""Fusion of exposures that were decoded by themselves: against truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fringeworks.stack.fusing import fuse
from fringeworks.types import CameraNoise, CoordinateMap, Decoded, InputError, Reason

SHAPE = (120, 160)
TRUTH = np.tile(np.linspace(100.0, 300.0, SHAPE[1]), (SHAPE[0], 1))


def exposure(rng, sigma, *, common=0.0, error=None, brightness=1.0, hidden=None, repeats=None):
    """A result with known errors: its own of ``sigma``, and those that all exposures share."""
    sigma = np.broadcast_to(sigma, SHAPE)
    x = TRUTH + sigma * rng.standard_normal(SHAPE) + (0.0 if error is None else error)
    told = np.sqrt(sigma**2 + common**2)
    reason = np.zeros(SHAPE, np.uint8)
    if hidden is not None:
        reason[hidden[0]] = hidden[1]
    if repeats:
        x = (x + 0.5) % repeats - 0.5
    x, told = (np.where(reason == 0, v, np.nan).astype(np.float32) for v in (x, told))
    modulation = np.full(SHAPE, 50.0 * brightness, np.float32)
    found = CoordinateMap(
        x, told, modulation, modulation * 1.2, reason, "x", (16.0,), repeats_px=repeats
    )
    return Decoded(found, None, CameraNoise(1.0))


def coverage(found):
    ok = found.x.reason == 0
    return np.mean(np.abs(found.x.coordinate_px - TRUTH)[ok] <= found.x.sigma_px[ok])


def test_one_result_stays_as_it_is():
    one = exposure(np.random.default_rng(0), 0.05)
    assert fuse([one]) is one


@pytest.mark.parametrize("seed", range(4))
def test_independent_noise_averages_out(seed):
    rng = np.random.default_rng(seed)
    wedge = np.linspace(0.03, 0.06, SHAPE[0])[:, None]
    sigmas = [wedge, wedge[::-1], 0.1]
    found = fuse([exposure(rng, s) for s in sigmas])
    expected = sum(np.broadcast_to(s, SHAPE) ** -2.0 for s in sigmas) ** -0.5
    assert found.x.failed_fraction == 0
    assert np.median(found.x.sigma_px / expected) == pytest.approx(1.0, abs=0.03)
    assert coverage(found) == pytest.approx(0.683, abs=0.012)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("common", [0.03, 0.1])
def test_common_errors_do_not(seed, common):
    rng = np.random.default_rng(seed)
    error = common * rng.standard_normal(SHAPE)
    found = fuse([exposure(rng, 0.03, common=common, error=error) for _ in range(3)])
    assert coverage(found) == pytest.approx(0.683, abs=0.015)
    finding = found.findings[-1]
    assert finding.kind == "exposures"
    assert finding.figures["common_px"] == pytest.approx(common, rel=0.15)


@pytest.mark.parametrize("seed", range(4))
def test_wrong_orders_in_one_exposure_are_left_out(seed):
    rng = np.random.default_rng(seed)
    wrong = rng.random(SHAPE) < 0.05
    results = [exposure(rng, s) for s in (0.05, 0.08, 0.2)]
    bad = results[seed % 3].x
    x = bad.coordinate_px + np.where(wrong, 16.0, 0.0).astype(np.float32)
    results[seed % 3] = replace(results[seed % 3], x=replace(bad, coordinate_px=x))
    found = fuse(results)
    assert (found.x.reason[wrong] == Reason.ORDER_AMBIGUOUS).all()
    assert np.isnan(found.x.coordinate_px[wrong]).all()
    assert np.isnan(found.x.sigma_px[wrong]).all()
    assert np.mean(found.x.reason[~wrong] != 0) < 1e-3
    assert coverage(found) == pytest.approx(0.683, abs=0.015)
    assert "moved between" in found.findings[-1].text


def test_every_exposure_adds_its_pixels():
    rng = np.random.default_rng(1)
    left, right = np.zeros(SHAPE, bool), np.zeros(SHAPE, bool)
    left[:, :60], right[:, 50:] = True, True
    found = fuse(
        [
            exposure(rng, 0.05, hidden=(right, Reason.LOW_MODULATION)),
            exposure(rng, 0.02, brightness=4.0, hidden=(left, Reason.SATURATED)),
        ]
    )
    assert (found.x.reason[:, :50] == 0).all()
    assert (found.x.reason[:, 60:] == 0).all()
    assert (found.x.reason[:, 50:60] == Reason.SATURATED).all()
    # There is no pixel in common that would tell the ratio of the brightnesses.
    assert np.isfinite(found.x.modulation[:, :50]).all()
    assert np.isnan(found.x.modulation[:, 60:]).all()
    overlap = left & (np.arange(SHAPE[1]) >= 40)
    shown = fuse(
        [
            exposure(rng, 0.05, hidden=(right, Reason.LOW_MODULATION)),
            exposure(rng, 0.02, brightness=4.0, hidden=(left & ~overlap, Reason.SATURATED)),
        ]
    )
    assert np.allclose(shown.x.modulation, 50.0)
    assert np.allclose(shown.x.background, 60.0)


def test_relative_coordinates_are_fused_across_their_seam():
    rng = np.random.default_rng(2)
    found = fuse([exposure(rng, 0.2, repeats=40.0) for _ in range(2)])
    x = found.x.coordinate_px
    assert ((x >= -0.5) & (x < 39.5)).all()
    off = (x - TRUTH + 20.0) % 40.0 - 20.0
    assert np.mean(np.abs(off) <= found.x.sigma_px) == pytest.approx(0.683, abs=0.012)


def test_results_that_do_not_belong_together_are_refused():
    rng = np.random.default_rng(0)
    one = exposure(rng, 0.1)
    with pytest.raises(InputError, match="at least one"):
        fuse([])
    with pytest.raises(InputError, match="exposure 2: expected results along x, got y"):
        fuse([one, Decoded(None, replace(one.x, axis="y"), one.noise)])
    with pytest.raises(InputError, match="periods"):
        fuse([one, replace(one, x=replace(one.x, periods_px=(8.0,)))])
