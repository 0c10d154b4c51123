"""The studio in a browser, on virtual devices."""

from __future__ import annotations

import time

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.devices.virtual_bench import RADIUS_MM
from fringeworks.simulate.scene import standard_scene
from tests import browser
from tests.studio_page import Running, Visitor

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


@pytest.mark.timeout(600)
def test_from_an_empty_table_to_a_part(studio, visitor, tmp_path):
    begun = time.monotonic()
    visitor.choose("Virtual scene", "plane")
    visitor.click("Set up")
    visitor.sees("No finding")
    visitor.step("Calibrate")
    for k in range(8):
        visitor.choose("Virtual scene", f"board-{k}")
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
    found = fw.fit_region(fw.read_points(paths[0]).xyz_mm, "sphere")
    assert found.parameters["radius_mm"] == pytest.approx(RADIUS_MM, abs=0.2)
    space = studio.folder
    again = tmp_path / "again.ply"
    assert (
        run(["measure", f"{space}/scan-001", "--rig", f"{space}/rig.toml", "--out", str(again)])
        == 0
    )
    assert again.read_bytes() == paths[0].read_bytes()
    assert b"FringeViewer" in paths[1].read_bytes()


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    """A studio of a folder with a pair, and a capture whose frame is missing."""
    folder = tmp_path_factory.mktemp("shared") / "work"
    folder.mkdir()
    scene = standard_scene("parabola", size=200, fringes=12, bits=8, noise=1.0, seed=1)
    fw.write_pair(folder / "pair", scene)
    fw.write_pair(folder / "broken", scene)
    next((folder / "broken").glob("object*")).unlink()
    outside = folder.parent / "secret.png"
    fw.write_frame(outside, np.zeros((8, 8), np.uint8))
    fw.write_pair(folder / "sneaky", scene)
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
    visitor.page.get_by_text("Beside the one before").click()
    visitor.page.wait_for_function(
        "document.querySelector('.fringe-viewer-mount')?.viewer?.surfaces?.length === 2"
    )
    np.testing.assert_array_equal(heights(visitor, 0), shown)
    other = fw.reconstruct(shared.folder / "pair", "fourier").surface
    gap = np.abs(heights(visitor, 1).reshape(other.shape) - other.values) / other.sigma
    assert np.nanmax(gap) <= 0.13
    # A reload and a second tab of the same visitor find the state.
    again = pages(same=True)
    assert again.surface() == (other.reason == fw.Reason.OK).sum()


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


def test_the_live_picture_moves_and_one_visitor_holds_the_devices(pages):
    one, other = pages(), pages()
    one.page.get_by_text("Live picture").click()
    one.click("Start")
    one.sees("of full scale, saturated")
    other.click("Set up")
    other.sees("another visitor is using them")
    other.step("Scan")
    one.click("Stop")


def test_a_visitor_who_leaves_harms_nothing(pages):
    one = pages()
    one.step("Learn")
    one.click("Try")
    one.page.close()
    other = pages()
    # The other one's work goes on to its end, and is refused to nobody for ever.
    for _ in range(20):
        measure(other)
        other.page.wait_for_timeout(1500)
        if other.page.locator(".fringe-viewer canvas").count():
            break
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
