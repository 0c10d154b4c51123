"""Points and results in the formats of other programs: there, read by independent code, and back."""

from __future__ import annotations

import csv
import io
import json
import struct
import sys
import zipfile
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks import Reason
from fringeworks.files.lzf import decompressed
from fringeworks.files.point_writers import KINDS, TABLE_WRITERS
from fringeworks.surface import Points
from fringeworks.surface.height_map import height_map_points
from fringeworks.types import CameraNoise, CoordinateMap, Provenance

MADE = Provenance("measure", {"axis": "x"}, date="2026-01-02T03:04:05Z")
SEEN = (fw.Finding("noise", "the noise was measured", severity="note"),)


def cloud(colour="rgb", rows=9, columns=13):
    """A wavy surface in half a metre with a hole, and colours that are no grey."""
    y, x = np.mgrid[:rows, :columns].astype(float)
    xyz = np.stack((0.7 * x - 4, 0.7 * y - 3, 500 + np.sin(x / 3) + 0.1 * y), -1)
    reason = np.zeros((rows, columns), np.uint8)
    reason[2:4, 5:8] = Reason.SATURATED
    reason[0] = Reason.SHADOW
    lost = reason != 0
    xyz[lost] = np.nan
    sigma = np.where(lost, np.nan, 0.01 + 0.001 * x)
    shown = np.stack((40 + 5 * x, 90 - 3 * y, 20 + 2 * x + 4 * y), -1)
    return fw.PointCloud(
        xyz.astype(np.float32),
        sigma.astype(np.float32),
        (0.5 * sigma).astype(np.float32),
        reason,
        residual_px=np.where(lost, np.nan, 0.1 * y - 0.3).astype(np.float32),
        colour={"rgb": shown, "grey": shown[..., 0], None: None}[colour],
        provenance=MADE,
        findings=SEEN,
        blur_mm=np.where(lost, np.nan, 0.002 * x).astype(np.float32),
    )


def same_hue(found, expected, within):
    """Colours agree up to their common scale."""
    scale = np.sum(found * expected) / np.sum(expected**2)
    np.testing.assert_allclose(found, scale * expected, atol=within * found.max())


COLOUR_STEP = {".csv": 1e-6, ".las": 2e-5, ".laz": 2e-5}
"""Rounding of colours over the largest; 8 bits elsewhere, where highlights are white."""
PACKAGES = {".e57": "pye57", ".las": "laspy", ".laz": "lazrs"}


def needs(suffix):
    if suffix in PACKAGES:
        pytest.importorskip(PACKAGES[suffix])


@pytest.mark.parametrize("colour", ["rgb", "grey", None])
@pytest.mark.parametrize("kind", ["points", "normals"])
@pytest.mark.parametrize("suffix", [".ply", ".pcd", ".csv", ".e57", ".las", ".laz"])
def test_points_come_back(tmp_path, suffix, kind, colour):
    needs(suffix)
    given = cloud(colour)
    ok = given.reason == 0
    found = fw.read(fw.write(tmp_path / f"p{suffix}", given, kind=kind))
    assert type(found) is Points
    np.testing.assert_allclose(found.xyz_mm, given.xyz_mm[ok], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.sigma_mm, given.sigma_mm[ok], rtol=1e-6)
    np.testing.assert_allclose(found.noise_mm, given.noise_mm[ok], rtol=1e-6)
    assert found.provenance == MADE
    assert (found.normals is None) == (kind == "points")
    if kind == "normals":
        expected = np.nan_to_num(fw.surface.normals(given)[ok])
        np.testing.assert_allclose(found.normals, expected, atol=1e-6)
    if colour is None:
        assert found.colour is None
    else:
        assert found.colour.ndim == (2 if colour == "rgb" else 1)
        same_hue(found.colour, given.colour[ok], COLOUR_STEP.get(suffix, 5e-3))


