"""The command line, the studio, and the Python that the studio prints take the same frames."""

from __future__ import annotations

import contextlib
import math
import os
import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("nicegui", reason="nicegui is not installed")

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.cli.devices import TakingOptions
from fringeworks.devices import virtual_camera
from fringeworks.devices.bench import SCALE, virtual_bench
from fringeworks.scan.bench import Take
from fringeworks.serving.worker import Job
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.scene import standard_scene
from fringeworks.simulate.standard import board_body, board_poses, bust, fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look
from fringeworks.studio.actions import MergeViews, Scan
from fringeworks.studio.session import Shown
from fringeworks.studio.state import Studio
from tests.grids import quick

SCENE = "virtual:sphere"
FRAMES = 9


class AtOnce:
    """Stands for a worker: does the work in this process, so that a test may look into it."""

    def __init__(self):
        self.job, self.busy = None, False

    def start(self, name, task, *given, total=0, wait=False):  # noqa: ARG002
        self.job = Job(name, total)
        try:
            self.job.result, self.job.state = task(self, *given), "done"
        except fw.InputError as problem:
            self.job.problem, self.job.state = str(problem), "failed"
        return self.job

    def progress(self, label):
        self.job.label, self.job.steps = label, self.job.steps + 1

    def close(self):
        """Nothing to end."""


SETUP = """
plan = "setup.plan.toml"
predicted_sigma_px = 0.03

[projector]
open = "virtual"
name = "virtual"
size_px = [576, 360]
gamma = 1.0
contrast = 1000.0
min_period_px = 8.0

[camera]
open = "virtual:plane"
name = "virtual"
modulation = 60.0

[settings]
exposure_ms = 16.666666666666668
gain_db = 1.2

[noise]
read_counts = 1.0
gain = 0.02

[delay]
appears_s = 0.0147
absent_s = 0.0
alone_s = 0.0314
left_s = 0.0147
refresh_s = 0.016666666666666666
frame_s = 0.016666666666666666
"""
"""What ``setup`` finds of the virtual devices, in short."""


def set_up(place, both=False):
    """A folder with a set-up, a plan and a rig."""
    place.mkdir(exist_ok=True)
    (place / "setup.toml").write_text(SETUP)
    rig = standard_rig(scale=SCALE)
    fw.files.write_rig(place / "rig.toml", rig)
    plan = fringe_plan(rig, both=both)
    blocks = tuple(replace(block, shifts_rad=fw.patterns.equal_steps(3)) for block in plan.blocks)
    fw.files.write_plan(place / "setup.plan.toml", replace(plan, blocks=blocks))
    return place


@pytest.fixture(scope="module")
def setup(tmp_path_factory):
    return set_up(tmp_path_factory.mktemp("setup"))


@pytest.fixture
def studio(setup, tmp_path):
    """A studio whose work is done at once."""
    shutil.copytree(setup, tmp_path / "studio")
    made = Studio(tmp_path / "studio")
    made.devices = made.compute = AtOnce()
    made.scene = "sphere"
    yield made
    made.close()


def content(folder):
    """Names and bytes of all files in a folder, or of one file."""
    files = [folder] if folder.is_file() else sorted(folder.rglob("*"))
    return {str(p.relative_to(folder)): p.read_bytes() for p in files if p.is_file()}


def faces(studio, setup, tmp_path, name):
    """What the studio has made, and what its commands and its Python make in other folders."""
    yield content(studio.workspace.root / name)
    done = studio.log.done
    for face in ("shell", "python"):
        shutil.copytree(setup, tmp_path / face, dirs_exist_ok=True)
        with contextlib.chdir(tmp_path / face):
            for command in done:
                if face == "python":
                    exec(f"import fringeworks as fw\n{command.python}", {})
                    continue
                for line in command.shell.splitlines():
                    assert run(["-q", *shlex.split(line)[1:]]) == 0, line
        yield content(tmp_path / face / name)


