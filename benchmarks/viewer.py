"""``python -m benchmarks.viewer``: size, first picture and speed of a surface of 2 million points.

Needs Chromium and playwright. The software renderer draws, as on a machine without a GPU.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from fringeworks.report import pack_surface
from fringeworks.report.viewer.page import viewer_page
from fringeworks.rig.pinhole import rays
from fringeworks.simulate.standard import standard_rig
from fringeworks.types import PointCloud, Rig

SCALE = 1.25
"""Size of the frame over the standard rig's: 1600 × 1280 px, 2,048,000 points."""
NOISE = 1.8
"""σ in mm times the modulation in counts: 0.03 mm where the fringes are strong."""
TURN_SECONDS = 4.0
"""How long the surface is turned."""
ARGUMENTS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
VIEWER = "document.querySelector('.fringe-viewer-mount').viewer"
TURNING = """async ([seconds]) => {
  const viewer = VIEWER;
  const stage = viewer.ui.picture;
  const gl = viewer.scene.gl;
  let frames = 0;
  const draw = viewer.scene.draw.bind(viewer.scene);
  viewer.scene.draw = (...all) => { frames++; draw(...all); };
  stage.setPointerCapture = () => {};
  const send = (type, k) => stage.dispatchEvent(new PointerEvent(
    type, { pointerId: 1, clientX: 300 + (k % 200), clientY: 300 + (k % 60), bubbles: true }));
  send('pointerdown', 0);
  const start = performance.now();
  for (let k = 0; performance.now() - start < 1000 * seconds; k++) {
    send('pointermove', k);
    await new Promise(requestAnimationFrame);
  }
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4)); // all is drawn
  const rate = (1000 * frames) / (performance.now() - start);
  send('pointerup', 0);
  return [rate, viewer.stride];
}""".replace("VIEWER", VIEWER)


def surface() -> tuple[PointCloud, np.ndarray[Any, Any], Rig]:
    """A wavy wall with noise: every pixel measured, with brightness and modulation."""
    rig = standard_rig(scale=SCALE)
    h, w = rig.camera.shape
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:h, :w]
    bump = 6 * np.exp(-((x - 800) ** 2 + (y - 600) ** 2) / 9e4)
    z = 500 + 12 * np.sin(x / 130) * np.cos(y / 110) + bump + 0.01 * x
    modulation = 60 + 25 * np.sin(x / 300) + rng.normal(0, 1, (h, w))
    sigma = (NOISE / modulation).astype(np.float32)
    z += rng.normal(0, 1, (h, w)) * sigma
    grey = 90 + 40 * np.sin(x / 50) * np.sin(y / 70) + rng.normal(0, 1.5, (h, w))
    directions = rays(rig.camera, np.stack((x, y), axis=-1))
    xyz = (directions * z[..., None]).astype(np.float32)
    reason = np.zeros((h, w), np.uint8)
    cloud = PointCloud(xyz, sigma, sigma, reason, colour=grey.astype(np.float32))
    return cloud, modulation.astype(np.float32), rig


def main() -> None:
    """Print the figures."""
    from playwright.sync_api import sync_playwright

    parser = argparse.ArgumentParser(description=__doc__)
    parser.parse_args()
    cloud, modulation, rig = surface()
    started = time.perf_counter()
    packed = pack_surface(cloud, camera=rig, modulation=modulation, title="2 million points")
    print(f"packing: {time.perf_counter() - started:.1f} s")
    html = viewer_page(packed)
    parts = {layer["name"]: layer["blocks"] for layer in packed.header["layers"]}
    parts |= {"z": packed.header["points"]["blocks"], "σ": packed.header["sigma"]["blocks"]}
    for name, channels in parts.items():
        print(f"  {name}: {sum(block[1] for planes in channels for block in planes) / 1e6:.2f} MB")
    print(f"page: {len(html.encode()) / 1e6:.2f} MB for {cloud.reason.size:,} points")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        path = Path(folder) / "page.html"
        path.write_text(html, encoding="utf-8")
        program = shutil.which("chromium")
        browser = driver.chromium.launch(executable_path=program, args=ARGUMENTS)
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        page.goto(path.as_uri())
        page.evaluate(f"{VIEWER}.ready")
        page.wait_for_function(f"() => {VIEWER}.rested", timeout=60_000)
        for mark in page.evaluate("performance.getEntriesByType('mark').map((m) => m.toJSON())"):
            print(f"{mark['name']}: {mark['startTime'] / 1000:.2f} s after opening")
        rate, stride = page.evaluate(TURNING, [TURN_SECONDS])
        print(f"turning: {rate:.1f} frames/s, every {stride}th pixel")
        browser.close()


if __name__ == "__main__":
    main()
