"""Calibrate: poses of a board, each judged as it is taken, and the rig."""

from __future__ import annotations

from functools import partial

from nicegui import ui

from fringeworks.serving.worker import Job
from fringeworks.studio.places import Place
from fringeworks.studio.steps.live import live_picture
from fringeworks.studio.steps.parts import (
    Step,
    devices,
    finding_lines,
    named,
    place_link,
    plot,
    show_findings,
    work,
)


def build(step: Step) -> None:
    """Build the step."""
    _Calibrate(step)


class _Calibrate:
    """Buttons, the poses so far, and the verdict on the rig."""

    def __init__(self, step: Step) -> None:
        self._step, self._studio = step, step.studio
        with ui.row().classes("fw-fields"):
            board = ui.input("Board: kind:COLUMNSxROWS:SIZE_MM").classes("fw-wide")
            board.bind_value(self._studio, "board")
            draw = step.attempt(partial(self._studio.print_board, step.session))
            ui.button("Board as PDF", on_click=draw).props("flat no-caps")
        devices(step)
        live_picture(step, board=True)
        with ui.row():
            take = step.attempt(partial(self._studio.take_pose, step.session))
            ui.button("Take a pose", on_click=take).props("no-caps")
            judge = step.attempt(partial(self._studio.judge_poses, step.session))
            ui.button("Judge again", on_click=judge).props("flat no-caps")
            calibrate = step.attempt(partial(self._studio.calibrate, step.session))
            ui.button("Calibrate", on_click=calibrate).props("outline no-caps")
            check = step.attempt(partial(self._studio.check_rig, step.session))
            ui.button("Check the rig", on_click=check).props("flat no-caps")
        work(step, ("calibrate", "judging"), self._judged, devices=True)
        self._poses()
        work(step, ("calibrating", "drawing the board"), self._calibrated)
        work(step, ("checking the rig",), self._checked, devices=True)
        self._drift = ui.label().classes("fw-lines").props('role="status"')
        self._verdict()

    def _checked(self, job: Job) -> None:
        lines = [job.result["text"], *(line for line, _ in finding_lines(job.result))]
        self._drift.set_text("\n".join(lines))

    def _judged(self, job: Job) -> None:
        self._studio.poses = job.result
        self._poses.refresh()

    def _calibrated(self, job: Job) -> None:
        if job.name == "drawing the board":
            ui.download(f"/file/{job.result}", job.result)
        else:
            self._studio.verdict = job.result
            self._verdict.refresh()

    @ui.refreshable_method
    def _poses(self) -> None:
        said = self._studio.poses
        if said.get("name"):
            text = said["few"] or f"{said['name']}: {said['corners']} corners found"
            if said["problem"]:
                text = f"{said['problem']}. The next pose takes its place."
            ui.label(text).props('role="status"')
        if said.get("judgement") and not self._studio.calibrated_with_all():
            ui.label(said["judgement"])
        with ui.row():
            for name in self._studio.workspace.taken_poses():
                undo = ui.button(f"{name} ✕", on_click=partial(self._remove, name))
                undo.props("flat dense no-caps")
                named(undo, f"Delete {name}")

    def _remove(self, name: str) -> None:
        self._step.attempt(partial(self._studio.undo_pose, name))()
        self._step.attempt(partial(self._studio.judge_poses, self._step.session))()
        self._poses.refresh()

    @ui.refreshable_method
    def _verdict(self) -> None:
        rig = self._studio.workspace.rig
        if not rig.is_file():
            return
        values = self._studio.verdict
        said = values.get("verdict", {}).get("text", "There is a rig.")
        ui.label(said).props('role="status"')
        show_findings(values)
        warned = any(warns for _, warns in finding_lines(values))
        words = "Scan with this rig; what is said above would make it better"
        place_link(words if warned else "Next: scan", Place("scan"))
        plot(self._step, "rig.png", "Coverage and residuals of the calibration")
