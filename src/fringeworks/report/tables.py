"""Tables of results as text, CSV, JSON, Markdown and LaTeX."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from typing import Any, Literal

from fringeworks.files.figures import to_json
from fringeworks.types.numbers import number

TableFormat = Literal["text", "csv", "json", "markdown", "latex"]
Row = dict[str, Any]


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return number(value)
    return str(value)


def format_table(rows: Sequence[Row], style: TableFormat = "text") -> str:
    """A comparison table as aligned text, CSV, JSON, Markdown or LaTeX."""
    if style == "json":
        return to_json(list(rows))
    columns = list(rows[0]) if rows else []
    if style == "csv":
        buffer = io.StringIO()
        writer = csv.DictWriter(buffer, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        return buffer.getvalue()
    body = [[_cell(row[c]) for c in columns] for row in rows]
    if style == "markdown":
        lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
        lines += ["| " + " | ".join(cells) + " |" for cells in body]
        return "\n".join(lines) + "\n"
    if style == "latex":
        return _latex(columns, body)
    return _aligned([columns, *body])


def _latex(columns: Sequence[str], body: Sequence[Sequence[str]]) -> str:
    """A ``tabular`` without packages; names to the left, numbers to the right."""

    def line(cells: Sequence[str]) -> str:
        plain = (cell.replace("_", r"\_").replace("%", r"\%") for cell in cells)
        return " & ".join(cell.replace("−", "$-$").replace("–", "--") for cell in plain) + r" \\"

    # Letters first: a column of names. The others hold numbers.
    ways = "".join(
        "l" if any(row[k][:1].isalpha() for row in body) else "r" for k in range(len(columns))
    )
    head = line([name.replace("_", " ") for name in columns])
    rows = [line(row) for row in body]
    lines = [rf"\begin{{tabular}}{{{ways}}}", r"\hline", head, r"\hline", *rows, r"\hline"]
    return "\n".join([*lines, r"\end{tabular}"]) + "\n"


def _aligned(table: Iterable[Sequence[str]]) -> str:
    rows = [list(row) for row in table]
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))] if rows[0] else []
    return "".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        + "\n"
        for row in rows
    )
