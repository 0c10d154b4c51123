"""The command line as a user types it."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

import fringeworks as fw
from fringeworks.files.response import write_response
from fringeworks.files.surfaces import read_surface
from fringeworks.showcase.chapter4 import PARTS
from fringeworks.signal.response import Response
from tests.commands import COLUMNS, run, run_alone
from tests.public import public_names


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    folder = tmp_path_factory.mktemp("capture") / "part"
    run(
        *("simulate", "--shape", "parabola", "--gamma", "2.2", "--bits", "8", "--noise", "2"),
        *("--seed", "1", "--size", "300", "--fringes", "15", "--height-mm", "60", "--out", folder),
    )
    return folder


def test_simulate_then_reconstruct(capture, tmp_path):
    names = sorted(p.name for p in capture.iterdir())
    assert names == [".fringeworks", "capture.toml", "object.png", "reference.png", "truth.tif"]
    out, metrics, figure = tmp_path / "part.ply", tmp_path / "m.json", tmp_path / "f.png"
    done = run(
        *("reconstruct", capture, "--method", "windowed"),
        *("--out", out, "--json", metrics, "--figure", figure, "--ply", "mesh"),
    )
    assert "against the truth" in done.stdout
    assert out.read_bytes().startswith(b"ply\n")
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert "NaN" not in metrics.read_text()
    content = json.loads(metrics.read_text())
    assert content["errors"]["edge_mean_abs_error_mm"] is None  # a parabola has no cliff
    assert content["unit"] == "mm"
    assert content["failed_fraction"] < 0.01
    assert content["maximum"] == pytest.approx(60, abs=4)
    assert content["errors"]["mean_abs_error_mm"] < 0.6
    assert content["reasons"]["ok"] == 90000 - sum(
        n for k, n in content["reasons"].items() if k != "ok"
    )


def test_reconstruct_two_images(capture, tmp_path):
    reference, object_ = capture / "reference.png", capture / "object.png"
    out = tmp_path / "u.tif"
    done = run(
        "reconstruct",
        "--reference",
        reference,
        "--object",
        object_,
        "--method",
        "gsifa",
        "--out",
        out,
    )
    assert "displacement in px" in done.stdout
    assert tifffile.imread(out).shape == (300, 300)
    out = tmp_path / "h.npz"
    run(
        *("reconstruct", "--reference", reference, "--object", object_, "--method", "fourier"),
        *("--option", "width=0.7", "--distance-mm", 5000, "--baseline-mm", 2000),
        *("--pitch-mm-per-px", 3.3333, "--axis", "x", "--out", out),
    )
    assert np.nanmax(read_surface(out).values) == pytest.approx(60, abs=5)


def test_json_on_stdout_is_json_only(capture):
    done = run("reconstruct", capture, "--json", "-")
    assert json.loads(done.stdout)["method"] == "windowed"


def test_compare(tmp_path):
    table = tmp_path / "table.json"
    done = run(
        *("compare", "--shape", "parabola", "--gamma", "1", "--noise", "0", "--bits", "0"),
        *("--method", "ifa,sifa,gsifa,exact,windowed", "--size", "200", "--fringes", "5"),
        "--timing",
        *("--json", table, "--csv", tmp_path / "t.csv", "--markdown", tmp_path / "t.md"),
    )
    rows = json.loads(table.read_text())["rows"]
    assert [row["method"] for row in rows] == ["ifa", "sifa", "gsifa", "exact", "windowed"]
    assert all(set(row) >= COLUMNS for row in rows)
    lines = done.stdout.splitlines()
    assert lines[0] == "parabola, γ 1, noise of 0 counts, not quantised, 5 fringes"
    assert len(lines) == 7
    assert max(map(len, lines)) <= 80
    assert lines[1].split()[0] == "method"
    assert (tmp_path / "t.csv").read_text().startswith("object,method,gamma")
    assert (tmp_path / "t.md").read_text().startswith("| object |")


def test_mask_option(capture, tmp_path):
    mask = np.zeros((300, 300), np.uint8)
    mask[100:200] = 255
    Image.fromarray(mask).save(tmp_path / "mask.png")
    run("reconstruct", capture, "--mask", tmp_path / "mask.png", "--out", tmp_path / "r.npz")
    values = read_surface(tmp_path / "r.npz").values
    assert np.isnan(values[:100]).all()
    assert np.isfinite(values[110:190]).all()


def test_help_and_methods():
    assert "reconstruct" in run().stdout
    assert "--reference" in run("reconstruct", "--help").stdout
    done = run("methods")
    for name in ("ifa", "gsifa", "windowed", "fourier"):
        assert name in done.stdout


@pytest.fixture
def frames(tmp_path):
    x = np.arange(80)
    fringe = np.tile((127 + 100 * np.cos(2 * np.pi * x / 16)).astype(np.uint8), (60, 1))
    files = {
        "good.png": fringe,
        "wide.png": np.hstack([fringe, fringe]),
        "black.png": np.zeros_like(fringe),
        "flat.png": np.full_like(fringe, 90),
        "noise.png": np.random.default_rng(0).integers(0, 255, fringe.shape, np.uint8),
    }
    for name, array in files.items():
        Image.fromarray(array).save(tmp_path / name)
    (tmp_path / "empty.png").touch()
    (tmp_path / "cut.png").write_bytes((tmp_path / "noise.png").read_bytes()[:2000])
    return tmp_path


PAIRS = {
    "sizes differ": ("good.png", "wide.png", "equal sizes"),
    "black object": ("good.png", "black.png", "all-black"),
    "black reference": ("black.png", "good.png", "all-black"),
    "no fringes": ("noise.png", "good.png", "expected fringes"),
    "flat object": ("good.png", "flat.png", "expected fringes"),
    "empty": ("good.png", "empty.png", "empty file"),
    "truncated": ("good.png", "cut.png", "readable image"),
    "missing": ("good.png", "nowhere.png", "no such file"),
}


@pytest.mark.parametrize("case", PAIRS)
def test_bad_frames(frames, case):
    reference, object_, message = PAIRS[case]
    out = frames / "out.tif"
    done = run(
        "reconstruct",
        "--reference",
        frames / reference,
        "--object",
        frames / object_,
        "--out",
        out,
        code=2,
    )
    assert message in done.stderr
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("reconstruct",), "expected either a capture, or --reference and --object"),
        (("reconstruct", "--reference", "good.png"), "expected two images, got one: --object"),
        (("reconstruct", "nowhere"), "got nothing there"),
        (("reconstruct", "--reference", "good.png", "--object", "good.png", "--method", "magic"), "expected one of"),
        (("reconstruct", "--reference", "good.png", "--object", "good.png", "--axis", "y"), "expected fringes along y"),
        (("reconstruct", "--reference", "good.png", "--object", "good.png", "--out", "no/such/x.tif"), "expected a writable folder"),
        (("reconstruct", "--reference", "good.png", "--object", "good.png", "--out", "x.doc"), "expected one of .tif"),
        (("reconstruct", "--reference", "good.png", "--object", "good.png", "--option", "n=3"), "it has scales"),
        (("reconstruct", "--reference", "good.png", "--object", "good.png", "--option", "scales=x"), "expected a number, a list, True, False or None"),
        (("reconstruct", "--reference", "good.png", "--object", "good.png", "--distance-mm", "5"), "--baseline-mm"),
        (("simulate", "--out", "good.png"), "expected a folder"),
        (("simulate", "--shape", "teapot", "--out", "x"), "expected one of parabola"),
        (("simulate", "--height-mm", "9000", "--out", "x"), "below the pupils"),
        (("compare", "--gamma", "a,b"), "--gamma: expected values"),
        (("compare", "--method", "gsifa,magic"), "expected one of"),
        (("compare", "--nonsense",), "--nonsense"),
        (("dance",), "dance"),
    ],
)  # fmt: skip
def test_bad_calls(frames, arguments, message):
    before = sorted(frames.iterdir())
    done = run(*arguments, cwd=frames, code=2)
    assert message in done.stderr
    assert sorted(frames.iterdir()) == before


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_unwritable_folder(capture, tmp_path):
    tmp_path.chmod(0o500)
    run("reconstruct", capture, "--out", tmp_path / "x.tif", code=2)


@pytest.mark.system
def test_anything_else_is_exit_code_1():
    command = [
        sys.executable,
        "-c",
        "import fringeworks.cli.app as a; a.app = lambda *x, **k: 1 / 0; import fringeworks.cli as c; c.main()",
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1


def shown(name, folder):
    environment = {**os.environ}
    environment.pop("FRINGEWORKS_DATA", None)
    command = [sys.executable, "-m", "fringeworks", name, "--size", "160", "--out", folder]
    subprocess.run(command, check=True, env=environment, capture_output=True, timeout=200)
    return {p.name for p in folder.iterdir()}


SHOWN = {
    "ideal.png",
    "camera.png",
    "errors.md",
    "errors.json",
    "parabola.ply",
    "capture",
    "rig.toml",
    "rig.md",
    "calibration.md",
    "bust",
    "bust.ply",
    "bust.html",
    "rig_bust.png",
    "sphere.ply",
    "plane.ply",
}
"""What the demonstration writes, among others."""


@pytest.mark.system
@pytest.mark.long
def test_demo(tmp_path):
    assert shown("demo", tmp_path / "demo") >= SHOWN


@pytest.mark.system
def test_demo_of_one_object_and_three_poses(tmp_path, monkeypatch):
    """The same steps with the least that each takes."""
    monkeypatch.delenv("FRINGEWORKS_DATA", raising=False)
    monkeypatch.setattr("fringeworks.showcase.demo.BODIES", ("parabola",))
    monkeypatch.setattr("fringeworks.showcase.demo.METHODS", ("gsifa", "fourier", "windowed"))
    monkeypatch.setattr("fringeworks.showcase.demo_rig.POSES", 3)
    folder = tmp_path / "demo"
    said = run("demo", "--size", "160", "--out", folder).stdout
    assert {p.name for p in folder.iterdir()} >= SHOWN
    assert "with a calibrated rig:" in said
    assert "no real captures" in said
    errors = json.loads((folder / "errors.json").read_text())
    assert {(row["case"], row["method"]) for row in errors} == {
        (case, method)
        for case in ("ideal", "camera")
        for method in ("gsifa", "fourier", "windowed")
    }


@pytest.mark.system
@pytest.mark.long
def test_paper(tmp_path):
    shown("paper", tmp_path)
    figures = sorted(p.stem for p in tmp_path.glob("*.svg"))
    captions = {name for part in PARTS.values() for name in part}
    assert captions == set(figures)
    page = (tmp_path / "chapter4.html").read_text()
    assert page.count("<img ") == len(figures)
    assert (tmp_path / "chapter4.pdf").read_bytes().startswith(b"%PDF")


def test_single_frame_denoised(tmp_path):
    y, x = np.mgrid[:120, :160].astype(float)
    bump = 2.0 * np.exp(-((x - 80) ** 2 + (y - 60) ** 2) / 500)
    fringes = (127 + 100 * np.cos(2 * np.pi * x / 16 - bump)).astype(np.uint8)
    Image.fromarray(fringes).save(tmp_path / "one.png")
    figures = tmp_path / "m.json"
    run("reconstruct", "--object", tmp_path / "one.png", "--denoise", "emd2d", "--json", figures)
    content = json.loads(figures.read_text())
    assert any("no reference frame" in note for note in content["notes"])
    assert abs(content["tilt_deg"]) < 1.0


def test_options_may_be_words_or_numbers(capture, tmp_path):
    figures = tmp_path / "m.json"
    run(
        *("reconstruct", capture, "--method", "wavelet", "--option", "path=smooth"),
        *("--option", "omega=7", "--json", figures),
    )
    assert json.loads(figures.read_text())["errors"]["mean_abs_error_mm"] < 2.0
    wrong = run("reconstruct", capture, "--method", "wavelet", "--option", "path=magic", code=2)
    assert "path: expected largest or smooth, got 'magic'" in wrong.stderr


@pytest.mark.system
def test_matrix_prints_and_draws_a_map(tmp_path):
    picture = tmp_path / "map.png"
    shown = run(
        *("compare", "--matrix", "--shape", "parabola", "--gamma", "1", "--noise", "0,2"),
        *("--fringes", "5,10", "--size", "150", "--method", "fourier,windowed,exact"),
        *("--figure", picture),
    ).stdout
    assert "5 fringes" in shown
    assert "windowed has the lowest mean error in" in shown
    assert picture.stat().st_size > 5000


def test_response_is_applied(tmp_path):
    table = np.zeros((1, 256))
    out = write_response(
        tmp_path / "response.toml", Response("left", "bench", 2.2, 3, 1.0, table, (200.0,), 0.0)
    )
    devices = ("--camera-name", "left", "--projector-name", "bench")
    run(
        "simulate",
        "--out",
        tmp_path / "s",
        "--size",
        "160",
        "--fringes",
        "8",
        "--gamma",
        "2.2",
        "--height-mm",
        "20",
        "--bits",
        "8",
    )
    ok = run("reconstruct", tmp_path / "s", "--response", out, *devices).stdout
    assert "a response with γ = 2.2" in ok
    for given, words in (
        ((), "does not name its camera"),
        (("--camera-name", "right", "--projector-name", "bench"), "the capture is of 'right'"),
    ):
        refused = run("reconstruct", tmp_path / "s", "--response", out, *given, code=2)
        assert words in refused.stderr


def test_version_quiet_and_log(capture, tmp_path):
    import fringeworks

    assert run("--version").stdout == f"fringeworks {fringeworks.__version__}\n"
    log = tmp_path / "run.log"
    done = run("--quiet", "--log", log, "reconstruct", capture, "--method", "fourier")
    assert done.stdout == done.stderr == ""
    run("--log", log, "reconstruct", "nowhere", code=2)
    lines = log.read_text().splitlines()
    assert all(re.match(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ ", line) for line in lines)
    assert any("height: " in line for line in lines)
    assert "error: nowhere: expected a capture folder" in lines[-1]
    assert "could not be written" in run("--log", tmp_path, "methods", code=2).stderr


@pytest.mark.system
def test_standard_output_takes_any_result(capture):
    command = [sys.executable, "-m", "fringeworks", "reconstruct", capture, "--method", "fourier"]

    def bytes_of(*options):
        return subprocess.run([*command, *options], capture_output=True, check=True, timeout=60)

    done = bytes_of("--out", "-")
    assert tifffile.imread(io.BytesIO(done.stdout)).shape == (300, 300)
    assert b"median" in done.stderr  # words give way to the result
    assert bytes_of("--figure", "-").stdout.startswith(b"\x89PNG")
    assert "standard output" in run("simulate", "--out", "-", code=2).stderr
    both = ("reconstruct", capture, "--out", "-", "--json", "-")
    assert "one result on standard output, got 2" in run(*both, code=2).stderr


@pytest.mark.system
def test_an_interrupt_is_answered(tmp_path):
    folder = tmp_path / "figures"
    command = [sys.executable, "-m", "fringeworks", "paper", "--size", "160", "--out", folder]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        while not list(folder.glob("*.svg")):
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (130, "fringeworks: interrupted\n")
    # The same while modules are imported.
    script = """
