"""Figures that pages quote from the code are those of the code."""

from __future__ import annotations

import re
import tomllib
from functools import cache
from importlib import import_module

import pytest

import fringeworks as fw
from tests.walk import ROOT

UP_TO_TWELVE = "zero one two three four five six seven eight nine ten eleven twelve"
WORDS = {word: float(k) for k, word in enumerate(UP_TO_TWELVE.split())}
WORDS |= {"half": 0.5, "quarter": 0.25, "tenth": 0.1, "twice": 2.0}
"""Figures that pages write as words."""

PERCENT = 0.01
MB = float(1 << 20)
MILLION = 1e6

FIGURES: dict[str, list[tuple[str, str, float]]] = {
    "architecture.md": [
        (r"blocks of (\d+) pixels", "decode/mod.rs:BLOCK_PIXELS", 1),
        (r"files have at most (\d+) lines", "tests/test_architecture.py:MAX_FILE", 1),
        (r"functions at most (\d+)", "tests/test_architecture.py:MAX_FUNCTION", 1),
        (r"\((\d+) names at most\)", "tests/test_architecture.py:MOST_NAMES", 1),
    ],
    "performance.md": [
        (r"blocks of (\d+) pixels", "decode/mod.rs:BLOCK_PIXELS", 1),
        (r"judges every (\d+)th stack", "stack:JUDGE_EVERY", 1),
    ],
    "stacks.md": [
        (r"every (\d+)th call", "stack:JUDGE_EVERY", 1),
        (r"\(at least (\w+)\)\. For 12 frames", "patterns:MIN_MARGIN", 1),
        (r"margin of less than (\w+) standard", "patterns:ORDER_SIGMAS", 1),
        (r"within (\w+) standard deviations", "patterns:ALTERNATIVE_SIGMAS", 1),
        (r"modulation above (\w+) of its", "stack:MIN_SNR", 1),
        (r"fewer than (\d+) % of the pixels", "stack:MIN_MEASURED", PERCENT),
        (r"decides: (\d+) × \d+ pixels", "stack:NEIGHBOURHOOD", 1),
    ],
    "../CONTRIBUTING.md": [
        (r"at most (\d+) lines", "tests/test_architecture.py:MAX_FILE", 1),
        (r"lines, functions (\d+)", "tests/test_architecture.py:MAX_FUNCTION", 1),
    ],
    "files.md": [
        (r"8 bytes per pixel \| (\d+) GB", "files:DEFAULT_MAX_GB", 1),
        (r"a frame counts (\d+) bytes", "files:FLOAT_BYTES", 1),
        (r"XML, YAML\) \| (\d+) MB", "files:MAX_DESCRIPTION_BYTES", MB),
        (r"rows of an image or device \| ([\d ]+) \|", "files:MAX_LENGTH_PX", 1),
        (r"pages of a TIFF \| ([\d ]+) \|", "files:MAX_PAGES", 1),
        (r"cameras of one rig \| (\d+) \|", "files:MAX_CAMERAS", 1),
        (r"version 7.3 \| (\d+) s", "files.mat:CPU_SECONDS", 1),
    ],
    "reference.md": [
        (r"one file may take, GB; (\d+) by default", "files:DEFAULT_MAX_GB", 1),
    ],
    "few-frames.md": [
        (r"within ([\d.]+) times the shortest", "patterns:ROBUST_BAND", 1),
        (r"(\w+) σ of the rig's calibration", "rig:ROOM_SIGMAS", 1),
    ],
    "rig.md": [
        (r"median epipolar error is above (\d+) px", "rig:LARGE_EPIPOLAR_PX", 1),
        (r"more than (\d+) % of the decoded", "rig:LARGE_SHARE", PERCENT),
        (r"more than (\d+) % of the lit pixels", "stack:LARGE_SHARE", PERCENT),
        (r"rows disagree by more than (\d+) σ", "rig:RESIDUAL_SIGMAS", 1),
        (r"is taken, at most (\d+) px", "rig:MAX_UNKNOWN_PX", 1),
        (r"(\w+) different poses are enough", "scan:ENOUGH_POSES", 1),
        (r"enough if (\w+) are tilted", "scan:TILTED_POSES", 1),
        (r"camera by (\d+)° or more", "scan:ADVISED_TILT_DEG", 1),
        (r"a drift of ([\d.]+) % of the dist", "rig:BLIND_SHARE", PERCENT),
        (r"the drift is below (\d+) px", "rig:UNKNOWN_RIG_PX", 1),
        (r"the farthest ([\d.]+) % are discarded", "surface:DISCARDED", PERCENT),
        (r"more than (\w+) robust standard", "surface:FAR_SIGMAS", 1),
        (r"more than a (\w+) of the points lie off", "surface:MAX_FAR_SHARE", 1),
        (r"no better than (\d+) %", "surface:MAX_RELATIVE_SIGMA", PERCENT),
        (r"each sphere is the ball of ([\d.]+) radii", "surface:SPHERE_REGION", 1),
    ],
    "cameras.md": [
        (r"Within (\w+) pixels of an edge", "rig:MARGIN_PX", 1),
        (r"exceed (\w+) their σ", "rig:MAX_DISAGREEMENT", 1),
    ],
    "sequences.md": [
        (r"peak of (\w+) times the floor", "evaluate:PEAK_FLOORS", 1),
    ],
    "merging.md": [
        (r"Points less than (\d+) mm above", "pipeline:ABOVE_MM", 1),
        (r"is the ratio; above (\d+) it", "pipeline:MAX_CLOSURE_SIGMAS", 1),
        (r"by their σ; above (\d+) it", "pipeline:MAX_DISAGREEMENT", 1),
    ],
    "deviation.md": [
        (r"more than (\d+) σ are a dent", "evaluate:SURE_SIGMAS", 1),
        (r"in cells of (\w+) pixels", "evaluate:CELL_SPACINGS", 1),
        (r"\((\d+) % of the model's size", "views:REACH_SHARE", PERCENT),
        (r"a (\w+) of a pixel within", "evaluate:EDGE_SIGMA_SPACINGS", 1),
        (r"pixel within ([\d.]+) pixels", "evaluate:EDGE_SPACINGS", 1),
    ],
    "inspect.md": [
        (r"divided into (\d+) × \d+ patches", "evaluate:PATCHES", 1),
        (r"(\d+) % of the area must", "evaluate:LEAST_SHARE_OF_VOLUME", PERCENT),
        (r"risk = ([\d.]+)", "types:USUAL_RISK", 1),
    ],
    "batch.md": [
        (r"`--memory-gb` \((\d+)\)", "batch:USUAL_MEMORY_GB", 1),
        (r"chunks of (\d+) × \d+ pixels", "batch:CHUNK_PX", 1),
    ],
    "report.md": [
        (r"turns (\d+) surfaces at most", "report:MOST_VIEWERS", 1),
        (r"more than (\d+) million pixels", "report.viewer.content:MAX_PIXELS", MILLION),
        (r"below (\d+) MB: larger", "report:NOTEBOOK_BYTES", MILLION),
    ],
    "viewer.md": [
        (r"holds up to (\d+) million pixels", "report.viewer.content:MAX_PIXELS", MILLION),
    ],
    "devices.md": [
        (r"`board-0` to `board-(\d+)`", "devices:POSES", 1),
        (r"saturated; (\w+) of them by default", "scan:MOST_SATURATED", 1),
        (r"camera sees (\d+) % of", "scan:MIN_COVERED_SHARE", PERCENT),
        (r"every picture in (\d+) rounds", "scan:MAX_ROUNDS", 1),
    ],
    "methods.md": [
        (r"by more than (\d+)° against", "pipeline:TURNED_DEG", 1),
        (r"at least (\d+) % of the object", "pipeline:ONE_SIDED", PERCENT),
        (r"more than ([\d.]+) % of the per", "pipeline:NOISY_ROWS", PERCENT),
        (r"less than (\w+) of the pixels that", "pipeline:FEW_MEASURED", 1),
    ],
}
"""What pages say, with the figure in brackets; the constant, as room:NAME; and its unit there."""
LAST = {"devices:POSES"}
"""Numbers of things whose page quotes the last, counted from 0."""


