"""Areas drawn on the picture, and the tolerances that a part is judged by."""

from __future__ import annotations

import html
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from nicegui import ui

from fringeworks.serving.worker import Job
from fringeworks.studio.steps.parts import Step, described, disclosure, named, work
from fringeworks.types import Area, InputError, PartTolerance
from fringeworks.types.numbers import limit, number, sigma_text
from fringeworks.types.recipe import FROM_MODEL, QUANTITIES

EVERYWHERE = "everywhere"
"""Choice for measuring the whole frame."""
LEAST_DRAG_PX = 3
"""A drag that is shorter is a click, px of the screen."""
LINE = 'fill="none" stroke="#ff2d95" vector-effect="non-scaling-stroke" stroke-width="2"'
"""How outlines are drawn."""
NAMED = 'fill="#ff2d95" stroke="black" stroke-width="3" paint-order="stroke" font-size="14"'
"""How names are drawn: with a dark outline, on bright and dark pictures."""
COLUMNS = ("Tolerance", "Value", "± σ", "Unit", "Limits", "Verdict")
"""Columns of the verdicts."""


def areas(step: Step, source: Callable[[], str | None], measured: Callable[[], None]) -> Areas:
    """Draw areas on the picture of a source, and judge tolerances in them.

    ``measured`` is called to measure again after the area that confines it has changed.
    """
    found: list[Areas] = []
    with disclosure("Areas and tolerances", lambda: found[0].opened()):
        found.append(Areas(step, source, measured))
    return found[0]


