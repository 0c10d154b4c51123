"""A stranger's walk: the commands of README and *start here*, word for word, with an empty home."""

from __future__ import annotations

import shlex

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