import os, signal, sys
class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == "typer":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupting())
from fringeworks.cli import main
main()
"""
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stderr) == (130, "fringeworks: interrupted\n")


PLUGIN = '''
import numpy as np
import fringeworks as fw

@fw.method("still")
def still(pair: fw.pair.PreparedPair, *, sigma: float = 0.5) -> fw.pair.Solution:
    """Finds no displacement anywhere."""
    zero = np.zeros(pair.object.shape)
    reason = np.zeros(zero.shape, np.uint8)
    return fw.pair.Solution(zero, zero + sigma, zero + 1, reason)

@fw.method("wrong")
def wrong(pair):
    """Returns something else."""
    return pair.object
'''


@pytest.mark.system
def test_methods_from_outside(capture, tmp_path):
    plugin = tmp_path / "mine.py"
    plugin.write_text(PLUGIN)
    own = ("--plugin", plugin)
    assert "Finds no displacement" in run_alone(*own, "methods").stdout
    figures = run_alone(
        *own, "reconstruct", capture, "--method", "still", "--option", "sigma=2", "--json", "-"
    )
    content = json.loads(figures.stdout)
    assert (content["maximum"], content["failed_fraction"]) == (0.0, 0.0)
    refused = run_alone(*own, "reconstruct", capture, "--method", "wrong", code=2).stderr
    assert (
        "method wrong: expected a fringeworks.pair.Solution to be returned, got ndarray" in refused
    )
    # Files that register nothing are refused in this process.
    taken = tmp_path / "taken.py"
    taken.write_text(PLUGIN.replace('"still"', '"fourier"'))
    assert (
        "expected a name that is free, got that of"
        in run("--plugin", taken, "methods", code=2).stderr
    )
    # Files of their own: Python takes one of the same size, written in the same second, for the other.
    for name, text, words in (
        ("none", "x = 1", "with the decorator"),
        ("fails", "1 / 0", "ZeroDivisionError"),
    ):
        other = tmp_path / f"{name}.py"
        other.write_text(text)
        assert words in run("--plugin", other, "methods", code=2).stderr
    assert "no such file" in run("--plugin", "none.py", "methods", code=2).stderr
    broken = tmp_path / "broken.py"
    broken.write_text(PLUGIN.replace("zero = ", "zero = 1 / "))
    broken = ("--plugin", broken, "reconstruct", capture, "--method", "still")
    assert "method still, from outside" in run_alone(*broken, code=2).stderr


def test_the_reference_page_is_complete():
    from fringeworks.cli.app import app

    page = (Path(__file__).parent.parent / "docs" / "reference.md").read_text()
    assert set(re.findall(r"^\| `fw\.([\w.]+)`", page, re.M)) == set(public_names())
    named = set(re.findall(r"^\| `([\w-]+)`", page, re.M))
    assert {c.name or c.callback.__name__ for c in app.registered_commands} <= named
    for group in app.registered_groups:
        for command in group.typer_instance.registered_commands:
            assert f"| `{group.name} {command.callback.__name__}` |" in page


@pytest.mark.system
def test_installed_methods_are_found(tmp_path):
    (tmp_path / "theirs.py").write_text(PLUGIN)
    info = tmp_path / "theirs-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[fringeworks.methods]\nstill = theirs\n")
    script = "import fringeworks as fw; print(*fw.methods())"
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=True)
    assert done.stdout.split()[-2:] == ["still", "wrong"]
    (tmp_path / "theirs.py").write_text("import nothing_there")
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert "plug-in still (theirs): could not be loaded: ModuleNotFoundError" in done.stderr


def test_every_command_has_an_example():
    from fringeworks.cli.app import SECTIONS, app

    for command in [*app.registered_commands, *app.registered_groups]:
        assert command.rich_help_panel in SECTIONS
    groups = [group.typer_instance for group in app.registered_groups]
    for command in [c for part in (app, *groups) for c in part.registered_commands]:
        assert command.epilog.startswith("Example: fringeworks "), command.name
        # The list of commands shows the first paragraph, cut at its first line.
        first = command.callback.__doc__.strip().splitlines()[0]
        assert first.endswith("."), first


@pytest.mark.system
def test_light_imports():
    script = (
        "import sys, fringeworks; heavy = {'numpy', 'h5py', 'typer', 'rich', 'matplotlib', 'scipy',"
        " 'cv2', 'pydantic'}; print(*heavy & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == []


@pytest.mark.system
def test_png_to_coordinates_imports_what_it_uses(tmp_path):
    plan = fw.PatternPlan(
        160,
        120,
        tuple(fw.patterns.PhaseSteps("x", p, fw.patterns.equal_steps(4)) for p in (160.0, 20.0)),
    )
    fw.files.write_stack(tmp_path / "capture", list(fw.encode(plan)), plan)
    script = (
        "import sys; from fringeworks.cli.commands import run; import fringeworks.pipeline.stacks; "
        "import fringeworks.files.points; code = run(sys.argv[1:]); heavy = {'PIL', 'tifffile', "
        "'cv2', 'matplotlib', 'h5py', *('scipy.' + name for name in ('linalg', "
        "'optimize', 'interpolate', 'sparse', 'fft', 'spatial'))}; "
        "print(code, *heavy & set(sys.modules))"
    )
    words = ["-q", "decode", str(tmp_path / "capture"), "--out", str(tmp_path / "x.npz")]
    done = subprocess.run(
        [sys.executable, "-c", script, *words], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["0"]


@pytest.mark.system
def test_start_is_quick():
    """``import fringeworks`` ≤ 2 × ``import numpy``, ``--help`` ≤ 3 ×, ``--version`` ≤ 1 ×."""

    def seconds(*command):
        best = float("inf")
        for _ in range(5):
            started = time.perf_counter()
            subprocess.run([sys.executable, *command], capture_output=True, check=True)
            best = min(best, time.perf_counter() - started)
        return best

    numpy = seconds("-c", "import numpy")
    assert seconds("-c", "import fringeworks") <= 2 * numpy
    assert seconds("-m", "fringeworks", "--help") <= 3 * numpy
    assert seconds("-m", "fringeworks", "--version") <= numpy


def test_long_work_off_a_terminal_says_so_now_and_then(monkeypatch, capsys):
    from fringeworks.cli import output
    from fringeworks.report import progress_bar

    now = iter([0.0, 1.0, 21.0, 22.0, 45.0])
    monkeypatch.setattr(progress_bar.time, "monotonic", lambda: next(now))
    with output.progress(4) as progress:
        for step in ("one", "two", "three", "four"):
            progress(step)
    said = capsys.readouterr().err.splitlines()
    assert said == ["2/4 two (21 s, 21 s left)", "4/4 four (45 s, 0 s left)"]


def test_paths_are_read_where_captures_are_wanted(capture, tmp_path):
    found = fw.reconstruct(str(capture), "fourier")
    assert found.surface.values.shape == (300, 300)
    for call, words in (
        (lambda: fw.reconstruct(tmp_path), "expected a file capture.toml or plan.toml, got none"),
        (lambda: fw.reconstruct(3), "pair: expected a Pair or a path, got int"),
        (lambda: fw.measure(3, "rig.toml"), "stack: expected a Stack or a path, got int"),
        (lambda: fw.measure(capture, "rig.toml"), "rig.toml: expected a rig file"),
        (lambda: fw.analyse("folder"), "pair: expected a Pair, got str"),
        (
            lambda: fw.decode("folder", fw.propose(640, 480, 9)[0].plan),
            "folder: expected a folder or a stack of frames",
        ),
        (
            lambda: fw.report.summarise("folder"),
            "result: expected a result of fringeworks, got str",
        ),
    ):
        with pytest.raises(fw.InputError, match=words):
            call()


def test_errors_say_their_kind(capture, tmp_path):
    plan = fw.propose(640, 480, 9)[0].plan
    frames = list(fw.encode(plan))
    for error, call in (
        (fw.FileProblem, lambda: fw.files.read_capture(tmp_path / "none")),
        (fw.FramesContradictPlan, lambda: fw.decode(frames[:-1], plan)),
        (fw.UnknownMethod, lambda: fw.reconstruct(capture, "magic")),
        (fw.UnknownMethod, lambda: fw.reconstruct(capture, "fourier", magic=1)),
        (fw.InputError, lambda: fw.reconstruct(capture, "fourier", width="wide")),
    ):
        with pytest.raises(error) as caught:
            call()
        assert type(caught.value) is error
