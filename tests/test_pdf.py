"""PDFs: one size of paper, embedded fonts, no line outside its page, no page nearly empty."""

from __future__ import annotations

import re
import zlib

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.report.drawing import Figure
from fringeworks.report.page.blocks import Chapter, Facts, Picture, Table, Text
from fringeworks.report.page.pages import BOTTOM_MM, PAPERS_MM, TOP_MM, Pages, paper_mm
from fringeworks.report.page.pdf import write_pdf
from fringeworks.report.page.typeset import BODY, paragraph, width_mm, wrapped
from fringeworks.report.verdicts import Verdict
from fringeworks.types import made_by

WORDS = "Control limits follow from the differences of neighbouring parts, and hold for them. "


def document(tmp_path, chapters, paper="A4", **more):
    origin = made_by("test", options={})
    return write_pdf(tmp_path / "d.pdf", "Title", chapters, origin, paper=paper, **more)


def streams(path):
    """The contents of a PDF's objects, unpacked."""
    content = path.read_bytes()
    for part in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", content, re.S):
        try:
            yield zlib.decompress(part)
        except zlib.error:
            yield part


def chapters():
    figure = Figure(figsize=(12.0, 7.0), layout="constrained")
    figure.add_subplot().plot([0, 1], [0, 1])
    rows = tuple((f"part {k}", f"{k / 7:.3f} mm", WORDS if k % 9 == 0 else "") for k in range(120))
    return [
        Chapter("One", (Facts((("a name", "a value"), ("long", 30 * WORDS))), Text(20 * WORDS))),
        Chapter("Two", (Table(("part", "value", "why"), rows, "Parts", bad=(3,)),)),
        Chapter("Three", (Picture(figure, "A figure."), Text("$ is no formula"))),
    ]


@pytest.mark.parametrize("paper", list(PAPERS_MM))
def test_all_pages_have_one_size_and_embedded_fonts(tmp_path, paper):
    path = document(tmp_path, chapters(), paper, verdict=Verdict("fail", "FAIL: 1 of 2."))
    content = path.read_bytes()
    sizes = set(re.findall(rb"/MediaBox \[ ([^\]]*) \]", content))
    assert len(sizes) == 1
    width, height = (float(v) for v in sizes.pop().split()[2:])
    assert (width, height) == pytest.approx([v * 72 / 25.4 for v in PAPERS_MM[paper]], abs=0.5)
    assert content.count(b"/Type /Page\n") + content.count(b"/Type /Page ") >= 4
    # TrueType fonts as they are: no Type 3 glyphs, which printers draw coarsely.
    kinds = set(re.findall(rb"/Subtype /(Type\w+|CIDFont\w+|TrueType)", content))
    assert kinds & {b"Type0", b"CIDFontType2", b"Type42"} or b"TrueType" in kinds
    assert b"/Type3" not in content
    assert b"/FontFile2" in content


def test_no_box_leaves_its_page_and_no_page_is_nearly_empty(tmp_path, monkeypatch):
    seen = []

    def write(_self, page, _number):
        seen.append((page[0], page[-1]))

    monkeypatch.setattr(Pages, "_write", write)
    document(tmp_path, chapters())
    room = PAPERS_MM["A4"][1] - TOP_MM - BOTTOM_MM
    filled = [down + box.height for _, (box, down) in seen]
    assert max(filled) <= room + 1e-9
    assert all(share > 0.5 * room for share in filled[:-1])
    assert all(first[1] == 0.0 for first, _ in seen)


def test_lines_fit_their_width_and_long_words_are_divided():
    lines = wrapped(f"{WORDS} {'a5' * 200}", BODY, 60.0)
    assert all(width_mm(line, BODY) <= 60.0 for line in lines)
    assert "".join(lines).replace(" ", "") == (WORDS + "a5" * 200).replace(" ", "")


def test_paragraphs_have_no_widows():
    boxes = paragraph(10 * WORDS, BODY, 100.0)
    kept = [box.keep for box in boxes]
    assert kept[0]
    assert kept[-2]
    assert not kept[-1]


def test_unknown_papers_are_refused():
    with pytest.raises(fw.InputError, match="paper: expected A4 or letter, got 'A3'"):
        paper_mm("A3")
    assert np.allclose(paper_mm("LETTER"), PAPERS_MM["letter"])


def test_figures_spare_a_last_page_of_few_lines(tmp_path, monkeypatch):
    pages = []
    monkeypatch.setattr(Pages, "_write", lambda _self, page, _number: pages.append(page))
    figure = Figure(figsize=(7.0, 6.0))
    lines = Facts(tuple((f"name {k}", "value") for k in range(26)))
    document(tmp_path, [Chapter("Title", (Picture(figure, "A figure."), lines))])
    assert len(pages) == 1