@pytest.mark.parametrize(
    ("how", "frames"),
    [
        (Take(), FRAMES),
        (Take(auto_exposure=True), FRAMES),
        pytest.param(*(Take(hdr=2), 2 * FRAMES), marks=pytest.mark.long),
        pytest.param(*(Take(average=3), FRAMES), marks=pytest.mark.long),
        (Take(hdr=2, average=2), 2 * FRAMES),
        pytest.param(*(Take(fast=True), FRAMES), marks=pytest.mark.long),
        (Take(fast=True, average=2), FRAMES),
    ],
    ids=repr,
)
def test_every_face_takes_the_same_frames(studio, setup, tmp_path, how, frames):
    job = studio.scan(studio.session("one"), "part", how)
    assert job.state == "done", job.problem
    assert job.steps == frames + 1
    one, shell, python = faces(studio, setup, tmp_path, "part")
    assert len([name for name in one if name.endswith((".png", ".tif"))]) == frames
    assert one == shell
    assert one == python
    # A script is two lines.
    assert studio.log.done[0].python.count("\n") == 1


@pytest.mark.parametrize("changed", ["seed", "grabs"])
def test_the_comparison_is_not_vacuous(studio, setup, tmp_path, monkeypatch, changed):
    """Frames are noisy: another seed, or one grab more in the beginning, makes other bytes."""
    studio.scan(studio.session("one"), "part")
    configure = virtual_camera.VirtualCamera.configure

    def grabbing(self, settings):
        found = configure(self, settings)
        self.grab()
        return found

    if changed == "seed":
        monkeypatch.setitem(virtual_bench.__kwdefaults__, "seed", 1)
    else:
        monkeypatch.setattr(virtual_camera.VirtualCamera, "configure", grabbing)
    one, shell, python = faces(studio, setup, tmp_path, "part")
    assert shell == python
    assert one.keys() == shell.keys()
    assert all(one[name] != shell[name] for name in one if name.endswith(".png"))
    stacks = [
        fw.files.read_stack(place / "part") for place in (studio.workspace.root, tmp_path / "shell")
    ]
    noise = np.subtract(*(stack.frames[0].astype(float) for stack in stacks))
    assert 0.5 < np.std(noise) < 10.0


@pytest.mark.parametrize("how", quick([Take(), Take(hdr=2), Take(average=2)], Take()), ids=repr)
def test_every_face_resumes(studio, setup, tmp_path, monkeypatch, how):
    """Interrupted after as many grabs and resumed, every face has the same frames."""
    count, last = [0], [math.inf]
    whole = virtual_camera.VirtualCamera.grab

    def failing(self, timeout_s=5.0):
        count[0] += 1
        if count[0] == last[0]:
            raise fw.DeviceProblem("camera: gone")
        return whole(self, timeout_s)

    monkeypatch.setattr(virtual_camera.VirtualCamera, "grab", failing)
    session, resumed = studio.session("one"), Take(**how.changed, resume=True)
    assert studio.scan(session, "whole", how).state == "done"
    count[0], last[0] = 0, count[0] - 5 * how.average
    assert "gone" in studio.scan(session, "part", how).problem
    begun = content(studio.workspace.root / "part")
    taken = {name for name in begun if name.endswith((".png", ".tif"))}
    assert 0 < len(taken) < FRAMES * how.hdr
    with pytest.raises(fw.InputError, match="already"):
        studio.scan(session, "part", how)
    for face in ("shell", "python"):
        with contextlib.chdir(shutil.copytree(setup, tmp_path / face)):
            command = Scan("part", how, {"camera": SCENE}).command(None)
            count[0] = 0
            if face == "shell":
                assert run(["-q", *shlex.split(command.shell)[1:]]) == 2
            else:
                with pytest.raises(fw.DeviceProblem, match="gone"):
                    exec(f"import fringeworks as fw\n{command.python}", {})
            assert content(Path("part")) == begun
    last[0] = math.inf
    assert studio.scan(session, "part", resumed).state == "done"
    one, shell, python = faces(studio, setup, tmp_path, "part")
    assert {name: one[name] for name in taken} == {name: begun[name] for name in taken}
    assert one == shell
    assert one == python


