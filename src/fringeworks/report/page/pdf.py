"""Chapters as a PDF: pages of one size with running text, tables, and figures as vectors."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any

from fringeworks.files.atomic import replacing
from fringeworks.files.provenance import json_line
from fringeworks.report.drawing import Figure, rc_context
from fringeworks.report.page.blocks import (
    Block,
    Chapter,
    Facts,
    Findings,
    Head,
    Origin,
    Picture,
    Surface,
    Table,
    Text,
)
from fringeworks.report.page.head import head_boxes
from fringeworks.report.page.language import Say, spoken
from fringeworks.report.page.pages import Pages, paper_mm
from fringeworks.report.page.set_table import set_table
from fringeworks.report.page.typeset import (
    BODY,
    HEADING,
    LABEL,
    SMALL,
    STRONG,
    TITLE,
    VERDICT,
    Box,
    Sheet,
    has_letters,
    paragraph,
    together,
    width_mm,
    wrapped,
)
from fringeworks.report.verdicts import VERDICT_INK, Verdict
from fringeworks.types import InputError, Provenance, day
from fringeworks.types.report_head import LETTERS

PDF_SETTINGS: Any = {"pdf.fonttype": 42, "pdf.use14corefonts": False}
"""Settings of every PDF: TrueType fonts are embedded (Type 42), as publishers ask for."""
USUAL_PAPER = "A4"
"""Paper of a PDF unless another is asked for."""
GAP_MM = 3.5
"""Distance between blocks, mm."""
CHAPTER_MM = 9.0
"""Distance before the heading of a chapter, mm."""
TALLEST = 0.6
"""Largest height of a picture, share of a page's text: a heading and a caption fit as well."""
PAIRED_IN = 5.6
"""Width of figures, inches, up to which two stand side by side: their text stays above 6 points."""
PAIR_GAP_MM = 6.0
"""Distance of two figures side by side, mm."""
SHRUNK = 0.8
"""Smallest factor by which a figure is laid out anew on less room, where its text keeps its size;
the rest of the way to the width of a page, figure and text are scaled together."""
NAME_MM = 62.0
"""Largest width of the names of facts, mm."""


def write_pdf(
    path: Path,
    title: str,
    chapters: Sequence[Chapter],
    origin: Provenance,
    notes: Sequence[str] = (),
    verdict: Verdict | None = None,
    paper: str = USUAL_PAPER,
    head: Head | None = None,
) -> Path:
    """Write chapters as a PDF, whole or not at all.

    Raises
    ------
    InputError for a language whose letters no installed typeface has.
    """
    check_typeface(head)
    # Dates would make every file differ from the last.
    metadata = {"Title": title, "Subject": json_line(origin), "CreationDate": None}
    with (
        rc_context(PDF_SETTINGS),
        replacing(path) as temporary,
        Pages(temporary, metadata, paper_mm(paper), title) as pages,
    ):
        say = spoken(head)
        writer = _Writer(pages.room_mm, say)
        fields = head_boxes(head, pages.room_mm[0], say)
        top = [*_top(writer, title, origin, notes, verdict), *fields]
        pages.fill(itertools.chain(top, _boxes(writer, title, chapters)))
    return path


def check_typeface(head: Head | None) -> None:
    """Refuse a language whose letters no installed typeface has."""
    code = "" if head is None else head.language
    if code in LETTERS and not has_letters(LETTERS[code]):
        raise InputError(
            f"head: expected a typeface for a PDF in the language {code}, got none: install one "
            "such as Noto Sans CJK, or write the report as a page (.html)"
        )


