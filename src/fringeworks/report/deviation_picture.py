"""The picture of a deviation from a model: maps of a camera's frame, or points seen from aside."""

from __future__ import annotations

import numpy as np

from fringeworks.evaluate.deviation import Deviation
from fringeworks.evaluate.spots import find_spots
from fringeworks.report.maps import COLOURS, Picture, draw_sheet, limits_of, small_print
from fringeworks.report.sheets import (
    REASONS,
    SIGMA,
    UNMEASURED_WORDS,
    Panel,
    PanelKind,
    Sheet,
)
from fringeworks.report.windows import window_of
from fringeworks.types import FloatMap, PointCloud, Reason
from fringeworks.types.numbers import limit, number, percent, sigma_text

MOST_DRAWN = 60_000
"""Largest number of points of a picture: more lie on top of each other."""
POINT_SIZE = 2.0
"""Size of a drawn point, in squares of 1/72 inch."""
WIDTH_INCH, HEIGHT_INCH = 11.0, 5.0
"""Size of a picture of points, inches."""
MOST_FLAGS = 6
"""Flags of a map, on the largest deviations; more would hide it."""
FLAG_POINTS = 16
"""Distance of a flag from its place, points."""
DEVIATION, RATIO = "deviation, positive outside", "deviation over σ"
"""Titles of two panels."""


def deviation_sheet(title: str, found: Deviation) -> Sheet:
    """The deviation of a cloud, its σ, the ratio of the two, and the reasons."""
    words, ends = scaled(found)
    return Sheet(
        title,
        facts_of(found),
        [
            Panel(words, found.distance_mm, "signed", "mm", limits=ends),
            Panel(SIGMA, found.sigma_mm, "sigma", "mm"),
            Panel(RATIO, found.distance_mm / found.sigma_mm, "signed", "σ"),
            Panel(REASONS, found.reason, "reasons"),
        ],
        columns=2,
        findings=found.findings,
        window=window_of(found.reason),
    )


def scaled(found: Deviation) -> tuple[str, tuple[float, float]]:
    """Title and ends of the map of a deviation: the tolerance, or ends for nearly all values."""
    tolerance = found.tolerance_mm
    if tolerance is None:
        low, high = limits_of("signed", [found.distance_mm])
        return f"{DEVIATION}; {beyond(found, high)} beyond the scale", (low, high)
    said = f"{beyond(found, tolerance)} beyond ±{limit(tolerance)} mm"
    return f"{DEVIATION}; {said}", (-tolerance, tolerance)


def beyond(found: Deviation, end: float) -> str:
    """The share of points that deviate by more."""
    return percent(float(np.mean(np.abs(found.measured) > end)))


def flags_of(found: Deviation) -> list[tuple[int, int, str]]:
    """Row, column and value of what deviates most: dents and bumps, or the extremes."""
    ok = found.reason == Reason.OK
    rows, columns = np.nonzero(ok)
    places = np.asarray(found.points_mm[ok], np.float64)
    if not np.isfinite(found.sigma_mm[ok]).all():
        distance = found.distance_mm[ok]
        ends = {int(np.argmin(distance)), int(np.argmax(distance))}
        return [
            (int(rows[k]), int(columns[k]), number(float(distance[k]), unit="mm", signed=True))
            for k in ends
        ]
    flags = []
    for spot in find_spots(found)[:MOST_FLAGS]:
        k = int(np.argmin(np.sum((places - spot.place_mm) ** 2, axis=1)))
        text = number(spot.depth_mm, spot.sigma_mm, "mm", signed=True)
        flags.append((int(rows[k]), int(columns[k]), text))
    return flags


def flagged_map(found: Deviation) -> Picture:
    """The deviation as one map, cropped to the part, with flags on what deviates most."""
    window = window_of(found.reason)
    title, ends = scaled(found)
    sheet = Sheet(
        "",
        "",
        [Panel(title, found.distance_mm, "signed", "mm", limits=ends)],
        columns=1,
        window=window,
    )
    figure = draw_sheet(sheet)
    for row, column, text in flags_of(found):
        figure.axes[0].annotate(
            text,
            (column, row),
            (FLAG_POINTS, FLAG_POINTS),
            textcoords="offset points",
            fontsize=8,
            arrowprops={"arrowstyle": "-", "linewidth": 0.8},
            bbox={"facecolor": "white", "edgecolor": "black", "linewidth": 0.6, "pad": 1.5},
        )
    return figure


def facts_of(found: Deviation) -> str:
    """Mean, rms, usual σ and share of points in one line."""
    figures = found.figures()
    parts = [
        f"{figures['points']:,} points",
        f"mean {number(figures['mean_mm'], figures['mean_sigma_mm'])} mm",
        f"rms {number(figures['rms_mm'])} mm",
    ]
    if figures["median_sigma_mm"] is not None:
        parts.append(f"median σ {sigma_text(figures['median_sigma_mm'])} mm")
    parts.append(f"aligned by {found.alignment.by}")
    if found.only:
        parts.append(
            f"{percent(figures['share_of_points'])} of all points: {', '.join(found.only)}"
        )
    elif figures["share_of_points"] < 1.0:
        parts.append(f"{percent(figures['share_of_points'])} within reach of the model")
    if isinstance(found.part, PointCloud):
        parts.append(UNMEASURED_WORDS)
    return "   ·   ".join(parts)


def of_points(title: str, found: Deviation) -> Picture:
    """Points in the plane of their two longest axes, seen against the third."""
    ok = np.flatnonzero(found.reason == Reason.OK)
    some = ok[:: max(1, len(ok) // MOST_DRAWN)]
    xyz = np.asarray(found.points_mm[some], np.float64)
    axes_of = np.linalg.svd(xyz - xyz.mean(axis=0), full_matrices=False)[2]
    # Points that face the viewer are drawn last.
    toward = axes_of[2] * (1.0 if np.nanmean(found.normals[some] @ axes_of[2]) >= 0 else -1.0)
    order = np.argsort(xyz @ toward)
    known = bool(np.isfinite(found.sigma_mm[ok]).all())
    shown: list[tuple[str, FloatMap, PanelKind]] = [(DEVIATION, found.distance_mm, "signed")]
    if known:
        shown.append((SIGMA, found.sigma_mm, "sigma"))
    small = small_print([finding.seen for finding in found.findings], WIDTH_INCH)
    figure = Picture(figsize=(WIDTH_INCH, HEIGHT_INCH), layout="constrained")
    figure.suptitle(f"{title}\n{facts_of(found)}", fontsize=12)
    if small:
        figure.supxlabel(small, x=0.01, ha="left", fontsize=9)
    for k, (name, values, kind) in enumerate(shown):
        axes = figure.add_subplot(1, len(shown), k + 1)
        low, high = scaled(found)[1] if kind == "signed" else limits_of(kind, [values])
        drawn = axes.scatter(
            xyz[order] @ axes_of[0],
            xyz[order] @ axes_of[1],
            c=values[some][order],
            s=POINT_SIZE,
            cmap=COLOURS[kind],
            vmin=low,
            vmax=high,
            linewidths=0,
        )
        axes.set_title(name, fontsize=11)
        axes.set_xlabel("along the longest axis / mm")
        axes.set_ylabel("across it / mm")
        axes.set_aspect("equal")
        figure.colorbar(drawn, ax=axes, extend="both", shrink=0.8).set_label("mm")
    return figure
