"""σ of a Gray code alone where light is weak: noise leaves bits in doubt far from their borders."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

import fringeworks as fw
from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps, Uniform, equal_steps

WIDTH, SHAPE = 640, (120, 200)


@pytest.mark.parametrize("inverse", [False, True])
@pytest.mark.parametrize(("cell", "noise"), [(2.0, 0.9), (4.0, 0.9), (4.0, 2.0), (8.0, 1.3)])
def test_sigma_covers_at_every_contrast(inverse, cell, noise):
    rng = np.random.default_rng(61)
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    columns = 90.0 + 2.1 * u + 0.13 * v
    albedo = 0.03 + 0.9 * (v / SHAPE[0]) ** 2
    light = () if inverse else (Uniform("white"), Uniform("black"))
    plan = PatternPlan(WIDTH, 120, (*light, GrayCode("x", cell, WIDTH, inverse=inverse)))
    frames = []
    within = np.linspace(-0.5, 0.5, 9)
    for block in plan.blocks:
        for k in range(block.frames):
            # Each pixel sees a camera pixel of columns.
            seen = np.mean(
                [np.broadcast_to(block.values(columns + 2.1 * d, k), SHAPE) for d in within], axis=0
            )
            counts = 5.0 + 200.0 * albedo * seen + noise * rng.standard_normal(SHAPE)
            frames.append(np.clip(np.rint(counts), 0, 255).astype(np.uint8))
    found = fw.decode(frames, plan).x
    contrast = 200.0 * albedo
    for low, high in ((6, 12), (12, 24), (24, 60), (60, 200)):
        part = (found.reason == 0) & (contrast >= low) & (contrast < high)
        if part.sum() < 300:
            continue
        off = np.abs(found.coordinate_px - columns)[part] / found.sigma_px[part]
        assert np.mean(off < 2.0) > 0.92, (low, high)
        assert np.mean(off > 5.0) < 2e-3, (low, high)


def photograph(columns, plan, albedo, noise, seed, mixed=None):
    """Frames of camera pixels of 1.4 columns, of which some see a share of other columns."""
    rng = np.random.default_rng(seed)
    frames = []
    for block in plan.blocks:
        for k in range(block.frames):
            offs = np.linspace(-0.7, 0.7, 7)
            seen = np.mean([block.values(columns + d, k) * np.ones(SHAPE) for d in offs], axis=0)
            if mixed is not None:
                share, others = mixed
                other = np.mean(
                    [block.values(others + d, k) * np.ones(SHAPE) for d in offs], axis=0
                )
                seen = (1.0 - share) * seen + share * other
            counts = 5.0 + 200.0 * albedo * seen + noise * rng.standard_normal(SHAPE)
            frames.append(np.clip(np.rint(counts), 0, 255).astype(np.uint8))
    return frames


def half_cells(period, light):
    uniform = (Uniform("white"), Uniform("black")) if light == "white" else ()
    code = GrayCode("x", period / 2.0, WIDTH, inverse=light == "inverse")
    return PatternPlan(WIDTH, 120, (*uniform, PhaseSteps("x", period, equal_steps(6)), code))


@pytest.mark.parametrize("light", ["white", "inverse", "fringes"])
@pytest.mark.parametrize(("period", "noise"), [(48.0, 4.0), (32.0, 2.5)])
def test_bits_of_weak_light_count_by_their_odds(light, period, noise):
    """A bit at 3 of its 4.5 standard deviations from the threshold is as certain as one at 6 of 6:
    where plain signs are right, few pixels may be lost, and hardly any may be wrong."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    columns = 60.0 + 2.3 * u + 0.11 * v
    plan = half_cells(period, light)
    # Half of the range from black to white is 4 to 7 times the noise of one frame.
    albedo = noise * (4.5 + 2.5 * v / SHAPE[0]) / 100.0
    found = fw.decode(photograph(columns, plan, albedo, noise, 71), plan).x
    ok = found.reason == 0
    off = np.abs(found.coordinate_px - columns)
    assert ok.mean() > 0.9
    assert np.mean(off[ok] > period / 4.0) < 2e-4
    assert np.mean(off[ok] < 2.0 * found.sigma_px[ok]) > 0.93


def test_bits_of_two_surfaces_do_not_count_by_odds():
    """Pixels that see two surfaces have bits between black and white, as in indirect light."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    columns = 60.0 + 2.0 * u + 0.11 * v
    others = 560.0 - 2.2 * u
    plan, noise = half_cells(32.0, "white"), 2.5
    albedo = noise * 6.0 / 100.0
    share = np.where(u % 10 < 5, 0.0, np.random.default_rng(3).uniform(0.2, 0.8, SHAPE))
    found = fw.decode(photograph(columns, plan, albedo, noise, 72, (share, others)), plan).x
    ok = found.reason == 0
    assert ok[share == 0].mean() > 0.9
    off = np.minimum(np.abs(found.coordinate_px - columns), np.abs(found.coordinate_px - others))
    # A twentieth of the mixed pixels would be wrong if their signs counted.
    assert np.mean((off > 16.0) & ok & (share > 0)) < 4e-3


@pytest.mark.parametrize(("gamma", "light"), [(1.0, 0.4), (1.0, 0.5), (2.2, 0.2), (2.2, 0.3)])
def test_bits_that_other_surfaces_light_lie_in_their_own_cell(gamma, light):
    """Cells of a period. Other light makes dark bits weak far from their borders, all the more in
    counts that are not linear: no pixel is taken to lie a period further because of it."""
    cells, steps = GrayCode("x", 80.0, 800), PhaseSteps("x", 80.0, equal_steps(8))
    plan = PatternPlan(800, 40, (steps, cells, Uniform("white"), Uniform("black")))
    rng, x = np.random.default_rng(7), np.linspace(20.0, 780.0, 500)
    frames = []
    for picture in fw.encode(plan):
        row = np.interp(x, np.arange(800.0), ndimage.gaussian_filter1d(picture[0] / 255.0, 3.0))
        other = np.where(np.arange(60)[:, None] < 45, 0.0, light)
        lit = 0.02 + 0.9 * ((1.0 - other) * row + other * picture.mean() / 255.0)
        counts = 250.0 * lit ** (1.0 / gamma)
        frames.append(np.clip(np.rint(counts + rng.normal(0.0, 1.0, counts.shape)), 0, 255))
    found = fw.decode([frame.astype(np.uint8) for frame in frames], plan).x.coordinate_px - x
    assert np.mean(np.abs(found[np.isfinite(found)]) > 20.0) == 0.0
    assert np.mean(np.isfinite(found)) > 0.8
