"""σ of coordinates that differ from their neighbours by more than it says."""

from __future__ import annotations

import numpy as np
import pytest

import fringeworks as fw
from fringeworks import _core
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import bust, fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look
from fringeworks.statistics.surface_scatter import SCALES, by_pixel, cover_scatter, scatters
from tests.fault_measure import capture, errors
from tests.fault_scenes import plans
from tests.fault_stage import Stage
from tests.grids import thinned
from tests.oracles.scatter import mean_chi

pytestmark = pytest.mark.statistical

MOST_PX = 8.0
"""Largest difference on one surface in these tests, projector px."""


def surface(noise=0.05, shape=(240, 320), seed=0):
    """A curved surface with its depth step, its σ and an even background."""
    v, u = np.mgrid[: shape[0], : shape[1]].astype(float)
    x = 1.3 * u + 0.002 * (u - 160.0) ** 2 + 3.0 * np.sin(v / 40.0) + np.where(u > 200, 60.0, 0.0)
    rng = np.random.default_rng(seed)
    measured = (x + noise * rng.standard_normal(shape)).astype(np.float32)
    return x, measured, np.full(shape, 0.05, np.float32), np.full(shape, 100.0, np.float32)


def within(x, measured, sigma, sigmas):
    """Share of the pixels within some standard deviations."""
    return float(np.mean(np.abs(measured - x) < sigmas * sigma))


def test_noise_alone_hardly_changes_sigma():
    _, measured, sigma, background = surface()
    assert not scatters(measured[::8], sigma[::8], MOST_PX)
    cover_scatter(measured, sigma, background, MOST_PX)
    assert np.median(sigma) == pytest.approx(0.05, rel=0.01)
    assert np.mean(sigma) < 0.053
    assert np.isfinite(sigma).all()


@pytest.mark.parametrize("factor", [2.0, 4.0])
def test_scatter_everywhere_is_covered(factor):
    x, measured, sigma, background = surface(noise=0.05 * factor)
    assert scatters(measured[::8], sigma[::8], MOST_PX)
    cover_scatter(measured, sigma, background, MOST_PX)
    assert 0.6 < within(x, measured, sigma, 1.0) < 0.76
    assert np.median(sigma) == pytest.approx(0.05 * factor, rel=0.15)


def test_scatter_of_a_region_stays_there():
    x, measured, sigma, background = surface()
    rng = np.random.default_rng(1)
    region = np.s_[100:140, 40:100]
    measured[region] += 0.4 * rng.standard_normal((40, 60)).astype(np.float32)
    cover_scatter(measured, sigma, background, MOST_PX)
    assert within(x[region], measured[region], sigma[region], 5.0) > 0.999
    assert np.median(sigma[region]) > 0.25
    outside = sigma.copy()
    outside[90:150, 30:110] = np.nan
    assert np.nanmax(outside) < 0.15


def test_depth_steps_are_no_scatter():
    _, measured, sigma, background = surface()
    cover_scatter(measured, sigma, background, MOST_PX)
    assert np.median(sigma[:, 198:203]) == pytest.approx(0.05, rel=0.01)


def test_errors_at_edges_of_brightness_are_covered_where_one_side_is_unknown():
    """A printed edge whose dark side cannot be measured: no difference is centred on its pixels."""
    x, measured, sigma, background = surface()
    columns = np.arange(20, 190, 10)
    rng = np.random.default_rng(2)
    shift = rng.standard_normal((240, columns.size)).astype(np.float32)
    for k, column in enumerate(columns):
        dark = k % 2 == 0
        background[:, column : column + 3] = 5.0 if dark else 60.0
        change = 0.95 if dark else 0.4
        measured[:, column - 1] += 0.6 * change * shift[:, k]
        if dark:
            measured[:, column : column + 3] = np.nan
            sigma[:, column : column + 3] = np.nan
    beside = columns[::2] - 1
    before = np.mean(np.abs(measured - x)[:, beside] > 5.0 * sigma[:, beside])
    assert before > 0.5
    cover_scatter(measured, sigma, background, MOST_PX)
    after = np.mean(np.abs(measured - x)[:, beside] > 5.0 * sigma[:, beside])
    assert after < 0.02


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("shape", [(1, 1), (3, 70), (200, 9), (130, 150)])
def test_factors_are_those_of_filters(scale, shape):
    rng = np.random.default_rng(3)
    x = np.add.outer(0.3 * np.arange(shape[0]), 1.3 * np.arange(shape[1]))
    scatter = np.where(np.arange(shape[1]) > shape[1] / 2, 3.0, 1.0)
    x = (x + 0.05 * scatter * rng.standard_normal(shape)).astype(np.float32)
    x[rng.random(shape) < 0.05] = np.nan
    sigma = np.where(np.isfinite(x), 0.05, np.nan).astype(np.float32)
    factors = np.ones(shape, np.float32)
    step, side = scale
    limits = {"most": MOST_PX, "excess": 4.0, "shared": 4.6}
    _core.raise_factors(x, sigma, factors, {"step": step, "side": side}, limits)
    expected = mean_chi(x.astype(float), sigma.astype(float), scale, MOST_PX, 4.0, 4.6)
    near = np.isclose(factors, expected, rtol=1e-3)
    assert np.mean(~near) < 1e-3  # a mean at the limit of significance may fall to either side
    if min(shape) > 100:
        assert np.mean(expected > 1.0) > 0.2


