"""Poses judged while they are taken: a good set is enough, a lacking one names what it lacks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fringeworks import InputError
from fringeworks.rig import Observation
from fringeworks.rig.calibration.board_view import BoardView
from fringeworks.rig.calibration.bundle import adjust
from fringeworks.rig.calibration.calibrate import calibrate
from fringeworks.rig.calibration.correspondence import Correspondence
from fringeworks.rig.calibration.diagnosis import diagnose
from fringeworks.rig.calibration.residuals import Sighting
from fringeworks.rig.pinhole import pose, rotation
from fringeworks.scan.poses import judge_poses, rough_focal_px
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import board_poses, cropped_field
from tests.grids import quick
from tests.rigs import board, rig, rig_errors, see, sighting

pytestmark = pytest.mark.statistical

GOOD = {
    # Name: tilt of the top, then of the right side, towards the camera, degrees; place x, y, z, mm.
    "top": (25, 3, -4, 0, 500),
    "bottom": (-24, -4, 0, -3, 505),
    "left": (2, -26, 5, 2, 500),
    "right": (-3, 25, 0, 5, 495),
    "upper left": (8, -8, -36, -30, 500),
    "upper right": (8, 8, 36, -31, 500),
    "lower left": (-8, -8, -35, 29, 505),
    "lower right": (-8, 8, 36, 31, 500),
    "near": (11, -11, 0, 2, 462),
    "far": (-11, 11, -3, 0, 548),
    "slant a": (11, 11, -3, 0, 505),
    "slant b": (11, -11, -3, 0, 500),
    "slant c": (-11, 11, -3, 3, 505),
    "slant d": (-11, -11, -3, 3, 500),
}
"""A set that is enough, in which each pose is there for one thing."""


def placed(top, right, x, y, z):
    """T_camera_board of a board with its middle at x, y, z."""
    turn = rotation(np.radians([top, right, 0.0]))
    return pose(turn, np.array([x, y, z], float)) @ pose(np.eye(3), -board().points_mm.mean(axis=0))


def seen(T, name, rng, devices=None):
    """Observation of a board without its photograph, and its sighting; what is outside is lost."""
    devices = devices or rig()
    s = sighting(devices, board(), T, rng)
    sizes = [(d.width_px, d.height_px) for d in (devices.camera, devices.projector)]
    in_camera, lit = (
        ((px > 0) & (px < np.array(size) - 1)).all(axis=1)
        for px, size in zip((s.camera_px, s.projector_px), sizes, strict=True)
    )
    projector = np.where(lit[:, None], s.projector_px, np.nan)[in_camera]
    found = Correspondence(
        projector, s.by_pixel[in_camera], np.full(projector.shape, 0.004), 0.0, {}
    )
    view = BoardView(s.index[in_camera], s.camera_px[in_camera])
    both = in_camera & lit
    parts = (s.points_mm, s.camera_px, s.projector_px, s.by_pixel, s.index)
    return (
        Observation(name, np.zeros((2, 2)), view, found, *sizes),
        Sighting(*(part[both] for part in parts)),
    )


def judged(names, **changes):
    rng = np.random.default_rng(0)
    poses = {**{name: GOOD[name] for name in names}, **changes}
    return judge_poses([seen(placed(*p), n, rng)[0] for n, p in poses.items()], board())


def check_accuracy(found, truth):
    """The limits of docs/rig.md; principal points by their standard deviations, too."""
    errors = rig_errors(found, truth)
    for k in (0, 1, 9, 10):
        assert abs(errors[k]) < 5e-4 * [*truth.camera.parameters, *truth.projector.parameters][k]
    assert found.baseline_mm == pytest.approx(truth.baseline_mm, rel=2e-4)
    principal = [2, 3, 11, 12]
    sigma = np.sqrt(np.diag(found.covariance))[principal]
    # The documented sets of 12 poses have up to 0.31 px.
    assert sigma.max() < 0.33
    assert np.abs(errors[principal] / sigma).max() < 3.5
    return np.abs(errors[principal]).max()


def test_a_good_set_is_enough():
    judgement = judged(GOOD)
    assert judgement.missing == ()
    assert judgement.enough
    assert judgement.poses == len(GOOD)
    assert judgement.tilted == 10
    assert judgement.coverage > 0.85
    assert judgement.tilts_deg == pytest.approx((25, 24, 26, 25), abs=1.0)
    near, far = judgement.distances_mm
    assert far / near == pytest.approx(548.0 / 462.0, rel=0.01)
    assert judgement.focal_px == pytest.approx(rig().camera.focal_px[0], rel=0.05)
    assert str(judgement).endswith("enough")
    assert len(str(judgement)) < 140


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("top", "tilt the top of the board towards the camera by 20° or more"),
        ("bottom", "tilt the bottom of the board towards the camera by 20° or more"),
        ("left", "tilt the left side of the board towards the camera by 20° or more"),
        ("right", "tilt the right side of the board towards the camera by 20° or more"),
        ("upper left", "move the tilted board into the upper left corner of the camera's image"),
        ("upper right", "move the tilted board into the upper right corner of the camera's image"),
        ("lower left", "move the tilted board into the lower left corner of the camera's image"),
        ("lower right", "move the tilted board into the lower right corner of the camera's image"),
        ("near", "hold the board 10 % nearer"),
        ("far", "hold the board 10 % further away"),
    ],
)
def test_what_a_set_lacks_is_named(name, words):
    judgement = judged(n for n in GOOD if n != name)
    assert judgement.missing == (words,)
    assert not judgement.enough
    assert str(judgement).endswith(f"next: {words}")


def test_few_and_repeated_poses_are_counted():
    names = [n for n in GOOD if n[:5] != "slant"] + ["slant a"]
    assert judged(names).missing == ("take 2 more poses with the board tilted by 20° or more",)
    untilted = {name: (3, k, 0, 0, 500) for k, name in enumerate("abc")}
    assert judged(names[:-2], **untilted).missing[-1].startswith("take 4 more poses with")
    rng = np.random.default_rng(1)
    first = seen(placed(*GOOD["top"]), "top", rng)[0]
    twice = [first, replace(first, name="the same")]
    assert judge_poses(twice, board()).poses == 1
    assert (
        judge_poses(twice, board()).missing[-1]
        == "take 8 more poses with the board tilted by 20° or more"
    )


def test_no_pose_and_one_pose():
    nothing = judge_poses([], board())
    assert not nothing.enough
    assert "0 poses" in str(nothing)
    assert "projector's light" in str(nothing)
    level = judged([], level=(3, -4, 2, 1, 505))
    assert level.poses == 1
    # Nothing determines the focal length yet.
    assert level.focal_px == pytest.approx(1.5 * 640, rel=0.35)
    assert len(level.missing) >= 9
    assert level.missing[-1] == "take 9 more poses with the board tilted by 20° or more"


def test_regions_without_light_are_not_asked_for():
    """A projector that lights the left part of the image only."""
    devices = cropped_field(rig(), columns=(100, 560))
    rng = np.random.default_rng(0)
    observations = [
        seen(placed(t, r, x - 25, y, z), name, rng, devices)[0]
        for name, (t, r, x, y, z) in GOOD.items()
    ]
    judgement = judge_poses(observations, board())
    assert not judgement.field[:, -1].any() or judgement.field.sum() == judgement.field.size
    assert not any("right" in text and "image" in text for text in judgement.missing)


def test_rough_focal_lengths():
    for seed in range(5):
        rng = np.random.default_rng(seed)
        poses = board_poses(board(), 4, seed=seed)
        found = rough_focal_px([seen(T, "p", rng)[0] for T in poses], board())
        assert found == pytest.approx(rig().camera.focal_px[0], rel=0.1)


def test_mixed_cameras_are_refused():
    rng = np.random.default_rng(0)
    one = seen(placed(*GOOD["top"]), "top", rng)[0]
    with pytest.raises(InputError, match="one camera size, got 640 × 512, 800 × 600"):
        judge_poses([one, replace(one, camera_size=(800, 600))], board())


def obeyed(words, rng):
    """A pose by a hand that follows the words, not exactly."""
    top, right = rng.uniform(-8, 8, 2)
    x, y, z = rng.uniform(-6, 6), rng.uniform(-6, 6), 500 + rng.uniform(-8, 8)
    tilt = rng.uniform(18, 30)
    if words.startswith("tilt the"):
        top = tilt if " top " in words else -tilt if " bottom " in words else top
        right = tilt if " right " in words else -tilt if " left " in words else right
    if "image" in words:
        x += 32 * (("right" in words) - ("left" in words))
        y += 27 * (("lower" in words) - ("upper" in words))
    if "tilted" in words:
        side = rng.uniform(0, 2 * np.pi)
        top, right = tilt * np.cos(side), tilt * np.sin(side)
    if words.startswith("hold the board 10 %"):
        z *= 0.9 if "nearer" in words else 1.1
    return placed(top, right, x, y, z)


@pytest.mark.parametrize("seed", quick(range(12), *range(4)))
def test_a_hand_that_follows_the_words_gets_a_good_calibration(seed):
    rng = np.random.default_rng(seed)
    taken = [seen(placed(0, 0, 0, 0, 500), "start", rng)]
    places = [placed(0, 0, 0, 0, 500)]
    while not (judgement := judge_poses([o for o, _ in taken], board())).enough:
        assert len(taken) < 20, judgement.missing
        places.append(obeyed(judgement.missing[0], rng))
        taken.append(seen(places[-1], f"pose{len(taken)}", rng))
    assert len(taken) >= 12
    check_accuracy(adjust([s for _, s in taken], rig(), places).rig, rig())


@pytest.mark.long
def test_photographed_poses_that_are_enough_calibrate_the_rig():
    observations = [
        see(placed(*p), name, optics=Optics(seed=k)) for k, (name, p) in enumerate(GOOD.items())
    ]
    assert judge_poses(observations, board()).enough
    found = calibrate(observations, board())
    check_accuracy(found.rig, rig())
    assert {f.kind for f in diagnose(found)} <= {"corners"}
