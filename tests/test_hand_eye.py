"""Hand–eye calibration: σ that holds, poses that stand out, motions and readings that decide nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.rig.pinhole import pose, rotation
from fringeworks.rig.robot.readings import CONVENTIONS, inverses
from tests.robots import NOISE, board_places, bound, robot, the_rig, written

MOUNTS = ("hand", "base")


@pytest.mark.parametrize("mount", MOUNTS)
def test_without_noise_the_truth_is_found(mount):
    made = robot(900, 8, mount, noise=(0.0, 0.0), corner_px=0.0)
    found = made.calibrated()
    assert np.abs(made.error(found.robot.T_mount_camera)).max() < 1e-6
    assert np.abs(found.T_other_board - made.Y).max() < 1e-6
    assert found.used.all()


@pytest.mark.parametrize("mount", MOUNTS)
def test_noise_is_in_sigma_and_estimated(mount):
    made = robot(901, mount=mount)
    stated, own = made.calibrated(noise=NOISE), made.calibrated()
    for found in (stated, own):
        assert np.abs(made.error(found.robot.T_mount_camera) / found.sigma).max() < 4
    assert not stated.noise_estimated
    assert own.noise_estimated
    assert own.robot.noise.translation_mm == pytest.approx(NOISE[0], rel=0.5)
    assert own.robot.noise.rotation_deg == pytest.approx(NOISE[1], rel=0.5)
    assert any("was not stated" in note for note in own.notes)
    assert np.all(own.left_out_mm < 4 * own.left_out_sigma_mm)


def test_stated_noise_that_is_too_small_is_replaced():
    found = robot(902).calibrated(noise=(0.005, 0.001))
    assert found.noise_estimated
    assert found.robot.noise.translation_mm > 0.02
    assert found.warnings[0].kind == "robot noise"


def test_poses_that_stand_out_are_named():
    made = robot(903)
    poses = made.T_base_flange.copy()
    poses[3, 0, 3] += 1.0
    poses[[8, 11]] = poses[[11, 8]]
    for noise in (None, NOISE):
        found = made.calibrated(poses, noise=noise)
        assert np.flatnonzero(~found.used).tolist() == [3, 8, 11]
        named = [f.frames[0] for f in found.findings if f.kind == "outlying pose"]
        assert named == ["pose 4", "pose 9", "pose 12"]
        assert np.abs(made.error(found.robot.T_mount_camera) / found.sigma).max() < 4


def test_the_errors_of_the_camera_are_in_sigma():
    covariance = np.zeros((24, 24))
    covariance[:4, :4] = np.diag([3.0, 3.0, 1.0, 1.0]) ** 2
    made, rig = robot(904), the_rig()
    certain = made.calibrated(noise=NOISE)
    wide = fw.rig.hand_eye(
        made.T_base_flange,
        made.views,
        "chessboard:11x8:12",
        fw.Rig(rig.camera, rig.projector, rig.T_projector_camera, covariance),
        mount="hand",
        noise=NOISE,
    )
    assert np.all(wide.sigma >= certain.sigma)
    assert wide.sigma[3:].max() > 2 * certain.sigma[3:].max()


def _turned(turns):
    """T_camera_board of a board that turns about points near its middle."""
    rng = np.random.default_rng(905)
    first = board_places(rng, 1)[0]
    found = []
    for turn in turns:
        middle = pose(np.eye(3), np.array([0.0, 0.0, 500.0]) + rng.uniform(-15, 15, 3))
        found.append(middle @ pose(rotation(turn), np.zeros(3)) @ np.linalg.inv(middle) @ first)
    return found


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize(
    ("turns", "words"),
    [
        (np.zeros((8, 3)), "without turning it"),
        (np.linspace(-0.5, 0.5, 8)[:, None] * [0.0, 0.0, 1.0], "about one axis only"),
        (np.linspace(-0.5, 0.5, 8)[:, None] * [0.6, 0.0, 0.8], "about one axis only"),
    ],
)
@pytest.mark.parametrize("noise", [None, NOISE])
def test_motions_that_determine_nothing_are_refused(turns, words, mount, noise):
    made = robot(907, mount=mount, places=_turned(turns))
    with pytest.raises(fw.InputError, match=words):
        made.calibrated(noise=noise)


def test_too_few_poses_are_refused():
    made = robot(908, 3)
    with pytest.raises(fw.InputError, match=r"expected 4 poses or more, got 3"):
        made.calibrated()
    with pytest.raises(fw.InputError, match="a robot pose for each of the 3 board views, got 2"):
        made.calibrated(made.T_base_flange[:2])


def test_shuffled_poses_are_refused():
    made = robot(909)
    with pytest.raises(fw.InputError, match="contradict the board views"):
        made.calibrated(np.roll(made.T_base_flange, 1, axis=0))


def test_inverse_poses_and_the_other_mount_are_told_apart_by_nobody():
    made = robot(910)
    with pytest.raises(fw.InputError, match="cannot tell these two apart"):
        made.calibrated(inverses(made.T_base_flange))
    numbers = written(inverses(made.T_base_flange), CONVENTIONS["abb"])
    with pytest.raises(fw.InputError, match=r"wxyz:mm:inverse.*--mount\) base"):
        made.calibrated(fw.rig.robot_poses(numbers))
    found = made.calibrated(fw.rig.robot_poses(numbers, "inverse"))
    assert found.robot.poses_as == "wxyz:mm:inverse"


def test_a_reading_is_found_and_said():
    made = robot(911, 8)
    found = made.calibrated(fw.rig.robot_poses(written(made.T_base_flange, CONVENTIONS["ros"])))
    assert found.robot.poses_as == "xyzw:m"
    assert any("read as xyzw:m (as ros)" in note for note in found.notes)


def test_a_wrong_reading_is_named_with_the_right_one():
    made = robot(912, 8)
    poses = fw.rig.robot_poses(written(made.T_base_flange, CONVENTIONS["ros"]), "abb")
    with pytest.raises(fw.InputError, match=r"wxyz:mm \(as abb\); they fit as xyzw:m"):
        made.calibrated(poses)


@pytest.mark.parametrize("mount", MOUNTS)
@pytest.mark.parametrize("maker", CONVENTIONS)
def test_the_reading_of_every_maker_is_found(maker, mount):
    right = CONVENTIONS[maker]
    for seed in (920, 921):
        made = robot(seed, 12, mount)
        numbers = written(made.T_base_flange, right)
        found = made.calibrated(fw.rig.robot_poses(numbers))
        assert found.robot.poses_as == right.spec
        assert np.abs(made.error(found.robot.T_mount_camera) / found.sigma).max() < 4.5


@pytest.mark.parametrize("maker", CONVENTIONS)
def test_no_wrong_reading_is_taken(maker):
    right = CONVENTIONS[maker]
    made = robot(930, 12)
    numbers = written(made.T_base_flange, right)
    for said, wrong in CONVENTIONS.items():
        if wrong == right:
            continue
        with pytest.raises(fw.InputError):
            made.calibrated(fw.rig.robot_poses(numbers, said))


def test_readings_that_fit_equally_are_both_named():
    """Turns of a degree are the same rotation in any order of the axes."""
    turns = np.random.default_rng(940).normal(size=(12, 3)) * 0.006
    made = robot(941, places=_turned(turns), straight=True)
    poses = fw.rig.robot_poses(written(made.T_base_flange, CONVENTIONS["fanuc"]), "deg:mm:direct")
    with pytest.raises(fw.InputError, match=r"cannot tell whether .* or .*--poses-as"):
        made.calibrated(poses)
    found = made.calibrated(fw.rig.robot_poses(poses.values, "fanuc"))
    assert np.abs(made.error(found.robot.T_mount_camera) / found.sigma).max() < 4


@pytest.mark.parametrize("half", [3, 8])
def test_a_board_that_looks_the_same_after_half_a_turn(half):
    """Views in which it was recognised turned are found, which are fewer or more than the others."""
    board = fw.rig.parse_board("chessboard:11x9:10")
    made = robot(950, 11, board=board.name)
    for view in made.views[:half]:
        object.__setattr__(view, "index", len(board.points_mm) - 1 - view.index)
    found = fw.rig.hand_eye(
        made.T_base_flange, made.views, board, the_rig(), mount="hand", noise=NOISE
    )
    assert found.used.all()
    assert np.abs(made.error(found.robot.T_mount_camera) / found.sigma).max() < 4
    turned = next(f for f in found.findings if f.kind == "half a turn")
    assert len(turned.frames) == min(half, 11 - half)


def test_a_board_of_another_size_is_not_taken_for_noise():
    made = robot(960)
    found = made.calibrated(board="chessboard:11x8:12.03")
    scale = next(f for f in found.findings if f.kind == "scale")
    assert scale.figures["scale"] == pytest.approx(12 / 12.03, abs=4 * scale.figures["sigma"])
    assert np.abs(made.error(found.robot.T_mount_camera) / found.sigma).max() < 4
    assert not [f for f in made.calibrated().findings if f.kind == "scale"]
    with pytest.raises(fw.InputError, match=r"the board has 9[56]\.\d+ ± .* % of its stated size"):
        made.calibrated(board="chessboard:11x8:12.5")


def test_poses_in_a_unit_that_is_no_reading_are_refused():
    made = robot(961, 10, places=_turned(np.random.default_rng(962).normal(size=(10, 3)) * 0.05))
    poses = made.T_base_flange.copy()
    poses[:, :3, 3] *= 0.1  # cm
    with pytest.raises(fw.InputError, match="contradict the board views"):
        made.calibrated(poses)


def test_sigma_holds_over_random_set_ups():
    ratios = []
    for seed in range(20):
        for mount in MOUNTS:
            made = robot(42_000 + seed, mount=mount)
            for noise in (NOISE, None):
                found = made.calibrated(noise=noise)
                assert found.used.all()
                ratios.append(made.error(found.robot.T_mount_camera) / found.sigma)
    z = np.abs(ratios)
    assert 0.60 < np.mean(z < 1) < 0.76
    assert np.mean(z < 2) >= 0.92


def test_sigma_holds_where_the_calibration_of_the_camera_is_off():
    off = np.array([1.0, 1.0, 0.6, 0.6, 2e-3, 5e-3, 1e-4, 1e-4, 0.0])
    own, covariance = np.diag(off**2), np.zeros((24, 24))
    own[0, 1] = own[1, 0] = 0.95
    covariance[:9, :9] = own
    rig, ratios = replace(the_rig(), covariance=covariance), []
    for seed in range(30):
        error = np.random.default_rng(seed).multivariate_normal(np.zeros(9), own)
        values = rig.camera.parameters + error
        real = replace(
            rig.camera,
            focal_px=tuple(values[:2]),
            principal_px=tuple(values[2:4]),
            distortion=tuple(values[4:]),
        )
        made = robot(44_000 + seed, mount=MOUNTS[seed % 2], camera=real)
        found = made.calibrated(rig=rig, noise=NOISE)
        assert found.used.all()
        ratios.append(made.error(found.robot.T_mount_camera) / found.sigma)
    z = np.abs(ratios)
    assert 0.58 < np.mean(z < 1) < 0.78
    assert np.mean(z < 2) >= 0.92


@pytest.mark.parametrize("mount", MOUNTS)
def test_errors_are_smaller_than_by_opencv(mount):
    cv2 = pytest.importorskip("cv2")
    if not hasattr(cv2, "calibrateHandEye"):
        pytest.skip("the bindings of OpenCV 5.0 have no calibrateHandEye")
    from benchmarks.hand_eye import errors, opencv_transforms

    ours, theirs = [], []
    for seed in range(12):
        for draw in range(3):
            made = robot(43_000 + seed, mount=mount, draw=draw)
            ours.append(errors(made, made.calibrated(noise=NOISE).robot.T_mount_camera))
            theirs.append([errors(made, T) for T in opencv_transforms(made)])
    one = np.sqrt(np.mean(np.square(ours), axis=0))
    others = np.sqrt(np.mean(np.square(theirs), axis=0))
    assert (others > one).all()
    assert (np.median(others, axis=0) > 1.05 * one).all()


@pytest.mark.parametrize("mount", MOUNTS)
def test_sigma_is_the_least_that_the_noise_allows(mount):
    """Of Cramér and Rao, computed from the views by differences, beside the package's own way."""
    for seed in (77_000, 77_001):
        found = robot(seed, mount=mount).calibrated(noise=NOISE)
        exact = robot(seed, mount=mount, noise=(0.0, 0.0), corner_px=0.0)
        least = np.sqrt(np.diag(bound(exact)))
        np.testing.assert_allclose(found.sigma, least, rtol=0.03)
