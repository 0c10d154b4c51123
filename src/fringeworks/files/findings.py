"""Findings as JSON values: in the files of results, in logs and in what commands print."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any, get_args

from fringeworks.types import Finding, Pixels, Region, Severity

LISTS = ("causes", "frames")
"""Fields of a finding that hold several texts."""


def findings_as_dicts(findings: Iterable[Finding]) -> list[dict[str, Any]]:
    """Findings as JSON values: all fields, and the text in one line."""
    return [asdict(finding) | {"text": finding.text} for finding in findings]


def findings_as_json(findings: Iterable[Finding]) -> str:
    """Findings as text for ``findings_from_json``."""
    return json.dumps(findings_as_dicts(findings))


def findings_from_json(text: str) -> tuple[Finding, ...]:
    """Findings as they were written.

    Raises
    ------
    ValueError, TypeError or KeyError for anything else.
    """
    return tuple(map(finding_from_dict, json.loads(text)))


def finding_from_dict(item: dict[str, Any]) -> Finding:
    """A finding from its values as ``findings_as_dicts`` gives them; None may be left out."""
    given = {name: value for name, value in item.items() if name != "text"}
    given |= {name: tuple(map(str, item[name])) for name in LISTS}
    if given.get("pixels") is not None:
        region = given["pixels"]["region"]
        region = None if region is None else Region(**region)
        given["pixels"] = Pixels(**given["pixels"] | {"region": region})
    found = Finding(**given)
    if not (isinstance(found.kind, str) and isinstance(found.seen, str)):
        raise ValueError("findings of another kind")
    if found.severity not in get_args(Severity):
        raise ValueError(f"severity: expected one of {get_args(Severity)}, got {found.severity}")
    return found
