"""Dents and outliers of a flat face: which of them flatness holds, and with which σ."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fringeworks.evaluate.part_areas import PartAreas
from tests.tolerance_bodies import NOISE_MM, SIDE, Case, grid, zone

pytestmark = pytest.mark.statistical


@pytest.mark.parametrize("radius_px", [2.0, 4.0, 10.0])
@pytest.mark.parametrize("seed", [21, 22])
def test_flatness_holds_dents_of_a_few_pixels(radius_px, seed):
    """Of 1,600 pixels, seven are few enough to be outliers, and too small for the spline."""
    rng = np.random.default_rng([seed, 77])
    u, v = grid()
    x, y = rng.uniform(-0.5, 0.5, 2)
    far = np.hypot(u - x, v - y) * (SIDE - 1) / 2.0 / radius_px
    dent = 15.0 * NOISE_MM * np.maximum(1.0 - far**2, 0.0) ** 2
    points = np.stack((20.0 * u, 20.0 * v, 500.0 + dent), axis=-1)
    one = Case(zone("iso_flatness"), {"part": points}, {})
    found = PartAreas(one.cloud(rng), one.recipe(), None).measure(one.tolerance)
    assert abs(found.value - dent.max()) < 3.5 * found.sigma
    assert found.sigma < 2.0 * NOISE_MM


def test_single_pixels_that_are_far_are_outliers():
    rng = np.random.default_rng(5)
    u, v = grid()
    points = np.stack((20.0 * u, 20.0 * v, np.full_like(u, 500.0)), axis=-1)
    one = Case(zone("iso_flatness"), {"part": points}, {})
    cloud = one.cloud(rng)
    xyz = cloud.xyz_mm.copy()
    for row, column in ((10, 10), (10, 11), (25, 30)):  # two of them side by side
        xyz[row, column, 2] += 30.0 * NOISE_MM
    found = PartAreas(replace(cloud, xyz_mm=xyz), one.recipe(), None).measure(one.tolerance)
    assert found.value < 2.0 * NOISE_MM
