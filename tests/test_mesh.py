"""Meshes of clouds: holes, fewer triangles, files that other programs read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.files.ply import read_ply
from fringeworks.surface.cloud import cloud_triangles
from tests.commands import run
from tests.oracles import cloud_mesh as oracle
from tests.surfaces import H, W, cloud_of

trimesh = pytest.importorskip("trimesh")


def sphere_depth(radius_mm=60.0, centre_mm=560.0):
    """Depths of a sphere on the axis, as the camera of ``cloud_of`` sees them."""
    y, x = np.mgrid[:H, :W]
    square = ((x - W / 2) ** 2 + (y - H / 2) ** 2) / 500**2 + 1
    root = centre_mm**2 - square * (centre_mm**2 - radius_mm**2)
    return np.where(root > 0, (centre_mm - np.sqrt(np.maximum(root, 0))) / square, np.nan)


def test_a_hole_in_a_plane_is_filled_by_the_plane_and_marked():
    y, x = np.mgrid[:H, :W]
    u, v = (x - W / 2) / 500, (y - H / 2) / 500
    depth = 500.0 / (1 + 0.8 * u - 0.3 * v)
    depth[20:27, 30:41] = np.nan
    found = fw.surface.cloud_mesh(cloud_of(depth), fill_px=77)
    assert np.count_nonzero(found.filled) == 77
    points = found.vertices_mm[found.filled]
    # The plane is z + 0.8 x − 0.3 y = 500.
    off = points @ [0.8, -0.3, 1.0] - 500.0
    assert np.abs(off).max() < 1e-3
    assert np.isnan(found.sigma_mm[found.filled]).all()
    assert np.isfinite(found.sigma_mm[~found.filled]).all()
    assert fw.surface.cloud_mesh(cloud_of(depth), fill_px=76).filled is None


def test_holes_in_a_sphere_are_filled_close_to_it():
    depth = sphere_depth()
    depth[25:31, 35:41] = np.nan
    found = fw.surface.cloud_mesh(cloud_of(depth), fill_px=40)
    points = found.vertices_mm[found.filled]
    assert len(points) == 36
    # The membrane over a square of side a = 7 mm lies 0.0737 a² · 2/R below the middle of a sphere
    # of R = 60 mm (Poisson's equation on a square): 0.12 mm.
    off = np.linalg.norm(points - [0, 0, 560.0], axis=1) - 60.0
    assert 0.09 < -off.min() < 0.13
    assert off.max() < 0.0


def test_a_hole_beside_a_step_in_depth_stays_open():
    depth = np.full((H, W), 500.0)
    depth[:, 40:] = 560.0
    depth[20:24, 38:42] = np.nan
    found = fw.surface.cloud_mesh(cloud_of(depth), fill_px=100)
    assert found.filled is None
    z = found.vertices_mm[found.faces][..., 2]
    assert np.ptp(z, axis=1).max() < 1.0


def test_holes_at_the_frames_border_stay_open():
    depth = np.full((H, W), 500.0)
    depth[:5, :5] = np.nan
    assert fw.surface.cloud_mesh(cloud_of(depth), fill_px=100).filled is None


def test_triangles_face_the_camera():
    found = fw.surface.cloud_mesh(cloud_of(sphere_depth()))
    p, q, r = found.vertices_mm[found.faces].transpose(1, 0, 2)
    assert (np.sum(np.cross(q - p, r - p) * p, axis=1) < 0).all()


@pytest.mark.parametrize("shape", [(H, W), (2, 2), (33, 7), (34, 7)])
def test_triangles_are_those_of_a_search_by_corners(shape):
    rng = np.random.default_rng(4)
    depth = np.nan_to_num(sphere_depth(), nan=520.0) + rng.normal(0.0, 0.05, (H, W))
    depth[rng.random((H, W)) < 0.1] += 3.0
    depth[5:][rng.random((H - 5, W)) < 0.05] = np.nan
    whole = cloud_of(depth)
    cut = slice(0, shape[0]), slice(0, shape[1])
    parts = (whole.xyz_mm, whole.sigma_mm, whole.noise_mm, whole.reason)
    cloud = fw.PointCloud(*(part[cut] for part in parts))
    expected = oracle.triangles(cloud)
    assert len(expected)
    np.testing.assert_array_equal(cloud_triangles(cloud), expected)
    used, faces = np.unique(expected, return_inverse=True)
    mesh = fw.surface.cloud_mesh(cloud)
    np.testing.assert_array_equal(mesh.faces, faces.reshape(-1, 3))
    np.testing.assert_array_equal(mesh.vertices_mm, cloud.xyz_mm.reshape(-1, 3)[used])


def test_fewer_triangles_keep_the_surface_within_their_sigma():
    pytest.importorskip("fast_simplification")
    full = fw.surface.cloud_mesh(cloud_of(sphere_depth()))
    few = fw.surface.decimate(full, 500)
    assert 400 < len(few.faces) <= 500
    off = np.abs(np.linalg.norm(few.vertices_mm - [0, 0, 560.0], axis=1) - 60.0)
    assert np.mean(off <= 2 * few.sigma_mm) > 0.9
    assert fw.surface.decimate(full, len(full.faces)) is full
    with pytest.raises(fw.InputError, match="faces: expected 4 or more, got 3"):
        fw.surface.decimate(full, 3)


@pytest.mark.parametrize("suffix", ["stl", "obj", "glb", "ply"])
def test_meshes_come_back_from_files(tmp_path, suffix):
    mesh = fw.surface.cloud_mesh(cloud_of(sphere_depth()))
    brightness = np.linspace(10.0, 200.0, len(mesh.vertices_mm))
    mesh = replace(mesh, colour=np.column_stack((brightness, brightness / 2, brightness / 4)))
    path = tmp_path / f"part.{suffix}"
    fw.files.write_mesh(path, mesh)
    loaded = trimesh.load(path, force="mesh", process=False)
    wanted = mesh.vertices_mm[mesh.faces]
    if suffix == "glb":
        wanted = wanted * (0.001, -0.001, -0.001)
    np.testing.assert_allclose(loaded.vertices[loaded.faces], wanted, rtol=1e-5, atol=1e-6)
    if suffix != "stl":
        colour = loaded.visual.vertex_colors[:, :3].astype(float)
        # The brightest half percent of all values is white, and cut there.
        below = colour[:, 0] < 255
        assert np.mean(below) > 0.97
        assert np.abs(colour[:, 0] - 2 * colour[:, 1])[below].max() <= 2
        assert np.ptp(colour[:, 0]) > 200


def test_a_ply_keeps_sigma_and_what_was_filled(tmp_path):
    depth = sphere_depth()
    depth[25:31, 35:41] = np.nan
    mesh = fw.surface.cloud_mesh(cloud_of(depth), fill_px=40)
    fw.files.write_mesh(tmp_path / "part.ply", mesh)
    table, comments = read_ply(tmp_path / "part.ply")
    assert (table["filled"].astype(bool) == mesh.filled).all()
    np.testing.assert_allclose(table["sigma"], mesh.sigma_mm)
    assert "fringeworks; mesh; unit mm" in comments


def test_what_is_no_mesh_is_refused(tmp_path):
    with pytest.raises(fw.InputError, match="expected neighbouring points, got none"):
        fw.surface.cloud_mesh(cloud_of(np.full((H, W), np.nan)))
    with pytest.raises(fw.InputError, match="fill_px: expected 0 or more, got -1"):
        fw.surface.cloud_mesh(cloud_of(np.full((H, W), 500.0)), fill_px=-1)
    mesh = fw.surface.cloud_mesh(cloud_of(np.full((H, W), 500.0)))
    with pytest.raises(fw.FileProblem, match="expected"):
        fw.files.write_mesh(tmp_path / "part.step", mesh)
    with pytest.raises(fw.InputError, match="expected triangles to write, got none"):
        fw.files.write_mesh(tmp_path / "part.stl", replace(mesh, faces=np.empty((0, 3), np.uint32)))
    assert not list(tmp_path.iterdir())


def bright_cloud():
    """A sphere with brightness and provenance."""
    cloud = cloud_of(sphere_depth())
    y, x = np.mgrid[:H, :W]
    return replace(cloud, colour=(x + y).astype(np.float32))


def read_pcd(path):
    """Header and points of a binary PCD file, by the words of its specification."""
    content = path.read_bytes()
    start = content.index(b"DATA binary\n") + len(b"DATA binary\n")
    lines = [line.split() for line in content[:start].decode().splitlines() if line[0] != "#"]
    header = {line[0]: line[1:] for line in lines}
    letters = {"F": "f", "U": "u", "I": "i"}
    kinds = [letters[t] + s for t, s in zip(header["TYPE"], header["SIZE"], strict=True)]
    table = np.frombuffer(content, list(zip(header["FIELDS"], kinds, strict=True)), offset=start)
    rows, columns = (int(header[name][0]) for name in ("HEIGHT", "WIDTH"))
    assert header["POINTS"] == [str(len(table))] == [str(rows * columns)]
    assert (rows, columns) == (H, W)
    return table.reshape(rows, columns)


def test_a_pcd_holds_the_points_with_sigma_normals_and_brightness(tmp_path):
    cloud = bright_cloud()
    ok = cloud.reason == fw.Reason.OK
    fw.files.write_points(tmp_path / "part.pcd", cloud, kind="normals")
    table = read_pcd(tmp_path / "part.pcd")
    np.testing.assert_array_equal(np.isfinite(table["x"]), ok)
    table = table[ok]
    np.testing.assert_array_equal(np.column_stack([table[n] for n in "xyz"]), cloud.xyz_mm[ok])
    np.testing.assert_array_equal(table["sigma"], cloud.sigma_mm[ok])
    np.testing.assert_allclose(
        np.column_stack([table[n] for n in ("normal_x", "normal_y", "normal_z")]),
        np.nan_to_num(fw.surface.normals(cloud)[ok]),
    )
    grey = table["rgb"] & 0xFF
    assert ((table["rgb"] >> 16) == grey).all()
    assert (table["rgb"] >> 8 & 0xFF == grey).all()
    assert np.corrcoef(grey, cloud.colour[ok])[0, 1] > 0.999
    with pytest.raises(fw.InputError, match="expected points, got triangles"):
        fw.files.write_points(tmp_path / "mesh.pcd", cloud, kind="mesh")
    assert not (tmp_path / "mesh.pcd").exists()


def test_a_mat_holds_the_frame_as_matlab_sees_it(tmp_path):
    scipy_io = pytest.importorskip("scipy.io")
    cloud = bright_cloud()
    fw.files.write_points(tmp_path / "part.mat", cloud)
    found = scipy_io.loadmat(tmp_path / "part.mat")
    for name in ("xyz_mm", "sigma_mm", "noise_mm", "reason", "colour"):
        np.testing.assert_array_equal(found[name], getattr(cloud, name))
    assert str(found["reasons"].ravel()[9][0]) == "shadow"
    assert "residual_px" not in found


def test_the_command_cleans_crops_fills_and_reduces(tmp_path):
    pytest.importorskip("fast_simplification")
    depth = np.full((H, W), 500.0)
    depth[30:33, 40:43] = np.nan  # a hole of 9 px
    depth[5:8, 70:78] = 450.0  # a speck before the surface
    fw.files.write_points(tmp_path / "seen.npz", cloud_of(depth))
    done = run(
        "mesh",
        tmp_path / "seen.npz",
        "--fill",
        9,
        "--box",
        "-20:::::",
        "--faces",
        100,
        "--out",
        tmp_path / "part.stl",
    )
    assert "24 removed by cleaning" in done.stdout
    assert "9 of them in filled holes" not in done.stdout  # decimated away on a plane
    part = trimesh.load(tmp_path / "part.stl")
    assert 0 < len(part.faces) <= 100
    np.testing.assert_allclose(part.vertices[:, 2], 500.0, atol=1e-3)
    assert part.vertices[:, 0].min() >= -20
    full = run("mesh", tmp_path / "seen.npz", "--fill", 9, "--out", tmp_path / "part.ply")
    assert "9 of them in filled holes" in full.stdout
    wrong = run("mesh", tmp_path / "seen.npz", "--box", "1:2", "--out", tmp_path / "x.stl", code=2)
    assert "--box: expected six limits in mm" in wrong.stderr
