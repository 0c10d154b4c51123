"""What is shown of the bias of a gauge: at one reference, and over several."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from fringeworks.evaluate.gauge_bias import (
    CAPABLE,
    SIGNIFICANT,
    GaugeLinearity,
    GaugeType1,
)
from fringeworks.report.kind import Kind, Rows, Word, describe
from fringeworks.report.kinds.gauge_anova import ends, gauge_verdict, span
from fringeworks.report.page.blocks import Block, Chapter, Picture, Table
from fringeworks.report.page.chapter import Context
from fringeworks.report.page.parts import facts
from fringeworks.report.sheets import titled
from fringeworks.report.verdicts import Verdict
from fringeworks.types.numbers import estimate, limit, number, percent, sigma_text
from fringeworks.types.report_head import DEVICE_HEAD

if TYPE_CHECKING:
    from fringeworks.report.drawing import Figure

LEVELS = ("reference", "mean bias", "line", "95 %")
"""Columns of the table of references."""


def type1_figures(found: GaugeType1) -> dict[str, Any]:
    """Bias, Cg and Cgk."""
    names = ("reference", "tolerance", "share", "spread", "mean", "sigma", "bias", "bias_sigma")
    return {
        "verdict": found.verdict,
        "trials": int(found.values.size),
        **{name: getattr(found, name) for name in (*names, "t", "significance", "cg", "cgk")},
        "bias_interval": ends(found.bias_interval),
        "cg_interval": ends(found.cg_interval),
        "cgk_interval": ends(found.cgk_interval),
    }


def _type1_rows(found: GaugeType1) -> list[tuple[str, str]]:
    real = "significant" if found.significance < SIGNIFICANT else "not significant"
    bias = estimate(found.bias, found.bias_sigma)
    half = limit(0.5 * found.share)
    wide = limit(0.5 * found.spread)
    return [
        ("trials", f"{found.values.size}"),
        ("reference", limit(found.reference)),
        ("width of the tolerance T", limit(found.tolerance)),
        ("mean", number(found.mean, found.sigma)),
        ("standard deviation s", sigma_text(found.sigma)),
        ("bias", f"{bias}, {real}: t {number(found.t)}, p {number(found.significance)}"),
        (
            f"Cg = {limit(found.share)} T / ({limit(found.spread)} s)",
            f"{number(found.cg)} (95 %: {span(found.cg_interval)})",
        ),
        (
            f"Cgk = ({half} T − |bias|) / ({wide} s)",
            f"{number(found.cgk)} (95 %: {span(found.cgk_interval)})",
        ),
        ("verdict", f"{found.verdict}: Cg and Cgk of {limit(CAPABLE)} or more are accepted"),
    ]


def type1_words(found: GaugeType1, _: dict[str, Any]) -> Iterator[Word]:
    """Bias, Cg, Cgk and verdict, a line each."""
    for name, text in _type1_rows(found):
        yield f"{name}: {text}"


def type1_picture(found: GaugeType1, name: str | None) -> Figure:
    """The trials with reference and the share of the tolerance."""
    from fringeworks.report.gauge_charts import type1_chart  # which needs Matplotlib

    return type1_chart(titled(name, "Trials of one reference"), found)


def type1_chapter(found: GaugeType1, context: Context) -> Chapter:
    """Figures and the run of the trials."""
    caption = "Trials in their order; dashed, the share of the tolerance about the reference."
    shown: tuple[Block, ...] = (
        facts(_type1_rows(found)),
        Picture(type1_picture(found, None), caption),
    )
    return Chapter(context.name, shown)


def linearity_figures(found: GaugeLinearity) -> dict[str, Any]:
    """Slope and intercept, and the bias at each reference."""
    fitted = ("slope", "slope_sigma", "slope_significance", "intercept", "intercept_sigma")
    names = (*fitted, "intercept_significance", "sigma", "curvature_significance", "straight")
    return {
        "verdict": found.verdict,
        "trials": int(found.values.size),
        **{name: getattr(found, name) for name in names},
        "levels": [
            {
                "reference": float(x),
                "mean_bias": float(mean),
                "line": float(line),
                "line_interval": [float(line - half), float(line + half)],
            }
            for x, mean, line, half in _levels(found)
        ],
    }


def _levels(found: GaugeLinearity) -> Any:
    return zip(found.levels, found.mean_bias, found.line, found.band, strict=True)


def _level_rows(found: GaugeLinearity) -> list[tuple[str, ...]]:
    return [
        (
            limit(float(x)),
            number(float(mean), float(half)),
            number(float(line), float(half)),
            span((float(line - half), float(line + half))),
        )
        for x, mean, line, half in _levels(found)
    ]


def _linearity_rows(found: GaugeLinearity) -> list[tuple[str, str]]:
    why = {
        "pass": "the band holds a bias of 0 at every reference",
        "fail": "the band leaves a bias of 0 out",
        "undecided": "the bias is not on a line, which therefore does not describe it",
    }[found.verdict]
    slope = estimate(found.slope, found.slope_sigma)
    intercept = estimate(found.intercept, found.intercept_sigma)
    return [
        ("trials", f"{found.values.size}"),
        ("slope", f"{slope}, p {number(found.slope_significance)}"),
        ("intercept", f"{intercept}, p {number(found.intercept_significance)}"),
        ("standard deviation about the line", sigma_text(found.sigma)),
        ("lack of fit", f"p {number(found.curvature_significance)}; a line above "
         f"{percent(SIGNIFICANT)}"),
        ("verdict", f"{found.verdict}: {why}"),
    ]  # fmt: skip


def linearity_words(found: GaugeLinearity, _: dict[str, Any]) -> Iterator[Word]:
    """The bias at each reference, the line, the verdict."""
    yield Rows(LEVELS, _level_rows(found))
    for name, text in _linearity_rows(found):
        yield f"{name}: {text}"


def linearity_picture(found: GaugeLinearity, name: str | None) -> Figure:
    """The bias over the references with line and band."""
    from fringeworks.report.gauge_charts import linearity_chart  # which needs Matplotlib

    return linearity_chart(titled(name, "Bias over the reference value"), found)


def linearity_chapter(found: GaugeLinearity, context: Context) -> Chapter:
    """Figures, the bias at each reference, and the line."""
    caption = "Bias of every trial and its means; the line with its confidence band of 95 %."
    shown: tuple[Block, ...] = (
        facts(_linearity_rows(found)),
        Table(LEVELS, tuple(_level_rows(found)), "Bias at each reference"),
        Picture(linearity_picture(found, None), caption),
    )
    return Chapter(context.name, shown)


def type1_verdict(found: GaugeType1) -> Verdict:
    """The verdict on the gauge."""
    return gauge_verdict(found.verdict)


def linearity_verdict(found: GaugeLinearity) -> Verdict:
    """The verdict on the gauge's linearity."""
    said = {
        "pass": "no significant bias",
        "fail": "the bias is significant",
        "undecided": "the bias is not on a line",
    }[found.verdict]
    return Verdict(found.verdict, f"{found.verdict.upper()}: {said}.")


describe(
    GaugeType1,
    Kind(
        type1_figures,
        type1_words,
        type1_picture,
        type1_chapter,
        verdict=type1_verdict,
        head=DEVICE_HEAD,
    ),
)
describe(
    GaugeLinearity,
    Kind(
        linearity_figures,
        linearity_words,
        linearity_picture,
        linearity_chapter,
        verdict=linearity_verdict,
        head=DEVICE_HEAD,
    ),
)
