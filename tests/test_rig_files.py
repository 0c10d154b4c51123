"""Rigs and points on disk: round trips, other programs' files, and damage."""

from __future__ import annotations

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from fringeworks import Finding, InputError, Reason
from fringeworks.cli.commands import run
from fringeworks.files.points import read_cloud, read_points, write_points
from fringeworks.files.rig import format_rig, read_rig, write_rig
from fringeworks.rig.point_findings import unit_findings
from fringeworks.rig.triangulate import triangulate
from fringeworks.surface.cloud import cloud_triangles
from fringeworks.types import Pixels, Region, RigMismatch
from tests.rigs import calibrated, rig, scene


def same(a, b, *, covariance=True):
    assert a.camera == b.camera
    assert a.projector == b.projector
    np.testing.assert_allclose(a.T_projector_camera, b.T_projector_camera, atol=1e-12)
    if covariance:
        np.testing.assert_allclose(a.covariance, b.covariance, rtol=1e-6)
        assert a.residual_px == b.residual_px


def test_toml_keeps_everything(tmp_path):
    found = calibrated(4).rig
    path = write_rig(tmp_path / "rig.toml", found)
    same(read_rig(path), found)
    text = path.read_text()
    assert "mm" in text.split("kind")[0]  # units, for people
    assert len(text.splitlines()) < 120
    bare = replace(found, covariance=None)
    assert read_rig(write_rig(tmp_path / "bare.toml", bare)).covariance is None


def test_unknown_residuals_stay_unknown(tmp_path):
    unknown = replace(calibrated(4).rig, residual_px=None)
    for name in ("rig.toml", "rig.xml"):
        assert read_rig(write_rig(tmp_path / name, unknown)).residual_px is None
    known = read_rig(write_rig(tmp_path / "known.toml", calibrated(4).rig))
    assert known.residual_px == calibrated(4).rig.residual_px


@pytest.mark.parametrize("name", ["rig.xml", "rig.yml", "rig.yaml"])
def test_opencv_files_go_both_ways(tmp_path, name):
    path = write_rig(tmp_path / name, rig())
    same(read_rig(path), rig(), covariance=False)
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert storage.getNode("camera_matrix").mat()[0, 0] == rig().camera.focal_px[0]


def test_files_of_other_programs_are_read(tmp_path):
    path = tmp_path / "other.xml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("img_shape", np.array([[1024.0], [1280.0]]))
    for name in ("cam_int", "proj_int"):
        storage.write(name, np.array([[3000.0, 0, 600], [0, 3001, 500], [0, 0, 1]]))
    for name in ("cam_dist", "proj_dist"):
        storage.write(name, np.array([[-0.1, 0.2, 0, 0]]))
    storage.write("roration", np.eye(3))
    storage.write("translation", np.array([[100.0], [0], [0]]))
    storage.release()
    with pytest.raises(InputError, match="missing projector_size"):
        read_rig(path)
    found = read_rig(path, projector_size=(1024, 768))
    assert found.camera.width_px == 1280
    assert found.projector.height_px == 768
    assert found.camera.distortion == (-0.1, 0.2, 0.0, 0.0, 0.0)


K = np.array([[2195.0, 0, 843.5], [0, 2195, 675.5], [0, 0, 1]])
TURN = cv2.Rodrigues(np.array([0.1, 0.2, -0.1]))[0]
PROGRAMS = {
    # Names as the programs' sources write them; sizes; residuals of camera and projector.
    "SLStudio": (
        "Kc kc Kp kp Rp Tp",
        {"frameWidth": 1688, "frameHeight": 1352, "screenResX": 1824, "screenResY": 1140, "cam_error": 0.28, "proj_error": 0.46, "stereo_error": 0.42},
        (0.42, 0.42),
    ),
    "SLMaster": ("M1 D1 M4 D4 Rlp Tlp", {"S": np.array([[1688.0], [1352.0]]), "K1": np.eye(3)}, None),
    "sltk": (
        "cam_K cam_kc pro_K pro_kc R T",
        {"cam_size": np.array([[1688], [1352]]), "pro_size": np.array([[1824], [1140]]), "cam_rms": -1.0, "pro_rms": 0.3, "stereo_rms": 0.5},
        (0.5, 0.5),
    ),
    "scan3d-capture": ("cam_K cam_kc proj_K proj_kc R T", {"cam_error": 0.2, "proj_error": 0.3}, (0.2, 0.3)),
    "OpenCV": ("M1 D1 M2 D2 R T", {}, None),
}  # fmt: skip


