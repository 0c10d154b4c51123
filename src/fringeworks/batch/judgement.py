"""What the report of a part needs beside its surface and its row: budgets, findings, origin.

It is stored with the results, without dates and folders: equal inputs give equal bytes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import PurePath
from typing import Any

from fringeworks.evaluate.budget import Budget, BudgetLine
from fringeworks.evaluate.inspect import Inspection
from fringeworks.files.findings import finding_from_dict, findings_as_dicts
from fringeworks.types import FileProblem, Finding, InputError, Provenance, provenance_from


@dataclass(frozen=True)
class Judgement:
    """What is kept of an inspection beside its surface and its values."""

    budgets: Mapping[str, Budget] = field(default_factory=dict)
    """Uncertainty budgets by the names of their tolerances."""
    findings: tuple[Finding, ...] = ()
    """What was found in the capture."""
    provenance: Provenance | None = None
    """How the surface was measured; without its date."""


def as_values(found: Inspection) -> dict[str, Any]:
    """Return the judgement of an inspection as JSON values."""
    budgets = {c.tolerance.name: _as_values(c.budget) for c in found.checks if c.budget is not None}
    origin = found.surface.provenance
    return {
        "budgets": budgets,
        "findings": findings_as_dicts(found.findings),
        "provenance": None if origin is None else _undated(origin).as_dict(),
    }


def judgement_from(values: Mapping[str, Any], name: str) -> Judgement:
    """Return the judgement that ``as_values`` gave; an empty one for results of old versions.

    Raises
    ------
    FileProblem that names the part, for values that were changed.
    """
    if not values:
        return Judgement()
    try:
        origin = values["provenance"]
        return Judgement(
            {one: _budget(budget) for one, budget in values["budgets"].items()},
            tuple(map(finding_from_dict, values["findings"])),
            None if origin is None else provenance_from(origin),
        )
    except (AttributeError, KeyError, TypeError, ValueError, InputError) as error:
        raise FileProblem(f"{name}: expected budgets, findings and origin, got {error}") from error


def _undated(origin: Provenance) -> Provenance:
    """The origin without its date, and without the folder of the frames: captures can be moved."""
    inputs = tuple(replace(one, name=PurePath(one.name).name) for one in origin.inputs)
    return replace(origin, date="", inputs=inputs)


def _as_values(budget: Budget) -> dict[str, Any]:
    """A budget as JSON values; JSON has no infinity."""
    values = asdict(budget)
    for one in (values, *values["lines"]):
        one["freedom"] = one["freedom"] if math.isfinite(one["freedom"]) else None
    return values


def _budget(values: Mapping[str, Any]) -> Budget:
    lines = tuple(BudgetLine(**_free(line)) for line in values["lines"])
    return Budget(**{**_free(values), "lines": lines})


def _free(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values with the degrees of freedom that JSON does not know."""
    freedom = values["freedom"]
    return {**values, "freedom": math.inf if freedom is None else freedom}
