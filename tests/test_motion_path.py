"""Motion that cycles do not resolve: it is estimated from all frames, or stands in σ and is named."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps, Uniform, equal_steps
from fringeworks.stack.kernel_settings import decoding_of
from fringeworks.stack.motion_code import code_distance
from fringeworks.stack.motion_evidence import missing_turns, turn_weights
from fringeworks.stack.motion_ripple import ripple_weights, ripples
from fringeworks.stack.motion_words import unsteady
from fringeworks.stack.step_convention import convention
from fringeworks.types import CoordinateMap

pytestmark = pytest.mark.statistical

WIDTH, HEIGHT = 640, 400
SHAPE = (72, 108)
TURN = 2.0 * np.pi


def steps(period, count):
    return PhaseSteps("x", period, equal_steps(count))


FOUR = PatternPlan(WIDTH, HEIGHT, (steps(640.0, 4), steps(80.0, 4), steps(16.0, 4)))
GRAY = PatternPlan(
    WIDTH,
    HEIGHT,
    (
        GrayCode("x", 8.0, WIDTH, offset_px=-4.0),
        steps(16.0, 4),
        Uniform("white"),
        Uniform("black"),
    ),
)
ORDERS = {"hierarchical": FOUR, "gray": GRAY}


def still_px():
    """Projector columns of a bent surface at rest."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    return 200.0 + 1.3 * u + 0.2 * v + 4.0 * np.sin(u / 25.0)


def photographed(plan, moved_px, count, seed, noise=1.0):
    """Frames of a surface that moves along the projector, each the mean of nine times."""
    rng = np.random.default_rng(seed)
    rest = still_px()
    paint = 0.6 + 0.3 * np.sin(np.arange(SHAPE[1]) / 9.0)
    patterns = [(block, k) for block in plan.blocks for k in range(block.frames)]
    frames = []
    for frame in range(count):
        block, k = patterns[frame % plan.frames]
        times = frame + 0.8 * (np.arange(9) / 8.0 - 0.5)
        light = np.mean([block.values(rest + moved_px(t), k) for t in times], axis=0)
        counts = 15.0 + 190.0 * paint * light + noise * rng.standard_normal(SHAPE)
        frames.append(np.clip(np.rint(counts), 0, 255).astype(np.uint8))
    return frames


