"""Calibration on the virtual rig: accuracy, true error bars, and findings that give the cause."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from fringeworks import InputError, PatternPlan, Reason, decode, encode
from fringeworks.patterns import GrayCode, PhaseSteps, Uniform
from fringeworks.rig.calibration.bundle import adjust
from fringeworks.rig.calibration.calibrate import calibrate, observe
from fringeworks.rig.calibration.diagnosis import diagnose
from fringeworks.rig.calibration.leave_out import leave_poses_out, with_smooth_board
from fringeworks.rig.pinhole import pose, project, transform
from fringeworks.simulate.boards import BoardErrors, real_points
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import board_body, board_poses, fringe_plan
from fringeworks.stack.even_light import texture
from tests.grids import quick
from tests.rigs import (
    board,
    calibrated,
    observations,
    poses,
    rig,
    rig_errors,
    see,
    shoot,
    sighting,
    with_gross_errors,
)

pytestmark = pytest.mark.statistical


def test_accuracy_with_noise_and_eight_bits():
    """With half the resolution of the standard rig and eight poses, limits in px are the same."""
    found, truth = calibrated().rig, rig()
    errors = rig_errors(found, truth)
    for k in (0, 1, 9, 10):
        assert abs(errors[k]) < 5e-4 * [*truth.camera.parameters, *truth.projector.parameters][k]
    assert np.abs(errors[[2, 3, 11, 12]]).max() < 0.5
    assert found.baseline_mm == pytest.approx(truth.baseline_mm, rel=2e-4)
    assert max(found.residual_px) < 0.05
    sigma = np.sqrt(np.diag(found.covariance))
    assert np.mean(np.abs(errors) <= 3 * sigma) > 0.9
    assert max(calibrated().predicted_px) < 0.05


@pytest.mark.long
def test_true_parameters_lie_within_three_sigma():
    scores, ratios = [], []
    for seed in range(24):
        rng = np.random.default_rng(seed)
        seen = [sighting(rig(), board(), T, rng) for T in board_poses(board(), 12, seed=seed)]
        places = board_poses(board(), 12, seed=seed)
        found = adjust(seen, rig(), places)
        errors = rig_errors(found.rig, rig())
        scores.append(errors / np.sqrt(np.diag(found.rig.covariance)))
        ratios.append(errors @ np.linalg.solve(found.rig.covariance, errors) / errors.size)
    assert np.mean(np.abs(scores) < 3) >= 0.99
    # The standard deviations must not be too large either.
    assert np.std(scores) == pytest.approx(1.0, abs=0.12)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.2)


def test_result_does_not_depend_on_the_start():
    rng = np.random.default_rng(3)
    places = board_poses(board(), 8, seed=3)
    seen = [sighting(rig(), board(), T, rng) for T in places]
    from tests.oracles.triangulation import moved

    wrong_start = rig()
    for k, step in (
        (0, 40.0),
        (1, -30.0),
        (2, 15.0),
        (9, -60.0),
        (12, 20.0),
        (19, 0.02),
        (21, 8.0),
    ):
        wrong_start = moved(wrong_start, k, step)
    far = [pose(T[:3, :3], T[:3, 3] + [3.0, -4.0, 10.0]) for T in places]
    near_start, far_start = adjust(seen, rig(), places), adjust(seen, wrong_start, far)
    sigma = np.sqrt(np.diag(near_start.rig.covariance))
    step = rig_errors(far_start.rig, near_start.rig) / sigma
    assert np.abs(step).max() < 0.01


def test_wrong_corners_do_not_change_the_rig():
    rng = np.random.default_rng(4)
    places = board_poses(board(), 8, seed=4)
    seen = [sighting(rig(), board(), T, rng) for T in places]
    plain = adjust(seen, rig(), places)
    bad = seen[2].camera_px.copy()
    bad[[3, 40, 41]] += [1.5, -2.0]
    found = adjust([*seen[:2], replace(seen[2], camera_px=bad), *seen[3:]], rig(), places)
    assert not found.used[2][[3, 40, 41]].any()
    assert sum(int((~u).sum()) for u in found.used) <= 6
    step = rig_errors(found.rig, plain.rig) / np.sqrt(np.diag(plain.rig.covariance))
    assert np.abs(step).max() < 0.7


def test_phase_outliers_do_not_change_the_rig():
    T = poses()[1]
    clean = observations()[1]
    dirty = see(T, "pose1", optics=Optics(seed=1), damage=lambda d: with_gross_errors(d, 0.1))
    assert dirty.found.outliers == pytest.approx(0.1, abs=0.04)
    change = dirty.found.projector_px - clean.found.projector_px
    assert np.isfinite(change).all()
    assert np.abs(change).max() < 0.03
    found = calibrate([dirty if o.name == "pose1" else o for o in observations()], board())
    assert found.rig.baseline_mm == pytest.approx(rig().baseline_mm, rel=2e-4)


def test_coordinates_between_pixels_are_exact():
    for o, T in zip(observations(3), poses(), strict=False):
        at = project(
            rig().projector, transform(rig().T_projector_camera, transform(T, board().points_mm))
        )
        c = project(rig().camera, transform(T, board().points_mm))
        moved = np.einsum("nij,nj->ni", o.found.by_pixel, (o.view.pixels - c[o.view.index]))
        error = o.found.projector_px - at[o.view.index] - moved
        assert np.sqrt(np.mean(error**2)) < 0.01
        assert np.median(np.abs(error) / o.found.sigma_px) < 2.0


@pytest.mark.long
@pytest.mark.parametrize("text", ["charuco:12x9:12:8.5", "circles:9x7:15"])
def test_other_boards_calibrate_as_well(text):
    seen = [
        see(T, f"pose{k}", text=text, optics=Optics(seed=k))
        for k, T in enumerate(poses(6, 5, text))
    ]
    found = calibrate(seen, board(text))
    assert found.rig.baseline_mm == pytest.approx(rig().baseline_mm, rel=3e-4)
    assert found.rig.camera.focal_px[0] == pytest.approx(rig().camera.focal_px[0], rel=1e-3)
    assert max(found.rig.residual_px) < 0.05
    scores = scores_of(found.rig, rig())
    assert np.mean(np.abs(scores) < 4) > 0.9


@pytest.mark.parametrize("distortion", quick([0, 2, 4, 5], 0, 4))
def test_coefficients_that_are_not_estimated_are_zero(distortion):
    found = calibrate(observations(5), board(), distortion=distortion).rig
    sigma = np.sqrt(np.diag(found.covariance))
    for first, device in ((4, found.camera), (13, found.projector)):
        assert all(k == 0.0 for k in device.distortion[distortion:])
        assert (sigma[first + distortion : first + 5] == 0.0).all()
        assert all(k != 0.0 for k in device.distortion[:distortion])
        assert (sigma[first : first + distortion] > 0.0).all()


def test_other_numbers_of_coefficients_are_refused():
    with pytest.raises(InputError, match="0, 2, 4 or 5"):
        calibrate(observations(3), board(), distortion=3)


def test_a_good_calibration_has_only_minor_findings():
    causes = {f.kind for f in diagnose(calibrated())}
    assert causes <= {"poses", "corners"}


def test_a_moved_board_is_named():
    """The board moved by 0.3 mm between the photograph and the frames of the fringes."""
    o, T = observations()[4], poses()[4]
    _, plan, frames = shoot([board_body(board(), T)], Optics(seed=4))
    moved = board_body(board(), pose(T[:3, :3], T[:3, 3] + [0.0, 0.0, 0.3]))
    image = texture(shoot([moved], Optics(seed=4))[2], plan)
    inconsistent = observe(
        image, decode(frames, plan), board(), projector_size=o.projector_size, name="pose4"
    )
    found = calibrate([inconsistent if x.name == o.name else x for x in observations()], board())
    messages = [f.text for f in diagnose(found) if f.kind == "pose"]
    assert messages
    assert all(m.startswith("pose4: the ") for m in messages)


@pytest.mark.long
@pytest.mark.parametrize(("gamma", "named"), [(1.25, False), (2.2, True)])
def test_ripple_that_decoding_leaves_is_named(gamma, named):
    """Decoding takes ripple out; at γ = 1.25 what remains is no finding."""
    one = Optics(gamma=gamma, seed=1)
    full = fringe_plan(rig(), steps=3)
    seen = [
        see(T, f"pose{k}", optics=replace(one, seed=k), plan=full)
        for k, T in enumerate(poses(4, 6))
    ]
    calibration = calibrate(seen, board())
    found = [f for f in diagnose(calibration) if f.kind == "ripple"]
    assert [("γ" in f.text) for f in found] == [True] * named
    assert max(calibration.rig.residual_px) < 0.05


def test_a_bent_board_is_named():
    rng = np.random.default_rng(1)
    places = board_poses(board(), 10, seed=7)
    bent = real_points(board(), BoardErrors(bow_mm=0.3))
    adjusted = adjust(
        [sighting(rig(), board(), T, rng, real_mm=bent) for T in places], rig(), places
    )
    bow, sigma = adjusted.shape.bow_mm, adjusted.bow_sigma_mm
    assert bow[0] == pytest.approx(0.3, abs=0.03)
    assert np.abs(bow[1:]).max() < 0.03
    assert abs(bow[0]) > 6 * sigma[0]
    worse = replace(calibrated(), bow_mm=bow, bow_sigma_mm=sigma)
    assert any("not flat" in f.text for f in diagnose(worse))
    straight = adjust([sighting(rig(), board(), T, rng) for T in places], rig(), places)
    assert (np.abs(straight.shape.bow_mm) < 5 * straight.bow_sigma_mm).all()


def scores_of(found, truth):
    """Errors of the estimated parameters over their standard deviations."""
    free = np.diag(found.covariance) > 0
    return rig_errors(found, truth)[free] / np.sqrt(np.diag(found.covariance)[free])


@pytest.mark.long
@pytest.mark.parametrize("seeds", [2, pytest.param(5, marks=pytest.mark.long)])
def test_errors_of_the_board_are_in_the_covariance(seeds):
    """A print that is off by 0.1 mm and a bow of 1 mm, the same in every pose: as on paper."""
    to_truth, of_halves = [], []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        errors = BoardErrors(print_mm=0.1, bow_mm=1.0, direction_deg=40.0 * seed, seed=seed)
        real = real_points(board(), errors)
        places = board_poses(board(), 12, seed=seed)
        seen = [sighting(rig(), board(), T, rng, real_mm=real) for T in places]
        order = rng.permutation(12)
        first, second = (
            adjust([seen[k] for k in half], rig(), [places[k] for k in half])
            for half in (order[:6], order[6:])
        )
        assert first.prior.print_mm == pytest.approx(0.1, rel=0.2)
        to_truth += [scores_of(first.rig, rig()), scores_of(second.rig, rig())]
        both = replace(first.rig, covariance=first.rig.covariance + second.rig.covariance)
        of_halves.append(scores_of(both, second.rig))
    assert np.sqrt(np.mean(np.square(to_truth))) == pytest.approx(1.0, abs=0.3)
    assert np.sqrt(np.mean(np.square(of_halves))) < 1.3


@pytest.mark.parametrize("seeds", [3, pytest.param(12, marks=pytest.mark.long)])
def test_smooth_errors_of_the_print_are_in_the_covariance(seeds):
    """Waves as long as twice the board, as of paper that has stretched, but no stretch or shear."""
    scores = []
    for seed in range(seeds):
        rng = np.random.default_rng([70, seed])
        real = board().points_mm.copy()
        x, y = (real[:, :2] / 42.0).T
        waves = np.stack([np.sin(v + rng.uniform(0, 6)) for v in (x, y, x, y)], axis=-1)
        terms = np.column_stack((waves, x * y))
        terms -= (
            np.column_stack((x, y, x**0))
            @ np.linalg.lstsq(np.column_stack((x, y, x**0)), terms, rcond=None)[0]
        )
        real[:, :2] += terms @ rng.normal(0.0, 0.006, (5, 2))
        places = board_poses(board(), 10, seed=seed)
        seen = [sighting(rig(), board(), T, rng, real_mm=real) for T in places]
        adjusted = adjust(seen, rig(), places)
        adjusted = with_smooth_board(seen, adjusted, free=np.ones(24, bool))
        assert adjusted.smooth
        scores.append(scores_of(adjusted.rig, rig()))
    assert np.abs(scores).max() < 4.0
    assert np.sqrt(np.mean(np.square(scores))) < 1.3


@pytest.mark.long
@pytest.mark.parametrize("seeds", [2, pytest.param(4, marks=pytest.mark.long)])
def test_errors_that_a_pose_s_corners_share_are_in_the_covariance(seeds):
    """Phase errors that bend the projector's coordinates of a whole pose, each in its own way."""
    scores, stated = [], []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        places = board_poses(board(), 8, seed=seed)
        seen = []
        for T in places:
            one = sighting(rig(), board(), T, rng)
            u, v = ((one.camera_px - one.camera_px.mean(0)) / np.ptp(one.camera_px, axis=0)).T
            smooth = np.stack((u, v, u * u, u * v, v * v, u**3, v**3), -1) @ rng.normal(
                0, 0.1, (7, 2)
            )
            seen.append(replace(one, projector_px=one.projector_px + smooth))
        adjusted = adjust(seen, rig(), places)
        left_out = leave_poses_out(seen, adjusted, free=np.ones(24, bool))
        assert not with_smooth_board(seen, adjusted, free=np.ones(24, bool)).smooth
        stated.append(left_out.inflation)
        scores.append(scores_of(adjusted.rig, rig()) / left_out.inflation)
    assert min(stated) > 1.5
    assert np.sqrt(np.mean(np.square(scores))) < 1.3


