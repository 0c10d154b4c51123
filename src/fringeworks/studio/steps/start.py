"""Start: a virtual part to try, or the next step with own devices."""

from __future__ import annotations

from nicegui import ui

from fringeworks.files.pair import CAPTURE_FILE
from fringeworks.studio.places import Place
from fringeworks.studio.steps.parts import UPDATE_S, Step, empty, place_link
from fringeworks.studio.tour import PART, Stage, Tour

SIGNS = {"to do": "○", "running": "…", "good": "✓", "look here": "!"}
"""Signs of the stages of the virtual part."""
NEXT = (
    ("set up", "Set up: find out what projector and camera can do."),
    ("calibrate", "Calibrate: show a board from several sides."),
    ("scan", "Scan: take the frames of a part."),
)
"""What comes next, by the step that is not done yet."""
LATEST = 5
"""Captures that are offered to look at; the others are in the list."""


def build(step: Step) -> None:
    """Build the step."""
    with ui.element("div").classes("fw-cards"):
        _Trial(step)
        with ui.element("section").classes("fw-card"):
            _own(step)


def _own(step: Step) -> None:
    """The next step with own devices, and the latest captures."""
    studio = step.studio
    ui.label("Measure with your devices").classes("fw-h2").props('role="heading" aria-level="2"')
    states = studio.step_states()
    name, words = next((one for one in NEXT if states[one[0]] != "good"), NEXT[-1])
    ui.label("A projector, a camera and a printed board are all that is needed.")
    place_link(words, Place(name))
    captures = [name for name in studio.workspace.captures() if name != PART]
    if not captures:
        empty("There is no capture of a part of yours in this folder yet.")
        return
    ui.label("Captures in this folder").classes("fw-quiet")
    for name in captures[-LATEST:]:
        place_link(name, Place("look", name))
    if len(captures) > LATEST:
        place_link(f"All {len(captures)} captures", Place("captures"))


class _Trial:
    """The virtual part: what happens, how far it is, and what comes next."""

    def __init__(self, step: Step) -> None:
        self._step, self._studio = step, step.studio
        self._told: tuple[object, ...] = ()
        self._seen = self._studio.tour if self._ended else None
        with ui.element("section").classes("fw-card"):
            ui.label("Try with a virtual part").classes("fw-h2").props(
                'role="heading" aria-level="2"'
            )
            ui.label(
                "Without any hardware: a virtual projector and camera are set up and calibrated, a "
                "part is scanned, and its surface opens. It takes about a minute."
            )
            with ui.row():
                begin = step.attempt(lambda: self._studio.start_tour(step.session))
                self._begin = ui.button("Try with a virtual part", on_click=begin)
                self._begin.props("no-caps")
                self._stop = ui.button("Stop", on_click=step.attempt(self._ended_by_hand))
                self._stop.props("flat no-caps")
                own = step.attempt(self._own_devices)
                self._own = ui.button("Now with your devices", on_click=own)
                self._own.props("no-caps outline")
            self._stages()
            self._now = ui.label().classes("fw-quiet")
        ui.timer(UPDATE_S, self._update)
        self._update()

    @property
    def _ended(self) -> bool:
        tour = self._studio.tour
        return tour is not None and not tour.running

    def _ended_by_hand(self) -> None:
        self._studio.hold(self._step.session)
        if self._studio.tour is not None:
            self._studio.tour.stop()

    def _own_devices(self) -> None:
        self._studio.end_tour(self._step.session)
        self._step.go("set up")

    def _update(self) -> None:
        tour = self._studio.tour
        if tour is not None and tour.finished and tour is not self._seen:
            self._seen = tour
            if tour.session is self._step.session:
                self._step.go("look", PART)
                return
        there = (self._studio.workspace.root / PART / CAPTURE_FILE).is_file()
        running = tour is not None and tour.running
        self._begin.set_visibility(not running)
        self._stop.set_visibility(running)
        self._own.set_visibility(there and not running)
        self._now.set_text(tour.now if tour is not None and running else "")
        told = () if tour is None else (tour.problem, tour.running, *map(repr, _all(tour)))
        if told != self._told:
            self._told = told
            self._stages.refresh()

    @ui.refreshable_method
    def _stages(self) -> None:
        tour = self._studio.tour
        if tour is None:
            return
        with ui.element("div").classes("fw-stages").props('role="status"'):
            for stage in _all(tour):
                ui.label(SIGNS[stage.state]).classes("fw-mark")
                with ui.column().classes("fw-close"):
                    ui.label(stage.title).classes("fw-good" if stage.state == "good" else "")
                    if stage.state != "to do":
                        ui.label(stage.words).classes("fw-quiet")
                    if stage.said:
                        ui.label(stage.said)
        if tour.problem:
            ui.label(tour.problem).classes("fw-bad fw-lines").props('role="alert"')
        if tour.finished:
            place_link("Look at the surface", Place("look", PART))


def _all(tour: Tour) -> list[Stage]:
    return list(tour.stages.values())
