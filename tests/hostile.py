"""Damaged files for every reader: what is mutated, and how."""

from __future__ import annotations

import io
import itertools
import random
import struct
import tempfile
import warnings
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import h5py
import numpy as np
import scipy.io
import tifffile
import trimesh
import zarr
from PIL import Image

import fringeworks as fw
from fringeworks.types import made_by
from tests.cameras import small_rig
from tests.hostile_structure import damaged
from tests.qif_documents import LEFT, TAKEN, document

FOLDER = "capture"
TOML_WORDS = (
    b"nan",
    b"inf",
    b"-1",
    b"0",
    b"9" * 5000,
    b"1e400",
    b'""',
    b"[" * 5000,
    b"'" + b"a" * 5000 + b"'",
    b"true",
    b"{}",
    b"a." * 200 + b"b=1",
    b'"../../../etc/passwd"',
    b'"a\\u0000b"',
    b"0x" + b"f" * 6000,
    b"\xff",
    b"1979-05-27",
)
TEXT_WORDS = (
    b"nan", b"inf", b".Inf", b"-1", b"0", b"1e400", b"9" * 400, b"1" + b"0" * 30, b"<a>" * 500, b"</data>",
    b"&lt;", b"<!DOCTYPE a [<!ENTITY b 'c'>]>", b"\0", b"\xff\xfe", b"property list uchar int z", b"[", b"{", b"\n",
)  # fmt: skip
BYTE_WORDS = (
    b"\0\0\0\0", b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\xff\xff\xff\x7f", b"\x80", b"\0\0\0\x80", b"\x01\0",
)  # fmt: skip


class Target(NamedTuple):
    """A reader, and a good file for it."""

    name: str
    content: bytes
    read: Callable[[Path], Any]
    words: tuple[bytes, ...]
    beside: dict[str, bytes] = {}  # noqa: RUF012
    share: float = 1.0
    """Of the files: readers that start a process, or read many files, get fewer."""


def mutations(target: Target, count: int, seed: int) -> Iterator[bytes]:
    """Damaged versions of a good file: bytes, words, pieces, and the file's end; every other one by
    its structure, where it has one that is known."""
    rng = np.random.default_rng([seed, *target.name.encode()])
    structured = random.Random(f"{seed} {target.name}")
    for number in range(count):
        if number % 2 and (found := damaged(target.content, target.name, structured)) is not None:
            yield found
            continue
        data = bytearray(target.content)
        for _ in range(int(rng.integers(1, 4))):
            # Headers decide on sizes: half of the damage is at the beginning.
            reach = len(data) if rng.random() < 0.5 else min(len(data), 400)
            at = int(rng.integers(0, max(reach, 1)))
            match int(rng.integers(0, 6)):
                case 0:
                    data[at : at + 1] = bytes([int(rng.integers(0, 256))])
                case 1:
                    word = target.words[int(rng.integers(0, len(target.words)))]
                    data[at : at + len(word) if rng.random() < 0.5 else at] = word
                case 2:
                    del data[at : at + int(rng.integers(1, 40))]
                case 3:
                    data[at:at] = data[at : at + int(rng.integers(1, 40))]
                case 4:
                    del data[at:]
                case 5:
                    # A whole value of a text.
                    end = next((k for k in range(at, len(data)) if data[k] in b" \n,<]"), len(data))
                    data[at:end] = target.words[int(rng.integers(0, len(target.words)))]
        yield bytes(data)


def _written(folder: Path, name: str, write: Callable[[Path], Any]) -> bytes:
    write(folder / name)
    return (folder / name).read_bytes()


