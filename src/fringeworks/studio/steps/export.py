"""Export: the result in every format, and the commands that do the same."""

from __future__ import annotations

from functools import partial

from nicegui import ui

from fringeworks.serving.worker import Job
from fringeworks.studio.steps.parts import Step, commands, empty, work

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
MESHES = {"STL, to print": ".stl", "OBJ": ".obj", "3MF": ".3mf", "GLB": ".glb"}
"""Meshes of points in the order of a frame's pixels."""
"""Further formats of points."""
OF_HEIGHTS = {"TIFF": (".tif", ""), "X3P": (".x3p", ""), "GSF": (".gsf", "")}
"""Further formats of heights over a plane."""


def build(step: Step) -> None:
    """Build the step."""
    studio, shown = step.studio, step.session.shown
    if shown is None or not shown.result:
        empty("Measure something in Look first; then it can be written.")
    else:
        ui.label(f"{shown.source}, as it is shown:")
        heights = "quantity" in shown.result["figures"]
        formats = FORMATS | (OF_HEIGHTS if heights else OF_POINTS)
        with ui.row():
            for name, (suffix, kind) in formats.items():
                write = step.attempt(partial(studio.export, step.session, shown, suffix, kind))
                ui.button(name, on_click=write).props("outline no-caps")
            for name, suffix in {} if heights else MESHES.items():
                mesh = step.attempt(partial(studio.write_mesh, step.session, shown, suffix))
                ui.button(name, on_click=mesh).props("outline no-caps")

    def written(job: Job) -> None:
        ui.download(f"/file/{job.result}", job.result)
        done.refresh()

    work(step, ("writing",), written)

    @ui.refreshable
    def done() -> None:
        if studio.log.done:
            commands(step)

    done()
