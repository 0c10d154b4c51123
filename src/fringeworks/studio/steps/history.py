"""History: what was done, what can be undone, and what lies in the trash."""

from __future__ import annotations

from functools import partial

from nicegui import ui

from fringeworks.studio.steps.parts import Step, commands, empty, heading, named
from fringeworks.studio.trash import KEPT_DAYS, Entry

MOST_SHOWN = 100
"""Entries of the trash that are listed."""
DATE = "%Y-%m-%d %H:%M"
"""How a time is shown."""


def build(step: Step) -> None:
    """Build the step."""
    heading("What can be undone")
    ui.label(
        f"Deleted and replaced files lie in the folder's trash for {KEPT_DAYS} days. Undoing can "
        "be undone as well."
    ).classes("fw-quiet")
    _entries(step)
    if step.studio.log.done:
        commands(step)
    else:
        heading("What was done")
        empty("Nothing was done in this folder yet. Commands that do the same will be here.")


@ui.refreshable
def _entries(step: Step) -> None:
    entries = step.studio.trash.entries()[:MOST_SHOWN]
    if not entries:
        empty("Nothing was deleted or replaced.")
        return
    with ui.element("div").classes("fw-scroll"), ui.element("table").classes("fw-table"):
        for entry in entries:
            with ui.element("tr"):
                for text in (entry.when.astimezone().strftime(DATE), entry.what):
                    with ui.element("td"):
                        ui.label(text)
                with ui.element("td"):
                    button = ui.button("Undo", on_click=partial(_undo, step, entry))
                    button.props("flat dense no-caps")
                    named(button, f"Undo {entry.what}")


def _undo(step: Step, entry: Entry) -> None:
    def undo() -> None:
        ui.notify(step.studio.undo(step.session, entry))
        step.go("history")

    step.attempt(undo)()
