"""Pages in a headless browser, opened from disk: what they ask for and complain about is kept."""

from __future__ import annotations

import io
import shutil
from dataclasses import dataclass, field

import numpy as np
import pytest
from PIL import Image

# The software renderer gives the same pictures on every machine.
ARGUMENTS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
VIEWER = "document.querySelector('.fringe-viewer-mount').viewer"


@pytest.fixture(scope="module")
def chromium():
    """A browser; tests that want it skip, visibly, where it is missing."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        pytest.skip("no chromium: the viewer is not tried in a browser")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=ARGUMENTS)
        yield browser
        browser.close()


@dataclass
class Opened:
    """A page that shows a viewer."""

    page: object
    requests: list[str] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)

    def complain(self, text):
        """Keep a message of the console; the renderer's remarks on its own speed do not count."""
        if "GL Driver Message" not in text:
            self.complaints.append(text)

    def js(self, expression, argument=None):
        """The value of an expression in which V is the viewer."""
        return self.page.evaluate(
            f"async (a) => {{ const V = {VIEWER}; return {expression}; }}", argument
        )

    def ui(self, name):
        return self.page.locator(f"[data-ui={name}]").first

    def contrasts(self):
        """Visible texts of the page with their contrast."""
        return self.page.evaluate(CONTRASTS)

    def text(self, name):
        return self.ui(name).inner_text()

    def rest(self):
        """Wait until all points are drawn."""
        self.page.wait_for_function(f"() => {VIEWER}.rested", timeout=20_000)

    def picture(self):
        """The stage as an (h, w, 3) array, without what is written over it."""
        self.rest()
        box = self.ui("stage").bounding_box()
        content = self.page.screenshot(
            clip=box | {"y": box["y"] + 60, "height": box["height"] - 120}
        )
        return np.asarray(Image.open(io.BytesIO(content)).convert("RGB")).astype(int)

    def place(self, pixel):
        """Where a pixel of the surface lies in the page, CSS px."""
        box = self.ui("stage").bounding_box()
        x, y = self.js("V.view.project(V.active[0].shown.subarray(3 * a, 3 * a + 3))", int(pixel))
        return box["x"] + x, box["y"] + y


CONTRASTS = """() => {
  const parts = (colour) => {
    const [r, g, b, a = 1] = colour.match(/[\\d.]+/g).map(Number);
    return [r, g, b, a];
  };
  const over = ([r, g, b, a], under) => [r, g, b].map((v, k) => v * a + under[k] * (1 - a));
  const light = (rgb) => rgb
    .map((v) => v / 255)
    .map((v) => (v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
  const ground = (element) => {
    if (!element) return [255, 255, 255];
    const own = parts(getComputedStyle(element).backgroundColor);
    return own[3] === 1 ? own.slice(0, 3) : over(own, ground(element.parentElement));
  };
  const found = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const element = node.parentElement;
    const style = getComputedStyle(element);
    const unseen = !element.checkVisibility({ visibilityProperty: true });
    if (!node.data.trim() || unseen || element.closest("script, style, noscript")) continue;
    const colour = element.closest("svg") ? style.fill : style.color;
    if (colour === "none") continue;
    const under = ground(element);
    const [one, other] = [light(over(parts(colour), under)), light(under)].sort((a, b) => a - b);
    found.push([node.data.trim().slice(0, 40), (other + 0.05) / (one + 0.05)]);
  }
  return found;
}"""
"""Contrast of every visible text to what is below it, as WCAG 2 computes it."""


class Pages:
    """Opens pages; at the end, none must have asked for anything or complained."""

    def __init__(self, browser, folder):
        self.browser, self.folder, self.opened = browser, folder, []

    def open(self, html, *, width=800, height=500, dark=False, ready=True):
        path = self.folder / f"page{len(self.opened)}.html"
        path.write_text(html, encoding="utf-8")
        page = self.browser.new_page(
            viewport={"width": width, "height": height}, color_scheme="dark" if dark else "light"
        )
        opened = Opened(page)
        page.on("request", lambda request: opened.requests.append(request.url))
        page.on("console", lambda message: opened.complain(message.text))
        page.on("pageerror", lambda error: opened.complaints.append(str(error)))
        page.goto(path.as_uri())
        if ready:
            page.evaluate(f"{VIEWER}.ready")
        self.opened.append((path, opened))
        return opened

    def close(self):
        for path, opened in self.opened:
            opened.page.close()
            assert opened.requests == [path.as_uri()], opened.requests
            assert not opened.complaints, opened.complaints


@pytest.fixture
def pages(chromium, tmp_path):
    found = Pages(chromium, tmp_path)
    yield found
    found.close()