@dataclass(frozen=True)
class _Writer:
    """Makes boxes of blocks."""

    room: tuple[float, float]
    """Width and height of a page's text, mm."""
    say: Say
    """Gives words in the language of the document."""

    def block(self, block: Block) -> list[Box]:
        """The boxes of a block that is no picture."""
        width = self.room[0]
        if isinstance(block, Facts):
            return self.facts(block.rows)
        if isinstance(block, Origin):
            head = paragraph(self.say("How to compute it again"), STRONG, width, before=GAP_MM)
            first, *others = self.facts(block.rows, small=True)
            return [*together([*head, first]), *others]
        if isinstance(block, Table):
            return set_table(block, width, GAP_MM)
        if isinstance(block, Findings):
            return self.findings(block)
        text = block.text if isinstance(block, Text) else ""
        return paragraph(text, BODY, width, before=GAP_MM)

    def facts(self, rows: Sequence[tuple[str, str]], *, small: bool = False) -> list[Box]:
        """Names and values, a row each."""
        name_kind, kind = (SMALL, SMALL) if small else (LABEL, BODY)
        first = min(max((width_mm(n, name_kind) for n, _ in rows), default=0.0), NAME_MM) + 4.0
        boxes = []
        for k, (name, value) in enumerate(rows):
            names = wrapped(name, name_kind, first - 3.0)
            values = wrapped(value, kind, self.room[0] - first)
            boxes.append(_fact(names, values, first, small, GAP_MM if k == 0 else 0.0))
        return boxes

    def findings(self, block: Findings) -> list[Box]:
        """Findings, with their causes and what to do."""
        boxes: list[Box] = []
        for severity, kind, seen, causes, advice in block.rows:
            head = f"{kind[:1].upper()}{kind[1:]} ({severity}): {seen}"
            lines = paragraph(head, BODY, self.room[0], before=GAP_MM, indent=3.0)
            for name, words in (("Likely cause", causes), ("What to do", advice)):
                text = f"{self.say(name)}: {words}."
                lines += paragraph(text, LABEL, self.room[0], indent=3.0) if words else []
            boxes += together(lines)
        if block.hidden:
            text = f"{block.hidden} more findings are not listed."
            boxes += paragraph(text, BODY, self.room[0], before=GAP_MM)
        return boxes

    def pictures(self, pictures: Sequence[tuple[Figure, str]]) -> list[Box]:
        """Figures with their captions, narrow ones side by side."""
        waiting, boxes = list(pictures), []
        half = 0.5 * (self.room[0] - PAIR_GAP_MM)
        while waiting:
            pair = waiting[:2]
            if len(pair) == 2 and all(f.get_figwidth() <= PAIRED_IN for f, _ in pair):
                boxes.append(_beside([self.picture(f, text, half) for f, text in pair], half))
                waiting = waiting[2:]
                continue
            figure, text = waiting.pop(0)
            narrow = figure.get_figwidth() <= PAIRED_IN
            boxes.append(self.picture(figure, text, half if narrow else self.room[0]))
        return boxes

    def picture(self, figure: Figure, text: str, room: float) -> Box:
        """A figure of a width, no higher than a page allows, and its caption."""
        across = 25.4 * figure.get_figwidth()
        shrunk = min(max(room / across, SHRUNK), 1.0)
        figure.set_size_inches(*(shrunk * figure.get_size_inches()))
        across, tall = (25.4 * float(v) for v in figure.get_size_inches())
        width = min(room, across)
        height = width * tall / across
        if height > TALLEST * self.room[1]:
            width *= TALLEST * self.room[1] / height
            height = TALLEST * self.room[1]
        return self.placed(figure, text, room, (width, height))

    def placed(self, figure: Figure, text: str, room: float, size: tuple[float, float]) -> Box:
        """A figure of a size, and its caption."""
        width, height = size
        caption = paragraph(text, SMALL, room, before=1.0) if text else []
        below = sum(box.height for box in caption) + (1.0 if caption else 0.0)

        def draw(sheet: Sheet, x: float, y: float) -> None:
            sheet.placed.append((figure, x, y, width))
            down = y + height + 1.0
            for box in caption:
                box.draw(sheet, x, down)
                down += box.height

        def squeeze(factor: float) -> Box:
            return self.placed(figure, text, room, (factor * width, factor * height))

        return Box(height + below, draw, GAP_MM, squeeze=squeeze)


def _fact(names: list[str], values: list[str], first: float, small: bool, before: float) -> Box:
    """A name with its value behind it."""
    name_kind, kind = (SMALL, SMALL) if small else (LABEL, BODY)

    def draw(sheet: Sheet, x: float, y: float) -> None:
        for k, line in enumerate(names):
            sheet.text(x, y + k * kind.line_mm, line, name_kind)
        for k, line in enumerate(values):
            sheet.text(x + first, y + k * kind.line_mm, line, kind)

    return Box(max(len(names), len(values)) * kind.line_mm, draw, before)


def _beside(boxes: Sequence[Box], width: float) -> Box:
    """Boxes side by side."""

    def draw(sheet: Sheet, x: float, y: float) -> None:
        for k, box in enumerate(boxes):
            box.draw(sheet, x + k * (width + PAIR_GAP_MM), y)

    def squeeze(factor: float) -> Box:
        return _beside([b.squeeze(factor) if b.squeeze else b for b in boxes], width)

    return Box(max(box.height for box in boxes), draw, GAP_MM, squeeze=squeeze)


def _top(
    writer: _Writer, title: str, origin: Provenance, notes: Sequence[str], verdict: Verdict | None
) -> list[Box]:
    """Title, date, verdict and notes."""
    width = writer.room[0]
    head = paragraph(title, TITLE, width)
    head += paragraph(f"fringeworks {origin.version}, {day(origin.date)}", LABEL, width, before=1.0)
    if verdict is not None:
        head.append(_plate(verdict))
    for note in notes:
        head += paragraph(note, BODY, width, before=1.5)
    return together(head)


def _boxes(writer: _Writer, title: str, chapters: Sequence[Chapter]) -> Iterator[Box]:
    """The chapters."""
    width = writer.room[0]
    for chapter in chapters:
        if len(chapters) > 1 or chapter.title != title:
            heading = paragraph(chapter.title, HEADING, width, before=CHAPTER_MM)
            line = Box(0.8, lambda sheet, x, y: sheet.rule(x, y, width))
            yield from (replace(box, keep=True) for box in (*heading, line))
        yield from _chapter(writer, chapter)


def _chapter(writer: _Writer, chapter: Chapter) -> Iterator[Box]:
    drawn = (Picture, Surface)
    for pictures, group in groupby(chapter.blocks, lambda block: isinstance(block, drawn)):
        if not pictures:
            for block in group:
                yield from writer.block(block)
            continue
        yield from writer.pictures(
            [
                (block.figure if isinstance(block, Picture) else block.draw(), block.caption)
                for block in group
                if isinstance(block, drawn)
            ]
        )


def _plate(verdict: Verdict) -> Box:
    """The verdict in white on its colour."""
    kind = replace(VERDICT, colour="#ffffff")
    room = 1.6
    height = kind.line_mm + 2 * room

    def draw(sheet: Sheet, x: float, y: float) -> None:
        width = width_mm(verdict.text, kind) + 4 * room
        sheet.plate(x, y, width, height, VERDICT_INK[verdict.kind])
        sheet.text(x + 2 * room, y + room, verdict.text, kind)

    return Box(height, draw, GAP_MM)
