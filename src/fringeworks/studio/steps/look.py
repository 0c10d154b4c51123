"""Look and measure: a surface to turn, methods and their options, and the result before."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from nicegui import ui

from fringeworks.pair.analyse import methods
from fringeworks.serving.worker import Job
from fringeworks.studio.places import Place
from fringeworks.studio.steps.areas import areas
from fringeworks.studio.steps.parts import (
    SHOWN_S,
    Step,
    checked,
    disclosure,
    empty,
    figures,
    number,
    show_findings,
    work,
)
from fringeworks.studio.tasks import is_stack
from fringeworks.types import InputError

DEVIATION = "deviation"
"""Stands for a method in addresses of parts that are compared with a drawing."""
USUAL = "windowed"
"""The method that addresses leave out."""
FIGURES = {
    "points": "Points",
    "failed_fraction": "Pixels without a value, %",
    "median_sigma_mm": "Median σ, mm",
    "median_sigma": "Median σ",
    "mean_mm": "Mean deviation, mm",
    "rms_mm": "Root mean square of the deviation, mm",
    "outside_share": "Outside of the tolerance, %",
    "surely_outside_share": "Outside by more than 2 σ, %",
    "method": "Method",
    "unit": "Unit",
}
"""Figures below the surface."""


def build(step: Step) -> None:
    """Build the step."""
    _Look(step)


class _Look:
    """The controls, and the surfaces that they have made."""

    def __init__(self, step: Step) -> None:
        self._step, self._studio, self._session = step, step.studio, step.session
        space = self._studio.workspace
        sources = [*space.captures(), *space.results()]
        self._session.catch_up()
        self._ask(step.place, sources)
        shown = self._session.pending or self._session.shown
        with ui.row().classes("fw-fields"):
            self._source = ui.select(
                sources,
                label="Capture or result",
                value=shown.source if shown and shown.source in sources else None,
                on_change=lambda: self._choose(),
            ).classes("fw-wide")
            names = list(methods())
            self._method = ui.select(
                names,
                label="Method",
                value=shown.method if shown and shown.method in names else USUAL,
                on_change=lambda: self._offer(),
            ).classes("fw-field")
            self._compare = ui.checkbox(
                "Compare with the previous result", on_change=lambda: self._draw()
            )
            ui.button("Measure", on_click=step.attempt(self._measure)).props("no-caps")
        self._options = ui.row().classes("fw-fields")
        self._controls: dict[str, Any] = {}
        work(step, ("measuring",), self._arrived)
        mount = ui.element("div").classes("fringe-viewer-mount fw-full")
        self._mount = f"c{mount.id}"
        self._below = ui.column()
        with disclosure("Compare with a drawing (CAD)"):
            self._drawing()
        self._areas = areas(step, lambda: self._source.value, self._recompute, lambda: self._mount)
        self._offer()
        if self._session.shown is not None:
            ui.timer(SHOWN_S, self._draw, once=True)
        elif not sources:
            empty("There is nothing to look at yet: scan a part, or try a virtual one in Start.")
        elif self._session.pending is None and not step.place.source:
            empty("Choose a capture or a result above, and press Measure.")

    def _drawing(self) -> None:
        """Choose a drawing in the folder, and compare the part with it."""
        drawings = self._studio.workspace.drawings()
        if not drawings:
            empty("Put a drawing into the folder: .stl, .obj, .off or .ply, in mm.")
            return
        with ui.row().classes("fw-fields"):
            model = ui.select(drawings, value=drawings[0], label="Drawing").classes("fw-wide")
            within = number("Tolerance, mm", low=1e-6, high=1e6).classes("fw-narrow")

            def compare() -> None:
                if not self._source.value:
                    raise InputError("part: expected a capture to be chosen, got none")
                name = str(self._source.value)
                self._studio.deviate(self._session, name, str(model.value), checked(within))
                self._step.move(_place(name, DEVIATION, {"model": model.value}))

            ui.button("Compare", on_click=self._step.attempt(compare)).props("outline no-caps")

    def _ask(self, place: Place, sources: list[str]) -> None:
        """Measure what the address asks for, unless it is shown already."""
        if not place.source:
            if (one := self._session.pending or self._session.shown) is not None:
                self._step.move(_place(one.source, one.method, one.options), replace=True)
            return
        if place.source not in sources:
            raise_later = f"{place.source}: expected a capture or result in the folder, got none"
            ui.label(raise_later).classes("fw-bad").props('role="alert"')
            return
        if place.method == DEVIATION and not self._session.recall(
            place.source, DEVIATION, place.options
        ):
            model = str(place.options.get("model", ""))
            self._step.attempt(
                lambda: self._studio.deviate(self._session, place.source, model, None)
            )()
            return
        method, options = place.method or USUAL, place.options
        if not self._session.recall(place.source, method, options):
            known = methods().get(method)
            if known is None or not options.keys() <= known.options.keys():
                ui.label("The address asks for a method or an option that there is not.").classes(
                    "fw-bad"
                ).props('role="alert"')
                return
            self._step.attempt(
                lambda: self._studio.look(self._session, place.source, method, options)
            )()

    def _choose(self) -> None:
        self._areas.forget()
        self._offer()

    def _offer(self) -> None:
        """Controls for the options of the method, from its own signature."""
        source = self._source.value
        path = self._studio.workspace.inside(source) if source else None
        pair = path is not None and path.is_dir() and not is_stack(path)
        self._method.set_visibility(pair)
        self._options.clear()
        self._controls = {}
        if not pair:
            return
        with self._options:
            for name, default in methods()[self._method.value].options.items():
                self._controls[name] = _control(name, default, lambda: self._recompute())

    def _recompute(self) -> None:
        """Measure again with the options that were changed."""
        if self._session.shown is not None:
            self._step.attempt(self._measure)()

    def _measure(self) -> None:
        if not self._source.value:
            raise InputError("surface: expected a capture or result to be chosen")
        defaults = methods()[self._method.value].options if self._controls else {}
        options = {name: _value(c, defaults[name]) for name, c in self._controls.items()}
        changed = {name: v for name, v in options.items() if v != defaults[name]}
        source, method = self._source.value, self._method.value
        self._studio.look(self._session, source, method, changed)
        self._step.move(_place(source, method, changed))

    def _arrived(self, job: Job) -> None:
        self._session.arrived(job.name, job.result)
        self._draw()

    def _draw(self) -> None:
        shown, kept = self._session.shown, self._session.kept
        if shown is None or not shown.result:
            return
        numbers = [shown.number]
        if self._compare.value and kept is not None and kept.result:
            numbers = [kept.number, shown.number]
        ui.run_javascript(f"fringeShow({json.dumps(self._mount)}, {json.dumps(numbers)})")
        self._below.clear()
        with self._below:
            title = shown.result.get("title", Path(shown.source).name)
            with ui.row().classes("items-center"):
                ui.label(title).classes("fw-h2")
                ui.button("Write files", on_click=lambda: self._step.go("export")).props(
                    "flat no-caps"
                )
            figures(shown.result["figures"], FIGURES)
            if shown.result["every"] > 1:
                ui.label(f"Shown: one of {shown.result['every']} columns and rows.")
            show_findings(shown.result["figures"])
        self._areas.shown()


def _place(source: str, method: str, options: dict[str, Any]) -> Place:
    """The address of a surface."""
    return Place("look", source, "" if method == USUAL else method, options)


def _control(name: str, default: Any, changed: Any) -> Any:
    """A control for an option, by the type of its default."""
    if isinstance(default, bool):
        return ui.checkbox(name, value=default, on_change=changed)
    if isinstance(default, int | float):
        return ui.number(name, value=default).classes("fw-narrow").on("change", changed)
    text = "" if default is None else default if isinstance(default, str) else json.dumps(default)
    return ui.input(name, value=text).classes("fw-narrow").on("change", changed)


def _value(control: Any, default: Any) -> Any:
    """The value of a control, as the method takes it."""
    value = control.value
    if not isinstance(value, str):
        whole = isinstance(default, int) and isinstance(value, float) and value.is_integer()
        return int(value) if whole else value
    if isinstance(default, str):
        return value
    if not value:
        return None
    try:
        return json.loads(value)
    except json.JSONDecodeError:
        return value
