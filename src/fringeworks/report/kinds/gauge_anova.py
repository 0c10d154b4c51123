"""What is shown of a gauge study."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from fringeworks.evaluate.capability import Interval
from fringeworks.evaluate.gauge_anova import ACCEPTED, REFUSED, GaugeStudy
from fringeworks.report.kind import Kind, Rows, Word, describe
from fringeworks.report.page.blocks import Chapter, Picture, Table, Text
from fringeworks.report.page.chapter import Context
from fringeworks.report.page.parts import facts
from fringeworks.report.sheets import titled
from fringeworks.report.verdicts import Verdict
from fringeworks.types.numbers import UNKNOWN, limit, number, percent
from fringeworks.types.report_head import DEVICE_HEAD

if TYPE_CHECKING:
    from fringeworks.report.drawing import Figure

LABELS = {
    "repeatability": "repeatability EV",
    "operators": "operators AV",
    "interaction": "interaction INT",
    "gauge": "gauge GRR",
    "parts": "parts PV",
    "total": "total TV",
}
"""Components with the abbreviations of the handbooks."""
COLUMNS = ("component", "σ", "95 %", "of the total", "95 %", "of the tolerance", "95 %")
"""Columns of the table of components."""
SHARE_INTERVALS = (4, 6)
"""Columns of intervals of shares."""
TABLE = ("source", "sum of squares", "degrees of freedom", "mean square", "F", "significance")
"""Columns of the analysis of variance."""
NOTE = (
    "Shares are of standard deviations and do not add up to 100 %. Intervals are generalised "
    "confidence intervals of 95 %; they never pool the interaction. The verdict follows from the "
    "share itself, as the handbooks ask for: AIAG, Measurement Systems Analysis, 4th edition."
)
"""Note below the tables."""
END_DIGITS = 2
"""Significant digits of the ends of intervals, and of shares: few trials know no more."""


def known(value: float) -> float | None:
    """A number for JSON; None for NaN."""
    return float(value) if np.isfinite(value) else None


def ends(interval: Interval) -> list[float | None]:
    """An interval for JSON."""
    return [known(end) for end in interval]


def span(interval: Interval) -> str:
    """An interval in words."""
    shown = [number(end, digits=END_DIGITS) for end in interval]
    return UNKNOWN if UNKNOWN in shown else " … ".join(shown)


def share_span(interval: Interval) -> str:
    """An interval of shares in words."""
    if not np.isfinite(interval).all():
        return UNKNOWN
    return f"{' … '.join(number(100.0 * end, digits=END_DIGITS) for end in interval)} %"


def share_text(share: float) -> str:
    """A share in words, which may be above 1."""
    return number(100.0 * share, unit="%") if np.isfinite(share) else UNKNOWN


def figures(study: GaugeStudy) -> dict[str, Any]:
    """Components, table, number of categories and verdict."""
    return {
        "verdict": study.verdict,
        "judged_share": study.judged_share,
        "judged_by": "total" if study.tolerance is None else "tolerance",
        "tolerance": study.tolerance,
        "spread": study.spread,
        "operators": len(study.operators),
        "parts": len(study.parts),
        "trials": study.values.shape[2],
        "pooled": study.pooled,
        "categories": study.categories,
        "categories_interval": ends(study.categories_interval),
        "components": [
            {
                "component": one.name,
                "sigma": one.sigma,
                "interval": ends(one.interval),
                "total_share": one.total_share,
                "total_interval": ends(one.total_interval),
                "tolerance_share": known(one.tolerance_share),
                "tolerance_interval": ends(one.tolerance_interval),
            }
            for one in study.components
        ],
        "anova": [
            {
                "source": row.source,
                "sum_of_squares": row.squares,
                "degrees_of_freedom": row.freedom,
                "mean_square": row.mean_square,
                "F": known(row.ratio),
                "significance": known(row.significance),
            }
            for row in study.table
        ],
    }


def words(study: GaugeStudy, figures: dict[str, Any]) -> Iterator[Word]:
    """Sizes, components, categories, verdict."""
    yield _sizes(study)
    # Intervals of shares are left to reports and JSON: a terminal has 80 columns.
    kept = [k for k in range(len(COLUMNS)) if k not in SHARE_INTERVALS]
    yield Rows([COLUMNS[k] for k in kept], [[row[k] for k in kept] for row in _rows(study)])
    if len(study.operators) > 1:
        yield f"interaction: {_pooling(study)}"
    yield f"distinct categories ndc {figures['categories']} ({span(study.categories_interval)})"
    yield f"{figures['verdict']}: {_why(study)}"


def _sizes(study: GaugeStudy) -> str:
    o, p, r = study.values.shape
    by = f"{o} operators × " if o > 1 else ""
    return f"{by}{p} parts × {r} trials"


def _pooling(study: GaugeStudy) -> str:
    row = next(one for one in study.table if one.source == "interaction")
    done = "counts as repeatability" if study.pooled else "is kept"
    return f"significance {number(row.significance)}, it {done}"


def _why(study: GaugeStudy) -> str:
    """What the verdict follows from."""
    of = "total variation" if study.tolerance is None else "tolerance"
    gauge = study.component("gauge")
    wide = gauge.total_interval if study.tolerance is None else gauge.tolerance_interval
    return (
        f"the gauge takes {share_text(study.judged_share)} of the {of} (95 %: {share_span(wide)}); "
        f"accepted up to {percent(ACCEPTED)}, not above {percent(REFUSED)}"
    )


def _rows(study: GaugeStudy) -> list[list[str]]:
    """The table of components as it is shown."""
    return [
        [
            LABELS[one.name],
            number(one.sigma),
            span(one.interval),
            share_text(one.total_share),
            share_span(one.total_interval),
            share_text(one.tolerance_share),
            share_span(one.tolerance_interval),
        ]
        for one in study.components
    ]


def _anova(study: GaugeStudy) -> tuple[tuple[str, ...], ...]:
    return tuple(
        (
            row.source,
            number(row.squares),
            f"{row.freedom}",
            number(row.mean_square),
            number(row.ratio),
            number(row.significance),
        )
        for row in study.table
    )


def picture(study: GaugeStudy, name: str | None) -> Figure:
    """All charts of the study."""
    from fringeworks.report.gauge_charts import gauge_sheet  # which needs Matplotlib

    return gauge_sheet(titled(name, "Gauge study"), study)


def chapter(study: GaugeStudy, context: Context) -> Chapter:
    """Verdict, components, analysis of variance, charts."""
    from fringeworks.report.gauge_charts import charts_of  # which needs Matplotlib

    low, high = study.categories_interval
    rows = [
        ("study", _sizes(study)),
        ("verdict", f"{study.verdict}: {_why(study)}"),
        ("width of the tolerance", None if study.tolerance is None else limit(study.tolerance)),
        ("spread", f"{limit(study.spread)} σ"),
        ("distinct categories ndc", f"{study.categories} ({span((low, high))})"),
        ("interaction", _pooling(study) if len(study.operators) > 1 else None),
    ]
    return Chapter(
        context.name,
        (
            facts(rows),
            Table(COLUMNS, tuple(map(tuple, _rows(study))), "Components of variation"),
            Table(TABLE, _anova(study), "Analysis of variance"),
            Text(NOTE),
            *(Picture(figure, caption) for figure, caption in charts_of(study)),
        ),
    )


def verdict(study: GaugeStudy) -> Verdict:
    """The verdict on the gauge, which says nothing about the parts."""
    return gauge_verdict(study.verdict)


def gauge_verdict(kind: str) -> Verdict:
    """A verdict on a gauge in words."""
    said = {
        "pass": "the gauge is accepted",
        "fail": "the gauge is not accepted",
        "undecided": "the use of the gauge decides",
    }[kind]
    return Verdict(kind, f"{kind.upper()}: {said}.")


describe(GaugeStudy, Kind(figures, words, picture, chapter, verdict=verdict, head=DEVICE_HEAD))
