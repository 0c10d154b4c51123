"""From a set-up to points on the command line, on virtual devices: the commands of docs/start.md."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.devices.bench import POSES, RADIUS_MM, SCALE
from fringeworks.simulate.standard import fringe_plan, standard_rig
from tests.walk import steps

pytestmark = pytest.mark.statistical


@pytest.mark.long
def test_the_page_from_setup_to_a_part(tmp_path, monkeypatch, capsys):
    """Every command of the page, with virtual devices in place of real ones."""
    monkeypatch.chdir(tmp_path)
    # The first three commands of the page are about two photographs: tests/test_walk.py.
    commands = [step.run for step in steps("docs/start.md")[3:]]
    assert len(commands) >= 6 + POSES
    for command in commands:
        words = command.replace("virtual:bust", "virtual:sphere").split()[1:]
        assert run(words) == 0, (words, capsys.readouterr())
    # The poses that lie there count; the user ends the taking of more.
    monkeypatch.setattr("sys.stdin", io.StringIO("q\n"))
    capsys.readouterr()
    live = "calibrate board/ --live --setup setup.toml --board chessboard:11x8:12 --out live.toml"
    assert run(live.split()) == 0
    assert f"{POSES} poses" in capsys.readouterr().out
    focal = [fw.files.read_rig(name).camera.focal_px for name in ("live.toml", "rig.toml")]
    # The set-up's noise weighs the frames a little differently from their own.
    assert focal[0] == pytest.approx(focal[1], rel=1e-5)
    assert json.loads(Path("part.json").read_text())["points"] > 3000
    found = fw.surface.fit_region(fw.files.read_points("part.ply").xyz_mm, "sphere")
    assert found.parameters["radius_mm"] == pytest.approx(RADIUS_MM, abs=0.1)
    # Plans take the set-up, too: the one of 24 frames is that of the set-up.
    plan = [
        "plan",
        "--setup",
        "setup.toml",
        "--frames",
        "24",
        "--axes",
        "x,y",
        "--out",
        "again.toml",
    ]
    assert run(plan) == 0
    assert fw.files.read_plan("again.toml") == fw.files.read_setup("setup.toml").plan
    assert run(["plan", "--frames", "24"]) == 2
    assert "--projector-size: expected, or --setup" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["capture", "--out", "c"], "expected a projector and a camera, or a set-up"),
        (
            ["capture", "--out", "c", "--projector", "virtual", "--camera", "webcam:0"],
            "expected virtual for both of them",
        ),
        (
            ["capture", "--out", "c", "--projector", "virtual", "--camera", "virtual:moon"],
            "expected one of bust, plane, sphere",
        ),
        (
            ["capture", "--out", "c", "--projector", "virtual", "--camera", "virtual"],
            "expected a plan, or a set-up with its plan",
        ),
        (
            ["capture", "--out", "c", "--projector", "beamer", "--camera", "webcam:0"],
            "expected a kind of",
        ),
        (
            [
                "setup",
                "--out",
                "s.toml",
                "--projector",
                "virtual",
                "--camera",
                "virtual",
                "--exposure-ms",
                "1e9",
            ],
            "exposure_ms: expected 0.02 to 10000",
        ),
    ],
)
def test_bad_input_is_one_sentence(tmp_path, monkeypatch, capsys, arguments, said):
    monkeypatch.chdir(tmp_path)
    assert run(arguments) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


HARDWARE = """
from pathlib import Path
import fringeworks as fw
from fringeworks.devices.clock import SimulatedClock

@fw.devices.camera_kind("wired")
def open_wired(folder):
    "A camera whose trigger output advances a projector that plays from its memory."
    plan = fw.files.read_plan(Path(folder) / "plan.toml")
    projector, camera = fw.devices.virtual_bench("sphere", clock=SimulatedClock())
    pictures, trigger, count = list(fw.encode(plan)), camera.trigger, [0]

    def advanced():
        projector.show(pictures[count[0] % len(pictures)])
        count[0] += 1
        return trigger()

    camera.trigger = advanced
    return camera
"""
"""A plug-in with a camera that is wired to a projector's memory."""


def test_a_scan_from_a_projectors_memory(tmp_path, monkeypatch, capsys):
    """Pictures are exported, the projector plays them, and the plan need not be named again."""
    monkeypatch.chdir(tmp_path)
    Path("hardware.py").write_text(HARDWARE)
    rig = standard_rig(scale=SCALE)
    fw.files.write_rig("rig.toml", rig)
    fw.files.write_plan("plan.toml", fringe_plan(rig, both=False))
    assert run(["patterns", "plan.toml", "--out", "pictures"]) == 0
    devices = ["--projector", "memory:pictures", "--camera", "wired:pictures"]
    plugin = ["--plugin", "hardware.py"]
    scan = ["scan", "--rig", "rig.toml", "--capture", "part", "--out", "part.ply", *devices]
    assert run([*plugin, *scan]) == 0, capsys.readouterr()
    found = fw.surface.fit_region(fw.files.read_points("part.ply").xyz_mm, "sphere")
    assert found.parameters["radius_mm"] == pytest.approx(RADIUS_MM, abs=0.1)
    fw.files.write_plan("other.toml", fringe_plan(rig))
    capsys.readouterr()
    assert run([*plugin, "capture", "other.toml", "--out", "other", *devices]) == 2
    assert "expected the plan whose pictures the projector memory holds" in capsys.readouterr().err
    assert not Path("other").exists()


def test_an_interrupted_scan_goes_on_with_its_own_exposures(tmp_path, monkeypatch, capsys):
    """Exposures measured anew would differ; those of the interrupted scan are taken."""
    from fringeworks.devices.virtual_camera import VirtualCamera

    monkeypatch.chdir(tmp_path)
    rig = standard_rig(scale=SCALE)
    fw.files.write_plan("plan.toml", fringe_plan(rig, both=False))
    devices = ["--projector", "virtual", "--camera", "virtual:sphere"]
    command = ["capture", "plan.toml", "--out", "part", "--hdr", "2", *devices]
    whole = VirtualCamera.grab
    left = [110]

    def failing(self, timeout_s=5.0):
        left[0] -= 1
        if left[0] == 0:
            raise fw.DeviceProblem("camera: gone")
        return whole(self, timeout_s)

    monkeypatch.setattr(VirtualCamera, "grab", failing)
    assert run(command) == 2
    assert "camera: gone" in capsys.readouterr().err
    taken = {path: path.read_bytes() for path in Path("part").glob("*/*.png")}
    assert taken
    assert run([*command, "--resume"]) == 0, capsys.readouterr()
    assert all(path.read_bytes() == content for path, content in taken.items())
    assert len(fw.files.read_exposures("part")) == 2
