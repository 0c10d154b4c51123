"""Rims of bodies before a dark ground, where the lens mixes their light with none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

import fringeworks as fw
from fringeworks.patterns import GrayCode, PhaseSteps, Uniform, equal_steps

pytestmark = pytest.mark.statistical

FINE = 4
"""Samples per camera pixel, along rows and columns."""
SHAPE = (180, 240)
WIDTH = 912
BORDER = 5
"""Pixels at the border of the picture that do not count: the scene ends there."""


def plan_of(kind, period_px):
    steps = {"gray": 4, "hierarchy": 3}[kind]
    fringes = PhaseSteps("x", period_px, equal_steps(steps))
    if kind == "gray":
        ends = (Uniform("white"), Uniform("black"))
        return fw.PatternPlan(WIDTH, 64, (fringes, GrayCode("x", period_px / 2, WIDTH), *ends))
    coarse = (PhaseSteps("x", p, equal_steps(3)) for p in (float(WIDTH), 8 * period_px))
    return fw.PatternPlan(WIDTH, 64, (*coarse, fringes))


def grid():
    y, x = np.mgrid[: SHAPE[0] * FINE, : SHAPE[1] * FINE].astype(np.float32)
    return (y + 0.5) / FINE - 0.5, (x + 0.5) / FINE - 0.5


def leaf(slope, seed):
    """A white sheet with a wavy outline and a hole: coordinates and albedo of every sample."""
    y, x = grid()
    h, w = SHAPE
    turn = np.arctan2(y - h / 2, x - w / 2)
    outline = 0.42 * h * (1.0 + 0.1 * np.sin(3 * turn + seed) + 0.05 * np.sin(7 * turn))
    inside = np.hypot(y - h / 2, 0.75 * (x - w / 2)) < outline
    inside &= np.hypot(y - 0.4 * h, x - 0.6 * w) > 18.0
    bump = np.exp(-((x - 0.3 * w) ** 2 + (y - h / 2) ** 2) / (2 * 40.0**2))
    return 60.0 + slope * (x + 0.1 * y + 6.0 * bump), np.where(inside, 0.6, 0.0)


def ball(slope, seed):
    """A plaster ball that is darker towards its rim."""
    del seed
    y, x = grid()
    h, w = SHAPE
    radius = 0.4 * h
    across = ((x - w / 2) ** 2 + (y - h / 2) ** 2) / radius**2
    up = np.sqrt(np.clip(1.0 - across, 0.0, 1.0))
    shade = 0.75 * np.clip(0.9 * up + 0.42 * (x - w / 2) / radius, 0.0, 1.0)
    return 80.0 + slope * (x + 0.5 * radius * up), np.where(across < 1.0, shade, 0.0)


def pixels(values):
    """Samples of every pixel, (h, w, 16)."""
    h, w = SHAPE
    return values.reshape(h, FINE, w, FINE).transpose(0, 2, 1, 3).reshape(h, w, -1)


def photographed(plan, column, albedo, blur_px, seed):
    rng = np.random.default_rng(seed)
    frames = []
    for pattern in fw.encode(plan):
        row = np.asarray(pattern, float)[0] / 255.0
        light = albedo * (10.0 + 190.0 * np.interp(column, np.arange(WIDTH), row))
        seen = pixels(ndimage.gaussian_filter(light, blur_px * FINE)).mean(axis=-1) + 5.0
        frames.append(np.clip(np.rint(seen + rng.standard_normal(SHAPE)), 0, 255).astype(np.uint8))
    return np.stack(frames)


def scores(body, kind, period_px, slope, blur_px, seed):
    """|error| / σ of the pixels within 4 px of the rim and inside, and the blur that was removed.

    Right is the surface in the middle of a pixel, and beyond a ball's rim what its lit part has.
    """
    plan = plan_of(kind, period_px)
    column, albedo = body(slope, seed)
    decoded = fw.decode(photographed(plan, column, albedo, blur_px, seed), plan)
    samples, lit = pixels(column), pixels(albedo) > 0.0
    some = lit.any(axis=-1)
    low = np.where(lit, samples, np.inf).min(axis=-1)
    high = np.where(lit, samples, -np.inf).max(axis=-1)
    found, sigma = decoded.x.coordinate_px, decoded.x.sigma_px
    steep = high - low > 2.0 * slope
    right = np.where(steep, np.clip(found, low, high), samples.mean(axis=-1))
    known = np.isfinite(found)
    counted = known & some
    counted[:BORDER] = counted[-BORDER:] = counted[:, :BORDER] = counted[:, -BORDER:] = False
    distance = ndimage.distance_transform_edt(known)
    z = np.abs(found - right) / sigma
    blur = decoded.details["x"]["removed_blur_px"]
    return z[counted & (distance < 4.3)], z[counted & (distance > 4.3)], blur


@pytest.mark.parametrize("kind", ["gray", "hierarchy"])
@pytest.mark.parametrize("blur_px", [0.5, 0.9, 1.2])
def test_the_rim_of_a_white_sheet_shows_the_blur(kind, blur_px):
    """Nothing is painted: only the rim tells the blur, and the blur moves only the rim."""
    for seed in (21, 22):
        rim, inner, blur = scores(leaf, kind, 12.0, 1.5, blur_px, seed)
        # The area of a pixel is a part of the blur.
        assert blur == pytest.approx(np.hypot(blur_px, 12**-0.5), rel=0.15)
        assert np.mean(rim < 2.0) > 0.88
        assert np.mean(rim > 5.0) < 2e-3
        assert 0.90 < np.mean(inner < 2.0) < 0.985


@pytest.mark.parametrize("blur_px", [0.3, 0.7, 1.2])
def test_sigma_covers_the_rim_of_a_ball(blur_px):
    """What curves most where it is darkest does not tell its blur: σ holds what it may be."""
    for seed in (31, 32):
        rim, inner, _ = scores(ball, "gray", 10.0, 1.0, blur_px, seed)
        assert np.mean(rim < 2.0) > 0.88
        assert np.mean(rim > 5.0) < 2e-3
        assert np.mean(inner < 2.0) > 0.90
