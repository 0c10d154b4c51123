"""What a check found: with its causes, and what to do."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from fringeworks.types import Frozen

SetupFindingKind = Literal[
    "dark",
    "saturated",
    "range",
    "exposure",
    "flicker",
    "scale",
    "mirrored",
    "contrast",
    "delay",
    "vignetting",
    "ramp",
    "room",
    "averaged",
    "compressed",
]
"""What a finding is about."""


@dataclass(frozen=True, eq=False, repr=False)
class SetupFinding(Frozen):
    """Something that makes measurements with a projector and a camera worse, or impossible."""

    kind: SetupFindingKind
    seen: str
    """What was seen, with its figures."""
    causes: tuple[str, ...]
    """Likely causes, the likeliest first."""
    advice: str
    """What to do about it."""
    figures: dict[str, float] = field(default_factory=dict)
    """The figures by name, with their units."""

    @property
    def text(self) -> str:
        """The finding in one line."""
        return f"{self.seen}; likely {', or '.join(self.causes)}; {self.advice}"