@pytest.mark.long
def test_useless_coefficients_are_left_out():
    """The rig's lenses have no k₃: it is left out, and k₁ is kept."""
    found = calibrated().rig
    assert found.camera.distortion[4] == found.projector.distortion[4] == 0.0
    assert found.camera.distortion[0] != 0.0
    assert found.covariance[8, 8] == found.covariance[17, 17] == 0.0
    assert found.covariance[4, 4] > 0.0


def test_two_poses_are_too_few():
    with pytest.raises(InputError, match="3 poses or more, got 2; pose7: expected"):
        calibrate(observations(2), board(), skipped={"pose7": "pose7: expected a chessboard"})


def test_identical_poses_are_named():
    o = observations(2)
    twice = [o[0], replace(o[0], name="again"), replace(o[0], name="and again"), o[1]]
    with pytest.raises(InputError, match="did not move between pose0 and again and and again"):
        calibrate(twice, board())


def test_a_pose_taken_twice_is_mentioned():
    o = observations(5)
    found = calibrate([*o, replace(o[2], name="again")], board())
    messages = [f.text for f in diagnose(found)]
    expected = "the board did not move between pose2 and again: they count as one pose"
    assert any(m.startswith(expected) for m in messages)


def test_parallel_poses_are_named():
    target = board()
    middle = target.points_mm.mean(axis=0)
    seen = []
    for k, (x, y, z) in enumerate([(0, 0, 500), (10, 5, 480), (-12, 8, 530)]):
        T = pose(np.eye(3), np.array([x, y, z]) - middle)
        seen.append(see(T, f"pose{k}", optics=Optics(seed=k)))
    with pytest.raises(InputError, match="parallel"):
        calibrate(seen, target)


