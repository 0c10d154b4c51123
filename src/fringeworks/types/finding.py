"""What was found in a capture, a set-up, a calibration or a result: as data and as text."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from fringeworks.types.arrays import Axis
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
    def text(self) -> str:
        """The finding in one line."""
        parts = [self.seen]
        if self.causes:
            parts.append(f"likely {', or '.join(self.causes)}")
        if self.advice:
            parts.append(self.advice)
        return "; ".join(parts)
