"""Fringe orders next to the ends of Gray-code cells, by the cells of neighbouring pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import fringeworks as fw
from fringeworks import _core
from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps, Uniform, equal_steps
from fringeworks.stack import neighbours
from fringeworks.stack.kernel_settings import Limits, decoding_of
from fringeworks.types import CameraNoise, Reason
from tests.oracles.vote import UNDECIDED, Votes

WIDTH, SHAPE, FINER = 640, (120, 200), 3


def cells_of(period, light, *, share=1.0, steps=4):
    """Fringes with Gray-code cells of a share of their period."""
    uniform = (Uniform("white"), Uniform("black")) if light == "white" else ()
    code = GrayCode("x", share * period, WIDTH, inverse=light == "inverse")
    return PatternPlan(WIDTH, 120, (*uniform, PhaseSteps("x", period, equal_steps(steps)), code))


def columns_of(shape=SHAPE):
    """A curved surface on a grid finer than the camera's, projector columns."""
    v, u = np.mgrid[: FINER * shape[0], : FINER * shape[1]] / FINER
    return 60.0 + 1.6 * u + 0.12 * v + 9.0 * np.sin(u / 31.0) + 5.0 * np.cos(v / 23.0)


def photograph(columns, plan, contrast, noise, seed, blur_px=0.6):
    """Frames of 8 bit whose fringes have the modulation ``contrast``, counts."""
    rng = np.random.default_rng(seed)
    frames = []
    for block in plan.blocks:
        for k in range(block.frames):
            light = gaussian_filter(
                block.values(columns, k) * np.ones(columns.shape), blur_px * FINER
            )
            light = light.reshape(SHAPE[0], FINER, SHAPE[1], FINER).mean(axis=(1, 3))
            counts = 12.0 + 2.0 * contrast * light + noise * rng.standard_normal(SHAPE)
            frames.append(np.clip(np.rint(counts), 0, 255).astype(np.uint8))
    return frames


def middles(columns):
    return columns.reshape(SHAPE[0], FINER, SHAPE[1], FINER).mean(axis=(1, 3))


@pytest.mark.parametrize("light", ["white", "inverse"])
@pytest.mark.parametrize(("period", "noise", "seed"), [(32.0, 4.0, 81), (40.0, 6.0, 82)])
def test_cells_of_a_whole_period_lose_no_pixels_at_their_ends(light, period, noise, seed):
    plan, columns = cells_of(period, light), columns_of()
    # A modulation of seven times the noise: 15 % of the pixels were ambiguous.
    found = fw.decode(photograph(columns, plan, 7.0 * noise, noise, seed), plan).x
    ok, truth = found.reason == Reason.OK, middles(columns)
    off = np.abs(found.coordinate_px - truth)[ok]
    assert ok.mean() > 0.98
    assert np.mean(off > period / 2.0) == 0.0
    assert 0.92 < np.mean(off < 2.0 * found.sigma_px[ok]) < 0.98


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_weak_light_is_no_reason_to_refuse_a_pixel_as_a_whole(share):
    """At a modulation of 4.5 times the noise every pixel was refused with cells of one period."""
    plan, columns = cells_of(32.0, "inverse", share=share), columns_of()
    found = fw.decode(photograph(columns, plan, 22.0, 4.9, 83), plan).x
    ok, truth = found.reason == Reason.OK, middles(columns)
    assert ok.mean() > 0.85
    assert np.mean(np.abs(found.coordinate_px - truth)[ok] > 16.0) == 0.0


