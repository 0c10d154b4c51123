"""Rigs of several cameras on disk, and the commands with a path for each camera."""

from __future__ import annotations

import json
import shlex
import shutil
from dataclasses import replace

import numpy as np
import pytest

from fringeworks import FileProblem, InputError, measure
from fringeworks.files import read_multi_rig, read_points, read_rig, write_multi_rig
from fringeworks.files.stack import write_stack
from fringeworks.rig.device_pairs import camera_pair
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import board_body, fringe_plan
from fringeworks.studio.camera_actions import CalibrateCameras, MeasureCameras
from fringeworks.studio.workspace import open_workspace
from tests.cameras import BOARD, facing_poses, small_rig, surfaces, views_of
from tests.commands import run
from tests.rigs import board

pytestmark = pytest.mark.statistical


def known_rig(cameras: int = 3):
    """A rig with a covariance and residuals."""
    rig = small_rig(cameras=cameras)
    n = 24 + 15 * (cameras - 1)
    A = np.random.default_rng(0).normal(size=(n, n)) * np.logspace(-6, 0, n)[:, None]
    return replace(rig, covariance=A @ A.T, residual_px=(0.1, 0.2, 0.3, 0.4)[: cameras + 1])


@pytest.mark.parametrize("cameras", [1, 2, 3])
def test_a_rig_is_read_as_it_was_written(tmp_path, cameras):
    rig = known_rig(cameras)
    found = read_multi_rig(write_multi_rig(tmp_path / "rig.toml", rig))
    assert found.cameras == rig.cameras
    assert found.projector == rig.projector
    assert np.array_equal(found.T_camera_first, rig.T_camera_first)
    assert np.array_equal(found.T_projector_camera, rig.T_projector_camera)
    assert found.residual_px == rig.residual_px
    scale = np.sqrt(np.diag(rig.covariance))
    assert np.abs((found.covariance - rig.covariance) / np.outer(scale, scale)).max() < 1e-11


def test_damaged_files_are_refused(tmp_path):
    path = write_multi_rig(tmp_path / "rig.toml", known_rig(2))
    text = path.read_text()
    for wrong, part in (
        (text.replace("camera 2 fx", "camera 3 fx"), "parameters"),
        (text.replace("[cameras.T_camera_first]", "[cameras.somewhere]"), "somewhere"),
        (text.replace('kind = "multi-rig"', 'kind = "rig"'), "kind"),
    ):
        path.write_text(wrong)
        with pytest.raises(FileProblem, match=part):
            read_multi_rig(path)
    path.write_text(text)
    with pytest.raises(FileProblem, match="kind"):
        read_rig(path)


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    """A plane, as both cameras of a small rig see it."""
    folder, rig = tmp_path_factory.mktemp("cameras"), small_rig()
    plan = fringe_plan(camera_pair(rig, 0))
    for k, view in enumerate(views_of(rig, [surfaces(0)["plane"]])):
        frames = photograph(view, plan, Optics(seed=k, noise=1.0))
        write_stack(folder / f"camera{k + 1}", list(frames), plan)
    write_multi_rig(folder / "rig.toml", rig)
    return folder


def test_measure_takes_a_capture_for_each_camera(capture, tmp_path):
    shots = [capture / "camera1", capture / "camera2"]
    out, figures, picture = (tmp_path / name for name in ("part.ply", "part.json", "part.png"))
    done = run(
        *("measure", *shots, "--rig", capture / "rig.toml", "--out", out),
        *("--json", figures, "--figure", picture),
    )
    assert "confirmed by another camera" in done.stdout
    assert "with camera 2" in done.stdout
    assert picture.stat().st_size > 10_000
    content = json.loads(figures.read_text())
    first, second = content["cameras"]
    assert first["confirmed_by_cameras"] > 0.8 * first["points"]
    assert content["points"] < first["points"] + second["points"]
    assert first["median_sigma_mm"] < first["pairs"]["projector"]["median_sigma_mm"]
    assert sum(first["difference_histogram"]["share"]) == pytest.approx(1.0)


class Told:
    """A link that keeps what is told."""

    def __init__(self):
        self.labels = []

    def progress(self, label):
        self.labels.append(label)


def test_the_studio_measures_with_two_cameras(capture, tmp_path):
    space = open_workspace(tmp_path)
    for name in ("camera1", "camera2"):
        shutil.copytree(capture / name, tmp_path / "part" / name)
    shutil.copy(capture / "rig.toml", space.cameras)
    shots = ("part/camera1", "part/camera2")
    action = MeasureCameras(shots, "plane")
    figures = action.run(Told(), space)
    assert figures["file"] == "plane.ply"
    words = shlex.split(action.command(figures).shell)
    assert words[1:4] == ["measure", *shots]
    direct = measure([tmp_path / shot for shot in shots], space.cameras).points
    stored = read_points(tmp_path / "plane.ply")
    np.testing.assert_array_equal(stored.xyz_mm, direct.xyz_mm.astype(stored.xyz_mm.dtype))


def test_captures_that_do_not_belong_to_a_rig_are_refused(capture):
    with pytest.raises(InputError, match="each of the rig's 2 cameras, got 1"):
        measure([capture / "camera1"], capture / "rig.toml")
    done = run(
        *("measure", capture / "camera1", capture / "camera2"),
        *("--rig", capture / "rig.toml", "--depth", "400,600"),
        code=2,
    )
    assert "cannot be combined with several cameras" in done.stderr


@pytest.mark.long
def test_calibrate_takes_a_folder_for_each_camera(tmp_path):
    rig = small_rig(0.4)
    plan = fringe_plan(camera_pair(rig, 0))
    for p, T in enumerate(facing_poses(4, 2)):
        for k, view in enumerate(views_of(rig, [board_body(board(BOARD), T)])):
            frames = photograph(view, plan, Optics(seed=10 * p + k))
            write_stack(tmp_path / f"camera{k + 1}" / f"pose{p}", list(frames), plan)
    out = tmp_path / "rig.toml"
    done = run(
        *("calibrate", tmp_path / "camera1", tmp_path / "camera2", "--board", BOARD),
        *("--out", out, "--json", tmp_path / "rig.json"),
    )
    assert "camera 2: 4 poses" in done.stdout
    found = read_multi_rig(out)
    space = open_workspace(tmp_path)
    action = CalibrateCameras(("camera1", "camera2"), BOARD)
    action.run(Told(), space)
    same = read_multi_rig(space.cameras)
    np.testing.assert_array_equal(same.T_camera_first, found.T_camera_first)
    assert action.command(None).shell.startswith("fringeworks calibrate camera1 camera2 --board")
    place = np.linalg.norm(found.T_camera_first[1][:3, 3] - rig.T_camera_first[1][:3, 3])
    assert place < 1.0
    assert found.provenance is not None
