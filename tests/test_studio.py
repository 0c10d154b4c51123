"""The studio in a browser, on virtual devices."""

from __future__ import annotations

import re
import shlex
import time
from dataclasses import replace

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.devices.bench import RADIUS_MM, SCALE
from fringeworks.files.findings import findings_as_dicts
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.scene import standard_scene
from fringeworks.simulate.standard import bust, fringe_plan, standard_rig
from fringeworks.simulate.virtual_rig import look
from fringeworks.studio.state import Studio
from fringeworks.studio.steps.parts import finding_lines
from fringeworks.studio.steps.scan import series_names
from fringeworks.types import Finding, InputError
from fringeworks.types.numbers import number
from tests import browser
from tests.studio_page import Running, Visitor

pytestmark = pytest.mark.system

chromium = browser.chromium


@pytest.fixture
def studio(tmp_path, monkeypatch):
    # Files hold the date of their making; equal ones need equal dates.
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    running = Running(tmp_path / "work")
    yield running
    running.close()


@pytest.fixture
def visitor(chromium, studio):
    context = chromium.new_context(viewport={"width": 1280, "height": 1000}, accept_downloads=True)
    visitor = Visitor(context, studio.address)
    yield visitor
    assert not visitor.complaints
    assert all(url.startswith((studio.address, "data:", "blob:")) for url in visitor.requests)
    context.close()


@pytest.mark.long
@pytest.mark.timeout(600)
def test_from_an_empty_table_to_a_part(studio, visitor, tmp_path, monkeypatch):
    begun = time.monotonic()
    visitor.step("Set up")
    visitor.click("Set up")
    visitor.sees("No finding")
    visitor.step("Calibrate")
    for k in range(8):
        # The virtual board moves by itself.
        visitor.click("Take a pose")
        visitor.sees(f"pose-{k + 1:02d}: ")
    visitor.click("Calibrate")
    visitor.sees("mm at ", 120)
    visitor.step("Scan")
    visitor.choose("Virtual scene", "sphere")
    visitor.click("Scan (space)")
    assert visitor.surface() > 3000
    visitor.click("Write files")
    paths = []
    for name in ("PLY, points", "Report, HTML"):
        with visitor.page.expect_download(timeout=60_000) as download:
            visitor.click(name)
        paths.append(tmp_path / download.value.suggested_filename)
        download.value.save_as(paths[-1])
    assert time.monotonic() - begun < 180
    found = fw.surface.fit_region(fw.files.read_points(paths[0]).xyz_mm, "sphere")
    assert found.parameters["radius_mm"] == pytest.approx(RADIUS_MM, abs=0.2)
    space = studio.folder
    again = tmp_path / "again.ply"
    assert (
        run(["measure", f"{space}/scan-001", "--rig", f"{space}/rig.toml", "--out", str(again)])
        == 0
    )
    assert again.read_bytes() == paths[0].read_bytes()
    assert b"FringeViewer" in paths[1].read_bytes()
    # What was clicked can be scripted.
    shell, python = (visitor.page.locator(".fw-code").nth(k).inner_text() for k in range(2))
    for name in ("shell", "python"):
        (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path / "shell")
    for line in shell.splitlines():
        assert run(shlex.split(line)[1:]) == 0, line
    monkeypatch.chdir(tmp_path / "python")
    exec(python, {})
    for name in ("shell", "python"):
        points = fw.files.read_points(tmp_path / name / "scan-001.ply")
        radius = fw.surface.fit_region(points.xyz_mm, "sphere").parameters["radius_mm"]
        assert radius == pytest.approx(RADIUS_MM, abs=0.2)


