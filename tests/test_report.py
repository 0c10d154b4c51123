"""Reports: every kind of result becomes a page and a PDF; nothing in them can run or ask a network."""

from __future__ import annotations

import base64
import json
import re
import zlib
from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.report.kinds.surface import height_figures, height_sheet, height_words
from fringeworks.report.page.tolerances import judge, parse_tolerance
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import bust, fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look
from fringeworks.types import Finding
from tests.grids import quick
from tests.virtual_devices import Screen, bench

pytestmark = pytest.mark.statistical

RIG = standard_rig(scale=0.2)
KINDS = ("points", "cloud", "coordinates", "pair", "heights", "form", "rig", "table", "figures")
NAUGHTY = '<script>alert(1)</script> & "quotes" $x$ </style>'


@pytest.fixture(scope="module")
def results():
    """One result of every kind that a report takes."""
    plan = fringe_plan(RIG)
    frames = tuple(photograph(look(RIG, bust()), plan, Optics(seed=1)))
    stack = fw.Stack(frames, plan)
    measured = fw.measure(stack, RIG)
    scene = fw.simulate.standard_scene("parabola", size=120, noise=1.0, bits=8)
    pair = fw.reconstruct(scene, "windowed")
    rng = np.random.default_rng(0)
    directions = rng.standard_normal((400, 3))
    ball = 20 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return {
        "points": measured,
        "cloud": measured.points,
        "coordinates": measured.decoded,
        "pair": pair,
        "heights": pair.surface,
        "form": fw.fit(ball, "sphere", diameter_mm=40),
        "rig": RIG,
        "table": fw.compare(["parabola"], ["windowed", "fourier"], size=80),
        "figures": fw.report.summarise(measured),
    }


def test_every_kind_becomes_a_page(results, tmp_path):
    written = fw.write_report(tmp_path / "r.html", results, rig=RIG)
    assert [path.name for path in written.paths] == ["r.html"]
    assert written.kept
    page = (tmp_path / "r.html").read_text()
    for name in results:
        assert f">{name}</h2>" in page
    # Nothing is loaded from elsewhere, and the page's own policy forbids it.
    assert not re.search(r"""(src|href)=["'](?!data:|#)""", page)
    assert 'content="default-src &#39;none&#39;;' in page


@pytest.mark.parametrize(
    "names", [("form", "table", "figures"), pytest.param(KINDS, marks=pytest.mark.long)], ids=len
)
def test_kinds_become_a_pdf_beside_the_page(results, tmp_path, names):
    some = {name: results[name] for name in names}
    written = fw.write_report(tmp_path / "r.html", some, pdf=tmp_path / "r.pdf", rig=RIG)
    assert [path.name for path in written.paths] == ["r.html", "r.pdf"]
    assert (tmp_path / "r.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("name", "suffix"),
    quick(
        [("pair", "html"), ("pair", "pdf"), ("form", "pdf")],
        ("pair", "html"),
        ("form", "pdf"),
    ),
)
def test_equal_runs_write_equal_files(results, tmp_path, monkeypatch, name, suffix):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    paths = [tmp_path / f"{run}.{suffix}" for run in "ab"]
    for path in paths:
        fw.write_report(path, results[name], title="t")
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_markup_in_names_is_shown_and_not_obeyed(results, tmp_path):
    surface = results["heights"]
    fw.write_report(
        tmp_path / "r.html",
        {NAUGHTY: surface},
        title=f"{NAUGHTY}!",
        notes=[NAUGHTY],
        pdf=tmp_path / "r.pdf",
    )
    page = (tmp_path / "r.html").read_text()
    assert "alert(1)</script>" not in page
    assert page.count("&lt;script&gt;alert(1)&lt;/script&gt;") >= 4


