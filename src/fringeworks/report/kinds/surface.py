"""What is shown of height maps and point clouds."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from fringeworks.report.display import maps_of, plot
from fringeworks.report.kind import Kind, Word, describe
from fringeworks.report.page.blocks import Block, Chapter, Picture, Text
from fringeworks.report.page.chapter import Context, judged_block
from fringeworks.report.page.charts import histogram
from fringeworks.report.page.parts import (
    facts,
    findings_block,
    provenance_block,
    reasons_table,
    sigma_with_unit,
    with_unit,
)
from fringeworks.report.page.surfaces import surface_block
from fringeworks.report.sheets import REASONS, SIGMA, Panel, Sheet, map_facts, titled
from fringeworks.report.summary import failures, finding_words, origin, told
from fringeworks.surface.cloud import normals
from fringeworks.types import (
    CAMERA_FRAME,
    FloatMap,
    HeightMap,
    InputError,
    PointCloud,
    Reason,
    count_reasons,
)
from fringeworks.types.numbers import number, percent, sigma_text

LIGHT = (-0.5, -0.5, -0.7)
"""Direction towards the lamp of a shaded surface, in camera coordinates: from the upper left, as
pictures of relief are lit by custom."""


def height_figures(surface: HeightMap) -> dict[str, Any]:
    """The figures of a height map, without its findings and its origin."""
    finite = np.isfinite(surface.values)
    values, sigma = surface.values[finite], surface.sigma[finite]
    return {
        "method": surface.method,
        "quantity": surface.quantity,
        "unit": surface.unit,
        "shape": list(surface.shape),
        "failed_fraction": surface.failed_fraction,
        "reasons": count_reasons(surface.reason),
        "minimum": float(values.min()) if values.size else None,
        "maximum": float(values.max()) if values.size else None,
        "median": float(np.median(values)) if values.size else None,
        "median_sigma": float(np.median(sigma)) if sigma.size else None,
        "shared_sigma": shared_sigma(surface),
    }


def shared_sigma(surface: HeightMap) -> float | None:
    """The part of σ that all pixels share where nothing tells the whole periods, px; None without
    one."""
    parts = [f.figures["zero_sigma_px"] for f in surface.findings if "zero_sigma_px" in f.figures]
    return float(max(parts)) if parts and surface.unit == "px" else None


def _sigma_of_pixels(surface: HeightMap) -> FloatMap:
    """σ without the part that all pixels share, which would hide what differs."""
    shared = shared_sigma(surface)
    if shared is None:
        return surface.sigma
    return np.sqrt(np.maximum(np.asarray(surface.sigma, np.float64) ** 2 - shared**2, 0.0))


def _height_figures(surface: HeightMap) -> dict[str, Any]:
    return height_figures(surface) | {
        "converged": surface.converged,
        **told(surface),
        **origin(surface.provenance),
    }


def height_words(_: object, figures: dict[str, Any]) -> Iterator[Word]:
    """A height map in words, and its errors where the truth is known."""
    yield from finding_words(figures)
    unit = figures["unit"]
    if figures["median"] is None:
        yield f"{figures['quantity']}: no pixel could be measured"
    else:
        shared, own = figures.get("shared_sigma"), figures["median_sigma"]
        beside = ""
        if shared is not None:
            own = max(own**2 - shared**2, 0.0) ** 0.5
            beside = f", beside {sigma_text(shared)} {unit} that all pixels share"
        yield (
            f"{figures['quantity']}: {number(figures['minimum'], own)} … "
            f"{number(figures['maximum'], own)} {unit}, median σ {sigma_text(own)} {unit}{beside}"
        )
    yield f"failed: {percent(figures['failed_fraction'])} ({failures(figures['reasons'])})"
    if "errors" in figures:
        e = figures["errors"]
        yield (
            f"against the truth: mean |error| {number(e['mean_abs_error_mm'])} mm, "
            f"s.d. {number(e['std_error_mm'])} mm"
        )


def height_sheet(surface: HeightMap, name: str | None, *more: Panel) -> Sheet:
    """The picture of a height map, with further maps."""
    heights = surface.quantity == "height"
    title = "Height above the reference plane" if heights else "Displacement of the fringes"
    method = f"method {surface.method}" if surface.method else ""
    pitch = f"{number(surface.pitch)} mm/px" if heights and surface.pitch is not None else ""
    shared, sigma = shared_sigma(surface), _sigma_of_pixels(surface)
    beside = "" if shared is None else f", beside {sigma_text(shared)} px in common"
    return Sheet(
        titled(name, title),
        map_facts(1.0 - surface.failed_fraction, sigma, surface.unit, pitch, method),
        [
            Panel(surface.quantity, surface.values, "values", surface.unit),
            Panel(SIGMA + beside, sigma, "sigma", surface.unit),
            Panel(REASONS, surface.reason, "reasons"),
            *more,
        ],
        columns=3,
        findings=surface.warnings,
    )


def height_chapter(
    surface: HeightMap,
    result: object,
    values: dict[str, Any],
    context: Context,
) -> Chapter:
    """The chapter of a height map, or of the result that it is in."""
    unit, usual = surface.unit, values["median_sigma"]
    rows = [
        ("method", surface.method or None),
        ("measured pixels", percent(1 - surface.failed_fraction)),
        (
            f"{surface.quantity}, smallest",
            with_unit(values["minimum"], unit, usual),
        ),
        (
            f"{surface.quantity}, largest",
            with_unit(values["maximum"], unit, usual),
        ),
        ("median σ", sigma_with_unit(usual, unit)),
        ("converged", surface.converged),
    ]
    return Chapter(
        context.name,
        (
            facts(rows),
            *judged_block(values, context),
            surface_block(
                result,
                context,
                f"The {surface.quantity} with its standard deviation and reasons.",
                lambda: maps_of(result),
            ),
            *findings_block(values["findings"]),
            *_profiles(surface),
            *_histograms(surface.values, surface.sigma, f"the {surface.quantity}", unit),
            reasons_table(surface.reason),
            *provenance_block(surface.provenance),
        ),
    )


def _height_chapter(surface: HeightMap, context: Context) -> Chapter:
    return height_chapter(surface, surface, _height_figures(surface), context)


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


def cloud_figures(cloud: PointCloud) -> dict[str, Any]:
    """The figures of a point cloud."""
    ok = cloud.reason == Reason.OK
    count = int(np.count_nonzero(ok))
    some = count > 0
    # One axis at a time: minima along rows of three take far longer.
    axes = [cloud.xyz_mm[..., k] for k in range(3)]
    return {
        "shape": list(cloud.shape),
        "frame": cloud.frame,
        "points": count,
        "failed_fraction": cloud.failed_fraction,
        "reasons": count_reasons(cloud.reason),
        "minimum_mm": [float(v.min(where=ok, initial=np.inf)) for v in axes] if some else None,
        "maximum_mm": [float(v.max(where=ok, initial=-np.inf)) for v in axes] if some else None,
        "median_sigma_mm": _median(cloud.sigma_mm[ok]) if some else None,
        "median_noise_mm": _median(cloud.noise_mm[ok]) if some else None,
        "residual_rms_px": None
        if cloud.residual_px is None or not some
        else float(np.sqrt(np.mean(cloud.residual_px[ok].astype(np.float64) ** 2))),
        **told(cloud),
        **origin(cloud.provenance),
    }


def _median(values: FloatMap) -> float:
    """Median of one value or more, which may be overwritten: that saves a copy.

    ``numpy.median`` loads the package of masked arrays, which takes longer.
    """
    middle = values.size // 2
    before = middle - (values.size + 1) % 2
    values.partition((before, middle))
    return float(np.mean(values[before : middle + 1]))


COORDINATES = "coordinates of "
"""Begins what points are said to be in that are not in camera coordinates."""


def place_words(cloud: PointCloud) -> str:
    """The coordinates of points, such as "coordinates of base"."""
    return f"{COORDINATES}{cloud.frame}"


def cloud_words(_: object, figures: dict[str, Any]) -> Iterator[Word]:
    """A point cloud in words."""
    yield from finding_words(figures)
    if figures["points"]:
        low, high = figures["minimum_mm"], figures["maximum_mm"]
        usual = figures["median_sigma_mm"]
        span = ", ".join(
            f"{name} {number(a, usual)} … {number(b, usual)}"
            for name, a, b in zip("xyz", low, high, strict=True)
        )
        frame = figures.get("frame", CAMERA_FRAME)
        place = "" if frame == CAMERA_FRAME else f" in {COORDINATES}{frame}"
        yield f"{figures['points']} points{place}: {span} mm"
        noise = sigma_text(figures["median_noise_mm"], "mm")
        yield f"median σ {sigma_text(usual)} mm, of which noise {noise}"
    yield f"failed: {percent(figures['failed_fraction'])} ({failures(figures['reasons'])})"


def cloud_sheet(cloud: PointCloud, name: str | None) -> Sheet:
    """The picture of a point cloud."""
    lamp, here = np.asarray(LIGHT) / np.linalg.norm(LIGHT), cloud.placement is None
    # The lamp is fixed to the camera, whose frame the picture shows.
    shape = normals(cloud if here else cloud.in_camera()) @ lamp
    return Sheet(
        titled(name, "Points before the camera" if here else f"Points in {place_words(cloud)}"),
        map_facts(1.0 - cloud.failed_fraction, cloud.sigma_mm, "mm"),
        [
            Panel(
                "depth z from the camera" if here else f"z in {place_words(cloud)}",
                cloud.xyz_mm[..., 2],
                "depth",
                "mm",
            ),
            Panel("shape, lit from the upper left", shape, "grey", "brightness"),
            Panel(SIGMA + " along the ray", cloud.sigma_mm, "sigma", "mm"),
            Panel(REASONS, cloud.reason, "reasons"),
        ],
        columns=2,
        findings=cloud.findings,
    )


def cloud_chapter(cloud: PointCloud, result: object, context: Context) -> Chapter:
    """The chapter of a point cloud, or of the result that it is in."""
    values = cloud_figures(cloud)
    rows = [
        ("points", f"{values['points']:,}"),
        ("measured pixels", percent(1 - cloud.failed_fraction)),
        ("median σ", sigma_with_unit(values["median_sigma_mm"], "mm")),
        ("median σ of pixel noise", sigma_with_unit(values["median_noise_mm"], "mm")),
        ("epipolar error (rms)", with_unit(values["residual_rms_px"], "px")),
    ]
    shown = "The points with their standard deviations and reasons"
    if cloud.placement is not None:
        rows.append(("coordinates", cloud.frame))
        shown += ", in camera coordinates"
    blocks: list[Block] = [
        facts(rows),
        *judged_block(values, context),
        surface_block(
            result,
            context,
            f"{shown}.",
            lambda: maps_of(result),
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


def itself(result: Any) -> Any:
    """The surface of a result that is one."""
    return result


describe(HeightMap, Kind(_height_figures, height_words, height_sheet, _height_chapter, itself))
describe(
    PointCloud,
    Kind(
        cloud_figures,
        cloud_words,
        cloud_sheet,
        lambda cloud, context: cloud_chapter(cloud, cloud, context),
        itself,
    ),
)
