"""Cliffs: the kernels against their oracles, and what two frames measure beside a cliff."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from scipy import ndimage

import fringeworks as fw
from fringeworks import _core
from fringeworks.pair.windows import spline_coefficients
from tests.cliff_scenes import boxes
from tests.grids import quick
from tests.oracles import cliffs as oracle
from tests.oracles import windowed
from tests.oracles.windowed import LIMITS, options_of, pair_of

pytestmark = pytest.mark.statistical

PERIOD = 20.0
SMALL = (34, 46)
"""Rows and columns for oracles that take milliseconds for a pixel."""


def cliff_problem(size=(48, 64), jump=5.0, seed=5):
    """Spline of the reference, object and displacement of a disc before a plane."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: size[0], : size[1]].astype(float)
    disc = np.hypot(x - 0.47 * size[1], y - 0.5 * size[0]) < 0.29 * size[0]
    u = 0.02 * x + np.where(disc, jump, 0.0)
    s = np.cos(2 * np.pi * x / PERIOD)
    d = 0.1 + 0.9 * np.cos(2 * np.pi * (x - u) / PERIOD) + 0.01 * rng.standard_normal(size)
    edge = ndimage.binary_dilation(disc) & ~ndimage.binary_erosion(disc)
    return spline_coefficients(s), d.astype(np.float32), u.astype(np.float32), edge


def full(shape, value, dtype=np.float32):
    return np.full(shape, value, dtype)


def test_relocation_agrees_with_its_oracle():
    spline, d, u, edge = cliff_problem(SMALL)
    smeared = cv2.GaussianBlur(u, (0, 0), 4.0)
    near = ndimage.binary_dilation(edge, iterations=5)
    clean = (~near).astype(np.uint8)
    present = np.where(near, np.float32(0.2), np.float32(0))
    offset, gain = full(d.shape, 0.1), full(d.shape, 0.9)
    options = {"reach": 20, "margin": 2, "base": 4, "max_change": 10.0, "same": 0.05}
    surfaces = {"displacement": smeared, "offset": offset, "gain": gain}
    found = _core.relocate_surfaces(
        pair_of(spline, d), surfaces, {"clean": clean, "present": present, **options}
    )
    expected = oracle.relocate(
        spline.astype(float), d, smeared, offset, gain, clean, present, **options
    )
    same = np.isclose(found[0], expected[0], atol=1e-3)
    assert same[near].mean() > 0.99  # rays that pass between two pixels
    assert np.abs(found[0] - u)[near].mean() < 0.6 * np.abs(smeared - u)[near].mean()
    np.testing.assert_array_equal(found[0][~near], smeared[~near])


def test_walls_take_the_better_side_as_their_oracle_does():
    spline, d, u, edge = cliff_problem()
    offset, gain = full(d.shape, 0.1), full(d.shape, 0.9)
    surfaces = {"displacement": u, "offset": offset, "gain": gain}
    found = _core.wall_sides(pair_of(spline, d), surfaces, edge.astype(np.uint8))
    expected = oracle.sides(spline.astype(float), d, u, offset, gain, edge)
    assert (found[~edge] == -1).all()
    assert np.mean(found[edge] == expected[edge]) > 0.98


def test_smoothing_stays_within_walls_as_its_oracle_does():
    _, _, u, edge = cliff_problem()
    found = _core.smooth_within_walls(u, edge.astype(np.uint8), 4.0)
    np.testing.assert_allclose(found, oracle.smooth_within(u.astype(float), edge, 4.0), atol=1e-4)
    inside = ndimage.binary_erosion(ndimage.binary_fill_holes(edge), iterations=4)
    assert np.abs(found - u)[inside].max() < 0.2  # 5 px lower outside


@pytest.mark.parametrize(
    "scales",
    [
        *(pytest.param(one, marks=pytest.mark.long) for one in ((32.0,), (8.0,), (8.0, 4.0, 2.0))),
        (3.0,),
    ],
)
def test_windows_with_walls_agree_with_their_oracle(scales):
    spline, d, u, edge = cliff_problem(SMALL)
    start = (u + 0.3).astype(np.float32)
    walls = edge.astype(np.uint8)
    found = _core.invert_windowed(pair_of(spline, d), start, options_of(scales, 1), walls)
    expected = windowed.invert(
        spline.astype(float),
        d.astype(float),
        start.astype(float),
        scales,
        1,
        PERIOD,
        2.5,
        LIMITS,
        edge,
    )
    same = (found[6] == expected[4]) & np.isfinite(found[0])
    assert same[~edge].mean() > 0.98
    assert np.isnan(found[0][edge]).all() == (scales != (2.0,))
    for k in (0, 1, 2):
        close = np.isclose(found[k][same], expected[k][same], rtol=2e-3, atol=5e-4)
        assert close.mean() > 0.995  # lines that pass exactly between two pixels
    assert np.nanmean(np.abs(found[0] - u)) < 0.05


