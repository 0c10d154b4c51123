"""Frames in a wrong order are named at few camera pixels per period; clean stacks are kept."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy import ndimage

import fringeworks as fw
from fringeworks.patterns import GrayCode, PhaseSteps, Uniform, equal_steps
from tests.grids import thinned

PERIOD, LENGTH, FINE = 16.0, 1024, 4


def plan_of(steps, *, cell=8.0, light=""):
    blocks = [
        PhaseSteps("x", PERIOD, equal_steps(steps)),
        GrayCode("x", cell, LENGTH, light == "inverse"),
    ]
    uniform = [Uniform("white"), Uniform("black")] if light == "uniform" else []
    return fw.PatternPlan(LENGTH, 64, (*blocks, *uniform))


PLANS = {
    "3": plan_of(3),
    "3, one period": plan_of(3, cell=16.0),
    "4 uniform": plan_of(4, light="uniform"),
    "3 inverse": plan_of(3, light="inverse"),
}


def photographed(plan, pixels, *, gamma=1.0, seed=0):
    """Frames of a wall with a bump and a step, at a number of camera pixels per period."""
    rng = np.random.default_rng(seed)
    width, rows = int(LENGTH / PERIOD * pixels), np.arange(48)[:, None]
    u = (np.arange(width * FINE) + 0.5) / FINE
    x = 14.0 + 0.96 * u * PERIOD / pixels + 5.0 * np.sin(7.0 * u / width) + 0.1 * rows
    x = x + 20.0 * np.exp(-0.5 * ((u / width - 0.4) / 0.12) ** 2 - ((rows - 26.0) / 18.0) ** 2)
    x = x + np.where((np.abs(u / width - 0.7) < 0.07) & (np.abs(rows - 24) < 16), 55.0, 0.0)
    x = np.clip(x, 0.0, LENGTH - 1.0)
    frames = []
    for block in plan.blocks:
        for k in range(block.frames):
            light = ndimage.gaussian_filter(block.values(x, k) ** gamma, (0.4, 0.4 * FINE))
            light = light.reshape(len(rows), width, FINE).mean(axis=2)
            seen = 12.0 + 190.0 * light + 2.0 * rng.standard_normal(light.shape)
            frames.append(np.clip(np.rint(seen), 0, 255).astype(np.uint8))
    return frames


def refusal(frames, plan):
    try:
        fw.decode(frames, plan)
    except fw.InputError as error:
        return str(error)
    return ""


@thinned(strength=1, name=list(PLANS), pixels=[3, 4, 8])
def test_swapped_frames_are_named(name, pixels):
    plan = PLANS[name]
    frames, labels = photographed(plan, pixels), plan.labels()
    for a, b in list(combinations(range(plan.frames), 2))[::9]:
        swapped = list(frames)
        swapped[a], swapped[b] = frames[b], frames[a]
        said = refusal(swapped, plan)
        assert f"{a} and {b} ({labels[a]}, {labels[b]}) are swapped" in said, said


@pytest.mark.parametrize("pixels", [3, 8])
@pytest.mark.parametrize("name", list(PLANS))
def test_lost_and_repeated_frames_are_named(name, pixels):
    plan = PLANS[name]
    frames, labels = photographed(plan, pixels), plan.labels()
    bit = next(k for k, label in enumerate(labels) if "gray" in label) + 2
    lost = [*frames[:bit], *frames[bit + 1 :], frames[0]]
    said = refusal(lost, plan)
    assert labels[bit] in said, said
    assert "lost" in said
    twice = [*frames[:bit], frames[bit - 1], *frames[bit + 1 :]]
    assert f"{labels[bit]}: it repeats frame {labels[bit - 1]}" in refusal(twice, plan)


@pytest.mark.parametrize("pixels", [3, 8])
def test_codes_of_another_convention_are_named(pixels):
    plan = PLANS["4 uniform"]
    frames = photographed(plan, pixels)
    assert "least significant bit" in refusal([*frames[:4], *frames[10:3:-1], *frames[11:]], plan)
    inverted = [202 + 12 - f.astype(int) for f in frames[4:11]]
    inverted = [np.clip(f, 0, 255).astype(np.uint8) for f in inverted]
    assert "inverted" in refusal([*frames[:4], *inverted, *frames[11:]], plan)


@thinned(strength=1, thorough=2, name=list(PLANS), pixels=[3, 5, 8, 16], gamma=[1.0, 2.2])
def test_clean_stacks_are_in_order(name, pixels, gamma):
    said = refusal(photographed(PLANS[name], pixels, gamma=gamma), PLANS[name])
    assert not said or "expected pixels that can be measured" in said
