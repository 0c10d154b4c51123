"""Gray codes without fringes whose frames are in a wrong order: refused with the cause, by a view
of a part of the projector's picture, in which some bits are bright or dark nearly everywhere."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import fringeworks as fw
from fringeworks import FramesContradictPlan, PatternPlan
from fringeworks.patterns import GrayCode, Uniform
from tests.stacks import take

SIZE = (640, 400)
WHITE_BLACK = (Uniform("white"), Uniform("black"))
PAIRS = PatternPlan(*SIZE, (*WHITE_BLACK, GrayCode("x", 4.0, 640, True)))
BOTH = PatternPlan(*SIZE, (*WHITE_BLACK, GrayCode("x", 1.0, 640), GrayCode("y", 1.0, 400)))
PAIRS_OF_BOTH = PatternPlan(*SIZE, (GrayCode("x", 2.0, 640, True), GrayCode("y", 2.0, 400, True)))


def photographed(plan, seed):
    """Frames of a relief that four fifths of the picture cover, of a camera with a little blur."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[:200, :280].astype(float)
    bump = 12.0 * np.sin(u / rng.uniform(25, 45) + v / rng.uniform(30, 60))
    at = (
        40.0 + 1.6 * v + 0.02 * u + 0.3 * bump,
        60.0 + 1.83 * u - 0.03 * v + bump + 30.0 * (u > rng.uniform(80, 200)),
    )
    albedo = rng.uniform(0.5, 0.9) + 0.1 * np.sin(u / 50.0)
    frames = take(plan, noise=0.0, albedo=albedo, at=at, seed=seed, kind=np.float64)
    frames = np.stack([gaussian_filter(frame, 0.5) for frame in frames])
    noisy = frames + rng.normal(0.0, 1.2, frames.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8), at[1]


def least_first(plan):
    """Places of the frames where each code begins with its least significant bit."""
    order = list(range(plan.frames))
    for first, block in plan.placed:
        if isinstance(block, GrayCode):
            size = 2 if block.inverse else 1
            starts = range(first, first + block.frames, size)
            order[first : first + block.frames] = [k + j for k in starts[::-1] for j in range(size)]
    return order


@pytest.mark.parametrize("plan", [PAIRS, BOTH, PAIRS_OF_BOTH], ids=["pairs", "both", "both pairs"])
@pytest.mark.parametrize("seed", range(2))
def test_codes_that_begin_with_the_least_bit(plan, seed):
    frames, _ = photographed(plan, seed)
    with pytest.raises(FramesContradictPlan, match="least significant bit"):
        fw.decode(frames[least_first(plan)], plan)


@pytest.mark.parametrize("lost", [4, 5, 8, 11, 16])
@pytest.mark.parametrize("seed", range(2))
def test_a_lost_frame_is_no_blur(lost, seed):
    """All later pairs are of two different bits, whose half difference is often zero."""
    frames, _ = photographed(PAIRS, seed)
    kept = [k for k in range(len(frames)) if k != lost]
    with pytest.raises(FramesContradictPlan, match="lost|early|never shown"):
        fw.decode(frames[[*kept, 0]], PAIRS)


@pytest.mark.parametrize(("a", "b"), [(4, 14), (4, 12), (3, 13)])
def test_bits_of_two_axes_that_are_swapped(a, b):
    """Both coordinates are folded, and as smooth along lines as surfaces are."""
    frames, _ = photographed(BOTH, 0)
    frames[[a, b]] = frames[[b, a]]
    with pytest.raises(FramesContradictPlan, match=f"{a} and {b} .* are swapped"):
        fw.decode(frames, BOTH)


@pytest.mark.parametrize("plan", [PAIRS, BOTH, PAIRS_OF_BOTH], ids=["pairs", "both", "both pairs"])
def test_blurred_codes_in_a_wrong_order_are_refused_or_measured(plan):
    """Other patterns that are tried may have no bit that is resolved."""
    frames, _ = photographed(plan, 1)
    blurred = np.stack([gaussian_filter(f.astype(float), 30.0) for f in frames]).astype(np.uint8)
    with pytest.raises(fw.InputError, match="expected"):
        fw.decode(np.roll(blurred, -1, axis=0), plan)


@pytest.mark.parametrize("plan", [PAIRS, BOTH], ids=["pairs", "both"])
@pytest.mark.parametrize("seed", range(3))
def test_frames_in_order_are_measured(plan, seed):
    frames, x = photographed(plan, seed)
    found = fw.decode(frames, plan).x
    error = np.abs(found.coordinate_px - x)
    assert np.isfinite(error).mean() > 0.95
    assert np.nanmean(error > 5.0 * found.sigma_px) < 0.01
