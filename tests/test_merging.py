"""Views of one part: poses by a board, the axis of a turntable, registration, fusion."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.rig.pinhole import inverse, pose
from fringeworks.simulate.bodies import Body, Sphere
from fringeworks.views.poses import carried, from_twist, twist
from fringeworks.views.registration import register
from fringeworks.views.surface_points import surface_points
from tests.surfaces import plane_cloud
from tests.turntable import (
    TurntableErrors,
    board_on_table,
    bust_on_table,
    turned_poses,
    turntable_pose,
)
from tests.turntables import BOARD, T_table_board, clouds_on_table, rig

pytestmark = pytest.mark.statistical

ERRORS = TurntableErrors(angle_deg=0.05, wobble_deg=0.1, runout_mm=0.01)


@cache
def views(part: str, angles: tuple[float, ...], seed: int):
    """Poses T_camera_table and measured clouds of a part on the turntable with a board."""
    ball = Body(Sphere(25.0), pose(np.eye(3), np.array([3.0, 2.0, -45.0])), 0.75)
    bodies = bust_on_table() if part == "bust" else [ball]
    bodies = [*bodies, board_on_table(BOARD, T_table_board)]
    poses = turned_poses(turntable_pose(distance_mm=520.0), angles, replace(ERRORS, seed=seed))
    return poses, clouds_on_table(bodies, poses, exposure=2.0, seed=seed)


def error_in_sigmas(found, truth, covariance):
    """Mean square of the pose error over its covariance, about the middle of the part."""
    middle = pose(np.eye(3), -(truth @ np.array([0.0, 0.0, 520.0, 1.0]))[:3])
    off = twist(middle @ found @ inverse(truth) @ inverse(middle))
    return float(off @ np.linalg.solve(carried(middle, covariance), off)) / 6.0


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
def test_a_boards_pose_is_off_by_what_its_covariance_says(seed):
    poses, clouds = views("ball", (0.0, 45.0, 90.0, 135.0), seed)
    squares = []
    for T, cloud in zip(poses, clouds, strict=True):
        found = fw.views.board_pose(cloud, BOARD).pose
        squares.append(
            error_in_sigmas(found.T_part_camera, inverse(T @ T_table_board), found.covariance)
        )
    assert 0.1 < np.mean(squares) < 3.0


def test_the_axis_of_a_turntable_is_found_within_its_sigma():
    angles = (0.0, 45.0, 90.0, 135.0)
    _, clouds = views("ball", angles, 0)
    found = fw.views.turntable_axis(
        [inverse(fw.views.board_pose(c, BOARD).pose.T_part_camera) for c in clouds], angles
    )
    true = turntable_pose(distance_mm=520.0)
    assert found.direction @ true[:3, 2] > 0
    off = np.degrees(np.linalg.norm(np.cross(found.direction, true[:3, 2])))
    assert off < 0.02
    assert np.linalg.norm(np.cross(found.point_mm - true[:3, 3], true[:3, 2])) < 0.03
    with pytest.raises(fw.InputError, match="expected 3 or more, got 1"):
        fw.views.turntable_axis([true])
    with pytest.raises(fw.InputError, match="rotations of 5°"):
        fw.views.turntable_axis([true, true, true])


def bust_pair():
    poses, clouds = views("bust", (0.0, 30.0), 0)
    points = []
    for T, cloud in zip(poses, clouds, strict=True):
        seen = surface_points(cloud)
        height = -((seen.xyz_mm - T[:3, 3]) @ T[:3, 2])
        points.append(seen.at(height > 1.0))
    return points, poses[0] @ inverse(poses[1])


def test_registration_finds_the_pose_within_its_sigma():
    (target, source), truth = bust_pair()
    to_middle = pose(np.eye(3), np.array([0.0, 0.0, -520.0]))
    for seed in range(3):
        rng = np.random.default_rng(seed)
        off = from_twist(np.concatenate((rng.normal(0, 0.03, 3), rng.normal(0, 1.0, 3))))
        found = register(source, target, inverse(to_middle) @ off @ to_middle @ truth)
        assert found.slides == 0
        assert error_in_sigmas(found.T_target_source, truth, found.noise + found.common) < 9.0
        e = twist(to_middle @ found.T_target_source @ inverse(truth) @ inverse(to_middle))
        assert np.linalg.norm(e[3:]) < 0.03


def test_a_sphere_slides_on_itself_in_three_directions():
    poses, clouds = views("ball", (0.0, 45.0, 90.0, 135.0), 0)
    points = []
    for T, cloud in zip(poses, clouds, strict=True):
        seen = surface_points(cloud)
        points.append(seen.at(-((seen.xyz_mm - T[:3, 3]) @ T[:3, 2]) > 1.0))
    found = register(points[1], points[0], poses[0] @ inverse(poses[1]))
    assert found.slides == 3


def test_a_merged_ball_has_its_diameter_within_sigma():
    _, clouds = views("ball", (0.0, 45.0, 90.0, 135.0), 0)
    part = fw.merge(clouds, board=BOARD, rig=rig())
    assert 0.4 < part.blur_px < 0.6
    common = np.sqrt(np.median(part.points.sigma_mm**2 - part.points.noise_mm**2))
    form = fw.surface.fit_form(
        part.points.xyz_mm, "sphere", sigma_mm=part.points.sigma_mm, common_mm=float(common)
    )
    assert abs(2.0 * form.parameters["radius_mm"] - 50.0) < 3.0 * 2.0 * form.sigma_mm
    assert abs(2.0 * form.parameters["radius_mm"] - 50.0) < 0.05
    assert any("slides" in finding.text for finding in part.findings)
    assert (part.points.noise_mm <= part.points.sigma_mm).all()


def test_the_command_merges_files(tmp_path):
    from fringeworks.cli.commands import run

    _, clouds = views("bust", (0.0, 30.0), 0)
    paths = [tmp_path / f"{k}.npz" for k in range(2)]
    for path, cloud in zip(paths, clouds, strict=True):
        fw.files.write_points(path, cloud)
    out = tmp_path / "part.ply"
    assert run(["merge", *map(str, paths), "--board", BOARD.name, "--out", str(out)]) == 0
    merged = fw.merge(paths, board=BOARD)
    read = fw.files.read_points(out)
    assert np.allclose(read.xyz_mm, merged.points.xyz_mm, atol=1e-4)
    assert np.allclose(read.sigma_mm, merged.points.sigma_mm, rtol=1e-5)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "expected the board"),
        ({"poses": "turntable"}, "the angle between two views"),
        ({"poses": "shape", "board": BOARD}, "cannot be combined"),
        ({"poses": "guess"}, "expected board, turntable or shape"),
        ({"board": BOARD, "blur_px": 0.5}, "expected the rig of the views"),
    ],
)
def test_options_that_do_not_belong_together(options, message):
    # Options are looked at before the points.
    with pytest.raises(fw.InputError, match=message):
        fw.merge([plane_cloud()] * 2, **options)


def test_the_command_writes_a_closed_mesh(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("skimage")
    from fringeworks.cli.commands import run

    _, clouds = views("ball", (0.0, 45.0, 90.0, 135.0), 0)
    paths = [str(tmp_path / f"{k}.npz") for k in range(2)]
    for path, cloud in zip(paths, clouds, strict=False):
        fw.files.write_points(path, cloud)
    fw.files.write_rig(tmp_path / "rig.toml", rig())
    out = tmp_path / "part.stl"
    options = ["--board", BOARD.name, "--rig", str(tmp_path / "rig.toml"), "--out", str(out)]
    assert run(["merge", *paths, *options]) == 0
    made = trimesh.load(out)
    assert made.is_watertight
    # It stands on the plate: the board's z axis points into the board.
    low, high = made.bounds
    assert low[2] == pytest.approx(0.0, abs=1e-4)
    assert low[:2] == pytest.approx(-high[:2], abs=1e-4)
    assert run(["merge", *paths, *options, "--origin", "part", "--up=-z"]) == 0
    as_board = trimesh.load(out)
    assert as_board.bounds[0, 2] > 0.5
    assert np.ptp(as_board.bounds[:, 2]) == pytest.approx(high[2], abs=1e-3)
