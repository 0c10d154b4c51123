"""Steps that start elsewhere than the plan says, beside a Gray code; and steps that are dark in their
place."""

from __future__ import annotations

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps, Uniform, equal_steps
from tests.grids import quick

WIDTH, SHAPE = 960, (60, 240)


def surface(seed, low=100.0, high=800.0):
    """Projector columns of a bent surface."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    bent = 6.0 * np.sin(u / rng.uniform(20, 40) + rng.uniform(0, 6)) + 0.1 * v
    return low + (high - low) * (u + rng.uniform(0, 1)) / SHAPE[1] + bent


def photographs(plan, seed, gamma=1.0, noise=0.7, **limits):
    rng = np.random.default_rng(seed)
    columns = surface(seed, **limits)
    albedo = 0.7 + 0.25 * np.sin(np.arange(SHAPE[1]) / rng.uniform(7, 15))
    frames = []
    for block in plan.blocks:
        for k in range(block.frames):
            light = np.broadcast_to(block.values(columns, k), SHAPE) ** gamma
            counts = 6.0 + 200.0 * albedo * light + noise * rng.standard_normal(SHAPE)
            frames.append(np.clip(np.rint(counts), 0, 255).astype(np.uint8))
    return frames, columns


def beside_code(count, period, cell, start_deg=0.0, inverse=False):
    start = np.radians(start_deg)
    shifts = tuple(float(d + start) for d in equal_steps(count))
    light = () if inverse else (Uniform("white"), Uniform("black"))
    code = GrayCode("x", cell, WIDTH, inverse=inverse)
    return PatternPlan(WIDTH, 60, (*light, code, PhaseSteps("x", period, shifts)))


@pytest.mark.parametrize(
    ("count", "period", "cell", "inverse"),
    [(8, 32.0, 16.0, True), (5, 20.0, 10.0, False), (12, 24.0, 12.0, True), (7, 28.0, 28.0, False)],
)
@pytest.mark.parametrize("steps", [1, -1])
def test_steps_that_start_a_whole_step_later_are_refused(count, period, cell, inverse, steps):
    frames, _ = photographs(beside_code(count, period, cell, inverse=inverse), 51)
    said = beside_code(count, period, cell, steps * 360.0 / count, inverse)
    with pytest.raises(fw.InputError, match="steps along x have another sign or start"):
        fw.decode(frames, said)


@pytest.mark.parametrize(
    ("count", "period", "cell"), [(8, 32.0, 16.0), (6, 24.0, 12.0), (4, 18.0, 9.0)]
)
@pytest.mark.parametrize("seed", [52, 53])
def test_columns_counted_from_one_are_told_and_in_sigma(count, period, cell, seed):
    frames, columns = photographs(beside_code(count, period, cell), seed)
    found = fw.decode(frames, beside_code(count, period, cell, 360.0 / period))
    (finding,) = [one for one in found.findings if one.kind == "fringes beside the code"]
    assert abs(abs(finding.figures["offset_px"]) - 1.0) < 0.25
    ok = found.x.reason == 0
    off = np.abs(found.x.coordinate_px - columns)[ok] / found.x.sigma_px[ok]
    assert np.mean(off < 2.0) > 0.95
    right = fw.decode(frames, beside_code(count, period, cell))
    assert not [one for one in right.findings if one.kind == "fringes beside the code"]


@pytest.mark.parametrize("gamma", quick([1.0, 1.6, 2.2], 2.2))
@pytest.mark.parametrize("count", [4, 8])
@pytest.mark.parametrize("limits", [(330.0, 640.0), (380.0, 600.0), (100.0, 500.0)])
def test_a_step_of_a_wide_fringe_may_be_dark_all_over_the_view(gamma, count, limits):
    """Of a fringe as wide as the projector, the view holds a third: with the response of a
    projector, a step is dark there, and its phases look like wrong steps."""
    steps = equal_steps(count)
    sets = tuple(PhaseSteps("x", WIDTH / n, steps) for n in (1, 6, 36))
    plan = PatternPlan(WIDTH, 60, sets)
    frames, columns = photographs(plan, 54, gamma=gamma, low=limits[0], high=limits[1])
    found = fw.decode(frames, plan)
    ok = found.x.reason == 0
    off = np.abs(found.x.coordinate_px - columns)[ok]
    assert np.mean(ok) > 0.95
    assert np.mean(off > 5.0 * found.x.sigma_px[ok]) < 1e-3
    assert np.mean(off > 10.0) < 1e-4


@pytest.mark.parametrize("low_high", [(330.0, 640.0), (250.0, 640.0), (100.0, 500.0)])
def test_sets_that_start_at_other_steps_show_one_response(low_high):
    """Each set takes the same four steps, from another one on, or backwards."""
    order = ((1, 2, 3, 0), (0, 1, 2, 3), (3, 2, 1, 0))
    steps = np.asarray(equal_steps(4))
    sets = tuple(
        PhaseSteps("x", WIDTH / n, tuple(float(d) for d in steps[list(places)]))
        for n, places in zip((36, 6, 1), order, strict=True)
    )
    plan = PatternPlan(WIDTH, 60, sets)
    frames, columns = photographs(plan, 56, gamma=2.2, low=low_high[0], high=low_high[1])
    found = fw.decode(frames, plan).x
    ok = found.reason == 0
    off = np.abs(found.coordinate_px - columns)[ok]
    assert np.mean(ok) > 0.95
    assert np.mean(off > 5.0 * found.sigma_px[ok]) < 1e-3


@pytest.mark.parametrize(("sign", "quarters"), [(1, 1), (1, 3), (-1, 1)])
@pytest.mark.parametrize("periods", [(28.0, 224.0, 1120.0), (24.0, 26.0, 28.4)])
def test_a_set_with_another_start_is_named(sign, quarters, periods):
    """It was taken for a scene that moved between the sets."""
    steps = np.asarray(equal_steps(4))
    shown = tuple(PhaseSteps("x", p, equal_steps(4)) for p in periods)
    frames, _ = photographs(PatternPlan(WIDTH, 60, shown), 57)
    wrong = PhaseSteps("x", periods[0], tuple(sign * (steps + quarters * np.pi / 2)))
    said = PatternPlan(WIDTH, 60, (wrong, *shown[1:]))
    with pytest.raises(
        fw.InputError, match=f"frames: .*the set from x-phase-{periods[0]:g}px-0 on"
    ) as told:
        fw.decode(frames, said)
    assert "moved" not in str(told.value).split(", or ")[0]


def with_dark_step(lost):
    sets = tuple(PhaseSteps("x", WIDTH / n, equal_steps(4)) for n in (1, 6, 36))
    plan = PatternPlan(WIDTH, 60, sets)
    frames, place = photographs(plan, 55, gamma=2.2)
    frames[lost][...] = 8
    frames[lost][::2, ::3] = 9
    return plan, frames, place


@pytest.mark.parametrize("lost", [1, 3])
def test_a_step_that_is_dark_by_mistake_is_named(lost):
    plan, frames, _ = with_dark_step(lost)
    with pytest.raises(fw.InputError, match=f"light of x-phase-960px-{lost} differs"):
        fw.decode(frames, plan)


def test_a_dark_step_that_the_other_frames_make_up_for_is_named():
    """The three other steps and the finer sets tell the coordinates."""
    plan, frames, place = with_dark_step(0)
    found = fw.decode(frames, plan)
    assert any("light of x-phase-960px-0 differs" in finding.seen for finding in found.findings)
    error = found.x.coordinate_px - place
    assert np.isfinite(error).mean() > 0.95
    assert np.nanmax(np.abs(error)) < 1.0
    assert np.nanmean(np.abs(error) < 2.0 * found.x.sigma_px) > 0.9
