"""The head of a report: for whom, of which part, and who signs."""

from __future__ import annotations

import re

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.evaluate import Area, PartTolerance
from fringeworks.evaluate.inspect import recipe_hash

HEAD = {"customer": "Müller & Söhne", "part_number": "4711", "revision": "C"}


def plate(seed=0):
    """A flat cloud of 40 × 40 points with noise of 0.01 mm."""
    y, x = np.mgrid[:40, :40] * 0.5
    z = 500.0 + np.random.default_rng(seed).normal(0.0, 0.01, x.shape)
    sigma = np.full(x.shape, 0.01, np.float32)
    xyz = np.stack((x - 10.0, y - 10.0, z), -1).astype(np.float32)
    return fw.PointCloud(xyz, sigma, sigma, np.zeros(x.shape, np.uint8))


def recipe(head=None):
    share = PartTolerance("seen", "valid_share", ("face",), 0.9, None)
    areas = {"face": Area(box=(2, 2, 37, 37))}
    return fw.Recipe(areas=areas, tolerances=(share,), head=head or {})


def fields_of(page):
    """Names and texts of the head of a page."""
    found = re.findall(r"<div><dt>(.*?)</dt><dd([^>]*)>(.*?)</dd></div>", page)
    return [(name, "" if "blank" in kind else text) for name, kind, text in found]


def test_a_report_with_a_verdict_has_a_head_to_sign(tmp_path):
    found = fw.inspect(plate(), recipe(HEAD))
    fw.write_report(tmp_path / "r.html", {"part": found}, head={"serial": "18"})
    assert fields_of((tmp_path / "r.html").read_text("utf-8")) == [
        ("customer", "Müller &amp; Söhne"),
        ("order", ""),
        ("part", ""),
        ("part number", "4711"),
        ("serial number", "18"),
        ("drawing", ""),
        ("drawing revision", "C"),
        *(("inspected by", ""), ("date", ""), ("signature", "")),
        *(("approved by", ""), ("date", ""), ("signature", "")),
    ]


def test_what_is_given_comes_before_the_recipe_and_the_inspector_signs(tmp_path):
    found = fw.inspect(plate(), recipe({**HEAD, "inspector": "A"}))
    given = {"inspector": "J. Doe", "revision": "D"}
    fw.write_report(tmp_path / "r.html", {"part": found}, pdf=tmp_path / "r.pdf", head=given)
    fields = fields_of((tmp_path / "r.html").read_text("utf-8"))
    assert ("inspected by", "J. Doe") in fields
    assert ("drawing revision", "D") in fields
    assert (tmp_path / "r.pdf").stat().st_size > 10_000


def test_reports_without_a_verdict_have_what_is_given_only(tmp_path):
    fw.write_report(tmp_path / "r.html", {"points": plate()})
    assert fields_of((tmp_path / "r.html").read_text("utf-8")) == []
    fw.write_report(tmp_path / "r.html", {"points": plate()}, head={"serial": "18"})
    assert fields_of((tmp_path / "r.html").read_text("utf-8")) == [("serial number", "18")]


@pytest.mark.parametrize(
    ("head", "said"),
    [
        ({"colour": "red"}, "head: expected fields of customer, order"),
        ({"serial": ""}, "head: expected a line of 1 to 120 letters for serial, got ''"),
        ({"serial": "x" * 121}, "head: expected a line of 1 to 120 letters for serial"),
        ({"part": "two\nlines"}, "head: expected a line of 1 to 120 letters for part"),
    ],
)
def test_faults_of_a_head_are_named(tmp_path, head, said):
    with pytest.raises(fw.InputError, match=re.escape(said)):
        recipe(head)
    with pytest.raises(fw.InputError, match=re.escape(said)):
        fw.write_report(tmp_path / "r.html", {"points": plate()}, head=head)


def test_a_recipe_keeps_its_head_and_judges_alike(tmp_path):
    path = fw.files.write_recipe(tmp_path / "recipe.toml", recipe(HEAD))
    assert fw.files.read_recipe(path).head == HEAD
    assert recipe_hash(recipe(HEAD)) == recipe_hash(recipe())
    path.write_text(path.read_text("utf-8").replace("customer", "costumer"), "utf-8")
    with pytest.raises(fw.FileProblem, match=r"recipe\.toml: head: expected fields"):
        fw.files.read_recipe(path)


@pytest.mark.parametrize("words", [["serial"], ["serial=1", "--head", "serial=2"], ["seriel=1"]])
def test_faults_of_the_option_are_bad_input(tmp_path, words, capsys):
    fw.write(tmp_path / "p.npz", plate())
    page = tmp_path / "r.html"
    report = ["report", str(tmp_path / "p.npz"), "--out", str(page), "--head"]
    assert run([*report, *words]) == 2
    assert "head" in capsys.readouterr().err
    assert not page.exists()
    assert run([*report, "serial=18"]) == 0
    assert fields_of(page.read_text("utf-8")) == [("serial number", "18")]
