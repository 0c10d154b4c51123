"""Captures without any fault, of scenes and plans that look like one: nothing is said of them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import fringeworks as fw
from fringeworks.patterns import GrayCode, PhaseSteps, Uniform, equal_steps

WIDTH, SHAPE = 854, (150, 320)
NOISE = 1.2


def photograph(columns, plan, albedo, seed, blur=0.5):
    """Frames of a camera of some blur, px, whose pixels each see the columns around their middle."""
    rng = np.random.default_rng(seed)
    slope = np.abs(np.gradient(columns, axis=1))
    spread = np.median(slope) * (blur**2 + 1.0 / 12.0) ** 0.5
    offs = np.linspace(-2.0, 2.0, 13)
    weights = np.exp(-0.5 * offs**2)
    frames = []
    for block in plan.blocks:
        for k in range(block.frames):
            seen = sum(
                w * np.broadcast_to(block.values(columns + spread * d, k), SHAPE)
                for w, d in zip(weights / weights.sum(), offs, strict=True)
            )
            light = 8.0 + 180.0 * albedo * seen
            frames.append(np.clip(np.rint(light + NOISE * rng.standard_normal(SHAPE)), 0, 255))
    return np.array(frames, np.uint8)


def facets(seed):
    """Columns and albedo of a surface of flat facets, 10 to 26 px wide, at all angles and depths."""
    rng = np.random.default_rng(seed)
    columns, albedo = np.empty(SHAPE), np.empty(SHAPE)
    for top in range(0, SHAPE[0], 15):
        place, at = 0, 40.0
        while place < SHAPE[1]:
            width = int(rng.integers(10, 27))
            u = np.arange(width)[: SHAPE[1] - place]
            slope = rng.uniform(1.4, 2.8)
            columns[top : top + 15, place : place + u.size] = at + slope * u
            albedo[top : top + 15, place : place + u.size] = rng.uniform(0.4, 0.9)
            place, at = place + width, at + slope * u.size + rng.uniform(-12.0, 10.0)
    return columns, albedo


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_creases_are_no_noise(seed):
    """Windows of three fringes hold creases nearly everywhere; neighbouring pixels hardly any."""
    columns, albedo = facets(seed)
    plan = fw.PatternPlan(
        WIDTH,
        SHAPE[0],
        (PhaseSteps("x", 24.0, equal_steps(4)), GrayCode("x", 12.0, WIDTH, inverse=True)),
    )
    found = fw.decode(photograph(columns, plan, albedo, seed), plan)
    assert "correlated noise" not in {f.kind for f in found.findings}
    ok = found.x.reason == 0
    assert ok.mean() > 0.97


@pytest.mark.parametrize(
    ("period", "steps", "line", "light"),
    [(10.0, 5, 2.0, "inverse"), (10.0, 5, 4.0, "inverse"), (12.0, 4, 3.0, "white")],
)
def test_sharp_lines_are_in_order(period, steps, line, light):
    """A sharp line is no cosine: what it leaves of the fit says nothing against its place."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    columns = 235.0 + 1.24 * u + 0.04 * v
    shifts = tuple(np.pi * (line - 1.0) / period + 2.0 * np.pi * np.arange(steps) / steps)
    uniform = (Uniform("black"), Uniform("white")) if light == "white" else ()
    code = GrayCode("x", period, WIDTH, inverse=light == "inverse", offset_px=-period / 2.0)
    phases = PhaseSteps("x", period, shifts, line_px=line)
    plan = fw.PatternPlan(WIDTH, SHAPE[0], (*uniform, code, phases))
    frames = photograph(columns, plan, 0.8, 5, blur=0.3)
    found = fw.decode(frames, plan).x
    ok = found.reason == 0
    assert ok.mean() > 0.95
    assert np.mean(np.abs(found.coordinate_px - columns)[ok] < 2.0 * found.sigma_px[ok]) > 0.92
    for k in range(0, len(frames) - 1, 3):
        swapped = frames.copy()
        swapped[[k, k + 1]] = swapped[[k + 1, k]]
        with pytest.raises(fw.InputError):
            fw.decode(swapped, plan)


def strips(offset_px, width_px, seed):
    """Frames of strips on a plane, within one stripe of the first bit, in weak light."""
    rng, finer, shape = np.random.default_rng(seed), 3, (200, 300)
    blocks = (PhaseSteps("x", 32.0, equal_steps(4)), GrayCode("x", 32.0, 530, inverse=True))
    plan = fw.PatternPlan(530, 64, blocks)
    v, u = np.mgrid[: shape[0] * finer, : shape[1] * finer] / finer
    strip = ((u + 0.3 * v) // width_px) % 3 == 1
    columns = 30.0 + 1.5 * u + 0.05 * v + offset_px * strip
    frames = []
    for block in plan.blocks:
        for k in range(block.frames):
            light = np.where(strip, 120.0, 108.0) * block.values(columns, k)
            light = gaussian_filter(light, 0.6 * finer)
            light = light.reshape(shape[0], finer, shape[1], finer).mean(axis=(1, 3))
            counts = 20.0 + light + 6.0 * rng.standard_normal(shape)
            frames.append(np.clip(np.rint(counts), 0, 255).astype(np.uint8))
    return frames, plan, columns[1::finer, 1::finer]


@pytest.mark.parametrize(("offset_px", "width_px", "seed"), [(10.0, 4.0, 2), (12.0, 8.0, 2)])
def test_a_bit_that_is_dark_everywhere_and_its_inverse_bright_is_in_order(
    offset_px, width_px, seed
):
    frames, plan, _ = strips(offset_px, width_px, seed)
    assert (fw.decode(frames, plan).x.reason == 0).mean() > 0.75


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_surface_of_ridges_is_not_dark(seed):
    """Ridges of 6 px in all windows look like scatter, which says nothing of the light."""
    frames, plan, columns = strips(7.0, 6.0, seed)
    found = fw.decode(frames, plan).x
    ok = found.reason == 0
    assert ok.mean() > 0.8
    assert np.mean(np.abs(found.coordinate_px - columns)[ok] > 16.0) < 1e-4
