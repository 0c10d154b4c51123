"""The report of a batch: its parts, how well the process keeps each tolerance, control charts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fringeworks import _core
from fringeworks.batch.part_reports import Parts, write_part_reports
from fringeworks.batch.run import BatchResult
from fringeworks.evaluate.capability import CONFIDENCE, Interval, capability
from fringeworks.evaluate.inspect import recipe_hash
from fringeworks.evaluate.nelson import control_series
from fringeworks.files.atomic import StrPath
from fringeworks.report.control_chart import control_chart
from fringeworks.report.drawing import need_plots
from fringeworks.report.kinds.nelson import SIGNAL_COLUMNS, signal_rows
from fringeworks.report.page.blocks import Block, Chapter, Origin, Picture, Table, Text
from fringeworks.report.page.head import head_of
from fringeworks.report.page.parts import dict_table, facts
from fringeworks.report.page.report import check_report_target, write_page
from fringeworks.report.verdicts import COVERAGE, Verdict, allowed, overall
from fringeworks.types import FloatMap, PartTolerance, Rig, day, fingerprint, made_by
from fringeworks.types.numbers import SHARE, UNKNOWN, limit, number, percent
from fringeworks.types.recipe import SIGNED
from fringeworks.types.report_head import PART_HEAD

MOST_LISTED = 2000
"""Parts that the table of a page lists; the summary has all."""
MOST_VALUES = 8
"""Tolerances whose values stand in the table of parts; more have charts only."""
BATCH_HEAD = tuple(name for name in PART_HEAD if name != "serial")
"""Fields of the head; the table of parts has the serial numbers."""
NOT_MEASURED = "not measured"
"""Verdict of scans that could not be measured."""
INDEX_DIGITS = 2
"""Decimals of Cp and Cpk: their intervals are several hundredths wide below 10,000 parts."""
HOW_CAPABLE = (
    "Cp and Cpk follow from the differences of neighbouring parts, Pp and Ppk from the standard "
    f"deviation of all; in brackets, intervals of {percent(CONFIDENCE)} confidence. They hold for "
    "normal values of a process in control. The measurement's own scatter is part of the spread."
)
"""Note below the table of capabilities."""
HOW_CHARTED = (
    "Bars are U (k = 2). Control limits follow from the differences of neighbouring parts: values "
    "beyond them are no chance, whether or not they keep the tolerance. Digits at values are the "
    "numbers of Nelson's rules that they complete; by chance, one value in 44 completes one."
)
"""Note above the control charts."""


def write_batch_report(
    path: StrPath,
    result: BatchResult,
    *,
    title: str = "",
    parts: Parts = "all",
    head: Mapping[str, str] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Path:
    """Write the report of a batch.

    Parameters
    ----------
    path : path
        ``.html`` or ``.pdf``.
    result : BatchResult
    title : str
        By default the part's name, else that of the folder of captures, and how many there are.
    parts : "all", "failed" or "none"
        Parts that get a report of their own, of the same format, in the folder ``NAME-parts``
        beside it; ``failed`` are those that did not pass. A page links to them.
    head : mapping, optional
        Fields of the head, which add to those of the recipe; see ``write_report``. Those of the
        parts have the name of the part as its serial number.
    progress : callable
        Called with what is written.

    Returns
    -------
    The path.

    Raises
    ------
    FileProblem for another suffix, or a folder that cannot be written to.
    """
    need_plots("a report")
    check_report_target(path)
    verdict = _verdict(result)
    origin = made_by("write_batch_report", options={"results": str(result.folder)})
    ordered = replace(result, rows=tuple(sorted(result.rows, key=_moment)))
    fields = {**result.recipe.head, **(head or {})}
    top = head_of(fields, BATCH_HEAD, judged=verdict is not None)
    links = write_part_reports(Path(path), ordered, parts, progress, fields)
    chapters = [
        Chapter("Summary", (*_summary(ordered), *_capabilities(ordered))),
        Chapter("Parts", _parts(ordered, links)),
        Chapter(
            "Control charts",
            (
                Text(HOW_CHARTED),
                *_signals(ordered),
                *(_chart(ordered, one) for one in result.tolerances),
                _coverage(ordered),
                _origin(ordered),
            ),
        ),
    ]
    return write_page(
        path, title or _title(result, fields), chapters, origin, verdict=verdict, head=top
    )


def _moment(row: Mapping[str, Any]) -> tuple[str, str]:
    """Parts in the order of their frames, else of their names."""
    return str(row.get("taken", "")), str(row["scan"])


def _title(result: BatchResult, head: Mapping[str, str]) -> str:
    folder = Path(result.source).name or result.folder.stem
    name = head.get("part") or head.get("part_number") or f"Inspection of {folder}"
    count = len(result.rows)
    return f"{name}: {count} part{'' if count == 1 else 's'}"


def _verdict(result: BatchResult) -> Verdict | None:
    """The verdict of all parts."""
    verdicts = _verdicts(result)
    kind = "fail" if result.failed else overall(verdicts)
    if not kind:
        return None
    names = {"fail": "failed", "undecided": "undecided", NOT_MEASURED: NOT_MEASURED}
    counts = [f"{verdicts.count(v)} {name}" for v, name in names.items() if verdicts.count(v)]
    said = f"{verdicts.count('pass')} of {len(verdicts)} parts pass"
    return Verdict(kind, f"{kind.upper()}: {', '.join([said, *counts])}.")


def _verdicts(result: BatchResult) -> list[str]:
    return [str(row.get("verdict") or NOT_MEASURED) for row in result.rows]


def _summary(result: BatchResult) -> tuple[Block, ...]:
    """How many parts there are, when they were taken, and by what they were judged."""
    dates = [row["taken"] for row in result.rows if row.get("taken")]
    verdicts = _verdicts(result)
    rig = result.recipe.rig
    rows = [
        ("parts", f"{len(result.rows):,}"),
        *((v, f"{verdicts.count(v):,}") for v in ("pass", "fail", "undecided", NOT_MEASURED)),
        ("frames written", f"{day(min(dates))} … {day(max(dates))}" if dates else None),
        ("risk of a wrong decision", percent(result.recipe.risk)),
        ("recipe", f"sha256 {recipe_hash(result.recipe)}"),
        ("rig", f"sha256 {fingerprint(rig)}" if isinstance(rig, Rig) else None),
    ]
    return (facts(rows),)


def _origin(result: BatchResult) -> Origin:
    """What is needed to compute the batch again."""
    origin = [
        ("captures", result.source or None),
        ("results", str(result.folder)),
        ("version", f"fringeworks {_core.version}"),
        ("call", f"fringeworks.batch.run_batch({result.source!r}, recipe, out)"),
    ]
    return Origin(facts(origin).rows)


def _capabilities(result: BatchResult) -> tuple[Block, ...]:
    """A row for each tolerance: limits, mean, spread, and indices with their intervals."""
    rows, indices = [], []
    for one in result.tolerances:
        found = capability(_column(result, one.name), one.low, one.high)
        unit = one.unit()
        wide = _column(result, f"{one.name} σ")
        usual = COVERAGE * float(np.median(wide[np.isfinite(wide)])) if found.count else None
        nominal, low, high = (limit(v, unit) for v in (one.target, one.low, one.high))
        rows.append(
            {
                "tolerance": one.name,
                "nominal": nominal,
                "min": low,
                "max": high,
                "mean": number(found.mean, found.overall, unit),
                "s": number(found.overall, found.overall, unit),
                "U (k = 2)": UNKNOWN if unit == SHARE else number(usual, usual, unit),
            }
        )
        indices.append(
            {
                "tolerance": one.name,
                "Cp": _index(found.cp, found.cp_interval),
                "Cpk": _index(found.cpk, found.cpk_interval),
                "Pp": _index(found.pp, found.pp_interval),
                "Ppk": _index(found.ppk, found.ppk_interval),
            }
        )
    if not rows:
        return (Text("Nothing is judged: the recipe has no tolerances."),)
    caption = "Capability"
    return dict_table(rows, "Values"), dict_table(indices, caption), Text(HOW_CAPABLE)


def _index(value: float, interval: Interval) -> str:
    """An index with its interval."""
    if not np.isfinite(value):
        return UNKNOWN
    shown = [number(v, 10.0 ** (1 - INDEX_DIGITS)) for v in (value, *interval)]
    return f"{shown[0]} [{shown[1]}, {shown[2]}]"


def _parts(result: BatchResult, links: Mapping[str, str]) -> tuple[Block, ...]:
    """The table of parts, which a page can search."""
    listed = result.rows[:MOST_LISTED]
    valued = result.tolerances[:MOST_VALUES]
    columns = ("part", "frames written / UTC", "verdict", *map(value_heading, valued), "why")
    verdicts = _verdicts(result)
    values = shown_values(result, valued, len(listed))
    rows = [_row(result, row, shown) for row, shown in zip(listed, values, strict=True)]
    shown = len(columns) if any(row[-1] for row in rows) else len(columns) - 1
    table = Table(
        columns[:shown],
        tuple(row[:shown] for row in rows),
        "All parts, in the order in which their frames were written",
        bad=tuple(k for k, v in enumerate(verdicts[:MOST_LISTED]) if v in ("fail", NOT_MEASURED)),
        doubtful=tuple(k for k, v in enumerate(verdicts[:MOST_LISTED]) if v == "undecided"),
        links=tuple(links.get(str(row["scan"]), "") for row in listed),
        search=True,
    )
    more = len(result.rows) - len(listed)
    return (table, *([Text(f"… and {more} more: see {result.summary.name}.")] if more else []))


def value_heading(one: PartTolerance) -> str:
    """The heading of the values of a tolerance."""
    unit = one.unit()
    return one.name if unit == SHARE else f"{one.name} / {unit}"


def shown_values(
    result: BatchResult, tolerances: tuple[PartTolerance, ...], count: int
) -> list[tuple[str, ...]]:
    """Return the values of the first parts as they are read, below ``value_heading``.

    All values of a tolerance have as many decimals as their median standard deviation supports.
    """
    columns = []
    for one in tolerances:
        sigma = _column(result, f"{one.name} σ")
        known = sigma[np.isfinite(sigma) & (sigma > 0)]
        usual = float(np.median(known)) if known.size else None
        unit = SHARE if one.unit() == SHARE else ""
        columns.append([number(v, usual, unit) for v in _column(result, one.name)[:count]])
    return [tuple(column[k] for column in columns) for k in range(count)]


def _row(result: BatchResult, row: Mapping[str, Any], values: Sequence[str]) -> tuple[str, ...]:
    """A part: its values, and why it does not pass."""
    whys = [_why(one, row) for one in result.tolerances if row.get(f"{one.name} why")]
    return (
        str(row["scan"]),
        day(row["taken"]).removesuffix(" UTC") if row.get("taken") else UNKNOWN,
        str(row.get("verdict") or NOT_MEASURED),
        *values,
        str(row.get("error") or "; ".join(whys)),
    )


def _why(one: PartTolerance, row: Mapping[str, Any]) -> str:
    """Why a part does not pass, in a line; its own report has more of what is undecided."""
    value, sigma = row.get(one.name), row.get(f"{one.name} σ")
    if row.get(f"{one.name} verdict") == "undecided" and value is not None:
        return f"{one.name}: undecided at {number(value, sigma, one.unit())} ({allowed(one)})"
    return f"{one.name}: {row[f'{one.name} why']}"


def batch_charts(result: BatchResult) -> list[Picture]:
    """Return the control chart of each tolerance, parts in the order of their frames."""
    ordered = replace(result, rows=tuple(sorted(result.rows, key=_moment)))
    return [_chart(ordered, one) for one in result.tolerances]


def _chart(result: BatchResult, one: PartTolerance) -> Picture:
    """The control chart of a tolerance; shares as percent."""
    scale, unit = (100.0, "%") if one.unit() == SHARE else (1.0, one.unit())
    low, high = (None if v is None else scale * v for v in (one.low, one.high))
    figure = control_chart(
        f"{one.name}: {one.quantity.replace('_', ' ')} of {' and '.join(one.areas)}",
        scale * _column(result, one.name),
        scale * np.nan_to_num(_column(result, f"{one.name} σ")),
        [str(row.get(f"{one.name} verdict", "")) for row in result.rows],
        (low, high),
        unit=unit,
        names=[str(row["scan"]) for row in result.rows],
        order=_order(result),
        least=-np.inf if one.quantity in SIGNED else 0.0,
    )
    return Picture(figure, f"{one.name}; allowed {allowed(one)}.")


def _order(result: BatchResult) -> str:
    """Label of the axis of parts."""
    dates = [row["taken"] for row in result.rows if row.get("taken")]
    return f"parts, {day(min(dates))} … {day(max(dates))}" if dates else "parts"


def _signals(result: BatchResult) -> tuple[Block, ...]:
    """Patterns of Nelson's rules in the values of all tolerances."""
    names = [str(row["scan"]) for row in result.rows]
    rows = [
        (one.name, *row)
        for one in result.tolerances
        for row in signal_rows(control_series(_column(result, one.name)), names)
    ]
    if not rows:
        return (Text("No pattern of Nelson's rules in any of them."),)
    more = len(rows) - MOST_LISTED
    table = Table(("tolerance", *SIGNAL_COLUMNS), tuple(rows[:MOST_LISTED]), "Patterns (Nelson)")
    return (table, Text(f"… and {more} more patterns.")) if more > 0 else (table,)


def _coverage(result: BatchResult) -> Picture:
    """How much of each frame was measured."""
    shares = 100.0 * _column(result, "valid_share")
    figure = control_chart(
        "measured pixels of the frame",
        shares,
        np.zeros_like(shares),
        _verdicts(result),
        (None, None),
        unit="%",
        names=[str(row["scan"]) for row in result.rows],
        order=_order(result),
        least=0.0,
    )
    return Picture(figure, "Share of the camera's pixels that have a value, background included.")


def _column(result: BatchResult, name: str) -> FloatMap:
    def number_of(value: Any) -> float:
        return np.nan if value is None or value == "" else float(value)

    return np.array([number_of(row.get(name)) for row in result.rows])
