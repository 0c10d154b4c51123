"""Projectors whose pixels a camera resolves, or sees as moiré: σ holds, and the cause is named."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import PatternPlan
from fringeworks.patterns import GrayCode, PhaseSteps, Uniform, equal_steps
from fringeworks.stack.decode import decode
from fringeworks.stack.pixel_grid import measure_pull
from tests.pixel_gaps import PixelGaps, flat_view, stack_of
from tests.stacks import take

SHAPE = (60, 320)
VIEWS = {
    "slow beat": ({"magnification": 1.0, "tilt": 0.05}, {"fill": 0.85, "open_side": 0.8}),
    "turned": ({"magnification": 1.3, "turned_deg": 3.0}, {"fill": 0.9}),
    "curved": ({"magnification": 1.9, "curved_px": 2.0}, {"fill": 0.8, "open_side": 0.8}),
    "resolved": ({"magnification": 2.7, "tilt": 0.02}, {"fill": 0.95, "defocus_px": 0.2}),
}


def camera_of(view, optics):
    x, y = flat_view(SHAPE, **view)
    return PixelGaps(x, y, (int(x.max()) + 6, int(y.max()) + 6), **optics)


def plan_of(size_px, name):
    if name == "sets":
        return PatternPlan(
            *size_px, tuple(PhaseSteps("x", p, equal_steps(4)) for p in (16.0, 18.0, 20.25))
        )
    code = (GrayCode("x", 16.0, size_px[0]), Uniform("white"), Uniform("black"))
    return PatternPlan(*size_px, (PhaseSteps("x", 32.0, equal_steps(4)), *code))


def test_the_simulator_keeps_the_light_and_the_places():
    """Camera pixels as large as projector pixels see whole ones: no seams, and no pull."""
    whole = camera_of({"magnification": 1.0}, {"fill": 0.85})
    np.testing.assert_allclose(whole.projected(np.ones(whole.size_px[::-1])), whole.white)
    turned = camera_of({"magnification": 2.0, "turned_deg": 10.0}, {"fill": 0.85})
    seen = turned.projected(np.ones(turned.size_px[::-1]))
    assert seen.mean() == pytest.approx(turned.white, rel=2e-3)
    assert seen.std() > 0.1 * turned.white


@pytest.mark.parametrize("name", VIEWS)
def test_coordinates_lie_where_theory_says(name):
    """The centre of gravity of the pixels' numbers, whatever the period: seams do not cancel."""
    seen = camera_of(*VIEWS[name])
    light = seen.projected(np.ones(seen.size_px[::-1]))
    numbers = np.broadcast_to(np.arange(seen.size_px[0]), seen.size_px[::-1])
    gravity = seen.projected(numbers.astype(float)) / light
    assert np.std(gravity - seen.x) > 0.02
    for period in (16.0, 30.5):
        frames = [
            seen.projected(0.5 + 0.5 * np.cos(2 * np.pi * (numbers / period - step)))
            for step in (0.0, 0.25, 0.5, 0.75)
        ]
        phase = np.arctan2(frames[1] - frames[3], frames[0] - frames[2])
        off = np.exp(1j * (phase - 2 * np.pi * gravity / period))
        off_px = np.abs(np.angle(off)) * period / (2 * np.pi)
        # The next term is a sixth of the third cumulant of two pixels, up to 0.096, times (2π/p)².
        assert off_px.max() < 1.02 * 0.0963 / 6.0 * (2 * np.pi / period) ** 2


@pytest.mark.parametrize(
    ("name", "plan"), [*((name, "sets") for name in VIEWS), ("curved", "gray")]
)
def test_sigma_contains_the_pull(name, plan):
    seen = camera_of(*VIEWS[name])
    plan = plan_of(seen.size_px, plan)
    found = decode(stack_of(seen, plan, exposure=1.1), plan)
    ratio = np.abs((found.x.coordinate_px - seen.x) / found.x.sigma_px)
    ratio = ratio[np.isfinite(ratio)]
    assert ratio.size > 0.95 * seen.x.size
    assert np.mean(ratio <= 2.0) > 0.95
    assert np.mean(ratio > 5.0) <= 300e-6
    named = [f for f in found.findings if f.kind == "pixel grid"]
    assert len(named) == 1
    assert 0.01 < named[0].figures["pull_px"] < 0.3


def test_the_pull_is_measured():
    """A known one, on a bent surface with a depth step."""
    v, u = np.mgrid[:40, :640].astype(float)
    x = u / 1.7 + 8.0 * np.sin(u / 200.0) + 0.1 * v + np.where(u > 400, 7.3, 0.0)
    pull = -0.06 * np.sin(2 * np.pi * x) - 0.02 * np.sin(4 * np.pi * x)
    rng = np.random.default_rng(0)
    found = measure_pull(x + pull + 0.02 * rng.standard_normal(x.shape))
    np.testing.assert_allclose(found.amplitudes_px, [-0.06, -0.02, 0.0], atol=0.006)
    assert found.rms_px == pytest.approx(np.std(pull), rel=0.1)
    assert measure_pull(x[:, :40]) is None


@pytest.mark.parametrize("size", [0.5, 1.0, 0.37])
def test_smooth_light_has_no_pull(size):
    """Also before cameras that see each projector pixel, or every half of one, at the same place."""
    v, u = np.mgrid[:80, :320].astype(float)
    plan = plan_of((330, 80), "sets")
    found = decode(take(plan, at=(v, size * u + 4.0)), plan)
    assert "pixel grid" not in {f.kind for f in found.findings}
