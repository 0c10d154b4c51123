"""Ripple of the phases by the differences of sets, and what frames show beyond their plan."""

import numpy as np
import pytest
from scipy.stats import f

from fringeworks.patterns.plan import step_design
from fringeworks.stack.real_frames import fit_frames
from fringeworks.stack.ripple import (
    SIGNIFICANT_AMPLITUDE,
    measure_ripple,
    significant_amplitude,
)
from fringeworks.stack.set_ripples import SetPhases, ripples_of_sets

NOISE = 0.01


def sets(periods, x, *, ripple=None, seed=0, steps=3):
    """Phases of sets at coordinates x with noise, and what they leave of their weighted mean."""
    rng = np.random.default_rng(seed)
    frequency = 1.0 / np.array(periods, float)
    phase = 2.0 * np.pi * np.outer(frequency, x)
    errors = rng.normal(0.0, NOISE, phase.shape)
    if ripple is not None:
        errors += ripple(phase)
    shift = frequency @ errors / (frequency @ frequency)
    return SetPhases(
        phase + np.outer(frequency, shift),
        errors - np.outer(frequency, shift),
        np.full(len(periods), NOISE**2),
        frequency,
        (steps,) * len(periods),
        np.arange(x.size) // 64,
    )


def found(phases, steps=3):
    orders = tuple(sorted({1, 2, 3, 4, *range(steps, 13, steps)}))
    return ripples_of_sets(phases, [orders] * len(phases.frequency))


X = np.tile(np.linspace(60.0, 700.0, 640), 12)
PLANS = {"hierarchy": (1024, 128, 16), "similar": (25, 28, 30), "two": (100, 66.7)}


@pytest.mark.parametrize("plan", list(PLANS))
def test_no_ripple_is_found_where_there_is_none(plan):
    for seed in range(8):
        for ripple in found(sets(PLANS[plan], X, seed=seed)):
            assert ripple.rms_rad < 2.5 * ripple.error_rad


@pytest.mark.parametrize("plan", ["hierarchy", "similar"])
def test_a_response_is_found_in_every_set(plan):
    def response(phase):
        return 0.15 * np.sin(3.0 * phase) + 0.02 * np.sin(6.0 * phase)

    ripples = found(sets(PLANS[plan], X, ripple=response))
    for period, ripple in zip(PLANS[plan], ripples, strict=True):
        phase = 2.0 * np.pi * X / period
        terms = zip(ripple.orders, ripple.phasors_rad, strict=True)
        seen = sum(np.real(z * np.exp(-1j * k * phase)) for k, z in terms)
        assert np.std(seen - response(phase)) < 0.05 * np.std(response(phase))
        assert ripple.rms_rad > 4.0 * ripple.error_rad


def test_the_ripples_of_two_sets_do_not_make_another_order():
    """Periods of 66.7 and 100 px: the product of their third orders has the period of 66.7 px. It
    once passed for steps of 128.5° and light that differs by 17 %, on real photographs."""

    def response(phase):
        return 0.34 * np.sin(3.0 * phase) + 0.05 * np.sin(6.0 * phase)

    for seed in range(4):
        for ripple in found(sets((200 / 3, 100.0), X, ripple=response, seed=seed)):
            assert ripple.low_rad == 0.0
            assert abs(ripple.significant(3)) == pytest.approx(0.34, abs=0.03)


def test_a_response_at_hardly_a_fringe_is_not_taken_for_steps():
    """The passes at the true phases once ran away: 0.22 rad of two per fringe."""

    def response(phase):
        return 0.2 * np.sin(3.0 * phase) - 0.02 * np.sin(6.0 * phase)

    x = np.tile(np.linspace(350.0, 680.0, 800), 8)
    for seed in range(4):
        for ripple in found(sets((261.12, 348.16), x, ripple=response, seed=seed)):
            assert ripple.low_rad == 0.0


def test_a_part_of_a_fringe_shows_little():
    """A coarse set that is seen over an eighth of its fringe: the phases must not be bent by chance."""
    x = np.linspace(400.0, 515.0, 8000)
    for seed in range(8):
        coarse, _ = found(sets((960, 120), x, seed=seed))
        assert coarse.error_rad > 0.05
        assert coarse.rms_rad < coarse.error_rad


