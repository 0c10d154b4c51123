"""Points in other coordinates: σ holds the error of the transform, and files keep the frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.rig.pinhole import pose, rotation, transform
from fringeworks.types.placement import pose_sigma_mm
from tests.surfaces import H, W, cloud_of


def sphere_depth():
    """Depths of a ball that fills a part of the frame, mm."""
    y, x = np.mgrid[:H, :W]
    r2 = (x - 0.5 * W) ** 2 + (y - 0.5 * H) ** 2
    return np.where(r2 < 25**2, 520.0 - np.sqrt(np.maximum(26.0**2 - r2, 0.0)), np.nan)


PLACE = pose(rotation(np.array([0.4, -1.1, 0.3])), np.array([700.0, -200.0, 900.0]))
RNG = np.random.default_rng(61)
ROOT = RNG.normal(size=(6, 6)) * np.array([1e-4] * 3 + [0.05] * 3)[:, None]
COVARIANCE = ROOT @ ROOT.T


def test_points_move_and_come_back():
    cloud = cloud_of(sphere_depth())
    moved = cloud.transformed(PLACE, frame="base")
    ok = cloud.reason == 0
    np.testing.assert_allclose(
        moved.xyz_mm[ok], transform(PLACE, cloud.xyz_mm[ok].astype(float)), atol=1e-4
    )
    assert (moved.frame, cloud.frame) == ("base", "camera")
    np.testing.assert_array_equal(moved.sigma_mm, cloud.sigma_mm)
    np.testing.assert_allclose(moved.in_camera().xyz_mm[ok], cloud.xyz_mm[ok], atol=2e-4)
    assert moved.in_camera().frame == "camera"
    assert cloud.in_camera() is cloud
    twice = moved.transformed(np.linalg.inv(PLACE), frame="again")
    np.testing.assert_allclose(twice.xyz_mm[ok], cloud.xyz_mm[ok], atol=2e-4)
    np.testing.assert_allclose(twice.placement.T_frame_camera, np.eye(4), atol=1e-9)


def test_sigma_is_that_of_the_worst_direction():
    points = RNG.normal(size=(20, 3)) * 200.0
    sigma = pose_sigma_mm(COVARIANCE, points)
    for p, s in zip(points, sigma, strict=True):
        by = np.hstack((-np.cross(np.eye(3), p).T, np.eye(3)))
        by[:, :3] = -np.array([[0, -p[2], p[1]], [p[2], 0, -p[0]], [-p[1], p[0], 0]])
        assert s == pytest.approx(np.sqrt(np.linalg.eigvalsh(by @ COVARIANCE @ by.T)[-1]), rel=1e-6)


def test_the_covariance_of_two_transforms_is_that_of_their_product():
    first = pose(rotation(np.array([-0.2, 0.5, 0.9])), np.array([30.0, -80.0, 400.0]))
    other = 0.5 * COVARIANCE + np.diag([1e-8] * 3 + [1e-4] * 3)
    cloud = cloud_of(sphere_depth())
    placed = cloud.transformed(first, frame="flange", covariance=other)
    placed = placed.transformed(PLACE, frame="base", covariance=COVARIANCE)
    drawn = []
    for a, b in zip(
        RNG.multivariate_normal(np.zeros(6), other, 4000),
        RNG.multivariate_normal(np.zeros(6), COVARIANCE, 4000),
        strict=True,
    ):
        T = pose(rotation(b[:3]) @ PLACE[:3, :3], PLACE[:3, 3] + b[3:])
        T = T @ pose(rotation(a[:3]) @ first[:3, :3], first[:3, 3] + a[3:])
        turn = T[:3, :3] @ (PLACE @ first)[:3, :3].T
        omega = 0.5 * np.array(
            [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
        )
        drawn.append(np.concatenate((omega, T[:3, 3] - (PLACE @ first)[:3, 3])))
    found, expected = placed.placement.covariance, np.cov(np.array(drawn).T)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        found / np.outer(scale, scale), expected / np.outer(scale, scale), atol=0.1
    )
    assert np.nanmedian(placed.sigma_mm) > 2 * np.nanmedian(cloud.sigma_mm)
    np.testing.assert_array_equal(placed.noise_mm, cloud.noise_mm)


def test_surfaces_of_points_in_other_coordinates_are_the_same():
    cloud = cloud_of(sphere_depth())
    moved = cloud.transformed(PLACE, frame="base")
    turned = fw.surface.normals(moved) @ PLACE[:3, :3].astype(np.float32)
    np.testing.assert_allclose(turned, fw.surface.normals(cloud), atol=2e-3)
    one, two = (fw.surface.cloud_mesh(c, fill_px=20) for c in (cloud, moved))
    np.testing.assert_array_equal(one.faces, two.faces)
    np.testing.assert_allclose(
        two.vertices_mm, transform(PLACE, one.vertices_mm.astype(float)), atol=1e-3
    )
    ok = (cloud.reason == 0)[..., None]
    heights = []
    for c, T in ((cloud, np.eye(4)), (moved, PLACE)):
        plane = transform(T, np.array([0.0, 0.0, 520.0])), T[:3, 2]
        heights.append(fw.surface.height_over_plane(c, *plane, pitch_mm=2.0, right=T[:3, 0]).values)
    assert ok.any()
    assert abs(heights[0].size - heights[1].size) < 0.1 * heights[0].size
    assert np.nanmax(heights[0]) == pytest.approx(np.nanmax(heights[1]), abs=1e-2)


def test_what_needs_camera_coordinates_says_so():
    moved = cloud_of(sphere_depth()).transformed(PLACE, frame="base")
    with pytest.raises(fw.InputError, match="camera coordinates for merging, got those of base"):
        fw.merge([moved, moved], poses="overlap")
    rig = fw.simulate.standard_rig(scale=0.25)
    with pytest.raises(fw.InputError, match="camera coordinates"):
        fw.rig.in_base(moved, replace(rig, robot=fw.rig.RobotFrame("base", PLACE)))
    for frame in ("", "camera", "two words", "x" * 65):
        with pytest.raises(fw.InputError, match="frame: expected a name"):
            moved.transformed(PLACE, frame=frame)
    with pytest.raises(fw.InputError, match="T: expected a rotation"):
        moved.transformed(2.0 * np.eye(4), frame="base")
    with pytest.raises(fw.InputError, match=r"covariance: expected a finite \(6, 6\)"):
        moved.transformed(np.eye(4), frame="base", covariance=np.eye(3))


@pytest.mark.parametrize("suffix", [".npz", ".pcd", ".csv", ".e57"])
def test_files_of_frames_keep_the_coordinates(tmp_path, suffix):
    if suffix == ".e57":
        pytest.importorskip("pye57")
    moved = cloud_of(sphere_depth()).transformed(PLACE, frame="base", covariance=COVARIANCE)
    fw.files.write_points(tmp_path / f"a{suffix}", moved, kind="frame")
    found = fw.files.read_cloud(tmp_path / f"a{suffix}")
    assert found.frame == "base"
    np.testing.assert_allclose(found.placement.T_frame_camera, PLACE, atol=1e-12)
    np.testing.assert_allclose(found.placement.covariance, COVARIANCE, rtol=1e-9)


def test_headers_name_the_coordinates(tmp_path):
    moved = cloud_of(sphere_depth()).transformed(PLACE, frame="base")
    fw.files.write_points(tmp_path / "a.ply", moved)
    assert b"coordinates of base" in (tmp_path / "a.ply").read_bytes()
    fw.files.write_points(tmp_path / "a.pcd", moved)
    head = (tmp_path / "a.pcd").read_bytes()[:4000].decode("ascii", "replace")
    view = next(line for line in head.splitlines() if line.startswith("VIEWPOINT"))
    np.testing.assert_allclose([float(v) for v in view.split()[1:4]], PLACE[:3, 3])
    assert f"WIDTH {W}" in head
    assert f"HEIGHT {H}" in head


def robot(mount, noise=None):
    return fw.rig.RobotFrame(mount, PLACE, COVARIANCE, noise, "zyx:deg:mm")


@pytest.mark.parametrize("mount", ["hand", "base"])
def test_rig_files_keep_the_robot(tmp_path, mount):
    rig = replace(fw.simulate.standard_rig(), robot=robot(mount, fw.rig.RobotNoise(0.05, 0.01)))
    fw.files.write_rig(tmp_path / "rig.toml", rig)
    found = fw.files.read_rig(tmp_path / "rig.toml").robot
    assert (found.mount, found.poses_as, found.noise) == (mount, "zyx:deg:mm", rig.robot.noise)
    np.testing.assert_allclose(found.T_mount_camera, PLACE, atol=1e-12)
    np.testing.assert_allclose(found.covariance, COVARIANCE, rtol=1e-6, atol=1e-18)
    with pytest.raises(fw.InputError, match="OpenCV cannot hold"):
        fw.files.write_rig(tmp_path / "rig.xml", rig)
    assert fw.rig.for_frames(rig, binning=2).robot == rig.robot
    text = (tmp_path / "rig.toml").read_text().replace('mount = "hand"', 'mount = "base"')
    if mount == "hand":
        (tmp_path / "rig.toml").write_text(text)
        with pytest.raises(fw.FileProblem, match="expected T_base_camera alone"):
            fw.files.read_rig(tmp_path / "rig.toml")


def test_points_in_the_base_of_a_camera_beside_the_robot():
    rig = replace(fw.simulate.standard_rig(), robot=robot("base"))
    cloud = cloud_of(sphere_depth())
    found = fw.rig.in_base(cloud, rig)
    assert found.frame == "base"
    np.testing.assert_array_equal(found.placement.T_frame_camera, PLACE)
    assert np.nanmin(found.sigma_mm - cloud.sigma_mm) > 0
    with pytest.raises(fw.InputError, match="expected none, because the camera stands beside"):
        fw.rig.in_base(cloud, rig, np.eye(4))
    with pytest.raises(fw.InputError, match="where the camera is on the robot, got none"):
        fw.rig.in_base(cloud, replace(rig, robot=None))


def test_points_in_the_base_of_a_camera_in_the_hand():
    rig = replace(fw.simulate.standard_rig(), robot=robot("hand", fw.rig.RobotNoise(0.05, 0.02)))
    cloud = cloud_of(sphere_depth())
    flange = pose(rotation(np.array([0.1, 0.2, -0.7])), np.array([400.0, 300.0, 500.0]))
    found = fw.rig.in_base(cloud, rig, flange)
    np.testing.assert_allclose(found.placement.T_frame_camera, flange @ PLACE)
    drawn = []
    for e, n in zip(
        RNG.multivariate_normal(np.zeros(6), COVARIANCE, 3000),
        RNG.normal(size=(3000, 6)),
        strict=True,
    ):
        n = n * np.sqrt(rig.robot.noise.variances)
        X = pose(rotation(e[:3]) @ PLACE[:3, :3], PLACE[:3, 3] + e[3:])
        B = pose(rotation(n[:3]) @ flange[:3, :3], flange[:3, 3] + n[3:])
        drawn.append((B @ X)[:3, 3])
    expected = np.cov(np.array(drawn).T)
    np.testing.assert_allclose(
        found.placement.covariance[3:, 3:], expected, atol=0.08 * np.trace(expected)
    )
    with pytest.raises(fw.InputError, match="expected the pose of the flange"):
        fw.rig.in_base(cloud, rig)
    numbers = fw.rig.robot_poses([[400, 300, 500, 10, 20, 30]])
    as_kuka = fw.rig.robot_poses([[400, 300, 500, 10, 20, 30]], "kuka").readings[0]
    placed = fw.rig.in_base(cloud, rig, numbers)
    expected = as_kuka.transforms(numbers.values)[0] @ PLACE
    np.testing.assert_allclose(placed.placement.T_frame_camera, expected)
    with pytest.raises(fw.InputError, match="as at the hand-eye calibration"):
        fw.rig.in_base(cloud, rig, fw.rig.robot_poses([[400, 300, 500, 10, 20, 30]], "fanuc"))
    with pytest.raises(fw.InputError, match="several|read as|poses_as"):
        open_rig = replace(rig, robot=replace(rig.robot, poses_as=""))
        fw.rig.in_base(cloud, open_rig, numbers)
    quiet = fw.rig.in_base(cloud, replace(rig, robot=fw.rig.RobotFrame("hand", PLACE)), flange)
    assert [f.kind for f in quiet.findings] == ["uncertainty"]
    np.testing.assert_array_equal(quiet.sigma_mm, cloud.sigma_mm)
