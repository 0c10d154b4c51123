"""Batch and Certify in the studio: many parts by one recipe, certificates, studies, watched rigs."""

from __future__ import annotations

import re
import shlex
import shutil
from urllib.parse import unquote

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.cli.commands import run
from fringeworks.devices.bench import virtual_rig
from fringeworks.evaluate import plan_positions
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.standard import bust, fringe_plan
from fringeworks.simulate.virtual_rig import look
from tests import browser, test_certificate
from tests.axe import overflow, violations
from tests.studio_page import Running, Visitor

pytestmark = pytest.mark.system

chromium = browser.chromium
PARTS = 3
TRIALS = "part,operator,trial,length\n"


def add_parts(folder, count=PARTS):
    """Captures of busts with a rig and a recipe; the last one lies in the dark."""
    rig = virtual_rig()
    fw.files.write_rig(folder / "rig.toml", rig)
    plan = fringe_plan(rig, both=False)
    for k in range(count):
        frames = list(photograph(look(rig, bust()), plan, Optics(seed=k + 1)))
        if k == count - 1:
            frames = [np.zeros_like(frame) for frame in frames]
        fw.files.write_stack(folder / "line" / f"part-{k + 1:02d}", frames, plan)
    face = fw.evaluate.Area(box=(20, 20, 70, 70))
    tolerances = (
        fw.evaluate.PartTolerance("flatness of face", "flatness", ("face",), None, 0.6),
        fw.evaluate.PartTolerance("share <of> face", "valid_share", ("face",), 0.5, None),
    )
    recipe = fw.Recipe(areas={"face": face}, tolerances=tolerances, rig=folder / "rig.toml")
    fw.files.write_recipe(folder / "recipe.toml", recipe)


def add_test(folder):
    """An acceptance test whose scans are exact balls."""
    file = folder / "acceptance.toml"
    file.write_text(test_certificate.TOML, encoding="utf-8")
    lines = [test_certificate.TOML]
    for k, one in enumerate(plan_positions(fw.files.read_acceptance_test(file))):
        fw.write(folder / f"s{k}.ply", test_certificate.scan(one, k).scan)
        lines.append(f'[[scans]]\nartefact = "ball bar"\nscan = "s{k}.ply"\nname = "bar {k}"\n')
    file.write_text("".join(lines), encoding="utf-8")


def add_trials(folder):
    rng = np.random.default_rng(3)
    sizes = rng.normal(0.0, 0.1, 5)
    rows = [
        f"P{p},O{o},{t},{5 + size + rng.normal(0, 0.01):.5f}\n"
        for p, size in enumerate(sizes)
        for o in range(2)
        for t in range(2)
    ]
    (folder / "trials.csv").write_text(TRIALS + "".join(rows))


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    folder = tmp_path_factory.mktemp("proofs") / "work"
    folder.mkdir()
    add_parts(folder)
    add_test(folder)
    add_trials(folder)
    running = Running(folder)
    yield running
    running.close()


@pytest.fixture
def entered(chromium, studio):
    contexts = []

    def enter(path, *, width=1280, dark=False):
        scheme = "dark" if dark else "light"
        contexts.append(
            chromium.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
        )
        return Visitor(contexts[-1], studio.address.rstrip("/") + path)

    yield enter
    for context in contexts:
        context.close()


def replay(studio, visitor, where, monkeypatch, count):
    """Do what the export says, as commands and as Python, each in a folder of its own."""
    visitor.step("Export")
    shell, python = (visitor.page.locator(".fw-code").nth(k).inner_text() for k in range(2))
    made = {}
    for name in ("shell", "python"):
        made[name] = where / name
        made[name].mkdir()
        for entry in studio.folder.iterdir():
            if entry.name == "line":
                shutil.copytree(entry, made[name] / "line")
            elif entry.suffix in (".toml", ".ply", ".csv"):
                shutil.copy(entry, made[name])
    monkeypatch.chdir(made["shell"])
    for line in shell.splitlines()[-count:]:
        assert run(shlex.split(line)[1:]) in (0, 3, 4, 5), line
    monkeypatch.chdir(made["python"])
    exec(python, {})
    return made


def rows(visitor):
    return visitor.page.locator(".fw-scroll tbody tr")