@cache
def page(name: str) -> str:
    """The text of a page, with single spaces in place of line breaks."""
    return " ".join((ROOT / "docs" / name).read_text(encoding="utf-8").split())


def number(text: str) -> float:
    """A figure as a page writes it: digits, with spaces between thousands, or a word."""
    word = text.strip().lower()
    return WORDS[word] if word[0].isalpha() else float(word.replace(" ", ""))


def constant(place: str) -> float:
    """The value of a constant of a room or module of the package, of a kernel, or of a test."""
    where, name = place.split(":")
    if where.endswith((".rs", ".py")):
        folder = ROOT / "crates/fringeworks/src" if where.endswith(".rs") else ROOT
        text = (folder / where).read_text(encoding="utf-8")
        (found,) = re.findall(rf"^(?:.*const )?{name}(?:: \w+)? = (\d+);?$", text, re.M)
        return float(found)
    source = ROOT / "src"
    start = source.joinpath("fringeworks", *where.split("."))
    files = sorted(start.rglob("*.py")) or [start.with_suffix(".py")]
    (file,) = [f for f in files if re.search(rf"^{name}(: .*)? = ", f.read_text("utf-8"), re.M)]
    module = ".".join(file.relative_to(source).with_suffix("").parts)
    return float(getattr(import_module(module), name))


