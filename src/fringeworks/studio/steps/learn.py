"""Learn: errors of each method on virtual scenes, and the dissertation's figures."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from fringeworks.pair.analyse import methods
from fringeworks.serving.worker import Job
from fringeworks.studio.learning import BODIES, PAIRS, SLIDERS, straightens
from fringeworks.studio.steps.parts import Step, disclosure, work
from fringeworks.types.numbers import number, percent

PAPER_PX = (200, 300, 500, 1000)
"""Sides of the dissertation's scenes; the last one is its own."""


STRAIGHTEN = "Straighten γ of frames without noise, as by default"
"""What the box beside methods that straighten the response says."""


def build(step: Step) -> None:
    """Build the step."""
    _Learn(step)
    _dissertation(step)


class _Learn:
    """The settings of a trial, and its surface."""

    def __init__(self, step: Step) -> None:
        self._step, self._studio, self._session = step, step.studio, step.session
        self._sliders: dict[str, Any] = {}
        with ui.row().classes("fw-fields"):
            self._experiment = ui.select(
                list(BODIES), value=next(iter(BODIES)), label="Experiment", on_change=self._offer
            ).classes("fw-field")
            self._body = ui.select([], label="Body").classes("fw-narrow")
            names = list(methods())
            self._method = ui.select(
                names, value="windowed", label="Method", on_change=self._offer
            ).classes("fw-field")
            self._painted = ui.checkbox("Painted")
            self._straighten = ui.checkbox(STRAIGHTEN, value=True)
        self._settings = ui.element("div").classes("fw-sliders")
        self._offer()
        ui.button("Try", on_click=step.attempt(self._begin)).props("no-caps")
        work(step, ("trying",), self._tried)
        self._told = ui.label().props('role="status"')
        element = ui.element("div").classes("fringe-viewer-mount fw-full")
        self._mount = f"c{element.id}"
        ui.timer(0.1, self._show, once=True)

    def _offer(self) -> None:
        """Bodies and sliders of the chosen experiment."""
        experiment = self._experiment.value
        bodies = list(BODIES[experiment])
        kept = self._body.value if self._body.value in bodies else bodies[0]
        self._body.set_options(bodies, value=kept)
        self._method.set_visibility(experiment in PAIRS)
        self._painted.set_visibility(experiment == "two frames, ideal")
        self._straighten.set_visibility(self._straightens())
        before = {key: slider.value for key, slider in self._sliders.items()}
        self._sliders = {}
        self._settings.clear()
        with self._settings:
            for key, one in SLIDERS.items():
                if experiment not in one.experiments:
                    continue
                ui.label(one.name)
                slider = ui.slider(
                    min=one.low, max=one.high, step=one.step, value=before.get(key, one.first)
                )
                slider.props(f'aria-label="{one.name}"')
                ui.label().bind_text_from(slider, "value", lambda v: f"{v:g}")
                self._sliders[key] = slider

    def _straightens(self) -> bool:
        """Whether the chosen method straightens the response."""
        ideal = self._experiment.value == "two frames, ideal"
        return ideal and straightens(self._method.value)

    def _begin(self) -> None:
        settings: dict[str, Any] = {key: slider.value for key, slider in self._sliders.items()}
        for key in ("fringes", "steps"):
            if key in settings:
                settings[key] = int(settings[key])
        if self._experiment.value == "two frames, ideal":
            settings["painted"] = self._painted.value
        if self._straightens():
            settings["straighten"] = self._straighten.value
        self._studio.learn(
            self._session, self._experiment.value, self._body.value, self._method.value, settings
        )

    def _tried(self, job: Job) -> None:
        self._session.trial = job.result
        self._show()

    def _show(self) -> None:
        """Show the last trial."""
        found = self._session.trial
        if found is None:
            return
        ui.run_javascript(f"fringeShow('{self._mount}', [{self._session.tried}])")
        unit = found["unit"]
        self._told.set_text(
            f"{found['method']}: mean error {number(found['mean'], unit=unit)}, largest "
            f"{number(found['largest'], unit=unit)}, {percent(found['failed'])} without a value. "
            "The layer Deviation is the true error."
        )


def _dissertation(step: Step) -> None:
    """The figures of the dissertation's chapter 4, made again."""
    studio = step.studio
    with disclosure("The dissertation's figures and its table of errors"):
        with ui.row().classes("fw-fields"):
            size = ui.select(list(PAPER_PX), value=300, label="Side of the scenes, px")
            size.classes("fw-field")
            draw = step.attempt(lambda: studio.draw_figures(step.session, int(size.value)))
            ui.button("Draw them", on_click=draw).props("no-caps")

        def drawn(_: Job) -> None:
            figures.refresh()

        work(step, ("the dissertation",), drawn)

        @ui.refreshable
        def figures() -> None:
            names = studio.workspace.figures()
            if not names:
                return
            ui.link("The chapter as a page", studio.figure_address("chapter4.html"), new_tab=True)
            with ui.row():
                for name in names:
                    with ui.column().classes("fw-close"):
                        caption = name.removesuffix(".svg").replace("_", " ")
                        picture = ui.image(studio.figure_address(name))
                        picture.classes("fw-wide").props["alt"] = caption
                        ui.label(caption).classes("fw-quiet")

        figures()