@pytest.mark.parametrize("colour", ["rgb", "grey", None])
@pytest.mark.parametrize("suffix", [".pcd", ".csv", ".e57"])
def test_a_whole_frame_comes_back_with_its_reasons(tmp_path, suffix, colour):
    needs(suffix)
    given = cloud(colour)
    found = fw.read(fw.write(tmp_path / f"f{suffix}", given, kind="frame"))
    assert type(found) is fw.PointCloud
    assert fw.files.read_cloud(tmp_path / f"f{suffix}") == found
    assert found.provenance == MADE
    assert np.array_equal(found.reason, given.reason)
    for name in ("xyz_mm", "sigma_mm", "noise_mm", "residual_px", "blur_mm"):
        one, other = getattr(found, name), getattr(given, name)
        np.testing.assert_allclose(one, other, rtol=2e-6, atol=1e-6, err_msg=name)
    assert found.findings == (() if suffix == ".pcd" else SEEN)
    ok = given.reason == 0
    if colour is None:
        assert found.colour is None
    else:
        assert found.colour.shape == given.colour.shape
        same_hue(found.colour[ok], given.colour[ok], COLOUR_STEP.get(suffix, 5e-3))
    points = fw.files.read_points(tmp_path / f"f{suffix}")
    assert len(points.xyz_mm) == ok.sum()


@pytest.mark.parametrize("suffix", [s for s in TABLE_WRITERS if s not in (".mcap", ".vtp")])
def test_merged_points_come_back(tmp_path, suffix):
    needs(suffix)
    rng = np.random.default_rng(5)
    given = Points(rng.normal(0, 30, (40, 3)), np.full(40, 0.02), np.full(40, 0.01), SEEN, MADE)
    found = fw.read(fw.write(tmp_path / f"m{suffix}", given))
    np.testing.assert_allclose(found.xyz_mm, given.xyz_mm, atol=1e-5)
    np.testing.assert_allclose(found.sigma_mm, given.sigma_mm, rtol=1e-6)
    assert found.provenance == MADE
    bare = Points(given.xyz_mm, None)
    found = fw.read(fw.write(tmp_path / f"b{suffix}", bare))
    np.testing.assert_allclose(found.xyz_mm, given.xyz_mm, atol=1e-5)
    assert (found.sigma_mm, found.provenance) == (None, None)


def test_merged_points_are_a_ros_bag_as_well(tmp_path):
    pytest.importorskip("rosbags")
    fw.write(tmp_path / "m.mcap", Points(np.eye(3), np.ones(3)))
    assert (tmp_path / "m.mcap").stat().st_size > 100


def test_equal_points_are_equal_files(tmp_path):
    for suffix in (".pcd", ".csv", ".e57", ".las", ".laz"):
        needs(suffix)
        for name in "ab":
            fw.write(tmp_path / f"{name}{suffix}", cloud())
        one, other = ((tmp_path / f"{name}{suffix}").read_bytes() for name in "ab")
        assert one == other, suffix


@pytest.mark.parametrize("suffix", KINDS)
def test_what_a_format_cannot_hold_is_said(tmp_path, suffix):
    needs(suffix)
    for kinds in (KINDS[suffix],):
        for kind in {"points", "normals", "mesh", "frame"} - set(kinds):
            with pytest.raises(fw.InputError, match="cannot hold; .* can"):
                fw.write(tmp_path / f"x{suffix}", cloud(), kind=kind)
    with pytest.raises(fw.InputError, match="kind: expected one of mesh, frame"):
        fw.write(tmp_path / "x.ply", cloud(), kind="blob")
    assert not list(tmp_path.iterdir())


def test_las_is_what_other_programs_expect(tmp_path):
    laspy = pytest.importorskip("laspy")
    given = cloud()
    fw.write(tmp_path / "p.las", given)
    found = laspy.read(tmp_path / "p.las")
    ok = given.reason == 0
    np.testing.assert_allclose(found.xyz, given.xyz_mm[ok] * np.float64(1e-3), atol=1e-9)
    assert (str(found.header.version), found.point_format.id) == ("1.4", 7)
    np.testing.assert_allclose(found["sigma"], given.sigma_mm[ok] * 1e-3, rtol=1e-6)
    assert found.red.max() > 60_000
    plain = fw.write(tmp_path / "g.las", replace(given, colour=None))
    assert laspy.read(plain).point_format.id == 6


