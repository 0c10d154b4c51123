"""Areas drawn on the picture, and the tolerances that a part is judged by."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from nicegui import ui

from fringeworks.serving.worker import Job
from fringeworks.studio.steps.parts import Step, checked, disclosure, named, work
from fringeworks.studio.steps.parts import number as number_field
from fringeworks.types import Area, InputError, PartTolerance
from fringeworks.types.numbers import SHARE, UNKNOWN, limit, number, sigma_text
from fringeworks.types.recipe import FROM_MODEL, QUANTITIES, SHARES, UNITS

EVERYWHERE = "everywhere"
"""Choice for measuring the whole frame."""
HOW = (
    "Drag a box over the picture, or click the corners of a polygon and close it. You can also "
    "choose Region in the viewer, drag a rectangle over the surface, and make it an area. Drag the "
    "handles of an area to change it. Arrow keys move a handle by 1 px, with Shift by 10 px."
)
"""How areas are drawn."""
ENDS = ("first column", "first row", "last column", "last row")
"""Numbers of a box."""
MOST_PX = 100_000
"""Largest column or row that can be typed."""
COLUMNS = ("Tolerance", "Value", "± σ", "Limits", "Verdict")
"""Columns of the verdicts."""


def areas(
    step: Step,
    source: Callable[[], str | None],
    measured: Callable[[], None],
    surface: Callable[[], str],
) -> Areas:
    """Draw areas on the picture and the surface of a source, and judge tolerances in them.

    ``measured`` is called to measure again after the area that confines it has changed; ``surface``
    gives the identifier of the element that holds the viewer.
    """
    found: list[Areas] = []
    with disclosure("Areas and tolerances", lambda: found[0].opened()):
        found.append(Areas(step, source, measured, surface))
    return found[0]


def area_of(corners: Any, *, box: bool) -> Area:
    """An area of corners that the page or a user gives.

    Raises
    ------
    InputError for anything but pairs of numbers.
    """
    try:
        places = tuple((float(x), float(y)) for x, y in corners)
    except (TypeError, ValueError):
        raise InputError("area: expected corners as column, row; column, row; …") from None
    if not box:
        return Area(polygon=tuple((round(x, 1), round(y, 1)) for x, y in places))
    columns, rows = zip(*places, strict=True)
    ends = (min(columns), min(rows), max(columns), max(rows))
    left, top, right, bottom = (round(v) for v in ends)
    return Area(box=(left, top, right, bottom))


def corners_of(area: Area) -> list[tuple[float, float]]:
    """The corners of a box or a polygon, in their order around it."""
    if area.box is None:
        return [(float(x), float(y)) for x, y in area.polygon or ()]
    left, top, right, bottom = area.box
    return [(left, top), (right, top), (right, bottom), (left, bottom)]


class Areas:
    """The picture with its areas, the tolerances, and the last verdicts."""

    def __init__(
        self,
        step: Step,
        source: Callable[[], str | None],
        measured: Callable[[], None],
        surface: Callable[[], str],
    ) -> None:
        self._step, self._studio, self._source = step, step.studio, source
        self._measured, self._surface = measured, surface
        self._unfolded = False
        with ui.row().classes("fw-fields"):
            self._shape = ui.toggle(
                {"box": "Box", "polygon": "Polygon"}, value="box", on_change=self._outline
            )
            self._shape.props("no-caps")
            self._name = ui.input("Name of the next area", value=self._next_name()).classes(
                "fw-field"
            )
            for name, action in (("Close the polygon", "close"), ("Undo corner", "back")):
                button = ui.button(name, on_click=partial(self._ask, action))
                button.props("flat no-caps")
                button.bind_visibility_from(self._shape, "value", lambda v: v == "polygon")
            region = ui.button("Area from the region", on_click=partial(self._ask, "region"))
            region.props("flat no-caps")
        ui.label(HOW).classes("fw-quiet fw-words")
        self._picture = ui.element("div").classes("fw-picture").props('role="group"')
        self._picture.props["aria-label"] = "What the camera saw, with the areas that are drawn"
        self._picture.props["data-alt"] = "What the camera saw"
        ui.on("fw-area", self._drawn_area)
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
        self._unfolded = True
        self._fault.set_text(self._studio.recipes.fault)
        self._show_picture()

    def shown(self) -> None:
        """The surface was drawn: show the areas on it as well, once they are asked for."""
        if self._unfolded:
            self._outline()

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
        source = f"/surface/{self._step.session.picture}"
        self._call("load", source, job.result["step"], job.result["size"])
        self._outline()

    def _call(self, function: str, *given: Any) -> None:
        """Call a function of the page's script for areas."""
        words = ", ".join(map(json.dumps, (self._picture.html_id, *given)))
        ui.run_javascript(f"import('/areas.js').then((areas) => areas.{function}({words}))")

    def _ask(self, function: str) -> None:
        self._call(function)

    def _drawn_area(self, event: Any) -> None:
        """An area was drawn or dragged, on the picture or on the surface."""
        self._step.attempt(partial(self._take, event.args))()

    def _take(self, given: Any) -> None:
        what, *rest = given
        if what == "none":
            raise InputError("There is no region: choose Region in the viewer, drag a rectangle.")
        name, corners = rest
        try:
            if what == "new":
                self._add(area_of(corners, box=name == "box"))
            else:
                self._move(str(name), corners)
        except InputError:
            self._outline()
            raise

    def _move(self, name: str, corners: Any) -> None:
        known = self._studio.recipes.shown.areas.get(name)
        if known is None:
            raise InputError(f"{name}: expected an area of the recipe, got none")
        self._replace(name, area_of(corners, box=known.box is not None))

    def _replace(self, name: str, area: Area) -> None:
        self._studio.recipes.move_area(name, area)
        self._changed()
        if self._studio.recipes.shown.within == name:
            self._measured()

    def _add(self, area: Area) -> None:
        self._studio.recipes.set_area(str(self._name.value), area)
        self._name.set_value(self._next_name())
        self._changed()

    def _next_name(self) -> str:
        taken = self._studio.recipes.shown.areas
        return next(n for k in range(1, 10_000) if (n := f"area-{k}") not in taken)

    def _changed(self) -> None:
        self.forget()
        self._outline()
        self._list.refresh()
        self._tolerances.refresh()

    def _outline(self) -> None:
        """Draw the outlines of all areas over the picture and on the surface."""
        found = [
            {"name": name, "box": area.box is not None, "corners": corners_of(area)}
            for name, area in self._studio.recipes.shown.areas.items()
            if area.box is not None or area.polygon is not None
        ]
        shown = self._step.session.shown
        every = 0
        if shown is not None and shown.source == self._source() and shown.result:
            every = shown.result["every"]
        self._call("show", found, self._shape.value, self._surface(), every)

    @ui.refreshable_method
    def _list(self) -> None:
        recipe = self._studio.recipes.shown
        if not recipe.areas:
            return
        for name, area in recipe.areas.items():
            with ui.row().classes("fw-fields"):
                remove = self._step.attempt(partial(self._remove_area, name))
                button = ui.button(f"{name} ✕", on_click=remove)
                button.props("flat dense no-caps")
                named(button, f"Delete {name}")
                self._numbers(name, area)
        with ui.row().classes("items-center"):
            ui.select(
                [EVERYWHERE, *recipe.areas],
                label="Measure only",
                value=recipe.within or EVERYWHERE,
                on_change=lambda event: self._confine(event.value),
            ).classes("fw-field")

    def _numbers(self, name: str, area: Area) -> None:
        """Fields of an area's columns and rows."""
        if area.box is not None:
            fields = [
                number_field(f"{name}: {end}", value=value, low=-MOST_PX, high=MOST_PX, whole=True)
                for end, value in zip(ENDS, area.box, strict=True)
            ]
            for field in fields:
                field.classes("fw-narrow")
                typed = self._step.attempt(partial(self._typed_box, name, fields))
                field.on("change", typed)
        elif area.polygon is not None:
            text = "; ".join(f"{x:g}, {y:g}" for x, y in area.polygon)
            corners = ui.input(f"{name}: column, row; …", value=text).classes("fw-wide")
            typed = self._step.attempt(partial(self._typed_polygon, name, corners))
            corners.on("change", typed)

    def _typed_box(self, name: str, fields: Sequence[ui.number]) -> None:
        left, top, right, bottom = (checked(field) for field in fields)
        if None not in (left, top, right, bottom):
            self._replace(name, Area(box=(int(left), int(top), int(right), int(bottom))))  # type: ignore[arg-type]

    def _typed_polygon(self, name: str, field: ui.input) -> None:
        corners = [pair.split(",") for pair in str(field.value or "").split(";") if pair.strip()]
        self._replace(name, area_of(corners, box=False))

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
                ui.label(f"{one.name}: {_limits(one.low, one.high, one.unit())}")
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
            low, high = _ends(quantity)

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
                share = check["quantity"] in SHARES
                unit = SHARE if share else check["unit"]
                cells = (
                    check["name"],
                    number(check["value"], check["sigma"], unit),
                    UNKNOWN if share else sigma_text(check["sigma"], unit),
                    _limits(check["smallest"], check["largest"], unit),
                    check["verdict"] + why,
                )
                _row("td", cells)


def _ends(quantity: ui.select) -> tuple[ui.number, ui.number]:
    """Fields of the limits, with the unit of the quantity that is chosen."""
    names = "Smallest", "Largest"
    low, high = (ui.number(name).classes("fw-narrow") for name in names)

    def said() -> None:
        chosen = str(quantity.value)
        unit = "0…1" if chosen in SHARES else UNITS[chosen]
        for field, name in zip((low, high), names, strict=True):
            field.props["label"] = f"{name}, {unit}"

    quantity.on_value_change(said)
    said()
    return low, high


def _row(kind: str, texts: Sequence[str]) -> None:
    """A row of a table."""
    with ui.element("tr"):
        for text in texts:
            with ui.element(kind):
                ui.label(text)


def _limits(low: float | None, high: float | None, unit: str) -> str:
    parts = [
        f"{words} {limit(value, unit)}"
        for words, value in (("at least", low), ("at most", high))
        if value is not None
    ]
    return ", ".join(parts)
