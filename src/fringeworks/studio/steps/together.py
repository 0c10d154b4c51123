"""Steps for what one scan cannot show: views of a part that are merged, and several cameras."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui

from fringeworks.serving.worker import Job
from fringeworks.studio.steps.parts import (
    Step,
    checked,
    disclosure,
    empty,
    finding_lines,
    number,
    work,
)

POSES = {
    "turntable": "A turntable turns a board and the part by equal steps",
    "board": "A board lies beside the part and moves with it",
    "shape": "The part's shape: neighbouring views overlap",
}
"""Where the poses of views come from."""
VIEWS = (
    "Scan the part from several sides: as a series above with a turntable step, or scan by scan.",
    "Choose the views, in the order in which they were taken.",
    "Say where their poses come from, and merge.",
)
"""Steps of merging."""
CAMERAS = (
    "Make a folder for each camera. Put its captures of a board into it, one for each pose, under "
    "the same names in all folders.",
    "Calibrate the cameras: the first folder is the first camera.",
    "Choose the captures of a part, one for each camera in the same order, and measure.",
)
"""Steps with several cameras."""


def build(step: Step) -> None:
    """Build both parts."""
    with disclosure("Merge views of a part"):
        _Views(step)
    with disclosure("Measure with two cameras or more"):
        _Cameras(step)


def _steps(lines: tuple[str, ...]) -> None:
    """Numbered steps."""
    with ui.element("ol").classes("fw-words"):
        for line in lines:
            with ui.element("li"):
                ui.label(line)


def _several(names: list[str], label: str, chosen: list[str]) -> ui.select:
    """A field in which several names are chosen, in the order of the clicks."""
    return ui.select(names, value=chosen, label=label, multiple=True).classes("fw-wide")


class _Views:
    """Which views are merged, by what poses."""

    def __init__(self, step: Step) -> None:
        self._step, self._studio = step, step.studio
        captures, series = self._studio.workspace.captures(), self._studio.series
        _steps(VIEWS)
        if len(captures) < 2:
            empty("There are no two captures in this folder yet.")
            return
        taken = [] if series is None else [name for name in series.taken if name in captures]
        self._chosen = _several(captures, "Views", taken if len(taken) > 1 else [])
        self._poses = ui.radio(POSES, value="turntable")
        with ui.row().classes("fw-fields"):
            self._board = ui.input(
                "Board: kind:COLUMNSxROWS:SIZE_MM", value=self._studio.board
            ).classes("fw-wide")
            self._board.bind_visibility_from(self._poses, "value", lambda v: v != "shape")
            self._turn = number("Table step, degrees", low=-180, high=180)
            self._turn.classes("fw-field")
            self._turn.bind_visibility_from(self._poses, "value", lambda v: v == "turntable")
            self._name = ui.input("Name of the part", value="merged").classes("fw-field")
            ui.button("Merge the views", on_click=step.attempt(self._merge)).props("no-caps")
        work(step, ("merging",), self._merged)
        self._said = ui.label().classes("fw-lines").props('role="status"')

    def _merge(self) -> None:
        by_shape = self._poses.value == "shape"
        self._studio.merge_views(
            self._step.session,
            [str(name) for name in self._chosen.value or []],
            "" if by_shape else str(self._board.value or "").strip() or self._studio.board,
            0.0 if by_shape else checked(self._turn) or 0.0,
            str(self._name.value or ""),
            beside=self._poses.value == "board",
        )

    def _merged(self, job: Job) -> None:
        found = job.result
        said = f"{found['points']:,} points of {found['views']} views: {found['file']}."
        self._said.set_text("\n".join([said, *(line for line, _ in finding_lines(found))]))
        self._step.go("look", found["file"])


class _Cameras:
    """The calibration of several cameras, and parts that all of them saw."""

    def __init__(self, step: Step) -> None:
        self._step, self._studio = step, step.studio
        space = self._studio.workspace
        folders = [name for name in space.folders_of_captures() if name != "."]
        _steps(CAMERAS)
        if len(folders) < 2:
            empty("There are no two folders of captures in this folder yet.")
            return
        with ui.row().classes("fw-fields"):
            self._folders = _several(folders, "Poses of each camera", [])
            board = ui.input("Board: kind:COLUMNSxROWS:SIZE_MM").classes("fw-wide")
            board.bind_value(self._studio, "board")
            self._button("Calibrate the cameras", self._calibrate)
        with ui.row().classes("fw-fields"):
            self._captures = _several(space.captures(), "Capture of each camera", [])
            self._name = ui.input("Name of the part", value="part").classes("fw-field")
            self._button("Measure with the cameras", self._measure)
        work(step, ("calibrating the cameras", "measuring with the cameras"), self._ended)
        there = "There is a rig of several cameras." if space.cameras.is_file() else ""
        self._said = ui.label(there).classes("fw-lines").props('role="status"')

    def _button(self, text: str, does: Callable[[], Any]) -> None:
        ui.button(text, on_click=self._step.attempt(does)).props("outline no-caps")

    def _calibrate(self) -> None:
        folders = [str(name) for name in self._folders.value or []]
        self._studio.calibrate_cameras(self._step.session, folders, self._studio.board)

    def _measure(self) -> None:
        captures = [str(name) for name in self._captures.value or []]
        self._studio.measure_cameras(self._step.session, captures, str(self._name.value or ""))

    def _ended(self, job: Job) -> None:
        if "file" in job.result:
            self._step.go("look", job.result["file"])
            return
        lines = [line for line, _ in finding_lines(job.result)]
        self._said.set_text("\n".join(["The cameras are calibrated: cameras.toml.", *lines]))
