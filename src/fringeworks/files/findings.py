"""Findings as JSON, inside the files of results."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, get_args

from fringeworks.types import FrameFinding, FrameFindingKind

LISTS = ("causes", "frames")
"""Fields of a finding that hold several texts."""


def findings_as_dicts(findings: Sequence[FrameFinding]) -> list[dict[str, Any]]:
    """Findings as JSON values."""
    return [asdict(finding) for finding in findings]


def findings_from_json(text: str) -> tuple[FrameFinding, ...]:
    """Findings as they were written.

    Raises
    ------
    ValueError, TypeError or KeyError for anything else.
    """
    items: list[dict[str, Any]] = json.loads(text)
    found = [
        FrameFinding(**item | {name: tuple(map(str, item[name])) for name in LISTS})
        for item in items
    ]
    kinds = get_args(FrameFindingKind)
    if not all(f.kind in kinds and isinstance(f.seen, str) for f in found):
        raise ValueError("findings of another kind")
    return tuple(found)
