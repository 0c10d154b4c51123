"""Disks that are full or read-only, clocks that jump: the result before stays, and one sentence says why."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.types import fingerprint
from tests.stacks import multi, take

pytestmark = pytest.mark.system

ROOT = Path(__file__).parents[1]
SCRIPT = """
import resource, sys
from pathlib import Path
import fringeworks as fw
from tests.kills import _content, writers

def refuses(writer, folder, before, what):
    try:
        writer.write(folder, 1)
    except fw.InputError as error:
        assert "\\n" not in str(error) and str(folder) in str(error), (writer.name, str(error))
    else:
        raise AssertionError(f"{writer.name}: {what} is not told")
    assert _content(folder) == before, f"{writer.name}: {what}: the result before is gone"
    left = [p.name for p in folder.rglob("*") if p.name.startswith(".fringeworks-")]
    assert not left, f"{writer.name}: {what}: {left}"
    return 1

place, count = Path(sys.argv[1]), 0
SLOW = ("board.svg", "report.html", "batch", "sequence", "capture")
chosen = [w for w in writers() if w.name not in SLOW]
for writer in chosen:
    folder = place / writer.name
    folder.mkdir()
    writer.write(folder, 0)
"""
LIMITED = """
hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
for writer in chosen:
    folder = place / writer.name
    before = _content(folder)
    largest = max(map(len, before.values()))
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest // 2, hard))
    try:
        count += refuses(writer, folder, before, "a full disk")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
print(count)
"""
FULL = """
import os, subprocess
with (place / "junk").open("wb", 0) as junk:
    try:
        while True:
            junk.write(bytes(512))
    except OSError:
        pass
for writer in chosen:
    folder = place / writer.name
    count += refuses(writer, folder, _content(folder), "a full disk")
subprocess.run(["mount", "-o", "remount,ro", str(place)], check=True)
for writer in chosen:
    folder = place / writer.name
    count += refuses(writer, folder, _content(folder), "a read-only disk")
print(count)
"""


def run(script, *words, **environment):
    done = subprocess.run(
        [sys.executable, "-c", script, *map(str, words)],
        cwd=ROOT,
        env={**os.environ, "SOURCE_DATE_EPOCH": "0", **environment},
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout.strip()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no limit of file sizes")
def test_files_that_cannot_grow_leave_the_result_before(tmp_path):
    assert int(run(SCRIPT + LIMITED, tmp_path)) >= 25


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 4 MB."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(place)]
    try:
        refused = subprocess.run(mount, capture_output=True, check=False).returncode
    except OSError:
        refused = True
    if refused:
        pytest.skip("file systems cannot be mounted here")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def test_full_and_read_only_disks_leave_the_result_before(small_disk):
    assert int(run(SCRIPT + FULL, small_disk)) >= 50


def test_folders_on_a_full_disk_hold_no_half_result(small_disk):
    plan = multi((1, 8), 4, (300, 40))
    fw.files.write_stack(small_disk / "c", take(plan), plan)
    (small_disk / "junk").write_bytes(bytes(4_000_000 - (240 << 10)))
    noise = np.random.default_rng(0).integers(0, 255, (8, 400, 300), dtype=np.uint8)
    with pytest.raises(fw.FileProblem, match="could not be written"):
        fw.files.write_stack(small_disk / "c", noise, plan, force=True)
    with pytest.raises(fw.FileProblem, match="a complete capture, got one that was interrupted"):
        fw.files.read_capture(small_disk / "c")
    (small_disk / "junk").unlink()
    fw.files.write_stack(small_disk / "c", take(plan), plan)
    assert len(fw.files.read_stack(small_disk / "c").frames) == 8


def test_clocks_that_jump_change_nothing_but_dates(tmp_path, monkeypatch):
    """Nothing waits for the time of day: it may be set back, or a year ahead, at any moment."""
    waits = [
        path.name
        for path in (ROOT / "src/fringeworks").rglob("*.py")
        if "time.time()" in path.read_text("utf-8")
    ]
    # Aravis stamps frames with the time of day; the difference to now is taken at once.
    assert waits == ["genicam.py"]
    plan = multi((1, 8), 4, (300, 40))
    frames = take(plan)
    expected = fingerprint(fw.decode(frames, plan))
    jumps = iter(1e9 * np.sin(np.arange(10**6)) + 1e9)
    monkeypatch.setattr(time, "time", lambda: float(next(jumps)))
    assert fingerprint(fw.decode(frames, plan)) == expected
    fw.files.write_stack(tmp_path / "c", frames, plan)
    assert len(fw.files.read_capture(tmp_path / "c").frames) == 8
