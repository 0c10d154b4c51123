"""What photographs of pairs show and ideal frames do not: holes, weak fringes, grids, compression."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from benchmarks.pair_coverage import mean_coverage
from fringeworks import Pair, Reason, analyse, reconstruct
from fringeworks.files import read_pair
from fringeworks.pair.presence import _grown_to_rim, without_fringes
from fringeworks.simulate.fringes import PairSettings, capture_pair
from fringeworks.simulate.scene import STANDARD_GEOMETRY, standard_scene
from tests.grids import quick, thinned
from tests.oracles import presence as oracle

pytestmark = pytest.mark.statistical

SIZE = 240
METHODS = ("fourier", "wavelet", "windowed_fourier", "windowed", "exact")
SIGMA_METHODS = ("fourier", "wavelet", "windowed_fourier", "windowed", "ifa", "exact")
LOWER_BARS = {("fourier", "curved", "JPEG 50"): (0.57, 0.89)}
"""Cells that do not reach 0.60 and 0.90 at this period: compression is hidden by the shape."""
UPPER_BARS = {("fourier", "plane", "JPEG 50"): 0.83}
"""Cells of planes that have more than 0.80 within 1 σ: there, error bars say too little."""


def plate(radius=26, **settings):
    """A plate with four holes, which also show in the reference; and where the holes are."""
    y, x = np.mgrid[:SIZE, :SIZE]
    holes = np.zeros((SIZE, SIZE), bool)
    for cy, cx in ((60, 60), (60, 170), (170, 75), (180, 185)):
        holes |= np.hypot(y - cy, x - cx) < radius
    albedo = ndimage.gaussian_filter(np.where(holes, 0.0, 1.0), 0.7)
    chosen = {"fringes": 10, "bits": 8, "noise": 1.0, "ambient": 0.1, "contrast": 0.6, **settings}
    pair = capture_pair(
        np.full(holes.shape, 4.0),
        STANDARD_GEOMETRY,
        PairSettings(**chosen),
        albedo=albedo,
        reference_albedo=albedo,
    )
    return pair, holes


@pytest.mark.parametrize("name", METHODS)
def test_holes_are_not_measured(name):
    pair, holes = plate()
    found = analyse(pair, name)
    inner = ndimage.binary_erosion(holes, iterations=1)
    assert np.mean(found.reason[inner] == Reason.LOW_MODULATION) >= 0.98
    surface = ~ndimage.binary_dilation(holes, iterations=3)
    assert np.mean(found.reason[surface] == Reason.LOW_MODULATION) <= 0.001


@pytest.mark.parametrize("fringes", [5, 10, 30])
@pytest.mark.parametrize("noise", [0.0, 2.0, 6.0])
def test_surfaces_have_fringes_everywhere(fringes, noise):
    """Neither dark paint nor noise nor a steep face is taken for a hole."""
    y, x = np.mgrid[:SIZE, :SIZE]
    albedo = np.where((x // 40 + y // 40) % 2, 1.0, 0.25)
    height = 15.0 * np.clip(1.0 - np.abs(x - 120) / 40, 0.0, 1.0)
    settings = PairSettings(fringes=fringes, bits=8, noise=noise, gamma=2.2, seed=2)
    pair = capture_pair(height, STANDARD_GEOMETRY, settings, albedo=albedo)
    frame = pair.object.astype(float)
    assert not without_fringes(
        frame, np.ones(frame.shape, bool), SIZE / fringes, noise**2 + 1 / 12
    ).any()


def test_holes_of_a_photographed_plate(real_data):
    folder = real_data / "pair_holes"
    pair = read_pair(folder / "reference.jpg", folder / "object.jpg")
    dark = ndimage.gaussian_filter(np.asarray(pair.object, float), 1) < 35
    holes = ndimage.binary_opening(dark, iterations=5)
    found = analyse(pair, "fourier")
    assert np.mean(found.reason[holes] == Reason.LOW_MODULATION) >= 0.98
    surface = ~ndimage.binary_dilation(holes, iterations=4)
    assert np.mean(np.isfinite(found.displacement_px[surface])) >= 0.97


def weak_pair():
    """Fine fringes that fade to less than the noise at one side, with a cone on them."""
    y, x = np.mgrid[:200, :300]
    rng = np.random.default_rng(4)
    period = 7.4
    amplitude = 20.0 * np.exp(-(((x - 120) / 70.0) ** 2)) + 1.5
    u = -6.0 * np.clip(1.0 - np.hypot(x - 130, y - 100) / 45, 0.0, 1.0) ** 0.5 + 0.5
    albedo = np.where(np.hypot(x - 130, y - 100) < 45, 0.55, 1.0)
    reference = 80 + amplitude * np.cos(2 * np.pi * x / period)
    object_ = albedo * (80 + amplitude * np.cos(2 * np.pi * (x - u) / period))
    frames = (
        np.clip(np.rint(f + 2.5 * rng.standard_normal(f.shape)), 0, 255).astype(np.uint8)
        for f in (reference, object_)
    )
    return Pair(*frames, axis="x"), u, period


def test_weak_fine_fringes_are_not_counted_into_garbage():
    pair, u, period = weak_pair()
    found = analyse(pair, "windowed").displacement_px
    ok = np.isfinite(found)
    rim = np.abs(np.hypot(*(np.indices(u.shape) - np.array([100, 130])[:, None, None])) - 45) < 4
    assert ok.mean() >= 0.9
    assert np.mean(np.abs(found - u)[ok & ~rim] > 0.5 * period) == 0.0


def test_photographed_fine_fringes(real_data):
    folder = real_data / "pair_fine"
    pair = read_pair(folder / "reference.jpg", folder / "object.jpg")
    found = analyse(pair, "windowed")
    band = analyse(pair, "windowed_fourier").displacement_px
    ok = np.isfinite(found.displacement_px)
    assert ok.mean() >= 0.95
    off = np.abs(found.displacement_px - band) > 0.5 * found.period_px
    assert not (off & ok).any()


@pytest.mark.parametrize("seeds", [(3,), pytest.param((1, 2, 3), marks=pytest.mark.long)], ids=len)
@thinned(
    strength=1,
    fault=["clean", "JPEG 50", "JPEG 75", "pixel grid", "flicker"],
    shape=["plane", "curved"],
)
def test_sigma_covers_the_errors(shape, fault, seeds):
    """Mean over seeds with different noise, γ and surfaces; the benchmark prints all periods.

    The bars are those of the mean over three seeds, which the long tests take; cells of one seed
    scatter by some per cent, so that one seed shows large faults only.
    """
    found = mean_coverage(shape, fault, (14.0,), seeds, SIGMA_METHODS)
    for name, share in found.items():
        bars = LOWER_BARS.get((name, shape, fault), (0.60, 0.90))
        assert share.within_1 >= bars[0], name
        assert share.within_2 >= bars[1], name
        if shape == "plane" and name in ("fourier", "wavelet"):
            assert share.within_1 <= UPPER_BARS.get((name, shape, fault), 0.80), name


@pytest.mark.parametrize(
    "name", quick(["fourier", "wavelet", "windowed_fourier", "windowed"], "fourier", "wavelet")
)
def test_sigma_covers_a_photographed_plane(real_data, name):
    folder = real_data / "pair_cone"
    found = analyse(read_pair(folder / "reference.jpg", folder / "object.jpg"), name)
    y, x = np.mgrid[:500, :500]
    flat = np.hypot(x - 252, y - 241) > 120
    design = np.stack([np.ones(flat.sum()), x[flat], y[flat]], axis=-1)
    values = found.displacement_px[flat]
    ok = np.abs(values - np.median(values)) < 1.0
    plane = design @ np.linalg.lstsq(design[ok], values[ok], rcond=None)[0]
    ratio = np.abs(values - plane) / found.sigma_px[flat]
    assert np.mean(ratio < 1) >= 0.6
    assert np.mean(ratio < 2) >= 0.85


def test_straightening_can_be_switched_off():
    pair = standard_scene("parabola", size=200, gamma=2.2)
    error = {
        on: np.nanstd(reconstruct(pair, "gsifa", straighten=on).surface.values - pair.truth_mm)
        for on in (True, False)
    }
    assert error[False] > 2 * error[True]


@pytest.mark.parametrize("period", [9.0, 17.0, 24.0])
def test_places_are_grown_as_by_gaussians(period):
    rng = np.random.default_rng(7)
    y, x = np.mgrid[:360, :480].astype(float)
    frame = 100.0 + 0.05 * x + 60.0 * np.cos(2.0 * np.pi * x / period)
    core, shadow = np.zeros((2, *frame.shape), bool)
    for row, column in ((90, 100), (220, 330), (300, 60)):
        away = np.hypot(y - row, x - column)
        shadow |= away < 2.0 * period
        core |= away < 1.2 * period
    frame[shadow] = 12.0
    frame += rng.normal(0.0, 2.0, frame.shape)
    found = _grown_to_rim(frame, core, period)
    expected = oracle.grown_to_rim(frame, core, period)
    assert np.count_nonzero(expected & ~core) > 1000
    assert np.count_nonzero(found != expected) <= 3e-4 * np.count_nonzero(expected)
    assert np.count_nonzero(found != shadow) < 0.01 * np.count_nonzero(shadow)
