"""What steps are built from: work with its progress, refusals in words, figures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from nicegui import ui

from fringeworks.devices.bench import POSES, SCENES
from fringeworks.files.findings import finding_from_dict
from fringeworks.studio.bench import VIRTUAL
from fringeworks.studio.session import Session
from fringeworks.studio.state import Studio
from fringeworks.studio.worker import Job
from fringeworks.types import InputError

UPDATE_S = 0.25
"""Interval at which work is polled, s."""
SEEN = [*SCENES, *(f"board-{k}" for k in range(POSES))]
"""What a virtual camera can look at."""


@dataclass(frozen=True)
class Step:
    """What the page hands to a step."""

    studio: Studio
    session: Session
    go: Callable[[str], None]
    """Show another step."""

    def attempt(self, action: Callable[[], Any]) -> Callable[[], None]:
        """Return a handler that says why something was refused."""

        def handler() -> None:
            try:
                action()
            except InputError as problem:
                ui.notify(
                    "\n".join(problem.lines),
                    type="warning",
                    multi_line=True,
                    timeout=10_000,
                    textColor="white",
                )

        return handler


def work(
    step: Step,
    names: tuple[str, ...],
    done: Callable[[Job], None] | None = None,
    *,
    devices: bool = False,
    endless: bool = False,
) -> None:
    """Show how far a visitor's computation is, or the work of the devices, whoever began it.

    Parameters
    ----------
    step : Step
    names : tuple of str
        Beginnings of the names of work that this place shows.
    done : callable, optional
        Called once when such work has ended well.
    devices : bool
        Whether it is work of the devices.
    endless : bool
        Whether it goes on until it is stopped; then only problems are shown.
    """
    studio = step.studio

    def present() -> Job | None:
        if not devices:
            return step.session.job(names)
        job = studio.devices.job
        return job if job is not None and job.name.startswith(names) else None

    first = present()
    told = {"ended": first if first is not None and not first.open else None}
    with ui.column().classes("w-full gap-1") as box:
        label = ui.label().props('role="status"')
        bar = ui.linear_progress(0.0, show_value=False)
        bar.props('instant-feedback aria-label="progress"')
        worker = studio.devices if devices else studio.compute
        cancel = ui.button("Cancel", on_click=lambda: worker.cancel(present()))
        cancel.props("flat dense no-caps")
    problem = ui.label().classes("text-negative whitespace-pre-line").props('role="alert"')

    def update() -> None:
        job = present()
        box.set_visibility(job is not None and job.open and not endless)
        cancel.set_visibility(not devices or studio.holds(step.session))
        problem.set_visibility(job is not None and job.state in ("failed", "cancelled"))
        if job is None:
            return
        label.set_text(_progress(job))
        bar.set_value(job.share)
        problem.set_text("Cancelled." if job.state == "cancelled" else job.problem)
        if job.state == "done" and told["ended"] is not job:
            told["ended"] = job
            if done is not None:
                done(job)

    ui.timer(UPDATE_S, update)
    update()


def _progress(job: Job) -> str:
    if job.state == "waiting":
        return f"{job.name}: waits for the work before it"
    left = "" if job.left_s is None else f", about {job.left_s:.0f} s left"
    count = f" ({job.steps} of {job.total})" if job.total else ""
    return f"{job.name}: {job.label}{count}{left}"


def finding_lines(figures: dict[str, Any]) -> list[tuple[str, bool]]:
    """The findings of a result in a line each, and whether it is more than a note."""
    found = map(finding_from_dict, figures.get("findings", []))
    return [(finding.line, bool(finding.rank)) for finding in found]


def show_findings(figures: dict[str, Any]) -> None:
    """Show the findings of a result."""
    for line, warns in finding_lines(figures):
        ui.label(line).classes("text-warning" if warns else "opacity-80")


def devices(step: Step) -> None:
    """Choose projector and camera; for the virtual ones, what they look at."""
    studio = step.studio
    with ui.row().classes("items-end"):
        for role in ("projector", "camera"):
            words = {VIRTUAL, getattr(studio, role), *studio.found[role == "camera"]}
            field = ui.select(
                sorted(words),
                label=role.capitalize(),
                with_input=True,
                new_value_mode="add-unique",
                value=getattr(studio, role),
            )
            field.classes("w-56").bind_value(studio, role)
        scene = ui.select(SEEN, label="Virtual scene").classes("w-40")
        scene.bind_value(studio, "scene")
        scene.bind_visibility_from(studio, "camera", lambda words: words == VIRTUAL)


def named(button: ui.button, name: str) -> None:
    """Give a button a name for those who do not see it.

    Names come from files: in a text of properties, some would be taken for code.
    """
    button.props["aria-label"] = name


def figures(values: dict[str, Any], names: dict[str, str]) -> None:
    """Show single figures with their names."""
    with ui.grid(columns="max-content auto").classes("gap-x-6 gap-y-0"):
        for key, name in names.items():
            value = values.get(key)
            if value is None:
                continue
            ui.label(name).classes("opacity-80")
            ui.label(f"{value:.4g}" if isinstance(value, float) else str(value))
