"""Pixels beside depth steps, creases and shadows: their σ is that of their own error."""

from __future__ import annotations

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.patterns import GrayCode, PhaseSteps, Uniform, equal_steps
from fringeworks.statistics.shrinkage import mean_square_errors
from tests.box_scenes import WIDTH, Photographs

ENDS = (Uniform("white"), Uniform("black"))
PLANS = {
    "gray-4": (PhaseSteps("x", 16.0, equal_steps(4)), GrayCode("x", 8.0, WIDTH)),
    "gray-8": (GrayCode("x", 12.0, WIDTH, inverse=True), PhaseSteps("x", 24.0, equal_steps(8))),
    "heterodyne-4": tuple(PhaseSteps("x", p, equal_steps(4)) for p in (19.0, 21.0, 23.0)),
    "code": (GrayCode("x", 1.0, WIDTH, inverse=True),),
    "code-white-black": (*ENDS, GrayCode("x", 2.0, WIDTH)),
}


def measured(kind, name, blur_px, noise, seed):
    plan = fw.PatternPlan(WIDTH, 64, PLANS[name])
    scene = Photographs(kind, seed)
    found = fw.decode(scene.stack(plan, blur_px, noise, seed), plan)
    return found, *scene.scores(found.x, blur_px)


@pytest.mark.statistical
@pytest.mark.parametrize(
    ("kind", "name", "blur_px", "noise", "least"),
    [
        ("steps", "gray-4", 0.5, 1.0, 0.95),
        ("steps", "heterodyne-4", 1.2, 0.4, 0.80),
        ("boxes", "gray-8", 0.8, 1.0, 0.90),
        pytest.param(
            *("clutter", "gray-8", 1.2, 1.0, 0.80),
            marks=pytest.mark.xfail(strict=False, reason="correlated noise is told, 1.2 times"),
        ),
        ("wires", "gray-4", 0.8, 1.0, 0.90),
    ],
)
def test_sigma_is_that_of_the_pixel_itself(kind, name, blur_px, noise, least):
    """Most pixels beside an edge are right: an average of all would be far from theirs."""
    for seed in (201, 202):
        found, near, far, share = measured(kind, name, blur_px, noise, seed)
        assert share > 0.95
        off, sigma = near
        assert np.mean(off < 2.0 * sigma) > least
        assert np.mean(off > 5.0 * sigma) < (0.02 if blur_px > 1.0 else 5e-3)
        assert np.median(sigma) < 2.5 * np.median(off) / 0.6745
        off, sigma = far
        assert 0.64 < np.mean(off < sigma) < 0.80
        assert not [finding for finding in found.findings if finding.severity != "note"]


@pytest.mark.parametrize(("name", "blur_px"), [("code", 0.5), ("code-white-black", 0.8)])
@pytest.mark.parametrize("seed", [211, 212])
def test_a_gray_code_alone_knows_its_mixed_pixels(name, blur_px, seed):
    """A bit in grey beside a depth step is no border of two cells."""
    _, near, _, share = measured("steps", name, blur_px, 1.0, seed)
    assert share > 0.98
    assert np.mean(near[0] < 2.0 * near[1]) > 0.95
    assert np.mean(near[0] > 5.0 * near[1]) < 2e-3


@pytest.mark.parametrize("seed", [221, 222])
def test_wires_are_no_correlated_noise(seed):
    """Nearly every window on lines holds the rim of a wire before a lens that blurs."""
    found, _, far, _ = measured("wires", "gray-8", 1.2, 1.0, seed)
    assert "correlated noise" not in {finding.kind for finding in found.findings}
    assert 0.64 < np.mean(far[0] < far[1]) < 0.78


def test_few_errors_are_told_from_noise():
    rng = np.random.default_rng(3)
    errors = np.where(rng.random(5000) < 0.05, 2.0 * rng.standard_normal(5000), 0.0)
    noise = rng.uniform(0.01, 0.04, 5000)
    seen = errors + np.sqrt(noise) * rng.standard_normal(5000)
    second, mean = mean_square_errors(seen, noise)
    assert mean == pytest.approx(np.mean(errors**2), rel=0.2)
    assert np.sum(second) == pytest.approx(np.sum(errors**2), rel=0.1)
    assert np.median(second) < 0.1 * np.median(noise)


def test_noise_alone_has_no_errors():
    rng = np.random.default_rng(4)
    for count in (30, 300, 3000):
        noise = np.full(count, 0.5)
        second, _ = mean_square_errors(np.sqrt(noise) * rng.standard_normal(count), noise)
        assert second.mean() < 0.1 * 0.5
