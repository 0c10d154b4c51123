"""Whole scans over GigE Vision on the command line: Aravis' fake camera before the virtual rig."""

from __future__ import annotations

import contextlib
import errno
import os
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.files.exposures import read_exposures
from fringeworks.files.plan import frame_names
from fringeworks.types import CameraSettings, DeviceProblem, FileProblem, MissingPackage

try:
    from fringeworks.devices.aravis import aravis
    from fringeworks.devices.genicam import GenicamCamera

    aravis()
except MissingPackage as error:
    pytest.skip(f"{error}", allow_module_level=True)

from tests.fake_gige import CameraProcess, the_only_camera
from tests.wire_rig import RIG, SPHERE_MM, Board, Screen, frame_of, scene_named

pytestmark = pytest.mark.system

ROOT = Path(__file__).parent.parent
PLAN = fw.PatternPlan(
    384,
    240,
    tuple(fw.patterns.PhaseSteps("x", 384 / n, fw.patterns.equal_steps(4)) for n in (27, 5.2, 1)),
)
FIXED = CameraSettings(exposure_ms=16.666, gain_db=0.0)


class Wire(CameraProcess):
    """A camera that sees the virtual rig, and the command line that uses it."""

    def __init__(self, folder, scene, lost):
        folder.mkdir()
        self.folder, self.scene = folder, scene_named(scene)
        Board.make(folder)
        fw.files.write_plan(folder / "plan.toml", PLAN)
        fw.files.write_rig(folder / "rig.toml", RIG)
        super().__init__("Rig", "tests.wire_rig", folder, scene, "Rig", lost)

    def begin(self, place, *options):
        """Begin ``scan`` in a folder, as a program of its own."""
        place.mkdir(exist_ok=True)
        words = ["scan", self.folder / "plan.toml", "--rig", self.folder / "rig.toml"]
        words += ["--projector", f"wire:{self.folder}", "--camera", f"genicam:{self.identifier}"]
        words += ["--capture", "part", "--out", "part.ply", *options]
        command = [sys.executable, "-m", "fringeworks", "--plugin", ROOT / "tests/wire_plugin.py"]
        paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
        return subprocess.Popen(
            [*command, *words],
            cwd=place,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(paths), "SOURCE_DATE_EPOCH": "0"},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def scanned(self, place, *options):
        """A scan that must succeed; the bytes of its points."""
        running = self.begin(place, *options)
        said = running.communicate(timeout=120)
        assert running.returncode == 0, said
        return (place / "part.ply").read_bytes()

    def killed_after(self, frames, folder, place, *options):
        """What a scan says whose camera is killed after some frames of a folder are written."""
        last = frame_names(PLAN, ".png")[frames - 1]
        (self.folder / "hold").write_text(str(place / folder / last))
        running = self.begin(place, *options)
        held = self.folder / "held"
        while not held.exists():
            assert running.poll() is None, running.communicate()
            time.sleep(0.01)
        self.kill()
        held.unlink()
        (self.folder / "hold").unlink()
        _, said = running.communicate(timeout=60)
        assert running.returncode == 2
        return said

    def check_exact(self, stack, settings):
        """Every frame shows the picture of the plan and nothing else, to the bit."""
        how = settings["exposure_ms"], settings.get("gain_db", 0.0)
        for frame, picture in zip(stack.frames, fw.encode(PLAN), strict=True):
            np.testing.assert_array_equal(frame, frame_of(self.scene, [(picture, 1.0)], *how))


@contextlib.contextmanager
def wire(folder, scene="sphere", *, lost=0):
    with the_only_camera():
        made = Wire(folder, scene, lost)
        try:
            yield made
        finally:
            made.stop()


def described(folder):
    """The description of a capture."""
    return tomllib.loads((folder / "capture.toml").read_text())


def frames_in(folder):
    return {path.name: path.read_bytes() for path in folder.glob("*.png")}


def check_killed(said):
    """One sentence that says what happened and what to do."""
    assert "Aravis Fake Rig: expected a camera that answers, got none" in said
    assert "unplugged or switched off" in said
    assert "[" not in said
    assert said.count("\n") == 1