def test_las_of_other_programs(tmp_path):
    laspy = pytest.importorskip("laspy")
    header = laspy.LasHeader(version="1.2", point_format=0)
    header.scales, header.offsets = [0.001] * 3, [10.0, 20.0, 5.0]
    data = laspy.LasData(header)
    data.x, data.y, data.z = np.array([[10.5, 11.25], [20.0, 21.5], [4.0, 5.125]])
    data.intensity = np.array([7, 900])
    data.write(tmp_path / "f.las")
    found = fw.read(tmp_path / "f.las")
    np.testing.assert_allclose(found.xyz_mm, [[10500, 20000, 4000], [11250, 21500, 5125]])
    assert found.sigma_mm is None
    assert found.colour.tolist() == [7, 900]


def test_e57_is_what_other_programs_expect(tmp_path):
    pye57 = pytest.importorskip("pye57")
    given = cloud()
    fw.write(tmp_path / "p.e57", given, kind="frame")
    with pye57.E57(str(tmp_path / "p.e57")) as file:
        assert file.scan_count == 1
        seen = file.read_scan(0, colors=True, row_column=True)
    ok = given.reason == 0
    xyz = np.column_stack([seen[f"cartesian{axis}"] for axis in "XYZ"])
    np.testing.assert_allclose(xyz, given.xyz_mm[ok] * 1e-3, atol=1e-7)
    rows, columns = np.nonzero(ok)
    assert np.array_equal(seen["rowIndex"], rows)
    assert np.array_equal(seen["columnIndex"], columns)
    shown = np.column_stack([seen[f"color{name}"] for name in ("Red", "Green", "Blue")])
    same_hue(shown.astype(float), given.colour[ok], 5e-3)


def test_e57_of_other_programs_with_poses(tmp_path):
    """Two scans, each turned and moved; one point is marked as invalid."""
    pye57 = pytest.importorskip("pye57")
    turn = np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])  # 90° about z
    data = {
        f"cartesian{axis}": np.array(v)
        for axis, v in zip("XYZ", ([1.0, 2], [0.0, 0], [0.0, 1]), strict=True)
    }
    data |= {"intensity": np.array([0.25, 0.5], np.float32)}
    with pye57.E57(str(tmp_path / "s.e57"), mode="w") as file:
        file.write_scan_raw(data, rotation=turn, translation=np.array([0.0, 0.0, 5.0]))
        state = {"cartesianInvalidState": np.array([0, 2], np.int8)}
        file.write_scan_raw(data | state)
    found = fw.read(tmp_path / "s.e57")
    np.testing.assert_allclose(found.xyz_mm, [[0, 1e3, 5e3], [0, 2e3, 6e3], [1e3, 0, 0]], atol=1e-3)
    assert found.colour.tolist() == [0.25, 0.5, 0.25]


def test_damaged_files_are_one_sentence(tmp_path):
    for suffix in (".pcd", ".csv", ".e57", ".las", ".laz"):
        needs(suffix)
        whole = fw.write(tmp_path / f"a{suffix}", cloud(), kind="points").read_bytes()
        rng = np.random.default_rng(3)
        for trial in range(3 if suffix == ".e57" else 12):
            spoiled = bytearray(whole[: rng.integers(1, len(whole))] if trial % 2 else whole)
            for place in rng.integers(0, len(spoiled), 8):
                spoiled[place] = rng.integers(256)
            (tmp_path / f"b{suffix}").write_bytes(spoiled)
            with suppress(fw.InputError):
                fw.read(tmp_path / f"b{suffix}")


# PCD of other programs.


def pcd(fields, sizes, kinds, counts, count, form, body, width=None, height=1):
    width = count if width is None else width
    header = f"# .PCD v0.7\nVERSION 0.7\nFIELDS {fields}\nSIZE {sizes}\nTYPE {kinds}\nCOUNT {counts}\nWIDTH {width}\nHEIGHT {height}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA {form}\n"
    return header.encode() + body


def lzf_literals(content):
    """Content as LZF that repeats nothing."""
    pieces = [content[k : k + 32] for k in range(0, len(content), 32)]
    return b"".join(bytes([len(piece) - 1]) + piece for piece in pieces)