@pytest.mark.parametrize("pdf", quick([None, "r.pdf"], None))
def test_surfaces_without_values_and_of_one_pixel(results, tmp_path, pdf):
    nothing = np.full((3, 4), np.nan, np.float32)
    reason = np.full((3, 4), fw.Reason.LOW_MODULATION, np.uint8)
    empty = fw.HeightMap(nothing, nothing, reason, "height", "mm", 0.1)
    one = np.ones((1, 1), np.float32)
    pixel = fw.HeightMap(one, 0.1 * one, np.zeros((1, 1), np.uint8), "displacement", "px", None)
    finding = fw.Finding("noise", "seen", ("a cause",), "do it")
    many = replace(results["heights"], findings=(finding,) * 10_000)
    fw.write_report(
        tmp_path / "r.html",
        {"empty": empty, "pixel": pixel, "many": many},
        pdf=pdf and tmp_path / pdf,
    )
    page = (tmp_path / "r.html").read_text()
    assert "9800 more findings are not listed" in page
    assert "expose longer" in page


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("median_sigma_mm<=0.05", ("median_sigma_mm", "<=", 0.05)),
        (" bodies.0.radius_mm > 1e1 ", ("bodies.0.radius_mm", ">", 10.0)),
    ],
)
def test_tolerances_are_read(text, parts):
    found = parse_tolerance(text)
    assert (found.name, found.sign, found.limit) == parts


@pytest.mark.parametrize("text", ["", "a", "a=3", "a<=", "a<=x", "a<=nan", "<=3", "a b<=3"])
def test_other_tolerances_are_refused(text):
    with pytest.raises(fw.InputError, match="tolerance: expected a name"):
        parse_tolerance(text)


def test_tolerances_are_judged(results, tmp_path):
    figures = {"a": 1.0, "b": None, "c": [{"d": 2}], "e": "text", "f": True}
    judged = judge(figures, [parse_tolerance(t) for t in ("a<=1", "a<1", "b<=1", "c.0.d>=2")])
    assert [one.kept for one in judged] == [True, False, False, True]
    for name in ("e", "f", "g", "c.1.d"):
        with pytest.raises(fw.InputError, match=f"expected one of a, b, c.0.d; got {name}"):
            judge(figures, [parse_tolerance(f"{name}<1")])
    written = fw.write_report(
        tmp_path / "r.html",
        results["points"],
        tolerances=["failed_fraction<=0.9", "median_sigma_mm<=1e-9"],
    )
    assert not written.kept
    page = (tmp_path / "r.html").read_text()
    assert "FAIL: 1 of 2 tolerances is not kept." in page
    assert page.count(">FAIL<") == page.count(">pass<") == 1


def test_results_are_read_from_files(results, tmp_path):
    cloud = results["cloud"]
    fw.files.write_points(tmp_path / "p.ply", cloud)
    fw.files.write_points(tmp_path / "p.npz", cloud)
    fw.files.write_surface(tmp_path / "h.npz", results["heights"])
    fw.files.write_surface(tmp_path / "h.tif", results["heights"])
    fw.files.write_coordinates(tmp_path / "c.npz", results["coordinates"])
    fw.files.write_rig(tmp_path / "rig.toml", RIG)
    (tmp_path / "m.json").write_text(fw.report.to_json(results["figures"]))
    names = ["p.ply", "p.npz", "h.npz", "h.tif", "c.npz", "rig.toml", "m.json"]
    fw.write_report(
        tmp_path / "r.html", [tmp_path / n for n in names], rig=tmp_path / "rig.toml", every=2
    )
    page = (tmp_path / "r.html").read_text()
    for name in names:
        assert f">{name}</h2>" in page
    assert f"{int((cloud.reason == 0).sum()):,}" in page


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("x.ply", None, "x.ply"),
        ("x.csv", "a", "x.csv: expected columns x, y and z, got a"),
        ("x.docx", "a", "expected one of .ply"),
        ("x.json", "[1]", "expected the numerical results"),
        ("x.json", "{", "x.json"),
        ("x.toml", "kind = 3", "x.toml"),
        ("x.npz", "no archive", "x.npz"),
    ],
)
def test_files_that_hold_no_result(tmp_path, name, content, said):
    if content is not None:
        (tmp_path / name).write_text(content)
    with pytest.raises(fw.FileProblem, match=re.escape(said)):
        fw.write_report(tmp_path / "r.html", tmp_path / name)
    assert not (tmp_path / "r.html").exists()


