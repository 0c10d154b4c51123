"""The response of one set of fringes, and wrong frames, from their brightness, where relief and paint
hide them along lines: fringes along the lines, few fringes, narrow bodies, folds, paint in step."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, gaussian_filter1d

import fringeworks as fw
from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps, Uniform, equal_steps
from fringeworks.signal.phase_table import TABLE_BINS
from fringeworks.stack.phase_light import Light, with_frames, with_light
from fringeworks.stack.ripple import unknown_ripple
from tests.grids import quick

SHAPE, LENGTH, OVER = (300, 420), 640, 8


def s_shaped(slope, middle):
    """An S-shaped response from 0 to 1."""
    low, high = (1.0 / (1.0 + np.exp(-slope * (v - middle))) for v in (0.0, 1.0))
    return lambda v: (1.0 / (1.0 + np.exp(-slope * (v - middle))) - low) / (high - low)


RESPONSES = {
    "linear": lambda v: v,
    "gamma 1.5": lambda v: v**1.5,
    "gamma 2.2": lambda v: v**2.2,
    "gamma 0.6": lambda v: v**0.6,
    "S": s_shaped(6.0, 0.4),
    "S about its middle": s_shaped(6.0, 0.5),
    "clipped": lambda v: np.minimum(v, 0.85) / 0.85,
}


def measured(response, phase, steps):
    """Phasor and mean that equal steps measure of fringes of a phase, shares of white."""
    shifts = 2.0 * np.pi * np.arange(steps) / steps
    seen = response(0.5 + 0.5 * np.cos(phase[..., None] - shifts))
    return 2.0 / steps * np.sum(seen * np.exp(1j * shifts), axis=-1), seen.mean(axis=-1)


def phase_errors(response, steps):
    """Errors of the phases by the response over the measured ones, turns."""
    true = 2.0 * np.pi * (np.arange(8 * TABLE_BINS) / (8 * TABLE_BINS) - 0.5)
    error = np.angle(measured(response, true, steps)[0] * np.exp(-1j * true))
    at = 2.0 * np.pi * ((np.arange(TABLE_BINS) + 0.5) / TABLE_BINS - 0.5)
    return np.interp(at, true + error, error, period=2.0 * np.pi) / (2.0 * np.pi)


@pytest.mark.parametrize("share", [0.8, 1.0])
@pytest.mark.parametrize("steps", [3, 4])
@pytest.mark.parametrize("name", RESPONSES)
def test_what_is_left_of_the_ripple_is_told_within_its_error(name, steps, share):
    """Of phases that are without a share of it."""
    response, rng = RESPONSES[name], np.random.default_rng(7)
    errors = phase_errors(response, steps)
    phase = rng.uniform(-np.pi, np.pi, (24, 600))
    wave, mean = measured(response, phase, steps)
    left = np.angle(wave * np.exp(-1j * phase)) * (1.0 - share)
    modulation = 2.0 * np.abs(wave) * (1.0 + rng.normal(0.0, 0.02, phase.shape))
    light = Light(phase + left, np.ones(phase.shape, bool), modulation, 2.0 * mean - 1.0)
    ripple = unknown_ripple((1, 2, steps, 2 * steps), steps)
    found = with_light(ripple, light, steps, share * errors)
    assert found is not None
    assert found.told
    assert found.error_rad < 0.08
    expected = 2.0 * np.mean(left * np.exp(1j * steps * phase))
    assert abs(found.phasors_rad[2] - expected) < 2.5 * found.error_rad + 0.01


def test_too_few_pixels_or_lines_tell_nothing():
    rng = np.random.default_rng(3)
    phase = rng.uniform(-np.pi, np.pi, (24, 600))
    ones = np.ones(phase.shape)
    for used in (rng.random(phase.shape) < 0.01, np.arange(24)[:, None] + 0.0 * ones < 3.0):
        light = Light(phase, used, ones, 0.0 * ones)
        assert with_light(unknown_ripple((1, 2, 3, 6), 3), light, 3, np.zeros(TABLE_BINS)) is None
    alike = Light(np.full(phase.shape, 0.3), ones > 0.0, ones, 0.0 * ones)
    assert with_light(unknown_ripple((1, 2, 3, 6), 3), alike, 3, np.zeros(TABLE_BINS)) is None


def scene(kind, rng):
    """Columns of the projector that a camera sees, and its albedo."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]] / SHAPE[1] - 0.5
    albedo = np.full(SHAPE, 0.8)
    relief = np.zeros(SHAPE)
    for _ in range(12):
        a, b, size = rng.uniform(-0.5, 0.5), rng.uniform(-0.4, 0.3), rng.uniform(0.03, 0.12)
        relief += rng.normal(0.0, 0.2) * np.exp(-((u - a) ** 2 + (v - b) ** 2) / 2.0 / size**2)
    slope = 60.0 * relief
    if kind == "fringes along the lines":
        columns = 320.0 + 420.0 * (v + 0.02 * u) + slope
    elif kind == "few fringes":
        columns = 320.0 + 110.0 * u + slope
    elif kind.endswith("narrow"):
        columns = 320.0 + 420.0 * u + 2.0 * slope
        albedo = np.where(np.abs(u) < (0.06 if kind.startswith("very") else 0.12), albedo, 0.0)
    else:  # stripes in step with the fringes
        columns = 320.0 + 420.0 * u + 0.2 * slope
        albedo = albedo * np.where((columns / 96.0) % 1.0 < 0.4, 0.3, 1.0)
    return columns, albedo


