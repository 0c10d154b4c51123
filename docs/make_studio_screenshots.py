"""Write the screenshots of docs/studio.md from a studio with virtual devices: make screenshots.

With ``--look FOLDER``, write every page into a folder instead, in light, dark and on a phone, to be
looked at: make look. Wants Chromium and Playwright, as the tests do.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from make_screenshots import ARGUMENTS, IMAGES, save
from playwright.sync_api import sync_playwright

import fringeworks as fw
from fringeworks.evaluate import plan_positions
from fringeworks.evaluate.acceptance.positions import ArtefactPlace
from fringeworks.studio.places import STEPS, Place
from fringeworks.studio.tour import PART
from fringeworks.types import Points

FEW_POSES = 3
"""Poses after which tilts and corners are still missing."""
POSES = 8
"""Poses of the board: as few as give a good rig."""
SCANS = 3
"""Scans of the part that the batch judges."""
NOISE_MM = 0.02
"""Standard deviation of the points of artefacts, mm."""
SAMPLES = 3000
"""Points of a ball or a plane."""
PLANE_MM = (80.0, 50.0)
"""Sides of the plane."""
TEST = """kind = "acceptance-test"
part = 2

[volume]
centre_mm = [0, 0, 510]
size_mm = [150, 110, 60]

[ball_bar]
length_mm = 70.0
length_expanded_mm = 0.002
diameters_mm = [24.0, 24.0]
diameter_expanded_mm = 0.001
form_mm = 0.001

[plane]
size_mm = [80, 50]
flatness_mm = 0.001
flatness_expanded_mm = 0.001

