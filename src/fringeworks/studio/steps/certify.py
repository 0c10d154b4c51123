"""Certify: the certificate of the scanner, studies of the gauge, and the watch over the rig."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from nicegui import ui

from fringeworks.studio.places import Place
from fringeworks.studio.steps.parts import (
    Step,
    checked,
    disclosure,
    empty,
    heading,
    number,
    place_link,
    work,
)
from fringeworks.studio.steps.telling import tell
from fringeworks.studio.workspace import CHECKS

HOW = (
    "An acceptance test after VDI/VDE 2634: a ball bar and a plane with known sizes are scanned in "
    "planned positions of the volume. The certificate states the largest errors against the limits."
)
"""What the certificate is."""
NO_TEST = (
    'Put an acceptance test into the folder: a .toml file with kind = "acceptance-test", the '
    "volume, the artefacts, the limits, and the scans."
)
"""What to do without a test."""
TESTS, STUDIES, RIGS = (
    ("positions of the test", "certificate"),
    ("gauge study",),
    ("watching the rig", "charting the checks"),
)
"""Names of the work of each part of the page."""


def build(step: Step) -> None:
    """Build the step."""
    _certificate(step)
    with disclosure("Is the gauge good enough for a tolerance?"):
        _study(step)
    with disclosure("Has the rig moved?"):
        _rig(step)


def _certificate(step: Step) -> None:
    studio = step.studio
    heading("Certificate")
    ui.label(HOW).classes("fw-words")
    tests = studio.workspace.of_kind("acceptance-test")
    if not tests:
        empty(NO_TEST)
    else:
        with ui.row().classes("fw-fields"):
            test = ui.select(tests, value=tests[0], label="Acceptance test").classes("fw-wide")
            positions = lambda: studio.list_positions(step.session, _of(test))  # noqa: E731
            _button(step, "List the positions", positions)
            for name, suffix in (("Certify", ".html"), ("Certify, as PDF", ".pdf")):
                _button(step, name, partial(_certify, step, test, suffix))
    _results(step, TESTS)


def _certify(step: Step, test: ui.select, suffix: str) -> None:
    step.studio.certify(step.session, _of(test), suffix)


def _study(step: Step) -> None:
    studio = step.studio
    tables = studio.workspace.tables()
    if not tables:
        empty("Put a table (CSV) of trials into the folder, or judge a batch of repeated scans.")
        return
    with ui.row().classes("fw-fields"):
        table = ui.select(tables, value=tables[0], label="Table").classes("fw-wide")
        quantity = ui.input("Column of the values", value="value").classes("fw-field")
        width = number("Width of the tolerance", low=1e-9, high=1e9).classes("fw-field")
        reference = ui.input("Calibrated value, or its column").classes("fw-wide")

        def judge() -> None:
            column, known = (str(field.value or "").strip() for field in (quantity, reference))
            studio.study(step.session, _of(table), column, checked(width), known)

        _button(step, "Judge the gauge", judge)
    ui.label(
        "Trials of several parts give repeatability and reproducibility. Trials of one part with a "
        "calibrated value give Cg and Cgk. A column of calibrated values gives linearity."
    ).classes("fw-quiet fw-words")
    _results(step, STUDIES)


def _rig(step: Step) -> None:
    studio = step.studio
    ui.label(
        "Scans of parts show, without a board, whether projector or camera has moved since the "
        "calibration. The scans need stripes along both axes."
    ).classes("fw-words")
    with ui.row().classes("fw-fields"):
        _button(
            step,
            "Watch by all scans",
            lambda: studio.watch_rig(step.session, studio.workspace.captures()),
        )
        if (studio.workspace.root / CHECKS).is_file():
            _button(step, "Chart all checks", lambda: studio.chart_checks(step.session))
        place_link("Check the rig with a board", Place("calibrate"))
    _results(step, RIGS)


def _results(step: Step, names: tuple[str, ...]) -> None:
    """The work of a part of the page, and what came of it last."""

    @ui.refreshable
    def found() -> None:
        result = step.session.proofs.get(names)
        if result is not None:
            tell(step, result)

    def arrived(job: Any) -> None:
        step.session.proofs[names] = job.result
        found.refresh()

    work(step, names, arrived)
    found()


def _button(step: Step, text: str, does: Callable[[], Any]) -> None:
    ui.button(text, on_click=step.attempt(does)).props("outline no-caps")


def _of(field: ui.select) -> str:
    return str(field.value or "")
