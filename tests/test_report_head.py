"""The head of a report: for whom, of which part, and who signs."""

from __future__ import annotations

import re

import pytest

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.evaluate.inspect import recipe_hash
from tests.inspected import plate
from tests.inspected import share_recipe as recipe

HEAD = {"customer": "Müller & Söhne", "part_number": "4711", "revision": "C"}


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


@pytest.mark.parametrize(
    ("fields", "title", "said"),
    [
        ({}, "", "capture-3"),
        ({"part": "Bracket"}, "", "Bracket: capture-3"),
        ({"part": "Bracket", "part_number": "7", "serial": "18"}, "", "Bracket, no. 18"),
        ({"part_number": "4711"}, "", "4711: capture-3"),
        ({"part": "Bracket", "serial": "18"}, "Mine", "Mine"),
    ],
)
def test_a_report_is_titled_by_its_part(tmp_path, fields, title, said):
    found = fw.inspect(plate(), recipe(fields))
    fw.write_report(tmp_path / "r.html", {"capture-3": found}, title=title)
    page = (tmp_path / "r.html").read_text("utf-8")
    assert f"<h1>{said}</h1>" in page
    fw.write_report(tmp_path / "r.html", {"one": found, "two": found}, title=title)
    assert "<h1>one</h1>" in (tmp_path / "r.html").read_text("utf-8") or title


def test_a_head_above_its_table_is_refused_with_a_hint(tmp_path):
    (tmp_path / "recipe.toml").write_text('kind = "recipe"\npart = "Bracket"\n', "utf-8")
    with pytest.raises(fw.FileProblem, match=r"unknown key part: .* below \[head\]"):
        fw.files.read_recipe(tmp_path / "recipe.toml")


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