[limits_mm]
PF = 0.15
PS = 0.08
SD = 0.05
F = 0.15
"""
"""An acceptance test without its scans."""


def seen(position: ArtefactPlace, random: np.random.Generator) -> Points:
    """Points of an artefact in a position: the front halves of two balls, or a plane."""
    if position.artefact == "ball bar":
        ways = random.normal(size=(2, SAMPLES, 3))
        ways /= np.linalg.norm(ways, axis=-1, keepdims=True)
        ways[..., 2] = -np.abs(ways[..., 2])
        radii = 12.0 + random.normal(0.0, NOISE_MM, (2, SAMPLES, 1))
        return Points((position.marks_mm[:2, None] + radii * ways).reshape(-1, 3), None)
    along = position.marks_mm[2] - position.marks_mm[0]  # the first mark is the middle
    along = along / np.linalg.norm(along)
    across = np.cross(position.direction, along)
    u, v = random.uniform(-0.5, 0.5, (2, SAMPLES, 1)) * np.array(PLANE_MM)[:, None, None]
    noise = random.normal(0.0, NOISE_MM, (SAMPLES, 1))
    points = position.marks_mm[0] + u * along + v * across + noise * position.direction
    return Points(points, None)


def prepare_test(folder: Path) -> None:
    """Write an acceptance test, with points of the artefacts in all positions."""
    path, random = folder / "acceptance.toml", np.random.default_rng(1)
    path.write_text(TEST, encoding="utf-8")
    scans = []
    for k, position in enumerate(plan_positions(fw.files.read_acceptance_test(path))):
        fw.write(folder / f"artefact-{k:02d}.ply", seen(position, random))
        scans.append(
            f'\n[[scans]]\nartefact = "{position.artefact}"\nscan = "artefact-{k:02d}.ply"\n'
        )
    path.write_text(TEST + "".join(scans), encoding="utf-8")


def prepare_recipe(folder: Path) -> None:
    """Write a recipe with a box, a polygon and two tolerances."""
    areas = {
        "chest": fw.evaluate.Area(box=(150, 170, 210, 200)),
        "head": fw.evaluate.Area(polygon=((150.0, 60.0), (200.0, 60.0), (175.0, 110.0))),
    }
    tolerances = (
        fw.evaluate.PartTolerance("form of chest", "flatness", ("chest",), None, 20.0),
        fw.evaluate.PartTolerance("share of head", "valid_share", ("head",), 0.5, None),
    )
    recipe = fw.Recipe(areas=areas, tolerances=tolerances, rig=folder / "rig.toml")
    fw.files.write_recipe(folder / "recipe.toml", recipe)


def choose(page: Any, scene: str) -> None:
    """Choose what the virtual camera looks at."""
    page.get_by_label("Virtual scene", exact=True).first.click()
    page.get_by_role("option", name=scene, exact=True).click()
    page.locator(".q-menu").wait_for(state="hidden")


def click(page: Any, name: str) -> None:
    """Press a button."""
    page.get_by_role("button", name=name, exact=True).click()


def step(page: Any, name: str) -> None:
    """Go to a step."""
    page.locator(".fw-steps a", has_text=name).click()
    page.locator(".fw-steps a[aria-current=step]", has_text=name).wait_for()


def take(page: Any, name: str) -> None:
    """Save what the page shows."""
    page.mouse.move(0, 0)
    page.wait_for_timeout(1500)
    save(page.screenshot(), IMAGES / "studio" / f"{name}.png")


def opened(page: Any, name: str) -> None:
    """Open or close a part of the page."""
    page.locator("summary", has_text=name).click()


def draw(page: Any, box: tuple[int, int, int, int]) -> None:
    """Draw a box on the picture."""
    picture = page.locator(".fw-picture img")
    picture.scroll_into_view_if_needed()
    page.wait_for_timeout(500)
    at = picture.bounding_box()
    page.mouse.move(at["x"] + box[0], at["y"] + box[1])
    page.mouse.down()
    page.mouse.move(at["x"] + box[2], at["y"] + box[3], steps=4)
    page.mouse.up()
    page.wait_for_timeout(500)


def surface(page: Any) -> None:
    """Wait until a surface is drawn."""
    page.wait_for_function("document.querySelector('.fringe-viewer-mount')?.viewer?.rested")


def judge_batch(page: Any) -> None:
    """Judge all parts, or show what was judged before."""
    if not page.locator(".fw-scroll caption").count():
        click(page, "Judge the parts")
    page.locator(".fw-scroll caption").wait_for()
    page.locator("picture img").first.wait_for()


def certify(page: Any) -> None:
    """Judge the scans of an acceptance test."""
    click(page, "Certify")
    page.locator(".fw-table tbody tr").first.wait_for()


def walk(page: Any, folder: Path) -> None:
    """Go through all steps."""
    take(page, "start")
    step(page, "Set up")
    click(page, "Set up")
    page.get_by_text("No finding").wait_for()
    take(page, "set-up")
    choose(page, "bust")
    opened(page, "Live picture")
    page.get_by_label("Light", exact=True).click()
    page.get_by_role("option", name="Fringes", exact=True).click()
    click(page, "Start")
    page.get_by_text("contrast of fringes").wait_for()
    page.locator(".fw-live img").hover()
    page.get_by_text("modulation").wait_for()
    save(page.screenshot(), IMAGES / "studio" / "live.png")
    click(page, "Stop")
    choose(page, "moves by itself")
    step(page, "Calibrate")
    for k in range(POSES):
        if k == FEW_POSES:
            opened(page, "Live picture")
            click(page, "Start")
            page.get_by_text("corners, ").wait_for()
            take(page, "board")
        click(page, "Take a pose")
        page.get_by_text(f"pose-{k + 1:02d}: ").wait_for()
        page.wait_for_timeout(500)
    opened(page, "Live picture")
    click(page, "Calibrate")
    page.get_by_text("good for").first.wait_for()
    take(page, "calibrate")
    step(page, "Scan")
    click(page, "Scan (space)")
    page.get_by_text("of 25").wait_for()
    save(page.screenshot(), IMAGES / "studio" / "scan.png")
    surface(page)
    take(page, "look")
    judge_scans(page, folder)
    step(page, "Look")
    surface(page)
    click(page, "Write files")
    take(page, "export")
    step(page, "Learn")
    click(page, "Try")
    surface(page)
    take(page, "learn")


def judge_scans(page: Any, folder: Path) -> None:
    """Draw areas on a scan, judge it and others, and certify the scanner."""
    opened(page, "Areas and tolerances")
    page.locator(".fw-picture img").wait_for()
    page.wait_for_timeout(2000)
    draw(page, (20, 30, 75, 240))
    draw(page, (150, 60, 215, 95))
    page.get_by_label("Quantity", exact=True).click()
    page.get_by_role("option", name="step height", exact=True).click()
    page.get_by_label("Smallest").fill("60")
    page.get_by_label("Largest").fill("100")
    click(page, "Add the tolerance")
    click(page, "Judge the part")
    page.get_by_text("scan-001: pass").scroll_into_view_if_needed()
    page.evaluate("window.scrollBy(0, 400)")
    take(page, "areas")
    page.locator(".fringe-viewer canvas").first.focus()
    page.keyboard.press("1")
    page.evaluate("window.scrollTo(0, 0)")
    take(page, "handles")
    for _ in range(1, SCANS):
        step(page, "Scan")
        click(page, "Scan (space)")
        surface(page)
    step(page, "Captures")
    page.locator(".fw-list [role=option]").first.wait_for()
    take(page, "captures")
    step(page, "Batch")
    judge_batch(page)
    take(page, "batch")
    prepare_test(folder)
    step(page, "Certify")
    certify(page)
    take(page, "certify")


SCHEMES = (("light", 1280, 900), ("dark", 1280, 900), ("phone", 390, 844))
"""Pages that are looked at: name, width and height, px."""


def look(browser: Any, address: str, folder: Path, work: Path) -> None:
    """Write every page in every scheme, after a virtual part was measured."""
    page = browser.new_page()
    page.set_default_timeout(300_000)
    page.goto(address)
    page.wait_for_timeout(1000)
    click(page, "Try with a virtual part")
    surface(page)
    prepare_test(work)
    prepare_recipe(work)
    for name, width, height in SCHEMES:
        scheme = "dark" if name == "dark" else "light"
        context = browser.new_context(
            viewport={"width": width, "height": height}, color_scheme=scheme
        )
        page = context.new_page()
        page.set_default_timeout(60_000)
        for place in STEPS:
            page.goto(address.rstrip("/") + Place(place).address)
            page.wait_for_selector(".fw-steps a")
            if place == "look":
                page.goto(f"{address}look/{PART}")
                surface(page)
                opened(page, "Areas and tolerances")
                page.locator(".fw-picture img").wait_for()
            if place == "learn":
                click(page, "Try")
                surface(page)
            if place == "batch":
                judge_batch(page)
            if place == "certify":
                certify(page)
            page.wait_for_timeout(1500)
            slug = place.replace(" ", "-")
            page.screenshot(path=folder / f"{slug}-{name}.png", full_page=True)
        context.close()


def main(pictures: Path | None) -> None:
    """Start a studio in a temporary folder, and go through it."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "measurements"
        command = [sys.executable, "-m", "fringeworks", "studio", str(folder), "--no-show"]
        studio = subprocess.Popen([*command, "--port", "0"], stdout=subprocess.PIPE, text=True)
        try:
            assert studio.stdout is not None
            found = re.search(r"http://\S+", studio.stdout.readline())
            assert found is not None
            with sync_playwright() as driver:
                program = shutil.which("chromium") or shutil.which("chromium-browser")
                browser = driver.chromium.launch(executable_path=program, args=ARGUMENTS)
                if pictures is not None:
                    pictures.mkdir(parents=True, exist_ok=True)
                    look(browser, found[0], pictures, folder)
                    return
                page = browser.new_page(viewport={"width": 1280, "height": 1000})
                page.set_default_timeout(300_000)
                page.goto(found[0])
                walk(page, folder)
        finally:
            studio.terminate()
            studio.wait()


if __name__ == "__main__":
    main(Path(sys.argv[2]) if sys.argv[1:2] == ["--look"] else None)
