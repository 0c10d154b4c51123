"""Tables of text (CSV): columns with names, in the spelling of any program that writes them."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.files.limits import (
    MAX_DESCRIPTION_BYTES,
    parsing,
    read_content,
    text_of,
    told,
)
from fringeworks.types import FileProblem, Reason

CSV = ".csv"
"""Suffix of tables."""
KIND = "# fringeworks "
"""Beginning of a file that is written here; what it holds follows."""
DETAILS = "# details "
"""Beginning of the line with the numbers and texts that are no columns, JSON."""
COMMENTS = ("#", "//", "%")
"""Beginnings of lines that are no rows."""
SEPARATORS = (";", "\t", ",")
"""What separates cells; where none occurs, white space does."""
MOST_COLUMNS = 1024
"""Largest number of columns."""
EMPTY_RUNS = re.compile(r"(?<=[,;\t])(?=[,;\t])")
"""Places of empty cells between two separators."""
REASONS = np.array([reason.name.lower() for reason in Reason])
"""Names of the reasons in tables."""
SINGLE = "%.9g"
"""Format that gives back every number of single precision."""


def write_csv(
    path: Path, kind: str, details: Mapping[str, Any], parts: Iterable[Mapping[str, NDArray[Any]]]
) -> None:
    """Write a table with a header; cells without a value are empty.

    Parameters
    ----------
    path : Path
    kind : str
        What the table holds: one word.
    details : mapping
        What else is to be kept, as JSON values; a comment before the header has it.
    parts : mappings of names to columns (n,)
        The rows, some at a time. Numbers have the digits that give them back.
    """
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(f"{KIND}{kind}\n{DETAILS}{json.dumps(details)}\n")
        for number, columns in enumerate(parts):
            if not number:
                file.write(",".join(columns) + "\n")
            file.write(_lines(list(columns.values())))


def _lines(columns: Sequence[NDArray[Any]]) -> str:
    """Rows of cells as text."""
    forms = [SINGLE if column.dtype == np.float32 else "%s" for column in columns]
    rows = zip(*(column.tolist() for column in columns), strict=True)
    text = (",".join(forms) + "\n") * len(columns[0]) % tuple(cell for row in rows for cell in row)
    unknown = any(c.dtype.kind == "f" and bool(np.isnan(c).any()) for c in columns)
    # Names of reasons do not hold these letters.
    return text.replace("nan", "") if unknown else text


@dataclass(frozen=True)
class CsvTable:
    """Rows of text, with the names of their columns."""

    kind: str
    """What the table holds, where fringeworks wrote it; else empty."""
    details: dict[str, Any]
    names: tuple[str, ...]
    """Names of the columns; empty where the file gives none."""
    width: int
    """Number of columns."""
    lines: list[str]
    separator: str | None
    """None for white space."""

    def numbers(self, columns: Sequence[int]) -> NDArray[np.float64]:
        """Columns of numbers, (n, k); NaN for empty cells."""
        if not self.lines:
            return np.empty((0, len(columns)))
        return np.loadtxt(
            self.lines,
            np.float64,
            comments=None,
            delimiter=self.separator,
            usecols=list(columns),
            ndmin=2,
            quotechar='"',
        )

    def words(self, column: int) -> NDArray[np.str_]:
        """A column of words of at most 20 letters, (n,)."""
        if not self.lines:
            return np.empty(0, "U20")
        return np.loadtxt(
            self.lines,
            "U20",
            comments=None,
            delimiter=self.separator,
            usecols=[column],
            ndmin=1,
            quotechar='"',
        )

    def reasons(self, column: int) -> NDArray[np.uint8]:
        """A column of the names of reasons, as ``Reason``.

        Raises
        ------
        FileProblem for other words.
        """
        words, place = np.unique(self.words(column), return_inverse=True)
        known = {str(name): number for number, name in enumerate(REASONS)}
        unknown = [word for word in words.tolist() if word not in known]
        if unknown:
            raise FileProblem(f"expected a reason, as low_modulation, got {told(unknown[0])!r}")
        numbers = np.array([known[word] for word in words.tolist()], np.uint8)
        return numbers[place.ravel()]


def read_csv(path: Path) -> CsvTable:
    """Read a table, whatever separates its cells and with a decimal point or comma.

    Raises
    ------
    FileProblem for a file that holds no rows of cells.
    """
    content = read_content(path, "a table")
    with parsing(path, "a table (CSV)"):
        lines = [line for line in decoded(content).splitlines() if line.strip()]
        start = next((k for k, x in enumerate(lines) if not x.startswith(COMMENTS)), len(lines))
        head, rows = lines[:start], lines[start:]
        if not rows:
            raise FileProblem("expected rows of numbers, got none")
        kind = head[0][len(KIND) :].strip() if head and head[0].startswith(KIND) else ""
        details = _details(head) if kind else {}
        separator = next((one for one in SEPARATORS if one in rows[0]), None)
        first = _cells(rows[0], separator)
        names: tuple[str, ...] = ()
        if not all(map(_is_number, first)):
            names, rows = tuple(first), rows[1:]
        elif head and len(said := _cells(head[-1].lstrip("#/% "), separator)) == len(first):
            # NumPy and CloudCompare put the names into the last comment.
            names = tuple(said)
        if len(first) > MOST_COLUMNS:
            raise FileProblem(f"expected at most {MOST_COLUMNS} columns, got {len(first)}")
        return CsvTable(kind, details, names, len(first), _rows_of(rows, separator), separator)


def decoded(content: bytes) -> str:
    """The text; Excel on Windows writes the code page 1252 unless asked for UTF-8."""
    try:
        return text_of(content)
    except FileProblem as problem:
        if not isinstance(problem.__cause__, UnicodeDecodeError):
            raise
        try:
            return content.decode("cp1252")
        except UnicodeDecodeError:
            raise FileProblem("expected text, got other bytes") from problem


def _details(head: Sequence[str]) -> dict[str, Any]:
    text = next((line[len(DETAILS) :] for line in head if line.startswith(DETAILS)), "{}")
    if len(text) > MAX_DESCRIPTION_BYTES:
        raise FileProblem(f"expected details of at most {MAX_DESCRIPTION_BYTES >> 20} MB, got more")
    found = json.loads(text)
    if not isinstance(found, dict):
        raise FileProblem("expected details by their names, got another JSON value")
    return found


def _cells(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return not cell  # an empty cell may be a number that is unknown
    return True


def _rows_of(rows: list[str], separator: str | None) -> list[str]:
    """Rows with decimal points, and NaN in empty cells."""
    if separator in (";", "\t") and any("," in row for row in rows[:1]):
        rows = [row.replace(",", ".") for row in rows]
    if separator is None:
        return rows
    found = []
    for row in rows:
        if separator * 2 in row or row[0] == separator or row[-1] == separator:
            row = EMPTY_RUNS.sub("nan", f"{separator}{row}{separator}")[1:-1]
        found.append(row)
    return found
