"""Scan: the frames of an object, one by one or as a series."""

from __future__ import annotations

from functools import partial

from nicegui import ui

from fringeworks.studio.steps.parts import Step, devices, work
from fringeworks.studio.worker import Job


def build(step: Step) -> None:
    """Build the step."""
    studio = step.studio
    devices(step)
    with ui.row().classes("items-end"):
        name = ui.input("Name", value=_next(studio.workspace.captures())).classes("w-48")
        exposures = ui.number("Exposures", value=1, min=1, max=8, precision=0).classes("w-28")
        average = ui.number("Frames averaged", value=1, min=1, max=64, precision=0).classes("w-36")

    def begin() -> None:
        studio.scan(
            step.session,
            str(name.value),
            exposures=int(exposures.value or 1),
            average=int(average.value or 1),
        )

    start = step.attempt(begin)
    ui.button("Scan (space)", on_click=start).props("no-caps")
    ui.keyboard(on_key=lambda event: start() if _pressed(event) else None)

    def ended(job: Job) -> None:
        name.set_value(_next(studio.workspace.captures()))
        taken.refresh()
        if studio.workspace.rig.is_file():
            step.attempt(lambda: look(job.result["capture"]))()

    def look(capture: str) -> None:
        studio.look(step.session, capture, "windowed", {})
        step.go("look")

    work(step, studio.devices, ("scan",), ended)

    @ui.refreshable
    def taken() -> None:
        for capture in studio.workspace.captures():
            with ui.row().classes("items-center"):
                ui.label(capture)
                show = step.attempt(partial(look, capture))
                ui.button("Look", on_click=show).props("flat dense no-caps")

    taken()


def _pressed(event: object) -> bool:
    """Whether the space bar went down, outside of a field."""
    action, key = getattr(event, "action", None), getattr(event, "key", None)
    return bool(getattr(action, "keydown", False) and getattr(key, "space", False))


def _next(captures: list[str]) -> str:
    """The first name of a series that is free."""
    return next(n for k in range(1, 10_000) if (n := f"scan-{k:03d}") not in captures)
