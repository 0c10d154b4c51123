"""What is shown of a deviation from a model."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from fringeworks.evaluate.deviation import Deviation
from fringeworks.evaluate.inspect import Check, judge_deviation
from fringeworks.evaluate.spots import find_spots
from fringeworks.report.display import maps_of
from fringeworks.report.kind import Kind, Rows, Word, describe
from fringeworks.report.page.blocks import Block, Chapter, Picture, Surface
from fringeworks.report.page.chapter import Context, judged_block
from fringeworks.report.page.charts import histogram
from fringeworks.report.page.parts import (
    dict_table,
    facts,
    findings_block,
    provenance_block,
    sigma_with_unit,
    with_unit,
)
from fringeworks.report.page.surfaces import thinned_words, thinning
from fringeworks.report.sheets import Sheet, titled
from fringeworks.report.summary import origin, told
from fringeworks.types import PointCloud, Reason, TriangleMesh
from fringeworks.types.numbers import estimate, limit, number, percent, sigma_text
from fringeworks.types.report_head import PART_HEAD

if TYPE_CHECKING:
    from fringeworks.report.drawing import Figure
    from fringeworks.report.viewer.pack import PackedSurface

MOST_SPOTS = 50
"""Dents and bumps that a page lists; with more, the model does not describe the part."""
PLACE_MM = 0.1
"""Standard deviation that places of spots are shown with, mm: a place is the middle of an area of
some pixels, and is shown to 0.01 mm."""
SPOT_COLUMNS = ("x / mm", "y / mm", "z / mm", "deviation / mm", "± σ", "area / mm²")
"""Columns of the table of dents and bumps."""
FACE_COLUMNS = ("face", "form", "points", "mean / mm", "rms / mm", "smallest / mm", "largest / mm")
"""Columns of the table of the drawing's faces."""


def figures(found: Deviation) -> dict[str, Any]:
    """How far the part lies from its model, and how it was aligned."""
    alignment = found.alignment
    sigma = np.sqrt(np.diag(alignment.covariance))
    return found.figures() | {
        "alignment": {
            "by": alignment.by,
            "T_model_part": alignment.T_model_part.tolist(),
            "covariance_rad_mm": alignment.covariance.tolist(),
            "sigma_rotation_deg": np.degrees(sigma[:3]).tolist(),
            "sigma_translation_mm": sigma[3:].tolist(),
            "rms_mm": alignment.rms_mm,
            "points": alignment.points,
            "share": alignment.share,
            "slides": alignment.slides,
            "converged": alignment.converged,
        },
        **told(found),
        **origin(found.provenance),
    }


def words(found: Deviation, figures: dict[str, Any]) -> Iterator[Word]:
    """Mean, rms, dents and bumps, and the share outside a tolerance."""
    if found.only:
        yield f"only points of the faces {', '.join(found.only)}"
    sigma = figures["mean_sigma_mm"]
    mean = estimate(figures["mean_mm"], sigma, "mm")
    yield f"{figures['points']} points; mean {mean}; rms {number(figures['rms_mm'], unit='mm')}"
    if figures["median_sigma_mm"] is not None:
        yield f"median σ of a point {sigma_text(figures['median_sigma_mm'], 'mm')}"
        spots = find_spots(found)
        if spots:
            rows = [
                [
                    *(number(v, PLACE_MM) for v in spot.place_mm),
                    number(spot.depth_mm, spot.sigma_mm, signed=True),
                    sigma_text(spot.sigma_mm),
                    number(spot.area_mm2),
                ]
                for spot in spots
            ]
            yield Rows(SPOT_COLUMNS, rows)
    if figures.get("faces"):
        names = (f"{one['number']} {one['name']}".strip() for one in figures["faces"])
        rows = [
            [
                name,
                one["kind"],
                str(one["points"]),
                *(number(one[key]) for key in ("mean_mm", "rms_mm", "smallest_mm", "largest_mm")),
            ]
            for name, one in zip(names, figures["faces"], strict=True)
        ]
        yield Rows(FACE_COLUMNS, rows)
    if "outside_share" in figures:
        sure = figures["surely_outside_share"]
        surely = "" if sure is None else f", {percent(sure)} surely (by 2 σ)"
        yield f"{percent(figures['outside_share'])} outside the tolerance{surely}"
    if "verdict" in figures:
        why = figures["why"]
        yield f"{figures['verdict']}: {why}" if why else figures["verdict"]
    yield from found.findings


