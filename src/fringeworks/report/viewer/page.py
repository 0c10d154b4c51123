"""The viewer in HTML: fragments for a page that is written elsewhere, and pages of its own."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from functools import cache
from importlib import resources

import numpy as np

from fringeworks.report.reason_words import REASON_COLOURS
from fringeworks.report.viewer.content import MAX_PIXELS
from fringeworks.report.viewer.pack import PackedSurface
from fringeworks.statistics.quantiles import MAD_TO_SIGMA
from fringeworks.surface import form
from fringeworks.types import InputError, Reason

MODULES = (
    "numbers",
    "unpack",
    "mesh",
    "measure",
    "lines",
    "fit",
    "scene",
    "view",
    "overlay",
    "tools",
    "scale",
    "input",
    "viewer",
)
"""The viewer's JavaScript files in an order in which each finds what it imports."""
MAX_SURFACES = 2
"""Surfaces of one viewer: it shows two side by side or as a difference."""
LIBRARY = {
    "maxPixels": MAX_PIXELS,
    "minPoints": form.MIN_POINTS,
    "discarded": form.DISCARDED,
    "farSigmas": form.FAR_SIGMAS,
    "maxFarShare": form.MAX_FAR_SHARE,
    "madToSigma": MAD_TO_SIGMA,
    "maxSpread": form.MAX_SPREAD,
    "patches": form.PATCHES,
    "maxRelativeSigma": form.MAX_RELATIVE_SIGMA,
    "fitRounds": form.FIT_ROUNDS,
    "maxSteps": form.MAX_STEPS,
    "refinedPoints": form.REFINED_POINTS,
}
"""Constants that the viewer shares with the functions whose figures it computes as well."""
SCALES = {
    **{
        name: tuple(f"#{colour}" for colour in colours.split())
        for name, colours in {
            "height": "440154 472d7b 3b528b 2c728e 21918c 28ae80 5ec962 addc30 fde725",
            "depth": "fde725 addc30 5ec962 28ae80 21918c 2c728e 3b528b 472d7b 440154",
            "spread": "0d0887 46039f 7201a8 9c179e bd3786 d8576b ed7953 fb9f3a fdca26 f0f921",
            "signed": "2166ac 67a9cf d1e5f0 f7f7f7 fddbc7 ef8a62 b2182b",
            "grey": "000000 ffffff",
        }.items()
    },
    "reasons": tuple(REASON_COLOURS[reason] for reason in Reason),
}
"""Colours, evenly spaced: viridis, viridis with its bright end near the camera, and plasma of
Matplotlib, blue to red, grey; one per reason."""
TABLE_SIZE = 256
"""Colours of a scale as the graphics processor looks them up."""
VIEWS = ((0, 0), (90, 0), (-90, 0), (0, 90), (-32, 22))
"""Yaw and pitch of the views on the keys 1 to 5, degrees. The last one is the first picture."""


def _layer(label: str, scale: str, *, mode: int = 1, told: bool = False) -> dict[str, object]:
    """How a layer is shown: mode of the shader, and whether the readout tells its value."""
    return {"label": label, "scale": scale, "mode": mode, "told": told}


LAYERS = {
    "difference": _layer("Difference", "signed", told=True),
    "cloud": _layer("Depth z", "depth"),
    "points": _layer("Depth z", "depth"),
    "heights": _layer("Height z", "height"),
    "displacements": _layer("Displacement z", "height"),
    "coordinates": _layer("Coordinate z", "height"),
    "deviation": _layer("Deviation", "signed", told=True),
    "sigma": _layer("Standard deviation σ", "spread"),
    "modulation": _layer("Modulation", "height", told=True),
    "albedo": _layer("Albedo over the reference's", "grey", told=True),
    "walls": _layer("Walls beside cliffs", "grey", told=True),
    "texture": _layer("Texture", "grey", told=True),
    "reason": _layer("Reason", "reasons", mode=3),
    "plain": _layer("Plain, lit", "grey", mode=0),
    "fit": _layer("Distance from the fit", "signed", told=True),
}
"""The layers in the order of the list."""


def _table(name: str) -> list[int]:
    """The 256 colours of a scale: words with red in the lowest byte, then green, blue, opacity."""
    colours = np.array([[int(hexa[k : k + 2], 16) for k in (1, 3, 5)] for hexa in SCALES[name]])
    if name == "reasons":
        mixed = np.resize(colours, (TABLE_SIZE, 3))
    else:
        place = np.linspace(0, len(colours) - 1, TABLE_SIZE)
        known = np.arange(len(colours))
        mixed = np.stack([np.interp(place, known, band) for band in colours.T], axis=-1)
    words = np.rint(mixed).astype(np.int64) @ [1, 1 << 8, 1 << 16] + (255 << 24)
    return [int(word) for word in words]


TABLES = {name: _table(name) for name in SCALES}
"""The scales as the pixels of a row, for textures and pictures."""


