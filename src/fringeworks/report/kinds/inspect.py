"""What is shown of an inspection."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from fringeworks.evaluate.inspect import Check, Inspection
from fringeworks.report.kind import Kind, Rows, Word, describe
from fringeworks.report.summary import summarise, told
from fringeworks.types.numbers import limit, number, sigma_text

COLUMNS = ("tolerance", "value", "± σ", "limits", "verdict")
"""Columns of the table of checks."""


def figures(inspection: Inspection) -> dict[str, Any]:
    """The figures of the surface, the checks and the verdict."""
    checks = [
        {
            "name": check.tolerance.name,
            "quantity": check.tolerance.quantity,
            "areas": list(check.tolerance.areas),
            "value": check.value if np.isfinite(check.value) else None,
            "sigma": check.sigma if np.isfinite(check.sigma) else None,
            "unit": check.unit,
            "smallest": check.tolerance.low,
            "largest": check.tolerance.high,
            "verdict": check.verdict,
            "why": check.why,
        }
        for check in inspection.checks
    ]
    return summarise(inspection.surface) | {
        "verdict": inspection.verdict,
        "checks": checks,
        **told(inspection),
    }


def words(inspection: Inspection, _: dict[str, Any]) -> Iterator[Word]:
    """The checks as a table, and the verdict."""
    yield Rows(COLUMNS, [_row(check) for check in inspection.checks], ruled=True)
    yield from inspection.findings
    judged = bool(inspection.checks)
    yield inspection.verdict if judged else "nothing is judged: the recipe has no tolerances"


def _row(check: Check) -> list[str]:
    one = check.tolerance
    low, high = ("" if v is None else limit(v) for v in (one.low, one.high))
    return [
        one.name,
        number(check.value, check.sigma, check.unit),
        sigma_text(check.sigma),
        f"{low} … {high}",
        f"{check.verdict}: {check.why}" if check.why else check.verdict,
    ]


describe(Inspection, Kind(figures, words))