@pytest.mark.parametrize("step_px", [10.0, 16.0, 23.0, 32.0, 45.0, 64.0])
def test_no_order_crosses_a_depth_step(step_px):
    """Strips in front of a surface, of which no single pixel knows its order at the cells' ends."""
    plan, columns = cells_of(32.0, "white"), columns_of()
    v, u = np.mgrid[: columns.shape[0], : columns.shape[1]] / FINER
    columns = columns + step_px * (((u + 0.3 * v) // 20.0) % 5 == 1)
    found = fw.decode(photograph(columns, plan, 30.0, 5.0, int(step_px)), plan).x
    fine = columns.reshape(SHAPE[0], FINER, SHAPE[1], FINER)
    low, high = fine.min(axis=(1, 3)), fine.max(axis=(1, 3))
    whole = high - low < 5.0  # pixels of one surface
    ok = (found.reason == Reason.OK) & whole
    assert ok.sum() > 0.7 * whole.sum()
    assert np.sum(np.abs(found.coordinate_px - middles(columns))[ok] > 10.0) <= 1


def test_kernel_and_twin_agree():
    rng = np.random.default_rng(84)
    shape, period = (41, 67), 20.0
    v, u = np.mgrid[: shape[0], : shape[1]].astype(float)
    x = 70.0 + 1.3 * u + 0.2 * v
    x[:, 40:] += 33.0
    variance = rng.uniform(0.002, 0.08, shape)
    phase = 2.0 * np.pi * (x / period - np.rint(x / period))
    phase = phase + np.sqrt(variance) * rng.standard_normal(shape)
    decoding = decoding_of(cells_of(period, "white"), "x", absolute=True, response=None)
    assert decoding.gray is not None
    middle = (np.floor((x + 0.5) / period) + 0.5) * period - 0.5
    half = np.full(shape, 0.5 * period)
    middle[rng.random(shape) < 0.1] = np.nan
    wide = rng.random(shape) < 0.1
    half[wide] = period
    reason = np.where(rng.random(shape) < 0.4, Reason.OK, Reason.ORDER_AMBIGUOUS).astype(np.uint8)
    reason[rng.random(shape) < 0.05] = Reason.SHADOW
    turns = phase / (2.0 * np.pi)
    order = np.rint(x / period - turns)
    coordinate = np.where(reason == Reason.OK, (turns + order) * period, np.nan)
    cells = [middle.astype(np.float32), half.astype(np.float32)]
    maps = {
        "coordinate": coordinate.astype(np.float32),
        "sigma": np.where(reason == Reason.OK, 0.1, np.nan).astype(np.float32),
        "reason": reason.copy(),
        "phases": [phase.astype(np.float32)],
        "variances": [variance.astype(np.float32)],
        "cells": cells,
    }
    rules = {"radius": 3, "ahead": 5, "others": 0.1, "continued": 0.7}
    kernel = decoding.kernel(CameraNoise(1.0), Limits(float("inf")))
    changed = _core.vote_cells(kernel, maps, rules)
    lit = reason != Reason.SHADOW
    twin = Votes(phase[None], variance[None], lit, [period], (-0.5, WIDTH - 0.5))
    known = np.where(reason == Reason.OK, order, UNDECIDED)
    asked = reason == Reason.ORDER_AMBIGUOUS
    slack = decoding.gray.kernel({k: k for k in decoding.frames}, period, None)["slack"]
    orders = twin.cell_orders((middle, half), known, asked, slack, rules)
    decided = orders != UNDECIDED
    same = (maps["reason"] == Reason.OK)[asked] == decided[asked]
    assert changed > 200
    assert same.mean() > 0.997
    both = asked & decided & (maps["reason"] == Reason.OK)
    off = maps["coordinate"] - (turns + orders) * period
    assert np.abs(off[both]).max() < 1e-3
    assert np.isfinite(maps["sigma"][both]).all()


def test_edges_alone_do_not_ask_the_neighbours(monkeypatch):
    monkeypatch.setattr(neighbours._core, "vote_cells", None)
    plan, columns = cells_of(32.0, "white", share=0.5), columns_of()
    found = fw.decode(photograph(columns, plan, 90.0, 1.0, 85), plan).x
    assert found.failed_fraction < 0.01


def test_sets_of_several_periods_are_not_asked():
    decoding = decoding_of(cells_of(32.0, "white"), "x", absolute=True, response=None)
    two = replace(decoding, sets=decoding.sets * 2)
    results = {"reason": np.full((4, 4), Reason.ORDER_AMBIGUOUS, np.uint8)}
    assert not neighbours.worth_voting(two, results)
