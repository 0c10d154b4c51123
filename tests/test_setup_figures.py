"""The set-up in pictures, words and JSON: on benches with and without faults."""

from __future__ import annotations

import json

import pytest
from PIL import Image

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.report.setup_curves import FAULT
from tests.grids import quick
from tests.virtual_devices import Screen, bench

pytestmark = pytest.mark.statistical

ROWS, COLUMNS = 120, 192
PLACES = {
    "scale": ({"scale": 0.9}, {}, ["scaling: the contrast beats, the picture is resized"]),
    "mirrored": ({"mirrored": True}, {}, ["orientation along x: the picture is mirrored"]),
    "range": ({"range_limited": True}, {}, ["response: light ≈ level^"]),
    "exposure": ({}, {"obeys_exposure": False}, ["exposure does not obey: asked for a ratio"]),
    "flicker": ({}, {"flicker": 0.4}, ["flicker: ", "flicker: seen at 10.0 Hz"]),
}


def opened(projector, camera):
    b = bench(
        {"width_px": COLUMNS, "height_px": ROWS} | projector,
        camera,
        scene=Screen(ROWS, COLUMNS, ambient=0.12),
        seed=1,
    )
    return b.projector, b.camera


def titles(figure):
    """Titles of the panels, and whether each is marked as a fault."""
    panels = [axes for part in figure.subfigs for axes in part.axes]
    return {a.get_title().replace("\n", " "): a.title.get_color() == FAULT for a in panels}


@pytest.mark.long
def test_a_clean_setup_has_twelve_panels_without_a_fault(tmp_path):
    figure = fw.report.setup_sheet(fw.set_up(*opened({}, {})))
    found = titles(figure)
    assert len(found) == 12
    assert not any(found.values())
    assert all(axes.get_title() for part in figure.subfigs for axes in part.axes)
    assert "nothing makes measurements worse" in figure.subfigs[0].get_suptitle()
    path = fw.save_figure(figure, tmp_path / "setup.png")
    with Image.open(path) as image:
        assert image.width > 1500
    for suffix in ("pdf", "svg"):
        fw.save_figure(figure, tmp_path / f"setup.{suffix}")


# test_setup.py finds the other three, too.
@pytest.mark.parametrize("kind", quick(list(PLACES), "mirrored", "exposure"))
def test_the_panel_of_a_fault_is_marked(kind):
    projector, camera, expected = PLACES[kind]
    measured = fw.set_up(*opened(projector, camera))
    assert [f.kind for f in measured.findings] == [kind]
    text = measured.findings[0].text
    assert "likely" in text
    assert text.count(";") >= 2
    figure = fw.report.setup_sheet(measured)
    marked = [title for title, fault in titles(figure).items() if fault]
    assert len(marked) == len(expected)
    for title, beginning in zip(marked, expected, strict=True):
        assert title.startswith(beginning)
    assert f"1 finding: {kind}" in figure.subfigs[0].get_suptitle()
    words = " ".join(figure.subfigs[1].texts[0].get_text().split())
    assert "Finding 1: " in words
    assert "likely" in words


@pytest.fixture
def command(tmp_path, monkeypatch, capsys):
    """Run ``setup`` on a bench; exit code, words and JSON."""
    monkeypatch.chdir(tmp_path)

    def call(projector, camera, *options):
        monkeypatch.setattr(
            "fringeworks.scan.bench.open_devices", lambda *_: opened(projector, camera)
        )
        devices = ["--projector", "virtual", "--camera", "virtual"]
        code = run(["setup", *devices, "--out", "s.toml", "--json", "s.json", *options])
        said = capsys.readouterr()
        return code, said, json.loads((tmp_path / "s.json").read_text())

    return call


def test_the_command_writes_everything(command, tmp_path):
    code, said, figures = command({}, {})
    assert code == 0
    assert {p.name for p in tmp_path.iterdir()} == {"s.toml", "s.plan.toml", "s.png", "s.json"}
    assert "nothing was found that makes measurements worse" in said.out
    assert "chosen for fringes" in said.out
    assert figures["exposure"]["chosen"]
    assert figures["vignetting"]["judged"] == "fall-off"
    assert figures["plan"]["predicted_sigma_px"] > 0
    assert figures["findings"] == []


def test_the_command_prints_a_table_of_findings(command, tmp_path):
    code, said, figures = command({"scale": 0.9}, {}, "--figure", "other.svg")
    assert code == 0
    assert (tmp_path / "other.svg").is_file()
    assert not (tmp_path / "s.png").exists()
    for words in ("finding", "likely causes", "what to do", "keystone", "along x", "along y"):
        assert words in said.out
    assert [f["kind"] for f in figures["findings"]] == ["scale"]
    assert len(figures["findings"][0]["causes"]) == 3


def test_a_setup_that_stops_still_shows_what_it_has_measured(command, tmp_path):
    code, said, figures = command({}, {"auto_exposure": True})
    assert code == 2
    assert {p.name for p in tmp_path.iterdir()} == {"s.png", "s.json"}
    assert "an automatic" in said.out
    assert "nothing was found" not in said.out
    assert said.err.startswith("error (exposure): an automatic exposure is on")
    assert said.err.splitlines()[-1].startswith("fringeworks: virtual: expected an exposure")
    assert figures["exposure"]["proof"]["verdict"] == "automatic"
    assert figures["response"] is None


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--out", "s.txt"], "expected .toml"),
        (["--out", "-"], "expected .toml"),
        (["--out", "s.toml", "--figure", "s.bmp"], "expected one of .png, .pdf, .svg"),
        (["--out", "none/s.toml"], "expected a writable folder"),
        (["--out", "s.toml", "--json", "-", "--figure", "-"], "expected one result"),
    ],
)
def test_targets_are_checked_first(options, said, monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delattr("fringeworks.scan.bench.open_devices")
    assert run(["setup", "--projector", "virtual", "--camera", "virtual", *options]) == 2
    assert said in capsys.readouterr().err
