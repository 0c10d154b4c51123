"""Chapters of surfaces: to turn, as maps, profiles and histograms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from fringeworks.pipeline.pairs import Reconstruction
from fringeworks.pipeline.stacks import Measurement
from fringeworks.report.display import plot
from fringeworks.report.drawing import Figure
from fringeworks.report.page.blocks import Block, Chapter, Picture, Surface, Text
from fringeworks.report.page.chapter import Context, chapter_of, judged_block
from fringeworks.report.page.charts import histogram
from fringeworks.report.page.parts import (
    facts,
    findings_block,
    provenance_block,
    reasons_table,
    with_unit,
)
from fringeworks.report.page.surfaces import as_heights, packed
from fringeworks.report.summary import summarise
from fringeworks.report.viewer.pack import PackedSurface
from fringeworks.types import (
    Decoded,
    DisplacementMap,
    FloatMap,
    HeightMap,
    InputError,
    PointCloud,
    Points,
)


def _surface(result: Any, context: Context, caption: str, draw: Callable[[], Figure]) -> Surface:
    def pack() -> PackedSurface:
        return packed(result, camera=context.rig, title=context.name, every=context.every)

    return Surface((pack,), caption, draw)


@chapter_of.register
def _(result: Reconstruction, context: Context) -> Chapter:
    return _heights(result.surface, result, context)


@chapter_of.register
def _(result: HeightMap, context: Context) -> Chapter:
    return _heights(result, result, context)


def _heights(surface: HeightMap, result: Reconstruction | HeightMap, context: Context) -> Chapter:
    values = summarise(result)
    unit = surface.unit
    rows = [
        ("method", surface.method or None),
        ("measured pixels", f"{1 - surface.failed_fraction:.2%}"),
        (f"{surface.quantity}, smallest", with_unit(values["minimum"], unit)),
        (f"{surface.quantity}, largest", with_unit(values["maximum"], unit)),
        ("median σ", with_unit(values["median_sigma"], unit)),
        ("converged", surface.converged),
    ]
    return Chapter(
        context.name,
        (
            facts(rows),
            *judged_block(values, context),
            _surface(
                result,
                context,
                f"The {surface.quantity} with its standard deviation and reasons.",
                lambda: plot(result, context.name),
            ),
            *findings_block(values["findings"]),
            *_profiles(surface),
            *_histograms(surface.values, surface.sigma, f"the {surface.quantity}", unit),
            reasons_table(surface.reason),
            *provenance_block(surface.provenance),
        ),
    )


def _profiles(surface: HeightMap | PointCloud) -> tuple[Block, ...]:
    """Profiles along the middle row and column, as far as anything is measured there."""
    rows, columns = surface.reason.shape
    lines = {
        "row": ((0, rows // 2), (columns - 1, rows // 2)),
        "column": ((columns // 2, 0), (columns // 2, rows - 1)),
    }
    found: list[Block] = []
    for name, line in lines.items():
        if line[0] == line[1]:
            continue
        try:
            drawn = plot(surface.profile(line), f"Middle {name}")
        except InputError as error:  # points that do not lie in the order of a camera's pixels
            found.append(Text(f"There is no profile along the middle {name}: {error}."))
            continue
        found.append(Picture(drawn, f"Profile along the middle {name}, with ±2 σ."))
    return tuple(found)


def _histograms(values: FloatMap, sigma: FloatMap, quantity: str, unit: str) -> tuple[Block, ...]:
    return (
        Picture(
            histogram(values, f"{quantity.removeprefix('the ')} / {unit}"),
            f"Distribution of {quantity}.",
        ),
        Picture(histogram(sigma, f"σ / {unit}"), "Distribution of the standard deviation σ."),
    )


@chapter_of.register
def _(result: DisplacementMap, context: Context) -> Chapter:
    surface = as_heights(result)
    return _heights(surface, surface, context)


@chapter_of.register
def _(result: Measurement, context: Context) -> Chapter:
    return _cloud(result.points, result, context)


@chapter_of.register
def _(result: PointCloud, context: Context) -> Chapter:
    return _cloud(result, result, context)


def _cloud(
    cloud: PointCloud,
    result: Measurement | PointCloud,
    context: Context,
) -> Chapter:
    values = summarise(result)
    rows = [
        ("points", f"{values['points']:,}"),
        ("measured pixels", f"{1 - cloud.failed_fraction:.2%}"),
        ("median σ", with_unit(values["median_sigma_mm"], "mm")),
        ("median σ of pixel noise", with_unit(values["median_noise_mm"], "mm")),
        ("epipolar error (rms)", with_unit(values["residual_rms_px"], "px")),
    ]
    blocks: list[Block] = [
        facts(rows),
        *judged_block(values, context),
        _surface(
            result,
            context,
            "The points with their standard deviations and reasons.",
            lambda: plot(result, context.name),
        ),
        *findings_block(values["findings"]),
        *_profiles(cloud),
        *_histograms(cloud.xyz_mm[..., 2], cloud.sigma_mm, "z", "mm"),
    ]
    if cloud.residual_px is not None:
        chart = histogram(cloud.residual_px, "epipolar error / px")
        blocks.append(Picture(chart, "Distance of the projector's points from epipolar lines."))
    blocks += [reasons_table(cloud.reason), *provenance_block(cloud.provenance)]
    return Chapter(context.name, tuple(blocks))


@chapter_of.register
def _(result: Points, context: Context) -> Chapter:
    xyz = result.xyz_mm
    values = summarise(result)
    rows = [
        ("points", f"{len(xyz):,}"),
        ("median σ", with_unit(values["median_sigma_mm"], "mm")),
    ]
    chart = histogram(xyz[:, 2], "z / mm", what="points")
    return Chapter(
        context.name,
        (
            facts(rows),
            *judged_block(values, context),
            *findings_block(values["findings"]),
            _surface(result, context, "The points.", lambda: chart),
            Picture(chart, "Distribution of z."),
            *provenance_block(result.provenance),
        ),
    )


@chapter_of.register
def _(result: Decoded, context: Context) -> Chapter:
    values = summarise(result)
    blocks: list[Block] = [
        *judged_block(values, context),
        *findings_block(values["findings"]),
    ]
    for axis, found in result.maps.items():
        one = values["axes"][axis]
        blocks += [
            facts(
                [
                    ("axis", f"{axis}, of the projector"),
                    ("periods", ", ".join(f"{p:g}" for p in found.periods_px) + " px"),
                    ("measured pixels", f"{1 - found.failed_fraction:.2%}"),
                    ("median σ", with_unit(one["median_sigma_px"], "px")),
                    ("median modulation", with_unit(one["median_modulation"], "counts")),
                ]
            ),
            _surface(
                found,
                replace(context, name=f"{context.name}, {axis}"),
                f"Projector coordinate {axis} over the camera's pixels.",
                lambda: plot(result, context.name),
            ),
            Picture(histogram(found.sigma_px, "σ / px"), "Distribution of σ."),
            reasons_table(found.reason),
        ]
    blocks += provenance_block(result.provenance)
    return Chapter(context.name, tuple(blocks))
