"""What was found in the frames of a stack or a pair, as data and as text."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from fringeworks.types.arrays import Axis
from fringeworks.types.frozen import Frozen

FrameFindingKind = Literal[
    "noise",
    "steps",
    "flicker",
    "motion",
    "ripple",
    "disagreement",
    "correlated noise",
    "scatter",
    "files",
    "unmeasured",
    "turned frame",
    "swapped frames",
    "row method",
    "lost pixels",
    "convergence",
    "raw colours",
    "exposures",
    "depth range",
    "views",
    "alignment",
    "cameras",
]
"""What a finding is about."""


@dataclass(frozen=True, eq=False, repr=False)
class FrameFinding(Frozen):
    """Something that was seen in the frames: its likely causes, and what to do about it."""

    kind: FrameFindingKind
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

    @property
    def text(self) -> str:
        """The finding in one line."""
        parts = [self.seen]
        if self.causes:
            parts.append(f"likely {', or '.join(self.causes)}")
        if self.advice:
            parts.append(self.advice)
        return "; ".join(parts)