@pytest.mark.parametrize("suffix", [".xml", ".yml"])
@pytest.mark.parametrize("program", PROGRAMS)
def test_programs_are_read_by_their_names(tmp_path, program, suffix):
    names, more, residual = PROGRAMS[program]
    path = tmp_path / f"rig{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    values = (K, np.full((5, 1), 0.01), 1.2 * K + np.diag([0, 0, -0.2]), np.full((1, 5), 0.02))
    values += (TURN.astype(np.float32), np.array([[-145.0], [-36], [68]], np.float32))
    for name, value in zip(names.split(), values, strict=True):
        storage.write(name, value)
    for name, value in more.items():
        storage.write(name, value)
    storage.release()
    sizes = {"camera_size": (1688, 1352), "projector_size": (1824, 1140)}
    found = read_rig(path, **sizes)
    assert (found.camera.width_px, found.projector.height_px) == (1688, 1140)
    assert found.projector.focal_px == pytest.approx((2634.0, 2634.0))
    assert found.camera.distortion == (0.01,) * 5
    np.testing.assert_allclose(found.T_projector_camera[:3, :3], TURN, atol=1e-6)
    assert found.baseline_mm == pytest.approx(np.linalg.norm([145, 36, 68]))
    if residual is not None:
        assert found.residual_px == residual
    with pytest.raises(InputError, match="missing projector_size|camera_size: expected 1688"):
        read_rig(path, camera_size=(99, 99))


def test_a_rig_in_metres_is_noted_and_converted(tmp_path):
    r = rig()
    T = r.T_projector_camera.copy()
    T[:3, 3] /= 1000.0
    path = write_rig(tmp_path / "metres.xml", replace(r, T_projector_camera=T, covariance=None))
    assert unit_findings(r) == ()
    (finding,) = unit_findings(read_rig(path))
    assert "1000 times too small" in finding.text
    found = read_rig(path, unit_mm=1000.0)
    assert found.baseline_mm == pytest.approx(r.baseline_mm)
    assert unit_findings(found) == ()
    for unit in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(InputError, match="unit_mm: expected > 0"):
            read_rig(path, unit_mm=unit)
    ours = write_rig(tmp_path / "rig.toml", r)
    with pytest.raises(InputError, match="unit_mm: expected with a file of OpenCV"):
        read_rig(ours, unit_mm=1.0)
    out = tmp_path / "out.toml"
    assert run(["rig", "convert", str(path), "--out", str(out), "--unit-mm", "1000"]) == 0
    assert read_rig(out).baseline_mm == pytest.approx(r.baseline_mm)


def test_matrices_that_are_no_such_thing_are_refused(tmp_path):
    for name, value, words in (
        ("camera_matrix", K + np.array([[0, 5.0, 0], [0, 0, 0], [0, 0, 0]]), "fx 0 cx"),
        ("rotation", 1.1 * TURN, "expected a rotation matrix"),
        ("translation", np.zeros((2, 1)), "expected 3 values, got 2"),
        ("projector_distortion", np.full((1, 14), 0.1), "five coefficients"),
    ):
        path = write_rig(tmp_path / "rig.xml", rig())
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        good = {
            "camera_size": np.array([[1688, 1352]]),
            "projector_size": np.array([[1824, 1140]]),
            **dict.fromkeys(("camera_matrix", "projector_matrix"), K),
            **dict.fromkeys(("camera_distortion", "projector_distortion"), np.zeros((1, 5))),
            "rotation": TURN,
            "translation": np.array([[100.0], [0], [0]]),
        }
        for key, matrix in (good | {name: value}).items():
            storage.write(key, matrix)
        storage.release()
        with pytest.raises(InputError, match=words):
            read_rig(path)


