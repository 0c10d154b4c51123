"""What steps are built from: work with its progress, refusals in words, figures."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from nicegui import ui

from fringeworks.devices.bench import SCENES
from fringeworks.files.findings import finding_from_dict
from fringeworks.serving.worker import Job
from fringeworks.studio.bench import BY_ITSELF, VIRTUAL
from fringeworks.studio.places import Place
from fringeworks.studio.plots import DARK_FOLDER
from fringeworks.studio.session import Session
from fringeworks.studio.state import Studio
from fringeworks.studio.words import step_words
from fringeworks.types import InputError, numbers

UPDATE_S = 0.25
"""Interval at which work is polled, s."""
SEEN = {BY_ITSELF: "moves by itself", **{name: name for name in SCENES}}
"""What a virtual camera can look at, and how it is called."""


@dataclass(frozen=True)
class Step:
    """What the page hands to a step."""

    studio: Studio
    session: Session
    go: Callable[..., None]
    """Show another step, and in *Look* a source."""
    place: Place
    """The address that is shown."""
    move: Callable[..., None]
    """Give the page the address of what it shows."""

    def attempt(self, action: Callable[[], Any]) -> Callable[[], None]:
        """Return a handler that says why something was refused."""

        def handler() -> None:
            try:
                action()
            except InputError as problem:
                say("\n".join(problem.lines), warns=True)

        return handler


ARROW = "M7 10l5 5 5-5z"
"""Path of the arrow of lists: without it, the page would load a font of icons."""
ui.select.default_props(f'dropdown-icon="{ARROW}"')
SHOWN_S = 0.1
"""Time until what was built is on the page, s."""
SAID_MS = 10_000
"""Time for which a refusal stays on the page, ms."""


def say(text: str, *, warns: bool = False) -> None:
    """Say something at the page's edge, for a while."""
    if warns:
        ui.notify(text, color="warning", multi_line=True, timeout=SAID_MS, textColor="white")
    else:
        ui.notify(text, multi_line=True)


def heading(text: str) -> None:
    """A heading within a step."""
    ui.label(text).classes("fw-h2").props('role="heading" aria-level="2"')


def empty(text: str) -> None:
    """Say why there is nothing here yet, and what brings something."""
    ui.label(text).classes("fw-empty")


def place_link(text: str, place: Place) -> ui.link:
    """A link to a place of the studio."""
    link = ui.link(text, place.address)
    link.props["data-place"] = place.address
    return link


@contextmanager
def disclosure(title: str, opened: Callable[[], Any] | None = None) -> Iterator[None]:
    """A part of the page that is folded away at first; ``opened`` is called when it unfolds."""
    with ui.element("details").classes("fw-more") as box:
        with ui.element("summary"):
            ui.label(title)
        if opened is not None:
            box.on(
                "toggle",
                lambda event: opened() if event.args else None,
                js_handler="(event) => emit(event.target.open)",
            )
        with ui.column():
            yield


def plot(step: Step, name: str, alt: str) -> None:
    """Show a plot of the folder in the page's colours; narrow pages scroll it."""
    root = step.studio.workspace.root
    path, dark = root / name, root / DARK_FOLDER / name
    if not path.is_file():
        return
    stamp = path.stat().st_mtime_ns
    frame = ui.element("div").classes("fw-scroll")
    frame.props('tabindex=0 role="region"')
    frame.props["aria-label"] = alt
    with frame, ui.element("picture"):
        if dark.is_file():
            source = ui.element("source").props('media="(prefers-color-scheme: dark)"')
            source.props["srcset"] = f"/file/{DARK_FOLDER}/{name}?{stamp}"
        picture = ui.element("img").classes("fw-figure")
        picture.props["alt"] = alt
        picture.props["src"] = f"/file/{name}?{stamp}"
    ui.link("Open the picture in a page of its own", f"/file/{name}?{stamp}", new_tab=True)


def described(picture: ui.interactive_image, words: str) -> None:
    """Say what a picture shows to those who do not see it."""
    script = f"getElement({picture.id}).$refs.img.alt = {json.dumps(words)}"
    ui.timer(SHOWN_S, lambda: ui.run_javascript(script), once=True)


