"""Batch: many parts by one recipe, with a table, control charts and a report of each part."""

from __future__ import annotations

import json
from typing import Any

from nicegui import ui

from fringeworks.studio.places import Place
from fringeworks.studio.steps.parts import SHOWN_S, Step, empty, heading, place_link, work
from fringeworks.studio.steps.telling import report_link, show_charts

HERE = "."
"""The studio's folder itself."""
VERDICTS = {name: name or "Any verdict" for name in ("", "pass", "fail", "undecided")} | {
    "not measured": "not measured"
}
"""Verdicts that can be asked for."""


def build(step: Step) -> None:
    """Build the step."""
    _Batch(step)


class _Batch:
    """What is judged by what, and what came of it."""

    def __init__(self, step: Step) -> None:
        self._step, self._studio = step, step.studio
        space = self._studio.workspace
        folders, recipes = space.folders_of_captures(), space.of_kind("recipe")
        if not folders:
            empty("There is no capture in this folder yet: scan parts, one capture each.")
        elif not recipes:
            empty(
                "There is no recipe yet: open one part in Look, draw areas on it and add "
                "tolerances. All parts are then judged by them."
            )
            place_link("Look at a part", Place("look", space.captures()[0]))
        else:
            self._controls(folders, recipes)
        work(step, ("batch",), lambda _: self._judged())
        self._found()

    def _controls(self, folders: list[str], recipes: list[str]) -> None:
        named = {name: "this folder" if name == HERE else name for name in folders}
        with ui.row().classes("fw-fields"):
            self._folder = ui.select(named, value=folders[0], label="Captures of")
            self._recipe = ui.select(recipes, value=recipes[0], label="Recipe")
            for field in (self._folder, self._recipe):
                field.classes("fw-wide")
            free = self._studio.workspace.free("batch", "")
            self._name = ui.input("Name of the results", value=free).classes("fw-field")
            self._resume = ui.checkbox("Resume an interrupted batch")
            run = self._step.attempt(self._run)
            ui.button("Judge the parts", on_click=run).props("no-caps")
        self._sizes()
        self._folder.on_value_change(lambda: self._sizes.refresh())

    @ui.refreshable_method
    def _sizes(self) -> None:
        """How many parts there are, and by what they are judged."""
        inside = "" if self._folder.value == HERE else str(self._folder.value)
        captures = self._studio.workspace.captures()
        count = sum(name.rpartition("/")[0] == inside for name in captures)
        one = "1 capture" if count == 1 else f"{count} captures"
        ui.label(f"{one}. Each gets a verdict by all tolerances of the recipe.").classes("fw-quiet")

    def _run(self) -> None:
        self._studio.run_batch(
            self._step.session,
            str(self._folder.value),
            str(self._recipe.value),
            str(self._name.value or ""),
            resume=bool(self._resume.value),
        )

    def _judged(self) -> None:
        self._name.set_value(self._studio.workspace.free("batch", ""))
        self._found.refresh()

    @ui.refreshable_method
    def _found(self) -> None:
        result = self._studio.batch
        if result:
            _Result(self._step, result)
            return
        known = self._studio.workspace.reports()
        if known:
            heading("Reports in this folder")
            for name in known:
                report_link(name)


class _Result:
    """The counts, the table of parts, the charts and the report of a batch."""

    def __init__(self, step: Step, result: dict[str, Any]) -> None:
        self._result = result
        heading(result["name"])
        counts = [f"{count} {kind}" for kind, count in result["counts"].items() if count]
        ui.label(", ".join(counts)).classes("fw-h2").props('role="status"')
        report_link(result["report"])
        if result["passed over"]:
            ui.label(f"No capture: {', '.join(result['passed over'])}").classes("fw-quiet")
        with ui.row().classes("fw-fields"):
            self._text = ui.input("Search", on_change=self._draw).classes("fw-field")
            self._verdict = ui.select(VERDICTS, value="", label="Verdict", on_change=self._draw)
            self._verdict.classes("fw-field")
        self._table = ui.element("div").classes("fw-scroll").props('tabindex=0 role="region"')
        self._table.props["aria-label"] = "Parts"
        ui.timer(SHOWN_S, self._draw, once=True)
        if result["more"]:
            ui.label(f"… and {result['more']} more parts: the report has them.")
        show_charts(step, result["charts"])

    def _draw(self) -> None:
        rows = json.dumps([self._result["columns"], self._result["rows"]])
        asked = json.dumps(
            {"text": str(self._text.value or ""), "verdict": str(self._verdict.value or "")}
        )
        ui.run_javascript(
            f"import('/parts.js').then(({{ show }}) => "
            f"show({json.dumps(self._table.html_id)}, ...{rows}, {asked}))"
        )
