"""Tolerances: limits on the figures of a result, judged and listed."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from fringeworks.types import Frozen, InputError

COMPARED: dict[str, Callable[[float, float], bool]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
}
"""Signs of a tolerance."""
WRITTEN = re.compile(r"\s*([\w.]+)\s*(<=|>=|<|>)\s*(\S+)\s*")
"""How a tolerance is written: name, sign, limit."""
NAMES_SHOWN = 30
"""Names of figures that a message lists; more fill a screen."""


@dataclass(frozen=True, eq=False, repr=False)
class Tolerance(Frozen):
    """A limit on a figure of a result."""

    name: str
    """Name of the figure in ``summarise``, with dots for what lies inside, such as
    ``bodies.0.form_mm``."""
    sign: str
    """``<=``, ``>=``, ``<`` or ``>``."""
    limit: float
    """In the figure's unit."""

    def __str__(self) -> str:
        return f"{self.name} {self.sign} {self.limit:g}"


@dataclass(frozen=True, eq=False, repr=False)
class Judged(Frozen):
    """A tolerance and the figure that it was applied to."""

    tolerance: Tolerance
    value: float
    """NaN where the figure has no value; it then fails."""

    @property
    def kept(self) -> bool:
        """Whether the figure keeps the tolerance."""
        return COMPARED[self.tolerance.sign](self.value, self.tolerance.limit)


def parse_tolerance(text: str) -> Tolerance:
    """Read a tolerance.

    Parameters
    ----------
    text : str
        Such as ``median_sigma_mm <= 0.05`` or ``failed_fraction<0.1``.

    Raises
    ------
    InputError for anything else.

    Examples
    --------
    >>> str(parse_tolerance("median_sigma_mm<=0.05"))
    'median_sigma_mm <= 0.05'
    """
    parts = WRITTEN.fullmatch(text)
    try:
        if parts is None:
            raise ValueError
        limit = float(parts[3])
        if not math.isfinite(limit):
            raise ValueError
    except ValueError as error:
        raise InputError(
            f"tolerance: expected a name, one of {' '.join(COMPARED)}, and a number, such as "
            f"median_sigma_mm<=0.05; got {text!r}"
        ) from error
    return Tolerance(parts[1], parts[2], limit)


def judge(figures: Mapping[str, Any], tolerances: Iterable[Tolerance]) -> tuple[Judged, ...]:
    """Apply tolerances to the figures of a result.

    Parameters
    ----------
    figures : mapping
        From ``summarise``.
    tolerances : iterable of Tolerance

    Raises
    ------
    InputError for a name that the figures do not have, listing those they have.
    """
    known = dict(numbers(figures))
    judged = []
    for tolerance in tolerances:
        if tolerance.name not in known:
            names = ", ".join(list(known)[:NAMES_SHOWN])
            raise InputError(f"tolerance: expected one of {names}; got {tolerance.name}")
        value = known[tolerance.name]
        judged.append(Judged(tolerance, math.nan if value is None else value))
    return tuple(judged)


def numbers(content: Any, name: str = "") -> Iterable[tuple[str, float | None]]:
    """Yield all numbers of nested figures with their dotted names; None is no value."""
    if isinstance(content, Mapping):
        inside: Iterable[tuple[Any, Any]] = content.items()
    elif isinstance(content, list | tuple):
        inside = enumerate(content)
    else:
        if content is None or (isinstance(content, int | float) and not isinstance(content, bool)):
            yield name, content
        return
    for key, value in inside:
        if key != "provenance":
            yield from numbers(value, f"{name}.{key}" if name else str(key))
