"""Console commands of the documentation, and what stands for hardware when they are run."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FENCED = re.compile(r"^```console\n(.*?)^```", re.M | re.S)
INDENTED = re.compile(r"(?:^    \S.*\n)+", re.M)
TABLE = re.compile(r"^\| `([\w-]+)` \| `([^`]+)` \| `([^`]+)` \|$", re.M)
POSES = range(10)
"""Poses for which a line with N is run."""

NOT_RUN = {
    "fringeworks calibrate board/ --live": "waits for somebody who moves the board: "
    "tests/test_live_calibration.py",
}
"""Beginnings of commands that are not run, and why."""


@dataclass(frozen=True)
class Step:
    """One command of a page, as it is printed and as it is run."""

    printed: str
    run: str


def commands(text: str) -> list[str]:
    """Commands of a page's console blocks, in their order: a reader can type them as they are."""
    return [line for m in FENCED.finditer(text) for line in m[1].splitlines()]


def examples(text: str) -> list[str]:
    """Commands of a page's indented blocks: they take files that the reader has."""
    outside = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S).replace("\\\n", "")
    lines = [line.strip() for m in INDENTED.finditer(outside) for line in m[0].splitlines()]
    return [line.partition("  #")[0].strip() for line in lines if line.startswith("fringeworks ")]


def substitutions(text: str) -> list[tuple[str, str, str]]:
    """Rows of the page's table: command, what the page prints, what is run in its place."""
    return [(m[1], m[2], m[3]) for m in TABLE.finditer(text)]


def steps(page: str) -> list[Step]:
    """Commands of a page that are run, hardware replaced as docs/start.md says."""
    table = substitutions((ROOT / "docs/start.md").read_text(encoding="utf-8"))
    found = []
    for printed in commands((ROOT / page).read_text(encoding="utf-8")):
        if printed.startswith(tuple(NOT_RUN)):
            continue
        line = printed
        for command, before, after in table:
            if line.startswith(f"fringeworks {command} "):
                line = line.replace(before, after)
        numbered = re.search(r"(?<=[/-])N\b", line)
        lines = [re.sub(r"(?<=[/-])N\b", str(n), line) for n in POSES] if numbered else [line]
        found += [Step(printed, one) for one in lines]
    return found


def walk(steps: list[Step], folder: Path) -> None:
    """Run commands one after the other as a stranger would: in a folder, with an empty home."""
    home = folder.parent / f"{folder.name} home"
    home.mkdir()
    environment = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("XDG_", "FRINGEWORKS_", "MPL"))
    }
    environment["HOME"] = environment["USERPROFILE"] = str(home)
    for step in steps:
        words = shlex.split(step.run)
        assert words[0] == "fringeworks", f"what is {step.printed}?"
        done = subprocess.run(
            [sys.executable, "-m", *words],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )
        assert done.returncode == 0, f"{step.run}\n{done.stdout}\n{done.stderr}"


PAGES = sorted([*(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.md")])


def marked(pages: Iterable[Path], long: Collection[str]) -> list:
    """Pages as parameters of a test, by their names; those in ``long`` run with the long tests."""
    return [
        pytest.param(page, marks=pytest.mark.long if page.name in long else (), id=page.name)
        for page in pages
    ]
