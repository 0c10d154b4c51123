"""How steps tell results: verdict, tables, lines, findings, charts, and the report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from urllib.parse import quote

from nicegui import ui

from fringeworks.studio.steps.parts import Step, plot, show_findings

STATES = {
    "pass": "fw-good",
    "holds": "fw-good",
    "fail": "fw-bad",
    "has moved": "fw-bad",
    "undecided": "fw-warn",
    "suspect": "fw-warn",
}
"""Classes of verdicts; the word always stands there."""


def tell(step: Step, result: dict[str, Any]) -> None:
    """Show a result as ``studio.told`` describes it."""
    if result["verdict"]:
        verdict = ui.label(result["verdict"]).classes("fw-h2").props('role="status"')
        verdict.classes(STATES.get(result["verdict"], ""))
    for part in result["said"]:
        if "line" in part:
            ui.label(part["line"]).classes("fw-lines")
        else:
            table(part["columns"], part["rows"])
    show_findings(result)
    report_link(result.get("report", ""))
    show_charts(step, result["charts"])


def show_charts(step: Step, charts: Sequence[dict[str, str]]) -> None:
    """Show charts with their captions."""
    for chart in charts:
        plot(step, chart["file"], chart["caption"])


def report_link(name: str) -> None:
    """Links to a report: to read it, and to save it."""
    if not name:
        return
    with ui.row():
        ui.link(f"Open the report {name}", f"/report/{quote(name)}", new_tab=True)
        ui.link("Save it", f"/file/{quote(name)}")


def table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table; narrow pages scroll it."""
    box = ui.element("div").classes("fw-scroll").props('tabindex=0 role="region"')
    box.props["aria-label"] = ", ".join(filter(None, columns))
    with box, ui.element("table").classes("fw-table"):
        with ui.element("thead"):
            _row("th", columns)
        with ui.element("tbody"):
            for row in rows:
                _row("td", row)


def _row(kind: str, texts: Sequence[str]) -> None:
    with ui.element("tr"):
        for text in texts:
            # Screen readers report an empty heading as an error.
            with ui.element(kind if text else "td"):
                ui.label(text)
