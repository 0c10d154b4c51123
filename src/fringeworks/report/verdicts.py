"""How verdicts look, in tables, charts and pictures alike."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from fringeworks.types import PartTolerance
from fringeworks.types.numbers import SHARE, limit

VERDICT_COLOURS = {"pass": "#0072b2", "fail": "#d55e00", "undecided": "#e69f00"}
"""Colours of the verdicts, told apart by eyes that confuse red and green."""
VERDICT_INK = {"pass": "#1b7a35", "fail": "#b3261e", "undecided": "#8a5a00"}
"""Colours of verdicts as text on white: green, red and brown with a contrast of 4.5 or more; the
word always stands beside the colour."""
VERDICT_MARKS = {"pass": "o", "fail": "X", "undecided": "D"}
"""Marks of the verdicts."""
COVERAGE = 2.0
"""Factor k of the expanded uncertainty U = k σ: a value is within U with about 95 % (GUM)."""


def allowed(one: PartTolerance, measured: str = "") -> str:
    """The limits of a tolerance in words, with the unit of its value where that is known."""
    unit = one.unit(measured)
    if one.low is None or one.high is None:
        return f"≥ {limit(one.low, unit)}" if one.high is None else f"≤ {limit(one.high, unit)}"
    return f"{limit(one.low)} … {limit(one.high, unit)}" if unit != SHARE else _shares(one)


def _shares(one: PartTolerance) -> str:
    """Both limits of a share."""
    return f"{limit(one.low, SHARE).removesuffix(' %')} … {limit(one.high, SHARE)}"


@dataclass(frozen=True)
class Verdict:
    """What stands on top of a report."""

    kind: str
    """pass, fail or undecided."""
    text: str
    """The verdict in words."""


def verdict_of(verdicts: Sequence[str]) -> Verdict | None:
    """The verdict of a report from those of its tolerances; None where there are none.

    Examples
    --------
    >>> verdict_of(["pass", "fail", "undecided"]).text
    'FAIL: 1 of 3 tolerances is not kept, 1 is undecided.'
    """
    kind, count = overall(verdicts), len(verdicts)
    if not kind:
        return None
    if count == 1:
        said_of = {"pass": "kept", "fail": "not kept", "undecided": "undecided"}
        return Verdict(kind, f"{kind.upper()}: the tolerance is {said_of[kind]}.")
    broken, open_ = verdicts.count("fail"), verdicts.count("undecided")
    said = []
    if broken:
        said.append(f"{broken} of {count} tolerances {'is' if broken == 1 else 'are'} not kept")
    if open_:
        of = "" if broken else f" of {count} tolerances"
        said.append(f"{open_}{of} {'is' if open_ == 1 else 'are'} undecided")
    if not said:
        said.append(f"all {count} tolerances are kept")
    return Verdict(kind, f"{kind.upper()}: {', '.join(said)}.")


def overall(verdicts: Iterable[str]) -> str:
    """The verdict of all: fail where one fails, undecided where none fails and one is; "" of none.

    Examples
    --------
    >>> overall(["pass", "undecided"]), overall([])
    ('undecided', '')
    """
    known = set(verdicts)
    return next((v for v in ("fail", "undecided", "pass") if v in known), "")
