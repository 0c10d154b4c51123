"""The report of a batch: control charts, counts, and the scans that need a look."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fringeworks.batch.run import BatchResult
from fringeworks.files.atomic import StrPath
from fringeworks.report.control_chart import control_chart
from fringeworks.report.drawing import need_plots
from fringeworks.report.page.blocks import Block, Chapter, Picture, Text
from fringeworks.report.page.parts import dict_table
from fringeworks.report.page.report import write_page
from fringeworks.types import FloatMap, PartTolerance, made_by

MOST_LISTED = 200
"""Scans that are listed; the summary has all."""


def write_batch_report(path: StrPath, result: BatchResult, *, title: str = "") -> Path:
    """Write the report of a batch.

    Parameters
    ----------
    path : path
        ``.html`` or ``.pdf``.
    result : BatchResult
    title : str
        By default the name of the results.

    Returns
    -------
    The path.

    Raises
    ------
    FileProblem for another suffix, or a folder that cannot be written to.
    """
    need_plots("a report")
    origin = made_by("write_batch_report", options={"results": str(result.folder)})
    title = title or result.folder.stem
    chapters = [
        _counts(result),
        *(_chart(result, one) for one in result.tolerances),
        *_look(result),
    ]
    return write_page(path, title, chapters, origin)


def _counts(result: BatchResult) -> Chapter:
    rows = [{"scans": len(result.rows), "not measured": result.failed}]
    rows[0] |= {verdict: result.count(verdict) for verdict in ("pass", "fail", "undecided")}
    shares = _column(result, "valid_share")
    picture = control_chart(
        "share of pixels with a value",
        shares,
        np.zeros_like(shares),
        _verdicts(result),
        (None, None),
    )
    blocks: tuple[Block, ...] = (
        dict_table(rows, "Parts by verdict"),
        Picture(picture, "How much of each part was measured."),
    )
    return Chapter("Parts", blocks)


def _chart(result: BatchResult, one: PartTolerance) -> Chapter:
    """The control chart of a tolerance."""
    verdicts = [str(row.get(f"{one.name} verdict", "")) for row in result.rows]
    sigma = np.nan_to_num(_column(result, f"{one.name} σ"))
    figure = control_chart(
        f"{one.name}: {one.quantity.replace('_', ' ')}",
        _column(result, one.name),
        sigma,
        verdicts,
        (one.low, one.high),
    )
    text = (
        "Bars are two standard deviations of a value. Control limits follow from the differences "
        "of neighbouring parts: values beyond them are no chance, whether or not they keep the "
        "tolerance."
    )
    return Chapter(one.name, (Picture(figure, text),))


def _look(result: BatchResult) -> list[Chapter]:
    """Scans that failed, are undecided, or were not measured."""
    rows = [
        {"scan": row["scan"], "verdict": row.get("verdict", ""), "why": row.get("error", "")}
        for row in result.rows
        if row.get("error") or row.get("verdict") != "pass"
    ]
    if not rows:
        return []
    blocks: list[Block] = [dict_table(rows[:MOST_LISTED], "Parts that did not pass")]
    if len(rows) > MOST_LISTED:
        blocks.append(Text(f"… and {len(rows) - MOST_LISTED} more: see {result.summary.name}."))
    return [Chapter("Look at these", tuple(blocks))]


def _verdicts(result: BatchResult) -> list[str]:
    return [str(row.get("verdict", "")) for row in result.rows]


def _column(result: BatchResult, name: str) -> FloatMap:
    def number(value: Any) -> float:
        return np.nan if value is None or value == "" else float(value)

    return np.array([number(row.get(name)) for row in result.rows])
