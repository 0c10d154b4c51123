"""Pages of the studio: addresses, colours and sizes for all, and the list of captures."""

from __future__ import annotations

import json
import re
import urllib.error
import urllib.request
from urllib.parse import quote

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.devices.bench import virtual_rig
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.scene import standard_scene
from fringeworks.simulate.standard import bust, fringe_plan
from fringeworks.simulate.virtual_rig import look
from fringeworks.studio.places import STEPS, Place
from fringeworks.studio.slim import OF_PARTS
from tests import browser
from tests.axe import overflow, violations
from tests.studio_page import Running, Visitor

pytestmark = pytest.mark.system

chromium = browser.chromium
CLASSES = "[...new Set([...document.querySelectorAll('*')].flatMap((e) => [...e.classList]))]"
LIST = ".fw-list [role=option]"
FIRST_BYTES = 300_000
"""Most that the first page loads, bytes: NiceGUI with Vue and Quasar are 270 000 of them."""
SETUP = """
plan = "setup.plan.toml"
predicted_sigma_px = 0.03
projector = { open = "virtual", name = "virtual", size_px = [576, 360], gamma = 1.0, contrast = 1000.0, min_period_px = 8.0 }
camera = { open = "virtual:plane", name = "virtual", modulation = 60.0 }
settings = { exposure_ms = 16.7, gain_db = 1.2 }
noise = { read_counts = 1.0, gain = 0.02 }
"""
"""What ``setup`` finds of the virtual devices, in short."""


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    """A studio of a folder with a set-up, a rig, a stack, a pair, areas and a tolerance."""
    folder = tmp_path_factory.mktemp("pages") / "work"
    folder.mkdir()
    rig = virtual_rig()
    fw.files.write_rig(folder / "rig.toml", rig)
    plan = fringe_plan(rig, both=False)
    (folder / "setup.toml").write_text(SETUP)
    fw.files.write_plan(folder / "setup.plan.toml", plan)
    (folder / ".dark").mkdir()
    for name in ("setup.png", "rig.png", ".dark/setup.png", ".dark/rig.png"):
        fw.files.write_frame(folder / name, np.zeros((90, 160), np.uint8))
    frames = list(photograph(look(rig, bust()), plan, Optics(seed=1)))
    fw.files.write_stack(folder / "bust", frames, plan)
    scene = standard_scene("parabola", size=120, fringes=8, bits=8, noise=1.0, seed=1)
    fw.files.write_pair(folder / "pair", scene)
    area = fw.evaluate.Area(box=(20, 20, 90, 90))
    tolerance = fw.evaluate.PartTolerance("flatness of face", "flatness", ("face",), None, 0.1)
    recipe = fw.Recipe(areas={"face": area}, tolerances=(tolerance,))
    fw.files.write_recipe(folder / "recipe.toml", recipe)
    running = Running(folder)
    yield running
    running.close()


@pytest.fixture
def opened(chromium, studio):
    """Opens pages; none may complain or ask for anything elsewhere."""
    contexts, visitors = [], []

    def enter(path="", *, width=1280, height=900, dark=False):
        scheme = "dark" if dark else "light"
        contexts.append(
            chromium.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)
        )
        visitors.append(Visitor(contexts[-1], studio.address.rstrip("/") + path))
        return visitors[-1]

    yield enter
    for visitor in visitors:
        assert not visitor.complaints
        assert all(u.startswith((studio.address, "data:", "blob:")) for u in visitor.requests)
    for context in contexts:
        context.close()


def heading(page):
    return page.locator("[role=heading][aria-level='1']").inner_text()


def fetched(studio, path):
    try:
        with urllib.request.urlopen(studio.address.rstrip("/") + path, timeout=20) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, ""


def test_every_step_has_an_address_and_a_language(studio):
    for step in STEPS:
        status, text = fetched(studio, Place(step).address)
        assert status == 200, step
        assert re.search(r'<html[^>]* lang="en', text), step
    assert fetched(studio, "/look/bust")[0] == 200
    # What an address holds is no code.
    hostile = "</title><script>window.hit=1</script>"
    assert hostile not in fetched(studio, f"/look/{quote(hostile)}?method={quote(hostile)}")[1]
    for path in ("/nothing", "/look-out", "/scan/bust", "/captures/x"):
        assert fetched(studio, path)[0] == 404, path


