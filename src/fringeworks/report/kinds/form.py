"""What is shown of the errors of fitted bodies."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from fringeworks.evaluate.form import FormEvaluation
from fringeworks.report.kind import Kind, Word, describe
from fringeworks.report.page.blocks import Chapter, Picture
from fringeworks.report.page.chapter import Context, judged_block
from fringeworks.report.page.charts import histogram
from fringeworks.report.page.parts import facts, findings_block, provenance_block
from fringeworks.report.summary import finding_words, origin, told
from fringeworks.types.numbers import number, percent

DIGITS = 5
"""Significant digits of places and sizes of bodies, whose σ is not stated beside each: a radius of
25 mm to a micrometre."""

OF_RADIUS = ("radius_mm", "radius_sigma_mm", "probing_error_size_PS_mm")
"""Figures whose digits follow from the σ of the radius."""


def figures(evaluation: FormEvaluation) -> dict[str, Any]:
    """The figures of the bodies."""
    return evaluation.figures | told(evaluation) | origin(evaluation.provenance)


def words(_: FormEvaluation, figures: dict[str, Any]) -> Iterator[Word]:
    """Fitted bodies and their errors."""
    yield from finding_words(figures)
    for body in figures["bodies"]:
        for name, value in body.items():
            yield f"{name:28s} {_shown(name, value, body.get('radius_sigma_mm'))}"
    for name in ("sphere_spacing_mm", "sphere_spacing_error_SD_mm"):
        if name in figures:
            yield f"{name:28s} {number(figures[name], digits=DIGITS)}"


def _shown(name: str, value: Any, sigma: float | None) -> str:
    """A figure of a body: places and sizes by the σ of its radius, shares as percent."""
    if name.endswith("_share"):
        return percent(value)
    if isinstance(value, list):
        known = sigma if name == "centre_mm" else None
        return ", ".join(number(v, known, digits=DIGITS) for v in value)
    if not isinstance(value, float):
        return str(value)
    if name in OF_RADIUS:
        return number(value, sigma, digits=DIGITS)
    return number(value)


def chapter(result: FormEvaluation, context: Context) -> Chapter:
    """The bodies, and how far points lie from them."""
    values = figures(result)
    rows = [
        (name, _shown(name, value, body.get("radius_sigma_mm")))
        for body in values["bodies"]
        for name, value in body.items()
    ]
    charts = [
        Picture(
            histogram(
                1e3 * form.distance_mm[form.region], "distance from the body / µm", what="points"
            ),
            f"Distances of the points from the {form.body}.",
        )
        for form in result.forms
    ]
    return Chapter(
        context.name,
        (
            facts(rows),
            *judged_block(values, context),
            *findings_block(values["findings"]),
            *charts,
            *provenance_block(result.provenance),
        ),
    )


describe(FormEvaluation, Kind(figures, words, chapter=chapter))
