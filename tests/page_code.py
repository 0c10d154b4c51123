"""The Python on the pages, and which of it the tests run."""

from __future__ import annotations

import re
from pathlib import Path

PYTHON = re.compile(r"^```python\n(.*?)^```", re.M | re.S)
NOT_RUN = {
    (
        "cameras.md",
        "import fringeworks as fw",
    ): "captures of two cameras: tests/test_cameras_files.py",
    (
        "deviation.md",
        'part = fw.surface.clean_cloud(fw.files.read_cloud("part.npz"))',
    ): "a part with its drawing: tests/test_deviation.py",
    ("service.md", "import json"): "a running service: tests/test_service.py",
    ("batch.md", "import xarray as xr"): "the number of a scan is made up: tests/test_batch.py",
    ("sequences.md", "import fringeworks as fw"): "a long sequence: tests/test_sequence.py",
    (
        "sequences.md",
        "decoder = fw.stack.SequenceDecoder(plan)",
    ): "a sketch: tests/test_sequence.py",
    ("sequences.md", "import xarray as xr"): "a long sequence: tests/test_sequence.py",
}
"""Blocks that are not run, by page and first line, and the test that holds them."""
ELSEWHERE = {"datasets.md", "gallery.md"}
"""Pages whose code other tests run: tests/test_datasets.py, and the examples of tests/test_examples.py."""


def blocks(page: Path) -> list[str]:
    found = PYTHON.findall(page.read_text(encoding="utf-8"))
    return [one for one in found if (page.name, one.split("\n", 1)[0]) not in NOT_RUN]
