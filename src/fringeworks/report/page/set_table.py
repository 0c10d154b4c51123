"""Tables of a PDF: columns as wide as their content needs, rows that are not divided."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from fringeworks.report.page.blocks import Table
from fringeworks.report.page.typeset import LABEL, RULE, SMALL, Box, Draw, Type, width_mm, wrapped
from fringeworks.report.verdicts import VERDICT_INK

GUTTER_MM = 2.6
"""Distance between columns, mm."""
ROOM_MM = 0.7
"""Room above and below the text of a row, mm."""
SIZES = (8.0, 7.0, 6.0, 5.0)
"""Sizes of type that are tried until the longest words of all columns fit, points."""
SHORT_CELL = 18
"""Letters of a cell up to which it stays on one line: a number with its unit, a
date with its time, an index with its interval."""
TEXT_MM = 34.0
"""Least width of columns of sentences, mm: four words on a line; the type becomes smaller first."""
SHORT_TABLE = 8
"""Rows of a table up to which it is not divided: a quarter of a page."""
MOST_CELL_LINES = 40
"""Lines of a cell that are shown; a page holds more, and no table of a report needs them."""


def set_table(table: Table, room: float, before: float) -> list[Box]:
    """Lay out a table; its head is repeated on every page."""
    rows = [table.columns, *table.rows]
    kind, widths = _fitted(rows, room)
    head_kind = replace(kind, bold=True)
    caption = [
        Box(SMALL.line_mm + 0.8, lambda s, x, y: s.text(x, y, table.caption, LABEL), before, True)
    ]
    head = _row(table.columns, head_kind, widths, room, colour="#000000")
    boxes = []
    for k, cells in enumerate(table.rows):
        ink = VERDICT_INK["fail"] if k in table.bad else None
        ink = VERDICT_INK["undecided"] if k in table.doubtful else ink
        row = _row(cells, replace(kind, colour=ink or kind.colour), widths, room)
        # Short tables stay together; of long ones, no row stands alone.
        keep = k < len(table.rows) - 1 if len(table.rows) <= SHORT_TABLE else k == len(rows) - 3
        boxes.append(replace(row, head=head, keep=keep))
    first = replace(head, keep=True, before=0.0 if table.caption else before)
    return [*(caption if table.caption else []), first, *boxes]


def _fitted(rows: Sequence[Sequence[str]], room: float) -> tuple[Type, list[float]]:
    """The size of type, and the width of each column, mm."""
    count = len(rows[0])
    free = room - GUTTER_MM * (count - 1)
    for points in SIZES:
        kind, bold = Type(points), Type(points, bold=True)
        kinds = [bold, *[kind] * (len(rows) - 1)]
        short = [0, *[SHORT_CELL] * (len(rows) - 1)]
        need, want = [0.0] * count, [0.0] * count
        for used, most, cells in zip(kinds, short, rows, strict=True):
            for k, cell in enumerate(cells):
                want[k] = max(want[k], width_mm(cell, used))
                words = [cell] if len(cell) <= most else cell.split(" ")
                # Heads wrap at every word; sentences have some words on a line.
                text = min(width_mm(cell, used), TEXT_MM) if len(cell) > most > 0 else 0.0
                need[k] = max(need[k], text, *(width_mm(word, used) for word in words))
        if sum(want) <= free:
            return kind, want
        if sum(need) <= free or points == SIZES[-1]:
            break
    if sum(need) > free:
        return kind, [free * n / sum(need) for n in need]
    spare = (free - sum(need)) / sum(w - n for w, n in zip(want, need, strict=True))
    return kind, [n + spare * (w - n) for w, n in zip(want, need, strict=True)]


def _row(
    cells: Sequence[str], kind: Type, widths: Sequence[float], room: float, colour: str = RULE
) -> Box:
    """A row with a line below it."""
    # A tenth of a millimetre more: sums of widths are rounded.
    lines = [
        wrapped(cell, kind, width + 0.1)[:MOST_CELL_LINES]
        for cell, width in zip(cells, widths, strict=True)
    ]
    height = max(map(len, lines)) * kind.line_mm + 2 * ROOM_MM
    return Box(height, _drawn(lines, kind, widths, (room, height, colour)))


def _drawn(
    lines: list[list[str]], kind: Type, widths: Sequence[float], frame: tuple[float, float, str]
) -> Draw:
    room, height, colour = frame

    def draw(sheet, x: float, y: float) -> None:  # type: ignore[no-untyped-def]
        left = x
        for column, width in zip(lines, widths, strict=True):
            for k, line in enumerate(column):
                sheet.text(left, y + ROOM_MM + k * kind.line_mm, line, kind)
            left += width + GUTTER_MM
        sheet.rule(x, y + height, room, colour)

    return draw