@pytest.mark.long
@pytest.mark.timeout(600)
def test_a_first_minute(studio, visitor):
    """One click measures a virtual part; another puts it away for own devices, which can be undone."""
    page = visitor.page
    begun = time.monotonic()
    visitor.click("Try with a virtual part")
    for words in ("The projector shows test pictures", "A board whose corners", "The corners tell"):
        visitor.sees(words, 200)
    page.wait_for_url("**/look/virtual-part", timeout=300_000)
    assert visitor.surface() > 80_000
    print(f"a first minute took {time.monotonic() - begun:.0f} s")
    visitor.step("Calibrate")
    visitor.sees("good for ±0.0")
    visitor.sees("Next: scan")
    # Nothing asks for further poses beside that.
    assert not page.get_by_text(re.compile("take .* more pose|are few")).count()
    visitor.step("Start")
    visitor.click("Now with your devices")
    page.wait_for_url("**/set-up")
    assert not (studio.folder / "setup.toml").exists()
    page.get_by_role("button", name="Undo: put the virtual part away").click()
    visitor.sees("No finding")
    assert (studio.folder / "virtual-part" / "capture.toml").is_file()


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    """A studio of a folder with a pair, and a capture whose frame is missing."""
    folder = tmp_path_factory.mktemp("shared") / "work"
    folder.mkdir()
    scene = standard_scene("parabola", size=200, fringes=12, bits=8, noise=1.0, seed=1)
    fw.files.write_pair(folder / "pair", scene)
    fw.files.write_pair(folder / "broken", scene)
    next((folder / "broken").glob("object*")).unlink()
    outside = folder.parent / "secret.png"
    fw.files.write_frame(outside, np.zeros((8, 8), np.uint8))
    fw.files.write_pair(folder / "sneaky", scene)
    description = folder / "sneaky" / "capture.toml"
    text = description.read_text()
    name = next((folder / "sneaky").glob("object*")).name
    description.write_text(text.replace(name, "../../secret.png"))
    running = Running(folder)
    yield running
    running.close()


@pytest.fixture
def pages(chromium, shared):
    """Opens pages of visitors who do not know each other."""
    contexts, visitors = [], []

    def enter(same=False):
        if not same:
            contexts.append(chromium.new_context(viewport={"width": 1280, "height": 1000}))
        visitors.append(Visitor(contexts[-1], shared.address))
        return visitors[-1]

    yield enter
    for visitor in visitors:
        assert not visitor.complaints
        assert all(
            url.startswith((shared.address, "data:", "blob:")) for url in visitor.requests
        ), visitor.requests
    for context in contexts:
        context.close()


def measure(visitor, source="pair", method=None):
    visitor.step("Look")
    visitor.choose("Capture or result", source)
    if method is not None:
        visitor.choose("Method", method)
    visitor.click("Measure")


def heights(visitor, which=-1):
    return np.array(
        visitor.page.evaluate(
            "(k) => { const s = document.querySelector('.fringe-viewer-mount').viewer.surfaces;"
            "return [...s.at(k).points].filter((_, i) => i % 3 === 2); }",
            which,
        )
    )


def told(visitor, title):
    """Wait until the viewer shows a surface of a name."""
    visitor.page.wait_for_function(
        "(t) => document.querySelector('.fringe-viewer-mount')?.viewer?.ui?.title?.textContent"
        ".includes(t)",
        arg=title,
    )


def test_methods_change_the_surface_and_are_compared(shared, pages):
    visitor = pages()
    measure(visitor)
    visitor.surface()
    visitor.sees("Median σ")
    expected = fw.reconstruct(shared.folder / "pair", "windowed").surface
    shown = heights(visitor)
    close = np.abs(shown.reshape(expected.shape) - expected.values) / expected.sigma
    assert np.nanmax(close) <= 0.13
    measure(visitor, method="fourier")
    visitor.page.wait_for_function(
        "(z) => document.querySelector('.fringe-viewer-mount')?.viewer?.surfaces?.[0]"
        "?.points[2 * 3 * 150 + 2] !== z",
        arg=float(shown[300]),
    )
    visitor.page.get_by_text("Compare with the previous result").click()
    visitor.page.wait_for_function(
        "document.querySelector('.fringe-viewer-mount')?.viewer?.surfaces?.length === 2"
    )
    np.testing.assert_array_equal(heights(visitor, 0), shown)
    other = fw.reconstruct(shared.folder / "pair", "fourier").surface
    gap = np.abs(heights(visitor, 1).reshape(other.shape) - other.values) / other.sigma
    assert np.nanmax(gap) <= 0.13
    # A reload and a second tab of the same visitor find the state.
    again = pages(same=True)
    again.step("Look")
    assert again.surface() == (other.reason == fw.Reason.OK).sum()


def test_findings_are_told_from_notes():
    finding = Finding("steps", "fringes differ", ("vibration",), "keep still")
    note = Finding("noise", "noise of 1", severity="note")
    figures = {"findings": findings_as_dicts([finding, note])}
    expected = [
        ("warning (steps): fringes differ; likely vibration; keep still", True),
        ("note (noise): noise of 1", False),
    ]
    assert finding_lines(figures) == expected


@pytest.mark.parametrize(("source", "said"), [("broken", "object"), ("sneaky", "outside")])
def test_broken_captures_are_a_sentence(pages, source, said):
    visitor = pages()
    measure(visitor, source)
    alert = visitor.page.get_by_role("alert").filter(has_text=said)
    alert.first.wait_for()
    assert "internal error" not in alert.first.inner_text()