def test_bands_do_not_show():
    """Rows are examined in bands; a taller map has the same σ where its neighbourhood is the same."""
    _, measured, sigma, background = surface(noise=0.2, shape=(600, 200))
    whole, part = sigma.copy(), sigma[180:420].copy()
    cover_scatter(measured, whole, background, MOST_PX)
    cover_scatter(measured[180:420].copy(), part, background[180:420], MOST_PX)
    np.testing.assert_allclose(whole[190:410], part[10:-10], rtol=1e-5)


@pytest.mark.parametrize(
    ("fault", "plan"),
    [("jpeg-80", "heterodyne-4"), ("jpeg-80", "gray-3"), ("vibration", "gray-4-inverse")],
)
def test_faults_that_shift_all_sets_alike_are_covered(fault, plan):
    stage = Stage("bust", plans()[plan])
    shot = capture(fault, stage, 3)
    found = fw.decode(shot.frames, stage.plan)
    error = errors(found.x.coordinate_px, shot, 0.0)
    ok = np.isfinite(found.x.coordinate_px)
    named = {cause for finding in found.findings for cause in finding.causes}
    true = "vibration" if fault == "vibration" else "lossy compression"
    assert any(cause.startswith(true) for cause in named)
    kinds = {finding.kind for finding in found.findings}
    assert kinds & {"scatter", "correlated noise"} or fault == "vibration"
    assert np.mean(error[ok] < found.x.sigma_px[ok]) > 0.6
    assert np.mean(error[ok] > 5.0 * found.x.sigma_px[ok]) < 5e-4


@thinned(strength=1, steps=[3, 8], noise=[0.5, 2.0])
def test_the_demonstration_s_bust_has_no_scatter(noise, steps):
    rig = standard_rig(scale=0.4)
    plan = fringe_plan(rig, both=False, steps=steps)
    frames = photograph(look(rig, bust()), plan, Optics(seed=steps, noise=noise))
    found = fw.decode(list(frames), plan)
    assert "scatter" not in {finding.kind for finding in found.findings}


@pytest.mark.parametrize("shape", ["creases", "bumps", "spheres", "steps"])
def test_relief_is_no_scatter_of_single_pixels(shape):
    rng = np.random.default_rng(0)
    v, u = np.mgrid[:200, :400].astype(float)
    relief = {
        "creases": 0.6 * abs((u + 2.0 * v) % 60.0 - 30.0),
        "bumps": 6.0 * np.sin(u / 2.2) * np.cos(v / 6.0),
        "spheres": 0.4
        * np.sqrt(np.maximum(24.0**2 - (u % 60 - 30) ** 2 - (v % 60 - 30) ** 2, 0.0)),
        "steps": 2.5 * ((u + v) % 50 > 25),
    }[shape]
    x = 1.3 * u + relief
    sigma = np.full(x.shape, 0.05, np.float32)
    measured = (x + 0.05 * rng.standard_normal(x.shape)).astype(np.float32)
    assert scatters(measured, sigma, MOST_PX)
    assert not by_pixel(measured, sigma, MOST_PX)
    if shape != "bumps":  # whose own differences exceed all others
        hit = rng.random(x.shape) < 0.05
        measured[hit] += rng.standard_normal(hit.sum()).astype(np.float32)
        assert by_pixel(measured, sigma, MOST_PX)


def test_change_of_brightness_is_that_of_filters():
    from scipy import ndimage

    from fringeworks.statistics.surface_scatter import _squared_change

    background = np.random.default_rng(4).uniform(1.0, 9.0, (37, 53)).astype(np.float32)
    spread = ndimage.maximum_filter(background, 3) - ndimage.minimum_filter(background, 3)
    np.testing.assert_allclose(_squared_change(background), (spread / background) ** 2, rtol=1e-5)
    background[10, 10] = 0.0
    background[20, 20] = np.nan
    found = _squared_change(background)
    assert np.isfinite(found).all()
    assert found[10, 10] == found[20, 20] == 0.0