def photographs(plan, columns, albedo, response, rng):
    """Frames of 8 bits that a camera takes, with blur of projector and camera, and noise."""
    fine = (np.arange(LENGTH * OVER) + 0.5) / OVER - 0.5
    frames = []
    for block in plan.blocks:
        for k in range(block.frames):
            drawn = np.rint(255.0 * block.values(np.arange(LENGTH, dtype=float), k)) / 255.0
            light = gaussian_filter1d(np.repeat(response(drawn), OVER), 0.6 * OVER, mode="nearest")
            counts = gaussian_filter(albedo * 190.0 * (np.interp(columns, fine, light) + 0.05), 0.6)
            counts = counts + 3.0 + rng.normal(0.0, 1.2, SHAPE)
            frames.append(np.clip(np.rint(counts), 0, 255).astype(np.uint8))
    return frames


@pytest.mark.parametrize("seed", quick([31, 32, 33], 31))
@pytest.mark.parametrize("name", quick(["gamma 2.2", "S", "gamma 0.6", "linear"], "gamma 2.2"))
@pytest.mark.parametrize(
    "kind", ["fringes along the lines", "few fringes", "narrow", "very narrow", "stripes"]
)
def test_sigma_covers_where_lines_do_not_show_the_response(kind, name, seed):
    """The response once stayed in the coordinates and out of σ: up to 800,000 per million pixels
    were off by more than 5 σ."""
    rng = np.random.default_rng(seed)
    code = GrayCode("x", 24.0, LENGTH)
    blocks = (PhaseSteps("x", 48.0, equal_steps(3)), code, Uniform("white"), Uniform("black"))
    plan = PatternPlan(LENGTH, 480, blocks)
    columns, albedo = scene(kind, rng)
    found = fw.decode(photographs(plan, columns, albedo, RESPONSES[name], rng), plan).x
    edge = gaussian_filter((np.abs(np.gradient(albedo, axis=1)) > 0.05).astype(float), 3.0) > 1e-3
    judged = (albedo > 0.1) & ~edge
    ok = judged & np.isfinite(found.coordinate_px)
    assert ok.sum() > 0.97 * judged.sum()
    off = np.abs(found.coordinate_px - columns)[ok] / found.sigma_px[ok]
    assert np.mean(off < 1.0) > 0.55  # a sinusoid of σ spends half of its phases within σ
    assert np.mean(off < 2.0) > 0.92
    assert np.mean(off > 5.0) < 1e-4
    # Of the ripple of γ = 2.2, 1.5 px rms, hardly anything is left.
    assert np.std((found.coordinate_px - columns)[ok]) < (0.5 if name != "S" else 0.9)


def test_a_response_is_named_and_a_linear_one_is_not():
    for name in ("gamma 2.2", "linear"):
        rng = np.random.default_rng(35)
        blocks = (PhaseSteps("x", 48.0, equal_steps(3)), GrayCode("x", 24.0, LENGTH))
        plan = PatternPlan(LENGTH, 480, (*blocks, Uniform("white"), Uniform("black")))
        columns, albedo = scene("few fringes", rng)
        found = fw.decode(photographs(plan, columns, albedo, RESPONSES[name], rng), plan)
        told = {finding.kind for finding in found.findings} & {"response", "ripple"}
        assert told == (set() if name == "linear" else {"response"})


@pytest.mark.parametrize("gamma", [1.8, 1.0])
def test_an_unknown_response_is_in_sigma_where_nearly_all_is_saturated(gamma):
    """Such captures once had 815,000 per million pixels beyond 5 σ."""
    rng = np.random.default_rng(36)
    blocks = (PhaseSteps("x", 48.0, equal_steps(3)), GrayCode("x", 24.0, LENGTH))
    plan = PatternPlan(LENGTH, 480, (*blocks, Uniform("white"), Uniform("black")))
    columns, albedo = scene("few fringes", rng)
    frames = photographs(plan, columns, 1.6 * albedo, lambda v: v**gamma, rng)
    found = fw.decode(frames, plan).x
    ok = np.isfinite(found.coordinate_px)
    assert ok.sum() > 1000
    off = np.abs(found.coordinate_px - columns)[ok] / found.sigma_px[ok]
    assert np.mean(off < 2.0) > 0.9
    assert np.mean(off > 5.0) < 1e-4


