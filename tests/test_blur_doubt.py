"""Balls up to their rims, by rigs that know the camera's blur and by rigs that do not.

The photographs are those of the second simulator, whose rims are mixed within each pixel.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.evaluate import AcceptanceTest, Area, BallBar, TestScan, TestVolume
from fringeworks.evaluate.acceptance.measured import measure_position
from fringeworks.evaluate.area_points import area_points
from fringeworks.evaluate.blur_doubt import with_blur_doubt
from fringeworks.evaluate.quantities import MEASURED
from fringeworks.simulate.standard import fringe_plan, standard_rig
from fringeworks.types import CameraBlur
from tests.ray_caster import Ball, Photographs

pytestmark = pytest.mark.statistical

RADII = (12.0, 10.0)


def scanned(seed, blur_px, *, known):
    """Two balls at random, 70 mm apart: their rig and points."""
    rng = np.random.default_rng([48, seed])
    middle = np.array([rng.uniform(-15, 15), rng.uniform(-20, 20), rng.uniform(490, 530)])
    way = np.array([1.0, rng.uniform(-0.4, 0.4), rng.uniform(-0.2, 0.2)])
    way *= 35.0 / np.linalg.norm(way)
    balls = [Ball(tuple(middle + s * way), r) for s, r in zip((-1.0, 1.0), RADII, strict=True)]
    rig = standard_rig(scale=0.3)
    plan = fringe_plan(rig, both=False)
    stack = Photographs(rig, balls).stack(plan, blur_px=blur_px, noise=1.0, seed=seed)
    if known:
        factors = (blur_px**2 + 1.0 / 12.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        rig = replace(rig, blur=CameraBlur(factors, 510.0, (300.0, 800.0), 0.05))
    return rig, balls, fw.measure(stack, rig).points


def near(cloud, ball):
    """All points of a ball, the last ones at its rim included."""
    off = np.linalg.norm(cloud.xyz_mm - np.array(ball.centre_mm), axis=-1) - ball.radius_mm
    return Area(mask=np.abs(np.nan_to_num(off, nan=np.inf)) < 0.5)


@pytest.mark.parametrize("blur_px", [0.4, 0.6])
def test_a_diameter_holds_its_sigma_without_a_known_blur(blur_px):
    """The last points before a rim make balls 0.1 mm too large: four of the σ that noise makes."""
    for seed in (901, 902):
        rig, balls, cloud = scanned(seed, blur_px, known=False)
        doubted = with_blur_doubt(cloud, rig)
        assert with_blur_doubt(doubted, rig) is doubted
        for ball in balls:
            found = MEASURED["sphere_diameter"](area_points(doubted, near(cloud, ball), rig))
            assert abs(found.value - 2.0 * ball.radius_mm) < 2.0 * found.sigma
            assert found.sigma < 0.06


@pytest.mark.parametrize("known", [True, False])
def test_the_probing_error_of_a_perfect_ball_is_within_its_sigma(known):
    diameters = tuple(2.0 * r for r in RADII)
    bar = BallBar(70.0, diameters, 0.001, 0.0005)
    test = AcceptanceTest(TestVolume((0.0, 0.0, 510.0), (150.0, 110.0, 60.0)), bar)
    for seed in (911, 912):
        rig, _, cloud = scanned(seed, 0.5, known=known)
        one = measure_position(TestScan("ball bar", cloud), test, rig)
        for error, sigma in zip(one.values_mm["PS"], one.sigma_mm["PS"], strict=True):
            assert abs(error) < 2.5 * sigma
            assert abs(error) < 0.03


def test_surfaces_that_tell_no_light_stay_as_they_are():
    rig, _, cloud = scanned(921, 0.5, known=False)
    assert with_blur_doubt(cloud, None) is cloud
    dark = replace(cloud, colour=None)
    assert with_blur_doubt(dark, rig) is dark
