"""The pictures of a set-up: one panel for each test, on one sheet."""

from __future__ import annotations

import textwrap
from collections.abc import Callable

import numpy as np

from fringeworks.report.drawing import Axes, AxesImage, Figure, need_plots, to_rgba
from fringeworks.report.maps import UNMEASURED
from fringeworks.report.setup_curves import (
    BLUE,
    FAULT,
    contrast,
    delay,
    exposure,
    flicker,
    noise,
    profile,
    response,
    spectrum,
)
from fringeworks.scan.setup import Setup, SetupTests
from fringeworks.types import FloatMap
from fringeworks.types.numbers import percent, sigma_text

WIDTH_IN = 17.0
"""Width of the sheet, inches: four panels, readable on a screen and on A3."""
PANEL_IN = 3.7
"""Height of a row of panels, inches."""
HEIGHTS = (0.85, 1.0, 1.0)
"""Heights of the rows of panels, relative: maps are wider than high."""
TITLE_LETTERS = 42
"""Letters of a line of a panel's title."""
LINE_IN = 0.21
"""Height of a line of text, inches."""
LINE_LETTERS = 215
"""Letters of a line of text that fit into the sheet."""
SHOWN_PIXELS = 400
"""Pixels of a map along its longer side that are drawn: more cannot be seen in a panel."""
LEVELS = 8
"""Contour lines over the range of projector coordinates."""

Panel = Callable[[Axes, SetupTests], str]
"""Draws a test and returns its title: the result in words."""


def setup_sheet(tests: SetupTests) -> Figure:
    """Draw a picture of each test of a set-up on one sheet, with the findings below.

    Parameters
    ----------
    tests : SetupTests
        A ``Setup``, or the tests of a ``SetupStopped``; tests that were not reached stay empty.

    Returns
    -------
    matplotlib Figure. Titles of tests with a finding are red.
    """
    need_plots("a picture")
    words = [line for text in _texts(tests) for line in textwrap.wrap(text, LINE_LETTERS)]
    below = LINE_IN * (len(words) + 1)
    figure = Figure(figsize=(WIDTH_IN, 3 * PANEL_IN + below + 0.6), layout="constrained")
    parts = figure.subfigures(2, 1, squeeze=False, height_ratios=[3 * PANEL_IN + 0.6, below])
    sheet, text = parts[0, 0], parts[1, 0]
    sheet.suptitle(_verdict(tests), fontsize=14)
    found = {finding.kind for finding in tests.findings}
    places = sheet.subplots(3, 4, height_ratios=HEIGHTS)
    for axes, (draw, needed, kinds) in zip(places.flat, PANELS, strict=True):
        name = draw.__name__.replace("_", " ").strip()
        if getattr(tests, needed) in (None, ()):
            _empty(axes, name, "not measured")
            continue
        title = draw(axes, tests)
        fault = bool(found & set(kinds))
        words_of = "\n".join(textwrap.wrap(title, TITLE_LETTERS))
        bold = {"color": FAULT, "fontweight": "bold"} if fault else {}
        axes.set_title(words_of, fontsize=10, **bold)  # without a colour, that of the page's text
    text.text(0.01, 0.96, "\n".join(words), ha="left", va="top", fontsize=10)
    return figure


def _verdict(tests: SetupTests) -> str:
    """The title of the sheet."""
    count = len(tests.findings)
    verdict = "nothing makes measurements worse"
    if count:
        kinds = ", ".join(dict.fromkeys(finding.kind for finding in tests.findings))
        verdict = f"{count} finding{'s' if count > 1 else ''}: {kinds}"
    if not isinstance(tests, Setup):
        verdict = f"stopped: {verdict}" if count else "stopped"
    size = f"{tests.size_px[0]} × {tests.size_px[1]} px"
    return f"Set-up of projector {tests.projector} ({size}) and camera {tests.camera}: {verdict}"


def _texts(tests: SetupTests) -> list[str]:
    """Plan and findings."""
    texts = []
    if isinstance(tests, Setup):
        plan = tests.proposal
        texts.append(f"Proposed plan: {plan.summary}; predicted σ {sigma_text(plan.sigma_px)} px")
    return texts + [
        f"Finding {k}: {finding.text}" for k, finding in enumerate(tests.findings, start=1)
    ]


def _empty(axes: Axes, title: str, reason: str) -> None:
    axes.set_title(title, fontsize=10, color="grey")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.text(0.5, 0.5, reason, ha="center", va="center", color="grey", transform=axes.transAxes)