def test_back_and_forward_go_through_the_steps(opened):
    visitor = opened()
    page = visitor.page
    for name in ("Scan", "Captures", "Learn"):
        visitor.step(name)
    assert page.url.endswith("/learn")
    page.go_back()
    page.locator(".fw-steps a[aria-current=step]", has_text="Captures").wait_for()
    assert heading(page).startswith("Captures")
    page.go_back()
    page.locator(".fw-steps a[aria-current=step]", has_text="Scan").wait_for()
    page.go_forward()
    page.locator(".fw-steps a[aria-current=step]", has_text="Captures").wait_for()
    assert page.locator(".fw-steps a[aria-current=step]").count() == 1
    # A reload, as after a restart, stays where it was.
    page.reload()
    page.locator(".fw-steps a[aria-current=step]", has_text="Captures").wait_for()


def test_a_surface_has_an_address(opened, studio):
    """An address shows its capture, measured as it says; Back shows the one before."""
    visitor = opened("/look/pair?method=fourier")
    page = visitor.page
    assert visitor.surface() > 1000
    visitor.sees("fourier")
    visitor.choose("Method", "windowed")
    visitor.click("Measure")
    page.wait_for_url("**/look/pair")
    page.wait_for_function("document.querySelector('.fw-facts')?.innerText.includes('windowed')")
    page.go_back()
    page.wait_for_function("document.querySelector('.fw-facts')?.innerText.includes('fourier')")
    for path, said in (("/look/gone", "gone: expected"), ("/look/pair?method=x", "method")):
        page.goto(studio.address.rstrip("/") + path)
        page.get_by_role("alert").filter(has_text=said).first.wait_for()


def areas(visitor):
    visitor.page.locator("summary", has_text="Areas and tolerances").click()
    visitor.page.wait_for_function("document.querySelector('.fw-picture img')?.naturalWidth > 0")
    visitor.page.get_by_text("drawing the picture").first.wait_for(state="hidden")


def ready(visitor, step):
    """Bring a step to where it shows most."""
    visitor.step(step)
    if step == "Look":
        visitor.page.goto(visitor.address.rstrip("/") + "/look/bust")
        visitor.surface()
        areas(visitor)
        visitor.click("Judge the part")
        visitor.sees(re.compile("^bust: (pass|fail|undecided)"))
    if step == "Learn":
        visitor.click("Try")
        visitor.surface()
    if step == "Captures":
        visitor.page.locator(LIST).first.wait_for()
    for summary in (
        visitor.page.locator("details.fw-more > summary").all() if step != "Look" else ()
    ):
        summary.click()
    visitor.page.wait_for_timeout(700)


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_axe_finds_nothing(opened, dark):
    visitor = opened(dark=dark)
    found = {}
    for step in STEPS:
        ready(visitor, step.capitalize())
        found[step] = violations(visitor.page)
        # Their styles are left out.
        used = visitor.page.evaluate(CLASSES)
        assert not [name for name in used if OF_PARTS.match(f".{name}")], step
    assert not {step: lines for step, lines in found.items() if lines}


def test_pages_are_as_wide_as_a_phone(opened):
    visitor = opened(width=390, height=844)
    wide = {}
    for step in STEPS:
        ready(visitor, step.capitalize())
        wide[step] = overflow(visitor.page)
        head = visitor.page.locator("header.fw-top").bounding_box()
        assert head["height"] < 844 / 5
    assert not {step: px for step, px in wide.items() if px > 0}
    assert not violations(visitor.page)