def test_every_face_takes_the_views_of_a_turntable(setup, tmp_path, monkeypatch, capsys):
    """The virtual ball does not turn, and no shape tells its views apart: only frames are compared."""
    for face in ("shell", "python"):
        shutil.copytree(setup, tmp_path / face)
    monkeypatch.chdir(tmp_path / "shell")
    turned = "import sys, pathlib; pathlib.Path('angles').open('a').write(sys.argv[1] + ' ')"
    words = "-q scan --setup setup.toml --camera virtual:sphere --rig rig.toml --average 2"
    turned_by = ["--turntable", "120"]
    turn = f"{shlex.quote(os.sys.executable)} -c {shlex.quote(turned)} {{angle}}"
    assert (
        run([*words.split(), *turned_by, "--turn", turn, "--capture", "part", "--out", "part.ply"])
        == 2
    )
    assert "the shape slides on itself" in capsys.readouterr().err
    assert Path("angles").read_text() == "120 240 "
    monkeypatch.chdir(tmp_path / "python")
    angles = []
    with (
        fw.scan.open_bench("setup.toml", camera=SCENE) as bench,
        pytest.raises(fw.InputError, match="the shape slides on itself"),
    ):
        fw.scan.scan_turntable(
            lambda place: fw.scan.take(bench, place, fw.scan.Take(average=2)),
            angles.append,
            "part",
            "rig.toml",
            step_deg=120.0,
        )
    assert angles == [120.0, 240.0]
    one, other = content(tmp_path / "shell" / "part"), content(tmp_path / "python" / "part")
    assert len([name for name in one if name.endswith(".tif")]) == 3 * FRAMES
    assert one == other
    first = sorted(name for name in one if name.startswith("view_00") and name.endswith(".tif"))
    assert all(one[name] != one[name.replace("view_00", "view_01")] for name in first)


@pytest.mark.parametrize("suffix", [".stl", ".obj"])
def test_every_face_writes_the_same_mesh(captures, studio, tmp_path, suffix):
    session = studio.session("one")
    job = studio.write_mesh(session, Shown("part", "windowed", {}, 0), suffix)
    assert job.state == "done", job.problem
    one, shell, python = faces(studio, captures, tmp_path, f"part{suffix}")
    assert one == shell
    assert one == python
    again = studio.write_mesh(session, Shown("part", "windowed", {}, 0), suffix)
    assert again.result == f"part-2{suffix}"
    refused = studio.write_mesh(session, Shown("pair", "windowed", {}, 0), suffix)
    assert "expected points in the order" in refused.problem


def test_every_face_compares_with_a_drawing(captures, studio, capsys):
    """The drawing is a mesh of the same points with fewer triangles."""
    session = studio.session("one")
    cloud = fw.files.read_cloud(captures / "cloud.npz")
    model = fw.surface.decimate(fw.surface.cloud_mesh(cloud), 3000)
    for folder in (studio.workspace.root, captures):
        fw.files.write_mesh(folder / "part.stl", model)
    job = studio.deviate(session, "part", "part.stl", 0.5)
    assert job.state == "done", job.problem
    assert job.result["figures"]["rms_mm"] < 0.5
    assert studio.surface(session.pending.number).stat().st_size > 1000
    command = studio.log.done[-1]
    assert command.shell.splitlines()[-1].startswith("fringeworks deviation part.npz --model")
    with contextlib.chdir(captures):
        capsys.readouterr()
        exec(f"import fringeworks as fw\n{command.python}", {})
        assert f"'rms_mm': {job.result['figures']['rms_mm']!r}" in capsys.readouterr().out
        for line in command.shell.splitlines():
            # Edges of the part lie beyond the tolerance.
            assert run(["-q", *shlex.split(line)[1:]]) == (3 if "--tolerance" in line else 0), line
    with pytest.raises(fw.InputError, match="drawing"):
        studio.deviate(session, "part", "../part.stl", None)


