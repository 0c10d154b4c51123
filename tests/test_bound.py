"""The Cramér–Rao bound of two frames."""

from __future__ import annotations

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.pair.prepared import prepare
from fringeworks.pair.windows import Windows

CAMERA = {"size": 300, "gamma": 2.2, "noise": 2.0, "bits": 8, "height_mm": 15.0, "fringes": 10}


def scene(name="tilt", **changes):
    made = fw.simulate.standard_scene(name, **{**CAMERA, **changes})
    return made, fw.pair.displacement_from_height(made.truth_mm, made.geometry)


def dense(windows, u, width, at):
    """The bound of one window, from its pixels one by one."""
    value, slope, known = windows.warp(u.astype(np.float32))
    y, x = (np.arange(n) - c for n, c in zip(u.shape, at, strict=True))
    dy, dx = y[:, None] / width, x[None, :] / width
    w = np.exp(-0.5 * (dx**2 + dy**2)) * (known > 0)
    w /= np.exp(-0.5 * (dx**2 + dy**2)).sum()

    def mean(v):
        return np.sum(w * v) / w.sum()

    spread = mean(value**2) - mean(value) ** 2
    b = (mean(value * windows.object) - mean(value) * mean(windows.object)) / spread
    one = np.ones_like(value)
    columns = np.stack([one, value, -b * slope, -b * slope * dx, -b * slope * dy])
    fisher = np.einsum("iyx,jyx,yx->ij", columns, columns, w) * 4 * np.pi * width**2
    noise = windows.object_noise + b**2 * windows.reference_noise
    return np.sqrt(noise * np.linalg.inv(fisher)[2, 2])


@pytest.mark.parametrize("width", [6.0, 20.0])
def test_it_is_that_of_the_pixels(width):
    made, u = scene("parabola", painted=True, seed=4)
    found = fw.pair.bound_px(made, u, window_px=width)
    windows = Windows.of(prepare(made))
    step = max(1, int(width / 4))
    for row, column in ((120, 150), (180, 210), (60, 90)):
        at = (row // step * step, column // step * step)
        assert found[at] == pytest.approx(dense(windows, u, width, at), rel=0.02)


def test_windows_reach_it_and_do_not_pass_it():
    errors, bounds = [], []
    for seed in range(6):
        made, u = scene(seed=seed)
        windows = Windows.of(prepare(made))
        fitted = windows.fit(u.astype(np.float32), [16.0], confidence=1e9)
        inner = (slice(60, -60, 20),) * 2
        errors.append((fitted.displacement_px - u)[inner])
        bounds.append(fw.pair.bound_px(made, u, window_px=16.0)[inner])
    ratio = np.sqrt(np.mean(np.square(errors)) / np.mean(np.square(bounds)))
    assert 0.85 < ratio < 1.5


def test_it_follows_noise_light_and_width():
    made, u = scene()
    usual = np.median(fw.pair.bound_px(made, u))
    noisier, _ = scene(noise=4.0)
    assert np.median(fw.pair.bound_px(noisier, u)) == pytest.approx(2 * usual, rel=0.15)
    assert np.median(fw.pair.bound_px(made, u, window_px=20.0)) < 0.6 * usual


def test_the_other_axis_and_what_is_unknown():
    made, u = scene("parabola", axis="y")
    u[:50] = np.nan
    found = fw.pair.bound_px(made, u)
    assert found.shape == u.shape
    assert np.array_equal(np.isnan(found), np.isnan(u))


def test_it_refuses_what_does_not_fit():
    made, u = scene()
    with pytest.raises(fw.InputError, match="window_px: expected 0.8 to 1000 px, got 0.1"):
        fw.pair.bound_px(made, u, window_px=0.1)
    with pytest.raises(fw.InputError, match=r"displacement_px: expected shape \(300, 300\)"):
        fw.pair.bound_px(made, u[:10])


def test_compare_states_it():
    made, _ = scene("parabola")
    (found,) = fw.evaluate.compare_captures([made], ["fourier", "windowed"])
    rows = found.rows()
    assert 0 < rows[0]["median_bound"] == rows[1]["median_bound"]
    inner = (slice(60, -60),) * 2
    error = np.abs(found.results["windowed"].surface.values - made.truth_mm)[inner]
    assert np.nanmedian(error) < 3 * np.nanmedian(found.bound[inner])
