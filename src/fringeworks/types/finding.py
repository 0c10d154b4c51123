"""What was found in a capture, a set-up, a calibration or a result: as data and as text."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol, get_args

import numpy as np

from fringeworks.types.arrays import Axis, BoolMap
from fringeworks.types.camera import Region
from fringeworks.types.frozen import Frozen

Severity = Literal["note", "warning", "error"]
"""How much a finding matters, in rising order.

- note: nothing is wrong. It tells how the result came about, such as which noise was measured.
- warning: results are less exact or less complete than they could be, or may be wrong. What was
  seen says in which way, and whether the standard deviations contain it.
- error: results, or the part of them that the finding names, are wrong or missing; do not use them
  before its cause is removed.
"""


LEFT_OUT = "axis left out"
"""Kind of the finding about an axis of which hardly a pixel can be measured."""
MOVING = "moving scene"
"""Kind of the finding about a camera or a scene that moves while the frames are taken."""


@dataclass(frozen=True)
class Pixels:
    """Which pixels a finding concerns: how many, and where."""

    count: int
    """Number of pixels that the finding concerns."""
    of: int
    """Number of pixels that were looked at."""
    region: Region | None = None
    """The smallest rectangle that holds them; None where their places are not known."""

    @property
    def share(self) -> float:
        """Share of the pixels that were looked at, 0…1."""
        return self.count / max(self.of, 1)


def region_of(where: BoolMap) -> Region | None:
    """The smallest rectangle that holds the True pixels of a map, (h, w); None for none."""
    rows, columns = (np.flatnonzero(where.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return None
    x, y = int(columns[0]), int(rows[0])
    return Region(x, y, int(columns[-1]) - x + 1, int(rows[-1]) - y + 1)


@dataclass(frozen=True, eq=False, repr=False)
class Finding(Frozen):
    """Something that was seen: its likely causes, and what to do about it."""

    kind: str
    """What it is about, in one or two words; every kind is named where it is found."""
    seen: str
    """What was seen, with its figures, and what was decided because of it."""
    causes: tuple[str, ...] = ()
    """Likely causes, the likeliest first; empty where none is needed."""
    advice: str = ""
    """What to do about it; empty where nothing is to be done."""
    axis: Axis | None = None
    """The axis that it concerns; None for both."""
    frames: tuple[str, ...] = ()
    """Labels of the frames that it concerns; empty for all."""
    figures: dict[str, float] = field(default_factory=dict)
    """The figures by name, with their units."""
    severity: Severity = "warning"
    pixels: Pixels | None = None
    """The pixels that it concerns; None for all, and where they are not known."""

    @property
    def rank(self) -> int:
        """The severity as a number: 0 for a note, 1 for a warning, 2 for an error."""
        return get_args(Severity).index(self.severity)

    @property
    def line(self) -> str:
        """Severity, kind and text in one line, as commands, logs and pages print it."""
        return f"{self.severity} ({self.kind}): {self.text}"

    @property
    def text(self) -> str:
        """The finding in one line."""
        parts = [self.seen]
        if self.causes:
            parts.append(f"likely {', or '.join(self.causes)}")
        if self.advice:
            parts.append(self.advice)
        return "; ".join(parts)


def by_effect(findings: Iterable[Finding]) -> list[Finding]:
    """Findings, the most severe first; of one severity, those that concern more pixels first."""

    def place(finding: Finding) -> tuple[int, float]:
        share = 1.0 if finding.pixels is None else finding.pixels.share
        return -finding.rank, -share

    return sorted(findings, key=place)


def as_notes(texts: Iterable[str], kind: str = "frames") -> tuple[Finding, ...]:
    """Texts that tell how a result came about, as findings."""
    return tuple(Finding(kind, text, severity="note") for text in texts)


class _Found(Protocol):
    @property
    def findings(self) -> tuple[Finding, ...]: ...


def numbered(name: str, results: Iterable[_Found]) -> tuple[Finding, ...]:
    """The findings of several results, each with its name and number from 1, as "camera 2"."""
    return tuple(
        replace(finding, seen=f"{name} {number}: {finding.seen}")
        for number, found in enumerate(results, 1)
        for finding in found.findings
    )


class Noted:
    """Base of results with ``findings``: their text, and those that warn."""

    @property
    def notes(self: _Found) -> tuple[str, ...]:
        """The findings in one line each."""
        return tuple(finding.text for finding in self.findings)

    @property
    def warnings(self: _Found) -> tuple[Finding, ...]:
        """The findings that are more than notes."""
        return tuple(finding for finding in self.findings if finding.rank)