def frames(steps, *, seed=0, off_deg=0.0, gains=0.0, gamma=1.0, noise=1.0, pixels=6000):
    rng = np.random.default_rng(seed)
    planned = 2.0 * np.pi * np.arange(steps) / steps
    real = planned + np.radians(off_deg) * rng.standard_normal(steps)
    phase, albedo = rng.uniform(0.0, 2.0 * np.pi, pixels), rng.uniform(0.4, 1.0, pixels)
    light = (0.5 + 0.5 * np.cos(phase - real[:, None])) ** gamma
    gain = 1.0 + gains * rng.standard_normal((steps, 1))
    data = gain * (20.0 + 180.0 * albedo * light) + rng.normal(0.0, noise, light.shape)
    return list(data[:, None, :]), np.arange(pixels), step_design(planned)


@pytest.mark.parametrize("steps", [4, 5, 8])
@pytest.mark.parametrize("gamma", [1.0, 2.2])
def test_frames_as_planned_stay_as_planned(steps, gamma):
    for seed in range(5):
        planes, pixels, planned = frames(steps, seed=seed, gamma=gamma)
        fit = fit_frames(planes, pixels, planned)
        assert fit.design is None
        assert (fit.harmonics is not None) == (gamma != 1.0)


@pytest.mark.parametrize("steps", [5, 8])
@pytest.mark.parametrize("gamma", [1.0, 2.2])
def test_steps_and_gains_are_found_beside_harmonics(steps, gamma):
    planes, pixels, planned = frames(steps, off_deg=4.0, gains=0.03, gamma=gamma, noise=0.5)
    fit = fit_frames(planes, pixels, planned)
    assert fit.design is not None
    data = np.concatenate(planes)

    def left(design):
        return np.mean((data - design @ (np.linalg.pinv(design) @ data)) ** 2)

    # What the residuals do not show shifts the phase by a function of itself (``stack.ripple``).
    noise = 0.25 * (1.0 - 3.0 / steps)
    assert left(planned) > 4.0 * noise
    if gamma == 1.0:
        assert left(fit.design) == pytest.approx(noise, rel=0.1)
    else:
        assert fit.harmonics is not None
        assert left(fit.design) < left(planned)


def test_relief_at_few_places_is_no_ripple():
    """Smooth relief as long as the fringes, which all lines cross: at four places its scatter is
    known too badly for five standard errors, which called a ripple in 6 % of such surfaces."""
    length, fringe, found = 320, 20.0, 0
    for seed in range(1000, 1150):
        rng = np.random.default_rng(seed)
        x = np.arange(length)
        waves = rng.uniform(0.6, 1.6, 6) / fringe
        relief = sum(
            np.cos(2.0 * np.pi * (k * x + rng.uniform())) * rng.standard_normal() for k in waves
        )
        phase = 2.0 * np.pi * (x / fringe + rng.uniform()) + 0.06 * relief
        turns = (phase + 0.02 * rng.standard_normal((24, length))) / (2.0 * np.pi)
        turns = (turns - np.rint(turns)).astype(np.float32)
        sigma = np.full(turns.shape, 0.02, np.float32)
        ripple = measure_ripple(turns, np.ones(turns.shape, bool), sigma, (1, 2, 3, 4), 4)
        assert ripple is not None
        found += any(ripple.significant(order) != 0 for order in (1, 2))
    assert found <= 1


@pytest.mark.parametrize("freedom", [6.0, 8.0, 20.0, 60.0])
def test_amplitudes_are_as_rare_as_with_known_errors(freedom):
    least = significant_amplitude(freedom)
    chance = f.sf(0.5 * least**2, 2, freedom)
    assert chance == pytest.approx(np.exp(-0.5 * SIGNIFICANT_AMPLITUDE**2), rel=1e-6)
    assert significant_amplitude(float("inf")) == SIGNIFICANT_AMPLITUDE
    assert least > SIGNIFICANT_AMPLITUDE