@pytest.mark.parametrize("suffix", [".xml", ".yml"])
@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("rows", "4", r"expected rows × cols numbers \(4 × 3\), got 9"),
        ("cols", "2", r"expected rows × cols numbers \(3 × 2\), got 9"),
        ("rows", "-3", "expected rows × cols numbers"),
        ("rows", "1000000000", "expected rows × cols numbers"),
        ("rows", "3.0", "expected rows and cols as whole numbers"),
        ("rows", None, "expected rows and cols as whole numbers"),
        ("dt", '"2d"', "expected rows × cols numbers"),
        ("dt", "text", "expected a type of numbers as dt, such as d, got text"),
        ("dt", None, "expected a type of numbers as dt, such as d, got none"),
        ("data", None, "expected a matrix of numbers, got something else"),
        ("data", "1. 2. 3.", r"expected rows × cols numbers \(3 × 3\), got 3"),
        ("data", "1. .Nan 3. 4. 5. 6. 7. 8. 9.", "expected finite values"),
        ("data", "1. .Inf 3. 4. 5. 6. 7. 8. 9.", "expected finite values"),
        ("data", "1. x 3. 4. 5. 6. 7. 8. 9.", "FileStorage|expected a matrix of numbers"),
    ],
)
@pytest.mark.parametrize("name", ["camera_matrix", "rotation"])
def test_matrices_hold_the_numbers_that_they_declare(tmp_path, suffix, name, key, value, message):
    path = write_rig(tmp_path / f"rig{suffix}", rig())
    text = path.read_text()
    before, matrix = text[: text.index(name)], text[text.index(name) :]
    if suffix == ".xml":
        old, new = rf"<{key}>.*?</{key}>", "" if value is None else f"<{key}>{value}</{key}>"
    else:
        listed = f"[ {', '.join(value.split())} ]" if value and key == "data" else value
        old = rf"{key}: (\[.*?\]|\S+)"
        new = "other: 0" if value is None else f"{key}: {listed}"
    path.write_text(before + re.sub(old, new, matrix, count=1, flags=re.DOTALL))
    with pytest.raises(InputError, match=message) as caught:
        read_rig(path)
    assert "\n" not in str(caught.value)


def test_a_matrix_of_nine_rows_is_no_matrix_of_three(tmp_path):
    path = write_rig(tmp_path / "rig.yml", rig())
    before, matrix = path.read_text().split("camera_matrix", 1)
    nine = matrix.replace("rows: 3", "rows: 9", 1).replace("cols: 3", "cols: 1", 1)
    path.write_text(f"{before}camera_matrix{nine}")
    with pytest.raises(InputError, match="camera_matrix: expected 3 rows and 3 cols, got 9 and 1"):
        read_rig(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('kind = "rig"', 'kind = "plan"', "kind"),
        ("[camera]", "[camera]\nfov = 3", "unknown key camera.fov"),
        ("focal_px", "focal", "missing key camera.focal_px|unknown key camera.focal"),
        ('"camera fx"', '"fx"', "uncertainty.parameters: expected camera fx"),
        ("translation_mm = [", "translation_mm = [1.0, ", "translation_mm"),
        ("rotation = [", "rotation = 3\nother = [", "rotation"),
    ],
)
def test_damaged_rig_files_are_named(tmp_path, old, new, message):
    path = tmp_path / "rig.toml"
    path.write_text(format_rig(calibrated(4).rig).replace(old, new, 1))
    with pytest.raises(InputError, match=message) as caught:
        read_rig(path)
    assert str(path) in str(caught.value)


def test_what_is_no_rig_file_is_refused(tmp_path):
    (tmp_path / "a.xml").write_text("no xml")
    (tmp_path / "b.xml").write_text('<?xml version="1.0"?><opencv_storage></opencv_storage>')
    for name, message in (
        ("a.xml", "FileStorage"),
        ("b.xml", "missing matrix camera_matrix"),
        ("c.toml", "no such"),
    ):
        with pytest.raises(InputError, match=message):
            read_rig(tmp_path / name)
    with pytest.raises(InputError, match="expected one of"):
        write_rig(tmp_path / "rig.json", rig())
    with pytest.raises(InputError, match="writable folder"):
        write_rig(tmp_path / "none" / "rig.toml", rig())


def cloud():
    view, decoded = scene("sphere")
    return triangulate(decoded, rig(), colour=view.albedo)


@pytest.mark.parametrize("name", ["points.ply", "points.xyz", "points.npz"])
def test_points_come_back(tmp_path, name):
    written = cloud()
    write_points(tmp_path / name, written)
    found = read_points(tmp_path / name)
    ok = written.reason == Reason.OK
    np.testing.assert_allclose(found.xyz_mm, written.xyz_mm[ok], atol=1e-4)
    np.testing.assert_allclose(found.sigma_mm, written.sigma_mm[ok], atol=1e-5)


