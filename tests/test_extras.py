"""What the default install does without OpenCV and Matplotlib, and what it says where they are needed."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.scene import standard_scene
from fringeworks.simulate.standard import bust, fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look

pytestmark = pytest.mark.system

ROOT = Path(__file__).parent.parent
BLOCK = "import sys\nfor name in ('cv2', 'matplotlib'): sys.modules[name] = None\n"
"""Both packages are missing in a process that begins so, whether they are installed or not."""
OPENCV = (
    "expected the package opencv-python-headless, got none; pip install 'fringeworks[calibration]'"
)
PLOTS = "expected the package matplotlib, got none; pip install 'fringeworks[plots]'"


def python(script, *words):
    """A process without either package."""
    return subprocess.run(
        [sys.executable, "-c", BLOCK + script, *map(str, words)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def command(*words):
    """The command line without either package."""
    return python("from fringeworks.cli import main; main()", *words)


@pytest.fixture(scope="module")
def captures(tmp_path_factory):
    """A folder of 12 pictures with its rig, and two photographs."""
    folder = tmp_path_factory.mktemp("captures")
    rig = standard_rig(scale=0.3)
    plan = fringe_plan(rig, both=False)
    assert plan.frames == 12
    frames = list(photograph(look(rig, bust()), plan, Optics()))
    fw.files.write_stack(folder / "part", frames, plan)
    fw.files.write_rig(folder / "rig.toml", rig)
    scene = standard_scene("parabola", size=120, fringes=8, noise=1, bits=8, seed=1, painted=True)
    fw.files.write_pair(folder / "pair", scene)
    return folder


def test_twelve_pictures_to_points(captures, tmp_path):
    """The points are those of a process that has both packages, bit by bit."""
    out = tmp_path / "part.ply"
    done = command("measure", captures / "part", "--rig", captures / "rig.toml", "--out", out)
    assert done.returncode == 0, done.stderr
    found = fw.files.read_points(out)
    expected = tmp_path / "expected.ply"
    measured = fw.measure(fw.files.read_stack(captures / "part"), captures / "rig.toml")
    fw.files.write_points(expected, measured.points)
    other = fw.files.read_points(expected)
    assert len(found.xyz_mm) > 10_000
    np.testing.assert_array_equal(found.xyz_mm, other.xyz_mm)


@pytest.mark.parametrize("method", ["windowed", "fourier"])
def test_two_photographs_to_a_map(captures, tmp_path, method):
    out = tmp_path / "map.tif"
    done = command("reconstruct", captures / "pair", "--method", method, "--out", out)
    assert done.returncode == 0, done.stderr
    here = fw.reconstruct(fw.files.read_capture(captures / "pair"), method).surface
    np.testing.assert_array_equal(fw.files.read_surface(out).values, here.values.astype(np.float32))


def test_coordinates_live_points_and_all_methods(captures, tmp_path):
    done = command("decode", captures / "part", "--out", tmp_path / "x.npz")
    assert done.returncode == 0, done.stderr
    done = python(
        "import fringeworks as fw\n"
        "part, pair, rig = sys.argv[1:]\n"
        "stack, pair = fw.files.read_stack(part), fw.files.read_capture(pair)\n"
        "frames = list(stack.frames)\n"
        "live = fw.stack.Decoder(stack.plan, frames[0].shape, rig=fw.files.read_rig(rig))\n"
        "assert (live.points(frames).reason == 0).any()\n"
        "for name in fw.methods(): fw.analyse(pair, name)\n"
        "assert fw.pair.bound_px(pair, fw.analyse(pair, 'fourier').displacement_px).any()\n"
        "from tests.public import public, public_names\n"
        "for name in public_names(): public(name)\n"
        "result = fw.reconstruct(pair, 'fourier')\n"
        "assert result._repr_png_() is None\n"
        "assert result._repr_html_()\n"
        "print(*fw.report.summarise(result))\n",
        captures / "part",
        captures / "pair",
        captures / "rig.toml",
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout


CALLS = {
    "fw.reconstruct(scene, 'fourier').surface.plot()": f"a picture: {PLOTS}",
    "fw.reconstruct(scene, 'fourier').surface.show()": f"a report: {PLOTS}",
    "fw.write_report(out / 'x.html', fw.reconstruct(scene, 'fourier'))": f"a report: {PLOTS}",
    "fw.save_figure(None, out / 'x.png')": f"a picture: {PLOTS}",
    "fw.report.best_map('', [])": f"a picture: {PLOTS}",
    "fw.report.setup_sheet(None)": f"a picture: {PLOTS}",
    "fw.report.write_board(out / 'x.pdf', 'chessboard:9x7:20')": f"a board to print: {PLOTS}",
    "fw.report.board_sheet(fw.rig.parse_board('chessboard:9x7:20'))": f"a board to print: {PLOTS}",
    "__import__('fringeworks.showcase.demo', fromlist=['x']).write_demo(out / 'demo')": f"the demonstration: {PLOTS}",
    "__import__('fringeworks.showcase.dissertation', fromlist=['x']).write_paper(out / 'paper')": f"the figures of the dissertation: {PLOTS}",
    "fw.batch.write_batch_report(out / 'x.html', None)": f"a report: {PLOTS}",
    "fw.batch.write_sequence_report(out / 'x.html', None)": f"a report: {PLOTS}",
    "fw.rig.parse_board('charuco:8x6:30:22')": f"a ChArUco board: {OPENCV}",
    "fw.rig.find_board(None, None)": f"finding a board: {OPENCV}",
    "fw.rig.observe(scene, 'chessboard:9x7:20', decoded=scene, projector_size=(9, 9))": f"a calibration: {OPENCV}",
    "fw.calibrate([], fw.rig.parse_board('chessboard:9x7:20'))": f"a calibration: {OPENCV}",
    "fw.calibrate(out / 'none', fw.rig.parse_board('chessboard:9x7:20'))": f"a calibration: {OPENCV}",
    "fw.rig.check_rig(None, None, None)": f"the check of a rig: {OPENCV}",
    "fw.scan.judge_poses(None, None)": f"judging poses: {OPENCV}",
    "fw.files.write_rig(out / 'x.xml', standard_rig())": f"a rig file of OpenCV: {OPENCV}",
    "fw.files.read_rig(made('x.yml'))": f"a rig file of OpenCV: {OPENCV}",
    "fw.devices.open_camera('webcam:0')": f"a webcam: {OPENCV}",
    "fw.devices.WebcamCamera(made('x.avi'))": f"a webcam: {OPENCV}",
    "next(iter(fw.stack.decode_sequence([], fw.files.read_plan(plan))))": f"a sequence: {OPENCV}",
    "fw.merge(['a', 'b'], board='chessboard:9x7:20')": f"a board among the views: {OPENCV}",
    "fw.run_service(out, 'rig.toml', projector='virtual', camera='virtual')": "service: expected the package "
    "opencv-python-headless, got none: pip install 'fringeworks[service]'",
    "fw.run_studio(out)": "studio: expected the package opencv-python-headless, got none: "
    "pip install 'fringeworks[studio]'",
}
"""Calls that need a package, and their sentence."""


def test_calls_that_need_a_package_say_so(captures, tmp_path):
    script = (
        "from pathlib import Path\n"
        "import fringeworks as fw\n"
        "from fringeworks.simulate import standard_rig, standard_scene\n"
        "out, plan, *calls = sys.argv[1:]\n"
        "out, scene = Path(out), standard_scene('parabola', size=60, fringes=6)\n"
        "def made(name):\n"
        "    (out / name).write_text('%YAML:1.0')\n"
        "    return str(out / name)\n"
        "for call in calls:\n"
        "    try:\n"
        "        eval(call)\n"
        "    except fw.MissingPackage as missing:\n"
        "        print(missing)\n"
        "    except Exception as other:\n"
        "        print(call, repr(other))\n"
        "    else:\n"
        "        print(call, 'went through')\n"
    )
    done = python(script, tmp_path, captures / "part" / "plan.toml", *CALLS)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == list(CALLS.values())
    assert {path.name for path in tmp_path.iterdir()} == {"x.yml", "x.avi"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["reconstruct", "pair", "--out", "x.tif", "--figure", "x.png"], f"x.png: {PLOTS}"),
        (["reconstruct", "pair", "--figure", "-"], f"-: {PLOTS}"),
        (["measure", "part", "--rig", "rig.toml", "--report", "x.html"], f"x.html: {PLOTS}"),
        (["board", "chessboard:9x7:20", "--out", "x.pdf"], f"x.pdf: {PLOTS}"),
        (["demo", "--out", "x"], f"the demonstration: {PLOTS}"),
        (["rig", "convert", "rig.toml", "--out", "x.xml"], f"a rig file of OpenCV: {OPENCV}"),
        (
            ["calibrate", "part", "--board", "chessboard:9x7:20", "--out", "x.toml"],
            f"a calibration: {OPENCV}",
        ),
    ],
)
def test_commands_that_need_a_package_say_so_in_one_line(captures, words, said):
    done = python(
        "import os; os.chdir(sys.argv.pop(1)); from fringeworks.cli import main; main()",
        captures,
        *words,
    )
    assert done.returncode == 2
    assert done.stderr.splitlines() == [f"fringeworks: {said}"]
    assert done.stdout == ""
    assert not [path.name for path in captures.iterdir() if path.name.startswith("x")]


@pytest.mark.long
def test_a_set_up_without_its_picture(tmp_path):
    """The picture beside a set-up file is a by-product: it is left out, which is said in one line."""
    out = tmp_path / "setup.toml"
    done = command("setup", "--projector", "virtual", "--camera", "virtual", "--out", out)
    assert done.returncode == 0, done.stderr
    assert f"left out {tmp_path / 'setup.png'}: {PLOTS}" in " ".join(done.stdout.split())
    assert fw.files.read_setup(out) is not None
    assert not (tmp_path / "setup.png").exists()


def test_every_extra_is_in_the_one_of_a_laboratory():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    (everything,) = extras["all"]
    # napari is a program of its own, and wants a Qt that its users choose. The licence of genicam
    # (extra "gentl") does not permit changes. The wheels of cascadio hold OpenCASCADE, which is
    # LGPL: only who asks for it installs it.
    single = sorted(extras.keys() - {"all", "all-but-opencv", "cad", "gentl", "napari"})
    assert everything == f"fringeworks[{','.join(single)}]"


def brought(extras, name):
    """Packages that an extra names, those of the extras in it too."""
    found = set()
    for each in extras[name]:
        inner = re.fullmatch(r"fringeworks\[(.*)\]", each)
        found |= {each} if inner is None else set()
        for other in inner[1].split(",") if inner else ():
            found |= brought(extras, other)
    return found


def test_the_extra_beside_another_opencv_lacks_opencv_only():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    lacking = brought(extras, "all") - brought(extras, "all-but-opencv")
    assert lacking == brought(extras, "calibration")
    assert brought(extras, "all-but-opencv") <= brought(extras, "all")