def test_the_kernels_refuse_what_does_not_fit():
    spline, d, u, _ = cliff_problem()
    pair, surfaces = pair_of(spline, d), {"displacement": u, "offset": u, "gain": u}
    short = np.zeros((4, 8), np.uint8)
    with pytest.raises(ValueError, match="walls"):
        _core.wall_sides(pair, surfaces, short)
    with pytest.raises(ValueError, match="walls"):
        _core.smooth_within_walls(u, short, 1.0)
    with pytest.raises(ValueError, match="clean"):
        options = {"reach": 9, "margin": 1, "base": 2, "max_change": 1.0, "same": 0.1}
        _core.relocate_surfaces(pair, surfaces, {"clean": short, "present": u, **options})
    with pytest.raises(ValueError, match="walls"):
        _core.invert_windowed(pair, u, options_of([4.0], 1), short)
    without = {name: array for name, array in pair.items() if name != "object"}
    with pytest.raises(KeyError, match="object"):
        _core.wall_sides(without, surfaces, short)


@cache
def measured_boxes(period, quality=None):
    """Boxes, what is measured of them, the truth, and the distance from cliffs."""
    pair, truth, away = boxes(5, period, quality=quality)
    return pair, fw.analyse(pair, "windowed"), truth, away


@pytest.mark.parametrize(
    ("period", "quality"),
    quick([(16.0, None), (30.0, None), (30.0, 85), (60.0, None)], (30.0, None)),
)
def test_errors_beside_cliffs_are_small(period, quality):
    """Of another scene than the demonstration's, seen by a lens."""
    _, found, truth, away = measured_boxes(period, quality)
    error = np.abs(found.displacement_px - truth) / period
    beside = (away > 5) & (away <= 25)
    assert found.walls is not None
    assert np.nanmean(error[beside]) < 0.002
    assert np.mean(found.reason != 0) < 0.006
    wall = found.walls > 0
    assert np.mean(away[wall] <= 6) > 0.9  # walls lie at cliffs


@pytest.mark.long
def test_painted_cliffs_have_an_albedo_and_walls():
    pair, truth, away = boxes(4, 30.0, painted=True)
    found = fw.analyse(pair, "windowed")
    assert found.walls is not None
    assert found.albedo is not None
    plain = fw.analyse(pair, "windowed", paint=False)
    error, without = (np.abs(r.displacement_px - truth)[away > 5] for r in (found, plain))
    assert np.nanmean(error) < 0.8 * np.nanmean(without)
    inner = np.s_[180:200, 145:155]
    assert np.median(found.albedo[inner]) == pytest.approx(0.6, abs=0.05)


def test_steps_of_paint_every_few_fringes_are_no_cliffs():
    y, x = np.mgrid[:300, :400].astype(float)
    rng = np.random.default_rng(0)
    truth = 2.0 * np.exp(-((x - 200) ** 2 + (y - 150) ** 2) / 5e3)
    albedo = np.where((x // 40 + y // 40) % 2 > 0, 1.0, 0.4)

    def frame(shift, albedo):
        light = ndimage.gaussian_filter(
            albedo * (128 + 90 * np.cos(2 * np.pi * (x - shift) / 25)), 0.7
        )
        return np.clip(np.rint(light + rng.normal(0, 1.5, x.shape)), 0, 255).astype(np.uint8)

    pair = fw.Pair(frame(0 * x, 1.0), frame(truth, albedo), axis="x")
    found = fw.analyse(pair, "windowed")
    assert found.albedo is not None
    assert found.walls is None
    assert np.nanmean(np.abs(found.displacement_px - truth)) < 0.08


def test_a_crease_is_no_cliff():
    """A steep roof: its slope changes by 1.2 px per px, its displacement does not jump."""
    y, x = np.mgrid[:300, :400].astype(float)
    rng = np.random.default_rng(1)
    truth = np.clip(40 - 0.6 * np.abs(y - 150), 0, None)

    def frame(shift):
        light = 128 + 90 * np.cos(2 * np.pi * (x - shift) / 18)
        return np.clip(np.rint(light + rng.normal(0, 1.5, x.shape)), 0, 255).astype(np.uint8)

    found = fw.analyse(fw.Pair(frame(0 * x), frame(truth), axis="x"), "windowed")
    assert found.walls is None
    assert np.nanmean(np.abs(found.displacement_px - truth)[20:-20, 60:-60]) < 0.08


def test_smooth_surfaces_have_no_edges():
    scene = fw.simulate.standard_scene(
        "parabola", size=300, fringes=12, height_mm=15.0, noise=2.0, bits=8
    )
    found = fw.analyse(scene, "windowed")
    assert found.walls is None
    assert found.albedo is None


def test_maps_turn_with_the_frames():
    pair, one, _, _ = measured_boxes(30.0, None)
    turned = replace(pair, reference=pair.reference.T, object=pair.object.T, axis="y")
    other = fw.analyse(turned, "windowed")
    np.testing.assert_array_equal(one.walls, other.walls.T)
