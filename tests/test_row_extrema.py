"""Row methods count fringes, not the projector's pixel grid: extrema in the band of the carrier."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import Pair, analyse
from fringeworks.files import read_pair
from fringeworks.pair import height_from_displacement
from fringeworks.pair.methods.inverse_function import find_extrema
from fringeworks.simulate.fringes import PairSettings, capture_pair
from fringeworks.simulate.scene import STANDARD_GEOMETRY
from tests.grids import quick, thinned
from tests.oracles import inverse_function as oracle

HEIGHT, WIDTH = 72, 240
RIM_PX = 12
SLIP_PERIODS = 0.6
GRIDS = [(0.17, 0.5), (0.25, 0.3), (0.25, 0.5), (0.33, 0.5)]
"""Pitch of the grid in fringe periods, and its depth."""


def displacement(shape, period):
    """Displacements, px; the steep one stretches the period to 0.62…1.38 of the mean."""
    y, x = np.mgrid[:HEIGHT, :WIDTH] / WIDTH - 0.5
    y = y + 0.5 - 0.5 * HEIGHT / WIDTH
    if shape == "plane":
        return 0.4 * period * (0.3 + 0.4 * x + 0.3 * y)
    if shape == "curved":
        return 1.3 * period * np.exp(-(x**2 + y**2) / (2 * 0.2**2))
    return 0.38 * WIDTH / (4 * np.pi) * np.sin(4 * np.pi * x) * np.exp(-((y / 0.3) ** 2))


def capture(shape, period, **settings):
    """A pair with noise in 8 bit, and its displacement."""
    u = displacement(shape, period)
    usual = {"gamma": 1.6, "noise": 2, "bits": 8, "contrast": 0.8, "ambient": 0.1}
    chosen = PairSettings(fringes=WIDTH / period, **usual, **settings)
    return capture_pair(
        height_from_displacement(u, STANDARD_GEOMETRY), STANDARD_GEOMETRY, chosen
    ), u


def slipped(found, u, period):
    """Pixels whose fringe order is wrong, away from the ends of the rows."""
    with np.errstate(invalid="ignore"):
        return (np.abs(found.displacement_px - u) > SLIP_PERIODS * period)[:, RIM_PX:-RIM_PX]


@thinned(strength=1, period=[7.5, 12.0, 20.0, 35.0], shape=["plane", "curved", "steep"])
def test_no_row_slips_on_a_pixel_grid(shape, period):
    grids = [(share * period, depth) for share, depth in GRIDS if share * period > 2.3]
    for pitch, depth in [*grids, (2.3, 0.5)]:
        for seed in range(3):
            pair, u = capture(shape, period, grid_px=pitch, grid_depth=depth, seed=seed)
            found = analyse(pair, "exact")
            rows = int(slipped(found, u, period).any(axis=1).sum())
            assert rows == 0, (pitch, depth, seed, rows)
            # At the grid's brightest and darkest points, intensities leave their monotone part.
            assert np.isfinite(found.displacement_px).mean() > 0.8, (pitch, depth, seed)


@pytest.mark.parametrize("name", ["ifa", "sifa", "gsifa"])
def test_all_row_methods_share_the_extrema(name):
    pair, u = capture("curved", 20.0, grid_px=5.0, grid_depth=0.5)
    assert not slipped(analyse(pair, name), u, 20.0).any()


@pytest.mark.parametrize("period", [7.5, 12.0, 20.0, 35.0, 120.0])
def test_as_many_maxima_as_fringes(period):
    x = np.arange(round(30 * period))
    expected = period * (np.arange(30) + 0.4)
    fringes = 0.5 + 0.5 * np.cos(2 * np.pi * (x - expected[0]) / period)
    for seed in range(5):
        noise = 0.02 * np.random.default_rng(seed).standard_normal(x.size)
        for pitch in (period / 3, period / 4, period / 6):
            row = fringes * (0.5 + 0.5 * np.sin(np.pi * x / pitch) ** 2) + noise
            found = find_extrema(row, period, noise=0.02)
            assert found.is_maximum.sum() == 30, (seed, pitch)
            off = found.position_px[found.is_maximum] - expected
            assert np.abs(off).max() < 0.25 * period


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("period", [9.0, 30.0, 70.0])
def test_extrema_on_a_grid_agree_with_the_oracle(period, seed):
    rng = np.random.default_rng(seed)
    x = np.arange(400.0)
    row = np.cos(2 * np.pi * (x + 3 * np.sin(x / 40)) / period) * (1 + 0.4 * np.cos(2.1 * x))
    row += 0.03 * rng.standard_normal(x.size)
    expected = np.array(oracle.extrema(row, period))
    found = find_extrema(row, period)
    np.testing.assert_allclose(found.position_px, expected[:, 0], atol=1e-9)
    np.testing.assert_allclose(found.value, expected[:, 1], atol=1e-9)


def test_cliffs_do_not_slip():
    """A jump within the fringe makes a prominent ripple, which is no fringe either."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    for period in (12.0, 20.0, 35.0):
        u = np.where((abs(x - 120) < 48) & (abs(y - 36) < 20), 0.4 * period, 0.0)
        height = height_from_displacement(u, STANDARD_GEOMETRY)
        settings = PairSettings(fringes=WIDTH / period, gamma=1.6, noise=2, bits=8, contrast=0.8)
        found = analyse(capture_pair(height, STANDARD_GEOMETRY, settings), "exact")
        assert not slipped(found, u, period).any()


@pytest.mark.parametrize("name", quick(["pair_fine", "pair_holes"], "pair_holes"))
def test_orders_of_photographs(real_data, name):
    """Few pixels are off by a period or more, where row methods measure at all."""
    folder = real_data / name
    pair: Pair = read_pair(folder / "reference.jpg", folder / "object.jpg")
    found = analyse(pair, "exact").displacement_px
    band = analyse(pair, "windowed_fourier").displacement_px
    with np.errstate(invalid="ignore"):
        off = np.abs(found - band) > SLIP_PERIODS * analyse(pair, "fourier").period_px
    assert off.sum() < 0.01 * np.isfinite(found).sum()
