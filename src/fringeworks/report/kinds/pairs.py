"""What is shown of the surface of two frames."""

from __future__ import annotations

from typing import Any

from fringeworks.pipeline.pairs import Reconstruction
from fringeworks.report.kind import Kind, describe
from fringeworks.report.kinds.pair import edges
from fringeworks.report.kinds.surface import (
    height_chapter,
    height_figures,
    height_sheet,
    height_words,
)
from fringeworks.report.page.blocks import Chapter
from fringeworks.report.page.chapter import Context
from fringeworks.report.sheets import Sheet
from fringeworks.report.summary import origin, told


def figures(result: Reconstruction) -> dict[str, Any]:
    """Figures of the surface and of the fringes."""
    return height_figures(result.surface) | {
        "axis": result.displacement.axis,
        "period_px": result.displacement.period_px,
        "tilt_deg": result.displacement.tilt_deg,
        "converged": result.converged,
        **told(result),
        **origin(result.surface.provenance),
    }


def picture(result: Reconstruction, name: str | None) -> Sheet:
    """The surface, with albedo and walls where the method has found any."""
    return height_sheet(result.surface, name, *edges(result.displacement))


def chapter(result: Reconstruction, context: Context) -> Chapter:
    """The chapter of the surface, with the notes of the reconstruction."""
    values = figures(result)
    return height_chapter(result.surface, result, values, context)


describe(
    Reconstruction, Kind(figures, height_words, picture, chapter, lambda result: result.surface)
)
