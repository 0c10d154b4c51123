"""From a set-up to points on the command line, on virtual devices: the commands of docs/devices.md."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

import pytest

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.devices.virtual_bench import POSES, RADIUS_MM

PAGE = Path(__file__).parent.parent / "docs" / "devices.md"


def test_the_page_from_setup_to_a_part(tmp_path, monkeypatch, capsys):
    """Every command of the page, with virtual devices in place of real ones."""
    monkeypatch.chdir(tmp_path)
    page = PAGE.read_text()
    commands = re.findall(r"^    fringeworks (.*)$", page, flags=re.MULTILINE)
    assert len(commands) >= 6
    for command in commands:
        words = command.replace("screen:1", "virtual").replace("webcam:0", "virtual:sphere").split()
        if "POSE" in command:
            for k in range(POSES):
                pose = [w.replace("POSE", f"{k}") for w in words]
                assert (
                    run([*pose, "--projector", "virtual", "--camera", f"virtual:board-{k}"]) == 0
                ), pose
            continue
        assert run(words) == 0, (words, capsys.readouterr())
    # The poses that lie there count; the user ends the taking of more.
    monkeypatch.setattr("sys.stdin", io.StringIO("q\n"))
    capsys.readouterr()
    live = "calibrate board/ --live --setup setup.toml --board chessboard:11x8:12 --out live.toml"
    assert run(live.split()) == 0
    assert f"{POSES} poses" in capsys.readouterr().out
    focal = [fw.read_rig(name).camera.focal_px for name in ("live.toml", "rig.toml")]
    # The set-up's noise weighs the frames a little differently from their own.
    assert focal[0] == pytest.approx(focal[1], rel=1e-5)
    assert json.loads(Path("part.json").read_text())["points"] > 3000
    found = fw.fit_region(fw.read_points("part.ply").xyz_mm, "sphere")
    assert found.parameters["radius_mm"] == pytest.approx(RADIUS_MM, abs=0.1)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["capture", "--out", "c"], "expected --projector and --camera, or --setup"),
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
            "expected a plan file, or --setup",
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
