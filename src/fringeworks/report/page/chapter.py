"""Chapters of results: those that their kinds declare, or figures and picture."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from fringeworks.report.display import plot
from fringeworks.report.kind import kind_of
from fringeworks.report.page.blocks import Block, Chapter, Picture
from fringeworks.report.page.parts import (
    figure_tables,
    findings_block,
    listed,
    provenance_block,
    scalar_facts,
    tolerance_block,
)
from fringeworks.report.page.tolerances import Tolerance, judge
from fringeworks.types import InputError, Rig


@dataclass(frozen=True)
class Context:
    """What a chapter needs beside its result."""

    name: str
    """Heading."""
    tolerances: tuple[Tolerance, ...] = ()
    rig: Rig | None = None
    """Of point clouds: their points then travel as depths."""
    every: int = 1
    """Every k-th pixel is shown."""
    verdicts: list[str] = field(default_factory=list)
    """Filled by the chapters: the verdict of each tolerance."""


def chapter_of(result: object, context: Context) -> Chapter:
    """Return the chapter of a result: by default its figures, and its picture where it has one.

    Raises
    ------
    InputError for something that is no result.
    """
    kind = kind_of(result)
    if kind.chapter is not None:
        return kind.chapter(result, context)
    drawn = [Picture(plot(result), "Picture of the result.")] if kind.picture else []
    values = kind.figures(result) if kind.figures else {}
    if not drawn and not values:
        raise InputError(f"report: expected a result of fringeworks, got {type(result).__name__}")
    origin = getattr(result, "provenance", None)
    return Chapter(
        context.name,
        (
            *figure_blocks(values, context),
            *drawn,
            *figure_tables(values),
            *(provenance_block(origin) if origin else ()),
        ),
    )


def judged_block(values: dict[str, Any], context: Context) -> tuple[Block, ...]:
    """Tolerances of a result, judged."""
    try:
        judged = judge(values, context.tolerances)
    except InputError as error:
        raise error.at(context.name) from error
    context.verdicts.extend("pass" if one.kept else "fail" for one in judged)
    return tolerance_block(judged)


def figure_blocks(values: dict[str, Any], context: Context) -> tuple[Block, ...]:
    """Single figures, tolerances and findings of a result, from ``summarise`` or a file."""
    found = [finding for finding in listed(values.get("findings")) if isinstance(finding, dict)]
    texts = [finding.get("text") for finding in found]
    notes = [note for note in listed(values.get("notes")) if note not in texts]
    found += [{"kind": "note", "seen": note} for note in notes]
    return (
        scalar_facts(values),
        *judged_block(values, context),
        *findings_block(found),
    )
