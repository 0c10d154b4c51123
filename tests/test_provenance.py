"""Every result says where it comes from; equal runs give equal files."""

from __future__ import annotations

import hashlib
import json
import zipfile

import numpy as np
import pytest
import tifffile
from PIL import Image

import fringeworks as fw
from fringeworks.types import fingerprint, made_by
from tests.commands import run
from tests.conftest import scene
from tests.stacks import multi, take

EPOCH = "1700000000"
DATE = "2023-11-14T22:13:20Z"


@pytest.fixture
def capture(tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", EPOCH)
    fw.files.write_pair(
        tmp_path / "part", scene("parabola", size=120, fringes=6, bits=8, noise=1, seed=1)
    )
    return tmp_path / "part"


def test_a_result_names_version_call_inputs_and_options(capture):
    origin = fw.reconstruct(capture, "fourier", width=0.6).surface.provenance
    assert (origin.version, origin.call, origin.date) == (fw.__version__, "reconstruct", DATE)
    assert origin.options["method"] == "fourier"
    assert origin.options["width"] == 0.6
    hashes = {source.name: source.sha256 for source in origin.inputs}
    frame = (capture / "object.png").read_bytes()
    assert hashes["part/object.png"] == hashlib.sha256(frame).hexdigest()
    assert "part/capture.toml" in hashes


def test_arrays_are_inputs_too():
    one = fw.reconstruct(scene("parabola", size=64, fringes=4), "fourier").surface.provenance
    two = fw.reconstruct(scene("cube", size=64, fringes=4), "fourier").surface.provenance
    assert [s.name for s in one.inputs] == ["reference", "object"]
    assert one.inputs[0] == two.inputs[0]
    assert one.inputs[1] != two.inputs[1]


@pytest.mark.parametrize("suffix", [".tif", ".npz", ".x3p", ".gsf"])
def test_surfaces_bring_it_back(capture, tmp_path, suffix):
    surface = fw.reconstruct(capture, "fourier").surface
    fw.files.write_surface(tmp_path / f"s{suffix}", surface)
    again = fw.files.read_surface(tmp_path / f"s{suffix}")
    assert again.provenance == surface.provenance
    assert (again.unit, again.quantity, again.method) == (surface.unit, "height", "fourier")
    assert again.pitch == pytest.approx(surface.pitch)
    np.testing.assert_allclose(again.values, surface.values, rtol=1e-5, atol=1e-5)
    if suffix in (".tif", ".npz"):
        np.testing.assert_allclose(again.sigma, surface.sigma, rtol=1e-6)
        np.testing.assert_array_equal(again.reason, surface.reason)
    if suffix == ".npz":
        assert again == surface


@pytest.mark.parametrize("suffix", [".ply", ".xyz", ".npz"])
def test_points_bring_it_back(tmp_path, suffix):
    origin = made_by("measure", options={"axis": "x", "noise": fw.signal.CameraNoise(1.0, 0.1)})
    ok = np.zeros((6, 7), np.uint8)
    xyz = np.random.default_rng(0).normal(size=(6, 7, 3)).astype(np.float32)
    sigma = np.full((6, 7), 0.1, np.float32)
    cloud = fw.PointCloud(xyz, sigma, sigma, ok, provenance=origin)
    fw.files.write_points(tmp_path / f"p{suffix}", cloud)
    found = fw.files.read_points(tmp_path / f"p{suffix}")
    assert found.provenance == origin
    np.testing.assert_allclose(found.xyz_mm, xyz.reshape(-1, 3), atol=1e-5)
    if suffix == ".npz":
        assert fw.files.read_cloud(tmp_path / "p.npz") == cloud
    if suffix == ".ply":
        header = (tmp_path / "p.ply").read_bytes().partition(b"end_header")[0].splitlines()
        assert max(map(len, header)) < 1000


def test_coordinates_bring_it_back(tmp_path):
    plan = multi((1, 8), 4, (300, 40))
    found = fw.decode(fw.Stack(list(take(plan)), plan))
    assert found.provenance.plan_sha256 == fingerprint(plan)
    assert len(found.provenance.inputs) == 8
    again = fw.files.read_coordinates(fw.files.write_coordinates(tmp_path / "x.npz", found))
    assert again.provenance == found.provenance


def test_equal_runs_write_equal_files(capture, tmp_path):
    for folder in (tmp_path / "one", tmp_path / "two"):
        folder.mkdir()
        surface = fw.reconstruct(capture, "fourier").surface
        for suffix in (".tif", ".npz", ".ply", ".x3p", ".gsf"):
            fw.files.write_surface(folder / f"s{suffix}", surface)
        for suffix in (".png", ".pdf", ".svg"):
            sheet = surface.plot()
            fw.save_figure(sheet, folder / f"s{suffix}", provenance=surface.provenance)
        run("reconstruct", capture, "--method", "fourier", "--json", folder / "s.json")
    for path in (tmp_path / "one").iterdir():
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes(), path.name
    told = json.loads((tmp_path / "one/s.json").read_text())["provenance"]
    assert told["date"] == DATE
    with Image.open(tmp_path / "one/s.png") as picture:
        assert json.loads(picture.text["provenance"]) == told
    assert b"/Subject" in (tmp_path / "one/s.pdf").read_bytes()
    assert "part/object.png" in (tmp_path / "one/s.svg").read_text()
    with tifffile.TiffFile(tmp_path / "one/s.tif") as file:
        assert json.loads(file.pages[0].description)["provenance"] == told
    with zipfile.ZipFile(tmp_path / "one/s.x3p") as archive:
        assert DATE.encode() in archive.read("main.xml")


def test_a_date_that_is_none(monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "yesterday")
    with pytest.raises(fw.InputError, match="SOURCE_DATE_EPOCH: expected a whole number"):
        made_by("x", options={})


def test_pictures_of_other_kinds_are_refused(capture, tmp_path):
    done = run("reconstruct", capture, "--figure", tmp_path / "s.bmp", code=2)
    assert "expected one of .png, .pdf, .svg, got .bmp" in done.stderr
