"""Orders that the fringes beside a surface tell, and those that nothing tells."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from fringeworks import Pair, reconstruct
from fringeworks.pair.free_surfaces import free_surfaces
from fringeworks.pair.order_range import dark_places
from fringeworks.pair.prepared import prepare
from tests.cliff_scenes import PERIOD, SHAPE, X, Y, boxed, photographed
from tests.two_frames import Bench, box

NO_LINKS = (np.zeros((0, 2), np.intp), np.zeros((0, 2), np.intp))
NEAR_PX = 5
"""Distance from a cliff up to which a surface is broken, px."""


def island(periods):
    """A pair with a low box, its displacement and where it continues."""
    pair, u, _ = boxed(periods)
    cliff = ndimage.maximum_filter(u, 3) != ndimage.minimum_filter(u, 3)
    on = ndimage.distance_transform_cdt(~cliff, "chessboard") > NEAR_PX
    return prepare(pair), u, on


@pytest.mark.parametrize("whole", [-1, 0, 1])
@pytest.mark.parametrize("periods", [0.15, 0.4])
def test_the_fringes_on_both_sides_tell_the_order_of_a_low_box(periods, whole):
    prepared, u, on = island(periods)
    wrong = u + np.where(u < 0, whole * PERIOD, 0.0)
    free = free_surfaces(prepared, wrong, on, NO_LINKS, 8)
    assert free[(u < 0) & on].mean() == (whole != 0)
    assert not free[(u == 0) & on].any()


def test_links_tell_the_order_of_a_surface_without_fringes_beside_it():
    prepared, u, on = island(0.15)
    wrong = u + np.where(u < 0, PERIOD, 0.0)
    rows = np.arange(65, 80)
    links = (np.stack((rows, rows), axis=1), np.stack((0 * rows + 5, 0 * rows + 90), axis=1))
    assert not free_surfaces(prepared, wrong, on, links, rows.size).any()
    assert free_surfaces(prepared, wrong, on, links, rows.size + 1).any()


def test_without_a_surface_at_the_rim_nothing_is_free():
    prepared, u, on = island(0.15)
    inside = np.pad(np.ones((SHAPE[0] - 2, SHAPE[1] - 2), bool), 1)
    assert not free_surfaces(prepared, u, on & inside, NO_LINKS, 8).any()


def faint_box(periods):
    """A box with its shadow, in frames of little contrast: displacement, and what is lit."""
    step, beside = periods * PERIOD, np.abs(Y - 75) < 32
    top = beside & (np.abs(X - 90) < 30)
    lit = ~(beside & (np.abs(X - 120 - 0.5 * step) <= 0.5 * step))
    u = np.where(top, -step, 0.0)
    rng = np.random.default_rng(5)

    def faint(frame):
        counts = 100.0 + 0.15 * (np.asarray(frame, float) - 100.0)
        return np.clip(np.rint(counts + 2.0 * rng.standard_normal(SHAPE)), 0, 255)

    frames = photographed(0.0), photographed(u, lit=lit, seed=1)
    return Pair(*map(faint, frames), axis="x"), u, lit


def test_shadows_are_seen_in_noise():
    pair, _, lit = faint_box(1.04)
    dark, reference = dark_places(prepare(pair))
    shade = ndimage.binary_erosion(~lit, iterations=2)
    assert dark[shade].mean() > 0.95  # 0.6 in single pixels
    assert dark[lit].mean() < 0.3  # fringes have dark parts, too
    assert reference[shade].mean() < 0.3


@pytest.mark.parametrize("periods", [0.85, 1.04])
def test_a_faint_box_is_right_or_its_order_is_in_sigma(periods):
    """Of a box of a period's height, nothing but the shadow is seen: its fringes continue."""
    pair, u, lit = faint_box(periods)
    result = reconstruct(pair, "fourier")
    found = result.displacement
    error = np.abs(found.displacement_px - u)
    far = (error > 0.6 * PERIOD) & (error > 5 * found.sigma_px) & lit
    assert far.mean() < 0.01  # 0.11 in single pixels
    assert "shadows" in [f.kind for f in result.warnings]


def dome(height, radius=24.0, flank=5.0):
    """A dome behind a steep flank."""

    def surface(x, y):
        away = np.hypot(x, y)
        top = 3.0 * np.cos(np.clip(away / radius, 0, 1) * np.pi / 2)
        return height * np.clip((radius - away) / flank, 0, 1) + top

    return surface


SMALL = {"shape": (100, 140), "period": 9.0}


@pytest.mark.parametrize("height", [13.0, 22.0])
def test_a_dome_behind_a_steep_flank_is_right_or_its_order_is_in_sigma(height):
    reference, object_, u, lit = Bench(**SMALL, contrast=0.3, noise=2.0).pair(dome(height))
    found = reconstruct(Pair(reference, object_, axis="x")).displacement
    error = np.abs(found.displacement_px - u)
    far = (error > 0.6 * found.period_px) & (error > 5 * found.sigma_px) & lit
    assert far.mean() < 0.002  # 0.02 by the distance of the surfaces alone


@pytest.mark.parametrize("surface", [box(20.0, 5.0), dome(4.0, flank=12.0)], ids=["box", "dome"])
def test_surfaces_whose_fringes_are_seen_are_not_doubted(surface):
    reference, object_, _, _ = Bench(**SMALL).pair(surface)
    kinds = [f.kind for f in reconstruct(Pair(reference, object_, axis="x")).warnings]
    assert "whole periods" not in kinds
