"""Light that differs from frame to frame by the same counts at all pixels, beside fringes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from fringeworks import PatternPlan, decode, encode
from fringeworks.patterns import GrayCode, PhaseSteps, Uniform, equal_steps
from fringeworks.patterns.plan import step_design
from fringeworks.stack.decoded_sample import decode_sample
from fringeworks.stack.kernel_settings import Limits, decoding_of
from fringeworks.types import CameraNoise
from tests.oracles.phase_shift import fit
from tests.real_frames import counts, half

LIGHT = (Uniform("white"), Uniform("black"))
PLANS = {
    "three steps and a code": (
        PhaseSteps("x", 32, equal_steps(3)),
        GrayCode("x", 32, 1024),
        *LIGHT,
    ),
    "four steps and a code": (PhaseSteps("x", 32, equal_steps(4)), GrayCode("x", 32, 1024), *LIGHT),
    "a long set": (PhaseSteps("x", 64, equal_steps(3)), PhaseSteps("x", 1024, equal_steps(3))),
    "three sets": tuple(PhaseSteps("x", period, equal_steps(3)) for period in (21, 24, 27)),
}


def painted(seed):
    """Coordinates along x of a bulged surface of light and dark paint, and its albedo."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:300, :480]
    coordinate = 100.0 + 1.7 * x + 0.1 * y
    coordinate += 30.0 * np.exp(-((x - 240.0) ** 2 + (y - 150.0) ** 2) / (2.0 * 90.0**2))
    dark = ndimage.gaussian_filter(rng.standard_normal(x.shape), 12.0) < 0.0
    return coordinate, ndimage.gaussian_filter(np.where(dark, 0.15, 1.0), 0.7)


def photographed(plan, seed, *, offset=0.0, gain=0.0):
    """Frames whose light differs by up to an offset, counts, and a share."""
    coordinate, albedo = painted(seed)
    rng = np.random.default_rng(100 + seed)
    frames = []
    for picture in encode(plan):
        row = ndimage.gaussian_filter1d(np.asarray(picture[0], float) / 255.0, 0.6)
        light = albedo * (150.0 * np.interp(coordinate, np.arange(row.size), row) + 12.0)
        light = light * (1.0 + gain * rng.uniform(-1.0, 1.0)) + offset * rng.uniform(-1.0, 1.0)
        frames.append(5.0 + light + rng.standard_normal(light.shape))
    return counts(frames), coordinate


def against_truth(plan, frames, coordinate):
    found = decode(frames, plan)
    known = np.isfinite(found.x.coordinate_px)
    off = np.abs(found.x.coordinate_px - coordinate)[known]
    return found, known.mean(), off / found.x.sigma_px[known]


@pytest.mark.statistical
@pytest.mark.parametrize("name", PLANS)
@pytest.mark.parametrize("gain", [0.0, 0.02])
def test_errors_keep_to_their_sigma_where_light_differs_from_frame_to_frame(name, gain):
    plan = PatternPlan(1024, 768, PLANS[name])
    for seed in (11, 12):
        frames, coordinate = photographed(plan, seed, offset=3.0, gain=gain)
        found, share, z = against_truth(plan, frames, coordinate)
        assert share > 0.5
        assert np.mean(z < 1.0) > (0.57 if gain else 0.66)
        assert np.mean(z < 2.0) > (0.9 if gain else 0.94)
        assert np.mean(z > 5.0) < 1e-4
        if not gain:
            assert any("at all pixels" in finding.seen for finding in found.findings)


@pytest.mark.statistical
@pytest.mark.parametrize("name", PLANS)
def test_gains_are_not_taken_for_offsets(name):
    plan = PatternPlan(1024, 768, PLANS[name])
    for seed in (11, 12):
        for gain in (0.0, 0.03):
            frames, coordinate = photographed(plan, seed, gain=gain)
            found, _, z = against_truth(plan, frames, coordinate)
            assert np.mean(z > 5.0) < 1e-4
            assert not any("at all pixels" in finding.seen for finding in found.findings)


@pytest.mark.statistical
@pytest.mark.parametrize("name", ["a long set", "three sets"])
def test_light_that_differs_from_set_to_set_is_no_noise(name):
    plan = PatternPlan(1024, 768, PLANS[name])
    frames, coordinate = photographed(plan, 13)
    brighter = [frame + np.uint8(4) if k < 3 else frame for k, frame in enumerate(frames)]
    _, share, z = against_truth(plan, brighter, coordinate)
    assert share > 0.95
    assert 0.62 < np.mean(z < 1.0) < 0.75


@pytest.mark.parametrize("steps", [3, 4, 5])
@pytest.mark.parametrize("limit", [np.inf, 190.0])
def test_offsets_leave_the_phases_what_they_were(steps, limit):
    rng = np.random.default_rng(steps)
    shifts = np.array(equal_steps(steps))
    phase = rng.uniform(-3.1, 3.1, 300)
    fitted = np.stack([np.full(300, 110.0), 95.0 * np.cos(phase), 95.0 * np.sin(phase)])
    frames = step_design(shifts) @ fitted
    offsets = step_design(shifts) @ (0.0, 2.5, -4.0)
    plan = PatternPlan(64, 2, (PhaseSteps("x", 64.0, tuple(shifts)),))
    decoding = decoding_of(plan, "x", absolute=False, response=None)
    sets = (replace(decoding.sets[0], offsets=tuple(offsets)),)
    planes = [np.ascontiguousarray(row[None], np.float32) for row in frames + offsets[:, None]]
    maps = decode_sample(
        replace(decoding, sets=sets), planes, CameraNoise(0.1, 0.0), Limits(limit).open
    )
    shown = np.stack(planes)[:, 0].astype(float)
    for k in range(300):
        if np.count_nonzero(shown[:, k] < limit) < 3:
            continue
        kept = np.where(shown[:, k] < limit, frames[:, k], np.inf)
        expected, modulation, _ = fit(kept, shifts, 1e9)
        assert maps["phases"][0][0, k] == pytest.approx(expected, abs=2e-5)
        assert maps["modulations"][0][0, k] == pytest.approx(modulation, rel=1e-4)


@pytest.mark.statistical
@pytest.mark.parametrize("sequence", [1, 2])
def test_a_board_of_two_sets_under_light_that_differs(real_data, sequence):
    """Dark squares have six counts of modulation, and light differs by up to three."""
    folder = real_data / "board_slstudio" / f"calseq{sequence}"
    frames = [half(path) for path in sorted(folder.glob("frameSeq_*"))]
    sets = [
        PhaseSteps(axis, size / fringes, equal_steps(3))
        for axis, size in (("x", 1824.0), ("y", 1140.0))
        for fringes in (16, 1)
    ]
    plan = PatternPlan(1824, 1140, tuple(sets))
    plain = decode(counts(frames), plan)
    rng = np.random.default_rng(40 + sequence)
    found = decode(counts([0.7 * f + 25.0 + rng.uniform(-3.0, 3.0) for f in frames]), plan)
    for one, other in ((plain.x, found.x), (plain.y, found.y)):
        both = np.isfinite(one.coordinate_px) & np.isfinite(other.coordinate_px)
        off = np.abs(one.coordinate_px - other.coordinate_px)[both]
        z = off / np.hypot(one.sigma_px, other.sigma_px)[both]
        assert both.sum() > 0.93 * np.isfinite(one.coordinate_px).sum()
        assert np.mean(z < 2.0) > 0.95
        assert np.mean(z > 5.0) < 1e-3