def _image(kind: str, array: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(array).save(buffer, kind)
    return buffer.getvalue()


def _surface() -> fw.HeightMap:
    rng = np.random.default_rng(0)
    values = rng.random((9, 12))
    reason = np.zeros((9, 12), np.uint8)
    origin = made_by("reconstruct", options={"method": "fourier"})
    return fw.HeightMap(values, values, reason, "height", "mm", 0.5, "fourier", origin)


def _cloud() -> fw.PointCloud:
    xyz = np.random.default_rng(0).random((6, 7, 3))
    return fw.PointCloud(
        xyz, xyz[..., 0], xyz[..., 1], np.zeros((6, 7), np.uint8), colour=xyz[..., 2]
    )


def _opencv(names: str, suffix: str, **more: Any) -> bytes:
    kind = cv2.FILE_STORAGE_FORMAT_XML if suffix == ".xml" else cv2.FILE_STORAGE_FORMAT_YAML
    storage = cv2.FileStorage("", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | kind)
    K = np.array([[2000.0, 0, 640], [0, 2000, 512], [0, 0, 1]])
    values = (
        K,
        np.full((1, 5), 0.01),
        K,
        np.full((1, 5), 0.02),
        np.eye(3),
        np.array([[100.0], [1], [2]]),
    )
    for name, value in zip(names.split(), values, strict=True):
        storage.write(name, value)
    for name, value in more.items():
        storage.write(name, value)
    return storage.releaseAndGetString().encode()


def _mat(arrays: dict[str, np.ndarray], compressed: bool) -> bytes:
    buffer = io.BytesIO()
    scipy.io.savemat(buffer, arrays, do_compression=compressed)
    return buffer.getvalue()


def _hdf5(arrays: dict[str, np.ndarray]) -> bytes:
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        for name, array in arrays.items():
            file[name] = array.T
    return buffer.getvalue()


def _npz(**arrays: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def _tiff(array: np.ndarray, **options: Any) -> bytes:
    buffer = io.BytesIO()
    tifffile.imwrite(buffer, array, **options)
    return buffer.getvalue()


PLAN = b"""kind = "plan"
projector = [64, 48]
[[sequence]]
kind = "phase"
axis = "x"
period_px = 16.0
steps = 3
[[sequence]]
kind = "gray"
axis = "x"
step_px = 16.0
[[sequence]]
kind = "white"
"""
PLY = b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
PLY += b"element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n1 1 2\n3 0 1 2\n"

STEP = Path(__file__).parent / "drawings" / "inch.step"
STEREO = b"""K1 = [80 0 32; 0 80 24; 0 0 1]; D1 = [0 0 0 0 0];
K2 = [81 0 31; 0 81 25; 0 0 1]; D2 = [0 0 0 0 0];
R = [1 0 0; 0 1 0; 0 0 1]; T = [-120 0 0];
"""


RECIPE = b"""kind = "recipe"
method = "windowed"
plan = "plan.toml"
within = "face"
risk = 0.05
[options]
degree = 3
[areas.face]
box = [1, 2, 10, 12]
[areas.rim]
polygon = [[0.0, 0.0], [9.0, 0.0], [5.0, 8.0]]
[areas.hole]
mask = "m.png"
[[tolerances]]
name = "step"
quantity = "step_height"
areas = ["face", "rim"]
min = -0.1
max = 0.1
"""
SEEN = (fw.Finding("noise", "seen"),)
SETUP = b"""plan = "plan.toml"
predicted_sigma_px = 0.05
findings = [{kind = "flicker", seen = "the lamp flickers", causes = ["mains"], advice = "another lamp", severity = "warning", frames = [], figures = {}}]
[projector]
open = "window:0"
name = "beamer"
size_px = [64, 48]
gamma = 2.2
contrast = 0.9
min_period_px = 4.0
[camera]
open = "webcam:0"
name = "left"
modulation = 40.0
black_counts = 5.0
[settings]
exposure_ms = 16.0
region = [0, 0, 64, 48]
averaged = 2
[noise]
read_counts = 1.0
gain = 0.02
[delay]
appears_s = 0.01
absent_s = 0.02
alone_s = 0.05
left_s = 0.06
refresh_s = 0.0166
frame_s = 0.033
transit_s = [0.01, 0.02]
"""
EXPOSURES = b"""kind = "exposures"
[[exposures]]
folder = "0"
exposure_ms = 4.0
[[exposures]]
folder = "1"
exposure_ms = 16.0
gain_db = 0.0
"""


def _zarr_files(array: np.ndarray) -> dict[str, bytes]:
    """The files of a Zarr array of format 3."""
    with tempfile.TemporaryDirectory() as place:
        zarr.create_array(f"{place}/a", data=array, chunks=(1, *array.shape[1:]))
        files = (path for path in Path(place, "a").rglob("*") if path.is_file())
        return {str(path.relative_to(f"{place}/a")): path.read_bytes() for path in files}


def _frames_of(path: Path) -> int:
    """Read the first frames: a sequence may be of any length, and frames of zeros take no space."""
    return sum(frame.size > 0 for frame in itertools.islice(fw.files.read_sequence(path), 20))


def targets(folder: Path) -> list[Target]:
    """Every reader with a good file."""
    rng = np.random.default_rng(1)
    grey = rng.integers(0, 255, (24, 32), dtype=np.uint8)
    frames = rng.integers(0, 255, (6, 24, 32), dtype=np.uint8)
    pair = {"S": grey, "D": grey.astype(np.float64)}
    capture = (
        b'kind = "pair"\naxis = "x"\nmask = "a.png"\ntruth = "t.tif"\n[frames]\nreference = "a.png"\n'
        b'object = "a.png"\n[geometry]\ndistance_mm = 500.0\nbaseline_mm = 200.0\npitch_mm_per_px = 1.0\n'
        b'[devices]\ncamera = "left"\n'
    )
    stack = b'kind = "stack"\nplan = "plan.toml"\nframes = "s.tif"\nsaturation = 255\n'
    rig = fw.Rig(
        *(fw.rig.Pinhole(640, 480, (900.0, 900.0), (320.0, 240.0)) for _ in range(2)),
        np.array([[1.0, 0, 0, 100], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
        np.eye(24),
        (0.1, 0.2),
        made_by("calibrate", options={}),
    )
    response = fw.Response("left", "bench", 2.2, 3, 1.0, np.zeros((2, 256)), (10.0, 200.0), 0.01)
    from fringeworks.types import CameraNoise

    flat = np.zeros((5, 6), np.float32)
    codes = fw.stack.CoordinateMap(
        flat, flat, flat, flat, flat.astype(np.uint8), "x", (16.0, 90.0), np.stack([flat] * 2)
    )
    decoded = fw.Decoded(codes, None, CameraNoise(1.0), SEEN)
    wrapped = fw.stack.WrappedPhase(
        flat, flat, flat, flat, flat.astype(np.uint8), (0.0, 1.0, 2.0), CameraNoise(1.0), SEEN
    )
    law = fw.pair.PixelCalibration(flat + 1, flat, (1.0, 9.0), pitch_mm_per_px=0.5)
    surface, cloud = _surface(), _cloud()
    light = fw.stack.LightSeparation(
        flat, flat, flat, flat, flat.astype(np.uint8), 24.0, True, findings=SEEN
    )
    box = trimesh.creation.box((3.0, 4.0, 5.0))
    png, tif = _image("PNG", grey), _tiff(grey.astype(np.float64))
    planned = {"plan.toml": PLAN}
    arrays = _zarr_files(frames)
    shots = _tiff(frames, photometric="minisblack")
    still = {"plan.toml": PLAN, "s.tif": shots, "capture.toml": stack}

    def npz(name: str, write: Callable[[Path], Any], read: Callable[[Path], Any]) -> Target:
        return Target(name, _written(folder, name, write), read, BYTE_WORDS)

    def on_surface(path: Path) -> fw.HeightMap:
        found = fw.files.read_surface(path)
        assert found.values.ndim == 2
        return found

    return [
        Target("a.png", png, fw.files.read_frame, BYTE_WORDS),
        Target("a.jpg", _image("JPEG", grey), fw.files.read_frame, BYTE_WORDS),
        Target("a.bmp", _image("BMP", grey), fw.files.read_frame, BYTE_WORDS),
        Target("a.tif", _tiff(grey), fw.files.read_frame, BYTE_WORDS),
        Target("z.tif", _tiff(grey, compression="zlib"), fw.files.read_frame, BYTE_WORDS),
        Target("s.tif", _tiff(frames, photometric="minisblack"), fw.files.read_stack, BYTE_WORDS, planned),
        Target("s.npy", _npy(frames), fw.files.read_stack, BYTE_WORDS, planned),
        Target("s.npz", _npz(frames=frames), fw.files.read_stack, BYTE_WORDS, planned),
        Target("p.mat", _mat(pair, False), fw.files.read_capture, BYTE_WORDS),
        Target("c.mat", _mat(pair, True), fw.files.read_capture, BYTE_WORDS),
        Target("h.mat", _hdf5(pair), fw.files.read_capture, BYTE_WORDS, share=0.02),
        Target("p.npz", _npz(reference=grey, object=grey, mask=grey > 3), fw.files.read_capture, BYTE_WORDS),
        Target("pair/capture.toml", capture, _parent(fw.files.read_capture), TOML_WORDS, {"pair/a.png": png, "pair/t.tif": tif}),
        Target("stack/capture.toml", stack, _parent(fw.files.read_capture), TOML_WORDS, {"stack/plan.toml": PLAN, "stack/s.tif": _tiff(frames, photometric="minisblack")}),
        Target("plan.toml", PLAN, fw.files.read_plan, TOML_WORDS),
        Target("rig.toml", _written(folder, "rig.toml", lambda p: fw.files.write_rig(p, rig)), fw.files.read_rig, TOML_WORDS),
        Target("rig.xml", _written(folder, "rig.xml", lambda p: fw.files.write_rig(p, rig)), fw.files.read_rig, TEXT_WORDS),
        Target("other.xml", _opencv("Kc kc Kp kp Rp Tp", ".xml", frameWidth=640, frameHeight=480, screenResX=64, screenResY=48), fw.files.read_rig, TEXT_WORDS),
        Target("other.yml", _opencv("cam_K cam_kc pro_K pro_kc R T", ".yml", cam_size=np.array([[64], [48]]), pro_size=np.array([[64], [48]]), stereo_rms=0.3), fw.files.read_rig, TEXT_WORDS),
        Target("response.toml", _written(folder, "r.toml", lambda p: fw.files.write_response(p, response)), fw.files.read_response, TOML_WORDS),
        Target("geometry.toml", _written(folder, "g.toml", lambda p: fw.files.write_reference_plane(p, fw.pair.ReferencePlaneGeometry(500.0, 200.0))), fw.files.read_reference_plane, TOML_WORDS),
        npz("law.npz", lambda p: fw.files.write_reference_plane(p, law), fw.files.read_reference_plane),
        npz("map.npz", lambda p: fw.files.write_surface(p, surface), on_surface),
        npz("map.tif", lambda p: fw.files.write_surface(p, surface), on_surface),
        npz("map.x3p", lambda p: fw.files.write_surface(p, surface), on_surface),
        npz("map.gsf", lambda p: fw.files.write_surface(p, surface), on_surface),
        npz("cloud.npz", lambda p: fw.files.write_points(p, cloud), fw.files.read_points),
        npz("cloud.ply", lambda p: fw.files.write_points(p, cloud), fw.files.read_points),
        npz("cloud.xyz", lambda p: fw.files.write_points(p, cloud), fw.files.read_points)._replace(words=TEXT_WORDS),
        npz("cloud.pcd", lambda p: fw.files.write_points(p, cloud), fw.read),
        npz("frame.pcd", lambda p: fw.files.write_points(p, cloud, kind="frame"), fw.read),
        npz("frame.csv", lambda p: fw.files.write_points(p, cloud, kind="frame"), fw.read)._replace(words=TEXT_WORDS),
        npz("map.csv", lambda p: fw.files.write_surface(p, surface), on_surface)._replace(words=TEXT_WORDS),
        npz("x.csv", lambda p: fw.files.write_coordinates(p, decoded), fw.read)._replace(words=TEXT_WORDS),
        Target("table.csv", b"x_m;y_m;z_m;\xcf\x83 [mm]\n1,0;2,0;;0,1\n4;5;6;0,2\n", fw.read, TEXT_WORDS),
        *(
            npz(f"cloud{suffix}", lambda p: fw.files.write_points(p, cloud), fw.read)._replace(share=share)
            for suffix, package, share in ((".las", "laspy", 1.0), (".laz", "lazrs", 0.02), (".e57", "pye57", 0.02))
            if find_spec(package)  # there are no wheels of pye57 for Linux on ARM
        ),
        npz("model.3mf", lambda p: fw.files.write_mesh(p, fw.TriangleMesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.uint32))), fw.files.read_model)._replace(share=0.5),
        npz("triangles.ply", lambda p: fw.files.write_mesh(p, fw.TriangleMesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.uint32))), fw.read),
        Target("text.ply", PLY, fw.files.read_points, TEXT_WORDS),
        Target("faces.ply", PLY, fw.read, TEXT_WORDS),
        npz("x.npz", lambda p: fw.files.write_coordinates(p, decoded), fw.files.read_coordinates),
        npz("phase.npz", lambda p: fw.files.write_phase(p, wrapped), fw.files.read_phase),
        npz("light.npz", lambda p: fw.files.write_light(p, light), fw.files.read_light),
        Target("rigs.toml", _written(folder, "rigs.toml", lambda p: fw.files.write_multi_rig(p, small_rig())), fw.files.read_multi_rig, TOML_WORDS),
        Target("stereo.m", STEREO, lambda p: fw.files.read_stereo_rig(p, camera_sizes=((64, 48), (64, 48))), TEXT_WORDS),
        Target("mesh.ply", PLY, fw.files.read_mesh, TEXT_WORDS),
        Target("model.stl", box.export(file_type="stl"), fw.files.read_model, BYTE_WORDS),
        Target("model.glb", box.export(file_type="glb"), fw.files.read_model, BYTE_WORDS, share=0.5),
        Target("model.obj", box.export(file_type="obj").encode(), fw.files.read_model, TEXT_WORDS, share=0.5),
        Target("mesh.obj", b"mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", fw.files.read_mesh, TEXT_WORDS),
        Target("mesh.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", fw.files.read_mesh, TEXT_WORDS),
        Target("r/recipe.toml", RECIPE, fw.files.read_recipe, TOML_WORDS, {"r/plan.toml": PLAN, "r/m.png": png}),
        Target("tolerances.step", STEP.read_bytes(), fw.files.read_tolerances, TEXT_WORDS),
        Target("tolerances.qif", document(TAKEN | LEFT).encode(), lambda p: fw.files.read_tolerances(p, model=STEP.with_name("tolerances.step")), TEXT_WORDS),
        Target("robot.toml", _written(folder, "robot.toml", lambda p: fw.files.write_rig(p, replace(rig, robot=fw.rig.RobotFrame("hand", np.eye(4), np.eye(6), fw.rig.RobotNoise(0.1, 0.1), "kuka")))), fw.files.read_rig, TOML_WORDS),
        Target("poses.csv", b"name,X,Y_mm,Z,A,B,C\na,600,0,400,90,0,180\n", fw.files.read_robot_poses, TEXT_WORDS),
        Target("poses.dat", b"XP1={X 1.5,Y 2,Z -3,A 90,B 0,C 180,S 2}\nXP2={X 1,Y 2,Z 3,A 9,B 0,C 1,S 2}\n", fw.files.read_robot_poses, TEXT_WORDS),
        Target("poses.json", b'[{"name": "a", "position": {"x": 1, "y": 2, "z": 3}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}]', fw.files.read_robot_poses, TEXT_WORDS),
        npz("placed.npz", lambda p: fw.files.write_points(p, cloud.transformed(np.eye(4), frame="base", covariance=np.eye(6))), fw.files.read_cloud),
        npz("placed.pcd", lambda p: fw.files.write_points(p, cloud.transformed(np.eye(4), frame="base", covariance=np.eye(6)), kind="frame"), fw.files.read_cloud),
        Target("setup.toml", SETUP, fw.files.read_setup, TOML_WORDS, planned),
        Target("loaded.toml", SETUP, fw.read, TOML_WORDS, planned),
        Target("figures.json", b'{"kind": "figures", "sigma_mm": 0.01, "rows": [1, 2.5, null], "n": {"a": "b"}}', fw.read, TEXT_WORDS),
        Target("map2.npz", _written(folder, "map2.npz", lambda p: fw.files.write_surface(p, surface)), fw.read, BYTE_WORDS),
        Target("e/capture.toml", EXPOSURES, _parent(fw.files.read_exposures), TOML_WORDS, {f"e/{k}/{n}": c for k in "01" for n, c in still.items()}, 0.25),
        Target("f/a.png", png, _parent(_frames_of), BYTE_WORDS, {"f/b.png": png}),
        Target("z/zarr.json", arrays.pop("zarr.json"), _parent(_frames_of), TEXT_WORDS, {f"z/{n}": c for n, c in arrays.items()}, 0.25),
        Target("y/c/0/0/0", arrays["c/0/0/0"], lambda p: _frames_of(p.parents[3]), BYTE_WORDS, {f"y/{n}": c for n, c in _zarr_files(frames).items() if n != "c/0/0/0"}, 0.1),
        Target("mesh.stl", bytes(80) + struct.pack("<I12fH", 1, *range(12), 0), fw.files.read_mesh, BYTE_WORDS),
    ]  # fmt: skip


def _npy(array: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


def _parent(read: Callable[[Path], Any]) -> Callable[[Path], Any]:
    return lambda path: read(path.parent)


def repacked(content: bytes, name: str, change: Callable[[bytes], bytes]) -> bytes:
    """A ZIP archive with one member changed, whole otherwise."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(out, "w") as new:
        for info in old.infolist():
            data = old.read(info)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                new.writestr(info.filename, change(data) if info.filename == name else data)
    return out.getvalue()
