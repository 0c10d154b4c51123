"""A view that sees a third of the widest fringe, under light of the room that changes: what the
frames seem to show of its steps is of no use there, and those of the plan decide the orders."""

from __future__ import annotations

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.patterns import PhaseSteps, equal_steps

SHAPE = (160, 240)
PLAN = fw.PatternPlan(
    1280, 400, tuple(PhaseSteps("x", 1280.0 / n, equal_steps(4)) for n in (1, 8, 64))
)


def photographed(gamma, indirect, away_px, seed=2):
    """Frames with light that other places send, and a room whose light changes by three tenths."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    x = 100.0 + 400.0 * u / SHAPE[1] + 6.0 * np.sin(v / 30.0)
    frames = []
    for block in PLAN.blocks:
        for k in range(block.frames):
            own, other = (block.values(at, k) ** gamma for at in (x, x + away_px))
            room = 20.0 + 36.0 * (1.0 + 0.3 * rng.standard_normal())
            light = room + 150.0 * (own + indirect * other) / (1.0 + indirect)
            noisy = light + 1.2 * rng.standard_normal(SHAPE)
            frames.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    return np.stack(frames), x


@pytest.mark.parametrize(
    ("gamma", "indirect", "away_px"), [(1.0, 0.1, 200.0), (1.0, 0.25, 150.0), (2.0, 0.25, 150.0)]
)
def test_steps_that_leave_no_order_certain_are_those_of_the_plan(gamma, indirect, away_px):
    frames, x = photographed(gamma, indirect, away_px)
    error = np.abs(fw.decode(frames, PLAN).x.coordinate_px - x)
    assert np.isfinite(error).mean() > 0.75
    assert not (error > 10.0).any()