def test_a_batch_has_a_table_charts_and_reports(studio, entered, tmp_path, monkeypatch):
    visitor = entered("/batch")
    page = visitor.page
    visitor.sees("3 captures.")
    visitor.click("Judge the parts")
    page.locator(".fw-scroll caption").wait_for(timeout=120_000)
    assert rows(visitor).count() == PARTS
    found = {
        row.locator("th").inner_text(): row.locator("td").first.inner_text()
        for row in rows(visitor).all()
    }
    direct = {
        f"part-{k + 1:02d}": fw.inspect(
            studio.folder / "line" / f"part-{k + 1:02d}", studio.folder / "recipe.toml"
        ).verdict
        for k in range(PARTS - 1)
    }
    assert {name: found[name] for name in direct} == direct
    assert found["part-03"] != "pass"
    # Search, and a filter by verdict.
    page.get_by_label("Search").fill("part-02")
    page.wait_for_function("document.querySelectorAll('.fw-scroll tbody tr').length === 1")
    page.get_by_label("Search").fill("")
    visitor.choose("Verdict", found["part-03"])
    page.wait_for_function("document.querySelectorAll('.fw-scroll tbody tr').length === 1")
    visitor.choose("Verdict", "Any verdict")
    # A chart for each tolerance, in the page's colours.
    assert page.locator("picture img").count() == 2
    assert page.locator("picture img").first.evaluate("(e) => e.decode().then(() => 1)") == 1
    # A part's own report opens, without the studio's rights.
    link = page.locator(".fw-scroll tbody th a").first
    with page.context.expect_page() as opened:
        link.click()
    opened.value.wait_for_load_state()
    assert "part-01" in opened.value.title() + opened.value.inner_text("body")
    assert opened.value.evaluate("origin") == "null"
    assert unquote(opened.value.url).endswith("batch-parts/part-01.html")
    assert not visitor.complaints
    assert not violations(page)
    made = replay(studio, visitor, tmp_path, monkeypatch, 1)
    summary = (studio.folder / "batch" / "summary.csv").read_text().splitlines()
    for folder in made.values():
        again = (folder / "batch" / "summary.csv").read_text().splitlines()
        assert again[0] == summary[0]
        # Seconds and the worker's number differ.
        assert [line.split(",")[:5] for line in again] == [line.split(",")[:5] for line in summary]
        assert (folder / "batch.html").is_file()
    # The list of captures knows the verdicts, and a name that is taken is refused.
    visitor.step("Captures")
    page.locator(".fw-list [role=option]", has_text="pass").first.wait_for()
    visitor.step("Batch")
    page.get_by_label("Name of the results").fill("batch")
    visitor.click("Judge the parts")
    visitor.sees("has 'batch' already")


def test_a_certificate_states_the_verdict(studio, entered, tmp_path, monkeypatch):
    visitor = entered("/certify")
    page = visitor.page
    visitor.click("List the positions")
    visitor.sees("space diagonal")
    visitor.click("Certify")
    page.locator("[role=status].fw-good", has_text="pass").wait_for(timeout=60_000)
    assert page.locator(".fw-table tbody tr").count() >= 1
    assert not violations(page)
    text = (studio.folder / "certificate.html").read_text("utf-8")
    assert "all limits are kept" in text
    with page.context.expect_page() as opened:
        page.get_by_role("link", name="Open the report certificate.html").click()
    opened.value.wait_for_load_state()
    assert "PASS: all limits are kept" in opened.value.inner_text("body")
    assert not visitor.complaints
    made = replay(studio, visitor, tmp_path, monkeypatch, 1)
    for folder in made.values():
        assert "all limits are kept" in (folder / "certificate.html").read_text("utf-8")


def test_a_gauge_is_studied(studio, entered):
    visitor = entered("/certify")
    page = visitor.page
    page.locator("summary", has_text="good enough").click()
    visitor.choose("Table", "trials.csv")
    page.get_by_label("Column of the values").fill("length")
    page.get_by_label("Width of the tolerance").fill("2")
    visitor.click("Judge the gauge")
    visitor.sees(re.compile("pass: the gauge takes"))
    page.locator("picture img").first.wait_for()
    assert "the gauge is accepted" in (studio.folder / "study.html").read_text("utf-8")
    page.get_by_label("Column of the values").fill("nothing")
    visitor.click("Judge the gauge")
    page.get_by_role("alert").filter(has_text="nothing").first.wait_for()
    assert not violations(page)


def test_a_rig_is_watched(entered):
    """Stripes along one axis say nothing about the rig, which is told."""
    visitor = entered("/certify")
    visitor.page.locator("summary", has_text="rig moved").click()
    visitor.click("Watch by all scans")
    visitor.sees(re.compile("says nothing about the rig"))
    assert not visitor.complaints


@pytest.mark.timeout(400)
def test_views_are_merged_by_steps(entered):
    """Two scans of one bust lie on each other: their shape says so."""
    visitor = entered("/scan")
    page = visitor.page
    page.locator("summary", has_text="Merge views").click()
    page.get_by_label("Views", exact=True).first.click()
    for name in ("line/part-01", "line/part-02"):
        page.get_by_role("option", name=name).click()
    page.keyboard.press("Escape")
    page.get_by_text("neighbouring views overlap").click()
    field = page.locator(".q-field", has=page.get_by_label("Views", exact=True))
    field.filter(has_text="line/part-01, line/part-02").wait_for()
    visitor.click("Merge the views")
    visitor.comes_to("**/look/merged.ply")
    assert visitor.surface() > 30_000
    assert not visitor.complaints
    visitor.step("Export")
    visitor.sees("fringeworks merge line/part-01.npz line/part-02.npz --poses shape")


@pytest.mark.parametrize("path", ["/batch", "/certify", "/scan"])
@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_pages_are_narrow_and_accessible(entered, path, dark):
    visitor = entered(path, width=390, dark=dark)
    for summary in visitor.page.locator("details.fw-more > summary").all():
        summary.click()
    visitor.page.wait_for_timeout(500)
    assert overflow(visitor.page) <= 0
    assert not violations(visitor.page)
