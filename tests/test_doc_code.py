"""Pages: Python runs, commands have the options that they use, links lead somewhere."""

from __future__ import annotations

import importlib.util
import re
import shlex
import shutil
import unicodedata
import urllib.parse
import webbrowser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import fringeworks as fw
from fringeworks.cli import commands as all_commands  # noqa: F401, registers them
from fringeworks.cli.app import app
from fringeworks.devices.registry import BOTH_KINDS, CAMERA_KINDS, PROJECTOR_KINDS
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import (
    board_body,
    board_poses,
    bust,
    fringe_plan,
    standard_rig,
)
from fringeworks.simulate.virtual_rig import look
from tests.page_code import ELSEWHERE, NOT_RUN, blocks
from tests.public import public_names
from tests.walk import PAGES, ROOT, commands, examples, marked

SOURCES = sorted((ROOT / "src").rglob("*.py"))
ROW_METHODS = ("exact", "gsifa", "sifa", "ifa")


LONG = ("tutorial-rig.md", "rig.md", "fw-rig.md")
"""Pages that calibrate anew what another page calibrates."""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The files that the pages speak of: a pair, a stack, a rig, poses of a board, results."""
    place = tmp_path_factory.mktemp("files")
    scene = fw.simulate.standard_scene("parabola", size=160, fringes=12, noise=1, bits=8)
    fw.files.write_pair(place / "scene", scene)
    for name, frame in (("reference", scene.reference), ("object", scene.object)):
        Image.fromarray(frame).save(place / f"{name}.jpg", quality=95)
    fw.files.write_surface(place / "part.tif", fw.reconstruct(scene, "fourier").surface)
    rig = standard_rig(scale=0.25)
    fw.files.write_rig(place / "rig.toml", rig)
    plan = fringe_plan(rig, both=False)
    fw.files.write_plan(place / "plan.toml", plan)
    frames = list(photograph(look(rig, bust()), plan, Optics(noise=1)))
    fw.files.write_stack(place / "part", frames, plan)
    fw.files.write_points(place / "part.npz", fw.measure(place / "part", rig).points)
    (place / "recipe.toml").write_text('kind = "recipe"\nrig = "rig.toml"\n')
    return place


@pytest.fixture(scope="module")
def poses(tmp_path_factory):
    """A folder of poses of a board, small ones."""
    place = tmp_path_factory.mktemp("poses")
    rig = standard_rig(scale=0.4)
    board, plan = fw.rig.parse_board("chessboard:11x8:12"), fringe_plan(rig)
    for k, T in enumerate(board_poses(board, 4, seed=1)):
        frames = list(photograph(look(rig, [board_body(board, T)]), plan, Optics(seed=k)))
        fw.files.write_stack(place / f"pose_{k}", frames, plan)
    fw.files.write_stack(place / "part", list(photograph(look(rig, bust()), plan, Optics())), plan)
    return place


@pytest.fixture
def _place(request, files, tmp_path, monkeypatch):
    """A folder with the files of the page, in which its code runs."""
    page = request.node.callspec.params["page"]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(webbrowser, "open", lambda *_, **__: True)
    if page.parent.name == "python":
        return  # These pages make their own files.
    for one in files.iterdir():
        # A recipe refuses links that lead out of its folder.
        if one.is_dir():
            (tmp_path / one.name).symlink_to(one)
        else:
            shutil.copy(one, tmp_path)
    if page.name == "rig.md":
        poses = request.getfixturevalue("poses")
        (tmp_path / "part").unlink()
        (tmp_path / "rig.toml").unlink()
        (tmp_path / "part").symlink_to(poses / "part")
        (tmp_path / "shots").mkdir()
        for one in poses.glob("pose_*"):
            (tmp_path / "shots" / one.name).symlink_to(one)
    elif page.name == "stacks.md":
        (tmp_path / "shots").symlink_to(files / "part")
    for made in ("part.ply", "part.html", "part.stl", "part.png", "part.pdf"):
        assert not (tmp_path / made).exists()


@pytest.fixture
def _kinds():
    """Kinds of devices that a page registers go with it."""
    yield
    for kinds in (CAMERA_KINDS, PROJECTOR_KINDS, BOTH_KINDS):
        for name, kind in list(kinds.items()):
            if not kind.open.__module__.startswith("fringeworks."):
                del kinds[name]


# Seen once in seven runs, on report.md: a warning of Matplotlib's layout, which nobody could repeat.
# These are the texts of a figure whose layout finds no room; every other warning is an error.
@pytest.mark.filterwarnings("ignore:constrained_layout not applied:UserWarning")
@pytest.mark.filterwarnings("ignore:Tight layout not applied:UserWarning")
@pytest.mark.usefixtures("_place", "_kinds", "_samples")
@pytest.mark.filterwarnings("ignore:FigureCanvasAgg is non-interactive")
@pytest.mark.parametrize(
    "page", marked((p for p in PAGES if p.name not in ELSEWHERE and blocks(p)), LONG)
)
def test_python_on_a_page_runs(page, tmp_path):
    known: dict[str, object] = {"fw": fw, "np": np, "__name__": "page"}
    for number, text in enumerate(blocks(page)):
        if page.name == "methods.md" and number == 0:
            # The page calls it a file, which the next block loads.
            (tmp_path / "mine.py").write_text(text)
            continue
        exec(compile(text, f"{page.name}, block {number}", "exec"), known)


def test_every_block_that_is_not_run_is_there():
    for name, first in NOT_RUN:
        texts = [p.read_text(encoding="utf-8") for p in PAGES if p.name == name]
        assert any(f"```python\n{first}" in text for text in texts), (name, first)


def groups() -> dict[str, object]:
    import typer

    return typer.main.get_command(app).commands


def parsed(line: str) -> None:
    """Parse a command line as the program does, without running it."""
    words = shlex.split(line.partition(" | ")[0].partition(" > ")[0])[1:]
    while words and words[0].startswith("-"):
        words = words[2 if words[0] in ("--log", "--plugin", "--max-gb") else 1 :]
    if not words:
        return
    command = groups()[words[0]]
    words = words[1:]
    if hasattr(command, "commands"):
        command, words = command.commands[words[0]], words[1:]
    if "--help" not in words:
        command.make_context("fringeworks", words)


LINES = [(page, line) for page in PAGES for line in examples(page.read_text(encoding="utf-8"))]
LINES += [
    (page, line)
    for page in PAGES
    for line in commands(page.read_text(encoding="utf-8"))
    if line.startswith("fringeworks ")
]


@pytest.mark.parametrize("page", sorted({page for page, _ in LINES}), ids=lambda p: p.name)
def test_commands_on_a_page_have_the_options_that_they_use(page):
    for where, line in LINES:
        if where == page and "COMMAND" not in line and "…" not in line:
            try:
                parsed(line)
            except Exception as error:
                pytest.fail(f"{line}: {getattr(error, 'message', error)}")


def anchors(page: Path) -> set[str]:
    """Names that headings of a page have as places, as the builder makes them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    titles = re.findall(r"^#+ (.*)$", text, re.M)
    return {slug(re.sub(r"[`*]|\]\(.*?\)|\[", "", t)) for t in titles}