def test_pcd_of_other_programs(tmp_path):
    xyz = np.array([[1, 2, 3], [4, 5, 6], [7, 8, np.nan]], np.float32)
    rgb = np.array([0xFF8000, 0x0000FF, 0x102030], np.uint32)
    text = "".join(
        f"{x} {y} {z} {c}\n" for (x, y, z), c in zip(xyz, rgb.view(np.float32), strict=True)
    )
    (tmp_path / "ascii.pcd").write_bytes(
        pcd("x y z rgb", "4 4 4 4", "F F F F", "1 1 1 1", 3, "ascii", text.encode())
    )
    columns = b"".join(np.ascontiguousarray(c).tobytes() for c in (*xyz.T, rgb))
    packed = lzf_literals(columns)
    body = struct.pack("<II", len(packed), len(columns)) + packed
    (tmp_path / "packed.pcd").write_bytes(
        pcd("x y z rgba", "4 4 4 4", "F F F U", "1 1 1 1", 3, "binary_compressed", body)
    )
    rows = b"".join(
        np.float32([*p, 9.0]).tobytes() + np.float32([0, 0, 1]).tobytes() + c.tobytes()
        for p, c in zip(xyz, rgb, strict=True)
    )
    (tmp_path / "padded.pcd").write_bytes(
        pcd("x y z _ fpfh rgb", "4 4 4 1 4 4", "F F F U F U", "1 1 1 4 3 1", 3, "binary", rows)
    )
    for name in ("ascii", "packed", "padded"):
        found = fw.read(tmp_path / f"{name}.pcd")
        np.testing.assert_array_equal(found.xyz_mm, xyz[:2])
        assert found.colour.tolist() == [[255, 128, 0], [0, 0, 255]], name


def test_pcd_that_lies_about_its_size(tmp_path):
    for count, form in (
        (10**12, "binary"),
        (10**7, "binary"),
        (5, "binary_compressed"),
        (4, "ascii"),
        (-1, "ascii"),
    ):
        (tmp_path / "a.pcd").write_bytes(
            pcd("x y z", "4 4 4", "F F F", "1 1 1", count, form, b"1 2 3\n" * 2)
        )
        with pytest.raises(fw.FileProblem, match="a.pcd"):
            fw.read(tmp_path / "a.pcd")


def test_lzf_repeats_what_came_before():
    # "abc" as it is, then nine bytes from three bytes back: the repetition overlaps itself.
    content = bytes([2]) + b"abc" + bytes([7 << 5, 0, 2])
    assert decompressed(content, 12) == b"abcabcabcabc"
    with pytest.raises(fw.FileProblem, match="damaged"):
        decompressed(bytes([1 << 5, 9]), 3)


# Tables.


def test_csv_opens_without_us(tmp_path):
    given = cloud()
    text = fw.write(tmp_path / "p.csv", given, kind="frame").read_text()
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    table = list(csv.DictReader(lines))
    assert len(table) == given.reason.size
    names = "x_mm,y_mm,z_mm,sigma_mm,noise_mm,residual_px,blur_mm,red,green,blue,row,column,reason"
    assert lines[0] == names
    assert {row["reason"] for row in table} == {"ok", "saturated", "shadow"}
    first = table[0]
    assert (first["x_mm"], first["reason"], first["row"]) == ("", "shadow", "0")
    inside = table[13 + 3]
    np.testing.assert_allclose(float(inside["z_mm"]), given.xyz_mm[1, 3, 2], rtol=1e-7)
    numbers = np.genfromtxt(
        io.StringIO(text), delimiter=",", skip_header=2, names=True, dtype=None, encoding=None
    )
    np.testing.assert_array_equal(numbers["red"], given.colour[..., 0].ravel())


TABLES = {
    "plain": ("x,y,z\n1,2,3\n4,5,6\n", None),
    "no header": ("1,2,3\n4,5,6\n", None),
    "blanks": ("X Y Z\n1 2 3\n4 5 6\n", None),
    "tabs and commas": ("x\ty\tz\n1,0\t2,0\t3,0\n4,0\t5,0\t6,0\n", None),
    "German": ("x [mm];y [mm];z [mm];σ [µm]\n1,0;2,0;3,0;10,0\n4,0;5,0;6,0;20,0\n", [0.01, 0.02]),
    "metres": ("x_m,y_m,z_m,sigma_mm\n.001,.002,.003,.01\n.004,.005,.006,.02\n", [0.01, 0.02]),
    "inches": (
        '"Z (in)","Y (in)","X (in)"\n{},{},{}\n{},{},{}\n'.format(
            *(v / 25.4 for v in (3, 2, 1, 6, 5, 4))
        ),
        None,
    ),
    "CloudCompare": ("//X,Y,Z,R,G,B\n1,2,3,10,20,30\n4,5,6,40,50,60\n", None),
    "NumPy": ("# x y z\n1 2 3\n4 5 6\n", None),
    "four columns": ("1,2,3,0.01\n4,5,6,0.02\n", [0.01, 0.02]),
    "missing point": ("x,y,z\n1,2,3\n,,\n4,5,6\n", None),
}


