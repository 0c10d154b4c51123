"""A plain ``measure`` answers without the other commands, and exactly as they do."""

import subprocess
import sys

import pytest

import fringeworks as fw
from fringeworks.cli import commands
from fringeworks.cli.measuring import answered, plain_call
from fringeworks.simulate import bust, fringe_plan, look, photograph, standard_rig


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plain")
    rig = standard_rig(scale=0.15)
    plan = fringe_plan(rig, both=False)
    fw.files.write_stack(folder / "shots", photograph(look(rig, bust()), plan), plan)
    fw.files.write_rig(folder / "rig.toml", rig)
    (folder / "broken.toml").write_text('kind = "rig"\n[camera]\nsize_px = [1, 2]\n')
    return folder


CALLS = [
    ["measure", "shots", "--rig", "rig.toml", "--out", "points.ply"],
    ["--quiet", "measure", "shots", "--rig", "rig.toml", "--out", "points.ply"],
    ["-q", "measure", "--out", "points.npz", "--rig", "rig.toml", "shots"],
    ["measure", "shots", "--rig", "rig.toml"],
    ["measure", "nothing", "--rig", "rig.toml", "--out", "points.ply"],
    ["measure", "shots", "--rig", "nothing.toml", "--out", "points.ply"],
    ["measure", "shots", "--rig", "broken.toml", "--out", "points.ply"],
    ["measure", "shots", "--rig", "rig.toml", "--out", "points.doc"],
    ["measure", "shots", "--rig", "rig.toml", "--out", "nowhere/points.ply"],
    ["measure", "shots", "--rig", "rig.toml", "--out", "rig.toml"],
]


@pytest.mark.parametrize("words", CALLS, ids=" ".join)
def test_as_the_command_itself(words, place, monkeypatch, capsys):
    monkeypatch.chdir(place)
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    said = []
    for run in (commands.run, answered):
        for old in place.glob("points.*"):
            old.unlink()
        code = run(words)
        files = {path.name: path.read_bytes() for path in place.glob("points.*")}
        said.append((code, capsys.readouterr(), files))
    assert said[0] == said[1]
    assert said[0][0] == (0 if "points" in "".join(said[0][2]) or len(words) == 4 else 2)


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["measure"],
        ["--help"],
        ["measure", "--help"],
        ["measure", "shots", "--rig"],
        ["measure", "shots", "--rig", "rig.toml", "--out", "-"],
        ["measure", "shots", "--rig", "rig.toml", "--axis", "x"],
        ["measure", "shots", "--rig=rig.toml", "--out", "points.ply"],
        ["measure", "one", "two", "--rig", "rig.toml"],
        ["measure", "one", "two", "three", "--rig", "rig.toml"],
        ["measure", "shots", "--rig", "rig.toml", "--rig", "rig.toml"],
        ["--verbose", "measure", "shots", "--rig", "rig.toml"],
        ["decode", "shots", "--rig", "rig.toml"],
        ["measure", "", "--rig", "rig.toml"],
    ],
    ids=" ".join,
)
def test_other_calls_are_left_to_the_commands(words):
    assert plain_call(words) is None


HEAVY = {"typer", "rich", "pydantic", "scipy", "cv2", "matplotlib", "PIL", "h5py", "numpy.ma"}


def loaded(script, *words, cwd):
    """Heavy modules that a process has when it ends."""
    done = subprocess.run(
        [sys.executable, "-c", f"{script}\nimport sys; print(*set(sys.modules))", *words],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=True,
    )
    return HEAVY & set(done.stdout.split())


@pytest.mark.system
def test_it_loads_nothing_that_it_does_not_need(place):
    modules = "fringeworks.cli.measuring, fringeworks.pipeline.stacks, fringeworks.files.points"
    assert loaded(f"import {modules}", cwd=place) == set()
    script = (
        "from fringeworks.cli import main\n"
        "try: main()\n"
        "except SystemExit as end: assert not end.code"
    )
    words = ["--quiet", "measure", "shots", "--rig", "rig.toml", "--out", "points.ply"]
    # Depth steps and paint in the scene are judged by SciPy's filters.
    assert loaded(script, *words, cwd=place) <= {"scipy", "numpy.ma"}
