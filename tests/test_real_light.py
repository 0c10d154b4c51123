"""Real photographs under exposures that differ from frame to frame, and under more noise."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import PatternPlan, decode
from fringeworks.patterns import GrayCode, PhaseSteps
from tests.real_frames import BACK, LIGHT, counts, half

pytestmark = pytest.mark.statistical

BOTH_CODES = (GrayCode("x", 1, 1024), GrayCode("y", 1, 768))


@pytest.fixture(scope="module")
def captures(real_data):
    objects, board = real_data / "object_gray_phase", real_data / "flat_board_gamma"
    fine = [*range(12, 31, 2), 52, 53]
    of_objects = [*range(6), *range(12, 21, 2), 30, 31]
    poses = {
        f"chessboard {k}": (
            [real_data / "board_procam" / f"pose{k}" / f"graycode_{n:02d}.png" for n in numbers],
            PatternPlan(1024, 768, (*BOTH_CODES, *LIGHT)),
        )
        for k, numbers in ((0, [*range(0, 40, 2), 40, 41]), (2, [*range(0, 40, 2), 40, 41]))
    }
    cells = GrayCode("x", 100, 1920)
    stacks = {
        "board": (
            [board / f"pat{k:02d}.png" for k in fine],
            PatternPlan(1920, 1080, (GrayCode("x", 2, 1920), *LIGHT)),
        ),
        "fringes on the board": (
            [board / f"pat{k:02d}.png" for k in (3, 4, 5, *fine)],
            PatternPlan(1920, 1080, (PhaseSteps("x", 240, BACK), GrayCode("x", 2, 1920), *LIGHT)),
        ),
        "objects": (
            [objects / f"pat{k:02d}.png" for k in of_objects[3:]],
            PatternPlan(1920, 1080, (PhaseSteps("x", 100, BACK), cells, *LIGHT)),
        ),
        "objects, two sets": (
            [objects / f"pat{k:02d}.png" for k in of_objects],
            PatternPlan(
                1920,
                1080,
                (PhaseSteps("x", 200 / 3, BACK), PhaseSteps("x", 100, BACK), cells, *LIGHT),
            ),
        ),
        **poses,
    }
    return {name: ([half(p) for p in paths], plan) for name, (paths, plan) in stacks.items()}


def compared(plain, found):
    """Share of the measured pixels that is still measured, and differences over their σ and px."""
    both = np.isfinite(plain.coordinate_px) & np.isfinite(found.coordinate_px)
    off = np.abs(found.coordinate_px - plain.coordinate_px)[both]
    stated = np.hypot(plain.sigma_px, found.sigma_px)[both]
    return both.sum() / np.isfinite(plain.coordinate_px).sum(), off / stated, off


@pytest.mark.parametrize("name", ["board", "objects", "chessboard 0", "chessboard 2"])
@pytest.mark.parametrize("light", ["mean", "rising", "random"])
def test_exposures_of_a_gray_code_are_taken_out(captures, name, light):
    frames, plan = captures[name]
    plain = decode(counts(frames), plan)
    means = np.array([frame.mean() for frame in frames])
    factors = {
        "mean": 0.7 * np.clip(np.median(means) / means, 0.5, 2.0),
        "rising": np.linspace(0.6, 0.9, len(frames)),
        "random": 0.75 * np.random.default_rng(3).uniform(0.8, 1.2, len(frames)),
    }[light]
    found = decode(counts([f * k for f, k in zip(frames, factors, strict=True)]), plan)
    for one, other in ((plain.x, found.x), (plain.y, found.y)):
        if one is not None:
            share, z, _ = compared(one, other)
            assert share > 0.85
            assert np.mean(z < 2.0) > 0.97
            assert np.mean(z > 5.0) < 1e-3


@pytest.mark.parametrize("noise", [1.0, 2.0])
def test_a_second_set_loses_no_pixels(captures, noise):
    """Dark objects, whose modulation is 25 counts: the beat of both sets has the noise of both."""
    shares = {}
    for name in ("objects", "objects, two sets"):
        frames, plan = captures[name]
        rng = np.random.default_rng(7)
        noisy = counts([f + rng.normal(0.0, noise, f.shape) for f in frames])
        plain, found = decode(counts(frames), plan).x, decode(noisy, plan).x
        shares[name], z, off = compared(plain, found)
        assert np.mean(z < 2.0) > 0.95
        assert np.mean(off > 20.0) < 1e-4
    assert shares["objects, two sets"] > shares["objects"] - 0.06


@pytest.mark.parametrize("kind", ["lamp", "exposure"])
@pytest.mark.parametrize("phase", [0.0, 2.0])
def test_light_that_differs_by_rows_is_told_by_a_fine_code(captures, kind, phase):
    """Three steps leave no residuals that show it."""
    frames, plan = captures["fringes on the board"]
    plain = decode(counts(frames), plan).x
    rows = np.linspace(0.0, 5.2 * np.pi, len(frames[0]))[:, None]
    lit = []
    for k, frame in enumerate(frames):
        wave = np.sin(rows + phase + 2.4 * k)
        lit.append(
            0.8 * frame + 20.0 + 5.0 * wave if kind == "lamp" else frame * (0.8 + 0.04 * wave)
        )
    found = decode(counts(lit), plan)
    _, z, _ = compared(plain, found.x)
    assert np.mean(z < 1.0) > 0.6
    assert np.mean(z < 2.0) > 0.9
    assert np.mean(z > 5.0) < 5e-4
    told = [one for one in found.findings if one.kind == "fringes beside the code"]
    assert "line to line" in told[0].seen
