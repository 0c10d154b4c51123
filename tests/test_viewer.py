"""The viewer in a browser: its points, figures, keys and pictures; hostile content."""

from __future__ import annotations

import base64
import re
import subprocess
import sys
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import fringeworks as fw
from fringeworks.files.points import Points
from fringeworks.report.viewer.page import (
    MODULES,
    viewer_fragment,
    viewer_page,
    viewer_script,
    viewer_style,
)
from fringeworks.surface.cloud import cloud_triangles
from fringeworks.surface.height_map import height_map_points, height_map_triangles
from fringeworks.surface.section import organised_points
from tests import browser
from tests.surfaces import (
    HOSTILE,
    height_map,
    measured_bust,
    random_cloud,
    small_rig,
    without_values,
    worn,
)

chromium, pages = browser.chromium, browser.pages  # fixtures
SOURCE = Path(__file__).parent.parent / "src" / "fringeworks" / "report" / "viewer"


@cache
def bust_page() -> str:
    return viewer_page(fw.report.pack_surface(measured_bust(), camera=small_rig(), title="bust"))


def bust() -> fw.PointCloud:
    return measured_bust().points


def points_of(opened, surface="V.surfaces[0]") -> np.ndarray:
    """All points as the page has them, (n, 3)."""
    text = opened.js(
        f"(() => {{ const b = new Uint8Array({surface}.points.buffer); let s = '';"
        "for (let i = 0; i < b.length; i += 8192) s += String.fromCharCode(...b.subarray(i, i + 8192));"
        "return btoa(s); })()"
    )
    return np.frombuffer(base64.b64decode(text), "<f8").reshape(-1, 3)


@pytest.mark.system
@pytest.mark.parametrize(
    ("result", "options"),
    [
        pytest.param(measured_bust, {"camera": small_rig()}, id="bust"),
        pytest.param(lambda: random_cloud(0, on_rays=False), {}, id="three coordinates"),
        pytest.param(height_map, {}, id="heights"),
        pytest.param(lambda: height_map(pupil=False), {}, id="heights without a pupil"),
    ],
)
def test_points_read_back_within_an_eighth_of_sigma(pages, result, options):
    found = result()
    surface = found.points if isinstance(found, fw.Measurement) else found
    opened = pages.open(viewer_page(fw.report.pack_surface(found, **options)))
    points = points_of(opened).reshape(*surface.reason.shape, 3)
    sigma = surface.sigma if isinstance(surface, fw.HeightMap) else surface.sigma_mm
    ok = surface.reason == 0
    error = np.linalg.norm(points - organised_points(surface), axis=-1)[ok]
    assert (error <= sigma[ok] / 8).all()
    reasons = opened.js("V.surfaces[0].reason.join(' ')")
    assert reasons == " ".join(map(str, surface.reason.ravel()))


@pytest.mark.system
def test_a_list_of_points_is_shown_as_it_is(pages):
    xyz = np.random.default_rng(0).normal(0, 20, (500, 3)) + np.array([0, 0, 400])
    opened = pages.open(viewer_page(fw.report.pack_surface(Points(xyz, None))))
    np.testing.assert_array_equal(points_of(opened), xyz)
    assert coloured(opened.picture(), opened) > 0.001


def coloured(picture, opened) -> float:
    """Share of a picture that is not background."""
    background = np.array(
        [int(v) for v in opened.js("getComputedStyle(V.ui.stage).backgroundColor.match(/\\d+/g)")]
    )
    return float((np.abs(picture - background).max(axis=-1) > 12).mean())


@pytest.mark.system
def test_triangles_are_those_of_the_library(pages):
    opened = pages.open(bust_page())
    count = "V.scene.level(V.surfaces[0].mesh, 1).faces.count / 3"
    # Coordinates differ by up to σ/8, so that a triangle at a limit may fall to the other side.
    assert opened.js(count) == pytest.approx(len(cloud_triangles(bust())), rel=2e-3)
    surface = height_map()
    opened = pages.open(viewer_page(fw.report.pack_surface(surface)))
    index = height_map_points(surface)[2]
    assert opened.js(count) == len(height_map_triangles(surface, index))


