"""Real photographs with frames in a wrong place, and seen by a camera that stands on its side."""

from __future__ import annotations

import re
from itertools import pairwise

import numpy as np
import pytest

from fringeworks import FramesContradictPlan, PatternPlan, decode
from fringeworks.patterns import GrayCode, PhaseSteps, equal_steps
from tests.real_frames import BACK, LIGHT, counts, half

pytestmark = pytest.mark.statistical

SLSTUDIO = [
    PhaseSteps(a, n / k, equal_steps(3)) for a, n in (("x", 1824.0), ("y", 1140.0)) for k in (16, 1)
]


def of_kamino(folder, numbers, *blocks):
    frames = counts(half(folder / f"pat{k:02d}.png") for k in numbers)
    return frames, PatternPlan(1920, 1080, (*blocks, *LIGHT))


@pytest.fixture(scope="module")
def captures(real_data):
    board, objects = real_data / "flat_board_gamma", real_data / "object_gray_phase"
    code, cells = GrayCode("x", 2, 1920), GrayCode("x", 100, 1920)
    fine = [*range(12, 31, 2), 52, 53]
    pose = real_data / "board_procam" / "pose0"
    numbers = [*range(0, 40, 2), 40, 41]
    sets = sorted((real_data / "board_slstudio" / "calseq1").glob("frameSeq_*"))
    return {
        "board": of_kamino(board, [0, 1, 2, *fine], PhaseSteps("x", 240, BACK), code),
        "board, brighter": of_kamino(board, [3, 4, 5, *fine], PhaseSteps("x", 240, BACK), code),
        "code of the board": of_kamino(board, fine, code),
        "objects": of_kamino(
            objects, [3, 4, 5, *range(12, 21, 2), 30, 31], PhaseSteps("x", 100, BACK), cells
        ),
        "chessboard": (
            counts(half(pose / f"graycode_{k:02d}.png") for k in numbers),
            PatternPlan(1024, 768, (GrayCode("x", 1, 1024), GrayCode("y", 1, 768), *LIGHT)),
        ),
        "steps": (counts(half(path) for path in sets), PatternPlan(1824, 1140, tuple(SLSTUDIO))),
    }


CODES = ("board", "board, brighter", "code of the board", "objects", "chessboard")


@pytest.mark.parametrize("name", CODES)
def test_bits_that_are_swapped_are_named(captures, name):
    frames, plan = captures[name]
    bits = [
        range(first, first + block.frames)
        for first, block in plan.placed
        if isinstance(block, GrayCode)
    ]
    decode(frames, plan)
    for a, b in (pair for code in bits for pair in pairwise(code)):
        swapped = list(frames)
        swapped[a], swapped[b] = frames[b], frames[a]
        if np.mean(np.abs(frames[a].astype(float) - frames[b])) < 2.0:
            continue  # both too fine for this camera
        with pytest.raises(FramesContradictPlan, match=f"{a} and {b} ") as caught:
            decode(swapped, plan)
        assert re.search(r"\bare swapped", str(caught.value))


@pytest.mark.parametrize("name", ["steps", "objects"])
def test_a_step_that_repeats_the_one_before_is_named(captures, name):
    frames, plan = captures[name]
    for first, block in plan.placed:
        for k in range(first + 1, first + block.frames):
            if isinstance(block, PhaseSteps):
                repeated = [*frames[:k], frames[k - 1], *frames[k + 1 :]]
                with pytest.raises(FramesContradictPlan, match="it repeats frame"):
                    decode(repeated, plan)


@pytest.mark.parametrize("name", ["board", "objects", "steps"])
def test_a_camera_on_its_side_sees_the_same(captures, name):
    frames, plan = captures[name]
    upright = decode(frames, plan).x
    turned = decode([np.rot90(frame).copy() for frame in frames], plan).x
    coordinate, sigma = (np.rot90(m, -1) for m in (turned.coordinate_px, turned.sigma_px))
    both = np.isfinite(coordinate) & np.isfinite(upright.coordinate_px)
    assert both.sum() > 0.97 * np.isfinite(upright.coordinate_px).sum()
    off = np.abs(coordinate - upright.coordinate_px)[both]
    stated = np.hypot(sigma, upright.sigma_px)[both]
    assert np.mean(off < stated) > 0.9
    assert np.mean(off > 5.0 * stated) < 2e-4