def picture(found: Deviation, name: str | None) -> Figure | Sheet:
    """The deviation, its σ, and the ratio of the two."""
    from fringeworks.report.deviation_picture import deviation_sheet, of_points  # needs Matplotlib

    title = titled(name, "Deviation from the model")
    if isinstance(found.part, PointCloud):
        return deviation_sheet(title, found)
    return of_points(title, found)


def chapter(result: Deviation, context: Context) -> Chapter:
    """Figures, the surface to turn, and dents and bumps."""
    values = figures(result)
    alignment, check = result.alignment, judge_deviation(result, context.rig)
    if check is not None:
        context.verdicts.append(check.verdict)
    rows = [
        *_judged(result, check, values),
        *((("faces", ", ".join(result.only)),) if result.only else ()),
        ("points", f"{values['points']:,}"),
        ("mean", estimate(values["mean_mm"], values["mean_sigma_mm"], "mm")),
        ("rms", with_unit(values["rms_mm"], "mm")),
        ("median σ of a point", sigma_with_unit(values["median_sigma_mm"], "mm")),
        ("smallest", with_unit(values["smallest_mm"], "mm", values["median_sigma_mm"])),
        ("largest", with_unit(values["largest_mm"], "mm", values["median_sigma_mm"])),
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
        return (Picture(maps_of(result), "The deviation from the model."),)

    def pack() -> PackedSurface:
        from fringeworks.report.deviation_picture import flags_of, scaled  # needs Matplotlib
        from fringeworks.report.viewer.pack import pack_surface  # for those only who turn it

        return pack_surface(
            cloud,
            camera=context.rig,
            deviation=result.distance_mm,
            limits=scaled(result)[1],
            model=in_part(result),
            flags=flags_of(result),
            title=context.name,
            own_notes=False,
            every=thinning(cloud, context.every),
        )

    from fringeworks.report.deviation_picture import flagged_map  # needs Matplotlib

    caption = "The deviation from the model, which is grey; flags are dents and bumps."
    caption += thinned_words(cloud, context.every)
    more = "The deviation, its standard deviation, and the ratio of the two."
    return (
        Surface((pack,), caption, lambda: flagged_map(result)),
        Picture(maps_of(result), more),
    )


def in_part(result: Deviation) -> TriangleMesh:
    """The model in the part's coordinates, where the viewer shows it."""
    T, model = np.linalg.inv(result.alignment.T_model_part), result.model
    placed = np.asarray(model.vertices_mm, np.float64) @ T[:3, :3].T + T[:3, 3]
    return TriangleMesh(placed.astype(np.float32), model.faces)


def _judged(
    result: Deviation, check: Check | None, values: dict[str, Any]
) -> list[tuple[str, Any]]:
    """The tolerance, what lies outside of it, and the verdict."""
    if result.tolerance_mm is None:
        return []
    rows = [
        ("tolerance", f"±{limit(result.tolerance_mm)} mm"),
        ("outside the tolerance", percent(values["outside_share"])),
    ]
    if values["surely_outside_share"] is not None:
        rows.append(("surely outside (by 2 σ)", percent(values["surely_outside_share"])))
    if check is None:
        return rows
    wide = number(check.expanded, check.sigma, "mm")
    largest = f"{number(check.value, check.sigma, 'mm')}, U = {wide}"
    verdict = f"{check.verdict}: {check.why}" if check.why else check.verdict
    return [
        *rows,
        ("largest deviation that counts", largest),
        ("verdict", verdict),
    ]


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


describe(Deviation, Kind(figures, words, picture, chapter, head=PART_HEAD))
