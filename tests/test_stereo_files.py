"""Rigs of two cameras in the files of other programs."""

from __future__ import annotations

import json

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.files import read_stereo_rig
from fringeworks.files.named_numbers import read_numbers
from fringeworks.rig.pinhole import look_at
from fringeworks.types import FileProblem, MultiRig, Pinhole
from tests.commands import run

cv2 = pytest.importorskip("cv2")

SIZES = ((640, 480), (656, 472))
LENSES = ((-0.1, 0.12, 4e-4, -3e-4, 0.02), (-0.08, 0.06, -2e-4, 5e-4, -0.01))
ONE = Pinhole(*SIZES[0], (1075.25, 1076.5), (323.25, 253.5), LENSES[0])
OTHER = Pinhole(*SIZES[1], (1139.5, 1138.0), (315.75, 261.25), LENSES[1])
POSE = look_at(np.array([190.0, 9.0, 30.0]), np.array([0.0, 0.0, 500.0]))
R, T = np.ascontiguousarray(POSE[:3, :3]), POSE[:3, 3:].copy()
RIG = MultiRig((ONE, OTHER), None, None, np.stack((np.eye(4), POSE)))


def matrix(device: Pinhole, origin: float = 0.0):
    """The camera matrix, with pixels that count from ``origin``."""
    (fx, fy), (cx, cy) = device.focal_px, device.principal_px
    return np.array([[fx, 0.0, cx + origin], [0.0, fy, cy + origin], [0.0, 0.0, 1.0]])


K1, K2, D1, D2 = matrix(ONE), matrix(OTHER), np.array([LENSES[0]]), np.array([LENSES[1]])


def storage(path, **content):
    """A file as cv::FileStorage writes it."""
    out = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in content.items():
        out.write(name, value)
    out.release()
    return path


def check(found, tolerance: float = 1e-9):
    assert found.projector is None
    for one, other in zip(found.cameras, RIG.cameras, strict=True):
        assert one.shape == other.shape
        assert np.abs(one.parameters - other.parameters).max() < 1000.0 * tolerance
    assert np.abs(found.T_camera_first[1] - POSE).max() < 1000.0 * tolerance


def test_opencv_s_stereo_calib_writes_two_files(tmp_path):
    inner = storage(tmp_path / "intrinsics.yml", M1=K1, D1=D1, M2=K2, D2=D2)
    R1, R2, P1, P2, Q, *_ = cv2.stereoRectify(K1, D1, K2, D2, SIZES[0], R, T)
    outer = storage(tmp_path / "extrinsics.yml", R=R, T=T, R1=R1, R2=R2, P1=P1, P2=P2, Q=Q)
    check(read_stereo_rig(inner, outer, camera_sizes=SIZES))
    for one in (inner, outer):
        with pytest.raises(FileProblem, match="two files"):
            read_stereo_rig(one, camera_sizes=SIZES)
    rectified = read_stereo_rig(outer, camera_sizes=SIZES, rectified=True)
    assert rectified.cameras[0].focal_px == (P1[0, 0], P1[1, 1])
    assert rectified.cameras[1].distortion == (0.0,) * 5
    baseline = np.linalg.norm(rectified.T_camera_first[1][:3, 3])
    assert baseline == pytest.approx(np.linalg.norm(T), rel=1e-9)


@pytest.mark.parametrize("suffix", [".yml", ".xml", ".json"])
def test_names_of_opencv_s_documentation(tmp_path, suffix):
    names = {"cameraMatrix1": K1, "distCoeffs1": D1, "cameraMatrix2": K2, "distCoeffs2": D2}
    path = storage(tmp_path / f"stereo{suffix}", **names, R=R, T=T / 1000.0)
    check(read_stereo_rig(path, camera_sizes=SIZES, unit_mm=1000.0))
    with pytest.raises(FileProblem, match="camera_size"):
        read_stereo_rig(path)