def test_swapped_axes_are_named():
    swapped = []
    for o in observations():
        found = replace(
            o.found, projector_px=o.found.projector_px[:, ::-1], by_pixel=o.found.by_pixel[:, ::-1]
        )
        swapped.append(replace(o, found=found))
    with pytest.raises(InputError, match="mirrored in all poses: its columns and rows are swapped"):
        calibrate(swapped, board())
    one = [swapped[0], *observations()[1:]]
    with pytest.raises(InputError, match="mirrored in pose0"):
        calibrate(one, board())


def test_mixed_sizes_are_named():
    o = list(observations(3))
    o[1] = replace(o[1], projector_size=(800, 600))
    with pytest.raises(InputError, match="one projector size, got 800 × 600, 960 × 600"):
        calibrate(o, board())


@lru_cache
def first_pose():
    """Plan, frames and coordinates of the board in its first pose."""
    _, plan, frames = shoot([board_body(board(), poses()[0])], Optics())
    return plan, frames, decode(frames, plan)


def test_weak_fringes_on_a_lit_board_are_named():
    """Where coarse fringes are seen and fine ones are not, the projector lights the board."""
    plan, frames, found = first_pose()
    weak = {
        axis: replace(
            m,
            coordinate_px=np.full_like(m.coordinate_px, np.nan),
            reason=np.full_like(m.reason, Reason.LOW_MODULATION),
        )
        for axis, m in found.maps.items()
    }
    size = (plan.width_px, plan.height_px)
    with pytest.raises(InputError, match="the fringes there are too weak"):
        observe(texture(frames, plan), replace(found, **weak), board(), projector_size=size)