def test_what_is_no_result(tmp_path):
    for result in ({}, [], 3, "folder"):
        if result == "folder":
            result = tmp_path
        with pytest.raises(fw.InputError):
            fw.write_report(tmp_path / "r.html", result)
    with pytest.raises(fw.FileProblem, match="expected one of .html, .pdf|html"):
        fw.write_report(tmp_path / "r.doc", RIG)
    np.savez(tmp_path / "x.npz", a=1)
    with pytest.raises(fw.FileProblem, match="got arrays named a"):
        fw.write_report(tmp_path / "r.html", tmp_path / "x.npz")
    with pytest.raises(fw.InputError, match="every: expected a whole number of 1 or more, got -1"):
        fw.write_report(tmp_path / "r.html", RIG, every=-1)


def test_the_command(results, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    fw.files.write_points("p.npz", results["cloud"])
    fw.files.write_rig("rig.toml", RIG)
    command = ["report", "p.npz", "rig.toml", "--rig", "rig.toml", "--out", "r.html"]
    assert run([*command, "--title", "Part 7", "--note", "first", "--pdf", "r.pdf"]) == 0
    assert capsys.readouterr().out.splitlines() == ["wrote r.html", "wrote r.pdf"]
    assert "<title>Part 7</title>" in (tmp_path / "r.html").read_text()
    (tmp_path / "m.json").write_text(fw.report.to_json(results["figures"]))
    assert run(["report", "m.json", "--out", "r.html", "--tolerance", "points<=1"]) == 3
    assert "not all tolerances are kept" in capsys.readouterr().out
    assert run(["report", "m.json", "--out", "r.html", "--tolerance", "nonsense<=1"]) == 2
    assert "tolerance: expected one of shape.0" in capsys.readouterr().err


def test_provenance_reproduces_the_result(results, tmp_path):
    fw.write_report(tmp_path / "r.html", results["pair"])
    page = (tmp_path / "r.html").read_text()
    origin = results["pair"].surface.provenance
    assert f"fringeworks {origin.version}" in page
    assert "fringeworks.reconstruct(" in page
    for source in origin.inputs:
        assert source.sha256 in page
    assert json.dumps(origin.options["method"]).strip('"') in page


def test_two_surfaces_are_compared(results, tmp_path):
    """The page holds both once, and the difference in figures."""
    surface = results["heights"]
    higher = replace(surface, values=surface.values + 0.5)
    fw.write_report(tmp_path / "r.html", {"low": surface, "high": higher})
    page = (tmp_path / "r.html").read_text()
    assert page.count("application/x-fringeworks-surface") == 2 + 1  # the script names it once
    assert page.count('<div class="fringe-viewer-mount">') == 1
    assert ">Comparison</h2>" in page
    assert re.search(r"median of B − A</dt><dd>0\.500 mm", page)
    # Maps of other sizes are not compared.
    fw.write_report(tmp_path / "r.html", {"a": surface, "b": results["cloud"]})
    assert ">Comparison</h2>" not in (tmp_path / "r.html").read_text()


def test_results_show_themselves_in_notebooks_and_browsers(results, tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr("tempfile.mkdtemp", lambda **_: str(tmp_path))
    path = results["points"].show(every=2)
    assert opened == [path.as_uri()]
    assert "<h1>Measurement</h1>" in path.read_text()
    frame = results["cloud"]._repr_html_()
    assert frame.startswith("<iframe srcdoc=")
    assert "<script" not in frame  # escaped inside the attribute
    assert results["coordinates"]._repr_html_() is None
    assert results["coordinates"]._repr_png_().startswith(b"\x89PNG")


def test_large_surfaces_are_thinned_in_notebooks(results, monkeypatch):
    monkeypatch.setattr("fringeworks.report.interactive.NOTEBOOK_BYTES", 30_000)
    frame = results["cloud"]._repr_html_()
    assert "to stay below 8 MB" in frame


def test_set_ups_calibrations_and_phases_have_chapters(tmp_path):
    devices = bench({"width_px": 192, "height_px": 120}, scene=Screen(120, 192))
    found = fw.set_up(devices.projector, devices.camera)
    fw.files.write_setup(tmp_path / "s.toml", found, projector="virtual", camera="virtual:plane")
    stored = fw.files.read_setup(tmp_path / "s.toml")
    fw.write_report(
        tmp_path / "r.html", {"measured": found, "stored": stored, "plan": found.proposal.plan}
    )
    page = (tmp_path / "r.html").read_text()
    assert "virtual:plane, " not in page
    assert ">virtual:plane<" in page
    assert page.count("<img ") >= 3


def test_whole_periods_that_nothing_tells_do_not_hide_the_sigma_of_pixels():
    """A part of σ that all pixels share is said by itself."""
    sigma = np.hypot(np.full((6, 8), 0.05), 95.0)
    found = fw.HeightMap(
        np.zeros((6, 8)),
        sigma,
        np.zeros((6, 8), np.uint8),
        quantity="displacement",
        unit="px",
        pitch=None,
        findings=(Finding("no background", "said", figures={"zero_sigma_px": 95.0}),),
    )
    figures = height_figures(found)
    assert figures["median_sigma"] == pytest.approx(95.0)
    words = [str(word) for word in height_words(None, figures | {"findings": []})]
    assert any("median σ 0.050 px, beside 95 px that all pixels share" in word for word in words)
    panel = height_sheet(found, None).panels[1]
    np.testing.assert_allclose(panel.values, 0.05, rtol=1e-6)
    assert "95 px in common" in panel.title


def test_frames_that_are_too_large_for_a_page_are_thinned(tmp_path, monkeypatch):
    """A limit of 5,000 pixels stands for one of eight million."""
    monkeypatch.setattr("fringeworks.report.viewer.content.MAX_PIXELS", 5000)
    values = np.add.outer(np.arange(120.0), np.arange(150.0)).astype(np.float32)
    large = fw.HeightMap(values, 0.1 + 0 * values, (0 * values).astype(np.uint8), "height", "mm", 1)
    fw.write_report(tmp_path / "r.html", {"large": large})
    page = (tmp_path / "r.html").read_text("utf-8")
    assert "Shown: one of 2 columns and rows of 150 × 120 px." in page
    assert "fringe-viewer-mount" in page
    with pytest.raises(fw.InputError, match="or every = 2"):
        fw.report.pack_surface(large)


def test_a_finding_is_said_once(results, tmp_path):
    """By the chapter, and neither by the picture below it nor by the viewer."""
    text = "the fringes jitter by half a pixel"
    found = replace(results["cloud"], findings=(fw.Finding("noise", text, ("a cause",), "do it"),))
    fw.write_report(tmp_path / "r.html", {"cloud": found}, pdf=tmp_path / "r.pdf")
    page = (tmp_path / "r.html").read_text("utf-8")
    assert page.count(text) == 1
    packed = re.search(r"x-fringeworks-surface\">([^<]*)<", page)[1]
    assert text.encode() not in base64.b64decode(packed)
    content = (tmp_path / "r.pdf").read_bytes()
    streams = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", content, re.S)
    shown = b"".join(zlib.decompressobj().decompress(s) for s in streams if s[:1] == b"x")
    assert shown.count(b"jitter") <= 1
