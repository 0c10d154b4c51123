"""The live picture, with what helps to aim, to focus and to expose, and live points."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from nicegui import ui

from fringeworks.serving.worker import Job
from fringeworks.studio.bench import LIVE_PICTURE, LIVE_POINTS
from fringeworks.studio.steps.parts import (
    UPDATE_S,
    Step,
    checked,
    described,
    disclosure,
    number,
    work,
)

ROUND_S = 0.1
"""Interval at which new points are polled, s."""


def live_picture(step: Step, *, board: bool = False) -> None:
    """Show what the camera sees; with a board, where it is and what poses are missing."""
    title = "Live picture: saturated pixels are red"
    if board:
        title = "Live picture: corners are green, amber marks what is missing"
    with disclosure(title):
        _Picture(step, board)


class _Picture:
    """Controls, picture, and what is said below it."""

    def __init__(self, step: Step, board: bool) -> None:
        self._step, self._studio, self._board = step, step.studio, board
        self._numbers = itertools.count()
        with ui.row().classes("fw-fields"):
            self._light = ui.select({"grey": "Even light", "fringes": "Fringes"}, value="grey")
            self._light.props('aria-label="Light"').classes("fw-narrow")
            self._level = ui.slider(min=0, max=1, step=0.05, value=1.0).classes("fw-field")
            self._level.props('label aria-label="Grey level that is projected"')
            self._level.bind_visibility_from(self._light, "value", lambda v: v == "grey")
            self._exposure = number("Exposure, ms", low=0.02, high=10_000).classes("fw-narrow")
            ui.button("Start", on_click=step.attempt(self._start)).props("flat no-caps")
            ui.button("Stop", on_click=step.attempt(self._stop)).props("flat no-caps")
            find = step.attempt(lambda: self._studio.find_exposure(step.session))
            ui.button("Find the exposure", on_click=find).props("flat no-caps")
        self._told = ui.label("Brightness and sharpness appear here.").props('role="status"')
        self._of_board = ui.label()
        self._picture = ui.interactive_image(cross=True, events=["mousemove"]).classes("fw-live")
        described(self._picture, "What the camera sees")
        self._under = ui.label()
        self._picture.on_mouse(lambda event: self._under.set_text(self._value(event)))
        ui.timer(UPDATE_S, self._update)
        work(step, (LIVE_PICTURE,), devices=True, endless=True)
        work(step, ("looking for the exposure",), self._found, devices=True)

    def _start(self) -> None:
        self._studio.start_live(
            self._step.session,
            self._light.value,
            float(self._level.value),
            checked(self._exposure),
            board=self._board,
        )

    def _stop(self) -> None:
        self._studio.stop_live(self._step.session)

    def _found(self, job: Job) -> None:
        if isinstance(job.result, float):
            self._exposure.set_value(round(job.result, 3))
            self._told.set_text(f"{job.result:.3g} ms suit this scene. Press Start.")

    def _seen(self) -> dict[str, Any] | None:
        job = self._studio.devices.job
        return job.latest.get("picture") if job and job.name == LIVE_PICTURE else None

    def _update(self) -> None:
        seen, job = self._seen(), self._studio.devices.job
        if seen is None or job is None or job.state != "running":
            return
        self._picture.set_source(f"/live/{next(self._numbers)}")
        focus = f"sharpness {seen['sharpness']:.4f}: turn the camera's lens until it is largest"
        if seen["fringes"] is not None:
            focus = (
                f"contrast of fringes {seen['fringes']:.0%}: turn the projector's lens until it is "
                "largest; the picture is the mean of three frames"
            )
        self._told.set_text(
            f"mean {seen['mean_share']:.0%} of full scale, saturated "
            f"{seen['saturated_share']:.1%}; {seen['advice']}; {focus}"
        )
        self._of_board.set_text(seen.get("board", ""))

    def _value(self, event: Any) -> str:
        """Brightness and modulation under the cursor."""
        seen = self._seen()
        if seen is None:
            return ""
        columns, rows = seen["size"]
        x, y = int(event.image_x), int(event.image_y)
        if not (0 <= x < columns and 0 <= y < rows):
            return ""

        def at(kind: str) -> float:
            return float(np.frombuffer(seen[kind], np.uint8)[y * columns + x]) / 255.0

        place = f"column {x * seen['step']}, row {y * seen['step']}"
        text = f"{place}: {at('brightness'):.0%} of full scale"
        return text if seen["modulation"] is None else f"{text}, modulation {at('modulation'):.1%}"


def live_points(step: Step) -> None:
    """Measure points again and again, and show them as they come."""
    studio = step.studio
    with disclosure("Live points"):
        with ui.row().classes("items-center"):
            begin = step.attempt(lambda: studio.start_points(step.session))
            ui.button("Start live points", on_click=begin).props("flat no-caps")
            stop = step.attempt(lambda: studio.stop_live(step.session))
            ui.button("Stop live points", on_click=stop).props("flat no-caps")
        told = ui.label("The clouds per second appear here.").props('role="status"')
        work(step, (LIVE_POINTS,), devices=True, endless=True)
        mount = ui.element("div").classes("fringe-viewer-mount fw-live-points fw-full")
        shown = {"number": 0}

        def update() -> None:
            job = studio.devices.job
            if job is None or job.name != LIVE_POINTS or job.state != "running":
                return
            if moved := job.latest.get("moved"):
                told.set_text(f"something moves: {moved}")
            cloud = job.latest.get("cloud")
            if cloud is None or cloud["number"] == shown["number"]:
                return
            shown["number"] = cloud["number"]
            told.set_text(cloud["said"])
            ui.run_javascript(f"fringeLive('c{mount.id}', {cloud['number']})")

        ui.timer(ROUND_S, update)