ROWS = [(name, *row) for name, rows in FIGURES.items() for row in rows]


@pytest.mark.parametrize(
    ("name", "says", "place", "unit"), ROWS, ids=[f"{row[0]} {row[2]}" for row in ROWS]
)
def test_a_page_says_what_the_code_has(name, says, place, unit):
    found = re.findall(says, page(name))
    assert found, f"{name}: nothing like {says!r}: change the table when the sentence changes"
    expected = constant(place) - (place in LAST)
    assert [number(one) * unit for one in found] == pytest.approx([expected] * len(found))


def test_files_that_the_architecture_names_are_there():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    files = {f"/{p.relative_to(ROOT).as_posix()}" for p in ROOT.glob("[st][re]*/**/*.py*")}
    named = set(re.findall(r"`((?:\w+/)*\w+\.pyi?)`", text))
    assert len(named) > 50
    for room, starts in re.findall(r"^\| `(\w+/)` \|.*\|([^|]*)\|$", text, re.M):
        named |= {room + name for name in re.findall(r"`(.*?)`", starts)}
    assert not {name for name in named if not any(path.endswith("/" + name) for path in files)}


def test_the_citation_and_the_links_are_those_of_the_package():
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    cited = dict(re.findall(r'^([\w-]+): "?([^"\n]+)"?$', text, re.M))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert cited["version"] == fw.__version__
    assert cited["license"] == project["license"]
    assert cited["repository-code"] == project["urls"]["Source"]
    for name, path in (("Changelog", "CHANGELOG.md"), ("Documentation", "docs/index.md")):
        assert project["urls"][name] == f"{cited['repository-code']}/blob/main/{path}"
        assert (ROOT / path).exists()


MAKERS = {
    "gallery": "docs/make_gallery.py",
    "concepts": "docs/make_concepts.py",
    "studio": "docs/make_studio_screenshots.py",
    "report": "docs/make_screenshots.py",
    "viewer": "docs/make_screenshots.py",
    "camera.png": "docs/make_screenshots.py",
    "rig_bust.png": "docs/make_screenshots.py",
    "napari.png": "docs/make_napari.py",
    "benchmarks.png": "benchmarks/page.py",
}
"""Program that draws the pictures of a folder, or one picture."""


def test_every_picture_has_a_program_that_draws_it():
    assert {path.name for path in (ROOT / "docs" / "images").iterdir()} == MAKERS.keys()
    for name, program in MAKERS.items():
        assert f'"{name}"' in (ROOT / program).read_text(encoding="utf-8"), name
    made = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert all(program in made for program in MAKERS.values() if program.startswith("docs/"))


def test_the_changes_of_a_version_are_one_screen():
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    for version in changes.split("\n## ")[1:]:
        lines = version.splitlines()
        assert len(lines) <= 50, "name what users see in a line, and describe it on its page"
        assert max(map(len, lines)) <= 140
