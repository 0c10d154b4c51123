"""Set up: devices, a live picture, and what they can do together."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from nicegui import ui

from fringeworks.studio.steps.parts import UPDATE_S, Step, devices, work
from fringeworks.studio.worker import Job


def build(step: Step) -> None:
    """Build the step."""
    studio = step.studio
    devices(step)
    with ui.row():
        start = step.attempt(lambda: studio.run_setup(step.session))
        ui.button("Set up", on_click=start).props("no-caps")
        find = step.attempt(lambda: studio.look_for_devices(step.session))
        ui.button("Find devices", on_click=find).props("flat no-caps")
    _live(step)

    def refresh(job: Job) -> None:
        if job.name == "looking for devices":
            studio.found = job.result
            step.go("set up")
        else:
            findings.refresh()

    work(step, studio.devices, ("set up", "looking"), refresh)

    @ui.refreshable
    def findings() -> None:
        if not studio.workspace.setup.is_file():
            return
        found = studio.findings()
        if not found:
            ui.label("No finding: the devices suit each other. Next: calibrate.")
        for text in found:
            ui.label(f"! {text}").classes("text-warning")
        if studio.workspace.setup.with_suffix(".png").is_file():
            stamp = studio.workspace.setup.stat().st_mtime_ns
            picture = ui.image(f"/file/setup.png?{stamp}").classes("w-full max-w-5xl bg-white")
            picture.props('alt="Pictures of all tests of the set-up"')

    findings()


def _live(step: Step) -> None:
    """The live picture, with what helps to expose and to focus."""
    studio = step.studio
    numbers = itertools.count()
    with ui.expansion("Live picture: saturated pixels are red").classes("w-full max-w-4xl"):
        with ui.row().classes("items-center"):
            level = ui.slider(min=0, max=1, step=0.05, value=0.5).classes("w-40")
            level.props('label aria-label="Grey level that is projected"')
            exposure = ui.number("Exposure, ms", min=0.02, max=10_000).classes("w-32")
            begin = step.attempt(
                lambda: studio.start_live(step.session, level.value, exposure.value)
            )
            ui.button("Start", on_click=begin).props("flat no-caps")
            ui.button("Stop", on_click=studio.devices.stop).props("flat no-caps")
        told = ui.label("Brightness and sharpness appear here.").props('role="status"')
        picture = ui.interactive_image(cross=True, events=["mousemove"]).classes("fw-live")
        under = ui.label()
        picture.on_mouse(lambda event: under.set_text(_value(studio, event)))

        def update() -> None:
            job = studio.devices.job
            seen = job.latest.get("picture") if job and job.name == "live picture" else None
            if seen is None or job is None or job.state != "running":
                return
            picture.set_source(f"/live/{next(numbers)}")
            told.set_text(
                f"mean {seen['mean_share']:.0%} of full scale, "
                f"saturated {seen['saturated_share']:.1%}, sharpness {seen['sharpness']:.4f} "
                "(turn the lens until it is largest)"
            )

        ui.timer(UPDATE_S, update)
    work(step, studio.devices, ("live",))


def _value(studio: Any, event: Any) -> str:
    """The brightness under the cursor."""
    job = studio.devices.job
    seen = job.latest.get("picture") if job else None
    if seen is None:
        return ""
    columns, rows = seen["size"]
    x, y = int(event.image_x), int(event.image_y)
    if not (0 <= x < columns and 0 <= y < rows):
        return ""
    grey = np.frombuffer(seen["grey"], np.uint8).reshape(rows, columns)
    return f"column {x}, row {y}: {grey[y, x] / 255:.0%} of full scale"
