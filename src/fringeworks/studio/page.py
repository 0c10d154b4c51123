"""The page: navigation on the left, the present step beside it."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import app, ui

from fringeworks.studio.session import Session
from fringeworks.studio.state import Studio
from fringeworks.studio.steps import calibrate, export, learn, look, scan, set_up
from fringeworks.studio.steps.parts import Step

STEPS: dict[str, tuple[str, Callable[[Step], None]]] = {
    "set up": ("Find out what projector and camera can do", set_up.build),
    "calibrate": ("Calibrate projector and camera with a board", calibrate.build),
    "scan": ("Take the frames of an object", scan.build),
    "look": ("Look, measure, compare and judge", look.build),
    "learn": ("Try methods on a virtual scene", learn.build),
    "export": ("Files, reports and commands", export.build),
}
"""The steps: what each is for, and what builds it."""
MARKS = {"to do": "○", "running": "…", "good": "✓", "look here": "!"}
"""Marks of a step's state; the words are read to those who do not see them."""
UPDATE_S = 0.5
"""Interval at which the states of the steps are polled, s."""
PRIMARY, WARNING = "#1f5fbf", "#8a5300"
"""Colours of controls and of findings; both have a contrast of 4.5 or more to white."""
STYLE = """
.fringe-viewer-mount { height: max(30rem, calc(100vh - 18rem)); }
.fw-steps button { justify-content: flex-start; text-transform: none; }
.fw-live { max-width: min(100%, 960px); image-rendering: pixelated; user-select: none; }
.fw-code { white-space: pre-wrap; font-family: ui-monospace, monospace; font-size: 13px; }
.nicegui-content { padding: 1rem; }
.fringe-viewer h2 { font-size: 1.1rem; font-weight: 600; line-height: 1.3; }
"""
"""Style of the page beside the viewer's."""
SCRIPT = """
<script defer src="/viewer.js"></script>
<link rel="stylesheet" href="/studio.css">
<script>
window.fringeShow = async (id, numbers) => {
  const mount = document.getElementById(id);
  // Browsers allow 16 pictures of the graphics processor: the old one is given back.
  for (const canvas of mount.querySelectorAll("canvas")) {
    canvas.getContext("webgl2")?.getExtension("WEBGL_lose_context")?.loseContext();
  }
  const load = async (number) => {
    const answer = await fetch(`/surface/${number}`);
    if (!answer.ok) throw new Error("The surface is no longer there: measure again.");
    return new Uint8Array(await answer.arrayBuffer());
  };
  const surfaces = await Promise.all(numbers.map(load));
  mount.replaceChildren();
  mount.viewer = new FringeViewer(mount, surfaces);
  await mount.viewer.ready;
};
window.fringeLive = async (id, number) => {
  const mount = document.getElementById(id);
  if (!mount || mount.loading) return; // pictures that come while one is drawn are left out
  mount.loading = true;
  try {
    const answer = await fetch(`/cloud/${number}`);
    if (!answer.ok) return;
    const bytes = new Uint8Array(await answer.arrayBuffer());
    if (mount.viewer?.header?.count) {
      await mount.viewer.replace(bytes);
    } else {
      mount.replaceChildren();
      mount.viewer = new FringeViewer(mount, [bytes]);
      await mount.viewer.ready;
    }
  } finally {
    mount.loading = false;
  }
};
</script>
"""
"""Loads the viewer, and shows packed surfaces in it."""


def add_page(studio: Studio) -> None:
    """Register the page of a studio."""

    @ui.page("/")
    def _page() -> None:
        session = studio.session(str(app.storage.browser["id"]))
        session.tabs += 1
        ui.context.client.on_delete(lambda: studio.left(session))
        ui.add_head_html(SCRIPT)
        ui.colors(primary=PRIMARY, warning=WARNING)
        with ui.header().classes("items-center"):
            ui.label("fringeworks studio").classes("text-lg")
            place = ui.label(studio.workspace.root.name)
            place.tooltip(str(studio.workspace.root))
        with ui.row().classes("w-full no-wrap items-start"):
            steps = ui.column().classes("fw-steps shrink-0").props('role="navigation"')
            content = ui.column().classes("grow min-w-0")
        _Shell(studio, session, steps, content)


class _Shell:
    """The steps, and the content of the present one."""

    def __init__(
        self, studio: Studio, session: Session, steps: ui.column, content: ui.column
    ) -> None:
        self._studio = studio
        self._session = session
        self._content = content
        self._buttons: dict[str, ui.button] = {}
        with steps:
            for name in STEPS:
                button = ui.button(name, on_click=lambda _, name=name: self.go(name))
                button.props("flat no-caps align=left")
                self._buttons[name] = button
        ui.timer(UPDATE_S, self._mark)
        self.go(session.step)

    def go(self, name: str) -> None:
        """Show a step."""
        self._session.step = name
        self._content.clear()
        purpose, build = STEPS[name]
        with self._content:
            ui.label(purpose).classes("text-xl").props('role="heading" aria-level="1"')
            build(Step(self._studio, self._session, self.go))
        self._mark()

    def _mark(self) -> None:
        states = self._studio.step_states()
        for name, button in self._buttons.items():
            state = states.get(name)
            mark = f"{MARKS[state]} " if state else "  "
            present = "page" if name == self._session.step else "false"
            button.set_text(mark + name.capitalize())
            told = f", {state}" if state else ""
            button.props(f'aria-label="{name.capitalize()}{told}" aria-current="{present}"')
            button.props("outline" if present == "page" else "", remove="outline")
