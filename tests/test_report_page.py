"""A report in a browser: viewer and maps of one surface, keys, print, both schemes."""

from __future__ import annotations

import io
import re

import numpy as np
import pytest
from PIL import Image

import fringeworks as fw
from fringeworks.report.page.blocks import Chapter, Table
from fringeworks.report.page.html import page_html
from fringeworks.types import made_by
from tests import browser
from tests.surfaces import measured_bust, small_rig

pytestmark = pytest.mark.system

chromium, pages = browser.chromium, browser.pages  # fixtures
MAPS = ".maps canvas"


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """The page of a measured bust and its rig."""
    path = tmp_path_factory.mktemp("report") / "r.html"
    results = {"bust": measured_bust(), "rig": small_rig()}
    fw.write_report(path, results, rig=small_rig(), tolerances=[])
    return path.read_text()


def coloured(opened, number):
    """Share of a map's pixels that are not the colour of a gap, and the number of colours."""
    content = opened.page.query_selector_all(MAPS)[number].screenshot()
    pixels = np.asarray(Image.open(io.BytesIO(content)).convert("RGB")).reshape(-1, 3)
    return np.mean((pixels != 0xB0).any(axis=1)), len(np.unique(pixels, axis=0))


def test_the_maps_show_every_quantity_and_their_values(pages, report):
    opened = pages.open(report, width=1280, height=900)
    opened.page.wait_for_selector(MAPS)
    labels = [e.get_attribute("aria-label") for e in opened.page.query_selector_all(MAPS)]
    assert [label.split(": ")[1].split(" /")[0] for label in labels] == [
        "Depth z",
        "Standard deviation σ",
        "Modulation",
        "Texture",
        "Reason",
    ]
    for number in range(4):
        share, colours = coloured(opened, number)
        assert share > 0.3
        assert colours > 50
    cloud = measured_bust().points
    row, column = (n // 2 for n in cloud.shape)
    first = opened.page.query_selector(MAPS)
    first.scroll_into_view_if_needed()
    box = first.bounding_box()
    scale = box["width"] / cloud.shape[1]
    opened.page.mouse.move(box["x"] + (column + 0.5) * scale, box["y"] + (row + 0.5) * scale)
    told = opened.page.inner_text(".told")
    assert told.startswith(f"Column {column}, row {row}: Depth z")
    z = float(re.search(r"Depth z ([\d.]+) mm", told)[1])
    assert z == pytest.approx(float(cloud.xyz_mm[row, column, 2]), rel=1e-4)
    bad_row, bad_column = np.argwhere(cloud.reason == fw.Reason.SHADOW)[10]
    x = box["x"] + (bad_column + 0.5) * scale
    opened.page.mouse.move(x, box["y"] + (bad_row + 0.5) * scale)
    assert "no value (shadow)" in opened.page.inner_text(".told")


def test_maps_zoom_together_by_keys(pages, report):
    opened = pages.open(report, width=1280, height=900)
    opened.page.wait_for_selector(MAPS)
    before = [coloured(opened, n)[1] for n in range(2)]
    opened.page.focus(MAPS)
    for _ in range(12):
        opened.page.keyboard.press("+")
    after = [coloured(opened, n)[1] for n in range(2)]
    assert all(a < 0.5 * b for a, b in zip(after, before, strict=True))
    opened.page.keyboard.press("0")
    # The frame of a map in focus covers a few pixels.
    again = [coloured(opened, n)[1] for n in range(2)]
    assert again == pytest.approx(before, rel=0.01)


def test_maps_are_read_by_keys(pages, report):
    """Arrows move the cursor by ten pixels, with Shift by one; zoomed maps follow it."""
    opened = pages.open(report, width=1280, height=900)
    opened.page.wait_for_selector(MAPS)
    cloud = measured_bust().points
    rows, columns = cloud.shape
    opened.page.focus(MAPS)
    opened.page.keyboard.press("ArrowRight")
    opened.page.keyboard.press("Shift+ArrowUp")
    told = opened.page.inner_text(".told")
    assert told.startswith(f"Column {columns // 2 + 10}, row {rows // 2 - 1}: ")
    for _ in range(8):
        opened.page.keyboard.press("+")
    for _ in range(40):
        opened.page.keyboard.press("ArrowLeft")
    assert opened.page.inner_text(".told").startswith(f"Column 0, row {rows // 2 - 1}: ")


@pytest.mark.parametrize("dark", [False, True])
def test_narrow_pages_do_not_scroll_sideways(pages, report, dark):
    opened = pages.open(report, width=400, height=800, dark=dark)
    opened.page.wait_for_selector(MAPS)
    widths = opened.page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
    assert widths[0] <= widths[1]
    # All controls of the viewer are seen without scrolling inside of it.
    panel = opened.page.evaluate(
        "[...document.querySelectorAll('.panel')].map((p) => p.scrollHeight - p.clientHeight)"
    )
    assert max(panel) <= 1
    background = opened.page.evaluate("getComputedStyle(document.body).backgroundColor")
    shades = [int(v) for v in re.findall(r"\d+", background)]
    assert (np.mean(shades) < 60) == dark
    contrasts = opened.contrasts()
    assert len(contrasts) > 100
    assert min(contrasts, key=lambda pair: pair[1])[1] >= 4.5, contrasts


def test_the_printed_page_has_maps_and_no_viewer(pages, report):
    opened = pages.open(report, width=1280, height=900)
    opened.page.wait_for_selector(MAPS)
    opened.page.emulate_media(media="print")
    assert not opened.page.is_visible(".fringe-viewer-mount")
    assert opened.page.is_visible(MAPS)
    assert len(opened.page.pdf()) > 50_000


def test_cursors_of_viewer_and_maps_are_linked(pages, report):
    opened = pages.open(report)
    opened.page.wait_for_selector(MAPS)
    viewer = "document.querySelector('.fringe-viewer-mount').viewer"
    told = opened.page.evaluate(
        f"() => {{ {viewer}.point(0); {viewer}.point(5 * {viewer}.surfaces[0].width + 7);"
        " return document.querySelector('.told').textContent; }"
    )
    assert told.startswith("Column 7, row 5:")


def test_tables_of_parts_are_searched_and_link_to_their_reports(pages):
    rows = tuple((f"B-{k:04d}", "fail" if k % 10 == 0 else "pass") for k in range(40))
    links = tuple(f"parts/{name}.html" for name, _ in rows)
    table = Table(("part", "verdict"), rows, "Parts", links=links, search=True)
    html = page_html("Lot", [Chapter("Parts", (table,))], made_by("test", options={}))
    opened = pages.open(html, ready=False)
    box = opened.page.locator(".search input")
    for words, count in (("b-00", 40), ("FAIL 03", 1), ("nothing", 0), ("", 40)):
        box.fill(words)
        assert opened.page.locator("tbody tr:visible").count() == count, words
    box.fill("fail")
    assert opened.page.inner_text(".search output") == "4 of 40"
    assert opened.page.locator("tbody a").nth(7).get_attribute("href") == "parts/B-0007.html"