def test_a_series_of_the_studio_is_its_scans(studio, setup, tmp_path):
    """As on a turntable: each scan opens the devices, and so do its commands."""
    for name in ("part-000.0deg", "part-120.0deg"):
        assert studio.scan(studio.session("one"), name, Take(average=2)).state == "done"
    for name in ("part-000.0deg", "part-120.0deg"):
        one, shell, python = faces(studio, setup, tmp_path / f"again {name}", name)
        assert one == shell
        assert one == python


def test_poses_are_captures(studio, tmp_path):
    """A pose that is taken on the page is what the command takes; deleted ones are left out."""
    set_up(studio.workspace.root, both=True)
    again = shutil.copytree(studio.workspace.root, tmp_path / "setup")
    session = studio.session("one")
    for k in range(2):
        studio.scene = f"board-{k}"
        job = studio.take_pose(session)
        assert job.state == "done", job.problem
    studio.undo_pose("pose-02")
    one, shell, python = faces(studio, again, tmp_path, "board/pose-01")
    assert one == shell
    assert one == python
    assert len(studio.log.done) == 1


@pytest.fixture(scope="module")
def taken(tmp_path_factory):
    """A pair, a stack and points."""
    root = tmp_path_factory.mktemp("taken")
    fw.files.write_pair(
        root / "pair", standard_scene("parabola", size=120, fringes=8, bits=8, seed=1)
    )
    rig = standard_rig(scale=SCALE)
    plan = fringe_plan(rig, both=False)
    fw.files.write_stack(
        root / "part", list(photograph(look(rig, bust()), plan, Optics(seed=1))), plan
    )
    fw.write(root / "cloud.npz", fw.measure(root / "part", rig).points)
    return root


@pytest.fixture
def captures(studio, taken, tmp_path):
    """The studio's folder with a pair, a stack, points, and an area; and a copy of it."""
    root = shutil.copytree(taken, studio.workspace.root, dirs_exist_ok=True)
    return shutil.copytree(root, tmp_path / "copy")


EXPORTS = [
    ("pair", "windowed", {}, ".tif", ""),
    ("pair", "windowed", {"paint": False, "iterations": 2}, ".npz", ""),
    ("pair", "fourier", {}, ".html", ""),
    ("part", "windowed", {}, ".ply", "points"),
    ("part", "windowed", {}, ".ply", "mesh"),
    ("part", "windowed", {}, ".html", ""),
    ("cloud.npz", "windowed", {}, ".ply", "mesh"),
    ("cloud.npz", "windowed", {}, ".html", ""),
    ("without a rig", "windowed", {}, ".npz", ""),
]


@pytest.mark.parametrize(
    ("source", "method", "options", "suffix", "kind"),
    # Each source, suffix and kind of content once.
    quick(EXPORTS, *(EXPORTS[k] for k in (0, 1, 3, 5, 6, 8))),
)
def test_every_face_writes_the_same_files(
    studio, captures, tmp_path, monkeypatch, source, method, options, suffix, kind
):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    if source == "without a rig":
        source = "part"
        for place in (studio.workspace.root, captures):
            (place / "rig.toml").unlink()
    shown = Shown(source, method, options, 1)
    job = studio.export(studio.session("one"), shown, suffix, kind)
    assert job.state == "done", job.problem
    one, shell, python = faces(studio, captures, tmp_path, job.result)
    assert one
    assert one == shell
    assert one == python


