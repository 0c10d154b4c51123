"""Scan: the frames of an object, once or as a series with pauses, as on a turntable."""

from __future__ import annotations

from functools import partial
from typing import Any

from nicegui import ui

from fringeworks.studio.steps.parts import Step, devices, work
from fringeworks.studio.worker import Job
from fringeworks.types import InputError


def build(step: Step) -> None:
    """Build the step."""
    _Scan(step)


class _Scan:
    """The settings of a scan, and the scans that were taken."""

    def __init__(self, step: Step) -> None:
        self._step, self._studio = step, step.studio
        self._left = 0
        devices(step)
        with ui.row().classes("items-end"):
            self._name = ui.input("Name", value=self._next()).classes("w-48")
            self._exposures = _whole("Exposures", 8)
            self._average = _whole("Frames averaged", 64)
            self._series = _whole("Scans", 999)
            self._pause = ui.number("Pause before each, s", value=0, min=0, max=3600)
            self._pause.classes("w-40")
        start = step.attempt(self._start)
        ui.button("Scan (space)", on_click=start).props("no-caps")
        ui.keyboard(on_key=lambda event: start() if _pressed(event) else None)
        self._waiting = ui.label().props('role="status"')
        work(step, self._studio.devices, ("scan",), self._ended)
        self._taken()

    def _start(self) -> None:
        """Begin a series; one scan is a series of one."""
        if self._studio.devices.busy or self._left:
            raise InputError("scan: expected no other scan, got one that is running or waiting")
        self._left = int(self._series.value or 1)
        self._wait()

    def _wait(self) -> None:
        """Wait for the pause, in which the object may be turned, and scan."""
        pause_s = float(self._pause.value or 0)
        if pause_s:
            self._waiting.set_text(f"Next scan in {pause_s:g} s: {self._left} left.")
        ui.timer(max(pause_s, 0.01), self._step.attempt(self._scan), once=True)

    def _scan(self) -> None:
        self._waiting.set_text("")
        self._left -= 1
        try:
            self._studio.scan(
                self._step.session,
                str(self._name.value),
                exposures=int(self._exposures.value or 1),
                average=int(self._average.value or 1),
            )
        except InputError:
            self._left = 0
            raise

    def _ended(self, job: Job) -> None:
        self._name.set_value(self._next())
        if self._left == 0 and self._studio.workspace.rig.is_file():
            self._step.attempt(partial(self._look, job.result["capture"]))()
            return
        self._taken.refresh()
        if self._left:
            self._wait()

    def _look(self, capture: str) -> None:
        self._studio.look(self._step.session, capture, "windowed", {})
        self._step.go("look")

    @ui.refreshable_method
    def _taken(self) -> None:
        for capture in self._studio.workspace.captures():
            with ui.row().classes("items-center"):
                ui.label(capture)
                show = self._step.attempt(partial(self._look, capture))
                ui.button("Look", on_click=show).props("flat dense no-caps")

    def _next(self) -> str:
        """The first name of a series that is free."""
        taken = self._studio.workspace.captures()
        return next(n for k in range(1, 10_000) if (n := f"scan-{k:03d}") not in taken)


def _whole(label: str, most: int) -> Any:
    """A field for a whole number."""
    return ui.number(label, value=1, min=1, max=most, precision=0).classes("w-36")


def _pressed(event: object) -> bool:
    """Whether the space bar went down, outside of a field."""
    action, key = getattr(event, "action", None), getattr(event, "key", None)
    return bool(getattr(action, "keydown", False) and getattr(key, "space", False))
