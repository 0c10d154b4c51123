"""What is shown of figures that were read from a file, and of the rows of a table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fringeworks.report.kind import Kind, describe
from fringeworks.report.page.blocks import Chapter
from fringeworks.report.page.chapter import Context, figure_blocks
from fringeworks.report.page.parts import figure_tables, limited_table, provenance_block
from fringeworks.types import InputError, provenance_from


def table_chapter(rows: list[Any], context: Context) -> Chapter:
    """The rows of a table."""
    if not all(isinstance(row, dict) for row in rows) or not rows:
        raise InputError("report: expected the rows of a table, got a list of something else")
    return Chapter(context.name, limited_table(rows, "Comparison"))


def figures_chapter(figures: dict[str, Any], context: Context) -> Chapter:
    """Figures that a command wrote with ``--json``."""
    origin = figures.get("provenance")
    known = provenance_from(origin) if isinstance(origin, Mapping) else None
    return Chapter(
        context.name,
        (
            *figure_blocks(figures, context),
            *figure_tables(figures),
            *provenance_block(known),
        ),
    )


describe(list, Kind(chapter=table_chapter))
describe(dict, Kind(chapter=figures_chapter))
