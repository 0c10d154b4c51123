"""What is shown of projector coordinates."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from fringeworks.report.display import maps_of
from fringeworks.report.kind import Kind, Word, describe
from fringeworks.report.kinds.surface import itself
from fringeworks.report.page.blocks import Block, Chapter, Picture
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
from fringeworks.types import CoordinateMap, Decoded, Reason, count_reasons
from fringeworks.types.numbers import number, percent, sigma_text


def figures(decoded: Decoded) -> dict[str, Any]:
    """Figures of each axis."""
    axes = {}
    for axis, found in decoded.maps.items():
        ok = found.reason == Reason.OK
        values, sigma = found.coordinate_px[ok], found.sigma_px[ok]
        axes[axis] = {
            "periods_px": list(found.periods_px),
            "repeats_px": found.repeats_px,
            "failed_fraction": found.failed_fraction,
            "reasons": count_reasons(found.reason),
            "minimum_px": float(values.min()) if values.size else None,
            "maximum_px": float(values.max()) if values.size else None,
            "median_sigma_px": float(np.median(sigma)) if sigma.size else None,
            "median_modulation": float(np.median(found.modulation[ok])) if ok.any() else None,
            **decoded.details.get(axis, {}),
        }
    some = next(iter(decoded.maps.values()))
    return {
        "shape": list(some.coordinate_px.shape),
        "noise": {"read_counts": decoded.noise.read_counts, "gain": decoded.noise.gain},
        "axes": axes,
        **told(decoded),
        **origin(decoded.provenance),
    }


def words(_: Decoded, figures: dict[str, Any]) -> Iterator[Word]:
    """Projector coordinates along each axis."""
    yield from finding_words(figures)
    for axis, found in figures["axes"].items():
        failed = failures(found["reasons"])
        if found["median_sigma_px"] is None:
            yield f"{axis}: no pixel could be measured ({failed})"
            continue
        yield (
            f"{axis}: {number(found['minimum_px'], found['median_sigma_px'])} … "
            f"{number(found['maximum_px'], found['median_sigma_px'])} px, median σ "
            f"{sigma_text(found['median_sigma_px'])} px"
        )
        yield f"   failed: {percent(found['failed_fraction'])} ({failed})"


def _panels(found: CoordinateMap) -> list[Panel]:
    what = "column" if found.axis == "x" else "row"
    return [
        Panel(f"projector {what} {found.axis}", found.coordinate_px, "values", "projector px"),
        Panel(SIGMA, found.sigma_px, "sigma", "projector px"),
        Panel("modulation", found.modulation, "grey", "counts"),
        Panel(REASONS, found.reason, "reasons"),
    ]


def axis_picture(found: CoordinateMap, name: str | None) -> Sheet:
    """The maps of one axis."""
    what = "column" if found.axis == "x" else "row"
    return Sheet(
        titled(name, f"The projector {what} that lights each camera pixel"),
        map_facts(1.0 - found.failed_fraction, found.sigma_px, "projector px"),
        _panels(found),
        columns=2,
    )


def picture(decoded: Decoded, name: str | None) -> Sheet:
    """The maps of each axis."""
    maps = list(decoded.maps.values())
    facts = "\n".join(
        (f"{'columns' if found.axis == 'x' else 'rows'}: " if len(maps) > 1 else "")
        + map_facts(1.0 - found.failed_fraction, found.sigma_px, "projector px")
        for found in maps
    )
    return Sheet(
        titled(name, "The projector pixel that lights each camera pixel"),
        facts,
        [panel for found in maps for panel in _panels(found)],
        columns=4 if len(maps) > 1 else 2,
        findings=decoded.findings,
    )


def chapter(result: Decoded, context: Context) -> Chapter:
    """Each axis to turn, with its figures."""
    values = figures(result)
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
                    ("measured pixels", percent(1 - found.failed_fraction)),
                    ("median σ", sigma_with_unit(one["median_sigma_px"], "px")),
                    ("median modulation", with_unit(one["median_modulation"], "counts")),
                ]
            ),
            surface_block(
                found,
                replace(context, name=f"{context.name}, {axis}"),
                f"Projector coordinate {axis} over the camera's pixels.",
                lambda: maps_of(result),
            ),
            Picture(histogram(found.sigma_px, "σ / px"), "Distribution of σ."),
            reasons_table(found.reason),
        ]
    blocks += provenance_block(result.provenance)
    return Chapter(context.name, tuple(blocks))


describe(CoordinateMap, Kind(picture=axis_picture, surface=itself))
describe(Decoded, Kind(figures, words, picture, chapter))
