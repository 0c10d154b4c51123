"""Parts that the chapters of several kinds of results share."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePath
from typing import Any

from fringeworks.report.page.blocks import Block, Facts, Findings, Origin, Table, Text
from fringeworks.report.page.tolerances import Judged
from fringeworks.report.reason_words import REASON_WORDS
from fringeworks.types import ByteMap, Provenance, Reason, reason_counts
from fringeworks.types.numbers import limit, number, percent, sigma_text

MOST_FINDINGS = 200
"""Findings that a page lists; nobody reads more, and the number of the others is said."""
MOST_ROWS = 500
"""Rows of a table that a page shows; more belong into a file."""
MOST_NAMED = 3
"""Inputs that a call names one by one; the frames of a stack are named by their folder."""
MOST_LETTERS = 4000
"""Letters of one value: a page of text. A list of a million numbers would fill a thousand pages of
a PDF."""
MOST_VALUES = 100
"""Values of a list that a page shows; their number is said."""


def shown(value: Any) -> str:
    """Return a figure as a table shows it."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return number(value)
    if isinstance(value, list | tuple):
        several = ", ".join(shown(item) for item in value[:MOST_VALUES])
        return several if len(value) <= MOST_VALUES else f"{several}, … ({len(value):,} values)"
    text = str(value)
    if len(text) <= MOST_LETTERS:
        return text
    return f"{text[:MOST_LETTERS]} … ({len(text):,} letters)"


def listed(value: Any) -> list[Any]:
    """Return what a file holds where a list is expected: a list, one value, or nothing."""
    if value is None:
        return []
    return list(value) if isinstance(value, list | tuple) else [value]


def with_unit(value: float | None, unit: str, sigma: float | None = None) -> str | None:
    """Return a figure with its unit, in the digits of its σ; None where it is unknown."""
    return None if value is None else number(value, sigma, unit)


def sigma_with_unit(sigma: float | None, unit: str) -> str | None:
    """Return a standard deviation with its unit; None where it is unknown."""
    return None if sigma is None else sigma_text(sigma, unit)


def facts(rows: Iterable[tuple[str, Any]]) -> Facts:
    """Names and values, those that are unknown left out."""
    return Facts(tuple((name, shown(value)) for name, value in rows if value is not None))


def reasons_table(reason: ByteMap) -> Table:
    """How many pixels have no value, why, and what to change; only reasons that occur."""
    counts = reason_counts(reason)
    rows = []
    for kind in Reason:
        count = int(counts[kind])
        if count:
            words = REASON_WORDS[kind]
            share = percent(count / reason.size)
            rows.append((words.label, f"{count:,}", share, words.meaning, words.advice))
    columns = ("pixels are", "number", "share", "meaning", "what to change")
    return Table(columns, tuple(rows), "Measured pixels, and reasons for those that are not")


def findings_block(found: Sequence[Mapping[str, Any]]) -> tuple[Block, ...]:
    """Findings as ``summarise`` gives them; nothing where there are none."""
    rows = [
        (
            str(f.get("severity", "note")),
            str(f.get("kind", "finding")),
            str(f.get("seen", "")),
            ", or ".join(map(str, listed(f.get("causes")))),
            str(f.get("advice", "")),
        )
        for f in found
    ]
    if not rows:
        return ()
    return (Findings(tuple(rows[:MOST_FINDINGS]), max(0, len(rows) - MOST_FINDINGS)),)


def tolerance_block(judged: Sequence[Judged]) -> tuple[Block, ...]:
    """Tolerances with pass or fail."""
    if not judged:
        return ()
    rows = tuple(
        (
            one.tolerance.name,
            shown(one.value),
            f"{one.tolerance.sign} {limit(one.tolerance.limit)}",
            "pass" if one.kept else "FAIL",
        )
        for one in judged
    )
    bad = tuple(k for k, one in enumerate(judged) if not one.kept)
    return (Table(("figure", "value", "tolerance", "verdict"), rows, "Tolerances", bad),)


def provenance_block(provenance: Provenance | None) -> tuple[Block, ...]:
    """What is needed to compute a result again."""
    if provenance is None:
        return (Origin((("made by", "unknown: the result carries no provenance"),)),)
    rows: list[tuple[str, Any]] = [
        ("made by", f"fringeworks {provenance.version}, {provenance.date}".removesuffix(", ")),
        ("call", call_text(provenance)),
        *((f"input {source.name}", f"sha256 {source.sha256}") for source in provenance.inputs),
        ("plan", _hash(provenance.plan_sha256)),
        ("rig", _hash(provenance.rig_sha256)),
    ]
    return (Origin(facts(rows).rows),)


def call_text(provenance: Provenance) -> str:
    """The call of the library that made a result, as Python."""
    names = [source.name for source in provenance.inputs]
    folders = {PurePath(name).parent for name in names}
    if len(names) > MOST_NAMED and len(folders) == 1:
        names = [f"{folders.pop()}/"]
    inputs = [json.dumps(name, ensure_ascii=False) for name in names]
    options = [f"{name}={value!r}" for name, value in provenance.options.items()]
    return f"fringeworks.{provenance.call}({', '.join([*inputs, *options])})"


def _hash(digest: str | None) -> str | None:
    return None if digest is None else f"sha256 {digest}"


def dict_table(rows: Sequence[Mapping[str, Any]], caption: str) -> Table:
    """Rows with equal keys as a table."""
    columns = tuple(rows[0]) if rows else ()
    cells = tuple(tuple(shown(row.get(name)) for name in columns) for row in rows)
    return Table(tuple(name.replace("_", " ") for name in columns), cells, caption)


def figure_tables(content: Mapping[str, Any]) -> tuple[Block, ...]:
    """The tables among figures: lists of rows."""
    found: list[Block] = []
    for name, value in content.items():
        rows = isinstance(value, list) and value and all(isinstance(v, Mapping) for v in value)
        rows = rows and value[0]
        if rows and name != "findings":
            found += limited_table(value, name.replace("_", " "))
    return tuple(found)


def limited_table(rows: Sequence[Mapping[str, Any]], caption: str) -> tuple[Block, ...]:
    """A table of the first rows, and how many more there are."""
    table = dict_table(rows[:MOST_ROWS], caption)
    if len(rows) <= MOST_ROWS:
        return (table,)
    return (table, Text(f"{len(rows) - MOST_ROWS} more rows are not shown."))


def scalar_facts(content: Mapping[str, Any]) -> Facts:
    """Single values of nested figures; a list of numbers counts as one value."""
    rows = _scalars(content)
    more = (
        [("not shown", f"{len(rows) - MOST_ROWS:,} more values")] if len(rows) > MOST_ROWS else []
    )
    return facts([*rows[:MOST_ROWS], *more])


def _scalars(content: Mapping[str, Any], name: str = "") -> list[tuple[str, Any]]:
    """Single values of nested figures; lists of numbers count as one value."""
    found: list[tuple[str, Any]] = []
    for key, value in content.items():
        full = f"{name}, {key}" if name else str(key)
        label = full.replace("_", " ")
        if key in ("provenance", "notes", "findings"):
            continue
        nested = isinstance(value, list) and any(isinstance(v, Mapping | list) for v in value)
        if isinstance(value, Mapping):
            found += _scalars(value, full)
        elif not nested:
            found.append((label, value))
    return found