@pytest.mark.parametrize("name", TABLES)
@pytest.mark.parametrize("coding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_tables_of_other_programs(tmp_path, name, coding):
    text, sigma = TABLES[name]
    if coding == "cp1252":
        text = text.replace("σ", "sigma")
    (tmp_path / "t.csv").write_bytes(text.replace("\n", "\r\n").encode(coding))
    found = fw.read(tmp_path / "t.csv")
    np.testing.assert_allclose(found.xyz_mm, [[1, 2, 3], [4, 5, 6]])
    assert sigma is None or np.allclose(found.sigma_mm, sigma)
    if name == "CloudCompare":
        assert found.colour.tolist() == [[10, 20, 30], [40, 50, 60]]


def test_columns_that_are_left_out_are_named(tmp_path):
    (tmp_path / "t.csv").write_text("x,y,z,temperature\n1,2,3,20\n")
    assert "temperature" in fw.read(tmp_path / "t.csv").notes[0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "expected rows of numbers, got none"),
        ("a,b\n1,2\n", "expected columns x, y and z, got a, b"),
        ("x,y,z\n1,2\n", "a table|points"),
        ("x,y,z\n1,2,three\n", "points"),
        ("# fringeworks plans\n# details {}\nx\n1\n", "expected a table of points, heights, coord"),
        ("# fringeworks heights\n# details {}\nrow,column\n1,2\n", "a height map as CSV"),
        ("# fringeworks points\n# details []\nx\n1\n", "details by their names"),
    ],
)
def test_tables_that_are_none(tmp_path, text, words):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(fw.InputError, match=words):
        fw.read(tmp_path / "t.csv")


@pytest.mark.parametrize("pitch", [0.25, None])
def test_heights_as_a_table(tmp_path, pitch):
    y, x = np.mgrid[:20, :31].astype(float)
    values = 0.1 * x - 0.05 * y
    values[3:5, 7:9] = np.nan
    reason = np.where(np.isnan(values), Reason.LOW_MODULATION, 0).astype(np.uint8)
    pupil = None if pitch is None else (15.0, 9.5, 800.0)
    given = fw.HeightMap(
        values, 0.01 + 0 * x, reason, "height", "mm", pitch, "windowed", MADE, pupil, True, SEEN
    )
    fw.write(tmp_path / "h.csv", given)
    assert fw.read(tmp_path / "h.csv") == given
    if pitch is None:
        return
    table = np.genfromtxt(
        tmp_path / "h.csv", delimiter=",", skip_header=2, names=True, dtype=None, encoding=None
    )
    inside = table[table["reason"] == "ok"]
    xyz, _, _ = height_map_points(given)
    found = np.column_stack([inside[name] for name in ("x_mm", "y_mm", "height_mm")])
    np.testing.assert_allclose(found, xyz)
    assert len(fw.files.read_points(tmp_path / "h.csv").xyz_mm) == len(xyz)


def coordinates(axes="xy"):
    rng = np.random.default_rng(2)
    maps = {}
    for axis in "xy":
        a, b, c, d = rng.uniform(1, 9, (4, 12, 17)).astype(np.float32)
        reason = np.zeros(a.shape, np.uint8)
        reason[3] = Reason.SHADOW
        a[3] = b[3] = np.nan
        maps[axis] = (
            CoordinateMap(a, b, c, d, reason, axis, (16.0, 128.0), repeats_px=640.0)
            if axis in axes
            else None
        )
    return fw.Decoded(maps["x"], maps["y"], CameraNoise(1.5, 0.04), SEEN, provenance=MADE)


