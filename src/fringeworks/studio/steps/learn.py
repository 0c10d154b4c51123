"""Learn: a virtual scene with sliders, and how each method holds or fails on it."""

from __future__ import annotations

from nicegui import ui

from fringeworks.pair.analyse import methods
from fringeworks.studio.steps.parts import Step, work
from fringeworks.studio.worker import Job

SLIDERS: dict[str, tuple[str, float, float, float, float]] = {
    "gamma": ("γ of the projector", 1.0, 3.0, 0.1, 1.0),
    "noise": ("Noise, counts", 0.0, 10.0, 0.5, 1.0),
    "fringes": ("Fringes", 4, 60, 1, 20),
    "height_mm": ("Height, mm", 5.0, 100.0, 5.0, 50.0),
}
"""Sliders: name, smallest, largest, step and first value."""
BODIES = ("parabola", "cube", "cylinder")
"""Bodies of the dissertation."""


def build(step: Step) -> None:
    """Build the step."""
    studio = step.studio
    sliders = {}
    with ui.row().classes("items-end"):
        body = ui.select(list(BODIES), value="parabola", label="Body").classes("w-36")
        method = ui.select(list(methods()), value="windowed", label="Method").classes("w-48")
        painted = ui.checkbox("Painted")
    with ui.grid(columns="max-content 16rem max-content").classes("items-center"):
        for key, (name, low, high, by, first) in SLIDERS.items():
            ui.label(name)
            sliders[key] = ui.slider(min=low, max=high, step=by, value=first)
            sliders[key].props(f'aria-label="{name}"')
            ui.label().bind_text_from(sliders[key], "value", lambda v: f"{v:g}")

    def begin() -> None:
        settings = {key: slider.value for key, slider in sliders.items()}
        settings["fringes"] = int(settings["fringes"])
        settings["painted"] = painted.value
        studio.learn(step.session, body.value, method.value, settings)

    ui.button("Try", on_click=step.attempt(begin)).props("no-caps")

    def tried(job: Job) -> None:
        ui.run_javascript(f"fringeShow('{mount}', [{step.session.tried}])")
        found = job.result
        told.set_text(
            f"{found['method']}: mean error {found['mean_abs_error_mm']:.3g} mm, largest "
            f"{found['max_abs_error_mm']:.3g} mm, {found['failed_fraction']:.1%} without a value. "
            "The layer Deviation is the true error."
        )

    work(step, studio.compute, ("trying",), tried)
    told = ui.label().props('role="status"')
    element = ui.element("div").classes("fringe-viewer-mount w-full")
    mount = f"c{element.id}"