def normals_of(opened) -> np.ndarray:
    text = opened.js("V.surfaces[0].mesh.normals.join(' ')")
    return np.array(text.split(), float).reshape(-1, 4)[:, :3] / 127.0


@pytest.mark.system
def test_normals_agree_with_the_library(pages):
    opened = pages.open(bust_page())
    opened.rest()
    expected = fw.surface.normals(bust()).reshape(-1, 3)
    found = normals_of(opened)
    both = np.isfinite(expected[:, 0]) & (np.abs(found).max(axis=1) > 0)
    assert both.mean() > 0.3
    cosine = np.sum(expected[both] * found[both], axis=1)
    # The windows differ at edges. On the surface, bytes and noise leave about two degrees.
    assert np.median(cosine) > np.cos(np.radians(2))
    assert np.mean(cosine > 0.9) > 0.9


def camera_view(opened):
    opened.ui("picture").focus()
    opened.page.keyboard.press("1")
    opened.rest()


def measured_pixels(window) -> np.ndarray:
    """Pixels of the bust in a window of its frame, in the middle of measured ones."""
    top, bottom, left, right = window
    mask = np.zeros(bust().shape, bool)
    mask[top:bottom, left:right] = True
    return np.flatnonzero(mask & (bust().reason == 0))


FOREHEAD = (60, 85, 160, 200)


