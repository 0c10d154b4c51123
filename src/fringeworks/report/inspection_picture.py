"""Pictures of an inspection: where each tolerance was measured, and its value and limits."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from fringeworks.evaluate.inspect import Check, Inspection
from fringeworks.report.drawing import Axes, Figure, need_plots
from fringeworks.report.maps import UNMEASURED, Picture
from fringeworks.report.verdicts import VERDICT_COLOURS, VERDICT_MARKS, allowed
from fringeworks.report.windows import window_of
from fringeworks.surface.cloud import normals
from fringeworks.types import BoolMap, FloatMap, HeightMap, PointCloud
from fringeworks.types.numbers import SHARE, number

LIGHT = (-0.5, -0.5, -0.7)
"""Direction towards the lamp, in camera coordinates: from the upper left, as reliefs are lit."""
AREA_COLOURS = ("#0072b2", "#d55e00")
"""Outlines of the first and the second area of a quantity: blue and orange."""
DATUM_COLOUR = "#7a3e9d"
"""Outline of datums, which differ from both: purple."""
ALL_AREAS = "#0072b2"
"""Outline of areas on the picture of a whole part."""
TINT = 0.28
"""Opacity of an area's tint: the surface below it stays visible."""
SIZE_INCH = (7.0, 2.1)
"""Width and height of the picture of a tolerance, inches."""
WHOLE_INCH = (11.0, 5.6)
"""Width and height of the picture of a part, inches."""
PART_BOX = (0.0, 0.02, 0.5, 0.9)
"""Place of a part in the picture of a tolerance, shares of its width and height."""
GAUGE_BOX = (0.56, 0.38, 0.42, 0.34)
"""Place of the value between its limits."""
MOST_GAUGES = 12
"""Tolerances on the picture of a part; the report has all of them."""
SIGNED = frozenset({"step_height", "deviation_mean"})
"""Quantities that can be negative: the axes of others begin at 0 or above."""
SHOWN_PIXELS = 500
"""Pixels along the longer side of a part's picture, about: a page shows no more."""
RELIEF = 2.0
"""Slope that is drawn half as bright as a plane, in usual slopes of a height map."""


@dataclass(frozen=True)
class Backdrop:
    """A part as a lit relief, cropped to what was measured, and thinned to what a page shows."""

    image: FloatMap
    extent: tuple[float, float, float, float]
    """Left, right, bottom and top of the image, px of the frame."""


def backdrop(surface: HeightMap | PointCloud) -> Backdrop:
    """Draw a part for the pictures of its areas."""
    window = window_of(surface.reason)
    rows = slice(window.top, window.bottom + 1)
    columns = slice(window.left, window.right + 1)
    every = max(1, max(window.width, window.height) // SHOWN_PIXELS)
    image = relief(surface)[rows, columns][::every, ::every]
    left, top = window.left - 0.5, window.top - 0.5
    right, bottom = left + every * image.shape[1], top + every * image.shape[0]
    return Backdrop(image, (left, right, bottom, top))


def area_picture(found: Inspection, check: Check, part: Backdrop) -> Figure:
    """Draw the areas of a tolerance on the part, and its value between its limits."""
    # Placed by hand: a layout that is searched takes three times as long, and batches have many.
    figure = Figure(figsize=SIZE_INCH)
    place, gauge = (figure.add_axes(box) for box in (PART_BOX, GAUGE_BOX))
    areas = {name: found.pixels(name) for name in check.tolerance.areas}
    _part(place, part, scaled=False)
    for (name, area), colour in zip(areas.items(), AREA_COLOURS, strict=False):
        if area is not None:
            _outline(place, name, area, colour)
    for letter in check.tolerance.zone.datums:
        for name in found.recipe.datums[letter].areas:
            pixels = found.pixels(name)
            if pixels is not None and name not in areas:
                _outline(place, letter, pixels, DATUM_COLOUR)
    _gauge(gauge, check, found.recipe.risk)
    return figure


def inspection_picture(title: str, found: Inspection) -> Picture:
    """Draw a part with all areas that have tolerances, and every value between its limits."""
    need_plots("a picture")
    checks = found.checks[:MOST_GAUGES]
    figure = Picture(figsize=WHOLE_INCH, layout="constrained")
    words = f"{title}: {found.verdict}" if found.checks else title
    more = len(found.checks) - len(checks)
    figure.suptitle(words + (f"   ·   {more} more tolerances are not shown" if more else ""))
    width = (1.15, 1.0) if checks else (1.0, 1e-3)
    left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=width)[0]
    place = left.subplots()
    _part(place, backdrop(found.surface), scaled=True)
    used = dict.fromkeys(name for check in checks for name in check.tolerance.areas)
    for name in used:
        pixels = found.pixels(name)
        if pixels is not None:
            _outline(place, name, pixels, ALL_AREAS)
    if checks:
        places = right.subplots(len(checks), 1, squeeze=False)
        for axes, check in zip(places.flat, checks, strict=True):
            _gauge(axes, check, found.recipe.risk, named=True)
    return figure