def test_the_first_page_is_light(chromium, studio):
    """Neither fonts nor the viewer are loaded before they are needed."""
    page = chromium.new_context().new_page()
    sizes, session = {}, page.context.new_cdp_session(page)
    session.send("Network.enable")
    session.on(
        "Network.loadingFinished",
        lambda e: sizes.__setitem__(e["requestId"], e["encodedDataLength"]),
    )
    requests = []
    page.on("request", lambda request: requests.append(request.url))
    page.goto(studio.address)
    page.wait_for_selector(".fw-steps a")
    page.wait_for_timeout(500)
    assert not [url for url in requests if url.endswith((".woff2", "viewer.js", "viewer.css"))]
    assert sum(sizes.values()) < FIRST_BYTES
    page.context.close()


def rows(visitor):
    return visitor.page.locator(f"{LIST} .fw-name").all_inner_texts()


def test_numbers_out_of_range_are_said(opened, studio):
    visitor = opened("/scan")
    field = visitor.page.get_by_label("Exposures", exact=True)
    field.fill("9")
    visitor.sees("1 to 8")
    visitor.click("Scan (space)")
    visitor.sees("Exposures: expected 1 to 8, got 9")
    assert field.input_value() == "9"
    assert not (studio.folder / "scan-001").exists()


@pytest.fixture
def many(tmp_path):
    """A studio of a folder with 200 captures, some with verdicts and findings."""
    scene = standard_scene("parabola", size=32, fringes=4, bits=8, seed=1)
    fw.files.write_pair(tmp_path / "part-000", scene)
    frames = {p.name: p.read_bytes() for p in (tmp_path / "part-000").iterdir()}
    for k in range(1, 200):
        folder = tmp_path / f"part-{k:03d}"
        folder.mkdir()
        for name, content in frames.items():
            (folder / name).write_bytes(content)
    notes = {
        "part-007": {"verdict": "fail", "findings": ["steps"], "measured": True},
        "part-107": {"verdict": "pass", "findings": ["steps"], "measured": True},
    }
    (tmp_path / "notes.json").write_text(json.dumps(notes))
    running = Running(tmp_path)
    yield running
    running.close()


def test_two_hundred_captures_are_found_renamed_and_deleted(chromium, many):
    context = chromium.new_context(viewport={"width": 1280, "height": 900})
    visitor = Visitor(context, many.address + "captures")
    page = visitor.page
    page.locator(LIST).first.wait_for()
    assert len(rows(visitor)) == 200
    assert page.evaluate("document.documentElement.scrollHeight") <= 1000
    page.wait_for_function(f"document.querySelector('{LIST} img').naturalWidth > 0")
    page.get_by_label("Search").fill("07")
    page.wait_for_function(f"document.querySelectorAll('{LIST}').length < 25")
    assert all("07" in name for name in rows(visitor))
    visitor.choose("Finding", "steps")
    page.wait_for_function(f"document.querySelectorAll('{LIST}').length === 2")
    visitor.choose("Verdict", "fail")
    page.wait_for_function(f"document.querySelectorAll('{LIST}').length === 1")
    assert rows(visitor) == ["part-007"]
    # By keys alone: delete, undo, rename, look.
    page.locator(".fw-list").focus()
    page.keyboard.press("Delete")
    visitor.sees("part-007 lies in the trash")
    assert not (many.folder / "part-007").exists()
    page.get_by_role("button", name="Undo: delete part-007").click()
    page.wait_for_function(f"document.querySelectorAll('{LIST}').length === 200")
    assert (many.folder / "part-007" / "capture.toml").is_file()
    page.locator(".fw-list").focus()
    page.keyboard.press("Home")
    page.keyboard.press("ArrowDown")
    assert page.locator(f"{LIST}[aria-selected=true] .fw-name").inner_text() == "part-198"
    page.wait_for_timeout(200)
    page.keyboard.press("F2")
    page.get_by_label("New name").fill("the part")
    page.keyboard.press("Enter")
    page.get_by_text("the part", exact=True).wait_for()
    assert (many.folder / "the part" / "capture.toml").is_file()
    page.locator(".fw-list").focus()
    page.keyboard.press("Home")
    page.wait_for_timeout(200)
    page.keyboard.press("Enter")
    page.wait_for_url("**/look/the%20part")
    assert not visitor.complaints
    context.close()
