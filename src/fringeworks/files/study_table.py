"""Tables of gauge studies: a column of values, with the part and the operator of each."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fringeworks.files.atomic import StrPath
from fringeworks.files.csv_table import COMMENTS, SEPARATORS, decoded
from fringeworks.files.limits import existing_file, parsing, read_content, told
from fringeworks.types import FileProblem, FloatMap, Frozen, InputError

NAMES_SHOWN = 12
"""Columns that a message names; more fill a screen."""
FIELDS = ("part", "operator", "trial")
"""What the name of a scan can tell."""
SCAN = "scan"
"""Column of the names of scans, as batches write it."""


@dataclass(frozen=True, eq=False, repr=False)
class StudyTable(Frozen):
    """Values of a study, as a table has them."""

    layout = {"values": "f n", "references": "?f n"}  # noqa: RUF012

    values: FloatMap
    """(n,), in the order of the rows."""
    parts: tuple[str, ...]
    """Empty where the table has no parts."""
    operators: tuple[str, ...] | None
    """None where the table has no operators."""
    references: FloatMap | None
    """(n,), calibrated values; None where they are not asked for."""


def read_study(
    path: StrPath,
    quantity: str,
    *,
    part: str | None = None,
    operator: str | None = None,
    names: str | None = None,
    calibrated: str | None = None,
) -> StudyTable:
    """Read the values of a study from a table (CSV), also from the summary of a batch.

    Parameters
    ----------
    path : path
        The first row has the names of the columns.
    quantity : str
        Column of the values.
    part, operator : str, optional
        Columns of their labels; by default ``part`` and ``operator``, where the table has them.
    names : str, optional
        How the column ``scan`` names parts, operators and trials, such as
        ``{part}_{operator}_{trial}``.
    calibrated : str, optional
        Column of calibrated values.

    Raises
    ------
    FileProblem for a file that is no table, a column that it lacks, a cell that is no number, and
    a trial that is there twice; InputError for a pattern that tells nothing.
    """
    place = existing_file(path, "a table (CSV)")
    content = read_content(place, "a table")
    with parsing(place, "a table (CSV)"):
        rows, decimal = table_rows(decoded(content))
        if names is not None:
            rows = [row | _fields(row, names) for row in rows]
        values = _numbers(rows, quantity, decimal)
        parts = _words(rows, part, "part")
        operators = _words(rows, operator, "operator")
        _refuse_twice(rows, parts, operators)
        known = None if calibrated is None else _numbers(rows, calibrated, decimal)
        return StudyTable(values, parts or (), operators, known)


Row = Mapping[str, str]
"""Cells by the names of their columns."""


def table_rows(text: str) -> tuple[list[dict[str, str]], str]:
    """Return the rows of a table, and its decimal sign."""
    lines = [x for x in text.splitlines() if x.strip() and not x.startswith(COMMENTS)]
    if len(lines) < 2:
        raise FileProblem("expected a row of names and rows of values, got fewer")
    separator = next((one for one in SEPARATORS if one in lines[0]), ",")
    head, *rest = (
        [cell.strip() for cell in cells] for cells in csv.reader(lines, delimiter=separator)
    )
    for number, cells in enumerate(rest, start=1):
        if len(cells) != len(head):
            raise FileProblem(f"row {number}: expected {len(head)} cells, got {len(cells)}")
    decimal = "," if separator != "," else "."
    return [dict(zip(head, cells, strict=True)) for cells in rest], decimal


def _known(rows: Sequence[Row], column: str) -> None:
    if column not in rows[0]:
        shown = [repr(told(name)) for name in list(rows[0])[:NAMES_SHOWN]]
        more = ", …" if len(rows[0]) > NAMES_SHOWN else ""
        raise FileProblem(f"expected a column {column!r}, got {', '.join(shown)}{more}")


def _numbers(rows: Sequence[Row], column: str, decimal: str) -> FloatMap:
    """A column of numbers, every one of them known."""
    _known(rows, column)
    found = []
    for number, row in enumerate(rows, start=1):
        cell = row[column]
        try:
            value = float(cell.replace(decimal, "."))
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            who = f" ({told(row[SCAN])})" if row.get(SCAN) else ""
            raise FileProblem(
                f"row {number}{who}: expected a number in {column!r}, got {told(cell)!r}; measure "
                "it again, or leave its part out"
            )
        found.append(value)
    return np.array(found)


def _words(rows: Sequence[Row], asked: str | None, usual: str) -> tuple[str, ...] | None:
    """A column of labels; None where the table lacks the usual one."""
    if asked is None and usual not in rows[0]:
        return None
    column = usual if asked is None else asked
    _known(rows, column)
    for number, row in enumerate(rows, start=1):
        if not row[column]:
            raise FileProblem(f"row {number}: expected a label in {column!r}, got an empty cell")
    return tuple(row[column] for row in rows)


def _refuse_twice(
    rows: Sequence[Row], parts: tuple[str, ...] | None, operators: tuple[str, ...] | None
) -> None:
    """Refuse a trial that is there twice."""
    if "trial" not in rows[0] or parts is None:
        return
    known = set()
    for number, (row, part, who) in enumerate(
        zip(rows, parts, operators or [""] * len(rows), strict=True), start=1
    ):
        if (part, who, row["trial"]) in known:
            by = f" by operator {told(who)}" if who else ""
            raise FileProblem(
                f"row {number}: expected each trial once, got trial {told(row['trial'])} of part "
                f"{told(part)}{by} again"
            )
        known.add((part, who, row["trial"]))


def _fields(row: Row, names: str) -> dict[str, str]:
    """What the name of a scan tells by a pattern."""
    _known([row], SCAN)
    found = _pattern(names).fullmatch(row[SCAN])
    if found is None:
        raise FileProblem(
            f"{SCAN} {told(row[SCAN])!r}: expected a name such as {names}, got another; rename it, "
            "or give another pattern"
        )
    return found.groupdict()


def _pattern(names: str) -> re.Pattern[str]:
    """A pattern of names with ``{part}``, ``{operator}`` and ``{trial}`` as an expression."""
    pieces = re.split(r"\{(\w+)\}", names)
    fields = pieces[1::2]
    apart = all(pieces[2:-1:2])
    if "part" not in fields or len(set(fields)) < len(fields) or set(fields) - set(FIELDS):
        raise InputError(f"names: expected {{part}}, and perhaps {{operator}}, {{trial}}: {names}")
    if not apart:
        raise InputError(f"names: expected letters between two fields, got none in {names}")
    parts = [
        f"(?P<{piece}>.+?)" if number % 2 else re.escape(piece)
        for number, piece in enumerate(pieces)
    ]
    return re.compile("".join(parts))
