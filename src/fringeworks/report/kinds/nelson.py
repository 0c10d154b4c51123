"""What is shown of a series on a control chart."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from fringeworks.evaluate.nelson import MEANINGS, RULES, ControlSeries
from fringeworks.report.kind import Kind, Rows, Word, describe
from fringeworks.types.numbers import estimate

SIGNAL_COLUMNS = ("rule", "at", "pattern", "usual cause")
"""Columns of the table of patterns."""


def signal_figures(found: ControlSeries) -> list[dict[str, Any]]:
    """Return the patterns of a series for JSON."""
    return [
        {"rule": one.rule, "first": one.first, "last": one.last, "pattern": RULES[one.rule]}
        for one in found.signals
    ]


def signal_rows(found: ControlSeries, names: Sequence[str] = ()) -> list[tuple[str, ...]]:
    """Return a row for each pattern; ``names`` are those of the values, numbers without them.

    A run that grows completes its pattern again with each value: it is one row, from its first to
    its last value.
    """
    runs: list[list[int]] = []
    for one in sorted(found.signals, key=lambda one: (one.rule, one.last)):
        if runs and runs[-1][0] == one.rule and one.first <= runs[-1][2]:
            runs[-1][2] = one.last
        else:
            runs.append([one.rule, one.first, one.last])
    rows: list[tuple[str, ...]] = []
    for rule, first, last in sorted(runs, key=lambda run: run[2]):
        ends = [names[k] if names else str(k + 1) for k in (first, last)]
        place = ends[0] if first == last else f"{ends[0]} … {ends[1]}"
        rows.append((str(rule), place, RULES[rule], MEANINGS[rule]))
    return rows


def figures(found: ControlSeries) -> dict[str, Any]:
    """Mean, σ and patterns."""
    low, high = found.limits
    return {
        "values": int(found.values.size),
        "mean": found.mean,
        "sigma": found.sigma,
        "limits": [low, high],
        "signals": signal_figures(found),
    }


def words(found: ControlSeries, _: dict[str, Any]) -> Iterator[Word]:
    """Mean and patterns."""
    yield f"{found.values.size} values: {estimate(found.mean, found.sigma)}"
    rows = signal_rows(found)
    yield Rows(SIGNAL_COLUMNS, rows) if rows else "no pattern of Nelson's rules"


describe(ControlSeries, Kind(figures, words))
