"""The examples run as they are, and the gallery shows all of them."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from PIL import Image

pytestmark = pytest.mark.system

ROOT = Path(__file__).parent.parent
specification = importlib.util.spec_from_file_location(
    "make_gallery", ROOT / "docs" / "make_gallery.py"
)
assert specification is not None
assert specification.loader is not None
gallery = importlib.util.module_from_spec(specification)
specification.loader.exec_module(gallery)

MAX_LINES = 30
ELSEWHERE = {"vendor_camera.py", "live.py"}
"""Examples that tests of their own run."""
LONG = ("calibrate.py", "deviation.py")
"""Examples that calibrate from a board, or render a part with its dent, which takes seconds."""


@pytest.fixture
def _clean(tmp_path, monkeypatch):
    """An empty folder to work in."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("_clean", "_samples")
@pytest.mark.parametrize(
    "example",
    [
        pytest.param(e, marks=pytest.mark.long if e.name in LONG else ())
        for e in gallery.examples()
        if e.name not in ELSEWHERE
    ],
    ids=lambda e: e.name,
)
def test_examples_run(example, tmp_path, capsys):
    found = gallery.run(example)
    assert isinstance(found["figure"], Figure)
    if example.suffix == ".py":
        assert (tmp_path / f"{example.stem}.png").stat().st_size > 5_000
    assert capsys.readouterr().out.strip(), "an example says something"


def test_examples_are_short_and_say_what_to_change():
    for example in gallery.examples():
        text = example.read_text(encoding="utf-8")
        if example.name in gallery.LONG:
            continue
        if example.suffix == ".py":
            assert len(text.splitlines()) <= MAX_LINES, example.name
        assert re.search(r"# (Your own:|or )", text), example.name


def test_the_gallery_shows_every_example():
    assert set(gallery.SECTIONS) == {example.name for example in gallery.examples()}
    assert gallery.PAGE.read_text(encoding="utf-8") == gallery.page(), "run `make gallery`"


def test_every_picture_is_there_and_small():
    wanted = {Path(n).stem for n in gallery.SECTIONS if n not in gallery.WITHOUT_PICTURE}
    assert {path.stem for path in gallery.PICTURES.glob("*")} == wanted
    for path in gallery.PICTURES.glob("*.png"):
        assert path.stat().st_size <= gallery.MAX_BYTES, path.name
        with Image.open(path) as picture:
            assert abs(picture.width - gallery.WIDTH_PX) <= 1, path.name


def test_pictures_are_the_same_every_time():
    import fringeworks as fw

    scene = fw.simulate.standard_scene("parabola", size=64, fringes=6)
    drawn = [gallery.small_png(fw.reconstruct(scene, "fourier").plot()) for _ in range(2)]
    assert drawn[0] == drawn[1]


def test_notebooks_hold_no_results():
    for example in gallery.examples():
        if example.suffix == ".ipynb":
            code = [cell for cell in gallery.cells(example) if cell["cell_type"] == "code"]
            assert code
            assert all(not cell["outputs"] and cell["execution_count"] is None for cell in code)