def test_a_method_is_tried_on_a_virtual_body(pages):
    visitor = pages()
    visitor.step("Learn")
    visitor.click("Try")
    assert visitor.surface() > 100_000
    visitor.sees("mean error 0.")


@pytest.mark.long
def test_a_series_of_scans(studio, visitor):
    """Without a rig, scans are taken and listed one after the other."""
    target = str(studio.folder / "setup.toml")
    words = "setup --projector virtual --camera virtual:plane --frames 12 --out"
    assert run([*words.split(), target]) == 0
    visitor.page.reload()
    visitor.step("Scan")
    visitor.page.get_by_label("Scans", exact=True).fill("2")
    visitor.page.get_by_label("Pause before each scan, s").fill("1")
    visitor.click("Scan (space)")
    visitor.sees("2 left")
    visitor.sees("scan-001-002")
    visitor.page.get_by_role("link", name="scan-001-002", exact=True).wait_for()
    assert len(fw.files.read_stack(studio.folder / "scan-001-002").frames) == 12
    visitor.page.get_by_label("Name").fill("../out")
    visitor.page.get_by_label("Scans", exact=True).fill("1")
    visitor.click("Scan (space)")
    visitor.sees("expected 1 to 60 letters")


def live(visitor, text="Live picture"):
    """Open a part of the page that shows what the devices do."""
    visitor.page.locator("summary", has_text=text).click()


def test_the_live_picture_helps_to_aim_and_one_visitor_holds_the_devices(pages):
    one, other = pages(), pages()
    for visitor in (one, other):
        visitor.step("Set up")
    one.choose("Virtual scene", "bust")
    live(one)
    one.choose("Light", "Fringes")
    one.click("Start")
    one.sees("contrast of fringes")
    one.sees("the exposure is good")
    picture = one.page.locator(".fw-live img").first
    picture.wait_for()
    picture.hover()
    one.sees("modulation 3")
    live(other)
    for name in ("Set up", "Stop"):
        other.click(name)
        other.sees("another visitor is using them")
        other.page.wait_for_timeout(200)
    one.page.get_by_text("contrast of fringes").wait_for()
    # Further work of the same visitor ends the picture.
    one.click("Find the exposure")
    one.page.wait_for_function(
        "Number(document.querySelector('[aria-label=\"Exposure, ms\"]')?.value) > 0"
    )
    one.click("Start")
    one.sees("contrast of fringes")
    one.click("Stop")


@pytest.mark.long
def test_a_visitor_who_leaves_gives_the_devices_back(pages):
    one, other = pages(), pages()
    for visitor in (one, other):
        visitor.step("Set up")
    live(one)
    one.click("Start")
    one.sees("saturated 0.0%")
    one.page.close()
    live(other)
    other.click("Start")
    other.sees("another visitor is using them")
    other.page.wait_for_timeout(35_000)
    other.click("Start")
    other.sees("saturated 0.0%")
    other.click("Stop")


def test_what_a_folder_holds_is_no_code(pages, shared):
    """Names of folders, poses and areas come from whoever made the folder."""
    hostile = 'x" :y="window.hit=1" z="'
    (shared.folder / "board" / hostile).mkdir(parents=True)
    (shared.folder / "board" / hostile / "capture.toml").write_text('kind = "stack"')
    area = fw.evaluate.Area(box=(1, 1, 9, 9))
    tolerance = fw.evaluate.PartTolerance(hostile, "flatness", (hostile,), None, 1.0)
    recipe = fw.Recipe(areas={hostile: area, "<img src=x onerror=window.hit=1>": area})
    recipe = replace(recipe, tolerances=(tolerance,))
    fw.files.write_recipe(shared.folder / "recipe.toml", recipe)
    visitor = pages()
    visitor.step("Calibrate")
    visitor.page.wait_for_timeout(500)
    measure(visitor)
    visitor.surface()
    live(visitor, "Areas and tolerances")
    visitor.page.locator(".fw-picture img").first.wait_for()
    visitor.page.get_by_text(hostile).first.wait_for()
    visitor.page.wait_for_timeout(500)
    assert visitor.page.evaluate("window.hit") is None
    (shared.folder / "recipe.toml").unlink()


def drag(visitor, box):
    """Draw a box on the picture."""
    picture = visitor.page.locator(".fw-picture img").first
    picture.scroll_into_view_if_needed()
    at = picture.bounding_box()
    for n, (x, y) in enumerate((box[:2], box[2:])):
        visitor.page.mouse.move(at["x"] + x + 0.5, at["y"] + y + 0.5, steps=4)
        (visitor.page.mouse.up if n else visitor.page.mouse.down)()