@pytest.mark.parametrize("axes", ["x", "xy"])
def test_coordinates_as_a_table(tmp_path, axes):
    given = coordinates(axes)
    found = fw.read(fw.write(tmp_path / "c.csv", given))
    assert (found.noise, found.findings, found.provenance) == (given.noise, SEEN, MADE)
    for axis in "xy":
        one, other = getattr(found, axis), getattr(given, axis)
        assert (one is None) == (other is None)
        if other is None:
            continue
        assert (one.axis, one.periods_px, one.repeats_px) == (axis, (16.0, 128.0), 640.0)
        assert np.array_equal(one.reason, other.reason)
        for name in ("coordinate_px", "sigma_px", "modulation", "background"):
            np.testing.assert_array_equal(
                getattr(one, name).astype(np.float32), getattr(other, name)
            )


# Meshes.


def tetrahedron(colour=True):
    vertices = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.uint32)
    seen = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [9, 99, 199.0]])
    return fw.TriangleMesh(vertices, faces, colour=seen if colour else None)


@pytest.mark.parametrize("colour", [True, False])
def test_3mf(tmp_path, colour):
    given = tetrahedron(colour)
    found = fw.read(fw.write(tmp_path / "m.3mf", given))
    assert type(found) is fw.TriangleMesh

    def corners(mesh):
        return np.sort(np.asarray(mesh.vertices_mm)[mesh.faces].reshape(-1, 9), axis=0)

    np.testing.assert_allclose(corners(found), corners(given))
    with zipfile.ZipFile(tmp_path / "m.3mf") as archive:
        assert set(archive.namelist()) == {"[Content_Types].xml", "_rels/.rels", "3D/3dmodel.model"}
        text = archive.read("3D/3dmodel.model").decode()
    assert ("#0963C7" in text) == colour


def test_3mf_opens_in_trimesh(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("lxml", reason="trimesh reads 3MF by lxml")
    fw.write(tmp_path / "m.3mf", tetrahedron())
    seen = trimesh.load(tmp_path / "m.3mf", force="mesh")
    assert seen.is_watertight
    assert seen.volume == pytest.approx(1000 / 6)


def model(text, tmp_path):
    with zipfile.ZipFile(tmp_path / "f.3mf", "w") as archive:
        archive.writestr("3D/3dmodel.model", text)
    return tmp_path / "f.3mf"


CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
SHAPE = '<mesh><vertices><vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/><vertex x="0" y="1" z="0"/></vertices><triangles><triangle v1="0" v2="1" v3="2"/></triangles></mesh>'


def test_3mf_of_other_programs_with_components(tmp_path):
    """An object in inches, placed twice within another one, which is moved."""
    text = f'<?xml version="1.0"?><model unit="inch" xmlns="{CORE}"><resources><object id="1">{SHAPE}</object><object id="7"><components><component objectid="1"/><component objectid="1" transform="0 1 0 -1 0 0 0 0 1 2 0 0"/></components></object></resources><build><item objectid="7" transform="1 0 0 0 1 0 0 0 1 0 0 3"/></build></model>'
    found = fw.read(model(text, tmp_path))
    placed = np.array([[0, 0, 3], [1, 0, 3], [0, 1, 3], [2, 0, 3], [2, 1, 3], [1, 0, 3.0]])
    corners = np.asarray(found.vertices_mm)[found.faces].reshape(-1, 3)
    np.testing.assert_allclose(np.sort(corners, axis=0), np.sort(placed * 25.4, axis=0))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('<!DOCTYPE m [<!ENTITY a "b">]><model/>', "without entities"),
        (f'<model xmlns="{CORE}"/>', "expected triangles, got none"),
        (
            f'<model xmlns="{CORE}"><resources><object id="1"><components><component objectid="1"/></components></object></resources><build><item objectid="1"/></build></model>',
            "parts, got more",
        ),
        (f'<model xmlns="{CORE}" unit="cubit"/>', "mesh as 3MF"),
        (
            f'<model xmlns="{CORE}"><resources><object id="1">{SHAPE.replace("v3=" + chr(34) + "2", "v3=" + chr(34) + "9")}</object></resources><build><item objectid="1"/></build></model>',
            "triangles of vertices in the file",
        ),
    ],
)
def test_3mf_that_is_none(tmp_path, text, words):
    with pytest.raises(fw.FileProblem, match=words):
        fw.read(model(text, tmp_path))


# Objects of other packages.


