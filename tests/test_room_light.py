"""Light of the room that flickers, and exposures that are too long: what everybody else decodes is
measured, and standard deviations cover what the light does."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy import ndimage

import fringeworks as fw
from fringeworks.patterns.plan import GrayCode, PatternPlan, PhaseSteps, Uniform, equal_steps
from fringeworks.stack.agreement import LineEvidence
from fringeworks.stack.gray_frames import gray_frames, resolution
from fringeworks.stack.room_light import evened

WIDTH, HEIGHT, SHAPE, FINE = 512, 320, (120, 240), 3
LIGHT = (Uniform("white"), Uniform("black"))


def surface(seed, scale=1.6, start=30.0, dim=1.0):
    """Projector columns of a wall with a wave, and its paint, of which a third is ``dim``; FINE
    samples per pixel."""
    rng = np.random.default_rng(seed)
    v, u = (np.mgrid[: SHAPE[0] * FINE, : SHAPE[1] * FINE] + 0.5) / FINE - 0.5
    x = start + scale * u + 0.2 * v + 8.0 * np.sin(v / 23.0 + rng.uniform(0, 6)) * np.cos(u / 41.0)
    paint = 0.6 + 0.25 * np.sin(u / rng.uniform(17, 30)) * np.cos(v / rng.uniform(17, 30))
    return x, paint * np.where(u < SHAPE[1] / 3, dim, 1.0)


def photographed(
    plan,
    seed,
    *,
    peak=150.0,
    room=20.0,
    flicker=0.0,
    rolling=0.0,
    scaled=0,
    gamma=1.0,
    noise=1.0,
    **view,
):
    """Frames of the surface. ``room`` is the light of the room, in counts, of which ``flicker`` is a
    wave in time that turns by ``rolling`` from the first row to the last. A projector of ``scaled``
    pixels resamples its pictures before its response of ``gamma``."""
    rng = np.random.default_rng(seed + 1000)
    x, paint = surface(seed, **view)
    rows = np.linspace(0.0, rolling, SHAPE[0] * FINE)[:, None]
    frames = []
    for block in plan.blocks:
        pixels = np.arange(float(WIDTH))
        for k in range(block.frames):
            light = block.values(pixels, k)
            at = x
            if scaled:
                light = cv2.resize(light[None].astype(np.float32), (scaled, 1))[0]
                at = (x + 0.5) * scaled / WIDTH - 0.5
            light = ndimage.gaussian_filter1d(np.repeat(light**gamma, 8), 4.0)
            seen = light[np.clip(np.rint((at + 0.5) * 8.0 - 0.5), 0, light.size - 1).astype(int)]
            lamp = room * (1.0 + flicker * np.cos(rng.uniform(0.0, 2.0 * np.pi) + rows))
            counts = ndimage.gaussian_filter(paint * (2.0 + peak * seen + lamp), 0.7 * FINE)
            counts = counts.reshape(SHAPE[0], FINE, SHAPE[1], FINE).mean(axis=(1, 3))
            counts = counts + noise * rng.standard_normal(SHAPE)
            frames.append(np.clip(np.rint(counts), 0, 255).astype(np.uint8))
    return frames, x[FINE // 2 :: FINE, FINE // 2 :: FINE]


def errors(found, true):
    """Errors over their standard deviations of all measured pixels, and the share of these."""
    ok = np.isfinite(found.coordinate_px)
    return (found.coordinate_px - true)[ok] / found.sigma_px[ok], float(ok.mean())


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_flicker_that_differs_by_rows_is_in_sigma(seed):
    """The frames of a set, of which it changes each otherwise, leave more residuals than noise."""
    plan = PatternPlan(
        WIDTH, HEIGHT, (PhaseSteps("x", 64.0, equal_steps(8)), GrayCode("x", 32.0, WIDTH), *LIGHT)
    )
    light = {"room": 60.0, "flicker": 0.1, "rolling": 4.0, "gamma": 2.2, "scaled": 640}
    frames, true = photographed(plan, seed, noise=1.5, **light)
    z, share = errors(fw.decode(frames, plan, noise=fw.signal.CameraNoise(1.5)).x, true)
    assert share > 0.99
    assert np.mean(np.abs(z) < 2.0) > 0.94
    assert np.mean(np.abs(z) > 5.0) < 1e-4


@pytest.mark.parametrize("seed", [6, 7, 9, 10])
@pytest.mark.parametrize("view", [(0.35, 325.0), (0.9, 40.0)])
def test_a_gray_code_is_read_in_a_room_that_flickers(view, seed):
    """Black or white frames in other light than the bits, and bits that are uniform in the view."""
    plan = PatternPlan(
        WIDTH, HEIGHT, (PhaseSteps("x", 20.0, equal_steps(4)), GrayCode("x", 10.0, WIDTH), *LIGHT)
    )
    scale, start = view
    light = {"peak": 110.0, "room": 60.0, "flicker": 0.5}
    frames, true = photographed(plan, seed, scale=scale, start=start, **light)
    found = fw.decode(frames, plan)
    z, share = errors(found.x, true)
    assert share > 0.98
    assert np.mean(np.abs(z) < 2.0) > 0.93
    assert np.mean(np.abs(z) > 5.0) < 1e-3
    assert {one.kind for one in found.findings if one.rank} == {"flicker"}


@pytest.mark.parametrize("seed", [0, 1])
def test_coarse_bits_that_are_bright_in_the_view_repeat_nothing(seed, monkeypatch):
    """Both first bits are; a lamp that lights a part of the scene beside the fringes alone makes
    them look like patterns. Scenes with many edges are looked at for faults."""
    monkeypatch.setattr(LineEvidence, "suspicious", lambda _: True)
    plan = PatternPlan(
        WIDTH, HEIGHT, (PhaseSteps("x", 20.0, equal_steps(4)), GrayCode("x", 20.0, WIDTH), *LIGHT)
    )
    frames, true = photographed(plan, seed, scale=0.5, start=335.0, peak=90.0, noise=0.3)
    for k in range(4):
        frames[k][:, 120:] += 30
    z, share = errors(fw.decode(frames, plan).x, true)
    assert share > 0.9
    assert np.mean(np.abs(z) > 5.0) < 1e-3


@pytest.mark.parametrize("inverse", [False, True])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_steady_light_is_left_as_it_is(seed, inverse):
    code = GrayCode("x", 4.0, WIDTH, inverse=inverse)
    plan = PatternPlan(WIDTH, HEIGHT, (code, *LIGHT))
    frames, _ = photographed(plan, seed, peak=60.0, room=80.0, gamma=2.2, scaled=640, noise=3.0)
    kept, told = evened(frames, plan)
    assert not told
    assert kept is frames


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("exposure", [2.5, 4.0])
def test_a_gray_code_is_read_where_white_is_saturated(exposure, seed):
    """Lit bits reach the sensor's limit like white, and dark ones are far below it."""
    plan = PatternPlan(WIDTH, HEIGHT, (GrayCode("x", 2.0, WIDTH), *LIGHT))
    frames, true = photographed(plan, seed, peak=200.0 * exposure, room=0.0, scale=0.8)
    assert np.mean(frames[-2] == 255) > 0.5
    found = fw.decode(frames, plan)
    z, share = errors(found.x, true)
    assert share > 0.98
    assert np.nanmax(np.abs(found.x.coordinate_px - true)) < 4.0
    assert np.mean(np.abs(z) < 2.0) > 0.95
    assert np.mean(np.abs(z) > 5.0) == 0.0
    assert any(one.kind == "saturated" for one in found.findings)


def test_stripes_that_a_scaler_darkens_have_no_narrow_borders():
    """Bits and inverses that add up to less than white say nothing of the width of borders."""
    rng = np.random.default_rng(0)
    plan = PatternPlan(64, 40, (GrayCode("x", 1.0, 64, inverse=True),))
    (first, code), x = plan.gray_code("x"), rng.integers(0, 64, 4000)
    pairs = 100.0 * np.stack([code.values(np.arange(64.0), k)[x] for k in range(code.frames)])
    pairs[-2:] *= 0.45
    frames = np.clip(np.rint(10.0 + pairs + rng.standard_normal(pairs.shape)), 0, 255)
    gray = gray_frames(plan, first, code, phases=False)
    sample = [frame[None].astype(np.uint8) for frame in frames]
    found = resolution(gray, sample, fw.signal.CameraNoise(1.0))
    assert found.unresolved == 0
    assert np.isinf(found.blurred_px)