@pytest.mark.parametrize("suffix", [".yml", ".xml", ".json"])
def test_sizes_that_opencv_writes_as_arrays(tmp_path, suffix):
    """OpenCV 5 writes an array of one dimension in another way than a matrix."""
    names = {"M1": K1, "D1": D1.ravel(), "M2": K2, "D2": D2.ravel(), "R": R, "T": T.ravel()}
    path = storage(tmp_path / f"stereo{suffix}", **names, imageSize=np.array(SIZES[0]))
    found = read_stereo_rig(path)
    assert [camera.shape for camera in found.cameras] == [SIZES[0][::-1]] * 2
    assert np.abs(found.T_camera_first[1] - POSE).max() < 1e-6


def test_a_missing_size_says_how_to_state_it(tmp_path):
    path = storage(tmp_path / "s.yml", M1=K1, D1=D1, M2=K2, D2=D2, R=R, T=T)
    done = run("rig", "convert", path, "--cameras", "--out", tmp_path / "r.toml", code=2)
    assert "rig convert --camera-size 1280x1024" in done.stderr


def test_json_of_left_and_right(tmp_path):
    flat = {
        "camera_matrix_left": K1.tolist(),
        "dist_coeffs_left": D1.tolist(),
        "camera_matrix_right": K2.tolist(),
        "dist_coeffs_right": D2.tolist(),
        "R": R.tolist(),
        "T": T.ravel().tolist(),
        "date": "2024-05-01",
    }
    path = tmp_path / "flat.json"
    path.write_text(json.dumps(flat), encoding="utf-8")
    check(read_stereo_rig(path, camera_sizes=SIZES))
    cameras = {
        name: {"K": K.tolist(), "D": D.ravel().tolist(), "size": list(size)}
        for name, K, D, size in zip(("left", "right"), (K1, K2), (D1, D2), SIZES, strict=True)
    }
    path.write_text(json.dumps({"stereo": cameras | {"R": R.tolist(), "T": T.tolist()}}))
    check(read_stereo_rig(path))
    with pytest.raises(FileProblem, match="640 × 480"):
        read_stereo_rig(path, camera_sizes=((641, 480), SIZES[1]))
    del flat["dist_coeffs_right"]
    path.write_text(json.dumps(flat))
    with pytest.raises(FileProblem, match="missing distortion"):
        read_stereo_rig(path, camera_sizes=SIZES)


def rows(values) -> str:
    return (
        "[" + "; ".join(" ".join(f"{v:.15g}" for v in row) for row in np.atleast_2d(values)) + "]"
    )


def test_text_of_matlab_s_stereo_parameters(tmp_path):
    """Its matrices are transposed, its pixels count from 1, its sizes are rows and columns."""
    text = "% stereoParams, written by a script\n"
    for number, device in enumerate(RIG.cameras, 1):
        name, k = f"stereoParams.CameraParameters{number}", device.distortion
        text += f"{name}.IntrinsicMatrix = {rows(matrix(device, 1.0).T)};\n"
        text += f"{name}.RadialDistortion = {rows([k[0], k[1], k[4]])};\n"
        text += f"{name}.TangentialDistortion = {rows(k[2:4])};\n"
        text += f"{name}.ImageSize = {rows(device.shape)};\n"
    text += f"stereoParams.RotationOfCamera2 = {rows(R.T)};\n"
    text += f"stereoParams.TranslationOfCamera2 = {rows(T.T)};\n"
    path = tmp_path / "stereo.txt"
    path.write_text(text, encoding="utf-8")
    check(read_stereo_rig(path))


def test_matrices_as_matlab_shows_them(tmp_path):
    text = ""
    for name, value in {
        "K1": K1,
        "K2": K2,
        "distCoeffs1": D1,
        "distCoeffs2": D2,
        "R": R,
        "T": T,
    }.items():
        lines = "\n".join("  ".join(f"{v / 1000:14.12f}" for v in row) for row in value)
        text += f"\n{name} =\n\n   1.0e+03 *\n\n{lines}\n\n"
    path = tmp_path / "shown.txt"
    path.write_text(text, encoding="utf-8")
    check(read_stereo_rig(path, camera_sizes=SIZES), 1e-6)


