"""Distances from triangle meshes: exact, with the right sign, and models from files."""

from __future__ import annotations

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.surface.closest import MeshDistance, numbered
from tests.oracles.closest import nearest as all_nearest

trimesh = pytest.importorskip("trimesh")


def mesh_of(made) -> fw.TriangleMesh:
    return fw.TriangleMesh(made.vertices, made.faces.astype(np.uint32))


BODIES = {
    "ball": lambda: trimesh.creation.icosphere(2, 20.0),
    "box": lambda: trimesh.creation.box((40.0, 30.0, 20.0)),
    "tube": lambda: trimesh.creation.annulus(5.0, 15.0, 20.0, sections=40),
}
"""Closed bodies: round, with sharp edges, and with a hole and long triangles."""


def inside(name, p):
    """Which points lie in the body of triangles, exactly."""
    if name == "box":
        return (np.abs(p) < (20.0, 15.0, 10.0)).all(axis=1)
    if name == "ball":
        corners = MeshDistance(mesh_of(BODIES[name]())).corners
        n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return ((p[:, None] - corners[:, 0]) * n).sum(-1).max(axis=1) < 0
    # A ring of 40 flat sides: the apothem instead of the radius.
    turn = np.arctan2(p[:, 1], p[:, 0]) % (2 * np.pi / 40) - np.pi / 40
    across = np.hypot(p[:, 0], p[:, 1]) * np.cos(turn) / np.cos(np.pi / 40)
    return (across > 5.0) & (across < 15.0) & (np.abs(p[:, 2]) < 10.0)


@pytest.mark.parametrize("name", BODIES)
def test_distances_are_those_of_a_search_through_all_triangles(name):
    mesh = mesh_of(BODIES[name]())
    points = np.random.default_rng(0).uniform(-25, 25, (800, 3))
    found = MeshDistance(mesh).nearest(points, 60.0)
    expected = all_nearest(points, np.asarray(mesh.vertices_mm)[mesh.faces.astype(int)])
    np.testing.assert_allclose(np.abs(found.distance_mm), expected, atol=1e-9)
    np.testing.assert_array_equal(found.distance_mm < 0, inside(name, points))
    way = points - found.point_mm
    np.testing.assert_allclose(np.linalg.norm(way, axis=1), expected, atol=1e-9)
    np.testing.assert_allclose(way, found.distance_mm[:, None] * found.direction, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(found.direction, axis=1), 1.0, atol=1e-9)


def test_points_beyond_the_reach_have_no_distance():
    found = MeshDistance(mesh_of(BODIES["box"]())).nearest(
        np.array([[0.0, 0, 10.9], [0, 0, 11.1], [0, 0, 500]]), 1.0
    )
    assert found.distance_mm[0] == pytest.approx(0.9)
    assert np.isnan(found.distance_mm[1:]).all()
    assert found.face[1:].tolist() == [-1, -1]
    with pytest.raises(fw.InputError, match="triangles with an area"):
        MeshDistance(fw.TriangleMesh(np.zeros((3, 3)), np.array([[0, 1, 2]])))


def test_points_beside_sharp_edges_are_told():
    distance = MeshDistance(mesh_of(BODIES["box"]()))
    # The diagonals of the sides are no sharp edges.
    top = np.array([[0.0, 0, 10], [19.5, 0, 10], [18.5, 0, 10], [0, 14.6, 10], [5, 5, 10]])
    assert distance.beside_edges(top, 1.0).tolist() == [False, True, False, True, False]
    ball = MeshDistance(mesh_of(trimesh.creation.icosphere(4, 20.0)))
    assert not ball.beside_edges(ball.corners[:, 0], 1.0).any()


def test_normals_of_round_surfaces_are_interpolated():
    ball = MeshDistance(mesh_of(trimesh.creation.icosphere(3, 20.0)))
    points = np.random.default_rng(1).normal(size=(500, 3))
    points *= 20.0 / np.linalg.norm(points, axis=1, keepdims=True)
    found = ball.nearest(points, 2.0)
    radial = points / 20.0
    rough = np.sum(ball.normals[found.face] * radial, axis=1)
    smooth = np.sum(ball.smooth_normals(found) * radial, axis=1)
    assert np.degrees(np.arccos(np.clip(smooth, -1, 1))).max() < 1.0
    assert np.degrees(np.arccos(rough)).max() > 3.0
    box = MeshDistance(mesh_of(BODIES["box"]()))
    near = box.nearest(np.array([[19.0, 3.0, 10.5]]), 2.0)
    np.testing.assert_allclose(box.smooth_normals(near), [[0, 0, 1]], atol=1e-12)