def refused(camera, capsys):
    """What ``capture`` says of a camera that it cannot open; its plan lies in the folder ``wire``."""
    command = ["capture", "wire/plan.toml", "--out", "d", "--projector", "memory:wire"]
    assert run([*command, "--camera", camera]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    return error


@pytest.mark.long
def test_a_scan_with_a_killed_camera_equals_an_undisturbed_one(tmp_path):
    """Auto exposure with a gain in whole dB, frames to the bit, kill, resume, equal points."""
    with wire(tmp_path / "wire") as made:
        whole = made.scanned(tmp_path / "a", "--auto-exposure")
        folder = tmp_path / "a" / "part"
        settings = described(folder)["settings"]
        # Between one and two refresh periods, gain makes up for the rest; the camera rounds it.
        assert settings["exposure_ms"] == pytest.approx(1e3 / 60, abs=0.001)
        assert settings["gain_db"] == 1.0
        stack = fw.files.read_stack(folder)
        white = np.max(stack.frames, axis=0)
        assert 0.75 * 255 < np.quantile(white[white > 20], 0.99) < 255
        made.check_exact(stack, settings)
        found = fw.surface.fit_region(
            fw.files.read_points(tmp_path / "a" / "part.ply").xyz_mm, "sphere"
        )
        assert found.parameters["radius_mm"] == pytest.approx(SPHERE_MM, abs=0.1)
        check_killed(made.killed_after(5, "part", tmp_path / "b", "--auto-exposure"))
        kept = frames_in(tmp_path / "b" / "part")
        assert len(kept) == 5
        assert not (tmp_path / "b" / "part.ply").exists()
        # A camera that was switched off forgets its gain; the interrupted capture knows it.
        made.start()
        assert made.scanned(tmp_path / "b", "--auto-exposure", "--resume") == whole
        again = frames_in(tmp_path / "b" / "part")
        assert again == frames_in(folder)
        assert kept.items() <= again.items()


def test_a_full_disk_loses_nothing_and_no_camera_is_said_so(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    taken = []

    def full(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def fill_at_four(label):
        taken.append(label)
        if len(taken) == 4:
            monkeypatch.setattr(os, "fsync", full)

    with wire(tmp_path / "wire") as made, Screen(made.folder) as projector:
        with GenicamCamera(made.identifier) as camera:
            where = projector, camera, PLAN, tmp_path / "c"
            with pytest.raises(FileProblem, match="could not be written: No space left on device"):
                fw.capture(*where, settings=FIXED, progress=fill_at_four)
            monkeypatch.setattr(os, "fsync", lambda _: None)
            kept = frames_in(tmp_path / "c")
            assert len(kept) == 3
            assert not list((tmp_path / "c").glob(".fringeworks-*"))
            fw.capture(*where, settings=FIXED, resume=True)
        assert kept.items() <= frames_in(tmp_path / "c").items()
        made.check_exact(fw.files.read_stack(tmp_path / "c"), vars(FIXED))
        made.stop()
        error = refused("genicam", capsys)
    assert "camera: expected one that is connected and not in use (No supported" in error
    assert "cameras found: none" in error
    assert not (tmp_path / "d").exists()


@pytest.mark.long
def test_lost_packets_do_not_change_the_points(tmp_path):
    found = []
    for name, lost in (("a", 0), ("b", 50)):
        with wire(tmp_path / f"wire-{name}", lost=lost) as made:
            found.append(made.scanned(tmp_path / name, "--auto-exposure"))
            settings = described(tmp_path / name / "part")["settings"]
            made.check_exact(fw.files.read_stack(tmp_path / name / "part"), settings)
    assert frames_in(tmp_path / "a" / "part") == frames_in(tmp_path / "b" / "part")
    assert found[0] == found[1]


@pytest.mark.long
def test_several_exposures_and_a_killed_camera(tmp_path):
    """Paint of 0.02 to 1 and a highlight: three exposures measure what one cannot."""
    with wire(tmp_path / "wire", "glossy") as made:
        made.scanned(tmp_path / "one", "--auto-exposure")
        whole = made.scanned(tmp_path / "a", "--hdr", "3")
        folder = tmp_path / "a" / "part"
        exposures = described(folder)["exposures"]
        assert len(exposures) == 3
        for one, stack in zip(exposures, read_exposures(folder), strict=True):
            made.check_exact(stack, one)
        one, three = (
            len(fw.files.read_points(tmp_path / n / "part.ply").xyz_mm) for n in ("one", "a")
        )
        size = RIG.camera.width_px * RIG.camera.height_px
        assert one < 0.8 * size
        assert three >= 0.97 * size
        check_killed(made.killed_after(5, "part/1", tmp_path / "b", "--hdr", "3"))
        part = tmp_path / "b" / "part"
        kept = [frames_in(part / name) for name in "01"]
        assert [len(frames) for frames in kept] == [PLAN.frames, 5]
        made.start()
        assert made.scanned(tmp_path / "b", "--hdr", "3", "--resume") == whole
        for name, frames in zip("01", kept, strict=True):
            assert frames.items() <= frames_in(part / name).items()
        for name in "012":
            assert frames_in(part / name) == frames_in(folder / name)


@pytest.mark.long
def test_a_camera_in_use_or_gone_before_the_first_frame(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with wire(tmp_path / "wire") as made, Screen(made.folder) as projector:
        with GenicamCamera(made.identifier) as camera:
            error = refused(f"genicam:{made.identifier}", capsys)
            assert f"camera {made.identifier}: expected one that is not in use" in error
            made.kill()
            with pytest.raises(DeviceProblem, match="expected a camera that answers, got none"):
                fw.capture(projector, camera, PLAN, tmp_path / "c", settings=FIXED)
            assert not (tmp_path / "c").exists()
        error = refused(f"genicam:{made.identifier}", capsys)
        assert f"camera {made.identifier}: expected one that is connected" in error
