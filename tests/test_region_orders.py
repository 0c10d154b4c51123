"""Orders of regions where smooth errors of wide fringes take the margin of every pixel."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from fringeworks import PatternPlan
from fringeworks.evaluate.scored_scenes import benchmark_scene
from fringeworks.patterns import PhaseSteps, equal_steps
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import bust, fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look
from fringeworks.stack.decode import decode
from fringeworks.stack.region_orders import _best, _Region
from fringeworks.types import InputError
from tests.grids import quick

SHAPE = (200, 300)


def smooth(rng, scale):
    """A smooth random map of median 0 and standard deviation 1."""
    field = gaussian_filter(rng.normal(size=SHAPE), scale, mode="reflect")
    return (field - np.median(field)) / field.std()


def frames_of(periods, place, errors, rng, noise=1.0):
    """Photographs of four steps of each period, whose phases have errors of their own, rad."""
    plan = PatternPlan(960, 60, tuple(PhaseSteps("x", p, equal_steps(4)) for p in periods))
    frames = []
    for period, error in zip(periods, errors, strict=True):
        for shift in equal_steps(4):
            light = 120.0 + 70.0 * np.cos(2.0 * np.pi * place / period + error - shift)
            frames.append(np.rint(light + rng.normal(0.0, noise, SHAPE)).astype(np.uint8))
    return plan, frames


@pytest.mark.parametrize("seed", quick([1, 2, 4], 1))
@pytest.mark.parametrize("step", [0.0, 15.0, 120.0])
def test_no_order_is_wrong_where_errors_of_wide_fringes_exceed_it(seed, step):
    """Errors of the widest fringes are more than half an order at some pixels: up to 770 of them
    were measured with a wrong order. The step is of whole periods, which finer fringes hide."""
    rng = np.random.default_rng(seed)
    place = 120.0 + 1.9 * np.arange(SHAPE[1]) + np.zeros(SHAPE) + 10.0 * smooth(rng, 40)
    place[60:120, 90:160] += step
    errors = [0.17 * smooth(rng, 40), 0.05 * smooth(rng, 20), np.zeros(SHAPE)]
    found = decode(*frames_of([960.0, 120.0, 15.0], place, errors, rng)[::-1]).x
    measured = np.isfinite(found.coordinate_px)
    error = found.coordinate_px - place
    assert measured.mean() > 0.6
    assert np.count_nonzero(np.abs(error[measured]) > 7.0) == 0


def best(off, middle, ratio, usual=0.0):
    """The order of a region whose errors have this mean, by fringes ``ratio`` times as wide."""
    pixels = (np.arange(128)[:, None] * 300 + np.arange(128)).ravel()
    region = _Region(pixels, np.array([middle]), off[None], np.array([1e-4]))
    orders = np.arange(-4.0, 4.0)[:, None] / ratio
    return _best(region, orders, region.of_mean(300, np.array([usual])))


def test_an_error_that_a_region_may_share_leaves_its_order_open():
    """Fringes forty times as wide: 0.05 rad that all pixels share are as much as a third of the way
    to the next order. Eight times as wide, they are little."""
    off = np.random.default_rng(0).normal(0.0, 1e-2, 128**2)
    assert best(off, 0.0, 40.0) is None
    assert best(off, 0.0, 8.0) == 4
    # Errors of other regions that a small one does not show by itself.
    assert best(off, 0.0, 8.0, usual=0.05**2) is None
    # Half-way between two orders, and a third of the way.
    assert best(off, 0.5 / 8.0, 8.0) is None
    assert best(off, 0.3 / 8.0, 8.0) is None


@pytest.mark.parametrize("seed", quick([5, 7, 8], 5))
def test_smooth_errors_that_all_places_share_in_part_do_not_refuse_the_stack(seed):
    """A mean error of 0.06 of an order beside 0.11 refused it: it was taken for motion."""
    rng = np.random.default_rng(seed)
    place = 120.0 + 1.9 * np.arange(SHAPE[1]) + np.zeros(SHAPE) + 10.0 * smooth(rng, 40)
    errors = [0.045 + 0.085 * smooth(rng, 40), np.zeros(SHAPE), np.zeros(SHAPE)]
    found = decode(*frames_of([960.0, 120.0, 15.0], place, errors, rng)[::-1]).x
    measured = np.isfinite(found.coordinate_px)
    assert measured.mean() > 0.95
    assert np.count_nonzero(np.abs((found.coordinate_px - place)[measured]) > 7.0) == 0


@pytest.mark.parametrize("seed", quick([5, 6, 7], 5))
@pytest.mark.parametrize(("noise", "size"), [(1.0, 0.3), (12.0, 0.3)])
def test_errors_of_many_orders_leave_none(seed, noise, size):
    """Twenty times as wide fringes with errors of a whole order: they look like small ones, and
    neighbours voted for up to 16,903 wrong orders of 76,800."""
    rng = np.random.default_rng(seed)
    place = 120.0 + 1.9 * np.arange(SHAPE[1]) + np.zeros(SHAPE) + 10.0 * smooth(rng, 40)
    errors = [size * smooth(rng, 25), np.zeros(SHAPE)]
    frames, plan = frames_of([960.0, 48.0], place, errors, rng, noise)[::-1]
    with pytest.raises(InputError, match="order_ambiguous"):
        decode(frames, plan)


@pytest.mark.parametrize("turns", [0.3, 2.3])
def test_a_scene_that_moved_between_the_sets_is_refused(turns):
    rng = np.random.default_rng(8)
    place = 120.0 + 1.9 * np.arange(SHAPE[1]) + np.zeros(SHAPE) + 10.0 * smooth(rng, 40)
    moved = 2.0 * np.pi * turns * (1.0 + 0.02 * smooth(rng, 60))
    frames, plan = frames_of([960.0, 120.0, 15.0], place, [0.0, 0.0, moved], rng)[::-1]
    with pytest.raises(InputError):
        decode(frames, plan)


def test_walls_that_light_each_other_are_measured():
    """A quarter of the corner's pixels before; plain rounding is wrong at a ninth of them."""
    scene = benchmark_scene("corner")
    found = decode(scene.capture.frames, scene.capture.plan).x
    error = (found.coordinate_px - scene.truth["coordinate"])[scene.measurable]
    measured = np.isfinite(error)
    assert measured.mean() > 0.92
    assert np.mean(np.abs(error[measured]) > 7.5) < 1e-4
    z = np.abs(error / found.sigma_px[scene.measurable])[measured]
    assert 0.6 < np.mean(z < 1.0) < 0.8
    assert np.mean(z > 5.0) < 1e-4


@pytest.mark.parametrize("seed", [71, 72])
def test_surfaces_that_fringes_join_do_not_keep_neighbours_from_voting(seed):
    """A bust before a wall in dim light: the finest fringes go on over whole steps between them."""
    rig = standard_rig(scale=0.5)
    view, plan = look(rig, bust()), fringe_plan(rig, both=False)
    optics = Optics(noise=2.0, exposure=0.17, ambient=1.0, gain=0.05, seed=seed)
    found = decode(list(photograph(view, plan, optics)), plan).x
    known = np.isfinite(found.coordinate_px) & view.lit
    error = found.coordinate_px[known] - view.projector_px[..., 0][known]
    assert known.sum() > 0.2 * view.lit.sum()
    assert np.count_nonzero(np.abs(error) > 0.5 * min(found.periods_px)) < 1e-4 * known.sum()
