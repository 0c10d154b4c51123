"""One pair for all files: what ``write`` writes, ``read`` reads as an equal thing of the same type."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import zarr

import fringeworks as fw
from fringeworks.files import mesh_writer, points, surfaces
from fringeworks.files.formats import FORMATS, OPENCV_SUFFIXES
from fringeworks.types import CameraNoise, made_by
from tests.cameras import small_rig

RNG = np.random.default_rng(3)
MADE = made_by("measure", options={"axis": "x"})
FLAT = RNG.random((5, 6)).astype(np.float32)
REASON = np.zeros((5, 6), np.uint8)
XYZ = RNG.random((5, 6, 3)).astype(np.float32)
XYZ[2, 3], REASON[2, 3] = np.nan, 4
PLAN = fw.PatternPlan(
    64,
    48,
    (fw.patterns.PhaseSteps("x", 64.0, fw.patterns.equal_steps(3)), fw.patterns.Uniform("white")),
)
FINDINGS = (fw.Finding("noise", "seen", ("one", "two"), "do this", frames=("1", "2")),)
PINHOLE = fw.rig.Pinhole(64, 48, (90.0, 90.0), (32.0, 24.0))
RIG = fw.Rig(PINHOLE, PINHOLE, np.eye(4) + np.eye(4, k=3) * 100.0, np.eye(24), (0.1, 0.2), MADE)
OK = REASON == 0
AXIS = fw.stack.CoordinateMap(
    FLAT, FLAT, FLAT, FLAT, REASON, "x", (16.0, 90.0), np.stack([FLAT] * 2)
)
CLOUD = fw.PointCloud(XYZ, FLAT, FLAT, REASON, FLAT, FLAT, MADE, FINDINGS)
POINTS = fw.surface.Points(
    XYZ[OK].astype(float), FLAT[OK].astype(float), FLAT[OK].astype(float), provenance=MADE
)
MESH = fw.TriangleMesh(
    np.float32([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 2]]),
    np.array([[0, 1, 2], [0, 2, 3]], np.uint32),
    np.full(4, 0.5, np.float32),
    filled=np.array([True, False, False, True]),
    provenance=MADE,
)
SETUP = fw.scan.StoredSetup(
    projector="window:1",
    camera="webcam:0",
    projector_name="bench",
    camera_name="left",
    settings=fw.devices.CameraSettings(exposure_ms=16.0),
    noise=CameraNoise(1.0, 0.02),
    delay=fw.scan.Delay(*np.array([[0.01], [0.005], [0.07], [0.06]]), 1 / 60, 1 / 30, (0.01, 0.02)),
    plan=PLAN,
    predicted_sigma_px=0.05,
    findings=FINDINGS,
    size_px=(64, 48),
    min_period_px=4.0,
    modulation=40.0,
    gamma=2.2,
    contrast=9.0,
    black_counts=5.0,
)
RECIPE = fw.Recipe(
    method="windowed",
    plan=PLAN,
    areas={"face": fw.evaluate.Area(box=(1, 2, 3, 4)), "hole": fw.evaluate.Area(mask=FLAT > 0.5)},
    tolerances=(fw.evaluate.PartTolerance("flat", "flatness", ("face",), None, 0.1),),
)
HEIGHTS = fw.HeightMap(
    FLAT, FLAT, REASON, "height", "mm", 0.5, "fourier", MADE, (1.0, 2.0, 500.0), True, FINDINGS
)
LAW = fw.pair.PixelCalibration(FLAT + 1, FLAT, (1.0, 9.0), MADE, 0.5)
EXACT = {
    "heights.npz": HEIGHTS,
    "heights.tif": HEIGHTS,
    "heights.tiff": HEIGHTS,
    "cloud.npz": CLOUD,
    "mesh.ply": MESH,
    "x.npz": fw.Decoded(AXIS, None, CameraNoise(1.0, 0.1), FINDINGS, provenance=MADE),
    "xy.npz": fw.Decoded(AXIS, replace(AXIS, axis="y", repeats_px=80.0), CameraNoise(1.0)),
    "phase.npz": fw.stack.WrappedPhase(
        FLAT, FLAT, FLAT, FLAT, REASON, (0.0, 2.0, 4.0), CameraNoise(1.0), FINDINGS, MADE
    ),
    "light.npz": fw.stack.LightSeparation(
        FLAT, FLAT, FLAT, FLAT, REASON, 24.0, True, 0.8, FINDINGS, MADE
    ),
    "law.npz": LAW,
    "law2.npz": replace(LAW, pitch_mm_per_px=None, provenance=None),
    "plane.toml": fw.pair.ReferencePlaneGeometry(500.0, 200.0, 0.2, -1, (3.0, 4.0)),
    "rig.toml": RIG,
    "rigs.toml": small_rig(),
    "response.toml": fw.Response(
        "left", "bench", 2.2, 3, 1.0, np.zeros((2, 256)), (10.0, 200.0), 0.01, provenance=MADE
    ),
    "plan.toml": PLAN,
    "recipe.toml": RECIPE,
    "setup.toml": SETUP,
    "figures.json": {"sigma_mm": 0.01, "rows": [1, 2.5, None], "n": {"a": "b"}},
    "frame.png": np.arange(30, dtype=np.uint16).reshape(5, 6),
    "frame.tif": FLAT,
}
"""Things by the file that keeps all of them."""


@pytest.mark.parametrize("name", EXACT)
def test_what_is_written_is_read(name, tmp_path):
    thing = EXACT[name]
    assert fw.write(tmp_path / name, thing) == tmp_path / name
    found = fw.read(tmp_path / name)
    assert type(found) is type(thing)
    if isinstance(thing, np.ndarray):
        assert found.dtype == thing.dtype
        np.testing.assert_array_equal(found, thing)
    else:
        assert found == thing


@pytest.mark.parametrize("name", [name for name in EXACT if name.endswith(".npz")])
def test_archives_open_with_numpy_alone(name, tmp_path):
    with np.load(fw.write(tmp_path / name, EXACT[name])) as archive:
        assert archive.files
        for key in archive.files:
            assert archive[key].dtype.kind in "fuibUS"


def alike(found, expected, *names, within=1e-6):
    for name in names:
        one, other = getattr(found, name), getattr(expected, name)
        np.testing.assert_allclose(one, other, rtol=within, atol=within, err_msg=name)


@pytest.mark.parametrize("suffix", [".ply", ".pcd", ".xyz"])
def test_clouds_without_their_frame_are_points(suffix, tmp_path):
    options = {} if suffix == ".xyz" else {"kind": "normals"}
    found = fw.read(fw.write(tmp_path / f"c{suffix}", replace(CLOUD, provenance=MADE), **options))
    assert type(found) is fw.surface.Points
    alike(found, POINTS, "xyz_mm", "sigma_mm", within=1e-5)
    assert found.provenance == MADE
    if suffix != ".xyz":
        alike(found, POINTS, "noise_mm")
        assert found.normals.shape == found.xyz_mm.shape
        assert found.colour.shape == (29,)


def test_points_keep_normals_and_colour(tmp_path):
    shown = np.array([[255, 0, 7]] * 28 + [[255, 255, 255]], float)
    thing = replace(POINTS, normals=POINTS.xyz_mm, colour=shown)
    found = fw.read(fw.write(tmp_path / "p.ply", thing))
    alike(found, thing, "xyz_mm", "sigma_mm", "noise_mm", "normals", "colour")
    assert (found.provenance, found.colour.shape) == (MADE, (29, 3))


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".glb"])
def test_meshes_come_back_from_other_programs_files(suffix, tmp_path):
    found = fw.read(fw.write(tmp_path / f"m{suffix}", MESH))
    assert type(found) is fw.TriangleMesh

    def corners(mesh):
        return np.sort(np.asarray(mesh.vertices_mm)[mesh.faces].reshape(-1, 9), axis=0)

    np.testing.assert_allclose(corners(found), corners(MESH), atol=1e-6)


def test_triangles_of_clouds_and_height_maps_are_meshes(tmp_path):
    y, x = np.mgrid[:20, :30].astype(float)
    flat = fw.PointCloud(
        np.stack([x, y, np.full_like(x, 500.0)], -1),
        0 * x + 0.1,
        0 * x,
        np.zeros(x.shape, np.uint8),
    )
    found = fw.read(fw.write(tmp_path / "c.ply", flat, kind="mesh"))
    assert (type(found), len(found.vertices_mm)) == (fw.TriangleMesh, 600)
    assert len(found.faces) == 2 * 19 * 29
    fw.write(tmp_path / "h.ply", HEIGHTS, kind="mesh")
    assert type(fw.read(tmp_path / "h.ply")) is fw.TriangleMesh
    moved = replace(HEIGHTS, quantity="displacement", unit="px")
    for kind in ("points", "mesh"):
        fw.write(tmp_path / "u.ply", moved, kind=kind)
        with pytest.raises(fw.InputError, match="displacements in px"):
            fw.read(tmp_path / "u.ply")


@pytest.mark.parametrize("suffix", [".x3p", ".gsf"])
def test_heights_without_sigma(suffix, tmp_path):
    found = fw.read(fw.write(tmp_path / f"h{suffix}", HEIGHTS))
    assert (type(found), found.unit, found.pitch) == (fw.HeightMap, "mm", 0.5)
    alike(found, HEIGHTS, "values")


@pytest.mark.parametrize("suffix", OPENCV_SUFFIXES)
def test_rigs_of_opencv(suffix, tmp_path):
    found = fw.read(fw.write(tmp_path / f"r{suffix}", RIG))
    alike(found, RIG, "T_projector_camera")
    assert (found.camera, found.projector, found.covariance) == (PINHOLE, PINHOLE, None)


def test_captures(tmp_path):
    frames = tuple(RNG.integers(0, 255, (24, 32), dtype=np.uint8) for _ in range(PLAN.frames))
    stack = fw.Stack(frames, PLAN, saturation=250.0, camera="left", projector="bench")
    fw.write(tmp_path / "stack", stack)
    for path in ("stack", "stack/capture.toml"):
        found = fw.read(tmp_path / path)
        assert replace(found, sources=(), count_step=stack.count_step) == stack
    pair = fw.Pair(reference=frames[0], object=frames[1], axis="x", camera="left")
    found = fw.read(fw.write(tmp_path / "pair", pair))
    assert replace(found, sources=()) == pair
    folder = tmp_path / "exposures"
    for number in "01":
        fw.write(folder / number, stack)
    (folder / "capture.toml").write_text(
        'kind = "exposures"\n[[exposures]]\nfolder = "0"\n[[exposures]]\nfolder = "1"\n'
    )
    assert [type(one) for one in fw.read(folder)] == [fw.Stack, fw.Stack]
    fw.files.write_patterns(tmp_path / "patterns", PLAN)
    assert fw.read(tmp_path / "patterns").plan == PLAN


def test_frames_without_a_plan_are_a_sequence(tmp_path):
    frames = RNG.integers(0, 255, (4, 24, 32), dtype=np.uint8)
    folder = tmp_path / "frames"
    folder.mkdir()
    for number, frame in enumerate(frames):
        fw.write(folder / f"{number}.png", frame)
    np.save(tmp_path / "f.npy", frames)
    np.savez(tmp_path / "f.npz", frames=frames)
    zarr.create_array(str(tmp_path / "z"), data=frames)
    for name in ("frames", "f.npy", "f.npz", "z"):
        found = fw.read(tmp_path / name)
        assert type(found) is fw.files.FrameSequence
        np.testing.assert_array_equal(list(found), frames)
    fw.write(tmp_path / "plan.toml", PLAN)
    for name in ("f.npy", "f.npz"):
        assert type(fw.read(tmp_path / name)) is fw.Stack
    np.savez(tmp_path / "pair.npz", reference=frames[0], object=frames[1])
    assert type(fw.read(tmp_path / "pair.npz")) is fw.Pair


def test_every_written_type_and_suffix_is_in_a_test_here():
    names = {name for one in FORMATS.values() for name in one.types}
    here = {type(thing).__name__ for thing in EXACT.values()}
    elsewhere = {"Pair", "Stack", "Points", "SetupTests", "PlaneCalibration"}
    assert names == here | elsewhere
    assert FORMATS["points"].suffixes == list(points.WRITERS)
    assert FORMATS["surface"].suffixes == list(surfaces.WRITERS)
    assert FORMATS["mesh"].suffixes == list(mesh_writer.SUFFIXES)


def test_the_help_of_write_lists_the_suffixes_of_every_type():
    text = " ".join(fw.write.__doc__.split())
    kinds = re.findall(r"((?:\w+, )*\w+): ((?:``\.\w+``(?:, )?)+|a folder)", text)
    listed = {
        name: set(re.findall(r"\.\w+", suffixes))
        for names, suffixes in kinds
        for name in names.split(", ")
    }
    for one in FORMATS.values():
        for name in one.types:
            assert listed[name] == set(one.suffixes), name


def test_calibrations_and_phases_with_more_than_is_read(tmp_path):
    geometry = fw.pair.ReferencePlaneGeometry(500.0, 200.0)
    fw.write(tmp_path / "g.toml", fw.pair.PlaneCalibration(geometry, 1.0, 2.0, (0.1, 0.2)))
    assert fw.read(tmp_path / "g.toml") == geometry
    phase = EXACT["phase.npz"]
    unwrapped = fw.unwrap(phase.phase_rad)
    assert fw.read(fw.write(tmp_path / "p.npz", phase, unwrapped=unwrapped)) == phase
    assert "unwrapped_rad" in np.load(tmp_path / "p.npz")


@pytest.mark.parametrize(
    ("name", "thing", "words"),
    [
        (
            "a.foo",
            HEIGHTS,
            "a.foo: expected one of .tif, .tiff, .npz, .ply, .x3p, .gsf, .csv, .vti, got .foo",
        ),
        ("a.ply", EXACT["x.npz"], "expected one of .npz, .csv, .vti, .mat, got .ply"),
        ("none/a.npz", CLOUD, "expected a writable folder, got none"),
        ("a.ply", fw.Pair(FLAT, FLAT), r"expected a folder for a pair of frames, got .*\(.ply\)"),
        ("a.npz", object(), "expected one of Pair, Stack, .*, got object"),
        ("a.npz", None, "got NoneType"),
    ],
)
def test_what_cannot_be_written_is_told_in_a_sentence(name, thing, words, tmp_path):
    with pytest.raises(fw.InputError, match=words):
        fw.write(tmp_path / name, thing)
    assert not list(tmp_path.iterdir())


def test_options_that_a_format_does_not_have(tmp_path):
    with pytest.raises(fw.InputError, match="separated light: .*kind"):
        fw.write(tmp_path / "a.npz", EXACT["light.npz"], kind="mesh")


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.foo", b"", "expected one of .ply, .npz, .toml, .*.json, got .foo"),
        ("a.npz", b"no", "expected an archive"),
        ("a.toml", b"kind = 'password'", "expected a file of the kind plan, rig, .*'password'"),
        ("a.toml", b"]", "expected TOML"),
        ("a.tif", b"II", "expected a readable TIFF"),
        ("a.ply", b"ply", "expected a PLY file"),
        ("a.pcd", b"VERSION", "expected points as PCD"),
        ("a.json", b"[1]", "another JSON value"),
    ],
)
def test_what_cannot_be_read_is_told_in_a_sentence(name, content, words, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(fw.InputError, match=words):
        fw.read(tmp_path / name)


@pytest.mark.parametrize(
    ("read", "name", "content", "words"),
    [
        (fw.files.read_stack, "a.ply", b"ply", "a.ply: expected one of .tif, .*, got .ply"),
        (fw.files.read_stack, "a.png", b"", "a.png: expected a plan"),
        (fw.files.read_cloud, "a.stl", b"solid", r"expected a point cloud \(.npz\), got .stl"),
        (fw.files.read_rig, "a.toml", b"#" * 1_050_000, "TOML of at most 1 MB, got 1.01 MB"),
        (fw.files.read_points, "a.foo", b"", "expected one of .ply, .pcd, .csv, [^c]*.gsf, got"),
        (fw.files.read_tolerances, "a.foo", b"", r"expected .step or .stp, got a.foo; .*\(.qif\)"),
        (partial(fw.files.read_study, quantity="a"), "a.csv", b"\x9d\x81", "expected text, got"),
        (fw.files.read_recipe, "", b"", "expected TOML, got a folder"),
    ],
)
def test_files_of_another_kind_are_named_by_what_they_are(read, name, content, words, tmp_path):
    if name:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(fw.InputError, match=words):
        read(tmp_path / name)


def test_other_archives_and_missing_files(tmp_path):
    np.savez(tmp_path / "a.npz", nothing=np.zeros(3))
    with pytest.raises(
        fw.FileProblem, match="expected a pair of frames, .*got arrays named nothing"
    ):
        fw.read(tmp_path / "a.npz")
    with pytest.raises(fw.FileProblem, match="got no such file"):
        fw.read(tmp_path / "none.npz")
    with pytest.raises(fw.FileProblem, match="expected images .*got 1 .npz files; give one file"):
        fw.read(tmp_path)