def viewer_style() -> str:
    """Return the viewer's style sheet, for a ``<style>`` element.

    Examples
    --------
    >>> ".fringe-viewer" in viewer_style()
    True
    """
    return _asset("viewer.css")


@cache
def viewer_script() -> str:
    """Return the viewer's script, for a ``<script>`` element after the fragments of the page.

    It defines ``FringeViewer`` and starts a viewer in every fragment; it sends no request.

    Examples
    --------
    >>> "FringeViewer" in viewer_script()
    True
    """
    constants: dict[str, object] = {
        "LIBRARY": LIBRARY,
        "SCALES": SCALES,
        "TABLES": TABLES,
        "LAYERS": LAYERS,
        "VIEWS": VIEWS,
        "TEMPLATE": _asset("viewer.html"),
        "VERTEX_SHADER": _asset("surface.vert"),
        "FRAGMENT_SHADER": _asset("surface.frag"),
    }
    parts = [f"const $assets = {json.dumps(constants, ensure_ascii=False)};"]
    parts += [_module(name) for name in MODULES]
    body = "\n".join(parts).replace("</", "<\\/")
    return (
        f'"use strict";\nglobalThis.FringeViewer = (() => {{\n{body}\n'
        "return $viewer.FringeViewer;\n})();\n"
        'for (const element of document.querySelectorAll(".fringe-viewer-mount")) {\n'
        "  element.viewer ??= new FringeViewer(element);\n}\n"
    )


def viewer_fragment(*surfaces: PackedSurface) -> str:
    """Return the element that shows one surface, or compares two, for a page with the script.

    Parameters
    ----------
    *surfaces : PackedSurface
        One or two. The viewer fills the element ``.fringe-viewer-mount``: give it a height.

    Raises
    ------
    InputError for no surface and for more than two.

    Examples
    --------
    >>> import numpy as np
    >>> from fringeworks.types import Points
    >>> from fringeworks.report.viewer.pack import pack_surface
    >>> viewer_fragment(pack_surface(Points(np.zeros((1, 3)), None)))[:33]
    '<div class="fringe-viewer-mount">'
    """
    if not 1 <= len(surfaces) <= MAX_SURFACES:
        raise InputError(f"surfaces: expected one or two, got {len(surfaces)}")
    # The letters of base64 cannot end a script element.
    payloads = "".join(
        '<script type="application/x-fringeworks-surface">'
        f"{base64.b64encode(surface.data).decode()}</script>\n"
        for surface in surfaces
    )
    return f'<div class="fringe-viewer-mount">\n{payloads}</div>\n'


def viewer_page(*surfaces: PackedSurface, title: str = "") -> str:
    """Return a page that shows one surface, or compares two, and needs nothing else.

    Parameters
    ----------
    *surfaces : PackedSurface
    One or two.
    title : str
    Title of the page, plain text; the first surface's by default.

    Returns
    -------
    HTML text for one file. Its content security policy forbids every request.

    Raises
    ------
    InputError for no surface and for more than two.

    Examples
    --------
    >>> import numpy as np
    >>> from fringeworks.types import Points
    >>> from fringeworks.report.viewer.pack import pack_surface
    >>> viewer_page(pack_surface(Points(np.zeros((1, 3)), None), title="a point"))[:15]
    '<!doctype html>'
    """
    fragment = viewer_fragment(*surfaces)
    style = viewer_style() + PAGE_STYLE
    script = viewer_script()
    name = html.escape(title or surfaces[0].header["title"] or "Surface")
    policy = (
        f"default-src 'none'; script-src {policy_source(script)}; style-src {policy_source(style)}"
    )
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{name}</title>\n<style>{style}</style>\n</head>\n<body>\n"
        "<noscript>This page needs JavaScript to show the surface.</noscript>\n"
        f"{fragment}<script>{script}</script>\n</body>\n</html>\n"
    )


PAGE_STYLE = """
html, body { margin: 0; height: 100%; }
.fringe-viewer-mount { height: 100%; }
"""
"""Style of a page that holds a viewer alone."""


def policy_source(text: str) -> str:
    """Return the source of a content security policy that allows exactly this text."""
    digest = hashlib.sha256(text.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"


def _asset(name: str) -> str:
    return (resources.files(__package__) / name).read_text(encoding="utf-8")


def _module(name: str) -> str:
    """A JavaScript module as a constant that holds what it exports."""
    text = _asset(f"{name}.js")
    text = re.sub(r"import \* as (\w+) from \"\./(\w+)\.js\";", r"const \1 = $\2;", text)
    text = re.sub(r"import (\{[^}]*\}) from \"\./(\w+)\.js\";", r"const \1 = $\2;", text)
    exported = re.findall(r"^export (?:async )?(?:function|class|const) (\w+)", text, re.M)
    text = re.sub(r"^export ", "", text, flags=re.M)
    return f"const ${name} = (() => {{\n{text}\nreturn {{ {', '.join(exported)} }};\n}})();"
