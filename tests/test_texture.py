"""Meshes with pictures on them: what other programs see, and that no file is lost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import fringeworks as fw
from fringeworks.files.texture import as_srgb, texture_of
from fringeworks.rig.pinhole import project
from tests import rigs
from tests.painted_ball import cloud, linear, paint


@pytest.fixture(scope="module")
def ball():
    return cloud()


def sampled(picture, uv):
    """Colours of a picture at places 0…1 from the lower left corner."""
    height, width = picture.shape[:2]
    column = np.clip(np.rint(uv[:, 0] * width - 0.5), 0, width - 1).astype(int)
    row = np.clip(np.rint((1 - uv[:, 1]) * height - 0.5), 0, height - 1).astype(int)
    return picture[row, column]


def agree(found, expected, within):
    """Linear colours agree up to their common scale; clipped highlights do not count."""
    inside = (found > 0.02).all(axis=1) & (found < 0.995).all(axis=1)
    assert inside.mean() > 0.75
    found, expected = found[inside], expected[inside]
    scale = np.sum(found * expected) / np.sum(expected**2)
    assert np.sqrt(np.mean((found / scale / expected - 1) ** 2)) < within


@pytest.mark.parametrize("faces", [None, 3000])
def test_a_glb_has_the_paint_as_a_picture(ball, tmp_path, faces):
    """The colour within 2 % of the light of the scene, also on few triangles."""
    trimesh = pytest.importorskip("trimesh")
    mesh = fw.surface.cloud_mesh(ball)
    if faces is not None:
        pytest.importorskip("fast_simplification")
        mesh = fw.surface.decimate(mesh, faces)
        assert len(mesh.faces) <= faces
    fw.write(tmp_path / "a.glb", mesh)
    seen = trimesh.load(tmp_path / "a.glb", force="mesh")
    picture = np.asarray(seen.visual.material.baseColorTexture.convert("RGB"))
    found = linear(sampled(picture, np.asarray(seen.visual.uv)))
    camera = rigs.rig().camera
    at = project(camera, np.asarray(seen.vertices) * (1e3, -1e3, -1e3))
    column, row = np.rint(at).astype(int).T
    agree(found, paint(ball.shape)[row, column], 0.02 if faces is None else 0.05)
    assert fw.read(tmp_path / "a.glb").faces.shape == mesh.faces.shape


def test_an_obj_has_its_picture_beside_it(ball, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    mesh = fw.surface.cloud_mesh(ball)
    fw.write(tmp_path / "part.obj", mesh)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"part.obj", "part.texture.png", "part.texture.mtl"}
    assert "map_Kd part.texture.png" in (tmp_path / "part.texture.mtl").read_text()
    seen = trimesh.load(tmp_path / "part.obj", force="mesh", process=False)
    np.testing.assert_allclose(
        np.asarray(seen.vertices)[seen.faces], mesh.vertices_mm[mesh.faces], atol=1e-4
    )
    picture = np.asarray(Image.open(tmp_path / "part.texture.png"))
    found = linear(sampled(picture, np.asarray(seen.visual.uv)))
    column, row = np.rint(project(rigs.rig().camera, np.asarray(seen.vertices))).astype(int).T
    agree(found, paint(ball.shape)[row, column], 0.02)
    assert len(fw.read(tmp_path / "part.obj").faces) == len(mesh.faces)


def test_a_second_obj_replaces_the_first_and_nothing_else(ball, tmp_path):
    (tmp_path / "part.png").write_bytes(b"a photograph")
    (tmp_path / "part.mtl").write_bytes(b"a material")
    mesh = fw.surface.cloud_mesh(ball)
    for texture in (mesh.texture, mesh.texture[..., ::-1].copy(), mesh.texture[..., 0]):
        fw.write(tmp_path / "part.obj", replace(mesh, texture=texture))
        words = (tmp_path / "part.obj").read_text().splitlines()[1].split()
        assert words[0] == "mtllib"
        material = (tmp_path / words[1]).read_text().split()
        picture = np.asarray(Image.open(tmp_path / material[-1]))
        assert np.array_equal(picture, texture_of(replace(mesh, texture=texture)).shown)
        assert len(list(tmp_path.iterdir())) == 5
    assert (tmp_path / "part.png").read_bytes() == b"a photograph"
    assert (tmp_path / "part.mtl").read_bytes() == b"a material"


def test_a_height_map_takes_the_picture_of_its_object(tmp_path):
    x = np.mgrid[:30, :40][1].astype(float)
    values = np.where(x < 25, 0.1 * x, 60 + 0.1 * x)
    values[4:6, 4:6] = np.nan
    reason = np.where(np.isnan(values), 3, 0).astype(np.uint8)
    surface = fw.HeightMap(values, 0.01 + 0 * x, reason, "height", "mm", 0.5)
    seen = 100 * paint(x.shape)
    mesh = fw.surface.height_map_mesh(surface, texture=seen)
    column, row = mesh.texture_px.astype(int).T
    np.testing.assert_allclose(mesh.vertices_mm[:, 2], values[row, column])
    np.testing.assert_array_equal(mesh.colour, seen[row, column])
    assert np.ptp(mesh.vertices_mm[mesh.faces][..., 2], axis=1).max() < 5  # not across the step
    fw.write(tmp_path / "h.obj", mesh)
    plain = fw.surface.height_map_mesh(surface)
    assert (plain.texture, plain.colour, len(plain.faces)) == (None, None, len(mesh.faces))
    fw.write(tmp_path / "p.obj", fw.surface.height_map_mesh(surface, texture=seen[..., 0]))
    for given, words in (
        ({"texture": seen[1:]}, "texture: expected"),
        ({"texture": seen[..., :2]}, "texture: expected"),
    ):
        with pytest.raises(fw.InputError, match=words):
            fw.surface.height_map_mesh(surface, **given)
    with pytest.raises(fw.InputError, match="expected heights in mm"):
        fw.surface.height_map_mesh(fw.HeightMap(x, x, reason, "displacement", "px", 1.0))


def test_textures_that_do_not_fit_their_mesh():
    vertices, faces = np.eye(3), np.array([[0, 1, 2]])
    for texture, place in (
        (np.ones((4, 5)), None),
        (None, np.ones((3, 2))),
        (np.ones((4, 5, 2)), np.ones((3, 2))),
        (np.ones((0, 5)), np.ones((3, 2))),
        (np.ones((4, 5)), np.ones((2, 2))),
        (np.ones((4, 5)), np.full((3, 2), np.nan)),
    ):
        with pytest.raises(fw.InputError, match="mesh: expected"):
            fw.TriangleMesh(vertices, faces, texture=texture, texture_px=place)
    flat = fw.TriangleMesh(
        vertices, faces, texture=np.full((4, 5), np.nan), texture_px=np.ones((3, 2))
    )
    assert texture_of(flat) is None


def test_srgb_goes_there_and_back():
    light = np.linspace(0, 1, 500)
    assert np.abs(linear(as_srgb(light)) - light).max() < 0.005
    assert as_srgb(np.array([-1.0, np.nan, 2.0])).tolist() == [0, 0, 255]


def test_a_mesh_without_a_texture_keeps_the_colour_of_its_vertices(ball, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    mesh = replace(fw.surface.cloud_mesh(ball), texture=None, texture_px=None)
    fw.write(tmp_path / "v.glb", mesh)
    seen = trimesh.load(tmp_path / "v.glb", force="mesh")
    assert seen.visual.kind == "vertex"
    assert fw.surface.cloud_mesh(cloud(colour=False)).texture is None
