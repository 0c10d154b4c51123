"""Programs killed while they write leave the old result or the new one; ``make fuzz`` kills more."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import fringeworks as fw
from tests.grids import quick
from tests.kills import _whole_recipe, _write_recipe

KILLS = 4
"""Of each quick writer."""
QUICK = (
    "map.npz",
    "cloud.ply",
    "rig.toml",
    "frame.png",
    "text.json",
    "recipe",
    "setup",
    "capture",
    "sequence",
)

pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no fork"),
]


def test_kills_leave_one_version_or_the_other():
    root = Path(__file__).parents[1]
    call = [sys.executable, "-W", "ignore::DeprecationWarning", "-m", "tests.kills"]
    call += ["--kills", str(KILLS * len(QUICK)), "--only", *QUICK]
    done = subprocess.run(
        call,
        cwd=root,
        env={**os.environ, "SOURCE_DATE_EPOCH": "0"},
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{KILLS * len(QUICK)} kills, 0 writers failed" in done.stdout


def test_recipes_keep_their_masks_and_plans(tmp_path):
    """A description and its files are never of different versions, and earlier ones are deleted."""
    for k in (0, 1, 0):
        _write_recipe(tmp_path / "recipe.toml", k)
        assert _whole_recipe(tmp_path)
        assert len(list(tmp_path.iterdir())) == 3
    (tmp_path / "recipe-mask-2.png").write_bytes(b"mine")
    area = fw.evaluate.Area(box=(0, 0, 3, 3))
    fw.files.write_recipe(tmp_path / "recipe.toml", fw.Recipe(areas={"a": area, "b": area}))
    assert (tmp_path / "recipe-mask-2.png").read_bytes() == b"mine"


INTERRUPTED = """
import sys, _thread, threading, time
from pathlib import Path
import fringeworks as fw
from tests.kills import _content, writers

folder = Path(sys.argv[1])
(writer,) = (w for w in writers() if w.name == sys.argv[2])
versions = []
for k in (0, 1):
    writer.write(folder, k)
    versions.append(_content(folder))
stopped = 0
for number in range(60):
    timer = threading.Timer(0.0005 * (number % 12), _thread.interrupt_main)
    try:
        timer.start()
        for k in range(10**6):
            writer.write(folder, k)
    except KeyboardInterrupt:
        stopped += 1
    timer.cancel()
    assert _content(folder) in versions
    # Nothing unfinished is left: the program had time to clean up.
    assert len(list(folder.iterdir())) == 1, list(folder.iterdir())
print(stopped)
"""


@pytest.mark.parametrize("name", quick(["map.npz", "cloud.xyz", "rig.toml"], "map.npz"))
def test_interrupts_leave_nothing_behind(tmp_path, name):
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED, tmp_path, name],
        cwd=Path(__file__).parents[1],
        env={**os.environ, "SOURCE_DATE_EPOCH": "0"},
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) == 60


def test_the_command_line_ends_on_an_interrupt_without_a_traceback(tmp_path):
    call = [sys.executable, "-m", "fringeworks", "compare", "--size", "900"]
    child = subprocess.Popen(call, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        child.wait(2.0)
    except subprocess.TimeoutExpired:
        child.send_signal(signal.SIGINT)
    error = child.communicate(timeout=60)[1].decode()
    assert child.returncode not in (0, 1), error
    assert "Traceback" not in error
