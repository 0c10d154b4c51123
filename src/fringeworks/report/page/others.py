"""Chapters of results that are no surfaces: rigs, set-ups, tables, figures from files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fringeworks.report.page.blocks import Block, Chapter, Text
from fringeworks.report.page.chapters import Context, chapter_of, judged_block
from fringeworks.report.page.parts import dict_table, facts, findings_block, provenance_block
from fringeworks.types import RIG_PARAMETERS, InputError, Provenance, Rig, provenance_from

MOST_ROWS = 500
"""Rows of a table that a page shows; more belong into a file."""


@chapter_of.register
def _(rig: Rig, context: Context) -> Chapter:
    sigma = None if rig.covariance is None else np.sqrt(np.diag(rig.covariance))
    values = [*rig.camera.parameters, *rig.projector.parameters]
    rows = [
        {"parameter": name, "value": float(value), "σ": None if sigma is None else float(sigma[k])}
        for k, (name, value) in enumerate(zip(RIG_PARAMETERS, values, strict=False))
    ]
    camera, projector = rig.residual_px or (None, None)
    known = {"baseline_mm": rig.baseline_mm, "camera_rms_px": camera, "projector_rms_px": projector}
    return Chapter(
        context.name,
        (
            facts(
                [
                    ("baseline / mm", rig.baseline_mm),
                    ("reprojection, camera / px", camera),
                    ("reprojection, projector / px", projector),
                    ("camera / px", f"{rig.camera.width_px} × {rig.camera.height_px}"),
                    ("projector / px", f"{rig.projector.width_px} × {rig.projector.height_px}"),
                ]
            ),
            *judged_block(known, context),
            dict_table(rows, "Parameters and their standard deviations"),
            *provenance_block(rig.provenance),
        ),
    )


@chapter_of.register
def _(rows: list, context: Context) -> Chapter:  # type: ignore[type-arg]
    if not all(isinstance(row, dict) for row in rows) or not rows:
        raise InputError("report: expected the rows of a table, got a list of something else")
    return Chapter(context.name, tuple(_table(rows, "Comparison")))


@chapter_of.register
def _(figures: dict, context: Context) -> Chapter:  # type: ignore[type-arg]
    blocks: list[Block] = [facts(_scalars(figures)), *judged_block(figures, context)]
    found = [f for f in figures.get("findings", ()) if isinstance(f, Mapping)]
    blocks += findings_block(found, figures.get("notes", ()))
    for name, value in figures.items():
        rows = isinstance(value, list) and value and all(isinstance(row, dict) for row in value)
        if rows and name != "findings":
            blocks += _table(value, name.replace("_", " "))
    blocks += provenance_block(_origin(figures.get("provenance")))
    return Chapter(context.name, tuple(blocks))


def _table(rows: list[dict[str, Any]], caption: str) -> list[Block]:
    blocks: list[Block] = [dict_table(rows[:MOST_ROWS], caption)]
    if len(rows) > MOST_ROWS:
        blocks.append(Text(f"{len(rows) - MOST_ROWS} more rows are not shown."))
    return blocks


def _scalars(content: Mapping[str, Any], name: str = "") -> list[tuple[str, Any]]:
    """Single values of nested figures; lists of numbers count as one value."""
    found: list[tuple[str, Any]] = []
    for key, value in content.items():
        full = f"{name}, {key}" if name else str(key)
        label = full.replace("_", " ")
        if key in ("provenance", "notes", "findings"):
            continue
        nested = isinstance(value, list) and any(isinstance(v, Mapping | list) for v in value)
        if isinstance(value, Mapping):
            found += _scalars(value, full)
        elif not nested:
            found.append((label, value))
    return found


def _origin(content: Any) -> Provenance | None:
    return provenance_from(content) if isinstance(content, Mapping) else None
