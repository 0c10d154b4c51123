"""What is shown of the displacement of fringes."""

from __future__ import annotations

import numpy as np

from fringeworks.report.kind import Kind, describe
from fringeworks.report.kinds.surface import height_chapter, height_figures
from fringeworks.report.page.blocks import Chapter
from fringeworks.report.page.chapter import Context
from fringeworks.report.sheets import REASONS, SIGMA, Panel, Sheet, map_facts, titled
from fringeworks.types import DisplacementMap, HeightMap, Pair
from fringeworks.types.numbers import number


def edges(found: DisplacementMap) -> list[Panel]:
    """Albedo and walls, where the method has found any."""
    panels = []
    if found.albedo is not None:
        panels.append(Panel("albedo, object over reference", found.albedo, "grey", "ratio"))
    if found.walls is not None:
        panels.append(Panel("walls beside cliffs", found.walls, "grey", "1"))
    return panels


def picture(found: DisplacementMap, name: str | None) -> Sheet:
    """Displacement, σ, modulation and reasons."""
    return Sheet(
        titled(name, f"Displacement of the fringes along {found.axis}"),
        map_facts(
            float(np.mean(np.isfinite(found.displacement_px))),
            found.sigma_px,
            "px",
            f"fringe period {number(found.period_px, digits=4)} px",
            f"method {found.method}",
        ),
        [
            Panel("displacement", found.displacement_px, "values", "px"),
            Panel(SIGMA, found.sigma_px, "sigma", "px"),
            Panel("modulation, object over reference", found.modulation_ratio, "grey", "ratio"),
            Panel(REASONS, found.reason, "reasons"),
            *edges(found),
        ],
        columns=2,
    )


def as_heights(found: DisplacementMap) -> HeightMap:
    """The surface that a displacement map is drawn as, in px."""
    return HeightMap(
        found.displacement_px,
        found.sigma_px,
        found.reason,
        "displacement",
        "px",
        None,
        method=found.method,
        converged=found.converged,
    )


def chapter(found: DisplacementMap, context: Context) -> Chapter:
    """The chapter of the surface that the displacement is drawn as."""
    surface = as_heights(found)
    return height_chapter(surface, surface, height_figures(surface), context)


def frames_sheet(pair: Pair, name: str | None) -> Sheet:
    """The frames as the camera delivered them, on one scale."""
    frames = {
        "object": pair.object,
        "reference": pair.reference,
        "white": pair.white,
        "black": pair.black if isinstance(pair.black, np.ndarray) else None,
    }
    panels = [
        Panel(f"{kind} frame", np.asarray(frame, float), "grey", "counts", scale="frames")
        for kind, frame in frames.items()
        if frame is not None
    ]
    size = " × ".join(map(str, pair.object.shape[::-1]))
    return Sheet(titled(name, "Frames of the pair"), f"{size} px", panels, columns=2)


describe(Pair, Kind(picture=frames_sheet))
describe(DisplacementMap, Kind(picture=picture, chapter=chapter, surface=as_heights))
