"""Surfaces out: every format read back by independent code."""

from __future__ import annotations

import hashlib
import xml.etree.ElementTree as ET
import zipfile

import numpy as np
import pytest
import tifffile

import fringeworks as fw
from fringeworks import HeightMap, InputError, Reason
from fringeworks.files import write_surface
from fringeworks.files.ply import read_ply as own_read_ply
from fringeworks.files.surfaces import WRITERS, read_surface
from fringeworks.surface.height_map import height_map_points


@pytest.fixture
def surface():
    y, x = np.mgrid[:20, :30].astype(float)
    values = 0.1 * x - 0.05 * y
    values[3:5, 7:9] = np.nan
    values[:, 20:] += 500.0  # a cliff
    reason = np.where(np.isnan(values), Reason.LOW_MODULATION, Reason.OK).astype(np.uint8)
    return HeightMap(values, 0.01 + 0 * values, reason, "height", "mm", 0.5, "windowed")


def test_tiff(tmp_path, surface):
    write_surface(tmp_path / "s.tif", surface)
    with tifffile.TiffFile(tmp_path / "s.tif") as file:
        found = file.asarray()
        description = file.shaped_metadata[0]
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, surface.values, rtol=1e-6)
    assert (description["unit"], description["pitch"]) == ("mm", 0.5)


def test_npz(tmp_path, surface):
    write_surface(tmp_path / "s.npz", surface)
    found = read_surface(tmp_path / "s.npz")
    for name in ("values", "sigma", "reason"):
        np.testing.assert_array_equal(getattr(found, name), getattr(surface, name))
    assert (found.quantity, found.unit, found.pitch, found.method) == (
        "height",
        "mm",
        0.5,
        "windowed",
    )
    (tmp_path / "bad.npz").write_bytes(b"no")
    with pytest.raises(InputError, match="expected a height map"):
        read_surface(tmp_path / "bad.npz")


def read_ply(path):
    content = path.read_bytes()
    header, _, body = content.partition(b"end_header\n")
    lines = header.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    count = {line.split()[1]: int(line.split()[2]) for line in lines if line.startswith("element")}
    vertex = np.frombuffer(body, "<f4", 4 * count["vertex"]).reshape(-1, 4)
    rest = body[vertex.nbytes :]
    dtype = np.dtype([("n", "u1"), ("index", "<i4", 3)])
    face = np.frombuffer(rest, dtype, count.get("face", 0))
    assert len(rest) == face.nbytes
    return vertex, face


def test_ply_points(tmp_path, surface):
    write_surface(tmp_path / "s.ply", surface)
    vertex, face = read_ply(tmp_path / "s.ply")
    assert len(vertex) == 20 * 30 - 4
    assert len(face) == 0
    first = vertex[31 - 1 + 1]  # row 1, column 1: x right, y up, z towards the camera
    np.testing.assert_allclose(first, [0.5, -0.5, surface.values[1, 1], 0.01], rtol=1e-5)


def test_ply_mesh(tmp_path, surface):
    write_surface(tmp_path / "s.ply", surface, ply="mesh")
    vertex, face = read_ply(tmp_path / "s.ply")
    corners = vertex[face["index"]][:, :, :3].astype(float)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (face["n"] == 3).all()
    assert (normals[:, 2] > 0).all()  # facing the camera
    assert np.ptp(corners[:, :, 2], axis=1).max() < 5.0  # no triangle across the cliff
    quads = 19 * 29 - 19  # less the column across the cliff
    assert len(face) == 2 * quads - 2 * 9 + 2  # less those at the hole, whose outer corners stay


def test_gsf(tmp_path, surface):
    write_surface(tmp_path / "s.gsf", surface)
    content = (tmp_path / "s.gsf").read_bytes()
    end = content.index(b"\0")
    lines = content[:end].decode().splitlines()
    assert lines[0] == "Gwyddion Simple Field 1.0"
    fields = dict(line.split(" = ") for line in lines[1:])
    assert (fields["XRes"], fields["YRes"], fields["ZUnits"]) == ("30", "20", "m")
    assert float(fields["XReal"]) == pytest.approx(0.015)
    start = end + (4 - end % 4)
    data = np.frombuffer(content[start:], "<f4").reshape(20, 30)
    np.testing.assert_allclose(data * 1e3, surface.values, rtol=1e-5, atol=1e-6)


def test_x3p(tmp_path, surface):
    write_surface(tmp_path / "s.x3p", surface)
    with zipfile.ZipFile(tmp_path / "s.x3p") as archive:
        description = archive.read("main.xml")
        data = archive.read("bindata/data.bin")
        checksum = archive.read("md5checksum.hex").decode()
    assert hashlib.md5(description).hexdigest() == checksum.split()[0]
    root = ET.fromstring(description)
    assert root.tag == "{http://www.opengps.eu/2008/ISO5436_2}ISO5436_2"
    assert root.findtext("Record1/FeatureType") == "SUR"
    assert float(root.findtext("Record1/Axes/CX/Increment")) == pytest.approx(0.5e-3)
    size = [int(root.findtext(f"Record3/MatrixDimension/Size{a}")) for a in "XYZ"]
    assert size == [30, 20, 1]
    assert root.findtext("Record3/DataLink/MD5ChecksumPointData") == hashlib.md5(data).hexdigest()
    heights = np.frombuffer(data, "<f8").reshape(20, 30)
    np.testing.assert_allclose(heights * 1e3, surface.values)


def test_x3p_holds_lengths_only(tmp_path, surface):
    in_px = HeightMap(surface.values, surface.sigma, surface.reason, "displacement", "px", 1.0)
    with pytest.raises(InputError, match="X3P: expected heights in mm"):
        write_surface(tmp_path / "s.x3p", in_px)
    assert list(tmp_path.iterdir()) == []
    write_surface(tmp_path / "s.gsf", in_px)
    assert b"ZUnits = px" in (tmp_path / "s.gsf").read_bytes()


@pytest.mark.parametrize("suffix", WRITERS)
def test_unwritable_folder_leaves_nothing(tmp_path, surface, suffix):
    with pytest.raises(InputError, match="expected a writable folder"):
        write_surface(tmp_path / "missing" / f"s{suffix}", surface)
    assert list(tmp_path.iterdir()) == []


def test_unknown_suffix(tmp_path, surface):
    with pytest.raises(InputError, match=r"expected one of \.tif"):
        write_surface(tmp_path / "s.doc", surface)


def test_points_index(surface):
    xyz, sigma, index = height_map_points(surface)
    assert index[3, 7] == -1
    assert xyz[index[10, 4]].tolist() == [2.0, -5.0, surface.values[10, 4]]
    assert sigma.shape == (596,)


@pytest.mark.parametrize("part", [np.s_[1520:1560], np.s_[:]])
def test_white_of_a_cloud_is_that_of_its_bright_points(tmp_path, part):
    """A dark rim and stripes that alternate with the rows must not decide it."""
    shape = (3000, 400)
    y = np.arange(shape[0])[:, None]
    colour = np.where((y % 40) < (3 if part != np.s_[:] else 20), 20.0, 200.0) * np.ones(shape)
    reason = np.ones(shape, np.uint8)
    reason[part] = 0
    xyz = np.ones((*shape, 3), np.float32)
    cloud = fw.PointCloud(xyz, xyz[..., 0], xyz[..., 0], reason, None, colour)
    fw.files.write_points(tmp_path / "cloud.ply", cloud)
    vertices, _ = own_read_ply(tmp_path / "cloud.ply")
    assert sorted(set(vertices["red"].tolist())) == [26, 255]
