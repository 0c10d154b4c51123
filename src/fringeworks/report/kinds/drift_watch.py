"""What is shown of a watched rig."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from fringeworks.files.findings import findings_as_dicts
from fringeworks.report.kind import Kind, Rows, Word, describe
from fringeworks.report.sheets import titled
from fringeworks.report.summary import origin
from fringeworks.rig.drift_watch import RigWatch, WatchedScan
from fringeworks.rig.scan_evidence import MODES
from fringeworks.types.numbers import number

if TYPE_CHECKING:
    from fringeworks.report.drawing import Figure

SHOWN = 10
"""Last scans that a command lists; the figures have all."""
COLUMNS = ("scan", "verdict", "over the limit", "this scan alone")
"""Columns of the table of scans."""


def figures(watch: RigWatch) -> dict[str, Any]:
    """The verdicts, the watched modes and what is noticeable; NaN and ∞ are None."""
    return {
        "verdict": watch.verdict,
        "baseline": watch.baseline,
        "false_alarms_per_1000": watch.false_alarms,
        "mode_parts": list(MODES),
        "modes": watch.modes.T.tolist(),
        "noticeable": {name: _known(size) for name, size in watch.noticeable.items()},
        "scans": [_scan(one) for one in watch.scans],
        "findings": findings_as_dicts(watch.findings),
        **origin(watch.provenance),
    }


def _known(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _scan(one: WatchedScan) -> dict[str, Any]:
    return {
        "name": one.name,
        "date": one.date,
        "verdict": one.verdict,
        "excess": _known(one.excess),
        "own_excess": _known(one.own_excess),
        "since": one.since,
        "modes": one.modes.tolist(),
        "covariance": one.covariance.tolist(),
    }


def words(watch: RigWatch, _: dict[str, Any]) -> Iterator[Word]:
    """The last scans, and what was found."""
    rows = [
        (one.name, one.verdict, number(one.excess), number(one.own_excess))
        for one in watch.scans[-SHOWN:]
    ]
    if rows:
        yield Rows(COLUMNS, rows)
    yield from watch.findings


def picture(watch: RigWatch, name: str | None) -> Figure:
    """How far each scan is over the limit."""
    from fringeworks.report.watch_chart import watch_chart  # which needs Matplotlib

    return watch_chart(titled(name, "Watched rig"), watch)


describe(RigWatch, Kind(figures, words, picture))