def slug(title: str) -> str:
    """The place of a heading: ASCII letters in lower case, with hyphens."""
    plain = unicodedata.normalize("NFKD", title).encode("ascii", "ignore").decode()
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", plain).strip().lower())


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_lead_somewhere(page):
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, place = target.partition("#")
        other = page if not name else (page.parent / name).resolve()
        assert other.exists(), f"{page.name}: {target}"
        if place and other.suffix == ".md":
            assert place in anchors(other), f"{page.name}: {target}"


def hooks():
    """The builder's own steps; what they need is installed with the builder."""
    pytest.importorskip("latex2mathml")
    pytest.importorskip("mkdocs")
    place = importlib.util.spec_from_file_location("hooks", ROOT / "docs" / "hooks.py")
    assert place is not None
    assert place.loader is not None
    module = importlib.util.module_from_spec(place)
    place.loader.exec_module(module)
    return module


def test_every_public_name_has_a_place_in_the_api():
    found = [name for _, names in hooks().sections() for name in names]
    assert sorted(found) == sorted(public_names())


def test_equations_are_drawn_and_code_is_left():
    made = hooks().with_equations(
        "a $x^2$ b\n\n`$x$`\n\n$$ \\frac{1}{2} $$\n\n    cost $5 and $6\n"
    )
    assert made.count("<math") == 2
    assert "<mfrac>" in made
    assert "`$x$`" in made
    assert "cost $5 and $6" in made


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_no_equation_is_left_as_text(page):
    made = hooks().with_equations(page.read_text(encoding="utf-8"))
    outside = re.sub(r"^```.*?^```|^    .*?$|`[^`]*`", "", made, flags=re.M | re.S)
    assert not re.search(r"\\frac|\\sigma|\$\$", outside)


def test_every_page_is_in_the_navigation_once():
    listed = re.findall(r": ([\w/-]+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.M)
    pages = [str(p.relative_to(ROOT / "docs")) for p in (ROOT / "docs").rglob("*.md")]
    assert sorted(listed) == sorted(pages)


def test_every_method_has_a_page_with_its_options():
    for method in ("windowed", "fourier", "windowed_fourier", "wavelet", *ROW_METHODS):
        text = (ROOT / "docs" / "methods" / f"{method}.md").read_text(encoding="utf-8")
        for title in ("What it does", "When it wins", "When it fails", "Measured", "Options"):
            assert f"\n## {title}\n" in text, (method, title)
        for option in fw.pair.get_method(method).options:
            assert f"`{option}`" in text, (method, option)


def test_pages_name_dois_once_and_in_form():
    text = (ROOT / "docs" / "bibliography.md").read_text(encoding="utf-8")
    for shown, linked in re.findall(r"\[(10\.[^\]]+)\]\(https://doi\.org/([^)]+)\)", text):
        assert shown == urllib.parse.unquote(linked)
    source = "".join(p.read_text(encoding="utf-8") for p in SOURCES)
    cited = re.findall(r"doi:(10\.(?:\([^\s()]*\)|[^\s,;()])+)", source)
    missing = {doi.rstrip(".") for doi in cited} - set(re.findall(r"\[(10\.[^\]]+)\]", text))
    assert not missing