def test_areas_are_drawn_and_parts_judged(pages, shared):
    visitor = pages()
    measure(visitor)
    visitor.surface()
    live(visitor, "Areas and tolerances")
    visitor.page.wait_for_function(
        "document.querySelector('.fw-picture img')?.naturalWidth === 200"
    )
    # The progress above the picture goes away when it is drawn, and the picture moves up.
    visitor.page.get_by_text("drawing the picture").first.wait_for(state="hidden")
    visitor.page.wait_for_timeout(1000)
    drag(visitor, (80, 80, 120, 110))
    visitor.sees("area-1 ✕")
    drag(visitor, (5, 5, 30, 190))
    visitor.sees("area-2 ✕")
    recipe = fw.files.read_recipe(shared.folder / "recipe.toml")
    assert recipe.areas["area-1"].box == pytest.approx((80, 80, 120, 110), abs=1)
    visitor.choose("Quantity", "step height")
    visitor.choose("Area", "area-1")
    visitor.choose("Base, or other area", "area-2")
    visitor.page.get_by_label("Smallest").fill("10")
    visitor.page.get_by_label("Largest").fill("20")
    visitor.click("Add the tolerance")
    visitor.sees("at least 10 mm, at most 20 mm")
    visitor.click("Judge the part")
    visitor.sees("pair: fail")
    found = fw.inspect(shared.folder / "pair", shared.folder / "recipe.toml")
    assert found.verdict == "fail"
    visitor.sees(number(found.checks[0].value, found.checks[0].sigma))
    # Measured within the area only, as the command line does it.
    visitor.choose("Measure only", "area-1")
    visitor.page.wait_for_function(
        "document.querySelector('.fringe-viewer-mount')?.viewer?.surfaces?.[0]?.header.count < 3000"
    )
    visitor.click("Write files")
    visitor.click("NPZ, everything")
    visitor.sees("inspect pair --recipe recipe.toml --out pair.npz")
    target = shared.folder.parent / "same.npz"
    words = ["inspect", str(shared.folder / "pair"), "--recipe", str(shared.folder / "recipe.toml")]
    assert run([*words, "--out", str(target)]) == 4
    one, other = (fw.files.read_surface(p) for p in (target, shared.folder / "pair.npz"))
    np.testing.assert_array_equal(one.values, other.values)
    visitor.step("Look")
    live(visitor, "Areas and tolerances")
    visitor.page.get_by_role("button", name="Delete area-1").click()
    visitor.page.get_by_text("at least 10").wait_for(state="hidden")
    assert list(fw.files.read_recipe(shared.folder / "recipe.toml").areas) == ["area-2"]
    (shared.folder / "recipe.toml").unlink()


@pytest.mark.parametrize(
    ("experiment", "said"),
    [
        ("phase shifting, rig", "12 frames: mean"),
        pytest.param("two frames, rig", " px", marks=pytest.mark.long),
    ],
)
def test_the_virtual_rig_is_tried(pages, experiment, said):
    visitor = pages()
    visitor.step("Learn")
    visitor.choose("Experiment", experiment)
    visitor.choose("Body", "sphere")
    visitor.click("Try")
    assert visitor.surface() > 50_000
    visitor.sees(said)
    visitor.page.wait_for_function(
        "document.querySelector('.fringe-viewer-mount').viewer.surfaces[0].layers"
        ".some((layer) => layer.name === 'deviation')"
    )


@pytest.mark.long
def test_live_board_and_live_points(studio, visitor):
    space = studio.folder
    words = "setup --projector virtual --camera virtual:plane --frames 24 --axes x,y --out"
    assert run([*words.split(), str(space / "setup.toml")]) == 0
    fw.files.write_rig(space / "rig.toml", standard_rig(scale=SCALE))
    visitor.page.reload()
    visitor.step("Calibrate")
    visitor.click("Take a pose")
    visitor.sees("pose-01: 88 corners found")
    live(visitor)
    visitor.click("Start")
    visitor.sees("88 corners, ")
    visitor.sees("new: tilt of the")
    visitor.step("Scan")
    visitor.choose("Virtual scene", "sphere")
    live(visitor, "Live points")
    visitor.click("Start live points")
    visitor.sees("clouds/s")
    assert visitor.surface() > 3000
    first = visitor.page.evaluate("document.querySelector('.fw-live-points').viewer")
    numbers = set()
    for _ in range(40):
        numbers.add(visitor.page.get_by_text("clouds/s").first.inner_text())
        visitor.page.wait_for_timeout(100)
    # New clouds come, and the same viewer shows them, as it is turned.
    assert len(numbers) > 4
    assert first is not None
    canvases = visitor.page.locator(".fw-live-points canvas").count()
    visitor.click("Stop live points")
    assert canvases == 1


