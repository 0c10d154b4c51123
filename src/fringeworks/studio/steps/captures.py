"""Captures: all captures and results of the folder, to find, look at, rename and delete."""

from __future__ import annotations

import json
from collections import Counter
from functools import partial
from typing import Any
from urllib.parse import quote

from nicegui import ui

from fringeworks.serving.worker import Job
from fringeworks.studio.notes import Note
from fringeworks.studio.steps.parts import Step, empty, say, work
from fringeworks.types import InputError

VERDICTS = {"": "Any verdict", "pass": "pass", "fail": "fail", "undecided": "undecided"}
"""Verdicts that can be asked for."""
MOST_SAID = 10
"""Parts that could not be judged of which the page says why."""
KEYS = "↑ ↓ choose · Enter looks · F2 renames · Delete deletes (Undo brings it back)"
"""What the keys do in the list."""


def build(step: Step) -> None:
    """Build the step."""
    _Captures(step)


class _Captures:
    """The list, what is asked of it, and what is done with the one that is chosen."""

    def __init__(self, step: Step) -> None:
        self._step, self._studio = step, step.studio
        self._chosen: str | None = None
        rows = self._rows()
        if not rows:
            empty("There is no capture in this folder yet: scan a part, or try a virtual one.")
            return
        codes = sorted({code for row in rows for code in row["findings"]})
        with ui.row().classes("fw-fields"):
            self._text = ui.input("Search", on_change=self._ask).classes("fw-field")
            self._verdict = ui.select(VERDICTS, value="", label="Verdict", on_change=self._ask)
            self._finding = ui.select(
                {"": "Any finding", **{code: code for code in codes}},
                value="",
                label="Finding",
                on_change=self._ask,
            )
            for field in (self._verdict, self._finding):
                field.classes("fw-field")
        self._buttons()
        self._list = ui.element("div").classes("fw-list")
        self._list.props('role="listbox" aria-label="Captures and results"')
        ui.label(KEYS).classes("fw-quiet")
        ui.on("fw-capture", self._told)
        ui.timer(0.05, lambda: self._draw(rows), once=True)

    def _buttons(self) -> None:
        with ui.row().classes("fw-fields"):
            for name, does in (("Look", "look"), ("Rename", "rename"), ("Delete", "delete")):
                action = self._step.attempt(partial(self._do, does))
                style = "no-caps" if does == "look" else "flat no-caps"
                ui.button(name, on_click=action).props(style)
            every = self._step.attempt(self._judge_all)
            ui.button("Judge all", on_click=every).props("outline no-caps")
        work(self._step, ("judging all",), self._judged)
        self._said = ui.label().classes("fw-lines").props('role="status"')
        self._dialog = ui.dialog()
        with self._dialog, ui.card():
            self._new = ui.input("New name").classes("fw-wide").props("autofocus")
            rename = self._step.attempt(self._rename)
            self._new.on("keydown.enter", rename)
            with ui.row():
                ui.button("Rename", on_click=rename).props("no-caps")
                ui.button("Cancel", on_click=self._dialog.close).props("flat no-caps")

    def _rows(self) -> list[dict[str, Any]]:
        """What the page draws: a row for each capture and result."""
        space, notes = self._studio.workspace, self._studio.notes
        captures = space.captures()
        rows = [self._row(name, notes.of(name), picture=True) for name in reversed(captures)]
        return rows + [self._row(name, notes.of(name), picture=False) for name in space.results()]

    def _row(self, name: str, note: Note, *, picture: bool) -> dict[str, Any]:
        found = ", ".join(note.findings)
        state = note.verdict or ("measured" if note.measured else "")
        words = [state, f"finding: {found}" if found else "", "" if picture else "result"]
        stamp = self._studio.workspace.inside(name).stat().st_mtime_ns if picture else 0
        return {
            "name": name,
            "picture": f"/thumb/{quote(name)}?{stamp}" if picture else "",
            "verdict": note.verdict,
            "findings": list(note.findings),
            "said": " · ".join(word for word in words if word) or "not measured yet",
        }

    def _asked(self) -> dict[str, str]:
        return {
            "text": str(self._text.value or ""),
            "verdict": str(self._verdict.value or ""),
            "finding": str(self._finding.value or ""),
        }

    def _ask(self) -> None:
        self._draw(None)

    def _draw(self, rows: list[dict[str, Any]] | None) -> None:
        given = json.dumps(rows), json.dumps(self._asked())
        ui.run_javascript(f"fringeCaptures('{self._list.html_id}', {given[0]}, {given[1]})")

    def _told(self, event: Any) -> None:
        """What was chosen in the list, and what a key asks for."""
        does, name = (event.args or [None, None])[:2]
        self._chosen = name if isinstance(name, str) else None
        if does in ("look", "rename", "delete"):
            self._step.attempt(lambda: self._do(does))()

    def _do(self, does: str) -> None:
        if self._chosen is None:
            raise InputError("No capture is chosen: choose one in the list.")
        if does == "look":
            self._step.go("look", self._chosen)
        elif does == "delete":
            self._studio.delete(self._step.session, self._chosen)
            say(f"{self._chosen} lies in the trash: Undo brings it back.")
            self._step.go("captures")
        else:
            self._new.set_value(self._chosen)
            self._dialog.open()

    def _judge_all(self) -> None:
        self._studio.inspect_all(self._step.session, self._studio.workspace.captures())

    def _judged(self, job: Job) -> None:
        counts = Counter(job.result.values())
        told = [f"{counts[verdict]} {verdict}" for verdict in VERDICTS if counts[verdict]]
        wrong = [f"{name}: {why}" for name, why in job.result.items() if why not in VERDICTS]
        self._said.set_text("\n".join([", ".join(told), *wrong[:MOST_SAID]]))
        self._draw(self._rows())

    def _rename(self) -> None:
        if self._chosen is not None:
            self._studio.rename(self._step.session, self._chosen, str(self._new.value or ""))
            self._dialog.close()
            self._step.go("captures")
