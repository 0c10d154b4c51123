"""Commands that pages show for files of the reader's own run as they are printed."""

from __future__ import annotations

import glob
import shlex
from pathlib import Path

import pytest

from fringeworks.cli.inspecting import EXIT_CODES
from tests.commands import run
from tests.page_files import build
from tests.walk import PAGES, examples, marked

pytestmark = pytest.mark.system

ELSEWHERE = {
    "fringeworks studio ": "serves a page until it is ended: tests/test_studio.py",
    "fringeworks serve ": "serves until it is ended: tests/test_service.py",
    "fringeworks setup ": "wants devices: tests/test_walk.py",
    "fringeworks scan ": "wants devices: tests/test_walk.py, tests/test_turntable_scan.py",
    "fringeworks study trials.csv --quantity step --scan-parts ": "wants devices: "
    "tests/test_gauge_scans.py",
    "fringeworks paper ": "takes a minute: tests/test_examples.py",
    "fringeworks --plugin own_method.py ": "would register a method for all tests of this process: "
    "tests/test_examples.py, tests/test_cli.py",
    "fringeworks rig check monday/ ": "a history: tests/test_nelson.py, tests/test_rig_check.py",
    "fringeworks rig watch ": "a log: tests/test_rig_watch.py",
    "fringeworks rig history ": "a history: tests/test_nelson.py",
    "fringeworks certificate ": "thirteen scans: tests/test_certificate.py",
    "fringeworks merge ": "many views: tests/test_merging.py",
    "fringeworks deviation part.npz --model part.step ": "a drawing: tests/test_drawings.py",
    "fringeworks recipe part.qif --model part.step ": "a QIF document: tests/test_qif_tolerances.py",
    "fringeworks calibrate left/ ": "two cameras: tests/test_cameras_files.py",
    "fringeworks measure part/left ": "two cameras: tests/test_cameras_files.py",
    "fringeworks rig projector ": "scenes of two cameras: tests/test_projector_from_points.py",
    "fringeworks rig convert intrinsics.yml ": "two files: tests/test_stereo_files.py",
    "fringeworks measure part/ --rig rig.toml --out - ": "writes bytes: tests/test_cli.py",
}
"""Beginnings of commands that are not run here, and the tests that run such ones."""

REPLACED = {
    "fringeworks decode shots/ --steps ": ("shots/", "four/"),
    "fringeworks rig convert rig.toml --crop ": ("320,256,640,512", "96,77,192,153"),
}
"""Words that differ here: a folder that holds one thing for one command of a page and another for the
next, and the middle of a camera that has 0.3 times the columns and rows of the page's."""
VERDICTS = {
    "fringeworks deviation part.npz --model part.stl --rig rig.toml --tolerance-mm 0.1 ": "undecided",
}
"""Commands whose part does not pass, and its verdict: their exit code says so. The edges of the part
lie 0.1 mm off within their σ."""
NOT_WRITTEN = {"rig2.toml": "the rig holds: there is nothing to adjust"}
LONG = (
    "README.md",
    "batch.md",
    "deviation.md",
    "few-frames.md",
    "files.md",
    "methods.md",
    "report.md",
    "rig.md",
    "sequences.md",
    "stacks.md",
    "study.md",
)
"""Pages that calibrate, compare many methods, or start workers."""


def lines(page):
    found = [line for line in examples(page.read_text(encoding="utf-8")) if "…" not in line]
    return [one for one in found if "COMMAND" not in one and not one.startswith(tuple(ELSEWHERE))]


def words(line, folder):
    """Words of a command, with names that the shell completes; and the file that takes its output."""
    for beginning, (before, after) in REPLACED.items():
        line = line.replace(before, after) if line.startswith(beginning) else line
    line, _, target = line.partition(" > ")
    found = []
    for word in shlex.split(line)[1:]:
        matches = sorted(glob.glob(word, root_dir=folder)) if "*" in word else []
        found += matches or [word]
    return found, target.strip()


def verdict(line):
    return next((said for start, said in VERDICTS.items() if line.startswith(start)), "pass")


@pytest.mark.parametrize("page", marked((p for p in PAGES if lines(p)), LONG))
def test_commands_of_a_page_run(page, tmp_path):
    build(page, tmp_path)
    for line in lines(page):
        given, target = words(line, tmp_path)
        done = run(*given, cwd=tmp_path, code=EXIT_CODES[verdict(line)])
        if target:
            assert done.stdout, line
            (tmp_path / target).write_bytes(done.stdout.encode(errors="surrogateescape"))
        for option in ("--out", "--figure", "--report", "--json"):
            name = given[given.index(option) + 1] if option in given else "-"
            if name != "-" and name not in NOT_WRITTEN:
                # Several captures have a picture each.
                assert list(tmp_path.glob(f"{Path(name).stem}*{Path(name).suffix}")), line


def test_each_reason_is_needed():
    shown = [line for page in PAGES for line in examples(page.read_text(encoding="utf-8"))]
    for beginning in (*ELSEWHERE, *REPLACED, *VERDICTS):
        assert any(line.startswith(beginning) for line in shown), beginning
