"""How verdicts look, in tables, charts and pictures alike."""

from __future__ import annotations

from collections.abc import Iterable

VERDICT_COLOURS = {"pass": "#0072b2", "fail": "#d55e00", "undecided": "#e69f00"}
"""Colours of the verdicts, told apart by eyes that confuse red and green."""
VERDICT_MARKS = {"pass": "o", "fail": "X", "undecided": "D"}
"""Marks of the verdicts."""
COVERAGE = 2.0
"""Factor k of the expanded uncertainty U = k σ: a value is within U with about 95 % (GUM)."""


def overall(verdicts: Iterable[str]) -> str:
    """The verdict of all: fail where one fails, undecided where none fails and one is; "" of none.

    Examples
    --------
    >>> overall(["pass", "undecided"]), overall([])
    ('undecided', '')
    """
    known = set(verdicts)
    return next((v for v in ("fail", "undecided", "pass") if v in known), "")
