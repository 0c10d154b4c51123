"""Set up: devices, a live picture, and what they can do together."""

from __future__ import annotations

from nicegui import ui

from fringeworks.files.findings import findings_as_dicts
from fringeworks.serving.worker import Job
from fringeworks.studio.places import Place
from fringeworks.studio.steps.live import live_picture
from fringeworks.studio.steps.parts import Step, devices, place_link, plot, show_findings, work


def build(step: Step) -> None:
    """Build the step."""
    studio = step.studio
    devices(step)
    with ui.row():
        start = step.attempt(lambda: studio.run_setup(step.session))
        ui.button("Set up", on_click=start).props("no-caps")
        find = step.attempt(lambda: studio.look_for_devices(step.session))
        ui.button("Find devices", on_click=find).props("flat no-caps")
    live_picture(step)

    def refresh(job: Job) -> None:
        if job.name == "looking for devices":
            studio.found = job.result
            step.go("set up")
        else:
            findings.refresh()

    work(step, ("set up", "looking for devices"), refresh, devices=True)

    @ui.refreshable
    def findings() -> None:
        if not studio.workspace.setup.is_file():
            return
        found = studio.findings()
        if not found:
            ui.label("No finding: the devices suit each other.")
        place_link("Next: calibrate", Place("calibrate"))
        show_findings({"findings": findings_as_dicts(found)})
        plot(step, "setup.png", "Plots of all tests of the set-up")

    findings()
