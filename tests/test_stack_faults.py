"""Captures with faults: a coordinate whose σ covers, or a refusal that names the cause."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from fringeworks import Finding, FramesContradictPlan, InputError, PatternPlan, decode
from fringeworks.patterns import PhaseSteps, equal_steps
from fringeworks.signal import CameraNoise
from fringeworks.signal.noise import noise_of_residuals
from tests.fault_measure import run
from tests.fault_scenes import plans
from tests.grids import thinned
from tests.stacks import guarded, multi, take

pytestmark = pytest.mark.statistical

PLANS = plans()
MAX_WRONG = 100.0
X = np.arange(960.0)


def harmless(outcome, coverage=0.6):
    """Refused, or right: few wrong orders, and a σ that covers."""
    if outcome.refused:
        return True
    tally = outcome.bands["all"]
    return tally.ok > 0 and tally.wrong_per_million <= MAX_WRONG and tally.coverage[0] >= coverage


@thinned(
    strength=1,
    lag=["late+1", "late-1", "late+2", "late-3"],
    name=["gray-3", "gray-4-inverse", "heterodyne-3", "hierarchical-4"],
)
def test_stacks_that_begin_early_or_late_are_refused(name, lag):
    assert run(lag, PLANS[name]).refused


@pytest.mark.parametrize("every", [4, pytest.param(2, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", ["gray-3", "heterodyne-4"])
def test_every_lost_frame_is_refused(name, every):
    for frame in range(0, PLANS[name].frames, every):
        outcome = run(f"lost:{frame}", PLANS[name])
        assert harmless(outcome), frame
        assert not outcome.refused or "frame" in outcome.refused


@pytest.mark.parametrize("every", [3, pytest.param(1, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", ["gray-3", "heterodyne-3"])
def test_every_dark_frame_is_refused_by_name(name, every):
    labels = PLANS[name].labels()
    for frame in range(0, PLANS[name].frames, every):
        outcome = run(f"dark-frame:{frame}", PLANS[name])
        assert harmless(outcome), frame
        if outcome.refused and "no pattern" in outcome.refused:
            assert labels[frame] in outcome.refused


@pytest.mark.parametrize("every", [5, pytest.param(1, marks=pytest.mark.long)])
def test_every_swap_in_a_gray_plan_is_refused(every):
    plan = guarded(16.0, 3, (960, 60), white_black=False)
    frames = take(plan)
    for a, b in list(combinations(range(plan.frames), 2))[::every]:
        swapped = frames.copy()
        swapped[[a, b]] = swapped[[b, a]]
        with pytest.raises(FramesContradictPlan, match=f"{a} and {b} .*swapped"):
            decode(swapped, plan)


@pytest.mark.parametrize("lag", [1, -1, 2, -2, 3, -3])
def test_late_stacks_are_named(lag):
    plan = guarded(16.0, 8, (960, 60))
    word = "late" if lag > 0 else "early"
    with pytest.raises(
        FramesContradictPlan, match=f"{abs(lag) if abs(lag) > 1 else 'one'} .*{word}"
    ):
        decode(np.roll(take(plan), lag, axis=0), plan)


@thinned(
    strength=1,
    name=["heterodyne-3", "hierarchical-4", "gray-8-white-black"],
    condition=["nudged", "interreflection", "drift", "lamp", "flicker", "wrong-steps"],
)
def test_systematic_errors_do_no_harm(condition, name):
    # Light between surfaces bends the phase of a single period smoothly, which no frame shows.
    least = 0.3 if condition == "interreflection" else 0.6
    assert harmless(run(condition, PLANS[name]), least)


@thinned(
    strength=1,
    name=["hierarchical-3", "gray-3", "gray-8-white-black"],
    condition=["jpeg-80", "vibration", "blending", "motion"],
)
def test_correlated_errors_are_covered(condition, name):
    assert harmless(run(condition, PLANS[name]), 0.55)


def bent(plan, gamma=2.2):
    """Frames of a projector with an exponent, noise included."""
    light = take(plan, noise=0.0, a=127.5, b=127.5, kind=np.float64) / 255.0
    seen = 20.0 + 200.0 * light**gamma
    noisy = seen + 2.0 * np.random.default_rng(0).standard_normal(seen.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def test_a_response_is_found_named_and_covered():
    plan = guarded(16.0, 3, (960, 80), white_black=False)
    found = decode(bent(plan), plan)
    off = np.abs(found.x.coordinate_px - X) / found.x.sigma_px
    assert np.nanmean(off < 1) > 0.6
    assert np.nanmean(off < 2) > 0.95
    ripple = next(f for f in found.findings if f.kind == "response")
    assert ripple.figures["per_fringe"] == 3
    assert "γ" in ripple.causes[0]
    assert ripple.advice
    assert ripple.text in found.notes


@pytest.mark.parametrize("name", ["single", "similar", "hierarchy"])
def test_a_response_is_measured_and_subtracted(name):
    """The ripple of γ = 2.2 in three steps, 0.2 rad rms, is taken out of every set."""
    plan = {
        "single": guarded(16.0, 3, (960, 80), white_black=False),
        "similar": multi((29, 32, 36), 3, (960, 80)),
        "hierarchy": multi((1, 8, 60), 3, (960, 80)),
    }[name]
    frames = bent(plan)
    found = decode(frames, plan)
    kept = decode(take(plan, noise=2.0, a=120.0, b=100.0), plan)
    off = found.x.coordinate_px - X
    assert found.x.failed_fraction < 0.03
    assert np.nanstd(off) < 2.0 * np.nanstd(kept.x.coordinate_px - X)
    share = np.abs(off) / found.x.sigma_px
    assert 0.6 < np.nanmean(share < 1.0) < 0.9
    assert np.nanmean(share > 5.0) <= 1e-4
    assert found.findings[0].kind != "disagreement"


def test_a_response_that_is_asked_for_must_be_seen():
    plan = guarded(240.0, 3, (960, 80), white_black=False)
    with pytest.raises(InputError, match="expected lines across several fringes"):
        decode(bent(plan), plan, estimate_response=True)


@pytest.mark.parametrize("steps", [4, 5, 8])
def test_harmonics_are_no_noise(steps):
    """Harmonics that do not disturb the phase count neither as noise nor in σ."""
    plan = guarded(32.0, steps, (960, 80))
    found = decode(bent(plan), plan)
    assert found.noise.read_counts == pytest.approx(np.hypot(2.0, 12.0**-0.5), rel=0.05)
    share = np.abs(found.x.coordinate_px - X) / found.x.sigma_px
    assert 0.6 < np.nanmean(share < 1.0) < 0.8


def test_nothing_measured_is_an_error():
    plan = multi((1, 8), 4, (300, 40))
    dark = take(plan, a=5.0, b=0.2, noise=1.0)
    with pytest.raises(InputError, match="expected pixels that can be measured, got none"):
        decode(dark, plan)


def test_dark_captures_with_little_noise_are_decoded():
    for name in ("hierarchical-3", "heterodyne-3"):
        assert not run("quantised", PLANS[name]).crashed
    plan = PatternPlan(64, 40, tuple(PhaseSteps("x", p, equal_steps(3)) for p in (64.0, 16.0)))
    found = decode(take(plan, noise=0.0, a=30.0, b=20.0), plan, noise=CameraNoise(0.0))
    assert found.noise.read_counts >= 12.0**-0.5
    assert np.nanmax(np.abs(found.x.coordinate_px - np.arange(64.0))) < 1.0


def test_shot_noise_decides_in_the_light():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        brightness = rng.uniform(5, 200, 6_000)
        square = (0.3**2 + 1 / 12 + 0.2 * brightness) * rng.chisquare(3, brightness.size)
        found = noise_of_residuals(brightness, square, 3, 12.0**-0.5)
        assert found.gain == pytest.approx(0.2, rel=0.15)
        assert found.read_counts < 1.5


def test_motion_is_named_and_taken_out():
    steps = 4
    # 0.2 rad of the fine fringes per frame, and the same distance of the coarse ones.
    plan = multi((1, 8, 64), steps, (960, 120))
    frames = []
    y, x = np.mgrid[:120, :960] * 1.0
    per_frame = 0.2 * 15.0 / (2.0 * np.pi)
    for k in range(plan.frames):
        moved = take(plan, at=(y, x + k * per_frame), seed=k)
        frames.append(moved[k])
    found = decode(np.stack(frames), plan)
    first = 2 * steps
    middle = x + (first + 0.5 * (steps - 1)) * per_frame
    off = found.x.coordinate_px - middle
    # A common shift of all steps cannot be seen; it is the time that the coordinate belongs to.
    off -= np.nanmedian(off)
    inner = off[:, 20:-60]
    assert np.nanmean(np.abs(inner) < found.x.sigma_px[:, 20:-60]) > 0.6
    motion = [f for f in found.findings if f.kind == "motion"]
    assert motion
    assert motion[-1].frames == tuple(plan.labels()[first:])


def test_findings_are_data():
    plan = multi((1, 8, 64), 4, (960, 60))
    gains = 1.0 + 0.03 * np.random.default_rng(1).standard_normal(plan.frames)
    frames = np.clip(np.rint(take(plan) * gains[:, None, None]), 0, 255).astype(np.uint8)
    found = decode(frames, plan)
    assert all(isinstance(finding, Finding) for finding in found.findings)
    assert {"noise"} < {finding.kind for finding in found.findings}
    flicker = next(f for f in found.findings if f.kind in ("flicker", "steps"))
    assert flicker.causes
    assert flicker.frames
    assert flicker.figures["largest_light_change"] > 0
    one = np.nanmean(np.abs(found.x.coordinate_px - X) < found.x.sigma_px)
    assert 0.6 < one < 0.95


@pytest.mark.parametrize("condition", ["noise-1", "noise-2", "mixed-pixels"])
def test_fringes_alone_do_not_tell_the_size_of_the_projector(condition):
    """Fewer fringe orders leave fewer to confuse: correct frames were told to be of 768 columns."""
    outcome = run(condition, PLANS["number-theoretic"], "plane", 7)
    assert not outcome.refused
    assert harmless(outcome)