@pytest.mark.parametrize("steps", [3, 4, 8])
def test_light_of_the_room_that_flickers_is_told_within_its_error(steps):
    """Offsets of the frames in proportion to the paint move the phasors by a share of the
    background, whatever the phases along lines."""
    rng = np.random.default_rng(11)
    phase = np.cumsum(rng.normal(0.0, 0.4, (24, 600)), axis=1) + rng.uniform(0, 6, (24, 1))
    shifts = 2.0 * np.pi * np.arange(steps) / steps
    offsets = rng.normal(0.0, 0.06, steps)
    frames = 0.7 + 0.5 * np.cos(phase[..., None] - shifts) + offsets
    wave = 4.0 / steps * np.sum(frames * np.exp(1j * shifts), axis=-1)
    measured_rad = np.angle(wave)
    modulation = np.abs(wave) * (1.0 + rng.normal(0.0, 0.05, phase.shape))
    fringe = np.floor(np.arange(600) / 40.0) + 0.0 * phase
    light = Light(measured_rad, phase > -np.inf, modulation, frames.mean(axis=-1), fringe)
    orders = (1, 2, *{3, 4, steps}, 2 * steps)
    nothing = unknown_ripple(orders, steps)
    found = with_frames(nothing, light, steps)
    error = np.angle(wave * np.exp(-1j * phase))
    expected = [2.0 * np.mean(error * np.exp(1j * k * measured_rad)) for k in (1, 2)]
    # The phase is off by κ + κ²/2 …, of which the logarithm of the modulation shows the same.
    size = abs(expected[0])
    assert size > 0.02
    assert np.all(np.abs(found.phasors_rad[:2] - expected) < 3.0 * found.error_rad + size**2)
    assert found.error_rad < 0.01
    few = Light(measured_rad, light.used, modulation, light.mean, fringe // 8.0)
    assert with_frames(nothing, few, steps) is nothing  # two fringes: paint may do the same
    others = Light(measured_rad, light.used, modulation, light.mean)
    assert with_frames(nothing, others, steps) is nothing


def folds(rng, width):
    """Columns that a camera sees on folds of cloth, and its albedo with shading."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]] / SHAPE[1] - 0.5
    columns = 320.0 + width * u
    for _ in range(4):
        wave = rng.uniform(2.0, 5.0) * u + rng.uniform(-1.5, 1.5) * v
        columns += 22.0 * rng.uniform(0.1, 0.3) * np.sin(2.0 * np.pi * (wave + rng.uniform()))
    albedo = 0.7 * (1.0 + 0.15 * gaussian_filter(rng.normal(0.0, 10.0, SHAPE), 3.0))
    return columns, np.clip(albedo, 0.2, 1.0)


@pytest.mark.parametrize("seed", quick([41, 42, 43], 41))
@pytest.mark.parametrize("flicker", quick([0.0, 0.03, 0.1], 0.1))
@pytest.mark.parametrize("steps", quick([3, 4, 8], 3))
@pytest.mark.parametrize("width", [420.0, 180.0])
def test_sigma_covers_folds_in_light_that_flickers(width, steps, flicker, seed):
    """Ripple of one per fringe once stayed in the coordinates and out of σ: up to 770,000 per
    million pixels were off by more than 5 σ. Folds across eight steps once made ripple of 1 px."""
    rng = np.random.default_rng(seed)
    blocks = (PhaseSteps("x", 32.0, equal_steps(steps)), GrayCode("x", 16.0, LENGTH))
    plan = PatternPlan(LENGTH, 480, (*blocks, Uniform("white"), Uniform("black")))
    columns, albedo = folds(rng, width)
    frames = []
    for frame in photographs(plan, columns, albedo, RESPONSES["linear"], rng):
        lamp = 170.0 * albedo * (0.15 + flicker * rng.uniform(-1.0, 1.0))
        frames.append(np.clip(np.rint(frame + lamp), 0, 255).astype(np.uint8))
    decoded = fw.decode(frames, plan)
    found = decoded.x
    assert np.isfinite(found.coordinate_px).mean() > 0.97
    inner = (slice(4, -4), slice(4, -4))  # blur folds the picture back at its rim
    off = (np.abs(found.coordinate_px - columns) / found.sigma_px)[inner]
    assert np.nanmean(off < 1.0) > 0.6
    assert np.nanmean(off < 2.0) > 0.92
    assert np.nanmean(off > 5.0) < 3e-4
    assert np.nanstd(found.coordinate_px - columns) < 0.15  # without it, up to 0.9 px
    if flicker == 0.0:
        told = {finding.kind for finding in decoded.findings}
        assert not told & {"steps", "motion", "flicker", "ripple", "response"}