@pytest.mark.parametrize("source", ["pair", "cloud.npz"])
def test_every_face_measures_within_the_area(studio, captures, tmp_path, monkeypatch, source):
    """A file is inspected in Python only: no command reads a result to measure in an area of it."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    box = (40, 40, 80, 80) if source == "pair" else (120, 80, 260, 220)
    studio.recipes.set_area("middle", fw.evaluate.Area(box=box))
    studio.recipes.confine("middle")
    session = studio.session("one")
    job = studio.export(session, Shown(source, "windowed", {}, 1), ".ply", "points")
    assert job.state == "done", job.problem
    shutil.copy(studio.workspace.recipe, captures)
    one, shell, python = faces(studio, captures, tmp_path, job.result)
    assert one == python
    if source == "pair":
        assert one == shell
    else:
        assert not studio.log.done[-1].shell


@pytest.mark.long
@pytest.mark.timeout(600)
def test_every_face_sets_up_and_calibrates(studio, setup, tmp_path, monkeypatch):
    """Set-ups are equal byte by byte, rigs to the last digits; their pictures are there."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    studio.scene = "plane"
    job = studio.run_setup(studio.session("one"))
    assert job.state == "done", job.problem
    board = fw.rig.parse_board(studio.board)
    rig = standard_rig(scale=SCALE)
    for k, place in enumerate(board_poses(board, 4, seed=1)):
        view = look(rig, [board_body(board, place)])
        frames = list(photograph(view, fringe_plan(rig), Optics(seed=k)))
        pose = studio.workspace.poses / f"pose-{k + 1:02d}"
        fw.files.write_stack(pose, frames, fringe_plan(rig))
    copy = shutil.copytree(setup, tmp_path / "copy")
    shutil.copytree(studio.workspace.poses, copy / "board")
    job = studio.calibrate(studio.session("one"))
    assert job.state == "done", job.problem
    one, shell, python = (
        {name: file for name, file in files.items() if name.startswith("setup")}
        for files in faces(studio, copy, tmp_path, "")
    )
    tables = [name for name in one if name.endswith(".toml")]
    assert len(tables) >= 2
    assert all(one[name] == shell[name] == python[name] for name in tables)
    # The sums of a calibration depend on where its arrays lie in memory, in the last digits.
    rigs = [tmp_path / face / "rig.toml" for face in ("studio", "shell", "python")]
    focal = [fw.files.read_rig(path).camera.focal_px for path in rigs]
    assert focal[1] == pytest.approx(focal[0], rel=1e-9)
    assert focal[2] == pytest.approx(focal[0], rel=1e-9)
    for place in (studio.workspace.root, tmp_path / "shell", tmp_path / "python"):
        assert (place / "setup.png").is_file()
        assert (place / "rig.png").is_file()


def test_options_have_one_name_and_one_default():
    """The command's options are the fields of what the library takes."""
    assert Take(**vars(TakingOptions())) == Take()
    assert vars(TakingOptions()) == vars(Take())


def test_a_script_says_what_the_actions_say():
    """Words are quoted, and whatever is usual is left out."""
    one = Scan("a part", Take(hdr=3, average=2), {"camera": "webcam:1"}).command(None)
    assert one.shell == (
        "fringeworks capture --setup setup.toml --camera webcam:1 --hdr 3 --average 2 "
        "--out 'a part'"
    )
    assert one.python == (
        "with fw.scan.open_bench('setup.toml', camera='webcam:1') as bench:\n"
        "    fw.scan.take(bench, 'a part', fw.scan.Take(hdr=3, average=2))"
    )
    merged = MergeViews(("a", "b"), "", 90.0, "part").command(None)
    assert merged.shell.splitlines()[2] == (
        "fringeworks merge a.npz b.npz --poses shape --out part.ply"
    )


def test_contradictions_are_one_sentence():
    for given in ({"hdr": 2}, {"auto_exposure": True}):
        with pytest.raises(fw.InputError, match="fast cannot be combined"):
            Take(fast=True, **given)
    with pytest.raises(fw.InputError, match="hdr: expected 1"):
        Take(hdr=0)