def _part(axes: Axes, part: Backdrop, *, scaled: bool) -> None:
    """The part in its frame's pixels; their scale is left out where a picture is small."""
    axes.patch.set(**UNMEASURED)
    axes.imshow(part.image, cmap="gray", interpolation="nearest", extent=part.extent)
    axes.set_autoscale_on(False)
    if not scaled:
        axes.set_xticks([])
        axes.set_yticks([])
        return
    axes.set_xlabel("x / px", fontsize=8)
    axes.set_ylabel("y / px", fontsize=8)
    axes.tick_params(labelsize=7)


def relief(surface: HeightMap | PointCloud) -> FloatMap:
    """Brightness of a surface that is lit from the upper left; NaN where it was not measured."""
    lamp = np.asarray(LIGHT) / np.linalg.norm(LIGHT)
    if isinstance(surface, PointCloud):
        return np.asarray(normals(surface) @ lamp)
    rows, columns = np.gradient(np.asarray(surface.values, np.float64))
    slope = np.hypot(rows, columns)
    known = slope[np.isfinite(slope)]
    usual = RELIEF * float(np.median(known)) if known.size and np.median(known) > 0 else 1.0
    up = np.stack((-columns, -rows, -np.full(rows.shape, usual)), axis=-1)
    return np.asarray(up / np.linalg.norm(up, axis=-1, keepdims=True) @ lamp)


def _outline(axes: Axes, name: str, pixels: BoolMap, colour: str) -> None:
    """Tint an area, and write its name above it."""
    tint = np.ma.masked_where(~pixels, np.ones(pixels.shape))
    axes.contourf(tint, levels=[0.5, 1.5], colors=[colour], alpha=TINT)
    edge = np.pad(pixels, 1).astype(float)
    at = np.arange(-1.0, pixels.shape[1] + 1), np.arange(-1.0, pixels.shape[0] + 1)
    axes.contour(*at, edge, levels=[0.5], colors=[colour], linewidths=1.4)
    rows, columns = np.nonzero(pixels)
    if rows.size:
        axes.text(
            float(columns.mean()),
            float(rows.min()) - 1.0,
            name,
            color="white",
            fontsize=8,
            ha="center",
            va="bottom",
            parse_math=False,
            bbox={"facecolor": colour, "edgecolor": "none", "pad": 1.5},
        )


def _say(axes: Axes, check: Check, spread: float, named: bool) -> None:
    """The unit, and a title with the value, its U and its limits."""
    one, measured = check.tolerance, bool(np.isfinite(check.value))
    unit = one.unit(check.unit)
    if unit == SHARE:
        axes.xaxis.set_major_formatter(lambda value, _: f"{100.0 * value:g}")
    axes.set_xlabel("%" if unit == SHARE else unit, fontsize=8)
    said = f"{one.name}: {check.verdict}\n" if named else ""
    value = number(check.value, check.sigma, unit) if measured else "no value"
    known_u = measured and unit != SHARE
    uncertain = f", U = {number(spread, check.sigma, unit)}" if known_u else ""
    limits = allowed(one, check.unit)
    title = axes.set_title(f"{said}{value}{uncertain}; allowed {limits}", fontsize=8)
    title.set_parse_math(False)


def _gauge(axes: Axes, check: Check, risk: float, *, named: bool = False) -> None:
    """The value with its U on an axis with the limits, and the guard bands of the decision."""
    one = check.tolerance
    low, high = one.low, one.high
    axes.set_yticks([])
    axes.tick_params(labelsize=8)
    measured = bool(np.isfinite(check.value))
    spread = check.expanded if measured else 0.0
    known = [v for v in (low, high, one.target) if v is not None]
    known += [check.value - spread, check.value + spread] if measured else []
    room = 0.15 * (max(known) - min(known)) or max(abs(known[0]), 1.0)
    left, right = min(known) - room, max(known) + room
    if min(known) >= 0.0 and one.quantity not in SIGNED:
        left = max(left, 0.0)
    axes.set_xlim(left, right)
    axes.set_ylim(-1.0, 1.0)
    inside = (left if low is None else low, right if high is None else high)
    axes.axvspan(*inside, color="#009e73", alpha=0.18, linewidth=0)
    guard = NormalDist().inv_cdf(1.0 - risk) * check.sigma if measured else 0.0
    for edge in (v for v in (low, high) if v is not None):
        axes.axvspan(edge - guard, edge + guard, color="#e69f00", alpha=0.25, linewidth=0)
        axes.axvline(edge, color="black", linewidth=1.4)
    if one.target is not None:
        axes.axvline(one.target, color="black", linewidth=0.8, linestyle=":")
    if measured:
        axes.errorbar(
            [check.value],
            [0.0],
            xerr=[spread],
            capsize=4,
            markersize=7,
            color=VERDICT_COLOURS[check.verdict],
            fmt=VERDICT_MARKS[check.verdict],
        )
    _say(axes, check, spread, named)
    for side in ("left", "right", "top"):
        axes.spines[side].set_visible(False)
