"""GLB in a browser: another program's loader draws the shape and the colours that were written."""

from __future__ import annotations

import base64
import io
import json
import struct
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import fringeworks as fw
from tests.browser import chromium
from tests.painted_ball import cloud, linear, paint

assert chromium

pytestmark = pytest.mark.system

SIZE = 400
PAGE = """
const data = "%s";
scene = new THREE.Scene();
scene.background = new THREE.Color(0x000000);
renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
renderer.setSize(%d, %d);
document.body.appendChild(renderer.domElement);
new THREE.GLTFLoader().load("data:text/plain;base64," + data, (gltf) => {
  // Without lights: the colours of the texture or of the vertices themselves.
  gltf.scene.traverse((part) => {
    if (!part.isMesh) return;
    const { map, vertexColors } = part.material;
    if (map) map.encoding = THREE.LinearEncoding;
    part.material = new THREE.MeshBasicMaterial({ map, vertexColors, side: THREE.DoubleSide });
  });
  scene.add(gltf.scene);
  const box = new THREE.Box3().setFromObject(gltf.scene);
  const c = box.getCenter(new THREE.Vector3()), s = box.getSize(new THREE.Vector3());
  const half = 0.5 * Math.max(s.x, s.y);
  const camera = new THREE.OrthographicCamera(-half, half, half, -half, 0.0, 10 * s.length());
  camera.position.set(c.x, c.y, box.max.z + s.length());
  camera.lookAt(c);
  renderer.render(scene, camera);
  window.shown = [c.x, c.y, half];
}, undefined, (error) => { window.shown = String(error); });
"""
"""Draws a file in parallel projection along z; ``shown`` is the middle and half the width."""


def page_of(content):
    """A page with the loader of three.js, which trimesh brings along, and a file."""
    trimesh = pytest.importorskip("trimesh")
    folder = Path(trimesh.__file__).parent / "resources" / "templates"
    with zipfile.ZipFile(folder / "viewer.zip") as archive:
        html = archive.read("viewer.html.template").decode("utf-8")
    code = PAGE % (base64.b64encode(content).decode(), SIZE, SIZE)
    begin, end = html.rindex("function init()"), html.rindex("</script>")
    return html[:begin] + code + html[end:]


def seen_in(browser, folder, content):
    """The picture of a file, (h, w, 3), with the middle and half the width of what it shows."""
    (folder / "page.html").write_text(page_of(content), encoding="utf-8")
    page = browser.new_page(viewport={"width": SIZE, "height": SIZE})
    complaints = []
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto((folder / "page.html").as_uri())
    page.wait_for_function("() => window.shown !== undefined", timeout=20_000)
    shown = page.evaluate("window.shown")
    url = page.evaluate("renderer.domElement.toDataURL()")
    page.close()
    assert not complaints, complaints
    assert isinstance(shown, list), shown
    picture = Image.open(io.BytesIO(base64.b64decode(url.split(",")[1]))).convert("RGB")
    return np.asarray(picture), shown


def expected_at(ball, shown):
    """Points of the ball, the pixels of the picture that show them, and their paint."""
    middle_x, middle_y, half = shown
    ok = ball.reason == 0
    place = ball.xyz_mm[ok] * (1e-3, -1e-3, -1e-3)
    column = np.rint((place[:, 0] - middle_x) / half * SIZE / 2 + SIZE / 2 - 0.5).astype(int)
    row = np.rint((middle_y - place[:, 1]) / half * SIZE / 2 + SIZE / 2 - 0.5).astype(int)
    return row.clip(0, SIZE - 1), column.clip(0, SIZE - 1), paint(ball.shape)[ok]


@pytest.fixture(scope="module")
def ball():
    return cloud()


@pytest.mark.parametrize("textured", [True, False])
def test_a_browser_draws_the_colours(ball, tmp_path, chromium, textured):
    mesh = fw.surface.cloud_mesh(ball)
    if not textured:
        mesh = replace(mesh, texture=None, texture_px=None)
    content = fw.write(tmp_path / "a.glb", mesh).read_bytes()
    length, kind = struct.unpack("<II", content[12:20])
    assert kind == 0x4E4F534A
    assert bool(json.loads(content[20 : 20 + length]).get("images")) == textured
    picture, shown = seen_in(chromium, tmp_path, content)
    row, column, wanted = expected_at(ball, shown)
    drawn = picture[row, column]
    # Vertex colours are light in glTF; the picture of a texture is in sRGB.
    found = linear(drawn) if textured else drawn / 255.0
    inside = (drawn > 20).all(axis=1) & (drawn < 255).all(axis=1)
    assert inside.mean() > 0.5
    scale = np.median(found[inside] / wanted[inside], axis=0)
    assert np.ptp(scale) < 0.02 * scale.mean()
    assert np.median(np.abs(found[inside] / scale / wanted[inside] - 1.0)) < 0.02