def test_heights_become_a_data_set():
    pytest.importorskip("xarray")
    y, x = np.mgrid[:5, :7].astype(float)
    reason = np.zeros(x.shape, np.uint8)
    reason[0, 0] = Reason.SHADOW
    surface = fw.HeightMap(
        x + y,
        0.1 + 0 * x,
        reason,
        "height",
        "mm",
        0.5,
        "windowed",
        MADE,
        (3.0, 2.0, 900.0),
        True,
        SEEN,
    )
    found = surface.to_xarray()
    assert (found.height.dims, found.height.units, found.sigma.units) == (
        ("row", "column"),
        "mm",
        "mm",
    )
    assert found.x.values.tolist() == (0.5 * np.arange(7)).tolist()
    assert found.y.values.tolist() == (-0.5 * np.arange(5)).tolist()
    assert (found.x.units, found.y.dims) == ("mm", ("row",))
    names = found.reason.flag_meanings.split()
    assert names[int(found.reason[0, 0])] == "shadow"
    assert json.loads(found.provenance)["call"] == "measure"
    assert json.loads(found.findings)[0]["seen"] == SEEN[0].seen
    moved = fw.HeightMap(x, x, reason, "displacement", "px", None).to_xarray()
    assert moved.displacement.units == "px"
    assert "x" not in moved.coords


def test_points_and_coordinates_become_data_sets():
    pytest.importorskip("xarray")
    given = cloud()
    found = given.to_xarray()
    np.testing.assert_array_equal(found.xyz_mm.sel(axis="z"), given.xyz_mm[..., 2])
    assert (found.sigma_mm.units, found.colour.dims) == ("mm", ("row", "column", "channel"))
    np.testing.assert_array_equal(found.colour.sel(channel="green"), given.colour[..., 1])
    decoded = coordinates()
    phases = np.zeros((2, 12, 17))
    decoded = replace(decoded, x=replace(decoded.x, phase_rad=phases, modulations=phases))
    found = decoded.to_xarray()
    np.testing.assert_array_equal(found.y_coordinate_px, decoded.y.coordinate_px)
    assert found.x_phase_rad.dims == ("x_set", "row", "column")
    assert found.x_period_px.values.tolist() == [16.0, 128.0]
    assert found.x_coordinate_px.units == "px"


def test_points_become_a_cloud_of_open3d():
    open3d = pytest.importorskip("open3d", reason="open3d is not installed: 400 MB, in no extra")
    given = cloud()
    ok = given.reason == 0
    found = given.to_open3d()
    assert isinstance(found, open3d.t.geometry.PointCloud)
    np.testing.assert_array_equal(found.point.positions.numpy(), given.xyz_mm[ok])
    np.testing.assert_array_equal(found.point.sigma.numpy()[:, 0], given.sigma_mm[ok])
    same_hue(found.point.colors.numpy().astype(float), given.colour[ok], 5e-3)
    assert len(found.to_legacy().points) == ok.sum()


@pytest.mark.parametrize(
    ("package", "call", "words"),
    [
        (
            "pye57.libe57",
            lambda p: fw.write(p / "a.e57", cloud()),
            r"E57 files: .* pye57, got none; pip install 'fringeworks\[export\]'",
        ),
        (
            "laspy",
            lambda p: fw.write(p / "a.las", cloud()),
            r"LAS files: .* laspy, got none; pip install 'fringeworks\[export\]'",
        ),
        ("lazrs", lambda p: fw.write(p / "a.laz", cloud()), r"LAZ files: .* lazrs, got none"),
        (
            "xarray",
            lambda _: cloud().to_xarray(),
            r"xarray, got none; pip install 'fringeworks\[xarray\]'",
        ),
        ("open3d", lambda _: cloud().to_open3d(), "open3d, got none; pip install open3d"),
        (
            "rosbags.rosbag2",
            lambda p: fw.write(p / "a.mcap", cloud()),
            r"rosbags, got none; pip install 'fringeworks\[ros\]'",
        ),
    ],
)
def test_a_missing_package_is_one_sentence(monkeypatch, tmp_path, package, call, words):
    if package == "lazrs":
        pytest.importorskip("laspy")
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(fw.MissingPackage, match=words):
        call(tmp_path)
    assert not list(tmp_path.iterdir())