def test_npz_keeps_the_frame(tmp_path):
    finding = Finding("noise", "noise of 9 counts", ("a cause",), "advice", frames=("frame 1",))
    pixels = Pixels(3, 10, Region(1, 2, 3, 4))
    figures = {"share": 0.3, "unknown_mm": float("nan")}
    other = Finding("unit", "a remark", axis="x", figures=figures, severity="note", pixels=pixels)
    written = replace(cloud(), findings=(finding, other))
    write_points(tmp_path / "p.npz", written)
    found = read_cloud(tmp_path / "p.npz")
    np.testing.assert_array_equal(found.xyz_mm, written.xyz_mm)
    np.testing.assert_array_equal(found.reason, written.reason)
    assert found.residual_px is None
    assert found.findings == written.findings
    notes = (finding.text, "a remark")
    assert found.notes == read_points(tmp_path / "p.npz").notes == notes


def test_ply_is_read_by_others(tmp_path):
    import trimesh

    written = cloud()
    write_points(tmp_path / "mesh.ply", written, kind="mesh")
    found = trimesh.load(tmp_path / "mesh.ply", process=False)
    assert len(found.vertices) == (written.reason == Reason.OK).sum()
    assert len(found.faces) == len(cloud_triangles(written))
    # Triangles face the camera.
    towards = np.einsum("nk,nk->n", found.face_normals, found.triangles_center)
    assert (towards < 0).mean() > 0.99


def test_text_and_big_endian_ply_are_read(tmp_path):
    points = np.arange(12.0).reshape(4, 3)
    header = "ply\nformat {}\nelement vertex 4\nproperty {t} x\nproperty {t} y\nproperty {t} z\nend_header\n"
    text = header.replace("{t}", "double").format("ascii 1.0")
    (tmp_path / "t.ply").write_text(text + "\n".join(" ".join(map(str, p)) for p in points) + "\n")
    big = header.replace("{t}", "float").format("binary_big_endian 1.0").encode()
    (tmp_path / "b.ply").write_bytes(big + points.astype(">f4").tobytes())
    for name in ("t.ply", "b.ply"):
        np.testing.assert_array_equal(read_points(tmp_path / name).xyz_mm, points)


def test_damaged_points_are_named(tmp_path):
    write_points(tmp_path / "p.ply", cloud())
    whole = (tmp_path / "p.ply").read_bytes()
    (tmp_path / "short.ply").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "none.ply").write_bytes(b"nothing at all")
    (tmp_path / "words.xyz").write_text("one two three\n")
    (tmp_path / "two.xyz").write_text("1 2\n3 4\n")
    (tmp_path / "bad.npz").write_bytes(b"PK")
    (tmp_path / "p.stl").write_bytes(b"solid")
    for name in ("short.ply", "none.ply", "words.xyz", "two.xyz", "bad.npz", "p.stl", "gone.ply"):
        with pytest.raises(InputError, match=name):
            read_points(tmp_path / name)


def test_nothing_is_not_written(tmp_path):
    written = cloud()
    empty = replace(written, reason=np.full_like(written.reason, Reason.SHADOW))
    with pytest.raises(InputError, match="expected points to write"):
        write_points(tmp_path / "empty.ply", empty)
    with pytest.raises(InputError, match="expected one of"):
        write_points(tmp_path / "p.obj", written)
    assert not list(tmp_path.iterdir())


def test_a_lens_that_folds_the_image_is_refused(tmp_path):
    """A calibration that failed: no lens folds the image around its middle."""
    known = rig()
    failed = replace(known.projector, distortion=(27.6, -2344.0, 7.97, 10.36, 0.0))
    for path in (tmp_path / "rig.toml", tmp_path / "rig.yml"):
        write_rig(path, replace(known, projector=failed))
        with pytest.raises(RigMismatch, match=r"projector: its lens .* folds the image \d+ px"):
            read_rig(path)
    # A wide angle, and a polynomial that turns round in the corners only, where no point lay.
    corner = float(np.hypot(*known.camera.shape[::-1]) / 2 / known.camera.focal_px[0])
    for distortion in ((-0.3, 0.1, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, -0.17 / corner**6)):
        write_rig(
            tmp_path / "rig.toml",
            replace(known, camera=replace(known.camera, distortion=distortion)),
        )
        assert read_rig(tmp_path / "rig.toml").camera.distortion == distortion
