"""Two frames and one: orders beside cliffs, waveforms, skirts of objects, and tilted fringes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fringeworks import InputError, Pair, reconstruct
from fringeworks.pair.analyse import analyse
from fringeworks.pair.carrier import find_carrier
from fringeworks.pair.prepared import prepare
from fringeworks.pair.shadow_orders import by_shadows
from fringeworks.pair.tears import without_tears
from tests.cliff_scenes import PERIOD, X, Y, box, boxed, photographed

pytestmark = pytest.mark.statistical


@pytest.mark.parametrize("periods", [0.7, 0.85, 1.4, 1.7])
@pytest.mark.parametrize("method", ["fourier", "windowed"])
def test_a_shadow_corrects_the_order_of_the_box_that_casts_it(periods, method):
    pair, u, lit = boxed(periods)
    result = reconstruct(pair, method)
    error = (result.displacement.displacement_px - u)[lit] / PERIOD
    known = np.isfinite(error)
    # 12 % without the shadow; the rest are edges that filters have smeared.
    assert np.mean(np.abs(error[known]) > 0.75) < 0.02
    assert known.mean() > 0.7
    assert "shadows" in [f.kind for f in result.warnings]


@pytest.mark.parametrize("periods", [0.96, 1.03])
def test_sigma_covers_a_box_of_a_periods_height(periods):
    """Its fringes continue those of the plane: only its shadow shows that it stands there."""
    pair, u, lit = boxed(periods)
    result = reconstruct(pair, "fourier")
    found = result.displacement
    ratio = (np.abs(found.displacement_px - u) / found.sigma_px)[lit]
    ratio = ratio[np.isfinite(ratio)]
    assert np.mean(ratio < 2) > 0.97  # 0.86 without a part of σ for it
    assert np.mean(ratio > 5) < 0.01
    assert "shadows" in [f.kind for f in result.warnings]
    beside = found.sigma_px[:20]  # rows without a shadow
    assert np.nanmedian(beside) < 0.1 * PERIOD


def test_sigma_covers_a_dome_behind_flanks_that_fringes_do_not_follow():
    radius = np.hypot(X - 110, Y - 75)
    flank = 1.5 * PERIOD * np.clip((52 - radius) / 10, 0, 1)
    top = 0.2 * PERIOD * np.cos(np.clip(radius / 40, 0, 1.57))
    u = np.where(radius < 52, -flank - top, 0.0)
    pair = Pair(photographed(0.0), photographed(u, seed=1), axis="x")
    result = reconstruct(pair, "windowed")
    found = result.displacement
    error = np.abs(found.displacement_px - u)
    known = np.isfinite(error)
    assert np.mean(error[known] > 0.6 * PERIOD) > 0.1  # a period off
    assert np.mean((error < 2 * found.sigma_px)[known]) > 0.98  # 0.73 without
    assert np.nanmedian(found.sigma_px[radius > 90]) < 0.1 * PERIOD
    (told,) = (f for f in result.warnings if f.kind == "whole periods")
    assert told.figures["free_share"] == pytest.approx(np.mean(radius < 52), rel=0.6)


@pytest.mark.parametrize("periods", [0.2, 0.35])
def test_a_low_box_keeps_its_order(periods):
    pair, _, _ = boxed(periods)
    prepared = prepare(pair)
    found = analyse(prepared, "fourier")
    again, orders = by_shadows(prepared, found)
    assert again is found
    assert orders.open_lines < 8


def test_dark_paint_is_no_shadow():
    dark = (np.abs(Y - 75) < 30) & (np.abs(X - 120) < 10)
    reference, object_ = (photographed(0.0, lit=~dark, seed=seed) for seed in (0, 1))
    prepared = prepare(Pair(reference, object_, axis="x"))
    found = analyse(prepared, "fourier")
    again, orders = by_shadows(prepared, found)
    assert again is found
    assert orders.open_lines == 0


@pytest.mark.parametrize("whole", [-1, 2])
def test_a_surface_torn_off_by_whole_periods_is_moved_back(whole):
    hill = -8.0 * np.exp(-((X - 110) ** 2 + (Y - 75) ** 2) / 900)
    prepared = prepare(Pair(photographed(0.0), photographed(hill, seed=1), axis="x"))
    found = analyse(prepared, "fourier")
    torn = (X > 140) & (np.abs(Y - 60) < 25)
    moved = found.displacement_px + torn * whole * found.period_px
    again, count = without_tears(prepared, replace(found, displacement_px=moved))
    assert count == pytest.approx(torn.sum(), rel=0.02)
    # The period of the place is that of the reference, which noise changes by 1e-3.
    left = np.abs(again.displacement_px - found.displacement_px)
    assert np.mean(left > 1e-3 * PERIOD * abs(whole)) < 0.002


def test_steps_of_other_heights_are_no_tears():
    u, lit = box(0.4)
    prepared = prepare(Pair(photographed(0.0), photographed(u, lit=lit, seed=1), axis="x"))
    found = analyse(prepared, "windowed")
    assert without_tears(prepared, found)[1] == 0


@pytest.mark.parametrize("gamma", [1.4, 2.2])
def test_a_single_frame_has_the_waveform_of_its_background(gamma):
    u = -9.0 * np.maximum(1.0 - np.hypot(X - 110, Y - 75) / 45.0, 0.0)
    frame = photographed(u, gamma=gamma)
    found = reconstruct(Pair(None, frame, axis="x"), "windowed").displacement
    away = np.hypot(X - 110, Y - 75) > 55
    z = (found.displacement_px - u) / found.sigma_px
    assert np.nanmean(np.abs(z) < 2.0) > 0.93
    assert np.nanmedian(found.sigma_px) < 0.2
    assert np.nanmax(np.abs(found.displacement_px[away][:, None])) < 1.0


@pytest.mark.parametrize("place", [(60, 60), (110, 75), (160, 90)])
def test_the_skirt_of_an_object_does_not_tilt_its_background(place):
    x, y = place
    u = -20.0 * np.exp(-((X - x) ** 2 + (Y - y) ** 2) / (2 * 22.0**2))
    found = reconstruct(Pair(None, photographed(u), axis="x"), "windowed").displacement
    z = (found.displacement_px - u) / found.sigma_px
    assert np.nanmean(np.abs(z) < 2.0) > 0.9
    assert np.nanmean(np.abs(z) > 5.0) < 1e-3


@pytest.mark.parametrize("tilt", [-46.0, -44.5, 44.5, 46.0])
def test_fringes_at_45_degrees_have_a_carrier(tilt):
    across = X * np.cos(np.radians(tilt)) + Y * np.sin(np.radians(tilt))
    hill = 0.8 * np.exp(-((X - 110) ** 2 + (Y - 75) ** 2) / 900)
    frame = 100 + 60 * np.cos(2 * np.pi * across / 15.0 + 2 * np.pi * hill)
    found = find_carrier(frame)
    assert abs(found.tilt_deg) < 50.0
    assert 1 / np.hypot(1 / found.period_px, found.cross_frequency) == pytest.approx(15.0, rel=0.05)


def test_fringes_along_the_axis_that_was_asked_for_are_told():
    across = X * np.cos(np.radians(70)) + Y * np.sin(np.radians(70))
    frame = 100 + 60 * np.cos(2 * np.pi * across / 12.0)
    with pytest.raises(InputError, match="tilted by at most 60° against axis x, got 70°"):
        find_carrier(frame, "x")


def test_the_drift_of_a_row_method_is_removed():
    u = -6.0 * np.exp(-((X - 110) ** 2 + (Y - 75) ** 2) / 900)
    pair = Pair(photographed(0.0), photographed(u, drift=0.05, seed=1), axis="x")
    result = reconstruct(pair, "gsifa")
    assert "moved frame" in [f.kind for f in result.warnings]
    assert abs(np.nanmedian(result.displacement.displacement_px - u)) < 0.05