@pytest.mark.long
def test_a_series_goes_on_when_nobody_looks(tmp_path):
    """The scans of a series are the studio's, not the page's."""
    words = "setup --projector virtual --camera virtual:plane --frames 12 --out"
    assert run([*words.split(), str(tmp_path / "setup.toml")]) == 0
    studio = Studio(tmp_path)
    try:
        session = studio.session("one")
        series = studio.start_series(session, series_names("part", 2, 90.0), 0.3)
        with pytest.raises(InputError, match="another visitor"):
            studio.run_setup(studio.session("other"))
        while series.running:
            time.sleep(0.1)
        assert series.problem == ""
        assert studio.workspace.captures() == ["part-000.0deg", "part-090.0deg"]
        series = studio.start_series(session, ["again-1", "again-2"], 5.0)
        studio.stop_series(session)
        while series.running:
            time.sleep(0.01)
        assert studio.workspace.captures() == ["part-000.0deg", "part-090.0deg"]
    finally:
        studio.close()


@pytest.mark.long
def test_a_visitor_who_leaves_harms_nothing(pages):
    one = pages()
    one.step("Learn")
    one.click("Try")
    one.page.close()
    other = pages()
    # The other one's work waits for the first.
    measure(other)
    assert other.surface() > 1000


@pytest.mark.long
def test_twenty_tabs(pages):
    pages()
    visitors = [pages(same=True) for _ in range(19)]
    for visitor in visitors:
        visitor.step("Learn")
    visitors[0].click("Try")
    visitors[0].surface()
    for visitor in visitors:
        visitor.step("Scan")
        visitor.sees("Exposures")


@pytest.fixture(scope="module")
def two_megapixels(tmp_path_factory):
    """A studio of a folder with a stack of 2 million pixels, and its rig."""
    folder = tmp_path_factory.mktemp("large") / "work"
    folder.mkdir()
    rig = standard_rig(scale=1.25)
    plan = fringe_plan(rig, both=False)
    fw.files.write_stack(
        folder / "large", list(photograph(look(rig, bust()), plan, Optics(seed=1))), plan
    )
    fw.files.write_rig(folder / "rig.toml", rig)
    running = Running(folder)
    yield running
    running.close()


ANSWER = """([name, heading]) => new Promise((done) => {
  const start = performance.now();
  const shows = () => [...document.querySelectorAll("[role=heading]")].some(
    (e) => e.textContent.startsWith(heading));
  const seen = new MutationObserver(() => {
    if (shows()) { seen.disconnect(); done(performance.now() - start); }
  });
  seen.observe(document.body, { childList: true, subtree: true, characterData: true });
  [...document.querySelectorAll(".fw-steps a")].find((b) => b.textContent.includes(name)).click();
})"""
"""Time from a click on a step until its heading is there, ms."""


@pytest.mark.long
@pytest.mark.timeout(600)
def test_clicks_are_answered_while_a_large_scan_is_measured(chromium, two_megapixels):
    """The best of three rounds: other tests may use the machine at the same time."""
    context = chromium.new_context(viewport={"width": 1280, "height": 1000})
    visitor = Visitor(context, two_megapixels.address)
    other = Visitor(chromium.new_context(), two_megapixels.address)
    found = []
    while len(found) < 3 and min(found, default=1.0) > 0.1:
        times = answers(visitor, other)
        found.append(np.percentile(times, 95))
        print(f"answers: median {np.median(times):.3f} s, 95th {found[-1]:.3f} s")
    assert min(found) <= 0.1


def answers(visitor, other):
    """Times of 100 answers to one visitor while work for the other one is done, s."""
    times = []
    while len(times) < 100:
        measure(other, "large")
        other.sees("decoding and measuring")
        busy = other.page.get_by_role("button", name="Cancel").first
        while busy.is_visible() and len(times) < 100:
            for name, heading in (("Scan", "Take the frames"), ("Export", "Files, reports")):
                times.append(visitor.page.evaluate(ANSWER, [name, heading]) / 1000.0)
        other.page.reload()
        other.page.wait_for_selector(".fw-steps a")
    return times
