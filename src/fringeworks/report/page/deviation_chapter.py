"""The chapter on a deviation from a model."""

from __future__ import annotations

import numpy as np

from fringeworks.evaluate.deviation import Deviation
from fringeworks.evaluate.spots import find_spots
from fringeworks.report.display import plot
from fringeworks.report.page.blocks import Block, Chapter, Picture, Surface
from fringeworks.report.page.chapter import Context, chapter_of, judged_block
from fringeworks.report.page.charts import histogram
from fringeworks.report.page.parts import (
    dict_table,
    facts,
    findings_block,
    provenance_block,
    with_unit,
)
from fringeworks.report.summary import summarise
from fringeworks.report.viewer.pack import PackedSurface, pack_surface
from fringeworks.types import PointCloud, Reason

MOST_SPOTS = 50
"""Dents and bumps that a page lists; with more, the model does not describe the part."""


@chapter_of.register
def _(result: Deviation, context: Context) -> Chapter:
    values = summarise(result)
    alignment = result.alignment
    rows = [
        ("points", f"{values['points']:,}"),
        ("mean", with_unit(values["mean_mm"], "mm")),
        ("σ of the mean", with_unit(values["mean_sigma_mm"], "mm")),
        ("rms", with_unit(values["rms_mm"], "mm")),
        ("median σ of a point", with_unit(values["median_sigma_mm"], "mm")),
        ("smallest", with_unit(values["smallest_mm"], "mm")),
        ("largest", with_unit(values["largest_mm"], "mm")),
        ("aligned by", alignment.by),
        ("alignment converged", alignment.converged),
        ("rms of the alignment", with_unit(alignment.rms_mm, "mm")),
    ]
    return Chapter(
        context.name,
        (
            facts(rows),
            *judged_block(values, context),
            *_shown(result, context),
            *findings_block(values["findings"]),
            Picture(
                histogram(result.distance_mm, "deviation / mm", what="points"),
                "Distribution of the deviation.",
            ),
            *_spots(result),
            *provenance_block(result.provenance),
        ),
    )


def _shown(result: Deviation, context: Context) -> tuple[Block, ...]:
    """The surface to turn with the deviation as its colour; points without a frame as a picture."""
    cloud = result.part
    if not isinstance(cloud, PointCloud):
        return (Picture(plot(result, context.name), "The deviation from the model."),)

    def pack() -> PackedSurface:
        return pack_surface(
            cloud,
            camera=context.rig,
            deviation=result.distance_mm,
            title=context.name,
            every=context.every,
        )

    caption = "The deviation from the model, with its standard deviation."
    return (
        Surface((pack,), caption, lambda: plot(result, context.name)),
        Picture(plot(result, context.name), caption),
    )


def _spots(result: Deviation) -> tuple[Block, ...]:
    """Dents and bumps, where σ is known."""
    if not np.isfinite(result.sigma_mm[result.reason == Reason.OK]).all():
        return ()
    spots = find_spots(result)[:MOST_SPOTS]
    if not spots:
        return ()
    rows = [
        {
            "x / mm": float(spot.place_mm[0]),
            "y / mm": float(spot.place_mm[1]),
            "z / mm": float(spot.place_mm[2]),
            "deviation / mm": spot.depth_mm,
            "σ / mm": spot.sigma_mm,
            "area / mm²": spot.area_mm2,
        }
        for spot in spots
    ]
    return (dict_table(rows, "Dents and bumps, in the model's coordinates"),)
