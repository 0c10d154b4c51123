"""Folders are written whole: foreign things are safe, and a killed program leaves no mixture."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

import fringeworks as fw
from tests.conftest import scene
from tests.folder_writes import PLANS
from tests.grids import quick
from tests.stacks import take


def test_things_of_others_are_safe(tmp_path):
    (tmp_path / "capture.toml").write_text("mine")
    (tmp_path / "photo.jpg").write_bytes(b"mine too")
    for write in (
        lambda **k: fw.files.write_pair(tmp_path, scene("cube", size=64, fringes=4), **k),
        lambda **k: fw.files.write_patterns(tmp_path, PLANS[0], **k),
        lambda **k: fw.files.write_stack(tmp_path, take(PLANS[0]), PLANS[0], **k),
    ):
        with pytest.raises(fw.files.FolderInUse, match="it holds capture.toml, photo.jpg"):
            write()
        assert sorted(p.name for p in tmp_path.iterdir()) == ["capture.toml", "photo.jpg"]
    assert (tmp_path / "capture.toml").read_text() == "mine"
    fw.files.write_stack(tmp_path, take(PLANS[0]), PLANS[0], force=True)
    assert (tmp_path / "photo.jpg").read_bytes() == b"mine too"
    # The photograph is not among the frames that capture.toml names.
    assert len(fw.files.read_stack(tmp_path).frames) == 8


def test_an_earlier_result_is_replaced_whole(tmp_path):
    fw.files.write_patterns(tmp_path / "p", PLANS[1])
    fw.files.write_patterns(tmp_path / "p", PLANS[0])
    after = {p.name for p in (tmp_path / "p").iterdir()}
    assert len([n for n in after if n.endswith(".png")]) == PLANS[0].frames
    assert fw.files.read_stack(tmp_path / "p").plan == PLANS[0]


def test_photographs_in_the_place_of_pictures_are_safe(tmp_path):
    written = fw.files.write_patterns(tmp_path, PLANS[0])
    written[3].write_bytes(written[4].read_bytes())  # a photograph with the picture's name
    for write in (fw.files.write_patterns, lambda f, p: fw.files.write_stack(f, take(p), p)):
        with pytest.raises(fw.files.FolderInUse, match=written[3].name + r" \(changed since\)"):
            write(tmp_path, PLANS[0])
    assert len(fw.files.read_stack(tmp_path).frames) == 8
    fw.files.write_patterns(tmp_path, PLANS[0], force=True)
    np.testing.assert_array_equal(fw.files.read_stack(tmp_path).frames, list(fw.encode(PLANS[0])))


def test_another_kind_of_result_is_not_replaced_unasked(tmp_path):
    fw.files.write_patterns(tmp_path, PLANS[0])
    with pytest.raises(fw.files.FolderInUse, match="of the same kind; it holds a result: patterns"):
        fw.files.write_stack(tmp_path, take(PLANS[1]), PLANS[1])
    fw.files.write_stack(tmp_path, take(PLANS[1]), PLANS[1], force=True)
    assert fw.files.read_capture(tmp_path).plan == PLANS[1]


def test_another_capture_leaves_nothing_behind(tmp_path):
    fw.files.write_stack(tmp_path / "c", take(PLANS[0]), PLANS[0])
    fw.files.write_pair(tmp_path / "c", scene("cube", size=64, fringes=4))
    names = sorted(p.name for p in (tmp_path / "c").iterdir())
    assert names == [".fringeworks", "capture.toml", "object.tif", "reference.tif", "truth.tif"]
    assert isinstance(fw.files.read_capture(tmp_path / "c"), fw.Pair)


def test_a_failed_write_is_no_result(tmp_path):
    with pytest.raises(fw.FramesContradictPlan, match="the plan has 8, got 7"):
        fw.files.write_stack(tmp_path / "c", take(PLANS[0])[:7], PLANS[0])
    with pytest.raises(fw.FileProblem, match="a complete capture, got one that was interrupted"):
        fw.files.read_capture(tmp_path / "c")
    fw.files.write_stack(tmp_path / "c", take(PLANS[0]), PLANS[0])
    assert fw.files.read_capture(tmp_path / "c").plan == PLANS[0]


def test_a_forged_list_does_not_lead_out_of_the_folder(tmp_path):
    (tmp_path / "precious.txt").write_text("mine")
    folder = tmp_path / "c"
    folder.mkdir()
    (folder / ".fringeworks").write_text("- ../precious.txt\n- ..\n- /etc/passwd\n")
    fw.files.write_pair(folder, scene("cube", size=64, fringes=4))
    assert (tmp_path / "precious.txt").read_text() == "mine"


DRIVER = """
import os, random, signal, sys, time
sys.path.insert(0, sys.argv[2])
from pathlib import Path
from tests.folder_writes import check, content

folder, kills = Path(sys.argv[1]), int(sys.argv[3])
complete, rng = 0, random.Random(1)
for n in range(6):  # loads what the children need
    content(n)(folder)
started = time.perf_counter()
for n in range(6):
    content(n)(folder)
longest = (time.perf_counter() - started) / 3
for k in range(kills):
    child = os.fork()
    if child == 0:
        for n in range(k, k + 1000):
            content(n)(folder)
    time.sleep(rng.uniform(0.0, longest))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    complete += check(folder)
print(complete)
"""


@pytest.mark.system
@pytest.mark.parametrize("kills", quick([100, 300], 100))
def test_kills_leave_nothing_half_and_nothing_mixed(tmp_path, kills):
    root = os.path.dirname(os.path.dirname(__file__))
    # A process of its own that starts no threads, so that it may fork.
    done = subprocess.run(
        [sys.executable, "-c", DRIVER, tmp_path / "c", root, str(kills)],
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert (
        kills / 30 < int(done.stdout) < kills * (1 - 1 / 30)
    )  # killed in the middle, and between two writes
