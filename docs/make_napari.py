"""Write docs/images/napari.png: the plug-in measures the ball of the sample data: make napari.

Wants a screen, real or virtual (Xvfb), and napari with a Qt. On Debian, Qt 6 needs the packages
libxcb-cursor0, libxcb-icccm4, libxcb-keysyms1, libxcb-image0 and libxkbcommon-x11-0. The button of
the widget is pressed as a visitor would.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import napari
from PIL import Image
from qtpy.QtWidgets import QApplication

import fringeworks as fw

PICTURE = Path(__file__).parent / "images" / "napari.png"
SAMPLES = Path(__file__).parent.parent / "samples"
SIZE = (1200, 800)
"""Columns and rows of the window."""
TURNS = 60
"""Turns of the event loop after which the window is drawn."""


def settle() -> None:
    """Let the window draw itself."""
    for _ in range(TURNS):
        QApplication.processEvents()


def measured(viewer: Any) -> list[str]:
    """Measure two images by the widget; names of the layers."""
    pair = fw.read(fw.data.ball())
    plane = viewer.add_image(pair.reference, name="plane")
    ball = viewer.add_image(pair.object, name="ball")
    _, widget = viewer.window.add_plugin_dock_widget("fringeworks", "Heights of two frames")
    widget.reference.value, widget.object_.value = plane, ball
    widget.call_button.native.click()
    settle()
    return [layer.name for layer in viewer.layers]


def main() -> None:
    """Drive napari, and store its window with 256 colours."""
    os.environ.setdefault("FRINGEWORKS_SAMPLES", str(SAMPLES))
    viewer = napari.Viewer()
    viewer.window.resize(*SIZE)
    names = measured(viewer)
    print(*names, sep="\n")
    assert "ball displacement / px" in names
    viewer.reset_view()
    settle()
    shown = Image.fromarray(viewer.screenshot(canvas_only=False, flash=False)).convert("RGB")
    viewer.close()
    shown.quantize(256, dither=Image.Dither.NONE).save(PICTURE, optimize=True)


if __name__ == "__main__":
    main()
