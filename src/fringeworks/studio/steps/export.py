"""Export: the result in every format, and the commands that do the same."""

from __future__ import annotations

from functools import partial

from nicegui import ui

from fringeworks.studio.steps.parts import Step, work
from fringeworks.studio.worker import Job

FORMATS = {
    "PLY, points": (".ply", "points"),
    "PLY, mesh": (".ply", "mesh"),
    "NPZ, everything": (".npz", ""),
    "CSV, table": (".csv", ""),
    "Report, HTML": (".html", ""),
    "Report, PDF": (".pdf", ""),
}
"""Formats of every result: suffix, and content of PLY."""
OF_POINTS = {
    "XYZ, text": (".xyz", ""),
    "PCD": (".pcd", ""),
    "E57": (".e57", ""),
    "LAS": (".las", ""),
}
"""Further formats of points."""
OF_HEIGHTS = {"TIFF": (".tif", ""), "X3P": (".x3p", ""), "GSF": (".gsf", "")}
"""Further formats of heights over a plane."""


def build(step: Step) -> None:
    """Build the step."""
    studio, shown = step.studio, step.session.shown
    if shown is None or not shown.result:
        ui.label("Measure something first; then it can be written.")
    else:
        ui.label(f"{shown.source}, as it is shown:")
        heights = "quantity" in shown.result["figures"]
        formats = FORMATS | (OF_HEIGHTS if heights else OF_POINTS)
        with ui.row():
            for name, (suffix, kind) in formats.items():
                write = step.attempt(partial(studio.export, step.session, shown, suffix, kind))
                ui.button(name, on_click=write).props("outline no-caps")

    def written(job: Job) -> None:
        ui.download(f"/file/{job.result}", job.result)
        commands.refresh()

    work(step, ("writing",), written)

    @ui.refreshable
    def commands() -> None:
        if not studio.log.done:
            return
        done = studio.log.done
        shell = "\n".join(command.shell for command in done if command.shell)
        python = "\n".join(["import fringeworks as fw", *(command.python for command in done)])
        for name, does, text in (("Commands", "do", shell), ("Python", "does", python)):
            ui.label(f"{name} that {does} the same").classes("text-lg")
            ui.label(text).classes("fw-code")
            copy = ui.button("Copy", on_click=lambda _, t=text: ui.clipboard.write(t))
            copy.props(f'flat dense no-caps aria-label="Copy the {name}"')

    commands()