def commands(step: Step) -> None:
    """The commands and the Python that do what was done in this folder."""
    done = step.studio.log.done
    shell = "\n".join(command.shell for command in done if command.shell)
    python = "\n".join(["import fringeworks as fw", *(command.python for command in done)])
    for name, does, text in (("Commands", "do", shell), ("Python", "does", python)):
        heading(f"{name} that {does} the same")
        ui.label(text).classes("fw-code")
        copy = ui.button("Copy", on_click=lambda _, t=text: ui.clipboard.write(t))
        copy.props(f'flat dense no-caps aria-label="Copy the {name}"')


def number(
    label: str, *, value: float | None = None, low: float, high: float, whole: bool = False
) -> ui.number:
    """A field for a number; one that is out of range is said beside it, and not changed."""

    def fits(given: float | None) -> str | None:
        if given is None:
            return None
        if whole and given != int(given):
            return "a whole number"
        return None if low <= given <= high else f"{low:g} to {high:g}"

    return ui.number(label, value=value, validation=fits)


def checked(field: ui.number) -> float | None:
    """The value of a field of a number.

    Raises
    ------
    InputError for one that is out of range.
    """
    if not field.validate():
        raise InputError(f"{field.label}: expected {field.error}, got {field.value:g}")
    return None if field.value is None else float(field.value)


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
    with ui.column().classes("fw-full fw-close") as box:
        label = ui.label().props('role="status"')
        bar = ui.linear_progress(0.0, show_value=False)
        bar.props('instant-feedback aria-label="progress"')
        worker = studio.devices if devices else studio.compute
        cancel = ui.button("Cancel", on_click=lambda: worker.cancel(present()))
        cancel.props("flat dense no-caps")
    problem = ui.label().classes("fw-bad fw-lines").props('role="alert"')

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
    words = step_words(job)
    count = f" ({job.steps} of {job.total})" if job.total and words == job.label else ""
    return f"{job.name}: {words}{count}{left}"


def finding_lines(figures: dict[str, Any]) -> list[tuple[str, bool]]:
    """The findings of a result in a line each, and whether it is more than a note."""
    found = map(finding_from_dict, figures.get("findings", []))
    return [(finding.line, bool(finding.rank)) for finding in found]


def show_findings(figures: dict[str, Any]) -> None:
    """Show the findings of a result."""
    for line, warns in finding_lines(figures):
        ui.label(line).classes("fw-warn" if warns else "fw-quiet")


def devices(step: Step) -> None:
    """Choose projector and camera; for the virtual ones, what they look at."""
    studio = step.studio
    with ui.row().classes("fw-fields"):
        for role in ("projector", "camera"):
            words = {VIRTUAL, getattr(studio, role), *studio.found[role == "camera"]}
            if role == "camera" and studio.phone.there:
                words.add("phone")
            field = ui.select(
                sorted(words),
                label=role.capitalize(),
                with_input=True,
                new_value_mode="add-unique",
                value=getattr(studio, role),
            )
            field.classes("fw-wide").bind_value(studio, role)
        scene = ui.select(SEEN, label="Virtual scene").classes("fw-field")
        scene.bind_value(studio, "scene")
        scene.bind_visibility_from(studio, "camera", lambda words: words == VIRTUAL)


def named(button: ui.button, name: str) -> None:
    """Give a button a name for those who do not see it.

    Names come from files: in a text of properties, some would be taken for code.
    """
    button.props["aria-label"] = name


def figures(values: dict[str, Any], names: dict[str, str]) -> None:
    """Show single figures with their names."""
    with ui.element("div").classes("fw-facts"):
        for key, name in names.items():
            value = values.get(key)
            if value is None:
                continue
            quantity, _, unit = name.partition(", ")
            ui.label(quantity).classes("fw-quiet")
            ui.label(f"{_figure(name, value)} {unit}".rstrip())


def _figure(name: str, value: Any) -> str:
    """A figure as it is read: shares in %, counts in groups of three digits."""
    if name.endswith(", %"):
        return numbers.percent(value).removesuffix(" %")
    if isinstance(value, int) and not isinstance(value, bool):
        return f"{value:,}"
    if not isinstance(value, float):
        return str(value)
    return numbers.sigma_text(value) if "σ" in name else numbers.number(value)
