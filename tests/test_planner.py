"""Proposed plans reach the error that they predict."""

from __future__ import annotations

import numpy as np
import pytest

from fringeworks import InputError, decode, propose
from fringeworks.patterns import PhaseSteps
from fringeworks.signal import CameraNoise
from tests.stacks import take


@pytest.mark.parametrize("frames", [6, 9, 12, 20])
@pytest.mark.parametrize("noise", [1.0, 4.0])
def test_proposals_decode_with_the_predicted_error(frames, noise):
    found = propose(960, 40, frames, noise=noise, modulation=80.0, min_period_px=20.0)
    assert [p.sigma_px for p in found] == sorted(p.sigma_px for p in found)
    for proposal in found:
        plan = proposal.plan
        assert plan.frames <= frames
        assert proposal.margin >= 6.0
        assert min(b.period_px for b in plan.blocks if isinstance(b, PhaseSteps)) >= 19.9
        stack = take(plan, noise=noise, b=80.0, seed=frames)
        decoded = decode(stack, plan, noise=CameraNoise(np.hypot(noise, 12**-0.5))).x
        off = decoded.coordinate_px - np.arange(960)
        assert np.nanmax(np.abs(off)) < 7 * proposal.sigma_px + 0.5
        assert np.nanstd(off) == pytest.approx(proposal.sigma_px, rel=0.06)
        assert decoded.failed_fraction < 0.01


def test_more_frames_and_less_noise_are_better():
    best = {n: propose(1920, 1080, n)[0].sigma_px for n in (6, 9, 12, 24)}
    assert best[6] > best[9] > best[12] > best[24]
    assert propose(1920, 1080, 12, noise=1.0)[0].sigma_px < best[12]


def test_both_axes():
    for proposal in propose(1920, 1080, 24, axes=("x", "y")):
        assert proposal.plan.axes == ("x", "y")
        assert proposal.plan.frames <= 24
        assert " y: " in proposal.summary


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"frames": 2}, "3 or more for each axis"),
        ({"frames": 5, "axes": ("x", "y")}, "3 or more for each axis"),
        ({"frames": 12, "axes": ("z",)}, "axes: expected x, y or both"),
        ({"frames": 12, "noise": 0.0}, "noise: expected > 0"),
        ({"frames": 12, "modulation": -1.0}, "modulation: expected > 0"),
        ({"frames": 12, "noise": 1e300}, "noise: expected .* times the modulation"),
        ({"frames": 12, "modulation": 1e300}, "noise: expected .* times the modulation"),
        ({"frames": 12, "min_period_px": 1.0}, "2 px or more"),
        ({"frames": 12, "min_period_px": np.inf}, "2 px or more"),
        ({"frames": 4, "noise": 40.0}, "expected more frames or light"),
    ],
)
def test_impossible_requests_are_refused(options, words):
    with pytest.raises(InputError, match=words):
        propose(1920, 1080, **options)
