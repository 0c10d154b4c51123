"""Several cameras and one projector: calibration, stereo, merging, and standard deviations."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
import scipy

from fringeworks import InputError, Reason
from fringeworks.rig import MultiRig
from fringeworks.rig.calibration.bundle import adjust
from fringeworks.rig.calibration.parameters import FurtherCamera, moved_rig
from fringeworks.rig.camera_findings import camera_findings, difference_histogram
from fringeworks.rig.camera_points import joined_points
from fringeworks.rig.device_errors import DeviceErrors, pixel_errors
from fringeworks.rig.device_pairs import camera_pair, pair_by_parameters
from fringeworks.rig.ray_estimates import combined, errors_over, estimates_of
from fringeworks.rig.stereo_match import CoordinateField
from fringeworks.rig.triangulate import triangulate
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import truth_distance
from fringeworks.statistics.local_scatter import scatter_factor
from tests.cameras import (
    adjusted,
    calibrated,
    further,
    gray_plan,
    measured,
    numeric,
    photographed,
    rig_errors,
    sightings,
    small_rig,
    surfaces,
    views_of,
)
from tests.rigs import rig_errors as pair_errors

pytestmark = pytest.mark.statistical

CALIBRATIONS = 24
"""Number of calibrations over which coverage is pooled. The error of a calibration is common to all
points, so one calibration counts as little more than one sample."""


def moved(rig: MultiRig, step: np.ndarray) -> MultiRig:
    """A rig after a step of all its parameters."""
    first = moved_rig(camera_pair(rig, 0), step[:24])
    assert first is not None
    others = [
        FurtherCamera(o.camera, o.T_camera_first).moved(part)
        for o, part in zip(further(rig), step[24:].reshape(-1, 15), strict=True)
    ]
    return MultiRig(
        (first.camera, *(o.camera for o in others)),
        first.projector,
        first.T_projector_camera,
        np.stack([np.eye(4), *(o.T_camera_first for o in others)]),
    )


@pytest.mark.parametrize("pair", [(0, "projector"), (1, "projector"), (0, 1), (1, 0), (1, 2)])
def test_a_pair_s_parameters_follow_those_of_the_rig(pair):
    rig = small_rig(cameras=3)
    by = pair_by_parameters(rig, *pair)
    rng = np.random.default_rng(0)
    for _ in range(4):
        step = 1e-6 * rng.normal(size=by.shape[1])
        change = pair_errors(camera_pair(moved(rig, step), *pair), camera_pair(rig, *pair))
        assert np.abs(change - by @ step).max() < 1e-8


@lru_cache
def adjustments():
    rig = small_rig()
    return [adjusted(rig, seed, count=6)[0] for seed in range(8)]


@pytest.mark.long
def test_parameters_of_two_cameras_lie_within_their_covariance():
    ratios, scores = [], []
    rig = small_rig()
    for found in adjustments():
        covariance = found.devices_covariance
        errors = rig_errors(_rig_of(found), rig)
        ratios.append(errors @ np.linalg.solve(covariance, errors) / errors.size)
        scores.append(errors / np.sqrt(np.diag(covariance)))
        assert found.converged
    # 8 calibrations of 39 parameters: the mean scatters by √(2 / 312) = 0.08.
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.25)
    assert np.sqrt(np.mean(np.square(scores))) == pytest.approx(1.0, abs=0.2)


def _rig_of(found) -> MultiRig:
    from fringeworks.rig.calibration.cameras import multi_rig_of

    return multi_rig_of(found)


def test_one_camera_gives_the_same_numbers_as_a_pair():
    """A rig of one camera goes through the same adjustment as a pair, number by number."""
    rig = small_rig(cameras=1)
    rng = np.random.default_rng(1)
    from tests.cameras import facing_poses

    places = facing_poses(4, 1)
    seen = sightings(rig, places, rng)
    named = adjust(seen, camera_pair(rig, 0), places)
    plain = adjust([replace(s, pose=None) for s in seen], camera_pair(rig, 0), places)
    assert np.array_equal(named.covariance, plain.covariance)
    assert named.rig == plain.rig


def test_a_second_camera_makes_the_projector_more_certain():
    rig = small_rig()
    both, seen = adjusted(rig, 3, count=6)
    from tests.cameras import facing_poses

    alone = adjust([s for s in seen if s.camera == 0], camera_pair(rig, 0), facing_poses(6, 3))
    ratio = np.diag(both.covariance)[9:18] / np.diag(alone.covariance)[9:18]
    assert (ratio < 1.05).all()
    assert np.median(ratio) < 0.9


def test_a_coordinate_is_read_between_pixels():
    rig = small_rig()
    view = views_of(rig, [surfaces(0)["plane"]])[1]
    decoded = numeric(view, np.random.default_rng(0), noise_px=1e-6)
    field = CoordinateField.of(decoded, ("x", "y"))
    v, u = np.nonzero(field.usable)
    place = np.stack((u, v), axis=-1)[:: len(u) // 50] + np.array([0.3, -0.4])
    place = place[field.usable_at(place)]
    around = np.rint(place).astype(int)
    exact = scipy.ndimage.map_coordinates(
        np.nan_to_num(view.projector_px[..., 0]), place[:, ::-1].T, order=3, mode="nearest"
    )
    inside = (np.abs(around - np.array([96, 77])) < 50).all(axis=1)
    assert np.abs(field.at(place)[inside, 0] - exact[inside]).max() < 1e-3
    assert inside.sum() > 10


def test_weights_are_least_squares_and_never_negative():
    rng = np.random.default_rng(0)
    A = rng.normal(size=(200, 3, 3))
    C = A @ A.transpose(0, 2, 1) + 0.01 * np.eye(3)
    w = rng.normal(size=(200, 3))
    w[::5, 1] = np.nan
    merged, weights = combined(w, C)
    assert (weights >= 0).all()
    assert weights.sum(axis=1) == pytest.approx(1.0)
    assert (weights[::5, 1] == 0).all()
    variance = np.einsum("ni,nik,nk->n", weights, C, weights)
    single = np.where(np.isfinite(w), np.einsum("nii->ni", C), np.inf)
    assert (variance <= single.min(axis=1) * (1 + 1e-9)).all()
    assert np.isfinite(merged).all()


def test_the_table_of_calibration_errors_is_right_between_its_nodes():
    rig = calibrated(small_rig(), 0, count=6)
    devices = ("projector", 1)
    table = DeviceErrors.of(rig, 0, devices, (1 / 600, 1 / 400))
    rng = np.random.default_rng(0)
    pixels = rng.uniform([20, 20], [170, 130], (100, 2))
    w = rng.uniform(1 / 590, 1 / 410, 100)
    exact = pixel_errors(rig, 0, devices, pixels, w)
    exact = exact @ exact.transpose(0, 2, 1)
    scale = np.sqrt(np.einsum("nii->ni", exact))
    error = (table.at(pixels, w) - exact) / (scale[:, :, None] * scale[:, None, :])
    # The last row, the length of the ray, is nearly nothing beside the others.
    of_devices = error[:, :4, :4]
    assert np.sqrt(np.mean(of_devices**2)) < 0.02
    assert np.quantile(np.abs(of_devices), 0.99) < 0.06


def test_scatter_is_measured_by_groups_of_sigma():
    rng = np.random.default_rng(0)
    sigma = np.repeat([[0.01], [0.1]], 60, axis=0) * np.ones((120, 100))
    real = np.where(sigma < 0.05, 0.5, 2.0) * sigma
    v, u = np.mgrid[:120, :100]
    found = scatter_factor(1e-4 * (u - 40.0) ** 2 + 0.01 * v + rng.normal(0, real), sigma)
    assert np.median(found[:50]) == pytest.approx(0.5, rel=0.1)
    assert np.median(found[70:]) == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize("axes", [("x", "y"), ("x",)])
def test_noise_is_stated_right_for_every_pair_and_merged(axes):
    """With an exact rig, errors are those of the noise alone; merging is better than any pair."""
    rig, rng = small_rig(), np.random.default_rng(5)
    views = views_of(rig, [surfaces(5)["plane"]])
    decoded = [numeric(view, rng) for view in views]
    if len(axes) == 1:
        decoded = [replace(d, y=None) for d in decoded]
    found = measured(rig, decoded, axes=axes)
    both = found.matched
    assert both.sum() > 10_000
    errors = []
    for cloud in (found.points, *found.pairs):
        error = truth_distance(views[0].points_mm, cloud.xyz_mm)[both]
        score = error / cloud.sigma_mm[both]
        assert np.sqrt(np.mean(score**2)) == pytest.approx(1.0, abs=0.06)
        assert np.mean(np.abs(score) < 1) == pytest.approx(0.683, abs=0.03)
        errors.append(np.sqrt(np.mean(error**2)))
    assert errors[0] <= min(errors[1:]) * 1.001
    # Two noises instead of one, over twice the baseline: √2 / 2.
    assert errors[2] < 0.75 * errors[1]


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_standard_deviations_cover_over_many_calibrations():
    """Every calibration has its own boards, noise and surfaces; the two cameras share the boards."""
    truth = small_rig()
    within, chi = [], []
    for seed in range(CALIBRATIONS):
        rig, rng = calibrated(truth, seed), np.random.default_rng(seed)
        name = ("plane", "tilted", "sphere")[seed % 3]
        views = views_of(truth, [surfaces(seed)[name]])
        decoded = [numeric(view, rng) for view in views]
        found = measured(rig, decoded)
        error = truth_distance(views[0].points_mm, found.points.xyz_mm)
        score = np.abs(error / found.points.sigma_mm)[found.matched]
        within.append([np.mean(score < 1), np.mean(score < 2)])
        chi.append(_low_order_chi_square(rig, decoded, views[0], found))
    one, two = np.mean(within, axis=0)
    assert 0.60 <= one <= 0.80
    assert 0.90 <= two <= 0.98
    # χ² of six coefficients: the mean over the calibrations scatters by √(12 / CALIBRATIONS).
    assert np.mean(chi) == pytest.approx(6.0, abs=3.0 * np.sqrt(12.0 / CALIBRATIONS))
    assert scipy.stats.kstest(chi, scipy.stats.chi2(6).cdf).pvalue > 0.01
    assert scipy.stats.chi2.sf(max(chi), 6) > 0.05 / CALIBRATIONS / 5


def _low_order_chi_square(rig, decoded, view, found) -> float:
    """Mahalanobis distance of a surface's quadratic deviation, by noise and calibration."""
    alone = triangulate(decoded[0], camera_pair(rig, 0))
    axes = ("x", "y")
    seen = estimates_of(rig, 0, decoded[0], alone, {1: CoordinateField.of(decoded[1], axes)}, axes)
    whole = np.flatnonzero(np.isfinite(seen.w).all(axis=1))
    whole = whole[:: max(1, len(whole) // 300)]
    noise = seen.noise_covariance()
    errors = errors_over(rig, 0, seen.devices, seen.w)
    w, weights = combined(seen.w, noise + seen.calibration_covariance(errors))
    w, weights, noise = w[whole], weights[whole], noise[whole]
    roots = pixel_errors(rig, 0, seen.devices, seen.pixels[whole], w)
    to_mm = -np.linalg.norm(seen.rays[whole], axis=1) / w**2
    common = np.einsum("ni,nir,nrp->np", weights, seen.by_errors()[whole], roots) * to_mm[:, None]
    random = np.einsum("ni,nik,nk->n", weights, noise, weights) * to_mm**2
    column, row = seen.pixels[whole].astype(int).T
    error = truth_distance(view.points_mm, found.points.xyz_mm)[row, column]
    u, v = column / view.body.shape[1] - 0.5, row / view.body.shape[0] - 0.5
    fit = np.linalg.pinv(np.column_stack((np.ones_like(u), u, v, u * u, u * v, v * v)))
    covariance = (fit @ common) @ (fit @ common).T + (fit * random) @ fit.T
    deviation = fit @ error
    return float(deviation @ np.linalg.solve(covariance, deviation))


@pytest.mark.long
@pytest.mark.parametrize("axes", ["x", "xy"])
def test_ripple_of_a_projector_is_gone_between_cameras(axes):
    """γ = 2.2 and three steps: what decoding leaves of 0.18 rad of ripple adds little to noise."""
    rig = small_rig(0.4)
    views = views_of(rig, [surfaces(1)["plane"]])
    plan = gray_plan(rig, period_px=20.0, steps=3, axes=axes)
    rms = {}
    for gamma in (1.0, 2.2):
        decoded = photographed(views, plan, Optics(gamma=gamma, noise=0.5, seed=3))
        found = measured(rig, decoded, axes=tuple(axes))
        assert found.matched.sum() > 0.85 * (found.points.reason == Reason.OK).sum()
        error = truth_distance(views[0].points_mm, found.points.xyz_mm)[found.matched]
        rms[gamma] = np.sqrt(np.mean(error**2))
        score = np.abs(error / found.points.sigma_mm[found.matched])
        assert 0.60 <= np.mean(score < 1) <= 0.80
        assert 0.90 <= np.mean(score < 2) <= 0.98
    assert rms[2.2] < 2.0 * rms[1.0]


def test_a_moved_camera_is_a_finding():
    rig, rng = small_rig(), np.random.default_rng(0)
    known = calibrated(rig, 0, count=6)
    views = views_of(rig, [surfaces(0)["plane"]])
    decoded = [numeric(view, rng) for view in views]
    assert camera_findings([measured(known, decoded)]) == ()
    step = np.zeros(39)
    step[24 + 10] = 4e-4  # a turn of the second camera about its y axis
    wrong = replace(moved(known, step), covariance=known.covariance)
    found = measured(wrong, decoded)
    (finding,) = camera_findings([found])
    assert finding.kind == "cameras"
    assert "camera 1" in finding.seen
    assert sum(difference_histogram(found)["share"]) == pytest.approx(1.0)


def test_an_isolated_pixel_stays_where_another_camera_confirms_it():
    rig, rng = small_rig(), np.random.default_rng(0)
    views = views_of(rig, [surfaces(0)["plane"]])
    decoded = [numeric(view, rng) for view in views]
    decoded[1] = replace(
        decoded[1], x=_without_right_half(decoded[1].x), y=_without_right_half(decoded[1].y)
    )
    doubtful = np.zeros(views[0].body.shape, bool)
    doubtful[60:90:7, ::7] = True
    alone = triangulate(decoded[0], camera_pair(rig, 0))
    others = {1: CoordinateField.of(decoded[1], ("x", "y"))}
    from fringeworks.rig.camera_points import camera_points

    found = camera_points(rig, 0, decoded[0], alone, others, ("x", "y"), doubtful=doubtful)
    lit = doubtful & (alone.reason == Reason.OK)
    assert (found.points.reason[lit & found.matched] == Reason.OK).all()
    assert (found.points.reason[lit & ~found.matched] == Reason.ISOLATED).all()
    assert (lit & found.matched).any()
    assert (lit & ~found.matched).any()


def _without_right_half(found):
    gone = np.zeros(found.reason.shape, bool)
    gone[:, gone.shape[1] // 2 :] = True
    return replace(
        found,
        coordinate_px=np.where(gone, np.nan, found.coordinate_px),
        sigma_px=np.where(gone, np.nan, found.sigma_px),
        reason=np.where(gone, Reason.SHADOW, found.reason).astype(np.uint8),
    )


def test_a_place_that_both_cameras_see_appears_once():
    rig, rng = small_rig(), np.random.default_rng(0)
    body = surfaces(0)["sphere"]
    views = views_of(rig, [body])
    decoded = [numeric(view, rng) for view in views]
    seen = [measured(rig, decoded, camera=k) for k in (0, 1)]
    joined = joined_points(rig, seen)
    counts = [int((s.points.reason == Reason.OK).sum()) for s in seen]
    assert counts[0] < len(joined.xyz_mm) == counts[0] + counts[1] - int(seen[1].matched.sum())
    radius = np.linalg.norm(joined.xyz_mm - body.T_world_body[:3, 3], axis=1)
    assert np.abs(radius - 45.0).max() < 0.5


def test_a_place_is_measured_in_three_cameras():
    rig, rng = small_rig(cameras=3), np.random.default_rng(2)
    views = views_of(rig, [surfaces(2)["plane"]])
    found = measured(rig, [numeric(view, rng) for view in views])
    assert found.devices == ("projector", 1, 2)
    all_three = np.isfinite(found.pairs[1].sigma_mm) & np.isfinite(found.pairs[2].sigma_mm)
    assert all_three.sum() > 5000
    errors = [
        np.sqrt(np.mean(truth_distance(views[0].points_mm, c.xyz_mm)[all_three] ** 2))
        for c in (found.points, *found.pairs)
    ]
    assert errors[0] <= min(errors[1:]) * 1.001
    score = truth_distance(views[0].points_mm, found.points.xyz_mm) / found.points.sigma_mm
    assert np.sqrt(np.mean(score[all_three] ** 2)) == pytest.approx(1.0, abs=0.06)


def test_wrong_rigs_are_refused():
    rig = small_rig()
    with pytest.raises(InputError, match="identity"):
        replace(rig, T_camera_first=rig.T_camera_first[::-1])
    with pytest.raises(InputError, match="baseline"):
        replace(rig, T_camera_first=np.stack([np.eye(4), np.eye(4)]))
    with pytest.raises(InputError, match=r"\(39, 39\)"):
        replace(rig, covariance=np.eye(24))
    with pytest.raises(InputError, match="twice"):
        camera_pair(rig, 1, 1)
    with pytest.raises(InputError, match="0 to 1"):
        camera_pair(rig, 2)
