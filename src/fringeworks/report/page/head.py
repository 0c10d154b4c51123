"""The head of a report, below its verdict: fields, and lines to sign on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from fringeworks.report.page.blocks import Head
from fringeworks.report.page.language import Say
from fringeworks.report.page.typeset import (
    BODY,
    INK,
    LABEL,
    Box,
    Sheet,
    together,
    width_mm,
    wrapped,
)
from fringeworks.types.report_head import ENGLISH, HEAD_FIELDS, checked_head

ROW_MM = 6.0
"""Height of a row of fields, mm: a written line needs 5."""
SIGNED_MM = 11.0
"""Height of a row of signatures, mm."""
GUTTER_MM = 8.0
"""Distance of two fields side by side, mm."""
LINE_MM = 0.15
"""Width of a line to fill in, mm."""


def head_of(given: Mapping[str, str], usual: Sequence[str], *, judged: bool) -> Head | None:
    """Return the head of a report; None where nothing is given and nothing was judged.

    Parameters
    ----------
    given : mapping
        Fields with their texts.
    usual : sequence of str
        Fields that a report with a verdict has in any case, as lines to fill in.
    judged : bool
        Whether the report has a verdict; it is then signed.

    Raises
    ------
    InputError for unknown fields and texts of several lines.
    """
    fields = checked_head(given)
    signed = judged and bool(usual)
    language = fields.pop("language", ENGLISH)
    names = [n for n in HEAD_FIELDS if n in fields or (signed and n in usual)]
    if signed:
        names = [n for n in names if n != "inspector"]
    if not names and language == ENGLISH:
        return None
    rows = tuple((HEAD_FIELDS[n], fields.get(n, "")) for n in names)
    return Head(rows, fields.get("inspector", "") if signed else None, language)


def head_boxes(head: Head | None, width: float, say: Say) -> list[Box]:
    """The head on paper: two fields side by side, then the lines to sign on."""
    if head is None or not head.rows:
        return []
    half = 0.5 * (width - GUTTER_MM)
    name_mm = max(width_mm(name, LABEL) for name, _ in head.rows) + 3.0
    boxes = []
    for k in range(0, len(head.rows), 2):
        cells = [(i * (half + GUTTER_MM), half, name_mm) for i in range(2)]
        boxes.append(_row(list(zip(head.rows[k : k + 2], cells, strict=False)), ROW_MM))
    if head.inspector is not None:
        third = (width - 2 * GUTTER_MM) / 3.0
        for who, name in (("inspected by", head.inspector), ("approved by", "")):
            fields = ((say(who), name), (say("date"), ""), (say("signature"), ""))
            cells = [
                (i * (third + GUTTER_MM), third, width_mm(field[0], LABEL) + 3.0)
                for i, field in enumerate(fields)
            ]
            boxes.append(_row(list(zip(fields, cells, strict=True)), SIGNED_MM))
    first, *others = boxes
    return together([Box(first.height, first.draw, 2.0), *others])


def _row(
    fields: Sequence[tuple[tuple[str, str], tuple[float, float, float]]], height: float
) -> Box:
    """Fields side by side: name and text, with left, width and width of the name, mm."""
    texts = [wrapped(text, BODY, room - first) for (_, text), (_, room, first) in fields]
    lines = max(len(one) for one in texts)
    tall = max(height, lines * BODY.line_mm + 1.5)
    top = tall - lines * BODY.line_mm

    def draw(sheet: Sheet, x: float, y: float) -> None:
        for ((name, _), (left, room, first)), text in zip(fields, texts, strict=True):
            sheet.text(x + left, y + top, name, LABEL)
            for k, line in enumerate(text):
                sheet.text(x + left + first, y + top + k * BODY.line_mm, line, BODY)
            if not any(text):
                below = y + top + BODY.line_mm
                sheet.rule(x + left + first, below, room - first, INK, LINE_MM)

    return Box(tall, draw)
