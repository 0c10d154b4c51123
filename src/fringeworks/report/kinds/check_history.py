"""What is shown of the history of a rig's checks: control charts and what Nelson's rules find."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from fringeworks.evaluate.nelson import ControlSeries, control_series
from fringeworks.files.check_history import CHARTED, CheckHistory
from fringeworks.report.kind import Kind, Rows, Word, describe
from fringeworks.report.kinds.nelson import SIGNAL_COLUMNS, signal_figures, signal_rows
from fringeworks.report.page.blocks import Block, Chapter, Picture, Table, Text
from fringeworks.report.page.chapter import Context
from fringeworks.types.numbers import estimate

if TYPE_CHECKING:
    from fringeworks.report.drawing import Figure

AS_PART = {"holds": "pass", "has moved": "fail", "cannot tell": "undecided"}
"""Verdicts of checks in the colours of those of parts."""
DAY_LETTERS = 10
"""Letters of the day in a date of ISO 8601."""
COLUMNS = ("figure", "checks", "mean ± s", "last")
"""Columns of the table of figures."""
HOW = (
    "Each check of the rig is a value. Mean and control limits follow from the differences of "
    "neighbours, and digits at values are the numbers of Nelson's rules that they complete. By "
    "chance, one value in 44 of a rig that holds completes one."
)
"""Note above the charts."""


def charted(history: CheckHistory) -> dict[str, ControlSeries]:
    """Return the figures of a history with their signals."""
    return {name: control_series(history.figures[name]) for name in CHARTED}


def figures(history: CheckHistory) -> dict[str, Any]:
    """The checks, and what the rules find in each figure."""
    return {
        "checks": len(history.dates),
        "verdicts": list(history.verdicts),
        "dates": list(history.dates),
        "figures": {
            name: {
                "values": one.values.tolist(),
                "mean": one.mean if np.isfinite(one.mean) else None,
                "sigma": one.sigma if np.isfinite(one.sigma) else None,
                "signals": signal_figures(one),
            }
            for name, one in charted(history).items()
        },
    }


def _rows(history: CheckHistory) -> list[tuple[str, ...]]:
    return [
        (
            name,
            str(len(history.dates)),
            estimate(one.mean, one.sigma, CHARTED[name]),
            estimate(float(one.values[-1]), None, CHARTED[name]),
        )
        for name, one in charted(history).items()
    ]


def _signals(history: CheckHistory) -> list[tuple[str, ...]]:
    names = [date[:DAY_LETTERS] for date in history.dates]
    return [
        (name, *row) for name, one in charted(history).items() for row in signal_rows(one, names)
    ]


def words(history: CheckHistory, _: dict[str, Any]) -> Iterator[Word]:
    """The figures, and the patterns in them."""
    yield Rows(COLUMNS, _rows(history))
    found = _signals(history)
    if found:
        yield Rows(("figure", *SIGNAL_COLUMNS), found)
    else:
        yield "no pattern of Nelson's rules in any figure"


def _chart(history: CheckHistory, name: str) -> Figure:
    from fringeworks.report.control_chart import control_chart  # which needs Matplotlib

    values = history.figures[name]
    spread = history.figures["sigma_mm" if name == "drift_mm" else "scale_sigma"]
    known = name in ("drift_mm", "scale")
    return control_chart(
        name.replace("_", " "),
        values,
        spread if known else np.zeros_like(values),
        [AS_PART[one] for one in history.verdicts],
        (None, None),
        unit=CHARTED[name],
        names=[date[:DAY_LETTERS] for date in history.dates],
        order="check",
        meanings={"pass": "holds", "fail": "has moved", "undecided": "cannot tell"},
    )


def chapter(history: CheckHistory, context: Context) -> Chapter:
    """Charts of all figures, and the patterns in them."""
    found = _signals(history)
    blocks: list[Block] = [Text(HOW), Table(COLUMNS, tuple(_rows(history)), "Checks")]
    if found:
        blocks.append(Table(("figure", *SIGNAL_COLUMNS), tuple(found), "Patterns (Nelson)"))
    else:
        blocks.append(Text("No pattern of Nelson's rules in any figure."))
    blocks += [Picture(_chart(history, name), f"{name} of each check.") for name in CHARTED]
    return Chapter(context.name, tuple(blocks))


describe(CheckHistory, Kind(figures, words, chapter=chapter))
