"""Results to turn and point at: in the browser, and in a notebook."""

from __future__ import annotations

import html
import math
import tempfile
import webbrowser
from pathlib import Path

from fringeworks.report.page.report import write_report
from fringeworks.report.page.surfaces import is_surface, packed
from fringeworks.report.viewer.page import viewer_page

NOTEBOOK_BYTES = 8_000_000
"""Largest size of a surface in a notebook, bytes: notebooks with more open slowly."""
FRAME_HEIGHT_PX = 560
"""Height of a surface in a notebook: all controls are seen without scrolling."""


def show(result: object, *, every: int = 1) -> Path:
    """Write the report of a result to a temporary file and open it in the browser.

    Parameters
    ----------
    result : any result of fringeworks
    every : int
        Show every k-th column and row only.

    Returns
    -------
    The file. It stays until the computer clears its temporary files.
    """
    folder = Path(tempfile.mkdtemp(prefix="fringeworks-"))
    (path,) = write_report(folder / "report.html", result, every=every).paths
    webbrowser.open(path.as_uri())
    return path


def repr_html(result: object) -> str | None:
    """Return a surface to turn, in a frame, for a notebook.

    Parameters
    ----------
    result : any result of fringeworks
        Surfaces of more than 8 MB are thinned, which is said below the frame.

    Returns
    -------
    HTML; None for results that are no surfaces, which are shown as their picture.
    """
    if not is_surface(result):
        return None
    used, surface = 1, packed(result)
    # Base64, in which the page holds the surface, makes four bytes of three.
    while (too_large := len(surface.data) * 4 / 3 / NOTEBOOK_BYTES) > 1:
        used = math.ceil(used * math.sqrt(too_large))
        surface = packed(result, every=used)
    page = html.escape(viewer_page(surface), quote=True)
    frame = (
        f'<iframe srcdoc="{page}" style="width:100%;height:{FRAME_HEIGHT_PX}px;border:0" '
        'sandbox="allow-scripts" title="Measured surface"></iframe>'
    )
    if used == 1:
        return frame
    return f"{frame}<p>Shown: one of {used} columns and rows, to stay below 8 MB.</p>"