class Areas:
    """The picture with its areas, the tolerances, and the last verdicts."""

    def __init__(
        self,
        step: Step,
        source: Callable[[], str | None],
        measured: Callable[[], None],
    ) -> None:
        self._step, self._studio, self._source = step, step.studio, source
        self._measured = measured
        self._corners: list[tuple[float, float]] = []
        self._scale, self._size = 1, (1, 1)
        with ui.row().classes("fw-fields"):
            self._shape = ui.toggle({"box": "Box", "polygon": "Polygon"}, value="box")
            self._shape.props("no-caps")
            self._name = ui.input("Name of the next area", value=self._next_name()).classes(
                "fw-field"
            )
            close = step.attempt(self._close_polygon)
            for name, action in (("Close the polygon", close), ("Undo corner", self._undo_corner)):
                button = ui.button(name, on_click=action).props("flat no-caps")
                button.bind_visibility_from(self._shape, "value", lambda v: v == "polygon")
        ui.label(
            "Drag a box over the picture, or click the corners of a polygon and close it."
        ).classes("fw-quiet")
        self._picture = ui.interactive_image(
            cross="#ff2d95", events=["mousedown", "mouseup", "mouseleave"]
        ).classes("fw-live")
        self._picture.on_mouse(self._mouse)
        described(self._picture, "What the camera saw, with the areas that are drawn")
        # Prevent the browser's own drag of the picture.
        for event in ("dragstart", "mousedown"):
            self._picture.on(event, js_handler="(event) => event.preventDefault()")
        work(step, ("drawing the picture",), self._drawn)
        self._fault = ui.label().classes("fw-bad").props('role="alert"')
        self._list()
        self._tolerances()
        inspect = step.attempt(self._inspect)
        ui.button("Judge the part", on_click=inspect).props("outline no-caps")
        work(step, ("judging",), self._judged)
        self._verdicts()

    def opened(self) -> None:
        """Show the picture, when this part of the page is unfolded."""
        self._fault.set_text(self._studio.recipes.fault)
        self._show_picture()

    def _judged(self, job: Job) -> None:
        self._step.session.verdict = job.result
        self._verdicts.refresh()

    def forget(self) -> None:
        """Take the verdict away: what it was about has changed."""
        if self._step.session.verdict is not None:
            self._step.session.verdict = None
            self._verdicts.refresh()

    def _show_picture(self) -> None:
        if self._source():
            self._step.attempt(
                lambda: self._studio.draw_picture(self._step.session, str(self._source()))
            )()

    def _drawn(self, job: Job) -> None:
        self._scale, self._size = job.result["step"], job.result["size"]
        self._picture.set_source(f"/surface/{self._step.session.picture}")
        self._outline()

    def _mouse(self, event: Any) -> None:
        columns, rows = self._size
        at = (
            min(max(event.image_x * self._scale, 0.0), columns - 1.0),
            min(max(event.image_y * self._scale, 0.0), rows - 1.0),
        )
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
            if max(abs(x1 - x0), abs(y1 - y0)) < LEAST_DRAG_PX * self._scale:
                return
            box = (min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1))
            left, top, right, bottom = (round(v) for v in box)
            self._step.attempt(lambda: self._add(Area(box=(left, top, right, bottom))))()

    def _close_polygon(self) -> None:
        corners, self._corners = tuple(self._corners), []
        self._add(Area(polygon=corners))

    def _add(self, area: Area) -> None:
        self._studio.recipes.set_area(str(self._name.value), area)
        self._name.set_value(self._next_name())
        self._changed()

    def _next_name(self) -> str:
        taken = self._studio.recipes.shown.areas
        return next(n for k in range(1, 10_000) if (n := f"area-{k}") not in taken)

    def _undo_corner(self) -> None:
        del self._corners[-1:]
        self._outline()

    def _changed(self) -> None:
        self.forget()
        self._outline()
        self._list.refresh()
        self._tolerances.refresh()

    def _outline(self) -> None:
        """Draw the outlines of all areas over the picture."""
        parts = []
        for name, area in self._studio.recipes.shown.areas.items():
            corners = area.polygon
            if area.box is not None:
                left, top, right, bottom = area.box
                corners = ((left, top), (right, top), (right, bottom), (left, bottom))
            if corners is None:
                continue
            parts.append(f'<polygon points="{self._points(corners)}" {LINE} />')
            x, y = (v / self._scale for v in corners[0])
            parts.append(f'<text x="{x:.1f}" y="{y - 3:.1f}" {NAMED}>{html.escape(name)}</text>')
        if self._corners:
            parts.append(f'<polyline points="{self._points(self._corners)}" {LINE} />')
        self._picture.set_content("".join(parts))

    def _points(self, corners: Any) -> str:
        return " ".join(f"{x / self._scale:.1f},{y / self._scale:.1f}" for x, y in corners)

    @ui.refreshable_method
    def _list(self) -> None:
        recipe = self._studio.recipes.shown
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
            ).classes("fw-field")

    def _remove_area(self, name: str) -> None:
        self._studio.recipes.remove_area(name)
        self._changed()

    def _confine(self, name: str) -> None:
        self._step.attempt(
            lambda: self._studio.recipes.confine(None if name == EVERYWHERE else name)
        )()
        self.forget()
        self._measured()

    @ui.refreshable_method
    def _tolerances(self) -> None:
        recipe = self._studio.recipes.shown
        for one in recipe.tolerances:
            with ui.row().classes("items-center"):
                ui.label(f"{one.name}: {_limits(one.low, one.high)}")
                remove = self._step.attempt(partial(self._remove_tolerance, one.name))
                button = ui.button("✕", on_click=remove).props("flat dense")
                named(button, f"Delete {one.name}")
        if not recipe.areas:
            return
        with ui.row().classes("fw-fields"):
            known = [q for q in QUANTITIES if recipe.model is not None or q not in FROM_MODEL]
            names = {name: name.replace("_", " ") for name in known}
            quantity = ui.select(names, value="flatness", label="Quantity").classes("fw-field")
            names_of_areas = list(recipe.areas)
            area = ui.select(names_of_areas, value=names_of_areas[-1], label="Area").classes(
                "fw-field"
            )
            other = ui.select(names_of_areas, value=names_of_areas[0], label="Base, or other area")
            other.classes("fw-field")
            other.bind_visibility_from(quantity, "value", lambda v: QUANTITIES[v] > 1)
            low = ui.number("Smallest").classes("fw-narrow")
            high = ui.number("Largest").classes("fw-narrow")

            def add() -> None:
                on = (area.value, other.value)[: QUANTITIES[quantity.value]]
                base = f"{names[quantity.value]} of {' over '.join(on)}"
                taken = {one.name for one in self._studio.recipes.shown.tolerances}
                name = next(
                    n
                    for k in range(1, 999)
                    if (n := base if k == 1 else f"{base} ({k})") not in taken
                )
                self._studio.recipes.add_tolerance(
                    PartTolerance(name, quantity.value, on, low.value, high.value)
                )
                self.forget()
                self._tolerances.refresh()

            ui.button("Add the tolerance", on_click=self._step.attempt(add)).props("flat no-caps")

    def _remove_tolerance(self, name: str) -> None:
        self._studio.recipes.remove_tolerance(name)
        self.forget()
        self._tolerances.refresh()

    def _inspect(self) -> None:
        if not self._source():
            raise InputError("part: expected a capture to be chosen, got none")
        self.forget()
        self._studio.inspect(self._step.session, str(self._source()))

    @ui.refreshable_method
    def _verdicts(self) -> None:
        result = self._step.session.verdict
        if result is None or result["source"] != self._source():
            return
        ui.label(f"{result['source']}: {result['verdict']}").classes("fw-h2").props('role="status"')
        with ui.element("div").classes("fw-scroll"), ui.element("table").classes("fw-table"):
            _row("th", COLUMNS)
            for check in result["checks"]:
                why = f": {check['why']}" if check["why"] else ""
                cells = (
                    check["name"],
                    number(check["value"], check["sigma"]),
                    sigma_text(check["sigma"]),
                    check["unit"],
                    _limits(check["smallest"], check["largest"]),
                    check["verdict"] + why,
                )
                _row("td", cells)


def _row(kind: str, texts: Sequence[str]) -> None:
    """A row of a table."""
    with ui.element("tr"):
        for text in texts:
            with ui.element(kind):
                ui.label(text)


def _limits(low: float | None, high: float | None) -> str:
    parts = [
        f"{words} {limit(value)}"
        for words, value in (("at least", low), ("at most", high))
        if value is not None
    ]
    return ", ".join(parts)
