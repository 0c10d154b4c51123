"""The reports of the parts of a batch, which its own report links to."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, cast
from urllib.parse import quote

import numpy as np

from fringeworks.batch.judgement import judgement_from
from fringeworks.batch.run import BatchResult
from fringeworks.batch.store import Store
from fringeworks.evaluate.budget import Budget
from fringeworks.evaluate.inspect import Check, Inspection, Verdict
from fringeworks.report.page.report import write_report
from fringeworks.types import FileProblem, PartTolerance, Rig
from fringeworks.types.recipe import UNITS
from fringeworks.types.report_head import MOST_LETTERS

Parts = Literal["all", "failed", "none"]
"""Parts that get a report of their own."""
UNSAFE = re.compile(r"[^\w.-]+")
"""What the names of files do not hold: names of parts may come from an address."""


def write_part_reports(
    path: Path,
    result: BatchResult,
    parts: Parts,
    progress: Callable[[str], None],
    head: Mapping[str, str],
) -> dict[str, str]:
    """Write the reports of parts into a folder beside the batch's, and return links to them.

    Parameters
    ----------
    path : path
        Report of the batch; those of its parts have the same format.
    result : BatchResult
    parts : "all", "failed" or "none"
    progress : callable
    head : mapping
        Fields of the head; the serial number is the name of the part.

    Returns
    -------
    Links from the report of the batch, by the names of the parts.

    Raises
    ------
    FileProblem for a folder that cannot be written to.
    """
    chosen = [
        row
        for row in result.rows
        if row.get("address") and (parts == "all" or row.get("verdict") != "pass")
    ]
    if parts == "none" or not chosen:
        return {}
    folder = path.with_name(f"{path.stem}-parts")
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise FileProblem(f"{folder}: could not be made: {error.strerror}") from error
    rig = result.recipe.rig if isinstance(result.recipe.rig, Rig) else None
    store = Store(result.folder)
    for row in chosen:
        name = str(row["scan"])
        progress(f"report of {name}")
        shown = {name: inspection_of(result, store, row)}
        write_report(
            _place(path, name), shown, rig=rig, head={**head, "serial": name[:MOST_LETTERS]}
        )
    links = report_links(path, result)
    return {str(row["scan"]): links[str(row["scan"])] for row in chosen}


def report_links(path: Path, result: BatchResult) -> dict[str, str]:
    """Return links from the report of a batch to those of its parts that are there."""
    names = [str(row["scan"]) for row in result.rows if row.get("address")]
    places = {name: _place(path, name) for name in names}
    return {
        name: f"{quote(place.parent.name)}/{quote(place.name)}"
        for name, place in places.items()
        if place.is_file()
    }


def _place(path: Path, name: str) -> Path:
    """The report of a part, beside that of its batch."""
    return path.with_name(f"{path.stem}-parts") / f"{UNSAFE.sub('_', name)}{path.suffix}"


def inspection_of(result: BatchResult, store: Store, row: Mapping[str, Any]) -> Inspection:
    """The inspection of a part as its row has it."""
    kept = judgement_from(store.judgement(row["address"]), str(row["scan"]))
    surface = replace(store.surface(row["address"]), provenance=kept.provenance)
    checks = tuple(_check(one, row, kept.budgets.get(one.name)) for one in result.tolerances)
    seconds = float(row.get("seconds") or 0.0)
    return Inspection(checks, surface, kept.findings, seconds, result.recipe)


def _check(one: PartTolerance, row: Mapping[str, Any], budget: Budget | None) -> Check:
    value, sigma = (row.get(name) for name in (one.name, f"{one.name} σ"))
    return Check(
        one,
        np.nan if value is None else float(value),
        np.nan if sigma is None else float(sigma),
        UNITS[one.quantity],
        cast("Verdict", row.get(f"{one.name} verdict", "undecided")),
        str(row.get(f"{one.name} why", "")),
        budget,
    )