@pytest.mark.parametrize(
    ("suffix", "kind"), [(".stl", "stl"), (".stl", "stl_ascii"), (".ply", "ply"), (".off", "off")]
)
def test_models_come_from_files(tmp_path, suffix, kind):
    path = tmp_path / f"box{suffix}"
    content = trimesh.creation.box((40.0, 30.0, 20.0)).export(file_type=kind)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    model = fw.files.read_model(path)
    assert (len(model.vertices_mm), len(model.faces)) == (8, 12)
    assert model.notes == ()
    assert MeshDistance(model).nearest(np.zeros((1, 3)), 50.0).distance_mm[0] == -10.0
    inches = fw.files.read_model(path, scale=25.4)
    np.testing.assert_allclose(np.ptp(inches.vertices_mm, axis=0), 25.4 * np.array([40, 30, 20]))


def test_models_say_what_is_wrong_with_them(tmp_path):
    box = trimesh.creation.box((40.0, 30.0, 20.0))
    vertices, faces = box.vertices, box.faces
    (tmp_path / "b.stl").write_bytes(
        trimesh.Trimesh(vertices, faces[:, ::-1]).export(file_type="stl")
    )
    turned = fw.files.read_model(tmp_path / "b.stl")
    assert "inwards" in turned.notes[0]
    assert MeshDistance(turned).nearest(np.zeros((1, 3)), 50.0).distance_mm[0] < 0
    (tmp_path / "o.stl").write_bytes(trimesh.Trimesh(vertices, faces[2:]).export(file_type="stl"))
    assert "not closed" in fw.files.read_model(tmp_path / "o.stl").notes[0]
    mixed = faces.copy()
    mixed[3] = mixed[3, ::-1]
    made = trimesh.Trimesh(vertices, mixed, process=False)
    (tmp_path / "m.ply").write_bytes(made.export(file_type="ply"))
    assert "opposite sides" in fw.files.read_model(tmp_path / "m.ply").notes[0]


@pytest.mark.parametrize(
    "content", [b"", b"solid x\nfacet normal", b"\0" * 84 + b"\0" * 7, b"ply\nformat ascii 1.0\n"]
)
def test_damaged_models_are_refused(tmp_path, content):
    for suffix in (".stl", ".ply"):
        path = tmp_path / f"bad{suffix}"
        path.write_bytes(content)
        with pytest.raises(fw.FileProblem, match="bad"):
            fw.files.read_model(path)


def test_models_that_cannot_be_read(tmp_path):
    with pytest.raises(fw.FileProblem, match="no such file"):
        fw.files.read_model(tmp_path / "none.stl")
    (tmp_path / "a.dxf").write_text("x")
    with pytest.raises(fw.FileProblem, match=r"\.stl"):
        fw.files.read_model(tmp_path / "a.dxf")
    path = tmp_path / "big.stl"
    path.write_bytes(trimesh.creation.icosphere(4).export(file_type="stl"))
    with fw.files.file_limits(max_gb=1e-5), pytest.raises(fw.FileProblem, match="GB"):
        fw.files.read_model(path)
    with pytest.raises(fw.InputError, match="scale"):
        fw.files.read_model(path, scale=0.0)


def test_places_are_numbered_as_numpy_does():
    places = np.random.default_rng(2).integers(-2, 3, (500, 3)).astype(float) / 3.0
    places[::7, 0] = -0.0
    found, number = numbered(places)
    expected, inverse = np.unique(places, axis=0, return_inverse=True)
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(number, inverse.ravel())


@pytest.mark.parametrize("name", BODIES)
def test_normals_of_edges_and_vertices_are_sums_over_their_triangles(name):
    mesh = MeshDistance(mesh_of(BODIES[name]()))
    corners, normals = mesh.corners, mesh.normals
    for face in range(0, len(corners), 7):
        for k in range(3):
            here = np.all(corners == corners[face, k], axis=2)
            total = np.zeros(3)
            for other, corner in zip(*np.nonzero(here), strict=True):
                one, two = (corners[other, (corner + j) % 3] - corners[face, k] for j in (1, 2))
                cosine = one @ two / np.linalg.norm(one) / np.linalg.norm(two)
                total += np.arccos(cosine) * normals[other]
            np.testing.assert_allclose(mesh._vertex_normals[face, k], total, atol=1e-9)
            ends = corners[face, (k + 1) % 3], corners[face, (k + 2) % 3]
            has = [np.all(corners == end, axis=2).any(axis=1) for end in ends]
            expected = normals[has[0] & has[1]].sum(axis=0)
            np.testing.assert_allclose(mesh._edge_normals[face, k], expected, atol=1e-12)
