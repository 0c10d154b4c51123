"""Scenes of which parts differ: in blur, in what fringes show of the response, and in brightness."""

import numpy as np
import pytest
import scipy

import fringeworks as fw
from fringeworks.patterns import GrayCode, PhaseSteps, Uniform, equal_steps

Y, X = np.mgrid[:120, :256].astype(float)


def taken(frames, noise, seed):
    rng = np.random.default_rng(seed)
    return [np.clip(np.rint(f + rng.normal(0.0, noise, f.shape)), 0, 255) for f in frames]


def noise_of(found, counts):
    """Standard deviation at a brightness, as the finding of the noise has it."""
    (finding,) = (f for f in found.findings if f.kind == "noise")
    read, gain = finding.figures["read_counts"], finding.figures.get("gain", 0.0)
    return float(np.sqrt(read**2 + gain * counts))


def bits_of(step_px, length, at):
    code = GrayCode("x", step_px, length)
    bits = code.frames
    cells = np.clip(np.floor((at + 0.5) / step_px), 0, code.cells - 1).astype(int)
    words = cells ^ (cells >> 1)
    return [((words >> (bits - 1 - k)) & 1).astype(float) for k in range(bits)]


@pytest.mark.parametrize("seed", range(3))
def test_noise_is_not_taken_from_harmonics_that_blur_takes(seed):
    """A response of γ 2.2 adds 0.4 of a second harmonic, and none where the projector is blurred."""
    steps = PhaseSteps("x", 16.0, equal_steps(4))
    plan = fw.PatternPlan(
        512, 400, (steps, GrayCode("x", 8.0, 512), *map(Uniform, ("white", "black")))
    )
    at = 40.0 + 1.5 * X + 3.0 * np.sin(Y / 40.0)
    phase, sharp = 2.0 * np.pi * at / 16.0, np.clip((X - 118.0) / 20.0, 0.0, 1.0)
    frames = []
    bright = np.where(Y < 80, 1.0, 0.2)
    for shift in steps.shifts_rad:
        wave = np.cos(phase - shift) + 0.4 * sharp * np.cos(2.0 * (phase - shift))
        frames.append(bright * (90.0 + 45.0 * wave))
    frames += [bright * (30.0 + 120.0 * bit) for bit in bits_of(8.0, 512, at)]
    frames += [150.0 * bright, 30.0 * bright]
    found = fw.decode(np.stack(taken(frames, 1.0, seed)).astype(np.uint8), plan)
    assert noise_of(found, 90.0) < 2.0  # 1.04 with rounding; 11 if harmonics counted as noise
    assert np.isfinite(found.x.coordinate_px).mean() > 0.97


@pytest.mark.parametrize("seed", range(3))
def test_noise_is_not_taken_from_stripes_that_a_scaler_darkens(seed):
    """A projector that resamples before its γ shows the finest bits and their inverse too dark."""
    at = 60.0 + 1.1 * X + 3.0 * np.sin(Y / 40.0)
    plan = fw.PatternPlan(512, 400, (GrayCode("x", 1.0, 512, True),))
    columns = np.arange(512.0)
    frames = []
    for bit in bits_of(1.0, 512, columns):
        for sent in (bit, 1.0 - bit):
            light = scipy.ndimage.gaussian_filter1d(sent, 1.2) ** 2.2
            frames.append(25.0 + 180.0 * np.interp(at, columns, light))
    found = fw.decode(np.stack(taken(frames, 1.5, seed)).astype(np.uint8), plan)
    assert noise_of(found, 115.0) < 3.0  # 1.5; 15 with the sums of all bits
    assert np.isfinite(found.x.coordinate_px).mean() > 0.97


@pytest.mark.parametrize("seed", range(3))
def test_neighbours_vote_where_a_small_part_is_dark(seed):
    """A strip of 5 % of the pixels has modulation that leaves the orders no margin."""
    sets = tuple(PhaseSteps("x", p, equal_steps(4)) for p in (18.0, 18.3, 20.5))
    plan = fw.PatternPlan(1080, 400, sets)
    at = 400.0 + 1.2 * X + 2.0 * np.sin(Y / 40.0)
    part = Y >= 113
    b = np.where(part, 5.0, 90.0)
    frames = [
        1.5 * b + 5.0 + b * np.cos(2.0 * np.pi * at / s.period_px - shift)
        for s in sets
        for shift in s.shifts_rad
    ]
    found = fw.decode(np.stack(taken(frames, 0.6, seed)).astype(np.uint8), plan)
    error = np.abs(found.x.coordinate_px - at)[part]
    assert np.isfinite(error).mean() > 0.95
    assert not np.any(error > 9.0)


@pytest.mark.parametrize("scale", [2.5, 3.0])
@pytest.mark.parametrize("seed", range(2))
def test_bits_finer_than_the_camera_are_unknown_in_coded_counts(scale, seed):
    """Phones show half of the light at 0.73 of the counts: stripes that blur look bright."""
    fine = np.arange(256 * 8) / 8 * scale
    at = 20.0 + fine + np.linspace(0.0, 4.0 * scale, 120)[:, None]
    frames = [*bits_of(1.0, 1024, at), np.ones_like(at), 0.0 * at]
    plan = fw.PatternPlan(1024, 400, (GrayCode("x", 1.0, 1024), Uniform("white"), Uniform("black")))

    def seen(pattern):
        light = scipy.ndimage.gaussian_filter1d(pattern, 8.0, axis=1)
        light = 0.02 + 0.7 * scipy.ndimage.uniform_filter1d(light, 8, axis=1)[:, 4::8]
        return 255.0 * (1.055 * light ** (1.0 / 2.4) - 0.055)

    frames = np.stack(taken([seen(f) for f in frames], 1.5, seed)).astype(np.uint8)
    found = fw.decode(frames, plan).x
    error, sigma = np.abs(found.coordinate_px - at[:, 4::8]), found.sigma_px
    ok = np.isfinite(error)
    assert ok.mean() > 0.9
    assert np.mean(error[ok] < 2.0 * sigma[ok]) > 0.95
    assert np.mean(error[ok] > 5.0 * sigma[ok]) < 1e-3