def measured(plan, moved_px, seed=0, every=None):
    """Errors over σ of the moments with a cycle to both sides, their errors, and all findings."""
    n = plan.frames
    frames = photographed(plan, moved_px, 4 * n, seed)
    normal, errors, findings = [], [], []
    for moment in fw.stack.decode_sequence(frames, plan, every=every or n // 2):
        if not n <= moment.first_frame <= 2 * n:
            continue
        found = moment.decoded.x
        off = found.coordinate_px - still_px() - moved_px(moment.time_frames)
        normal.append((off / found.sigma_px)[np.isfinite(off)])
        errors.append(off[np.isfinite(off)])
        assert np.isfinite(off).mean() > 0.9
        findings += [f for f in moment.decoded.findings if f.kind == "motion between frames"]
    return np.concatenate(normal), np.concatenate(errors), findings


def sine(amplitude, period, start=0.6):
    return lambda t: amplitude * np.sin(TURN * t / period + start)


def stops(velocity, first, last):
    return lambda t: velocity * (np.clip(t, first, last) - first)


def test_a_vibration_that_repeats_with_the_cycles_is_found_and_named():
    normal, errors, findings = measured(FOUR, sine(1.0, 12.0))
    assert np.mean(np.abs(normal) < 2.0) > 0.9
    assert np.sqrt(np.mean(errors**2)) < 0.2
    (period,) = {round(finding.figures["period_frames"]) for finding in findings}
    assert period == 12
    assert "a vibration with a period of 12" in findings[0].causes[0]
    assert "take 4 times as many frames per second" in findings[0].advice


def test_a_repeating_vibration_beside_a_gray_code_is_covered():
    normal, _, findings = measured(GRAY, sine(1.0, 13.0), seed=3, every=13)
    assert np.mean(np.abs(normal) < 2.0) > 0.9
    assert findings


MOTIONS = {
    "repeats": lambda n: sine(1.0, n),
    "nearly repeats": lambda n: sine(0.9, 0.93 * n, 0.2),
    "period of 1.5 cycles": lambda n: sine(1.0, 1.5 * n),
    "period of 3 cycles": lambda n: sine(1.5, 3.0 * n, 1.0),
    "two periods in a cycle": lambda n: sine(0.5, 0.5 * n, 1.3),
    "starts and stops": lambda n: stops(0.5, 1.3 * n, 2.4 * n),
}


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("orders", ORDERS)
def test_motion_within_cycles_is_covered(motion, orders):
    plan = ORDERS[orders]
    normal, _, _ = measured(plan, MOTIONS[motion](plan.frames), seed=3)
    assert np.mean(np.abs(normal) < 2.0) > 0.9
    assert np.mean(np.abs(normal) > 5.0) < 300e-6


@pytest.mark.parametrize("speed", [0.0, 0.8, -1.0, 1.5])
def test_a_gray_code_tells_the_distance_to_a_cell(speed):
    n = GRAY.frames
    frames = [f.astype(float) for f in photographed(GRAY, lambda t: speed * t, 2 * n, 21)]
    found = code_distance(frames[:n], frames[n:], GRAY, "x")
    assert np.mean(np.abs(found - speed * n) <= 8.0) > 0.98
    assert code_distance(frames[:12], frames[12:24], FOUR, "x") is None


@pytest.mark.parametrize("speed", [0.8, -1.1])
def test_beside_a_gray_code_surfaces_move_by_more_than_half_a_period(speed):
    """10 and 14 px in a cycle, with fringes of 16 px."""
    normal, errors, _ = measured(GRAY, lambda t: speed * t, seed=22)
    assert np.mean(np.abs(normal) < 2.0) > 0.9
    assert np.abs(errors).max() < 2.0


@pytest.mark.parametrize("orders", ORDERS)
def test_a_vibration_of_less_than_two_frames_is_covered(orders):
    plan = ORDERS[orders]
    normal, _, findings = measured(plan, sine(0.5, plan.frames / 7.4), seed=23)
    assert np.mean(np.abs(normal) < 2.0) > 0.9 or findings
    assert np.mean(np.abs(normal) > 5.0) < 300e-6 or findings


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("orders", ORDERS)
def test_still_scenes_have_no_motion(orders, seed):
    plan = ORDERS[orders]
    frames = photographed(plan, lambda _: 0.0, 4 * plan.frames, seed)
    for moment in fw.stack.decode_sequence(frames, plan, every=plan.frames):
        assert not [f for f in moment.decoded.findings if f.kind == "motion between frames"]
        found = moment.decoded.x
        assert np.isfinite(found.coordinate_px).mean() > 0.99
        # It adds less than two per cent.
        assert np.median(moment.motion.path_sigma_px["x"] / found.sigma_px) < 0.2


@pytest.mark.parametrize("orders", ORDERS)
def test_many_still_scenes_have_no_motion(orders):
    for seed in range(100, 120):
        test_still_scenes_have_no_motion(orders, seed)


@pytest.mark.parametrize("count", [4, 5, 7])
def test_residuals_tell_velocity_and_curvature(count):
    block = steps(16.0, count)
    times = np.arange(count) - 0.5 * (count - 1)
    path = 0.25 * times + 0.04 * times**2
    samples = [
        (100.0 + 80.0 * np.cos(TURN * (still_px() + d) / 16.0 - shift)).astype(np.float32)
        for d, shift in zip(path, block.shifts_rad, strict=True)
    ]
    known = [np.zeros(SHAPE, np.float32)] * count
    _, missing, variances = missing_turns(samples, block, known, 1.0)
    expected = turn_weights(block.shifts_rad) @ path
    np.testing.assert_allclose(expected, (0.25, 0.04), atol=1e-9)
    for seen, true in zip(missing, expected, strict=True):
        assert np.median(np.abs(seen - true)) < 0.005
    assert all((variance > 0).all() for variance in variances)


def test_pixels_without_phase_do_not_hide_the_start_of_the_steps():
    """Frames that are moved back have pixels that come from outside of the image."""
    frames = [f[None, 30].astype(np.float32) for f in photographed(GRAY, lambda _: 0.0, 13, 0)]
    (first, _), *_ = GRAY.phase_sets("x")
    for k in range(first, first + 4):
        frames[k][:, 40:44] = np.nan
    found = convention(decoding_of(GRAY, "x", absolute=True, response=None), frames)
    assert found.borders > 5
    assert abs(found.start_turns) < 0.03


@lru_cache(maxsize=1)
def three_steps():
    return PatternPlan(WIDTH, HEIGHT, (steps(640.0, 3), steps(80.0, 3), steps(16.0, 3)))


def test_three_steps_follow_slower_vibrations():
    """They leave no residuals: only the sets of successive cycles tell the motion."""
    still = [np.zeros(SHAPE, np.float32)] * 3
    assert missing_turns(still, steps(16.0, 3), still, 1.0)[1:] == ([], [])
    normal, _, _ = measured(three_steps(), sine(1.0, 27.0))
    assert np.mean(np.abs(normal) < 2.0) > 0.9


@pytest.mark.parametrize("count", [3, 4, 5, 8])
def test_ripples_tell_motion_to_and_fro(count):
    block = steps(16.0, count)
    path = 0.3 * (-1.0) ** np.arange(count) + 0.05 * np.arange(count)
    samples = [
        100.0 + 80.0 * np.cos(TURN * (still_px() + d) / 16.0 - shift)
        for d, shift in zip(path, block.shifts_rad, strict=True)
    ]
    design = np.stack([np.ones(count), np.cos(block.shifts_rad), np.sin(block.shifts_rad)], 1)
    _, c, s = np.tensordot(np.linalg.pinv(design), np.stack(samples), 1)
    found, variance = ripples((c + 1j * s).astype(np.complex64), block.shifts_rad, 12)
    weights = ripple_weights(block.shifts_rad)
    # Four steps have one: that of motion that alternates.
    assert len(found) == len(weights) == (1 if count == 4 else 2)
    np.testing.assert_allclose(weights.sum(axis=1), 0.0, atol=1e-12)
    for one, row in zip(found, weights, strict=True):
        off = one - TURN / 16.0 * (row @ path)
        assert np.abs(np.median(off)) < 0.01
        assert np.mean(off**2 < 16.0 * variance) > 0.9


@pytest.mark.parametrize("light", ["everywhere", "disc", "stripe"])
def test_fringes_that_a_border_cuts_off_are_no_ripple(light):
    """Half a window of 12 px leaves 0.09 rad of fringes of 18 camera px."""
    v, u = np.mgrid[:204, :240].astype(float)
    lit = {
        "everywhere": np.ones(u.shape, bool),
        "disc": np.hypot(u - 110.0, v - 95.0) < 80.0,
        "stripe": np.abs(u - 120.0) < 40.0,
    }[light]
    phase = TURN * (100.0 + 0.9 * u + 0.1 * v) / 16.0
    shadow = np.random.default_rng(4).uniform(0.0, TURN, lit.shape)
    wave = np.where(lit, 80.0, 1.0) * np.exp(1j * np.where(lit, phase, shadow))
    (found,), variance = ripples(wave.astype(np.complex64), steps(16.0, 4).shifts_rad, 12)
    blocks = lit.reshape(17, 12, 20, 12).mean(axis=(1, 3)) > 0.5
    assert np.abs(found[blocks]).max() < 0.01
    assert np.mean(found[blocks] ** 2 < 9.0 * (variance[blocks] + 0.002**2)) > 0.98
    assert np.median(variance[blocks]) < 0.01**2


def test_a_velocity_that_changes_slowly_is_no_vibration():
    """With three times the noise, those of every period fit as well."""
    normal, _, findings = measured(FOUR, lambda t: 0.4 * t + 1e-3 * t**2, seed=5)
    assert np.mean(np.abs(normal) < 2.0) > 0.9
    assert not findings


def test_wide_fringes_show_no_ripple():
    """Their phases do not take all values within the window."""
    wave = 80.0 * np.exp(1j * TURN * still_px() / 640.0)
    _, variance = ripples(wave.astype(np.complex64), steps(640.0, 4).shifts_rad, 12)
    assert variance.min() > 0.5


def exposed_px(moved_px, time):
    """Mean of a motion over an exposure of ``photographed``."""
    return np.mean([moved_px(time + 0.8 * (k / 8.0 - 0.5)) for k in range(9)])


@pytest.mark.parametrize("per_plan", [6.7, 10.3])
@pytest.mark.parametrize("orders", ORDERS)
def test_vibrations_that_look_alike_are_at_one_place_at_a_frame(orders, per_plan):
    """To and fro in two frames, and faster than the frames."""
    plan = ORDERS[orders]
    n = plan.frames
    path = sine(0.5, n / per_plan)
    frames = photographed(plan, path, 5 * n, 41)
    normal, off = [], []
    for moment in fw.stack.decode_sequence(frames, plan, every=n // 3):
        assert moment.time_frames == moment.first_frame + n // 2
        if n <= moment.first_frame <= 3 * n:
            found = moment.decoded.x
            error = found.coordinate_px - still_px() - exposed_px(path, moment.time_frames)
            normal.append((error / found.sigma_px)[np.isfinite(error)])
            off.append(error[np.isfinite(error)])
    normal = np.concatenate(normal)
    assert np.mean(np.abs(normal) < 2.0) > 0.9
    assert np.mean(np.abs(normal) > 5.0) < 300e-6
    assert np.sqrt(np.mean(np.concatenate(off) ** 2)) < 0.15


@pytest.mark.parametrize(("period", "factor"), [(100.0, 2), (12.0, 4), (5.0, 10), (None, 4)])
def test_the_advice_against_motion_is_more_frames(period, factor):
    shape = (24, 36)
    found = CoordinateMap(
        axis="x",
        coordinate_px=np.zeros(shape, np.float32),
        sigma_px=np.full(shape, 0.1, np.float32),
        modulation=np.ones(shape, np.float32),
        background=np.ones(shape, np.float32),
        reason=np.zeros(shape, np.uint8),
        periods_px=(16.0,),
    )
    chances = {} if period is None else {period: np.ones((2, 3), np.float32)}
    finding = unsteady(found, np.full(shape, 0.09, np.float32), chances, 12)
    assert finding.advice.startswith(f"take {factor} times as many frames per second, or a plan of")
    assert finding.figures["rate_factor"] == factor
