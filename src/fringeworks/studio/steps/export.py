"""Export: the result in every format, and the commands that do the same."""

from __future__ import annotations

from functools import partial

from nicegui import ui

from fringeworks.serving.worker import Job
from fringeworks.studio.places import Place
from fringeworks.studio.steps.parts import Step, commands, empty, place_link, work

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
MESHES = {"STL, to print": ".stl", "3MF, to print": ".3mf", "OBJ": ".obj", "GLB": ".glb"}
"""Meshes of points in the order of a frame's pixels."""
LATEST = 3
"""Captures that are offered to look at."""
OF_HEIGHTS = {"TIFF": (".tif", ""), "X3P": (".x3p", ""), "GSF": (".gsf", "")}
"""Further formats of heights over a plane."""


def build(step: Step) -> None:
    """Build the step."""
    studio, shown = step.studio, step.session.shown
    if shown is None or not shown.result:
        empty("Measure something in Look first; then it can be written.")
        for name in studio.workspace.captures()[-LATEST:]:
            place_link(f"Look at {name}", Place("look", name))
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
        if not heights:
            ui.label(
                "Files to print hold a solid that lies on its back on a plate of 2 mm. For all "
                "sides of a part, merge views in Scan."
            ).classes("fw-quiet")

    def written(job: Job) -> None:
        ui.download(f"/file/{job.result}", job.result)
        done.refresh()

    work(step, ("writing",), written)

    @ui.refreshable
    def done() -> None:
        if studio.log.done:
            commands(step)

    done()
