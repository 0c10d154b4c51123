"""Chapters as a PDF: figures as vectors, tables as text, surfaces as their maps."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fringeworks.files.atomic import replacing
from fringeworks.files.provenance import json_line
from fringeworks.report.drawing import Figure
from fringeworks.report.page.blocks import (
    Block,
    Chapter,
    Facts,
    Findings,
    Origin,
    Picture,
    Surface,
    Table,
)
from fringeworks.types import Provenance

PAPER_IN = (8.27, 11.69)
"""A4, inches."""
LINES = 74
"""Lines of text of a page."""
LETTERS = 96
"""Letters of a line: 8 pt Courier fits so many between the margins of A4."""
MARGIN = 0.08
"""Left margin, share of the page's width."""


def write_pdf(
    path: Path,
    title: str,
    chapters: Sequence[Chapter],
    origin: Provenance,
    notes: Sequence[str] = (),
) -> Path:
    """Write chapters as a PDF, whole or not at all."""
    from matplotlib.backends.backend_pdf import PdfPages

    # Dates would make every file differ from the last.
    metadata = {"Title": title, "Subject": json_line(origin), "CreationDate": None}
    with replacing(path) as temporary, PdfPages(temporary, metadata=metadata) as pdf:
        lines = [title, "", f"fringeworks {origin.version}, {origin.date}", "", *notes]
        for chapter in chapters:
            lines += ["", chapter.title.upper(), ""]
            for block in chapter.blocks:
                if isinstance(block, Picture | Surface):
                    lines = _flush(pdf, lines)
                    _add(pdf, block.figure if isinstance(block, Picture) else block.draw())
                else:
                    lines += ["", *_text(block)]
            lines = _flush(pdf, lines)
    return path


def _flush(pdf: Any, lines: list[str]) -> list[str]:
    """Write lines on as many pages as they need."""
    wrapped = [part for line in lines for part in textwrap.wrap(line, LETTERS) or [""]]
    while wrapped and not wrapped[0].strip():
        wrapped.pop(0)
    for start in range(0, len(wrapped), LINES):
        page = Figure(figsize=PAPER_IN)
        text = "\n".join(wrapped[start : start + LINES])
        # A dollar sign would begin a formula.
        page.text(MARGIN, 0.95, text, family="monospace", size=8, va="top", parse_math=False)
        _add(pdf, page)
    return []


def _add(pdf: Any, figure: Figure) -> None:
    pdf.savefig(figure)


def _text(block: Block) -> list[str]:
    """A block as lines."""
    if isinstance(block, Facts | Origin):
        width = max((len(name) for name, _ in block.rows), default=0)
        return [f"{name.ljust(width)}  {value}" for name, value in block.rows]
    if isinstance(block, Table):
        return [block.caption, *_aligned([block.columns, *block.rows])]
    if isinstance(block, Findings):
        lines = []
        for severity, kind, seen, causes, advice in block.rows:
            lines.append(f"- {kind} ({severity}): {seen}")
            lines += [f"  likely cause: {causes}"] if causes else []
            lines += [f"  what to do: {advice}"] if advice else []
        more = [f"{block.hidden} more findings are not listed."] if block.hidden else []
        return lines + more
    return [getattr(block, "text", "")]


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Rows with columns of equal width; the last column wraps."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    used = sum(widths[:-1]) + 2 * (len(widths) - 1)
    room = max(LETTERS - used, 20)
    lines = []
    for row in rows:
        start = "  ".join(cell.ljust(w) for cell, w in zip(row[:-1], widths[:-1], strict=True))
        parts = textwrap.wrap(row[-1], room) or [""]
        lines.append(f"{start}  {parts[0]}" if start else parts[0])
        lines += [" " * (used) + part for part in parts[1:]]
    return lines
