"""The table of a comparison as a terminal of 80 columns shows it; files have all columns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

ABOUT = ("object", "gamma", "noise", "bits", "fringes", "capture", "unit")
"""Columns that say what was measured. Those with one value in all rows stand above the table."""
HEADS = {
    "object": "object",
    "capture": "capture",
    "method": "method",
    "gamma": "γ",
    "noise": "noise",
    "bits": "bits",
    "fringes": "fringes",
    "unit": "unit",
    "measured_fraction": "measured",
    "failed_fraction": "no value",
    "median_sigma": "median σ",
    "median_abs_difference": "|difference|",
    "agree_within_1_sigma": "agrees, 1 σ",
    "agree_within_2_sigma": "agrees, 2 σ",
    "mean_abs_error_mm": "|error| / mm",
    "std_error_mm": "s.d. / mm",
    "max_abs_error_mm": "max / mm",
    "within_1_sigma": "in 1 σ",
    "within_2_sigma": "in 2 σ",
    "seconds": "seconds",
}
"""Columns that are shown, with their heads; ``|difference|`` is a median, ``|error|`` a mean."""
SHARES = frozenset(
    {
        "measured_fraction",
        "failed_fraction",
        "agree_within_1_sigma",
        "agree_within_2_sigma",
        "within_1_sigma",
        "within_2_sigma",
    }
)
"""Columns that are shown as percent."""
OF_SCENES = frozenset({"failed_fraction", "std_error_mm", "max_abs_error_mm"})
"""Columns that are left out for pairs of one's own, so that the table fits on a terminal."""
SAID = {"gamma": "γ {}", "noise": "noise of {} counts", "fringes": "{} fringes", "unit": "in {}"}
"""How a value that all rows have in common is said."""


def common_words(rows: Sequence[dict[str, Any]]) -> str:
    """What all rows have in common, as a line."""
    said = []
    for name in _common(rows):
        value = rows[0][name]
        if name == "bits":
            said.append(f"{value} bit" if value else "not quantised")
        else:
            text = f"{value:g}" if isinstance(value, int | float) else str(value)
            said.append(SAID.get(name, "{}").format(text))
    return ", ".join(said)


def shown_rows(rows: Sequence[dict[str, Any]]) -> list[dict[str, str]]:
    """The rows as they are shown: few columns, shares as percent."""
    from fringeworks.types.numbers import number, percent

    left_out = set(_common(rows))
    if rows and "measured_fraction" in rows[0]:
        left_out |= OF_SCENES

    def cell(name: str, value: Any) -> str:
        if name in SHARES:
            return percent(value)
        if name in ABOUT and not isinstance(value, str):
            return f"{value:g}"
        return number(value) if isinstance(value, float) else str(value)

    names = [name for name in HEADS if rows and name in rows[0] and name not in left_out]
    return [{HEADS[name]: cell(name, row[name]) for name in names} for row in rows]


def _common(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Columns about what was measured that have one value in all rows."""
    return [
        name
        for name in ABOUT
        if rows and name in rows[0] and len({str(row[name]) for row in rows}) == 1
    ]
