"""Whether a rig still holds: knocks are found, named and corrected, and a good rig is left alone."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.rig.calibration.board_points import flatness_mm, scale_of
from fringeworks.rig.calibration.bundle import adjust
from fringeworks.rig.calibration.changes import EVERYTHING, NOTHING, fit_changes
from fringeworks.rig.calibration.drift import with_sigma
from fringeworks.rig.calibration.parameters import moved_rig, parameter_change
from fringeworks.rig.calibration.start import first_pose
from fringeworks.rig.pinhole import pose, rotation
from fringeworks.simulate.bodies import Plane
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import board_body, board_poses, fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look
from fringeworks.types import RIG_PARAMETERS
from tests.commands import run
from tests.grids import quick
from tests.rigs import ahead, board, sighting

pytestmark = pytest.mark.statistical

SCALE = 0.25
KNOCK = np.radians(0.2)
BOARD = "chessboard:11x8:12"


@lru_cache
def truth():
    return standard_rig(scale=SCALE)


@lru_cache
def calibration(seed=0):
    """The rig as it was calibrated once: off by its own σ."""
    rng = np.random.default_rng(seed)
    places = board_poses(board(), 12, seed=seed)
    return adjust([sighting(truth(), board(), T, rng) for T in places], truth(), places).rig


def knocked(**steps):
    """The true rig after a change of some parameters."""
    change = np.zeros(24)
    for name, step in steps.items():
        change[RIG_PARAMETERS.index(name.replace("_", " "))] = step
    return moved_rig(truth(), change)


def shoot(rig, bodies, seed=0, **optics):
    plan = fringe_plan(rig)
    frames = photograph(look(rig, bodies), plan, Optics(seed=seed, **optics))
    return fw.Stack(list(frames), plan)


def board_stack(rig, seed=0, number=0, **optics):
    place = board_poses(board(), 12, seed=50 + seed)[number]
    return shoot(rig, [board_body(board(), place)], seed, **optics)


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(k, marks=pytest.mark.long) for k in range(1, 5))]
)
@pytest.mark.parametrize("axis", quick("xyz", "y"))
def test_a_knock_is_found_and_named(axis, seed):
    now = knocked(**{f"rotation_{axis}": KNOCK})
    found = fw.rig.check_rig(calibration(seed), board_stack(now, seed, seed), board())
    assert found.verdict == "has moved"
    assert found.excess > 20
    assert [cause.name for cause in found.causes] == ["rotation"]
    expected = np.where(np.array(list("xyz")) == axis, 0.2, 0.0)
    # The check states twice the scatter of independent corners.
    assert (np.abs(found.rotation_deg - expected) < 3 * found.rotation_sigma_deg).all()
    assert found.rotation_sigma_deg.max() < 0.02
    assert f"{axis} +0.20" in str(found)


@pytest.mark.parametrize("seeds", [6, pytest.param(20, marks=pytest.mark.long)])
def test_independent_noise_is_no_drift(seeds):
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        place = board_poses(board(), 12, seed=70 + seed)[seed % 12]
        seen = sighting(truth(), board(), place, rng)
        rig = calibration(seed % 4)
        fits = fit_changes(rig, [seen], [first_pose(seen, rig.camera)])
        # χ² of 8 degrees of freedom exceeds 31.8 once in 10⁴.
        assert fits[NOTHING].cost - fits[EVERYTHING].cost < 31.8


def test_a_rig_that_holds_is_left_alone():
    found = fw.rig.check_rig(calibration(), board_stack(truth()), board())
    assert found.verdict == "holds"
    assert found.excess < 1
    assert found.causes == ()
    assert found.drift_mm < 4 * found.sigma_mm
    assert found.noticeable_mm < 0.2
    assert "the rig holds" in str(found)
    assert found.scale == pytest.approx(1.0, abs=4 * found.scale_sigma + 1e-4)


@pytest.mark.parametrize("axis", quick("xyz", "y"))
def test_the_corrected_rig_measures_as_before(axis):
    plane = [ahead(Plane(140, 100), turn=(0.2, 0.15, 0))]

    def flatness(rig, stack):
        points = fw.measure(stack, rig).points.xyz_mm
        return flatness_mm(points[np.isfinite(points).all(axis=-1)].astype(float)[::5])

    good = flatness(calibration(), shoot(truth(), plane))
    now = knocked(**{f"rotation_{axis}": KNOCK})
    corrected = fw.rig.adjust_rig(calibration(), board_stack(now), board())
    assert flatness(corrected, shoot(now, plane)) < 1.2 * good
    assert corrected.residual_px[1] < 0.1
    assert corrected.provenance.call == "adjust_rig"


@pytest.mark.parametrize("seeds", [2, pytest.param(4, marks=pytest.mark.long)])
def test_the_corrected_rigs_covariance_holds(seeds):
    """Over calibrations and poses, with the errors of corners that the covariance assumes."""
    squares = []
    for seed in range(seeds):
        now = knocked(rotation_y=KNOCK, translation_x=0.4)
        stacks = [board_stack(now, seed, k) for k in (0, 3)[: 1 + seed % 2]]
        found = fw.rig.adjust_rig(calibration(seed), stacks, board())
        error = parameter_change(found, now)
        free = np.diag(found.covariance) > 0
        squares.append(
            error[free] @ np.linalg.solve(found.covariance[np.ix_(free, free)], error[free])
        )
    # 24 parameters each; the scatter is stated twice, the calibration's share once.
    assert np.mean(squares) / 24 < 1.3


@pytest.mark.parametrize(
    ("steps", "cause", "words"),
    [
        ({"camera_fx": 7.9, "camera_fy": 7.9}, "camera focus", "camera was refocused"),
        pytest.param(
            {"projector_fx": 5.1, "projector_fy": 5.1},
            "projector focus",
            "projector was refocused",
            marks=pytest.mark.long,
        ),
        ({"translation_x": 1.0}, "translation", "moved against the camera by 1.0"),
    ],
)
def test_other_changes_are_told_apart(steps, cause, words):
    found = fw.rig.check_rig(calibration(), board_stack(knocked(**steps)), board())
    assert found.verdict == "has moved"
    assert found.causes[0].name == cause
    assert words in found.text


def test_a_longer_baseline_may_be_a_smaller_board():
    longer = 0.003 * truth().T_projector_camera[:3, 3]
    steps = {f"translation_{a}": v for a, v in zip("xyz", longer, strict=True)}
    found = fw.rig.check_rig(calibration(), board_stack(knocked(**steps)), board())
    assert found.causes[0].name == "baseline"
    assert "longer, or the board's squares are so much smaller" in found.text
    assert found.scale == pytest.approx(0.997, abs=3e-4)


def test_a_refocused_camera_is_adjusted():
    now = knocked(camera_fx=16.0, camera_fy=16.0)
    found = fw.rig.adjust_rig(calibration(), board_stack(now), board())
    error = parameter_change(found, now)
    assert (np.abs(error) < 3 * np.sqrt(np.diag(found.covariance))).all()
    assert np.sqrt(found.covariance[0, 0]) < 1.0
    points = fw.measure(shoot(now, [ahead(Plane(140, 100), z=520)]), found).points
    off = np.nanmedian(points.xyz_mm[..., 2]) - 520.0
    assert abs(off) < 3 * np.nanmedian(points.sigma_mm) < 0.3


def test_a_pose_that_says_little_gives_no_verdict():
    """A small board straight ahead, in noise, does not notice what matters."""
    small = fw.rig.parse_board("chessboard:5x4:6")
    place = pose(rotation(np.zeros(3)), np.array([-12.0, -9.0, 500.0]))
    wall = ahead(Plane(), z=510)
    stack = shoot(truth(), [board_body(small, place), wall], noise=4.0)
    found = fw.rig.check_rig(calibration(), stack, small)
    assert found.verdict == "cannot tell"
    assert "blind" in {f.kind for f in found.findings}
    assert "would have been noticed" in found.text


def test_a_rig_without_covariance():
    plain = replace(calibration(), covariance=None, residual_px=None)
    small = knocked(rotation_x=0.1 * KNOCK)
    found = fw.rig.check_rig(plain, board_stack(small), board())
    assert found.verdict == "cannot tell"
    assert "uncertainty" in {f.kind for f in found.findings}
    large = knocked(rotation_x=4 * KNOCK)
    assert fw.rig.check_rig(plain, board_stack(large), board()).verdict == "has moved"


def test_an_uncorrected_response_is_taken_out_and_said():
    place = board_poses(board(), 12, seed=50)[0]
    plan = fringe_plan(truth(), steps=3)
    view = look(truth(), [board_body(board(), place)])
    stack = fw.Stack(list(photograph(view, plan, Optics(gamma=2.2))), plan)
    found = fw.rig.check_rig(calibration(), stack, board())
    assert "ripple" not in {f.kind for f in found.findings}
    assert "response" in {f.kind for f in fw.decode(stack).findings}


def test_what_cannot_be_checked_is_refused():
    with pytest.raises(fw.InputError, match="one pose or more, got none"):
        fw.rig.check_rig(calibration(), [], board())
    with pytest.raises(fw.BoardNotFound):
        fw.rig.check_rig(calibration(), shoot(truth(), [ahead(Plane(140, 100))]), board())
    camera = replace(calibration().camera, width_px=300)
    with pytest.raises(fw.RigMismatch, match=r"camera of 300 × 256 px, got pose 1"):
        fw.rig.check_rig(replace(calibration(), camera=camera), board_stack(truth()), board())


def test_scale_and_flatness_of_points():
    grid = board().points_mm
    turned = 1.002 * grid @ rotation(np.array([0.3, -0.2, 0.1])).T + [1.0, 2.0, 500.0]
    assert scale_of(turned, grid) == pytest.approx(1.002, abs=1e-12)
    bent = grid + [0.0, 0.0, 1.0] * np.where(np.arange(len(grid)) % 2, 0.1, -0.1)[:, None]
    assert flatness_mm(bent) == pytest.approx(0.1, rel=0.02)
    assert with_sigma(0.20048, 0.00113) == "0.2005 ± 0.0011"
    assert with_sigma(13.4, 1.26) == "13.4 ± 1.3"
    assert with_sigma(1340.2, 126.0) == "1340 ± 126"


def test_on_the_command_line(tmp_path):
    now = knocked(rotation_y=KNOCK)
    for name, rig in (("good", truth()), ("bad", now)):
        stack = board_stack(rig)
        fw.files.write_stack(tmp_path / name, stack.frames, stack.plan)
    fw.files.write_rig(tmp_path / "rig.toml", calibration())
    checking = ("--rig", tmp_path / "rig.toml", "--board", BOARD)
    kept = tmp_path / "kept.toml"
    done = run("rig", "check", tmp_path / "good", *checking, "--adjust", "--out", kept)
    assert "the rig holds" in done.stdout
    assert "not written, because the rig holds" in done.stdout
    assert not kept.exists()
    figures = tmp_path / "check.json"
    done = run("rig", "check", tmp_path / "bad", *checking, "--json", figures, code=3)
    turned = re.search(r"the projector turned against the camera by ([\d.]+) ±", done.stdout)
    assert float(turned[1]) == pytest.approx(0.2, abs=0.004)
    written = json.loads(figures.read_text())
    assert written["verdict"] == "has moved"
    assert written["rotation_deg"][1] == pytest.approx(0.2, abs=0.02)
    out = tmp_path / "rig2.toml"
    run("rig", "check", tmp_path / "bad", *checking, "--adjust", "--out", out)
    again = ("--rig", out, "--board", BOARD)
    assert "the rig holds" in run("rig", "check", tmp_path / "bad", *again).stdout
    done = run("rig", "check", tmp_path / "bad", *checking, "--adjust", code=2)
    assert "--adjust: expected together with --out" in done.stderr
