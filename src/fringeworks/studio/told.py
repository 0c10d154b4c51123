"""A result as the page shows it: its verdict, tables, lines, findings and charts, as plain data."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from fringeworks.files.findings import findings_as_dicts
from fringeworks.report.drawing import Figure, Line2D, rc_context
from fringeworks.report.figures import save_figure
from fringeworks.report.kind import Rows, words_of
from fringeworks.report.page.blocks import Picture
from fringeworks.report.page.chapter import Context, chapter_of
from fringeworks.report.summary import summarise
from fringeworks.studio.plots import DARK, DARK_FOLDER
from fringeworks.types import Finding

CHARTS = ".charts"
"""Folder of the charts of results; a dot hides it from lists."""


def told(result: Any, root: Path, name: str) -> dict[str, Any]:
    """Return what a command prints of a result, and draw the charts of its report.

    Parameters
    ----------
    result : any result of fringeworks
    root : Path
        The studio's folder.
    name : str
        Name of the files of its charts.
    """
    figures = summarise(result)
    said: list[dict[str, Any]] = []
    findings: list[Finding] = []
    for word in words_of(result, figures):
        if isinstance(word, Finding):
            findings.append(word)
        elif isinstance(word, Rows):
            rows = [list(map(str, row)) for row in word.rows]
            said.append({"columns": list(word.columns), "rows": rows})
        elif word and word != figures.get("verdict"):
            said.append({"line": word})
    return {
        "verdict": str(figures.get("verdict", "")),
        "said": said,
        "findings": findings_as_dicts(findings),
        "charts": draw_charts(lambda: _pictures(result), root, name),
    }


def _pictures(result: Any) -> list[Picture]:
    """The pictures of a result's report."""
    blocks = chapter_of(result, Context("")).blocks
    return [block for block in blocks if isinstance(block, Picture)]


def draw_charts(
    make: Callable[[], Sequence[Picture]], root: Path, name: str
) -> list[dict[str, str]]:
    """Draw pictures for light pages and for dark ones; their files and captions."""
    light, dark = root / CHARTS, root / DARK_FOLDER / CHARTS
    for folder in (light, dark):
        folder.mkdir(parents=True, exist_ok=True)
    shown = []
    for k, picture in enumerate(make()):
        file = f"{name}-{k + 1}.png"
        save_figure(picture.figure, light / file)
        shown.append({"file": f"{CHARTS}/{file}", "caption": picture.caption})
    with rc_context(DARK):
        for k, picture in enumerate(make()):
            save_figure(_paled(picture.figure), dark / f"{name}-{k + 1}.png")
    return shown


def _paled(figure: Figure) -> Figure:
    """A figure whose black lines are seen on dark pages, and whose grid does not dazzle there."""
    ink, grid = DARK["text.color"], DARK["grid.color"]
    for axes in figure.axes:
        for line in (*axes.get_xgridlines(), *axes.get_ygridlines()):
            line.set_color(grid)
    for line in figure.findobj(Line2D):
        if line.get_color() == "black":
            line.set_color(ink)
    return figure
