"""The history of a rig's checks: a table to which each check adds a row."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fringeworks.files.atomic import StrPath, check_target, write_text
from fringeworks.files.csv_table import decoded
from fringeworks.files.limits import existing_file, is_file, parsing, read_content, told
from fringeworks.files.study_table import table_rows
from fringeworks.rig.calibration.drift import RigCheck
from fringeworks.types import FileProblem, FloatMap, Frozen
from fringeworks.types.provenance import today

CHARTED = {
    "drift_mm": "mm",
    "scale": "",
    "camera_rms_px": "px",
    "projector_rms_px": "px",
    "flatness_mm": "mm",
}
"""Figures of a check that are charted, with their units."""
OTHERS = ("sigma_mm", "scale_sigma", "excess")
"""Further figures that are kept."""
LABELS = ("date", "rig", "verdict")
"""Columns of words: when the check was made, the hash of the rig, and what it said."""
VERDICTS = ("holds", "has moved", "cannot tell")
"""What a check can say."""


@dataclass(frozen=True, eq=False, repr=False)
class CheckHistory(Frozen):
    """Checks of a rig in the order in which they were made."""

    dates: tuple[str, ...]
    """Date and time in UTC, ISO 8601."""
    rigs: tuple[str, ...]
    """Hash of the rig that was checked; empty where it is unknown."""
    verdicts: tuple[str, ...]
    figures: dict[str, FloatMap]
    """Figures of ``RigCheck`` by their names, (n,) each."""


def append_check(path: StrPath, check: RigCheck) -> CheckHistory:
    """Add a check to the history of a rig; the file is made where it is missing.

    Parameters
    ----------
    path : path
        ``.csv``.
    check : RigCheck

    Returns
    -------
    CheckHistory with the new check as its last one.

    Raises
    ------
    FileProblem for another suffix, a folder that is missing, and a file that is no history; it is
    then left as it is.
    """
    target = Path(path)
    check_target(target, (".csv",))
    rows: list[list[str]] = []
    if is_file(target):
        known = read_check_history(target)
        rows = [_cells(known, k) for k in range(len(known.dates))]
    origin = check.provenance
    rig = "" if origin is None else origin.rig_sha256 or ""
    date = today() if origin is None or not origin.date else origin.date
    numbers = [repr(float(getattr(check, name))) for name in (*CHARTED, *OTHERS)]
    rows.append([date, rig, check.verdict, *numbers])
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*LABELS, *CHARTED, *OTHERS])
    writer.writerows(rows)
    write_text(target, text.getvalue())
    return read_check_history(target)


def _cells(known: CheckHistory, k: int) -> list[str]:
    """A row as it is written."""
    numbers = [repr(float(column[k])) for column in known.figures.values()]
    return [known.dates[k], known.rigs[k], known.verdicts[k], *numbers]


def read_check_history(path: StrPath) -> CheckHistory:
    """Read the history of a rig's checks.

    Raises
    ------
    FileProblem for a file that is no history.
    """
    place = existing_file(path, "a history of checks (CSV)")
    content = read_content(place, "a history of checks")
    with parsing(place, "a history of checks (CSV)"):
        rows, decimal = table_rows(decoded(content))
        wanted = (*LABELS, *CHARTED, *OTHERS)
        missing = [name for name in wanted if name not in rows[0]]
        if missing:
            raise FileProblem(f"expected a column {missing[0]!r} of a history of checks, got none")
        for number, row in enumerate(rows, start=1):
            if row["verdict"] not in VERDICTS:
                raise FileProblem(
                    f"row {number}: expected {', '.join(VERDICTS)}, got {told(row['verdict'])!r}"
                )
        figures = {
            name: np.array([float(row[name].replace(decimal, ".")) for row in rows])
            for name in (*CHARTED, *OTHERS)
        }
        dates, rigs, verdicts = (tuple(row[name] for row in rows) for name in LABELS)
        return CheckHistory(dates, rigs, verdicts, figures)
