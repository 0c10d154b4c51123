"""A stranger's walk: the commands of README and *start here*, word for word, with an empty home."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys

import pytest

from tests.commands import run
from tests.walk import NOT_RUN, ROOT, commands, steps, substitutions, walk

pytestmark = pytest.mark.system

LONG_PAGES = ["docs/start.md"]
"""Pages that set up, calibrate and scan, which takes minutes."""


def test_the_commands_of_the_readme_work(tmp_path):
    """In this process, and without the self-test, which has tests of its own."""
    for step in steps("README.md"):
        _, command, *words = shlex.split(step.run)
        if command != "selftest":
            run(command, *words, cwd=tmp_path)
    assert (tmp_path / "scene.ply").stat().st_size > 10_000
    assert (tmp_path / "scene.png").stat().st_size > 10_000


@pytest.mark.long
def test_the_readme_works_as_it_is_printed(tmp_path):
    walked = steps("README.md")
    assert len(walked) >= 5
    assert all(step.run == step.printed for step in walked)
    folder = tmp_path / "a folder"
    folder.mkdir()
    walk(walked, folder)
    assert (folder / "scene.ply").stat().st_size > 10_000
    assert (folder / "scene.png").stat().st_size > 10_000


@pytest.mark.long
def test_two_photographs_in_five_minutes(tmp_path):
    walked = steps("docs/start.md")[:3]
    assert [step.run.split()[1] for step in walked] == ["simulate", "reconstruct", "reconstruct"]
    folder = tmp_path / "photographs"
    folder.mkdir()
    walk(walked, folder)
    assert (folder / "part.png").stat().st_size > 10_000


def test_the_table_replaces_every_device():
    for page in ("README.md", "docs/start.md"):
        for step in steps(page):
            assert "screen:" not in step.run, step.printed
            assert "webcam:" not in step.run, step.printed
            assert "POSE" not in step.run, step.printed


def test_every_row_of_the_table_is_used():
    page = (ROOT / "docs/start.md").read_text(encoding="utf-8")
    for command, before, after in substitutions(page):
        lines = [one for one in commands(page) if one.startswith(f"fringeworks {command} ")]
        assert any(before in one for one in lines), (command, before, after)
    for beginning in NOT_RUN:
        assert any(one.startswith(beginning) for one in commands(page))


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("page", LONG_PAGES)
def test_the_page_works_from_the_first_line_to_the_last(page, tmp_path):
    folder = tmp_path / "measurements"
    folder.mkdir()
    walk(steps(page), folder)
    assert (folder / "part.html").stat().st_size > 10_000
    assert (folder / "again.ply").stat().st_size > 10_000


HOURS = sorted((ROOT / "docs").glob("hour-*.md"))
"""A first hour for each kind of user: their console lines need no hardware."""


@pytest.mark.parametrize("page", HOURS, ids=lambda page: page.stem)
def test_the_first_hour_of_each_user(page, tmp_path):
    """Word for word and in order, with the recipe of the page; the Python of pages runs elsewhere."""
    text = page.read_text(encoding="utf-8")
    for recipe in re.findall(r"^```toml\n(.*?)^```", text, re.M | re.S):
        (tmp_path / "recipe.toml").write_text(recipe, encoding="utf-8")
    printed = commands(text)
    for line in printed:
        program, *words = shlex.split(line)
        if program == "python":
            subprocess.run([sys.executable, *words], cwd=tmp_path, check=True)
        else:
            assert program == "fringeworks"
            run(*words, cwd=tmp_path)
    written = {w for line in printed for w in re.findall(r"(?<=--out )\S+|(?<=--report )\S+", line)}
    assert all((tmp_path / name).exists() for name in written)
    assert printed or "```python" in text


def test_there_is_a_first_hour_for_every_user():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    users = {"student", "maker", "inspector", "researcher", "robot"}
    assert {page.stem.removeprefix("hour-") for page in HOURS} == users
    assert all(f"docs/{page.name}" in readme for page in HOURS)