def _lit_area(axes: Axes, tests: SetupTests) -> str:
    """Light of white, with the pixels that are not used tinted."""
    assert tests.levels is not None
    levels, step = tests.levels, _step(tests.levels.white)
    light, lit = levels.white[::step, ::step], levels.lit[::step, ::step]
    top = float(np.quantile(light, 0.999))
    picture = axes.imshow(light, cmap="gray", vmin=0.0, vmax=top, extent=_extent(levels.white))
    tint = np.zeros((*lit.shape, 4))
    tint[~lit] = to_rgba(BLUE, 0.45)
    axes.imshow(tint, extent=_extent(levels.white))
    _camera_axes(axes)
    _bar(axes, picture, "white less black / counts")
    share = percent(float(np.mean(levels.lit)))
    return f"{share} of the frame is lit and below the limit (rest tinted blue)"


def _projector_x(axes: Axes, tests: SetupTests) -> str:
    assert tests.orientation is not None
    _coordinates(axes, tests.orientation.x_px, tests.size_px[0], "projector column x / px")
    mirrored = "mirrored" if tests.orientation.mirrored else "not mirrored"
    return f"orientation along x: the picture is {mirrored}"


def _projector_y(axes: Axes, tests: SetupTests) -> str:
    assert tests.orientation is not None
    _coordinates(axes, tests.orientation.y_px, tests.size_px[1], "projector row y / px")
    seen = np.isfinite(tests.orientation.x_px + tests.orientation.y_px).mean()
    return f"orientation along y: {percent(float(seen))} of the frame has coordinates"


def _coordinates(axes: Axes, place: FloatMap, length: int, label: str) -> None:
    """A map of coordinates with contour lines."""
    step = _step(place)
    shown = np.ma.masked_invalid(place[::step, ::step])
    axes.patch.set(**UNMEASURED)
    picture = axes.imshow(shown, cmap="cividis", vmin=0.0, vmax=length, extent=_extent(place))
    if shown.count() > 100:
        h, w = place.shape
        x, y = np.arange(0, w, step), np.arange(0, h, step)
        lines = axes.contour(
            x, y, shown, np.linspace(0, length, LEVELS + 1)[1:-1], colors="white", linewidths=0.7
        )
        axes.clabel(lines, fmt="%.0f", fontsize=7)
    _camera_axes(axes)
    _bar(axes, picture, label)


def _vignetting(axes: Axes, tests: SetupTests) -> str:
    assert tests.vignetting is not None
    found = tests.vignetting
    axes.patch.set(**UNMEASURED)
    columns, rows = tests.size_px
    extent = (-0.5, columns - 0.5, rows - 0.5, -0.5)
    shown = np.ma.masked_invalid(found.light)
    top = float(np.quantile(shown.compressed(), 0.98)) if shown.count() else 1.0
    picture = axes.imshow(shown, cmap="cividis", vmin=0.0, vmax=max(top, 1e-6), extent=extent)
    if found.judged == "fall-off":
        x, y = (
            (np.arange(n) + 0.5) * size / n - 0.5
            for n, size in zip(found.light.shape[::-1], tests.size_px, strict=True)
        )
        marks = np.arange(0.1, 1.0, 0.1 if found.corner_share < 0.8 else 0.05)
        seen = np.ma.masked_where(shown.mask, found.fall_off)
        if np.ptp(seen) > marks[1] - marks[0]:
            lines = axes.contour(x, y, seen, marks, colors="white", linewidths=0.9)
            axes.clabel(lines, fmt=percent, fontsize=7)
    axes.set_xlabel("projector column / px")
    axes.set_ylabel("projector row / px")
    label = "light / middle (lines: fit)"
    _bar(axes, picture, label)
    return f"vignetting: {found}"


def _step(values: FloatMap) -> int:
    return max(1, int(max(values.shape)) // SHOWN_PIXELS)


def _extent(values: FloatMap) -> tuple[float, float, float, float]:
    h, w = values.shape
    return (-0.5, w - 0.5, h - 0.5, -0.5)


def _bar(axes: Axes, picture: AxesImage, label: str) -> None:
    """A colour bar as high as the map."""
    axes.figure.colorbar(picture, cax=axes.inset_axes((1.03, 0.0, 0.05, 1.0)), label=label)


def _camera_axes(axes: Axes) -> None:
    axes.set_xlabel("camera x / px")
    axes.set_ylabel("camera y / px")


PANELS: tuple[tuple[Panel, str, tuple[str, ...]], ...] = (
    (_lit_area, "levels", ("dark", "saturated", "pixel grid")),
    (_projector_x, "orientation", ("mirrored",)),
    (_projector_y, "orientation", ()),
    (_vignetting, "vignetting", ("vignetting",)),
    (response, "levels", ("range", "ramp", "room")),
    (noise, "levels", ("compressed",)),
    (contrast, "stripes", ("contrast",)),
    (profile, "stripes", ("scale",)),
    (exposure, "exposing", ("exposure",)),
    (flicker, "flicker", ("flicker", "averaged")),
    (spectrum, "flicker", ("flicker",)),
    (delay, "delay", ("delay",)),
)
"""Each panel, the field of ``SetupTests`` that it draws, and the findings that it shows."""
