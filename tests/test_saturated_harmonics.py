"""Fringes with harmonics whose brightest samples are saturated: the phase stays what it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fringeworks import PatternPlan
from fringeworks.patterns import PhaseSteps, equal_steps
from fringeworks.patterns.plan import step_design
from fringeworks.stack.decode import decode
from fringeworks.stack.decoded_sample import decode_sample
from fringeworks.stack.fits import harmonic_parts
from fringeworks.stack.kernel_settings import HARMONICS, Limits, decoding_of
from fringeworks.types import CameraNoise
from tests.oracles.phase_shift import fit_with_harmonics
from tests.stacks import guarded


def phase_of(frames, harmonics, limit):
    """Wrapped phases of a set of equal steps by the kernel, rad."""
    plan = PatternPlan(64, 2, (PhaseSteps("x", 64.0, equal_steps(len(frames))),))
    decoding = decoding_of(plan, "x", absolute=False, response=None)
    shares = tuple(tuple(map(float, row)) for row in harmonics)
    sets = (replace(decoding.sets[0], harmonics=shares),)
    planes = [np.ascontiguousarray(frame[None], np.float32) for frame in frames]
    found = decode_sample(
        replace(decoding, sets=sets), planes, CameraNoise(0.1, 0.0), Limits(limit).open
    )
    return found["phases"][0][0]


@pytest.mark.parametrize("steps", [4, 5, 8])
@pytest.mark.parametrize("share", [0.7, 0.85, 0.95])
def test_the_phase_of_the_samples_that_are_left_is_that_of_all(steps, share):
    """Whatever the harmonics do to the phase of all samples: a table takes that out."""
    rng = np.random.default_rng(steps)
    phase = np.linspace(-3.1, 3.1, 500)
    design = step_design(equal_steps(steps))
    fitted = np.stack([np.full(phase.size, 120.0), 90.0 * np.cos(phase), 90.0 * np.sin(phase)])
    across = np.linalg.qr(design, mode="complete")[0][:, 3:]
    harmonics = across @ rng.normal(0.0, 0.06, (steps - 3, 2 * len(HARMONICS)))
    frames = design @ fitted + harmonics @ harmonic_parts(fitted)
    limit = float(np.quantile(frames.max(axis=0), share))
    whole = phase_of(frames, harmonics, np.inf)
    assert np.abs(whole - phase).max() < 1e-5
    found = phase_of(frames, harmonics, limit)
    plain = phase_of(frames, (), limit)
    partly = np.isfinite(found) & (frames >= limit).any(axis=0)
    assert np.count_nonzero(partly) > 20
    assert np.abs(found - phase)[partly].max() < 2e-3
    assert np.abs(plain - phase)[partly].max() > 2e-2


@pytest.mark.parametrize("steps", [4, 6])
def test_the_kernel_fits_as_its_twin_does(steps):
    rng = np.random.default_rng(40 + steps)
    phase = rng.uniform(-3.0, 3.0, 60)
    shifts = np.array(equal_steps(steps))
    frames = 20.0 + 200.0 * (0.5 + 0.5 * np.cos(phase - shifts[:, None])) ** 2.0
    frames += rng.normal(0.0, 1.0, frames.shape)
    design = step_design(shifts)
    across = np.linalg.qr(design, mode="complete")[0][:, 3:]
    second = np.zeros((steps, 2 * len(HARMONICS)))
    second[:, :2] = 0.25 * np.column_stack((np.cos(2.0 * shifts), np.sin(2.0 * shifts)))
    shares = across @ (across.T @ second)
    found = phase_of(frames, shares, 190.0)
    twin = [fit_with_harmonics(frames[:, k], shifts, shares, 190.0)[0] for k in range(phase.size)]
    few = (frames < 190.0).sum(axis=0) < 3
    assert np.all(np.isnan(found[few]))
    known = np.isfinite(found) & (frames >= 190.0).any(axis=0)
    assert np.count_nonzero(known) > 15
    off = np.angle(np.exp(1j * (found - np.array(twin))))[known]
    assert np.abs(off).max() < 1e-4


@pytest.mark.parametrize("gamma", [1.6, 2.2, 2.8])
@pytest.mark.parametrize("seed", [1, 2])
def test_bright_pixels_of_four_steps_are_as_good_as_the_others(gamma, seed):
    """Three samples of four were fitted without their harmonics once: the error was 2 to 5 times
    that of the other pixels, and all of them had a larger σ."""
    plan = guarded(16.0, 4, (640, 60))
    rng = np.random.default_rng(seed)
    place = np.linspace(20.0, 600.0, 500)
    albedo = np.where((np.arange(500) // 50) % 2, 1.45, 0.8)
    shown = [block.values(place, k) ** gamma for block in plan.blocks for k in range(block.frames)]
    seen = albedo * (15.0 + 190.0 * np.stack([np.broadcast_to(s, place.shape) for s in shown]))
    frames = seen[:, None] + rng.normal(0.0, 1.5, (plan.frames, 200, 500))
    frames = np.clip(np.rint(frames), 0, 255).astype(np.uint8)
    found = decode(frames, plan)
    maps = found.x
    error = maps.coordinate_px - place
    partly = (frames[:4] == 255).any(axis=0) & np.isfinite(error)
    assert np.count_nonzero(partly) > 5000
    clear = np.isfinite(error) & ~(frames[:4] == 255).any(axis=0)
    z = np.abs(error / maps.sigma_px)
    assert 0.6 < np.mean(z[partly] < 1.0) < 0.85
    assert np.mean(z[partly] < 2.0) > 0.92
    assert "correlated noise" not in {finding.kind for finding in found.findings}
    assert np.mean(z[partly] > 5.0) < 1e-4
    rms = [np.sqrt(np.mean(error[k] ** 2)) for k in (partly, clear)]
    assert rms[0] < 2.0 * rms[1], rms
