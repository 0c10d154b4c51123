"""Two surfaces of one kind and size together: side by side, and as their difference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fringeworks.report.page.blocks import Block, Chapter, Picture, Surface, Text
from fringeworks.report.page.charts import histogram
from fringeworks.report.page.parts import facts, with_unit
from fringeworks.report.page.surfaces import surface_of
from fringeworks.surface.section import difference
from fringeworks.types import FloatMap, HeightMap, PointCloud
from fringeworks.types.numbers import percent


def compared(chapters: Sequence[Chapter], results: Sequence[Any]) -> list[Chapter]:
    """Put a chapter on the difference before those of two results; it holds both surfaces.

    Parameters
    ----------
    chapters : two chapters, with a surface each
    results : their results, which ``comparable`` has accepted
    """
    both = [block for chapter in chapters for block in chapter.blocks if isinstance(block, Surface)]
    names = [chapter.title for chapter in chapters]
    caption = (
        f"A: {names[0]}, B: {names[1]}. The list of results shows one, both side by side, or B − A."
    )
    surface = Surface(tuple(block.pack[0] for block in both), caption, both[0].draw)
    others = [
        replace(chapter, blocks=tuple(b for b in chapter.blocks if not isinstance(b, Surface)))
        for chapter in chapters
    ]
    return [Chapter("Comparison", (*_figures(results), surface)), *others]


def _figures(results: Sequence[Any]) -> tuple[Block, ...]:
    """The difference in figures, where both have an order of pixels in common."""
    one, other = (surface_of(result) for result in results)
    if not isinstance(one, PointCloud | HeightMap):
        return ()
    values, sigma = difference(one, other)
    unit = "mm" if isinstance(one, PointCloud) else one.unit
    known = np.isfinite(values)
    if not known.any():
        return (Text("The two surfaces have no measured pixel in common."),)
    return (
        facts(
            [
                ("pixels in both", percent(float(known.mean()))),
                ("median of B − A", with_unit(float(np.median(values[known])), unit)),
                ("median |B − A|", with_unit(float(np.median(np.abs(values[known]))), unit)),
                ("within 1 σ of the difference", percent(_within(values, sigma, 1.0))),
                ("within 2 σ", percent(_within(values, sigma, 2.0))),
            ]
        ),
        Picture(histogram(values, f"B − A / {unit}"), "Distribution of the difference."),
    )


def _within(values: FloatMap, sigma: FloatMap, factor: float) -> float:
    known = np.isfinite(values)
    return float(np.mean(np.abs(values[known]) <= factor * sigma[known]))
