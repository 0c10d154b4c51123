"""Chapters of results. ``surface_chapters`` and ``others`` register their kinds."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import singledispatch
from typing import Any

from fringeworks.report.display import plot
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
from fringeworks.report.summary import summarise
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
    judged: list[bool] = field(default_factory=list)
    """Filled by the chapters: whether each tolerance is kept."""


@singledispatch
def chapter_of(result: object, context: Context) -> Chapter:
    """Return the chapter of a result: its figures, and its picture where it has one.

    A kind of result that needs more registers a function of its own.

    Raises
    ------
    InputError for something that is no result.
    """
    try:
        drawn = [Picture(plot(result), "Picture of the result.")]
    except InputError:
        drawn = []
    try:
        values = summarise(result)
    except InputError:
        values = {}
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
    context.judged.extend(one.kept for one in judged)
    return tolerance_block(judged)


def figure_blocks(values: dict[str, Any], context: Context) -> tuple[Block, ...]:
    """Single figures, tolerances and findings of a result, from ``summarise`` or a file."""
    found = [finding for finding in listed(values.get("findings")) if isinstance(finding, dict)]
    return (
        scalar_facts(values),
        *judged_block(values, context),
        *findings_block(found),
    )
