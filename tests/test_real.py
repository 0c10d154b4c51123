"""Photographed pairs; skipped where there are none."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import Reason, read_pair, reconstruct
from fringeworks.fits import fit_cone, fit_plane
from fringeworks.types import count_reasons

CENTRE = (252.0, 241.0)


@pytest.fixture(scope="module")
def cone(real_data):
    capture = read_pair(
        real_data / "pair_cone" / "reference.jpg", real_data / "pair_cone" / "object.jpg"
    )
    return {name: reconstruct(capture, name) for name in ("windowed", "fourier", "gsifa")}


@pytest.fixture(scope="module")
def radius():
    y, x = np.mgrid[:500, :500]
    return np.hypot(x - CENTRE[0], y - CENTRE[1])


def test_flanks_are_straight(cone, radius):
    fits = {
        name: fit_cone(cone[name].surface.values, radius < 60) for name in ("windowed", "fourier")
    }
    assert fits["windowed"].rms < 0.13
    assert fits["windowed"].rms < fits["fourier"].rms
    # The apex stays where the flanks put it; a band-pass rounds it off.
    apex = fits["windowed"].parameters["apex"]
    tip = {name: np.nanmax(cone[name].surface.values[radius < 12]) for name in fits}
    assert tip["windowed"] == pytest.approx(apex, abs=0.4)
    assert tip["fourier"] < apex - 1.5


def test_background_is_flat(cone, radius):
    fit = fit_plane(cone["windowed"].surface.values, radius > 110)
    assert fit.rms <= 0.06


def test_displacement_says_so(cone):
    surface = cone["windowed"].surface
    assert (surface.unit, surface.quantity) == ("px", "displacement")
    assert any("geometry unknown" in note for note in cone["windowed"].notes)
    assert any("luminance" in note or "grey" in note for note in cone["windowed"].notes)
    assert surface.failed_fraction < 0.01


def test_gsifa_runs_and_its_failures_carry_reasons(cone, radius):
    surface = cone["gsifa"].surface
    failed = ~np.isfinite(surface.values)
    assert 0 < failed.mean() < 0.05
    assert (surface.reason[failed] != Reason.OK).all()
    assert sum(count_reasons(surface.reason).values()) == failed.size
    background = surface.values[(radius > 110) & ~failed]
    assert np.abs(np.median(background)) < 0.5
    assert np.mean(np.abs(background) > 10) < 0.001  # no row slips by a period


def test_pyramid_runs(real_data):
    """Its grazing face is for a later method; here nothing may fall over or lose its reasons."""
    folder = real_data / "pair_pyramid"
    surface = reconstruct(read_pair(folder / "reference.jpg", folder / "object.jpg")).surface
    failed = ~np.isfinite(surface.values)
    assert (surface.reason[failed] != Reason.OK).all()
    assert surface.failed_fraction < 0.3
