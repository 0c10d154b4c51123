"""Reports in other languages: every word of the table, and what stays as people wrote it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import fringeworks as fw
from fringeworks.evaluate.tolerances.measure import VALUES
from fringeworks.report.page import typeset
from fringeworks.report.page.language import PLACE, TABLE, language
from fringeworks.report.page.report import __file__ as beside
from fringeworks.report.verdicts import verdict_of
from fringeworks.types.report_head import LANGUAGES
from tests.inspected import plate
from tests.inspected import share_recipe as recipe

ISO_1101 = [one.removeprefix("iso_") for one in VALUES]


def table():
    """Rows of the table of words."""
    lines = (Path(beside).parent / TABLE).read_text("utf-8").splitlines()
    return [line.split("\t") for line in lines]


def test_every_word_is_there_once_in_all_languages():
    head, *rows = table()
    assert ["en", *head[1:]] == list(LANGUAGES)
    assert len({row[0] for row in rows}) == len(rows)
    for row in rows:
        assert len(row) == len(LANGUAGES)
        assert all(row)
        places = {found[1] for found in PLACE.finditer(row[0])}
        for said in row[1:]:
            assert {found[1] for found in PLACE.finditer(said)} == places, row[0]


@pytest.mark.parametrize("code", LANGUAGES[1:])
def test_characteristics_of_iso_1101_have_their_words(code):
    say = language(code).say
    for name in ISO_1101:
        english = f"ISO 1101 {name.replace('_', ' ')}: top to A | B"
        said = say(english)
        assert name.replace("_", " ") not in said or code == "de", said
        assert said != english
        assert "A | B" in said
        assert "{" not in said


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("kinds", [("pass", "pass"), ("fail", "pass"), ("undecided", "fail")])
def test_verdicts_are_sentences_of_the_table(count, kinds):
    verdict = verdict_of([kinds[0], *[kinds[1]] * (count - 1), "pass"])
    for code in LANGUAGES[1:]:
        said = language(code).say(verdict.text)
        assert said != verdict.text
        assert not re.search(r"PASS|FAIL:|tolerance", said)


def test_what_the_table_does_not_have_stays_as_it_is():
    for code in LANGUAGES:
        assert language(code).say("a bracket of mine") == "a bracket of mine"
    assert language("en").say("pass") == "pass"


def test_a_page_is_in_the_language_of_its_head(tmp_path):
    found = fw.inspect(plate(), recipe({"customer": "Part", "language": "de"}))
    fw.write_report(tmp_path / "de.html", {"part": found})
    page = (tmp_path / "de.html").read_text("utf-8")
    assert '<html lang="de">' in page
    for said in ("Toleranzen", "Entscheidung", "Kunde", "geprüft von", "Unterschrift"):
        assert f">{said}<" in page
    assert "<dd>Part</dd>" in page, "what people wrote is not translated"
    fw.write_report(tmp_path / "ja.html", {"part": found}, head={"language": "ja"})
    assert "判定" in (tmp_path / "ja.html").read_text("utf-8")


def test_a_pdf_without_a_typeface_for_its_letters_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(typeset, "typefaces", lambda: (typeset.FAMILY,))
    with pytest.raises(fw.InputError, match="typeface for a PDF in the language zh"):
        fw.write_report(tmp_path / "r.pdf", {"points": plate()}, head={"language": "zh"})
    assert not (tmp_path / "r.pdf").exists()
    fw.write_report(tmp_path / "r.pdf", {"points": plate()}, head={"language": "de"})


def test_unknown_languages_are_refused():
    with pytest.raises(fw.InputError, match="head: expected a language of en, de, zh, ja"):
        recipe({"language": "fr"})
