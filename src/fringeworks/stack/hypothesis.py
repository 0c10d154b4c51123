"""A hypothesis about a stack: which frame shows which pattern of the plan, and how."""

from __future__ import annotations

from dataclasses import dataclass

from fringeworks.types import Axis


@dataclass(frozen=True)
class OtherSteps:
    """Sign and start of steps that differ from the plan's."""

    axis: Axis
    sign: float
    """1, or −1 for steps that run backwards."""
    start: float
    """Start of the steps, turns."""
    of_set: int | None = None
    """Number of the set along the axis that takes these steps; None for all."""


@dataclass(frozen=True)
class OtherPeriod:
    """Period of a set that differs from the plan's."""

    axis: Axis
    of_set: int
    """Number of the set along the axis."""
    px: float
    """The period, projector px."""


@dataclass(frozen=True)
class Order:
    """A hypothesis: which frame of the stack shows which pattern of the plan."""

    places: tuple[int | None, ...]
    """Frame of the stack that shows each pattern of the plan; None where none does."""
    inverted: frozenset[int] = frozenset()
    """Patterns that are shown with light and dark exchanged."""
    since: int = 0
    """First frame of the stack that sees the scene moved."""
    moved_px: int = 0
    """Shift of the image since then along the lines, camera px."""
    steps: tuple[OtherSteps, ...] = ()
    """Steps that differ from the plan's."""
    exposure: tuple[int, float] | None = None
    """A frame of the stack whose exposure is another, and how many times that of the others."""
    period: OtherPeriod | None = None
    """A period that differs from the plan's."""

    def shown(self, pattern: int) -> bool:
        """Whether there is a frame for a pattern."""
        return pattern >= len(self.places) or self.places[pattern] is not None

    @property
    def lacks_one(self) -> bool:
        """Whether it is the plan's order, but for one pattern that no frame shows."""
        shown = [k for k, place in enumerate(self.places) if place == k]
        return len(shown) == len(self.places) - 1 and None in self.places
