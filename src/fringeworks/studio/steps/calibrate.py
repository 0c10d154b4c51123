"""Calibrate: poses of a board, each judged as it is taken, and the rig."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from fringeworks.studio.steps.parts import Step, devices, work
from fringeworks.studio.worker import Job


def build(step: Step) -> None:
    """Build the step."""
    studio = step.studio
    with ui.row().classes("items-end"):
        ui.input("Board").bind_value(studio, "board").classes("w-64").tooltip(
            "Kind and size: chessboard:COLUMNSxROWS:SQUARE_MM, charuco:… or circles:…"
        )
    devices(step)
    with ui.row():
        take = step.attempt(lambda: studio.take_pose(step.session))
        ui.button("Take a pose", on_click=take).props("no-caps")
        ui.button("Judge again", on_click=step.attempt(studio.judge_poses)).props("flat no-caps")
        ui.button("Calibrate", on_click=step.attempt(studio.calibrate)).props("outline no-caps")

    def judged(job: Job) -> None:
        studio.poses = job.result
        poses.refresh()

    work(step, studio.devices, ("calibrate", "judging"), judged)

    @ui.refreshable
    def poses() -> None:
        said = studio.poses
        if said.get("name"):
            text = said["problem"] or f"{said['corners']} corners found"
            ui.label(f"{said['name']}: {text}").props('role="status"')
        if said.get("judgement"):
            ui.label(said["judgement"])
        with ui.row():
            for name in studio.workspace.taken_poses():
                undo = ui.button(f"{name} ✕", on_click=lambda _, n=name: remove(n))
                undo.props(f'flat dense no-caps aria-label="Delete {name}"')

    def remove(name: str) -> None:
        step.attempt(lambda: studio.undo_pose(name))()
        step.attempt(studio.judge_poses)()
        poses.refresh()

    poses()

    def calibrated(job: Job) -> None:
        verdict.refresh(job.result)

    work(step, studio.compute, ("calibrating",), calibrated)

    @ui.refreshable
    def verdict(values: dict[str, Any] | None = None) -> None:
        if not studio.workspace.rig.is_file():
            return
        said = (values or {}).get("verdict", {}).get("text")
        ui.label(said or "There is a rig. Next: scan.").props('role="status"')
        if studio.workspace.rig.with_suffix(".png").is_file():
            stamp = studio.workspace.rig.stat().st_mtime_ns
            picture = ui.image(f"/file/rig.png?{stamp}").classes("w-full max-w-5xl bg-white")
            picture.props('alt="Coverage and residuals of the calibration"')

    verdict()
