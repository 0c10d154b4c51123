"""Tables of results as text, CSV, JSON and Markdown."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Sequence
from typing import Any, Literal

import numpy as np

from fringeworks.types import InputError

TableFormat = Literal["text", "csv", "json", "markdown"]
Row = dict[str, Any]


def to_json(content: Any) -> str:
    """The JSON text of results. NaN, which JSON does not have, becomes null."""

    def clean(value: Any) -> Any:
        if isinstance(value, dict):
            return {k: clean(v) for k, v in value.items()}
        if isinstance(value, (list, tuple)):
            return [clean(v) for v in value]
        if isinstance(value, np.ndarray | np.generic):
            return clean(value.tolist())
        return None if isinstance(value, float) and not np.isfinite(value) else value

    try:
        return json.dumps(clean(content), indent=2, allow_nan=False) + "\n"
    except (TypeError, ValueError) as error:
        raise InputError(
            f"content: expected numbers, text, lists and dictionaries, got others: {error}"
        ) from error


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return "–" if np.isnan(value) else f"{value:.4g}"
    return str(value)


def format_table(rows: Sequence[Row], style: TableFormat = "text") -> str:
    """A comparison table as aligned text, CSV, JSON or Markdown."""
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
    return _aligned([columns, *body])


def _aligned(table: Iterable[Sequence[str]]) -> str:
    rows = [list(row) for row in table]
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))] if rows[0] else []
    return "".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        + "\n"
        for row in rows
    )
