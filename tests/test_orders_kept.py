"""Right captures whose frames look as if they were in another order are kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

import fringeworks as fw
from fringeworks.patterns import GrayCode, PhaseSteps, Uniform, equal_steps
from fringeworks.stack.explanations import near
from fringeworks.stack.hypothesis import Hypothesis
from tests.bumps import COLUMN, COLUMNS, ROW, ROWS, SIZE, seen


@pytest.mark.parametrize("seed", range(2))
def test_a_bit_that_is_dark_in_nearly_the_whole_view(seed):
    codes = [GrayCode(axis, 4.0, length, True) for axis, length in zip("xy", SIZE, strict=True)]
    plan = fw.PatternPlan(*SIZE, (Uniform("white"), *codes, Uniform("black")))
    found = fw.decode(seen(plan, seed), plan)
    for measured, truth in ((found.x, COLUMN), (found.y, ROW)):
        error = measured.coordinate_px - truth
        assert np.mean(np.abs(error) < 4.0) > 0.98


@pytest.mark.parametrize("cells", [3.7, 4.0])
def test_code_of_whole_cells_per_pixel(cells):
    plan = fw.PatternPlan(1024, 640, (GrayCode("x", 1.0, 1024, True),))
    rng, width, fine = np.random.default_rng(3), 190, 12
    position = np.arange(width * fine) / fine * cells + 5.0
    frames = []
    for k in range(plan.frames):
        light = ndimage.gaussian_filter1d(plan.blocks[0].values(position, k), 0.6 * fine)
        light = light.reshape(width, fine).mean(axis=1)
        counts = 20.0 + 150.0 * light + rng.normal(0.0, 1.5, (40, width))
        frames.append(np.rint(counts).astype(np.uint8))
    found = fw.decode(frames, plan).x
    error = found.coordinate_px - (np.arange(width) * cells + 5.0 + 0.46 * cells - 0.5)
    assert np.mean(np.abs(error) < 2.0 * found.sigma_px) > 0.9


def test_a_view_in_which_first_frames_show_no_pattern():
    steps = equal_steps(4)
    plan = fw.PatternPlan(1280, 64, tuple(PhaseSteps("x", p, steps) for p in (1280, 160, 20)))
    rng = np.random.default_rng(5)
    truth = 710.0 + 1.1 * np.arange(160)
    frames = []
    for block in plan.blocks:
        for k in range(block.frames):
            # An estimated response leaves residuals as large as those of a false order.
            light = (255.0 * block.values(truth, k)) ** 2.4 / 255.0**1.4
            seen = 10.0 + 0.8 * light + rng.normal(0.0, 1.0, (120, 160))
            frames.append(np.clip(np.rint(seen), 0, 255).astype(np.uint8))
    found = fw.decode(frames, plan).x
    assert np.mean(np.abs(found.coordinate_px - truth) < 2.0) > 0.9


def test_rows_that_are_rough_under_every_order_are_no_late_rows():
    """Rows of a crease were called a band that shows the pattern after that of its frame."""
    plan = fw.PatternPlan(640, 480, (PhaseSteps("x", 20.0, equal_steps(4)),))
    rows = Hypothesis(plan, (1, 2, 3, 0), "band", band={"x": np.arange(1000) < 600})
    planned = {"x": np.full(1000, 1.4)}
    some, most = (replace(rows, explained=share) for share in (0.3, 0.6))
    assert not near((0.3 * 600 * 1.4, some), planned)
    assert near((0.6 * 600 * 1.4, most), planned)


def saturated(gain, plan):
    """Frames of which most pixels are saturated; the dark ones see the pattern beside as well."""
    rng = np.random.default_rng(1)
    paint = np.where(np.hypot(COLUMNS - 60.0, ROWS - 70.0) < 25.0, 0.25, 1.0)
    other = np.where(paint < 1.0, 0.45, 0.0)
    frames = []
    for k in range(plan.frames):
        light, indirect = plan.blocks[0].values(COLUMN, k), plan.blocks[0].values(ROW + 90.0, k)
        light = (1.0 - other) * light + other * indirect
        seen = 15.0 + gain * paint * (10.0 + 80.0 * light) + rng.normal(0.0, 1.0, paint.shape)
        frames.append(np.clip(np.rint(seen), 0, 255).astype(np.uint8))
    return frames


def test_saturated_pixels_that_fit_the_plan_vote_for_it():
    """The few others, to which indirect light shows another pattern, were believed."""
    plan = fw.PatternPlan(*SIZE, (GrayCode("x", 8.0, SIZE[0], True),))
    frames = saturated(3.2, plan)
    found = fw.decode(frames, plan).x
    assert np.mean(np.abs(found.coordinate_px - COLUMN) < 8.0) > 0.9
    frames[4], frames[8] = frames[8], frames[4]
    with pytest.raises(fw.InputError, match="saturated: 94% .* besides, frames"):
        fw.decode(frames, plan)