def test_a_board_that_only_the_camera_sees_is_named():
    plan, frames, found = first_pose()
    dark = {
        axis: replace(m, coordinate_px=np.full_like(m.coordinate_px, np.nan))
        for axis, m in found.maps.items()
    }
    size = (plan.width_px, plan.height_px)
    with pytest.raises(InputError, match="pose9: .*the projector does not light the board"):
        observe(
            texture(frames, plan),
            replace(found, **dark),
            board(),
            projector_size=size,
            name="pose9",
        )
    with pytest.raises(InputError, match="pose9: calibration: expected both axes"):
        observe(
            texture(frames, plan),
            replace(found, y=None),
            board(),
            projector_size=size,
            name="pose9",
        )
    with pytest.raises(InputError, match="coordinates of shape"):
        observe(np.zeros((5, 5)), found, board(), projector_size=size)


def test_texture_is_even_light():
    _, plan, frames = shoot([board_body(board(), poses()[0])], Optics(noise=0.0))
    even = texture(frames, plan)
    assert even.dtype == np.float32
    # The mean over the equal steps of any set is the same light.
    first = np.mean([f.astype(float) for f in frames[:4]], axis=0)
    assert np.abs(even - first).max() < 1.5
    with pytest.raises(InputError, match="the plan has 24, got 3"):
        texture(frames[:3], plan)
    four = PatternPlan(64, 64, (GrayCode("x", 1.0, 64, levels=4),))
    with pytest.raises(InputError, match="white frame"):
        texture(np.zeros((3, 4, 4), np.uint8), four)


