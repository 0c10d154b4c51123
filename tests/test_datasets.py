"""The page on data sets: its plans can be read, and its lines read the data where it is there."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import fringeworks as fw

PAGE = (Path(__file__).parent.parent / "docs" / "datasets.md").read_text(encoding="utf-8")
PLANS = re.findall(r"^```toml\n(kind = \"plan\".*?)^```", PAGE, re.M | re.S)
BLOCKS = re.findall(r"^```python\n(.*?)^```", PAGE, re.M | re.S)
TRIED = {
    folder: (section, block)
    for section in re.split(r"^(?=## |.*\bThe objects are\b)", PAGE, flags=re.M)
    for block in re.findall(r"^```python\n(.*?)^```", section, re.M | re.S)
    for folder in re.findall(r"([\w/]+)/(?=,| or |\n)", block.split("\n")[0] + "\n")
    if block.startswith("# in ")
}
"""Blocks that read data, by each folder that they name, with the part of the page that they are in."""
SAYS = {
    "flat_board_gamma": 0.60,
    "object_gray_phase": 0.35,
    "board_slstudio": 0.30,
    "unwrap_longs": 0.75,
}
"""Shares of the frame that are measured, at least: the lit part of each."""


def test_plans_of_the_page_are_plans(tmp_path):
    assert len(PLANS) == 7
    for k, text in enumerate(PLANS):
        path = tmp_path / f"{k}.toml"
        path.write_text(text)
        assert isinstance(fw.read(path), fw.PatternPlan)


def test_every_block_is_tried_or_a_function():
    others = [b for b in BLOCKS if not b.startswith("# in ")]
    assert len(TRIED) == 12
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
        assert int(re.search(r"(\d+)% (measured|unwrapped)", said)[1]) >= 100 * SAYS[folder]
    if folder == "board_procam":
        assert len(list(Path("board").iterdir())) == 5


def test_every_capture_at_hand_is_on_the_page(real_data):
    here = {path.name for path in real_data.iterdir() if path.is_dir()}
    assert here <= {folder.partition("/")[0] for folder in TRIED}


def test_patterns_of_slmaster_are_decoded_by_its_plan(tmp_path):
    """Pictures by the formulas of its source, seen by a camera of 3 px for 4 of the projector."""
    section = next(s for s in PAGE.split("\n## ") if s.startswith("SLMaster"))
    (tmp_path / "plan.toml").write_text(re.search(r"^```toml\n(.*?)^```", section, re.M | re.S)[1])
    names: dict = {"fw": fw}
    exec(re.search(r"^```python\n(.*?)^```", section, re.M | re.S)[1], names)
    x = np.round(np.linspace(100, 1800, 1275)).astype(int)
    lit = [127.5 - 127.5 * np.cos(2 * np.pi * ((x % 60) / 60 + i / 12)) for i in range(12)]
    code = (x // 30) ^ (x // 60)
    lit += [255.0 * (code >> bit & 1) for bit in range(5, -1, -1)]
    (tmp_path / "L").mkdir()
    for k, row in enumerate(lit):
        frame = np.tile(np.round(20 + 0.7 * row).astype(np.uint8), (40, 1))
        Image.fromarray(frame).save(tmp_path / "L" / f"{k}.bmp")
    found = names["slmaster"](str(tmp_path), tmp_path / "plan.toml").x
    error = found.coordinate_px - x
    assert np.mean(np.isfinite(error)) > 0.99
    assert np.nanmax(np.abs(error)) < 0.5
