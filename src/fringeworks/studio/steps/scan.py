"""Scan: the frames of an object, once or as a series with pauses, as on a turntable."""

from __future__ import annotations

from functools import partial
from typing import Any

from nicegui import ui

from fringeworks.scan.bench import Take
from fringeworks.studio.places import Place
from fringeworks.studio.steps import together
from fringeworks.studio.steps.live import live_points
from fringeworks.studio.steps.parts import (
    UPDATE_S,
    Step,
    checked,
    devices,
    heading,
    number,
    place_link,
    work,
)

LATEST = 8
"""Captures that are listed below a scan; the others are in the list of captures."""


def build(step: Step) -> None:
    """Build the step."""
    _Scan(step)


class _Scan:
    """The settings of a scan, and the scans that were taken."""

    def __init__(self, step: Step) -> None:
        self._step, self._studio = step, step.studio
        self._seen = self._studio.series
        devices(step)
        with ui.row().classes("fw-fields"):
            self._name = ui.input("Name", value=self._next()).classes("fw-field")
            self._exposures = _whole("Exposures", 8)
            self._average = _whole("Frames averaged", 64)
            self._series = _whole("Scans", 999)
            self._turn = number("Turntable step, degrees", value=0, low=0, high=180)
            self._turn.classes("fw-field")
            self._pause = number("Pause before each scan, s", value=0, low=0, high=3600)
            self._pause.classes("fw-field")
        start = step.attempt(self._start)
        with ui.row():
            self._auto = ui.checkbox("Choose the exposure first")
            self._fast = ui.checkbox("Fast, at the delay of the set-up")
            self._resume = ui.checkbox("Resume an interrupted scan")
        with ui.row():
            ui.button("Scan (space)", on_click=start).props("no-caps")
            stop = step.attempt(lambda: self._studio.stop_series(step.session))
            ui.button("Stop the series", on_click=stop).props("flat no-caps")
        ui.keyboard(on_key=lambda event: start() if _pressed(event) else None)
        self._waiting = ui.label().props('role="status"')
        self._problem = ui.label().classes("fw-bad fw-lines").props('role="alert"')
        work(step, ("scan",), devices=True)
        ui.timer(UPDATE_S, self._update)
        self._taken()
        together.build(step)
        live_points(step)

    def _start(self) -> None:
        """Begin a series; one scan is a series of one."""
        name, count = str(self._name.value), int(checked(self._series) or 1)
        turn = checked(self._turn) or 0.0
        self._studio.start_series(
            self._step.session,
            series_names(name, count, turn),
            checked(self._pause) or 0.0,
            Take(
                auto_exposure=bool(self._auto.value),
                hdr=int(checked(self._exposures) or 1),
                average=int(checked(self._average) or 1),
                fast=bool(self._fast.value),
                resume=bool(self._resume.value),
            ),
            turn,
        )

    def _update(self) -> None:
        """Say how far the series is, and look at a single scan when it is there."""
        series = self._studio.series
        if series is None:
            return
        if series.running and series.waiting_s:
            self._waiting.set_text(f"Next scan in {series.waiting_s:.0f} s: {series.left} left.")
        elif series.running:
            self._waiting.set_text(f"{series.left} left." if len(series.names) > 1 else "")
        elif series is not self._seen:
            self._seen = series
            self._waiting.set_text("")
            self._problem.set_text(series.problem)
            single = len(series.names) == 1 and series.taken
            if single and self._studio.workspace.rig.is_file():
                self._step.attempt(partial(self._look, series.taken[0]))()
                return
            self._name.set_value(self._next())
            self._taken.refresh()

    def _look(self, capture: str) -> None:
        self._step.go("look", capture)

    @ui.refreshable_method
    def _taken(self) -> None:
        captures = self._studio.workspace.captures()
        if not captures:
            return
        heading("Latest captures")
        for capture in captures[-LATEST:]:
            place_link(capture, Place("look", capture))
        if len(captures) > LATEST:
            place_link(f"All {len(captures)} captures", Place("captures"))

    def _next(self) -> str:
        """The first name that is free."""
        root = self._studio.workspace.root
        names = (f"scan-{k:03d}" for k in range(1, 100_000))
        return next(n for n in names if not [*root.glob(f"{n}*")])


def series_names(name: str, count: int, turn_deg: float) -> list[str]:
    """Return the names of a series: by their angle on a turntable, or numbered."""
    if count == 1:
        return [name]
    if turn_deg:
        return [f"{name}-{k * turn_deg:05.1f}deg" for k in range(count)]
    return [f"{name}-{k:03d}" for k in range(1, count + 1)]


def _whole(label: str, most: int) -> Any:
    """A field for a whole number."""
    return number(label, value=1, low=1, high=most, whole=True).classes("fw-narrow")


def _pressed(event: object) -> bool:
    """Whether the space bar went down, outside of a field."""
    action, key = getattr(event, "action", None), getattr(event, "key", None)
    return bool(getattr(action, "keydown", False) and getattr(key, "space", False))
