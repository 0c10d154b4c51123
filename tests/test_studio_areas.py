"""Areas in the studio: drawn and dragged on the picture and on the surface, typed, and undone."""

from __future__ import annotations

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.simulate.scene import standard_scene
from fringeworks.studio.steps.areas import area_of, corners_of
from fringeworks.types import InputError
from tests import browser
from tests.axe import overflow, violations
from tests.studio_page import Running, Visitor

pytestmark = pytest.mark.system

chromium = browser.chromium
SIZE = 120
VIEWER = "document.querySelector('.fringe-viewer-mount').viewer"


@pytest.fixture
def studio(tmp_path):
    scene = standard_scene("parabola", size=SIZE, fringes=8, bits=8, noise=1.0, seed=5)
    fw.files.write_pair(tmp_path / "pair", scene)
    areas = {
        "face": fw.evaluate.Area(box=(20, 30, 60, 80)),
        "rim": fw.evaluate.Area(polygon=((70.0, 20.0), (110.0, 20.0), (90.0, 60.0))),
    }
    fw.files.write_recipe(tmp_path / "recipe.toml", fw.Recipe(areas=areas))
    running = Running(tmp_path)
    yield running
    running.close()


@pytest.fixture
def visitor(chromium, studio):
    context = chromium.new_context(viewport={"width": 1280, "height": 1400})
    visitor = Visitor(context, studio.address + "look/pair")
    visitor.surface()
    visitor.page.locator("summary", has_text="Areas and tolerances").click()
    visitor.page.wait_for_function("document.querySelector('.fw-picture img')?.naturalWidth > 0")
    visitor.page.get_by_text("drawing the picture").first.wait_for(state="hidden")
    visitor.page.locator(".fringe-viewer .grip").first.wait_for()
    visitor.page.wait_for_timeout(700)
    yield visitor
    assert not visitor.complaints
    context.close()


def areas(studio):
    return fw.files.read_recipe(studio.folder / "recipe.toml").areas


def becomes(studio, page, name, expected, within=0.0):
    """The box or polygon of an area, once it is as expected; a busy machine takes seconds."""

    def found():
        area = areas(studio).get(name)
        return np.array([np.nan] if area is None else area.box or area.polygon, float)

    for _ in range(100):
        now = found()
        if now.shape == np.shape(expected) and np.all(np.abs(now - expected) <= within):
            break
        page.wait_for_timeout(100)
    # What was written is shown before the next step begins.
    page.wait_for_timeout(900)
    np.testing.assert_allclose(found(), expected, rtol=0, atol=within)


def drag(page, grip, dx, dy):
    grip.scroll_into_view_if_needed()
    box = grip.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + dx, y + dy, steps=5)
    page.mouse.up()


def grip(page, name):
    return page.locator(f".fw-picture .fw-grip[aria-label^='{name}']")


def test_handles_change_an_area_on_the_picture(studio, visitor):
    page = visitor.page
    drag(page, grip(page, "face, corner 3"), 25, 10)
    becomes(studio, page, "face", (20, 30, 85, 90), 1)
    drag(page, grip(page, "face, corner 2"), -10, 5)
    becomes(studio, page, "face", (20, 35, 75, 90), 1)
    drag(page, grip(page, "face, all"), 5, -5)
    becomes(studio, page, "face", (25, 30, 80, 85), 2)
    drag(page, grip(page, "rim, corner 3"), 0, 20)
    becomes(studio, page, "rim", ((70, 20), (110, 20), (90, 80)), 1)
    # By keys, and undone.
    before = areas(studio)["face"].box
    grip(page, "face, corner 1").focus()
    page.keyboard.press("Shift+ArrowRight")
    page.keyboard.press("ArrowDown")
    becomes(studio, page, "face", (before[0] + 10, before[1] + 1, *before[2:]))
    page.get_by_role("button", name="Undo: change face").click()
    becomes(studio, page, "face", before)


def test_numbers_are_typed(studio, visitor):
    page = visitor.page
    page.get_by_label("face: first column").fill("11")
    page.get_by_label("face: first column").press("Enter")
    becomes(studio, page, "face", (11, 30, 60, 80))
    page.get_by_label("rim: column, row").fill("70, 20; 110, 25.5; 90, 60; 75, 50")
    page.get_by_label("rim: column, row").press("Enter")
    becomes(studio, page, "rim", ((70, 20), (110, 25.5), (90, 60), (75, 50)))
    # What is no area is refused, and nothing changes.
    page.get_by_label("face: first column").fill("90")
    page.get_by_label("face: first column").press("Enter")
    visitor.sees("expected a box")
    assert areas(studio)["face"].box == (11, 30, 60, 80)


