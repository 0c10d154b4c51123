"""Rims of holes and prints that stay where they are while the fringes move, by a ray-caster."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

from fringeworks import Pair
from fringeworks.pair.analyse import analyse
from fringeworks.pair.prepared import prepare
from fringeworks.pair.still_edges import still_edges
from tests.grids import quick
from tests.two_frames import Bench, dome, flat

pytestmark = pytest.mark.statistical


def dots(albedo):
    """Round holes or prints in a square lattice, on the plane."""

    def paint(x, y):
        dx, dy = (v - 40.0 * np.rint(v / 40.0) for v in (x, y))
        return np.where(dx**2 + dy**2 < 81.0, albedo, 1.0)

    return paint


def slope(x, y):
    """Paint with one straight edge."""
    return np.where(x < 0.3 * y, 1.0, 0.4)


PARTS = ("reference", "object")
PAINT = {"holes": dots(0.0), "prints": dots(0.3), "one edge": slope}


def bench(paint, drift=0.3):
    return Bench(shape=(110, 150), period=9.0, drift=drift, paint=paint)


def drifted(one):
    """The displacement by the drift of the pattern, (h, w), px."""
    h, w = one.shape
    wide, u = np.arange(-40.0, w + 40.0, 0.25), np.empty(one.shape)
    for row in range(h):
        phase, _ = one.coordinate(one.camera, flat, wide, np.full_like(wide, row))
        sign = np.sign(phase[-1] - phase[0])
        here = np.interp(np.arange(w), wide, phase)
        u[row] = np.arange(w) - np.interp(sign * (here + one.drift), sign * phase, wide)
    return u


def from_edges(one):
    """Distance from the nearest edge of paint, px, and where the brighter paint is."""
    yy, xx = np.mgrid[: one.shape[0], : one.shape[1]].astype(float)
    points = one.meet(one.camera, flat, xx, yy)
    paint = one.paint(points[0], points[1])
    low, high = ndimage.minimum_filter(paint, 3), ndimage.maximum_filter(paint, 3)
    return ndimage.distance_transform_edt(high == low), paint == 1.0


@pytest.mark.parametrize("name", quick(list(PAINT), "holes"))
def test_still_edges_do_not_pull_the_displacement(name):
    one = bench(PAINT[name])
    reference, object_, _, _ = one.pair(flat)
    found = analyse(Pair(reference, object_, axis="x"))
    z = np.abs(found.displacement_px - drifted(one)) / found.sigma_px
    distance, bright = from_edges(one)
    inner = np.zeros(one.shape, bool)
    inner[8:-8, 8:-8] = True
    for near, far in ((0, 5), (5, 10)):
        beside = inner & bright & (distance > near) & (distance <= far)
        measured = beside & np.isfinite(z)
        assert measured.sum() > 0.75 * beside.sum()
        assert np.mean(z[measured] < 2) > 0.9
        assert np.mean(z[measured] > 5) < 0.005


def test_fringes_without_paint_have_no_edges():
    one = Bench(shape=(110, 150), period=9.0, beside=500.0, projector_height=350.0, roll=20.0)
    reference, object_, _, _ = one.pair(dome(32.0, 5.0))
    assert still_edges(prepare(Pair(reference, object_, axis="x"))).mean() < 0.01


@pytest.mark.long
def test_a_photographed_plate_is_smooth_beside_its_holes(real_data):
    """A flat plate with holes: rms 2.1 px within 5 px of a rim when its holes counted as shape."""
    folder = real_data / "pair_holes"
    frames = (np.asarray(Image.open(folder / f"{n}.jpg").convert("L")) for n in PARTS)
    u = analyse(Pair(*frames)).displacement_px
    known = np.isfinite(u)
    distance = ndimage.distance_transform_edt(ndimage.binary_opening(known, iterations=2))
    smooth = ndimage.median_filter(np.where(known, u, np.nanmedian(u)), 31)
    beside = known & (distance > 0) & (distance <= 5)
    assert np.sqrt(np.mean((u - smooth)[beside] ** 2)) < 0.3
