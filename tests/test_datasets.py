"""The page on data sets: its plans can be read, and its lines read the data where it is there."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

import fringeworks as fw

PAGE = (Path(__file__).parent.parent / "docs" / "datasets.md").read_text(encoding="utf-8")
PLANS = re.findall(r"^```toml\n(kind = \"plan\".*?)^```", PAGE, re.M | re.S)
BLOCKS = re.findall(r"^```python\n(.*?)^```", PAGE, re.M | re.S)
TRIED = {
    found[1]: (section, block)
    for section in re.split(r"^(?=## |.*\bThe objects are\b)", PAGE, flags=re.M)
    for block in re.findall(r"^```python\n(.*?)^```", section, re.M | re.S)
    if (found := re.match(r"# in ([\w/]+)/\n", block))
}
"""Blocks that read data, by the folder, with the part of the page that they are in."""
SAYS = {"flat_board_gamma": 0.60, "object_gray_phase": 0.35, "board_slstudio": 0.30}
"""Shares of the frame that are measured, at least: the lit part of each."""


def test_plans_of_the_page_are_plans(tmp_path):
    assert len(PLANS) == 6
    for k, text in enumerate(PLANS):
        path = tmp_path / f"{k}.toml"
        path.write_text(text)
        assert isinstance(fw.read(path), fw.PatternPlan)


def test_every_block_is_tried_or_a_function():
    others = [b for b in BLOCKS if not b.startswith("# in ")]
    assert len(TRIED) == 8
    assert all("def " in block for block in others)


@pytest.mark.parametrize("folder", sorted(TRIED))
def test_lines_of_the_page_read_the_data(real_data, tmp_path, monkeypatch, capsys, folder):
    if not (real_data / folder).is_dir():
        pytest.skip(f"no {folder}")
    section, block = TRIED[folder]
    shutil.copytree(real_data / folder, tmp_path / "data")
    plan = re.search(r"^```toml\n(.*?)^```", section, re.M | re.S)
    if plan:
        (tmp_path / "data" / "plan.toml").write_text(plan[1])
    monkeypatch.chdir(tmp_path / "data")
    exec(compile(block, folder, "exec"), {})
    said = capsys.readouterr().out
    if folder in SAYS:
        assert int(re.search(r"(\d+)% measured", said)[1]) >= 100 * SAYS[folder]
    if folder == "board_procam":
        assert len(list(Path("board").iterdir())) == 5