def test_areas_are_dragged_and_drawn_on_the_surface(studio, visitor):
    page = visitor.page
    page.locator(".fringe-viewer canvas").first.focus()
    page.keyboard.press("1")
    page.wait_for_timeout(600)
    outline = page.locator(".fringe-viewer .lines .outlines").first.get_attribute("d")
    assert outline.count("M") >= 5
    handles = page.locator(".fringe-viewer .grip:not(.all):visible")
    assert handles.count() == 7
    scale = page.evaluate(f"{VIEWER}.view.spacing")
    drag(page, handles.nth(2), 20 * scale, 0)
    becomes(studio, page, "face", (20, 30, 80, 80), 2)
    box = areas(studio)["face"].box
    # The picture shows the same.
    label = grip(page, "face, corner 3").get_attribute("aria-label")
    assert f"column {box[2]}, row {box[3]}" in label
    # A rectangle over the surface becomes an area.
    page.locator(".fringe-viewer canvas").first.focus()
    page.keyboard.press("r")
    stage = page.locator(".fringe-viewer [data-ui=stage]").bounding_box()
    x, y = stage["x"] + stage["width"] / 2, stage["y"] + stage["height"] / 2
    page.mouse.move(x - 5 * scale, y + 10 * scale)
    page.mouse.down()
    page.mouse.move(x + 25 * scale, y + 30 * scale, steps=4)
    page.mouse.up()
    visitor.click("Area from the region")
    visitor.sees("area-1 ✕")
    left, top, right, bottom = areas(studio)["area-1"].box
    assert right - left == pytest.approx(30, abs=2)
    assert bottom - top == pytest.approx(20, abs=2)


def test_a_profile_is_wide_and_its_cursor_is_linked(visitor):
    page = visitor.page
    page.locator(".fringe-viewer canvas").first.focus()
    page.keyboard.press("1")
    page.keyboard.press("d")
    page.wait_for_timeout(500)
    places = page.evaluate(
        f"""() => {{ const V = {VIEWER}, p = V.surfaces[0].shown;
        return [40 * {SIZE} + 25, 90 * {SIZE} + 95].map((i) =>
          V.view.project(p.subarray(3 * i, 3 * i + 3))); }}"""
    )
    stage = page.locator(".fringe-viewer [data-ui=stage]").bounding_box()
    for x, y in places:
        page.mouse.click(stage["x"] + x, stage["y"] + y)
    chart = page.locator(".fringe-viewer [data-ui=chart]")
    chart.wait_for()
    page.wait_for_timeout(500)
    dock = chart.bounding_box()
    assert dock["width"] > 800
    line = page.locator(".fringe-viewer .lines .profile").first.get_attribute("d")
    assert len(line) > 300
    curves = page.locator(".fringe-viewer [data-ui=curves]").bounding_box()
    page.mouse.move(curves["x"] + curves["width"] / 2, curves["y"] + 40)
    page.wait_for_timeout(200)
    pointed = page.evaluate(f"{VIEWER}.pointed")
    assert (pointed % SIZE, pointed // SIZE) == pytest.approx((60, 65), abs=1)
    assert "±" in page.locator("[data-ui=chartAt]").inner_text()
    # And the other way round.
    first = page.locator(".chart .cursor").get_attribute("d")
    x, y = places[0]
    stage = page.locator(".fringe-viewer [data-ui=stage]").bounding_box()
    at = page.evaluate(
        f"""() => {{ const V = {VIEWER}, i = V.tools.along[10], p = V.surfaces[0].shown;
        return V.view.project(p.subarray(3 * i, 3 * i + 3)); }}"""
    )
    page.mouse.move(stage["x"] + at[0], stage["y"] + at[1])
    page.wait_for_timeout(200)
    assert page.locator(".chart .cursor").get_attribute("d") not in ("", first)


@pytest.mark.parametrize("width", [390, 1280])
def test_areas_are_accessible(chromium, studio, width):
    context = chromium.new_context(viewport={"width": width, "height": 844})
    visitor = Visitor(context, studio.address + "look/pair")
    visitor.surface()
    visitor.page.locator("summary", has_text="Areas and tolerances").click()
    grip(visitor.page, "face, corner 1").wait_for()
    visitor.page.wait_for_timeout(900)
    assert overflow(visitor.page) <= 0
    assert not violations(visitor.page)
    context.close()


def test_corners_make_areas():
    assert area_of([[3.4, 9], [1, 2.6]], box=True).box == (1, 3, 3, 9)
    assert corners_of(area_of([[3, 9], [1, 2]], box=True)) == [(1, 2), (3, 2), (3, 9), (1, 9)]
    for bad in ([[1]], [["a", 2]], None, [[1, 2], [3, 4]]):
        with pytest.raises(InputError):
            area_of(bad, box=False)
