"""Trials of a gauge study that are scanned one after another, into the table of the study."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fringeworks.evaluate.inspect import inspect
from fringeworks.files.atomic import StrPath, write_text
from fringeworks.files.limits import told
from fringeworks.files.study_table import table_rows
from fringeworks.types import InputError, Recipe

MOST_TRIALS = 50
"""Largest number of trials of each part by each operator. AIAG asks for 2 or 3, and for up to 50
of one reference."""
_ALONE = ["part", "trial"]
"""First columns of a table without operators; the tolerances of the recipe follow."""


@dataclass(frozen=True)
class Trial:
    """One measurement of a study."""

    part: str
    operator: str
    number: int
    """From 1 on."""

    @property
    def name(self) -> str:
        """Name of its folder."""
        return "_".join(one for one in (self.part, self.operator, str(self.number)) if one)


def trials_of(parts: Sequence[str], operators: Sequence[str], count: int) -> list[Trial]:
    """Return the trials of a study in the order in which they are measured.

    Parameters
    ----------
    parts, operators : sequences of str
        Labels; no operators for repeatability alone.
    count : int
        Trials of each part by each operator.

    Raises
    ------
    InputError for labels that are empty, twice, or no names of folders, and for a wrong count.

    Notes
    -----
    An operator measures all parts before the next trial, each time in another order, so that nobody
    remembers a value and a drift of the gauge does not look like a difference of parts (AIAG, MSA,
    4th edition, 2010, ch. III B). The order is the same whenever the study is asked for again.
    """
    for what, labels in (("parts", parts), ("operators", operators)):
        wrong = [one for one in labels if not one.strip() or Path(one).name != one or "_" in one]
        if wrong or len(set(labels)) < len(labels):
            raise InputError(
                f"{what}: expected different names without / and _, got "
                f"{', '.join(told(one) for one in labels)}"
            )
    if not parts or not 1 <= count <= MOST_TRIALS:
        raise InputError(
            f"trials: expected parts, and 1 to {MOST_TRIALS} trials of each, got {len(parts)} "
            f"parts and {count}"
        )
    found = []
    for number in range(1, count + 1):
        for k, operator in enumerate(operators or ("",)):
            order = np.random.default_rng([number, k]).permutation(len(parts))
            found += [Trial(parts[at], operator, number) for at in order]
    return found


def scan_trials(
    table: StrPath,
    trials: Sequence[Trial],
    recipe: Recipe,
    take: Callable[[Trial], StrPath],
) -> Path:
    """Scan the trials of a study that its table lacks, and write their values into it.

    Parameters
    ----------
    table : path
        CSV; a table of earlier trials is continued, so that an interrupted study goes on.
    trials : sequence of Trial
    recipe : Recipe
        With the rig and the tolerances, whose names are the columns of the values.
    take : callable
        Takes the capture of a trial, and returns its folder.

    Raises
    ------
    InputError for a value that could not be measured, and for a table of other columns. All trials
    before it are in the table then.
    """
    place = Path(table)
    quantities = [one.name for one in recipe.tolerances]
    if not quantities:
        raise InputError("recipe: expected tolerances, whose values are studied, got none")
    labels = ["part", "operator", "trial"] if any(one.operator for one in trials) else _ALONE
    columns = [*labels, *quantities]
    rows = _known(place, columns)
    known = [row[: len(labels)] for row in rows]
    for trial in trials:
        told_by = {"part": trial.part, "operator": trial.operator, "trial": str(trial.number)}
        label = [told_by[one] for one in labels]
        if label in known:
            continue
        checks = inspect(take(trial), recipe).checks
        for one in checks:
            if not np.isfinite(one.value):
                raise InputError(f"{trial.name}: {one.tolerance.name} was not measured: {one.why}")
        rows.append([*label, *(repr(float(one.value)) for one in checks)])
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([columns, *rows])
        write_text(place, text.getvalue())
    return place


def _known(table: Path, columns: Sequence[str]) -> list[list[str]]:
    """The rows of earlier trials."""
    if not table.exists():
        return []
    rows, _ = table_rows(table.read_text("utf-8"))
    if list(rows[0]) != list(columns):
        raise InputError(
            f"{told(str(table))}: expected the columns {', '.join(columns)}, got "
            f"{', '.join(told(one) for one in rows[0])}; name a new table"
        )
    return [list(row.values()) for row in rows]
