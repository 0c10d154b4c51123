"""σ of a Gray code alone where light is weak: noise leaves bits in doubt far from their borders."""

from __future__ import annotations

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.patterns.plan import GrayCode, PatternPlan, Uniform

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
