"""The notebook on the pages: it runs, and holds what running it shows."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


def maker():
    place = importlib.util.spec_from_file_location("make_notebook", ROOT / "docs/make_notebook.py")
    module = importlib.util.module_from_spec(place)
    place.loader.exec_module(module)
    return module


def said(notebook):
    return [
        "".join(output["text"])
        for cell in notebook["cells"]
        for output in cell.get("outputs", [])
        if output["output_type"] == "stream"
    ]


@pytest.mark.usefixtures("_samples")
def test_the_notebook_runs_and_shows_what_it_stores(tmp_path, monkeypatch):
    """The set of the sample data that it reads is made anew."""
    monkeypatch.chdir(tmp_path)
    stored = json.loads((ROOT / "docs/first_look.ipynb").read_text(encoding="utf-8"))
    made = maker().make()
    assert [c["source"] for c in made["cells"]] == [c["source"] for c in stored["cells"]]
    codes = [c for c in stored["cells"] if c["cell_type"] == "code"]
    assert len(codes) == 6
    assert "pip install" in codes[0]["source"][0]
    # Times differ, and so may the last digit of a figure on another machine.
    assert len(said(made)) == len(said(stored)) == 5
    assert said(made)[-1] == said(stored)[-1]
    pictures = [o for c in stored["cells"] for o in c.get("outputs", []) if "data" in o]
    assert len(pictures) == 1
    assert (tmp_path / "bust.vtp").stat().st_size > 10_000


def test_the_notebook_runs_without_jupyter(tmp_path, monkeypatch):
    """As the report on platforms does."""
    place = importlib.util.spec_from_file_location("notebook", ROOT / "release/notebook.py")
    module = importlib.util.module_from_spec(place)
    place.loader.exec_module(module)
    cells = [
        {"cell_type": "markdown", "source": ["# One"]},
        {"cell_type": "code", "source": ["%pip install x"]},
        {"cell_type": "code", "source": ["a = 2\n", "open('b.txt', 'w').close()"]},
        {"cell_type": "code", "source": ["print(a)"]},
    ]
    path = tmp_path / "n.ipynb"
    path.write_text(json.dumps({"cells": cells}), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert module.run(path) == "2\n"
    assert not (tmp_path / "b.txt").exists()
    assert len(module.cells(ROOT / "docs/first_look.ipynb")) == 5
