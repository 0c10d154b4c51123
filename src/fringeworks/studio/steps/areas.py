"""Areas drawn on the picture, and the tolerances that a part is judged by."""

from __future__ import annotations

import html
from collections.abc import Callable
from functools import partial
from typing import Any

from nicegui import ui

from fringeworks.studio.steps.parts import Step, named, work
from fringeworks.studio.worker import Job
from fringeworks.types import Area, InputError, PartTolerance
from fringeworks.types.recipe import QUANTITIES

EVERYWHERE = "everywhere"
"""What is chosen where no area confines the measurement."""
LINE = 'fill="none" stroke="#ff2d95" vector-effect="non-scaling-stroke" stroke-width="2"'
"""How outlines are drawn."""
COLUMNS = ("Tolerance", "Value", "Standard deviation", "Unit", "Verdict")
"""Columns of the verdicts."""


def areas(step: Step, source: Callable[[], str | None], measured: Callable[[], None]) -> None:
    """Draw areas on the picture of a source, and judge tolerances in them.

    ``measured`` is called to measure again after the area that confines it has changed.
    """
    with ui.expansion("Areas and tolerances").classes("w-full") as box:
        _Areas(step, source, measured, box)


class _Areas:
    """The picture with its areas, the tolerances, and the last verdicts."""

    def __init__(
        self,
        step: Step,
        source: Callable[[], str | None],
        measured: Callable[[], None],
        box: ui.expansion,
    ) -> None:
        self._step, self._studio, self._source = step, step.studio, source
        self._measured = measured
        self._corners: list[tuple[float, float]] = []
        self._scale = 1
        box.on_value_change(self._opened)
        with ui.row().classes("items-end"):
            self._shape = ui.toggle({"box": "Box", "polygon": "Polygon"}, value="box")
            self._name = ui.input("Name of the next area", value=self._next_name()).classes("w-48")
            close = step.attempt(self._close_polygon)
            ui.button("Close the polygon", on_click=close).props("flat no-caps")
        ui.label(
            "Drag a box over the picture, or click the corners of a polygon and close it."
        ).classes("opacity-80")
        self._picture = ui.interactive_image(
            cross="#ff2d95", events=["mousedown", "mouseup"]
        ).classes("fw-live")
        self._picture.on_mouse(self._mouse)
        # Else browsers drag the picture itself.
        for event in ("dragstart", "mousedown"):
            self._picture.on(event, js_handler="(event) => event.preventDefault()")
        work(step, ("drawing the picture",), self._drawn)
        self._list()
        self._tolerances()
        inspect = step.attempt(self._inspect)
        ui.button("Judge the part", on_click=inspect).props("outline no-caps")
        work(step, ("judging",), self._judged)
        self._verdicts()

    def _opened(self, event: Any) -> None:
        if event.value:
            self._show_picture()

    def _judged(self, job: Job) -> None:
        self._verdicts.refresh(job.result)

    def _show_picture(self) -> None:
        if self._source():
            self._step.attempt(
                lambda: self._studio.draw_picture(self._step.session, str(self._source()))
            )()

    def _drawn(self, job: Job) -> None:
        self._scale = job.result["step"]
        self._picture.set_source(f"/picture/{self._studio.picture_number(self._step.session)}")
        self._outline()

    def _mouse(self, event: Any) -> None:
        at = (event.image_x * self._scale, event.image_y * self._scale)
        if self._shape.value == "polygon":
            if event.type == "mouseup":
                self._corners.append(at)
                self._outline()
            return
        if event.type == "mousedown":
            self._corners = [at]
        elif self._corners:
            (x0, y0), (x1, y1) = self._corners[0], at
            self._corners = []
            box = (min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1))
            left, top, right, bottom = (round(v) for v in box)
            self._step.attempt(lambda: self._add(Area(box=(left, top, right, bottom))))()

    def _close_polygon(self) -> None:
        corners, self._corners = tuple(self._corners), []
        self._add(Area(polygon=corners))

    def _add(self, area: Area) -> None:
        self._studio.set_area(str(self._name.value), area)
        self._name.set_value(self._next_name())
        self._changed()

    def _next_name(self) -> str:
        taken = self._studio.recipe.areas
        return next(n for k in range(1, 10_000) if (n := f"area-{k}") not in taken)

    def _changed(self) -> None:
        self._outline()
        self._list.refresh()
        self._tolerances.refresh()

    def _outline(self) -> None:
        """Draw the outlines of all areas over the picture."""
        parts = []
        for name, area in self._studio.recipe.areas.items():
            corners = area.polygon
            if area.box is not None:
                left, top, right, bottom = area.box
                corners = ((left, top), (right, top), (right, bottom), (left, bottom))
            if corners is None:
                continue
            parts.append(f'<polygon points="{self._points(corners)}" {LINE} />')
            x, y = (v / self._scale for v in corners[0])
            parts.append(
                f'<text x="{x:.1f}" y="{y - 3:.1f}" fill="#ff2d95" font-size="14">'
                f"{html.escape(name)}</text>"
            )
        if self._corners:
            parts.append(f'<polyline points="{self._points(self._corners)}" {LINE} />')
        self._picture.set_content("".join(parts))

    def _points(self, corners: Any) -> str:
        return " ".join(f"{x / self._scale:.1f},{y / self._scale:.1f}" for x, y in corners)

    @ui.refreshable_method
    def _list(self) -> None:
        recipe = self._studio.recipe
        if not recipe.areas:
            return
        with ui.row().classes("items-center"):
            for name in recipe.areas:
                remove = self._step.attempt(partial(self._remove_area, name))
                button = ui.button(f"{name} ✕", on_click=remove)
                button.props("flat dense no-caps")
                named(button, f"Delete {name}")
            ui.select(
                [EVERYWHERE, *recipe.areas],
                label="Measure only",
                value=recipe.within or EVERYWHERE,
                on_change=lambda event: self._confine(event.value),
            ).classes("w-48")

    def _remove_area(self, name: str) -> None:
        self._studio.remove_area(name)
        self._changed()

    def _confine(self, name: str) -> None:
        self._step.attempt(lambda: self._studio.confine(None if name == EVERYWHERE else name))()
        self._measured()

    @ui.refreshable_method
    def _tolerances(self) -> None:
        recipe = self._studio.recipe
        for one in recipe.tolerances:
            with ui.row().classes("items-center"):
                ui.label(f"{one.name}: {_limits(one)}")
                remove = self._step.attempt(partial(self._remove_tolerance, one.name))
                button = ui.button("✕", on_click=remove).props("flat dense")
                named(button, f"Delete {one.name}")
        if not recipe.areas:
            return
        with ui.row().classes("items-end"):
            names = {name: name.replace("_", " ") for name in QUANTITIES}
            quantity = ui.select(names, value="flatness", label="Quantity").classes("w-44")
            names_of_areas = list(recipe.areas)
            area = ui.select(names_of_areas, value=names_of_areas[-1], label="Area")
            other = ui.select(names_of_areas, value=names_of_areas[0], label="Base, or other area")
            other.bind_visibility_from(quantity, "value", lambda v: QUANTITIES[v] > 1)
            low = ui.number("Smallest").classes("w-28")
            high = ui.number("Largest").classes("w-28")

            def add() -> None:
                on = (area.value, other.value)[: QUANTITIES[quantity.value]]
                base = f"{names[quantity.value]} of {' over '.join(on)}"
                taken = {one.name for one in self._studio.recipe.tolerances}
                name = next(
                    n
                    for k in range(1, 999)
                    if (n := base if k == 1 else f"{base} ({k})") not in taken
                )
                self._studio.add_tolerance(
                    PartTolerance(name, quantity.value, on, low.value, high.value)
                )
                self._tolerances.refresh()

            ui.button("Add the tolerance", on_click=self._step.attempt(add)).props("flat no-caps")

    def _remove_tolerance(self, name: str) -> None:
        self._studio.remove_tolerance(name)
        self._tolerances.refresh()

    def _inspect(self) -> None:
        if not self._source():
            raise InputError("part: expected a capture to be chosen, got none")
        self._studio.inspect(self._step.session, str(self._source()))

    @ui.refreshable_method
    def _verdicts(self, result: dict[str, Any] | None = None) -> None:
        if result is None:
            return
        ui.label(f"The part: {result['verdict']}").classes("text-lg").props('role="status"')
        with ui.grid(columns="repeat(5, max-content)").classes("gap-x-6 gap-y-0"):
            for name in COLUMNS:
                ui.label(name).classes("opacity-80")
            for check in result["checks"]:
                why = f": {check['why']}" if check["why"] else ""
                for text in (
                    check["name"],
                    _number(check["value"]),
                    _number(check["sigma"]),
                    check["unit"],
                    check["verdict"] + why,
                ):
                    ui.label(text)


def _limits(one: PartTolerance) -> str:
    low = "" if one.low is None else f"at least {one.low:g}"
    high = "" if one.high is None else f"at most {one.high:g}"
    return ", ".join(part for part in (low, high) if part)


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.5g}"
