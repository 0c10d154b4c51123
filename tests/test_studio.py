"""The studio in a browser, on virtual devices."""

from __future__ import annotations

import time

import pytest

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.devices.virtual_bench import RADIUS_MM
from tests import browser
from tests.studio_page import Running, Visitor

chromium = browser.chromium


@pytest.fixture
def studio(tmp_path):
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
    visitor.click("Export")
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
