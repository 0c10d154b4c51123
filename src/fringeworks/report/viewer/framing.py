"""What the viewer has to know before it draws: size, limits of triangles, directions, words."""

from __future__ import annotations

from typing import Any

import numpy as np

from fringeworks.report.viewer.content import Content
from fringeworks.surface.cloud import GRAZING_COSINE, LONG_SIDE
from fringeworks.surface.height_map import MAX_TRIANGLE_SLOPE
from fringeworks.types import FloatMap
from fringeworks.types.numbers import number, percent

SHOWN_SLOPE = 0.25
"""Height of a surface in the picture over its width, where z is no length: relief is visible, and
the surface stays in the frame from all sides."""
BOX_PERCENTILES = (0.2, 99.8)
"""Coordinates of the box that is shown, percent of the points below: outliers do not shrink the
picture."""
SMALLEST_HALF = 0.5
"""Half the side of a box in a direction in which all points are alike, in their unit."""
MAX_SAMPLED = 300_000
"""Points, about, that percentiles and usual distances come from: more only cost time."""


def framing(content: Content) -> dict[str, Any]:
    """The part of the header that follows from the points."""
    box = _box(content)
    stretch = _stretch(content)
    rows, columns = content.reason.shape
    count = int(content.measured.sum())
    words = [f"{count:,} point{'' if count == 1 else 's'}"]
    if content.raster:
        words.append(f"{percent(count / content.reason.size)} of {columns} × {rows}")
    if stretch != 1.0:
        words.append(f"z drawn × {number(stretch)}")
    away = content.kind in ("cloud", "points")
    return {
        "box": box,
        "stretch": stretch,
        "summary": ", ".join(words),
        # Camera coordinates have y down and z away from the viewer.
        "away": away,
        **_edges(content, box),
    }


def _box(content: Content) -> dict[str, list[float]]:
    """Middle and half sides of the box that holds nearly all points."""
    points = content.points[content.measured]
    if not len(points):
        return {"centre": [0.0] * 3, "half": [SMALLEST_HALF] * 3}
    sampled = points[:: max(1, len(points) // MAX_SAMPLED)]
    low, high = np.percentile(sampled, BOX_PERCENTILES, axis=0)
    half = (high - low) / 2.0
    return {
        "centre": ((low + high) / 2.0).tolist(),
        "half": np.where(half > 0, half, SMALLEST_HALF).tolist(),
    }


def _edges(content: Content, box: dict[str, list[float]]) -> dict[str, Any]:
    """Usual distance of neighbours (``side``), and which triangles bridge a step (``edges``).

    A triangle is cut where a side is longer than ``limit``, per depth for clouds, of heights only
    its rise counts; and where the |cosine| to the camera's ray is below ``cosine``.
    """
    if not content.raster:
        # A list of points covers its box once.
        across, down, _ = box["half"]
        count = max(int(content.measured.sum()), 1)
        return {"side": 2.0 * float(np.sqrt(across * down / count)), "edges": None}
    if content.kind != "cloud":
        assert content.lattice is not None
        pitch = content.lattice.pitch
        limit = MAX_TRIANGLE_SLOPE * pitch
        edges = {"limit": limit, "lateral": 0, "per_depth": False, "cosine": 0.0}
        return {"side": pitch, "edges": edges}
    usual = _usual_side(content.points)
    limit = LONG_SIDE * usual
    edges = {"limit": limit, "lateral": 1, "per_depth": True, "cosine": GRAZING_COSINE}
    return {"side": (usual or 1e-3) * (abs(box["centre"][2]) or 1.0), "edges": edges}


def _usual_side(points: FloatMap) -> float:
    """Median of the triangles' longest sides over their depth; 0 where there is no triangle."""
    every = max(1, points.shape[0] * points.shape[1] // MAX_SAMPLED)
    rows = np.arange(0, points.shape[0] - 1, every)
    corner, right, below = points[rows, :-1], points[rows, 1:], points[rows + 1, :-1]
    sides = ((corner, right), (right, below), (below, corner))
    with np.errstate(all="ignore"):
        longest = np.max([np.linalg.norm(p - q, axis=-1) for p, q in sides], axis=0)
        ratio = longest / corner[..., 2]
    ratio = ratio[np.isfinite(ratio)]
    return float(np.median(ratio)) if ratio.size else 0.0


def _stretch(content: Content) -> float:
    """Factor of z in the picture: 1 for lengths, else such that heights fill a quarter of it."""
    z = content.points[..., 2][content.measured]
    if content.metric or not z.size:
        return 1.0
    low, high = np.percentile(z, [1, 99])
    across = max(float(np.ptp(content.points[..., k][content.measured])) for k in range(2))
    return float(SHOWN_SLOPE * across / (high - low)) if high > low and across > 0 else 1.0