def test_texture_of_unequal_steps_has_no_fringes():
    plan = PatternPlan(64, 64, (PhaseSteps("x", 16.0, (0.0, 1.0, 2.5)),))
    frames = [40.0 + 100.0 * frame / 255.0 for frame in encode(plan)]
    np.testing.assert_allclose(texture(frames, plan), 90.0, atol=0.5)


GRAY_ALONE = PatternPlan(960, 600, (GrayCode("x", 2.0, 960), GrayCode("y", 2.0, 600)))
"""Gray code along both axes, without inverse, white or black frames."""


def test_gray_code_alone_lights_a_board():
    """The brightest and the darkest bit of a pixel stand for the white and the black frame."""
    lit = replace(GRAY_ALONE, blocks=(*GRAY_ALONE.blocks, Uniform("white"), Uniform("black")))
    _, _, frames = shoot([board_body(board(), poses()[0])], Optics(seed=1), plan=lit)
    alone = see(poses()[0], "pose0", optics=Optics(seed=1), plan=GRAY_ALONE)
    with_light = observe(
        texture(frames, lit), decode(frames, lit), board(), projector_size=(960, 600), name="pose0"
    )
    assert len(alone.view.index) == len(with_light.view.index) == 88
    assert np.abs(alone.view.pixels - with_light.view.pixels).max() < 0.1
    off = alone.found.projector_px - with_light.found.projector_px
    assert np.nanmax(np.abs(off)) < 0.3
    even = texture(frames[:-2], GRAY_ALONE)
    share = even[frames[-2] > 60] / frames[-2][frames[-2] > 60]
    assert 0.85 < np.percentile(share, 1) < np.percentile(share, 99) < 1.15