@pytest.mark.system
def test_the_value_under_the_cursor_with_sigma_or_the_reason(pages):
    opened = pages.open(bust_page())
    camera_view(opened)
    pixel = int(measured_pixels(FOREHEAD)[40])
    opened.page.mouse.move(*opened.place(pixel))
    said = opened.text("readout")
    place = re.match(
        r"column (\d+), row (\d+): x (\S+), y (\S+) mm, z (\S+) mm, σ (\S+) mm, modulation (\S+)",
        said,
    )
    assert place, said
    column, row = int(place[1]), int(place[2])
    # Some pixels fall on one place of the screen: the one in front is told.
    assert abs(column - pixel % 320) <= 1
    assert abs(row - pixel // 320) <= 1
    xyz = np.array([float(place[k].replace("−", "-")) for k in (3, 4, 5)])
    sigma = bust().sigma_mm[row, column]
    assert np.abs(xyz - bust().xyz_mm[row, column]).max() < sigma / 8 + 0.5e-3
    assert float(place[6]) == pytest.approx(sigma, rel=0.07)  # two digits
    shadow = np.flatnonzero(bust().reason == fw.Reason.SHADOW)
    places = [opened.place(p) for p in shadow[:: len(shadow) // 12]]
    found = []
    for x, y in places:
        opened.page.mouse.move(x, y)
        found.append(opened.text("readout"))
    told = [text for text in found if "no value (shadow): the projector does not light" in text]
    assert len(told) > len(places) / 2
    assert "What to do: turn the object, or scan it again from another side." in told[0]


def click(opened, pixel):
    """Pick at a pixel; return the one that the viewer took."""
    opened.page.mouse.click(*opened.place(pixel))
    return opened.js("V.tools.picks.at(-1)")


@pytest.mark.system
def test_two_picks_give_the_distance_and_the_profile_of_the_library(pages):
    opened = pages.open(bust_page())
    camera_view(opened)
    opened.page.keyboard.press("d")
    i = click(opened, measured_pixels(FOREHEAD)[3])
    j = click(opened, measured_pixels((205, 215, 120, 140))[7])
    ends = [(p % 320, p // 320) for p in (i, j)]
    expected = bust().profile(ends, level=True)
    length = expected.along_mm[-1]
    sigma = [float(bust().sigma_mm[row, column]) for column, row in ends]
    shown = re.search(r"Distance\s+(\S+) ± (\S+) mm", opened.text("result"))
    # Both ends may be off by σ/8, and the text is rounded.
    assert float(shown[1]) == pytest.approx(length, abs=sum(sigma) / 8 + 1e-3)
    assert 0 < float(shown[2]) <= np.hypot(*sigma) * 1.02 + 1e-3
    samples = opened.js("V.tools.samples")
    found = np.array([[np.nan if v is None else v for v in row] for row in samples], float)
    np.testing.assert_array_equal(np.isnan(found[:, 0]), np.isnan(expected.along_mm))
    allowed = (np.nan_to_num(expected.sigma) + sum(sigma)) / 8
    assert (np.abs(np.nan_to_num(found[:, 0] - expected.along_mm)) <= allowed).all()
    assert (np.abs(np.nan_to_num(found[:, 1] - expected.values)) <= allowed).all()
    # σ along the ray, in 8 bits, as it counts across the line.
    ratio = found[:, 2] / expected.sigma
    assert ((ratio > 0.97) & (ratio < 1.03))[np.isfinite(ratio)].all()
    assert opened.ui("chart").is_visible()


def drag(opened, window):
    """Drag a rectangle around a window of the frame; return the chosen pixels."""
    top, bottom, left, right = window
    first, last = opened.place(top * 320 + left), opened.place(bottom * 320 + right)
    opened.page.mouse.move(*first)
    opened.page.mouse.down()
    opened.page.mouse.move(*last, steps=3)
    opened.page.mouse.up()
    return np.array(opened.js("V.tools.chosen.pixels"))


@pytest.mark.system
@pytest.mark.parametrize(
    ("body", "window"), [("sphere", FOREHEAD), ("plane", (226, 250, 130, 190))]
)
def test_a_region_fits_what_the_library_fits(pages, body, window):
    opened = pages.open(bust_page())
    camera_view(opened)
    opened.page.keyboard.press("r")
    opened.ui("body").select_option(body)
    pixels = drag(opened, window)
    assert len(pixels) > 150
    found = opened.js("({...V.tools.result, distances: Array.from(V.tools.result.distances)})")
    assert "mm" in opened.text("result")
    # On the page's own points: the same least squares, stopped at other places.
    own = fw.surface.fit_region(points_of(opened)[pixels], body)
    # On the measured ones: σ/8 in every point, which leaves less in their mean.
    measured = fw.surface.fit_region(organised_points(bust()).reshape(-1, 3)[pixels], body)
    sigma = float(np.median(bust().sigma_mm.ravel()[pixels]))
    for form, tolerance in ((own, 2e-5), (measured, sigma / 8)):
        assert found["deviation"] == pytest.approx(form.deviation_mm, abs=tolerance)
        assert found["range"] == pytest.approx(
            form.spread_mm(), abs=2 * tolerance + sigma / 4 * (form is measured)
        )
        if body == "sphere":
            assert found["radius"] == pytest.approx(
                form.parameters["radius_mm"], abs=10 * tolerance
            )
            assert np.allclose(found["centre"], form.parameters["centre_mm"], atol=10 * tolerance)
        else:
            assert np.dot(found["normal"], form.parameters["normal"]) > 1 - 1e-6
    if body == "sphere":
        assert found["radiusSigma"] == pytest.approx(own.sigma_mm, rel=0.02)
        assert found["radius"] == pytest.approx(30.0, abs=5 * own.sigma_mm + 0.05)
    # The page's distances count along the normal that it tells, towards the camera.
    sign = np.sign(np.dot(found["distances"], own.distance_mm)) if body == "plane" else 1.0
    np.testing.assert_allclose(found["distances"], sign * own.distance_mm, atol=1e-4)
    assert opened.js("V.surfaces[0].layers.some(({ name }) => name === 'fit')")


@pytest.mark.system
def test_what_cannot_be_fitted_says_why(pages):
    opened = pages.open(bust_page())
    camera_view(opened)
    opened.page.keyboard.press("r")
    opened.ui("body").select_option("sphere")
    drag(opened, (226, 250, 130, 190))
    assert "does not determine a sphere" in opened.text("result")
    opened.ui("body").select_option("plane")
    drag(opened, (60, 85, 160, 230))
    assert "No plane fits the region" in opened.text("result")
    drag(opened, (226, 240, 125, 222))
    assert "lie off the plane: choose less" in opened.text("result")
    for corner in (30, 34):  # beside the surface
        opened.page.mouse.click(corner, corner)
    assert "10 points or more, got 0" in opened.text("result")


@pytest.mark.system
def test_two_results_side_by_side_and_as_the_difference_of_the_library(pages):
    other = worn(bust())
    one, two = (
        fw.report.pack_surface(cloud, camera=small_rig(), title=name)
        for cloud, name in ((bust(), "new"), (other, "worn"))
    )
    opened = pages.open(viewer_page(one, two))
    alone = opened.picture()
    opened.ui("show").select_option("both")
    beside = opened.picture()
    assert np.abs(alone - beside).max() > 50
    half = beside.shape[1] // 2
    # The cameras are locked, so both halves show nearly the same.
    halves = np.abs(beside[:, 20 : half - 60] - beside[:, half + 20 : 2 * half - 60])
    assert np.mean(halves.max(axis=-1) > 60) < 0.02
    opened.ui("show").select_option("difference")
    assert opened.text("title") == "worn − new"
    values, sigma = fw.surface.difference(bust(), other)
    found = opened.js("V.gap.layers.find(({ name }) => name === 'difference').values.join(' ')")
    found = np.array(found.split(), float).reshape(values.shape)
    known = np.isfinite(values)
    np.testing.assert_array_equal(np.isfinite(found), known)
    allowed = (bust().sigma_mm + other.sigma_mm)[known] / 8 + 1e-5
    assert (np.abs(found - values)[known] <= allowed).all()
    told = np.array(opened.js("V.gap.sigma.join(' ')").split(), float).reshape(values.shape)
    np.testing.assert_allclose(told[known], sigma[known], rtol=0.016)


@pytest.mark.system
def test_a_difference_of_unlike_surfaces_is_refused_in_words(pages):
    page = viewer_page(
        fw.report.pack_surface(bust(), camera=small_rig()), fw.report.pack_surface(height_map())
    )
    opened = pages.open(page)
    opened.ui("show").select_option("difference")
    assert "two surfaces of one kind, size, pitch and unit" in opened.text("readout")
    assert opened.js("V.ui.show.value") == "one"


@pytest.mark.system
def test_five_views_none_is_blank_and_no_two_are_alike(pages):
    opened = pages.open(bust_page())
    opened.ui("picture").focus()
    pictures = []
    for key in "12345":
        opened.page.keyboard.press(key)
        pictures.append(opened.picture())
        assert coloured(pictures[-1], opened) > 0.02, key
    for k, one in enumerate(pictures):
        for other in pictures[:k]:
            assert np.mean(np.abs(one - other).max(axis=-1) > 30) > 0.02


@pytest.mark.system
def test_layers_light_range_and_clip_planes_change_the_picture(pages):
    opened = pages.open(bust_page())
    camera_view(opened)
    seen = [opened.picture()]
    for layer in ("sigma", "modulation", "texture", "reason", "plain", "cloud"):
        opened.ui("layer").select_option(layer)
        seen.append(opened.picture())
    for one, other in pairwise(seen):
        assert np.mean(np.abs(one - other).max(axis=-1) > 30) > 0.02
    np.testing.assert_array_equal(seen[0], seen[-1])
    opened.ui("low").fill("600")
    assert np.abs(opened.picture() - seen[-1]).max() > 50
    opened.page.keyboard.press("h")
    hidden = opened.picture()
    assert coloured(hidden, opened) < 0.9 * coloured(seen[-1], opened)
    opened.page.get_by_text("Clip planes").click()
    opened.page.get_by_label("z to").fill("100")
    assert coloured(opened.picture(), opened) == 0
    opened.page.keyboard.press("u")
    opened.page.get_by_label("z to").fill("1000")
    assert coloured(opened.picture(), opened) > coloured(hidden, opened)


@pytest.mark.system
def test_the_keyboard_reaches_everything(pages):
    opened = pages.open(bust_page())
    names = opened.js(
        "[...V.root.querySelectorAll('button, select, input, summary, canvas[tabindex]')]"
        ".filter((e) => e.checkVisibility() && !(e.type === 'radio' && !e.checked)).length"
    )
    reached = set()
    opened.ui("picture").focus()
    for _ in range(names + 3):
        reached.add(
            opened.page.evaluate(
                "[...document.querySelectorAll('*')].indexOf(document.activeElement)"
            )
        )
        opened.page.keyboard.press("Tab")
    assert len(reached) >= names
    camera_view(opened)
    before = opened.js("[V.view.yaw, V.view.scale, ...V.view.target]")
    for key in ("ArrowRight", "Shift+ArrowUp", "+"):
        opened.page.keyboard.press(key)
    after = opened.js("[V.view.yaw, V.view.scale, ...V.view.target]")
    assert all(a != b for a, b in zip(before[:2], after[:2], strict=True))
    assert before[3] != after[3]
    camera_view(opened)
    for key in ("d", "c", "ArrowLeft", "Enter", "ArrowUp", "Shift+ArrowUp", "Enter"):
        opened.page.keyboard.press(key)
    assert opened.js("V.tools.picks.length") == 2
    assert "Distance" in opened.text("result")
    opened.page.keyboard.press("Escape")
    assert opened.js("V.cross") is None


@pytest.mark.system
def test_every_control_has_a_name(pages):
    opened = pages.open(bust_page())
    nameless = opened.js(
        "[...V.root.querySelectorAll('button, select, input, canvas')].filter((e) => !e.hidden &&"
        "!e.ariaHidden && !e.ariaLabel && !e.labels?.length && !e.textContent.trim()).map((e) => e.outerHTML)"
    )
    assert nameless == []


@pytest.mark.system
@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("width", [1280, 400])
def test_schemes_and_widths(pages, dark, width):
    opened = pages.open(bust_page(), width=width, dark=dark)
    assert coloured(opened.picture(), opened) > 0.02
    assert opened.page.evaluate("document.documentElement.scrollWidth") <= width
    contrasts = opened.contrasts()
    assert len(contrasts) > 15
    assert min(contrasts, key=lambda pair: pair[1])[1] >= 4.5, contrasts
    background = opened.js("getComputedStyle(V.root).backgroundColor")
    assert (np.mean([int(v) for v in re.findall(r"\d+", background)]) < 60) == dark


@pytest.mark.system
def test_hostile_names_are_shown_as_text(pages):
    notes = tuple(f"{k} {HOSTILE}" for k in range(10_000))
    packed = fw.report.pack_surface(bust(), camera=small_rig(), title=HOSTILE, notes=notes)
    opened = pages.open(viewer_page(packed, title=HOSTILE))
    assert opened.page.title() == HOSTILE
    assert opened.text("title") == HOSTILE
    opened.ui("notesTitle").click()
    own = len(bust().notes)
    assert opened.text("notesTitle") == f"Notes ({own + 10_000})"
    assert f"… and {own + 9_800} more notes" in opened.text("notes")
    assert HOSTILE in opened.text("notes")
    assert opened.page.evaluate("window.hacked") is None


@pytest.mark.system
@pytest.mark.parametrize("kind", ["nothing", "one pixel", "two pixels in a row"])
def test_surfaces_with_hardly_anything(pages, kind):
    cloud = without_values(random_cloud(0))
    if kind != "nothing":
        shape = (1, 1) if kind == "one pixel" else (1, 2)
        xyz = np.array([[[1, 2, 400], [2, 2, 401]]], np.float32)[:, : shape[1]]
        sigma = np.full(shape, 0.1, np.float32)
        cloud = fw.PointCloud(xyz, sigma, sigma, np.zeros(shape, np.uint8))
    opened = pages.open(viewer_page(fw.report.pack_surface(cloud)))
    opened.rest()
    if kind == "nothing":
        assert "No pixel has a value." in opened.text("readout")
        assert "shadow" in opened.text("legend")
    else:
        words = "1 point, 100.0 %" if shape[1] == 1 else "2 points, 100.0 %"
        assert words in opened.text("summary")
        opened.page.mouse.move(*opened.place(0))
        told = re.findall(r"-?[\d.]+(?= mm|,)", opened.text("readout").partition(": ")[2])
        assert np.allclose(np.array(told, float), [1, 2, 400, 0.1], atol=0.1 / 8 + 0.005)


def damaged(data: bytes, kind: str) -> bytes:
    if kind == "cut off":
        return data[: len(data) // 2]
    if kind == "another magic":
        return b"x" + data[1:]
    old, new = b'"size": [31, 23]', b'"size": [9999999, 9999999]'
    size = int.from_bytes(data[8:12], "little") + len(new) - len(old)
    return data[:8] + size.to_bytes(4, "little") + data[12:].replace(old, new)


@pytest.mark.system
@pytest.mark.parametrize("kind", ["cut off", "another magic", "too many pixels"])
def test_damaged_content_is_refused_in_words(pages, kind):
    packed = fw.report.pack_surface(random_cloud(0))
    opened = pages.open(viewer_page(replace(packed, data=damaged(packed.data, kind))))
    words = {"another magic": "not a packed surface", "too many pixels": "a page shows at most"}
    assert words.get(kind, "") in opened.text("readout")
    assert opened.ui("readout").get_attribute("role") == "alert"
    assert opened.text("readout")


@pytest.mark.system
def test_a_page_of_somebody_elses_holds_two_viewers(pages):
    fragments = [viewer_fragment(fw.report.pack_surface(s)) for s in (height_map(), bust())]
    style = f"<style>{viewer_style()} .fringe-viewer-mount {{ height: 400px }}</style>"
    script = f"<script>{viewer_script()}</script>"
    opened = pages.open(
        f"<!doctype html><meta charset=utf-8>{style}{fragments[0]}<p>text{fragments[1]}{script}"
    )
    counts = opened.page.evaluate(
        "Promise.all([...document.querySelectorAll('.fringe-viewer-mount')].map(async (e) => {"
        "await e.viewer.ready; return e.viewer.surfaces[0].header.count; }))"
    )
    assert counts == [int((s.reason == 0).sum()) for s in (height_map(), bust())]
    opened.page.locator("[data-ui=light]").nth(1).uncheck()
    assert opened.page.locator("[data-ui=light]").nth(0).is_checked()
    # One name is all that the script adds to the page.
    added = opened.page.evaluate(
        "(() => { const f = document.createElement('iframe'); document.body.append(f);"
        "const own = new Set(Object.getOwnPropertyNames(f.contentWindow)); f.remove();"
        "return Object.getOwnPropertyNames(window).filter((n) => !own.has(n) && isNaN(n)); })()"
    )
    assert added == ["FringeViewer"]


@pytest.mark.system
def test_turning_draws_a_coarser_raster_and_then_all_points(pages):
    opened = pages.open(bust_page())
    opened.rest()
    opened.js("V.stride = 4")
    x, y = opened.place(128 * 320 + 160)
    opened.page.mouse.move(x, y)
    opened.page.mouse.down()
    opened.page.mouse.move(x + 60, y + 20, steps=2)
    assert not opened.js("V.rested")
    assert opened.js("V.surfaces[0].mesh.levels.has(V.stride)")
    yaw = opened.js("V.view.yaw")
    opened.page.mouse.up()
    opened.rest()
    assert opened.js("V.view.yaw") == yaw != 0
    assert opened.js("V.surfaces[0].mesh.levels.get(1).faces.count") > 0


@pytest.mark.system
def test_the_script_is_clean():
    program = Path(sys.executable).with_name("oxlint")
    if not program.exists():
        pytest.skip("oxlint is not installed")
    done = subprocess.run(
        [program, "--deny-warnings", SOURCE], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


def test_the_modules_hold_what_they_say():
    texts = {name: (SOURCE / f"{name}.js").read_text(encoding="utf-8") for name in MODULES}
    assert {path.stem for path in SOURCE.glob("*.js")} == set(MODULES)
    # The template names the methods of its controls.
    template = (SOURCE / "viewer.html").read_text(encoding="utf-8")
    for name, text in texts.items():
        lines = text.splitlines()
        assert len(lines) <= 400, name
        assert max(map(len, lines)) <= 100, name
        rest = "".join(other for key, other in texts.items() if key != name)
        for exported in re.findall(
            r"^export (?:async )?(?:function|class|const) (\w+)", text, re.M
        ):
            assert exported == "FringeViewer" or re.search(rf"\b{exported}\b", rest), exported
        # Data never becomes markup; the template is the only exception, and it is a constant.
        assert "insertAdjacentHTML" not in text
        assert set(re.findall(r"innerHTML = (\w+)", text)) <= {"TEMPLATE"}
        # Methods and functions that nobody calls.
        for function in re.findall(
            r"^(?:  |)(?:async |get |function )*(\w+)\(.*\) \{$", text, re.M
        ):
            everywhere = template + "".join(texts.values())
            uses = len(re.findall(rf"\b{function}\b", everywhere))
            assert uses >= 2 or function in ("constructor", "handleEvent"), f"{name}.{function}"


@pytest.fixture
def deviating(pages):
    """A plate with a dent before its drawing, and flags."""
    y, x = np.mgrid[0:60, 0:80].astype(float)
    dent = -0.4 * np.exp(-((x - 40) ** 2 + (y - 30) ** 2) / 20.0)
    xyz = np.stack((0.5 * x, 0.5 * y, 300.0 - dent), -1).astype(np.float32)
    small = np.full((60, 80), 0.01, np.float32)
    cloud = fw.PointCloud(xyz, small, small, np.zeros((60, 80), np.uint8))
    corners = np.array([[-5, -5, 300], [45, -5, 300], [45, 35, 300], [-5, 35, 300]], np.float32)
    drawing = fw.TriangleMesh(corners, np.array([[0, 2, 1], [0, 3, 2]], np.uint32))
    packed = fw.report.pack_surface(
        cloud,
        deviation=dent,
        limits=(-0.1, 0.1),
        model=drawing,
        flags=[(30, 40, "−0.400 mm")],
    )
    return pages.open(viewer_page(packed))


@pytest.mark.system
def test_a_deviation_opens_on_its_map_with_drawing_and_flags(deviating):
    opened = deviating
    assert opened.js("V.layer.name") == "deviation"
    assert opened.js("V.scale.range") == pytest.approx([-0.1, 0.1])
    assert re.fullmatch(r"beyond the scale: \d+\.\d %", opened.text("beyond"))
    assert opened.js("[...document.querySelectorAll('.flags b')].map((b) => b.textContent)")[0] == (
        "−0.400 mm"
    )
    with_drawing = opened.picture()
    opened.ui("model").uncheck()
    opened.rest()
    # The drawing reaches out behind the points.
    assert np.mean(np.abs(with_drawing - opened.picture()).max(axis=-1) > 15) > 0.01


@pytest.mark.system
def test_ends_of_the_scale_are_typed_and_depth_is_drawn_larger(deviating):
    opened = deviating
    opened.ui("highText").fill("0.5")
    opened.ui("lowText").fill("-0.5")
    opened.ui("lowText").press("Tab")
    assert opened.js("V.scale.range") == pytest.approx([-0.5, 0.5])
    assert opened.text("beyond") == ""
    opened.ui("highText").fill("-0.7")  # below the lower end: refused
    opened.ui("highText").press("Tab")
    assert opened.js("V.scale.range") == pytest.approx([-0.5, 0.5])
    flat = opened.js("V.view.half[2]")
    opened.ui("exaggeration").fill("20")
    opened.ui("exaggeration").press("Tab")
    assert opened.js("V.view.half[2]") == pytest.approx(20 * flat)
    span = "Math.max(...V.surfaces[0].shown.filter((_, k) => k % 3 === 2))"
    assert opened.js(f"{span}") > 20 * 0.15
    assert opened.js("V.surfaces[0].mesh.model.list.count") == 6
    opened.ui("exaggeration").fill("0")
    opened.ui("exaggeration").press("Tab")
    assert opened.js("V.view.half[2]") == pytest.approx(20 * flat)


@pytest.mark.system
def test_picked_points_get_flags_and_lose_them(deviating):
    opened = deviating
    opened.js("(V.ui.panel.elements.tool.value = 'flag', V.tools.change())")
    at = opened.js("V.view.project(V.surfaces[0].shown.subarray(3 * 1620, 3 * 1620 + 3))")
    for count in (2, 1):
        opened.js("V.tools.pick(a[0], a[1])", at)
        assert opened.js("V.surfaces[0].header.flags.length") == count