def test_bouguet_s_toolbox(tmp_path):
    text = ""
    for side, device in zip(("left", "right"), RIG.cameras, strict=True):
        for name, values in (
            ("fc", device.focal_px),
            ("cc", device.principal_px),
            ("kc", device.distortion),
        ):
            text += f"{name}_{side} = [ {' ; '.join(f'{v:.15g}' for v in values)} ];\n"
        text += f"alpha_c_{side} = 0.000000;\n"
    turn = cv2.Rodrigues(R)[0]
    text += f"om = {rows(turn)};\nT = {rows(T)};\n"
    path = tmp_path / "Calib_Results_stereo.m"
    path.write_text(text, encoding="utf-8")
    check(read_stereo_rig(path, camera_sizes=SIZES), 1e-8)


def test_damaged_files_are_refused(tmp_path):
    for name, text in {
        "a.json": '{"M1": [[1, 2], [3',
        "b.yml": "%YAML:1.0\n---\nM1: [1, 2\n",
        "c.txt": "nothing of a rig",
        "d.json": "[" * 2000,
    }.items():
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        with pytest.raises(FileProblem):
            read_stereo_rig(path, camera_sizes=SIZES)
    with pytest.raises(FileProblem, match="missing camera matrices"):
        read_stereo_rig(storage(tmp_path / "e.yml", M1=K1), camera_sizes=SIZES)
    turned = {"M1": K1, "D1": D1, "M2": K2, "D2": D2, "T": T}
    with pytest.raises(FileProblem, match="rotation"):
        read_stereo_rig(storage(tmp_path / "f.yml", R=2 * R, **turned), camera_sizes=SIZES)
    wide = turned | {"D1": np.linspace(0.1, 0.8, 8)[None]}
    with pytest.raises(FileProblem, match="five coefficients"):
        read_stereo_rig(storage(tmp_path / "g.yml", R=R, **wide), camera_sizes=SIZES)
    with pytest.raises(fw.InputError, match="unit_mm"):
        read_stereo_rig(tmp_path / "g.yml", unit_mm=-1.0)


def test_convert_writes_a_rig_without_a_projector(tmp_path):
    inner = storage(tmp_path / "intrinsics.yml", M1=K1, D1=D1, M2=matrix(OTHER), D2=D2)
    outer = storage(tmp_path / "extrinsics.yml", R=R, T=T)
    out = tmp_path / "rig.toml"
    run(
        *("rig", "convert", inner, "--with", outer, "--cameras"),
        *("--camera-size", "640x480", "--out", out),
    )
    found = fw.files.read_multi_rig(out)
    assert found.projector is None
    assert found.cameras[0] == ONE
    done = run("rig", "convert", inner, "--with", outer, "--out", out, code=2)
    assert "--cameras" in done.stderr
    done = run(
        *("rig", "convert", inner, "--cameras", "--bin", "2", "--out", out),
        code=2,
    )
    assert "cannot be combined" in done.stderr


def test_numbers_keep_their_names(tmp_path):
    path = tmp_path / "names.m"
    path.write_text("a.b = [1, 2; 3 4]; % [9]\nc = -1.5e-3;\nwords = 'none';\n", encoding="utf-8")
    found = read_numbers(path)
    assert np.array_equal(found["a.b"], [[1.0, 2.0], [3.0, 4.0]])
    assert found["c"] == -0.0015
    assert set(found) == {"a.b", "c"}


@pytest.mark.parametrize("name", ["maps.yml", "maps.xml"])
def test_maps_for_rectification_say_what_to_bring(tmp_path, name):
    turned, _, P1, P2, *_ = cv2.stereoRectify(K1, D1, K2, D2, SIZES[0], R, T)
    maps = cv2.initUndistortRectifyMap(K1, D1, turned, P1, SIZES[0], cv2.CV_32FC1)
    path = storage(tmp_path / name, P1=P1, P2=P2, map1x=maps[0], map1y=maps[1])
    for read in (read_stereo_rig, fw.files.read_rig):
        with pytest.raises(
            FileProblem, match="got maps of 640 × 480 px.*P1 and P2 of stereoRectify"
        ):
            read(path)
    alone = storage(tmp_path / "p.yml", P1=P1, P2=P2)
    assert read_stereo_rig(alone, camera_sizes=(SIZES[0],) * 2).cameras[0].shape == (480, 640)
    np.savez(tmp_path / "maps.npz", map1x=maps[0])
    with pytest.raises(FileProblem, match="maps for undistortion hold no rig"):
        fw.files.read_rig(tmp_path / "maps.npz")
