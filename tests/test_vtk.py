"""Files for ParaView: what other readers of VTK's XML find in them."""

from __future__ import annotations

import base64
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.surface.cloud import cloud_triangles
from fringeworks.types import CameraNoise, CoordinateMap, Provenance
from tests.surfaces import height_map, random_cloud

TYPES = {"Float32": "<f4", "Float64": "<f8", "UInt8": "u1", "Int32": "<i4", "Int64": "<i8"}
TYPES |= {"UInt16": "<u2", "UInt32": "<u4"}
MADE = Provenance("measure", {"axis": "x", "said": "a < b & -- ü"}, date="2026-01-02T03:04:05Z")


def arrays(path):
    """The root, and all arrays of a file by their names."""
    root = ET.parse(path).getroot()
    assert root.attrib["header_type"] == "UInt64"
    found = {}
    for one in root.iter("DataArray"):
        if one.attrib["type"] == "String":
            numbers = bytes(map(int, one.text.split()))
            found[one.attrib["Name"]] = numbers.decode().split("\0")[:-1]
            continue
        raw = base64.b64decode(one.text)
        length = int.from_bytes(raw[:8], "little")
        values = np.frombuffer(raw[8:], TYPES[one.attrib["type"]])
        assert values.nbytes == length
        components = int(one.attrib["NumberOfComponents"])
        found[one.attrib["Name"]] = values if components == 1 else values.reshape(-1, components)
    return root, found


@pytest.fixture
def cloud():
    return replace(random_cloud(3), provenance=MADE)


def test_points(tmp_path, cloud):
    fw.write(tmp_path / "c.vtp", cloud, kind="normals")
    root, found = arrays(tmp_path / "c.vtp")
    ok = cloud.reason == 0
    np.testing.assert_allclose(found["Points"], cloud.xyz_mm[ok], rtol=1e-6)
    np.testing.assert_allclose(found["sigma_mm"], cloud.sigma_mm[ok], rtol=1e-6)
    assert found["normals"].shape == found["Points"].shape
    assert root.find("PolyData/Piece").attrib["NumberOfVerts"] == str(ok.sum())
    assert found["connectivity"].tolist() == list(range(ok.sum()))
    assert "a < b & --" in found["provenance"][0]


def test_triangles(tmp_path, cloud):
    fw.write(tmp_path / "m.vtp", cloud, kind="mesh")
    _, found = arrays(tmp_path / "m.vtp")
    triangles = found["connectivity"].reshape(-1, 3)
    ok = np.flatnonzero(cloud.reason == 0)
    assert np.array_equal(ok[triangles], cloud_triangles(cloud))
    assert found["offsets"].tolist() == list(range(3, 3 * len(triangles) + 1, 3))
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]])
    mesh = fw.TriangleMesh(corners, np.array([[0, 1, 2]]), np.full(3, 0.1))
    fw.write(tmp_path / "t.vtp", mesh)
    _, found = arrays(tmp_path / "t.vtp")
    assert found["sigma_mm"] == pytest.approx([0.1] * 3)


def test_merged_points(tmp_path):
    fw.write(tmp_path / "p.vtp", fw.surface.Points(np.eye(3), np.full(3, 0.2)))
    _, found = arrays(tmp_path / "p.vtp")
    np.testing.assert_allclose(found["Points"], np.eye(3))
    assert found["sigma_mm"] == pytest.approx([0.2] * 3)


def test_rasters_have_sigma_and_reasons_with_y_upwards(tmp_path, cloud):
    fw.write(tmp_path / "c.vti", cloud)
    _, found = arrays(tmp_path / "c.vti")
    rows, columns = cloud.shape
    assert found["reasons"] == [reason.name.lower() for reason in fw.Reason]
    assert np.array_equal(found["reason"].reshape(rows, columns)[::-1], cloud.reason)
    sigma = found["sigma_mm"].reshape(rows, columns)[::-1]
    np.testing.assert_allclose(sigma, cloud.sigma_mm, rtol=1e-6)
    surface = height_map()
    fw.write(tmp_path / "h.vti", surface)
    root, found = arrays(tmp_path / "h.vti")
    values = found[f"height_{surface.unit}"].reshape(surface.shape)[::-1]
    np.testing.assert_allclose(values, surface.values, rtol=1e-6)
    image = root.find("ImageData")
    assert image.attrib["WholeExtent"].split()[1] == str(surface.shape[1] - 1)
    assert float(image.attrib["Spacing"].split()[0]) == pytest.approx(surface.pitch)


def test_coordinates(tmp_path):
    flat = np.ones((4, 5), np.float32)
    one = CoordinateMap(flat, flat, flat, flat, np.zeros((4, 5), np.uint8), "x", (8.0,))
    fw.write(tmp_path / "d.vti", fw.Decoded(one, None, CameraNoise(1.0)))
    _, found = arrays(tmp_path / "d.vti")
    assert found["x_coordinate_px"].size == 20
    assert found["x_reason"].dtype == np.uint8


def test_equal_results_are_equal_files(tmp_path, cloud):
    for suffix in (".vtp", ".vti"):
        for name in "ab":
            fw.write(tmp_path / f"{name}{suffix}", cloud)
        assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_vtk_itself_reads_them(tmp_path, cloud):
    pytest.importorskip("vtkmodules")
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOXML import vtkXMLImageDataReader, vtkXMLPolyDataReader

    for suffix, reader in ((".vtp", vtkXMLPolyDataReader()), (".vti", vtkXMLImageDataReader())):
        fw.write(tmp_path / f"c{suffix}", cloud)
        reader.SetFileName(str(tmp_path / f"c{suffix}"))
        reader.Update()
        output = reader.GetOutput()
        sigma = vtk_to_numpy(output.GetPointData().GetArray("sigma_mm"))
        assert sigma.size == output.GetNumberOfPoints() > 0
        assert output.GetFieldData().GetAbstractArray("provenance").GetValue(0)
