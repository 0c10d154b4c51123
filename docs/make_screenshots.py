"""Write the screenshots of docs/report.md and docs/viewer.md from a report of the demo, and the
pictures that the demo draws: make screenshots.

Wants Chromium and Playwright, as the tests do. Pictures are reduced to 256 colours to stay small.
"""

from __future__ import annotations

import shutil
import sys
from io import BytesIO
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import sync_playwright

ARGUMENTS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
"""The software renderer gives the same pictures on every machine."""
IMAGES = Path(__file__).parent / "images"
VIEWER = ".fringe-viewer-mount"
KEYS = {"camera": "1", "left": "2", "right": "3", "above": "4", "oblique": "5"}
"""Keys of the five views."""
LAYERS = ("sigma", "modulation", "texture", "reason", "plain")
"""Layers that are shown beside the depth."""
OF_THE_DEMO = {"camera.png": 1500, "rig_bust.png": 1000}
"""Pictures of the demo on pages, and their widths there, px."""


def save(content: bytes, path: Path) -> None:
    """Write a screenshot as a small PNG."""
    path.parent.mkdir(parents=True, exist_ok=True)
    picture = Image.open(BytesIO(content)).convert("RGB")
    picture.quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)


def reduce(source: Path, path: Path, width: int) -> None:
    """Write a drawn picture smaller; its colours are spread evenly, as colour maps want it."""
    drawn = Image.open(source).convert("RGB")
    drawn = drawn.resize((width, round(width * drawn.height / drawn.width)), Image.Resampling.BOX)
    drawn.quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(
        path, optimize=True
    )


def opened(browser: Any, report: Path, width: int, height: int, scheme: str) -> Any:
    """A page whose surfaces are all drawn."""
    page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
    page.goto(report.resolve().as_uri())
    page.wait_for_selector(".maps canvas")
    page.wait_for_function(f"() => document.querySelector('{VIEWER}').viewer.rested")
    return page


def main(report: Path) -> None:
    """Take all screenshots of a report with a point cloud in its first chapter."""
    for name, width in OF_THE_DEMO.items():
        reduce(report.parent / name, IMAGES / name, width)
    with sync_playwright() as driver:
        program = shutil.which("chromium") or shutil.which("chromium-browser")
        browser = driver.chromium.launch(executable_path=program, args=ARGUMENTS)
        for name, width, scheme in (
            ("light", 1280, "light"),
            ("dark", 1280, "dark"),
            ("narrow", 400, "light"),
            ("narrow-dark", 400, "dark"),
        ):
            page = opened(browser, report, width, 1300, scheme)
            save(page.screenshot(), IMAGES / "report" / f"bust-{name}.png")
            viewer = page.locator(VIEWER).first
            page.locator("[data-ui=picture]").first.focus()
            for view, key in KEYS.items():
                page.keyboard.press(key)
                page.wait_for_function(f"() => document.querySelector('{VIEWER}').viewer.rested")
                save(viewer.screenshot(), IMAGES / "viewer" / f"{view}-{name}.png")
            for layer in LAYERS if name == "light" else ():
                page.select_option("[data-ui=layer]", layer)
                page.wait_for_function(f"() => document.querySelector('{VIEWER}').viewer.rested")
                save(viewer.screenshot(), IMAGES / "viewer" / f"layer-{layer}.png")
            page.close()
        browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
