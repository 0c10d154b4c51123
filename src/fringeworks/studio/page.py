"""The page: navigation above, the present step below it."""

from __future__ import annotations

from collections.abc import Callable
from importlib import resources

from fastapi import Request
from nicegui import app, ui

from fringeworks.studio.places import STEPS, Place, place_of
from fringeworks.studio.session import Session
from fringeworks.studio.state import Studio
from fringeworks.studio.steps import (
    batch,
    calibrate,
    captures,
    certify,
    export,
    history,
    learn,
    look,
    scan,
    set_up,
    start,
)
from fringeworks.studio.steps.parts import Step
from fringeworks.types import InputError

BUILDERS: dict[str, tuple[str, Callable[[Step], None]]] = {
    "start": ("Measure a part in three dimensions", start.build),
    "set up": ("Find out what projector and camera can do", set_up.build),
    "calibrate": ("Calibrate projector and camera with a board", calibrate.build),
    "scan": ("Take the frames of an object", scan.build),
    "captures": ("Captures and results in this folder", captures.build),
    "look": ("Look, measure, compare and judge", look.build),
    "batch": ("Judge many parts by one recipe", batch.build),
    "certify": ("Prove how well the scanner measures", certify.build),
    "export": ("Files, reports and commands", export.build),
    "learn": ("Try methods on a virtual scene", learn.build),
    "history": ("What was done, and what can be undone", history.build),
}
"""The steps: what each is for, and what builds it."""
MARKS = {"to do": "○", "running": "…", "good": "✓", "look here": "!"}
"""Marks of a step's state; the words are read to those who do not see them."""
UPDATE_S = 0.5
"""Interval at which the states of the steps are polled, s."""
ROOM = resources.files("fringeworks.studio")
"""Where the style and the script of the page lie."""
STYLE, SCRIPT = (ROOM.joinpath(f"studio.{kind}").read_text("utf-8") for kind in ("css", "js"))
"""Style and script of the page; the viewer has its own."""
MODULES = {name: ROOM.joinpath(f"{name}.js").read_text("utf-8") for name in ("areas", "parts")}
"""Scripts that steps load when they need them."""
HEAD = """
<meta name="description" content="fringeworks studio">
<link rel="stylesheet" href="/studio.css">
<script src="/studio.js" defer></script>
"""
"""Loads them."""
BOOT = """
<div class="fw-boot" role="banner"><div class="fw-top">
<span class="fw-brand">fringeworks studio</span>
<nav class="fw-early" aria-label="Steps">{links}</nav>
</div></div>
"""
"""What is shown until the page's script has built it: the bar with the steps."""


def add_page(studio: Studio) -> None:
    """Register the addresses of a studio's page."""

    def show(request: Request) -> None:
        query = f"?{request.url.query}" if request.url.query else ""
        place = place_of(request.url.path + query)
        _build(studio, place or Place(STEPS[0]))

    for step in STEPS:
        ui.page(Place(step).address)(show)

    @ui.page("/look/{source:path}")
    def _view(request: Request, source: str) -> None:  # noqa: ARG001, the address has it
        show(request)


def _build(studio: Studio, place: Place) -> None:
    session = studio.session(str(app.storage.browser["id"]))
    session.tabs += 1
    ui.context.client.on_delete(lambda: studio.left(session))
    ui.add_head_html(HEAD)
    ui.add_body_html(_boot(place))
    with ui.header(fixed=False).classes("fw-top"):
        ui.link("fringeworks studio", "/").classes("fw-brand").props["data-place"] = "/"
        root = ui.label(studio.workspace.root.name).classes("fw-folder")
        root.tooltip(str(studio.workspace.root))
        nav = ui.element("nav").classes("fw-steps").props('aria-label="Steps"')
        if not studio.workspace.writable:
            ui.label("read-only").classes("fw-warn")
        undo = ui.row().classes("fw-undo")
    shell = _Shell(studio, session, nav, undo, ui.column().classes("fw-content"))
    ui.on("fw-place", shell.came)
    shell.show(place)


def _boot(place: Place) -> str:
    """The bar with the steps, before there is anything else."""
    links = "".join(
        f'<a href="{Place(name).address}"'
        + (' aria-current="step"' if name == place.step else "")
        + f">{name.capitalize()}</a>"
        for name in STEPS
    )
    return BOOT.format(links=links)


class _Shell:
    """The steps, and the content of the present one."""

    def __init__(
        self, studio: Studio, session: Session, nav: ui.element, undo: ui.row, content: ui.column
    ) -> None:
        self._studio, self._session, self._content = studio, session, content
        self._links: dict[str, ui.link] = {}
        self._marked: dict[str, tuple[str, str, str]] = {}
        """What the links show."""
        self._place = Place(STEPS[0])
        with nav:
            for name in STEPS:
                address = Place(name).address
                link = ui.link(name.capitalize(), address)
                link.props["data-place"] = address
                self._links[name] = link
        with undo:
            self._undo = ui.button(on_click=self._undone).props("flat no-caps dense")
        ui.timer(UPDATE_S, self._mark)

    def came(self, event: object) -> None:
        """Show the place of an address that a click or the browser's Back asks for."""
        address = getattr(event, "args", None)
        place = place_of(address) if isinstance(address, str) else None
        if place is not None:
            self.show(place)

    def go(self, step: str, source: str = "") -> None:
        """Show a step, under an address of its own."""
        self.move(Place(step, source))
        self.show(Place(step, source))

    def move(self, place: Place, *, replace: bool = False) -> None:
        """Give the page the address of what it shows; ``replace`` keeps no way back."""
        if place.address != self._place.address:
            self._place = place
            history = ui.navigate.history
            (history.replace if replace else history.push)(place.address)

    def show(self, place: Place) -> None:
        """Show a place, whose address the page has already."""
        self._place = place
        self._content.clear()
        purpose, build = BUILDERS[place.step]
        # What asked for the place may have been cleared away: the content is where things are said.
        with self._content:
            ui.page_title(f"{place.source or place.step.capitalize()} · fringeworks studio")
            ui.label(purpose).classes("fw-h1").props('role="heading" aria-level="1" tabindex=-1')
            build(Step(self._studio, self._session, self.go, place, self.move))
        self._mark()

    def _undone(self) -> None:
        try:
            said = self._studio.undo(self._session)
        except InputError as problem:
            said = "\n".join(problem.lines)
        ui.notify(said, multi_line=True)
        self.show(self._place)

    def _mark(self) -> None:
        states = self._studio.step_states()
        for name, link in self._links.items():
            state = states.get(name)
            mark, told = (f"{MARKS[state]} ", f", {state}") if state else ("", "")
            here = "step" if name == self._place.step else "false"
            shown = (mark + name.capitalize(), name.capitalize() + told, here)
            if self._marked.get(name) != shown:
                self._marked[name] = shown
                link.set_text(shown[0])
                link.props["aria-label"], link.props["aria-current"] = shown[1:]
        last = self._studio.trash.last()
        self._undo.set_visibility(last is not None)
        if last is not None:
            self._undo.set_text(f"Undo: {last.what}")
