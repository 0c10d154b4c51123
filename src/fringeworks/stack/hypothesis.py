"""A hypothesis about a stack: the patterns of its frames, and which frame shows which of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import Block, PatternPlan
from fringeworks.stack.kernel_settings import Decoding, decoding_of
from fringeworks.types import Axis, BoolMap, InputError

Places = tuple[int | None, ...]


@dataclass(frozen=True)
class Hypothesis:
    """Patterns, the frames that show them, and the fault of a capture that would make it."""

    plan: PatternPlan
    """Patterns that the frames show: those of the plan, or others."""
    places: Places
    """Frame of the stack that shows each pattern; None where none does."""
    kind: str = ""
    words: str = ""
    """The fault in words."""
    advice: str = ""
    changes: int = 0
    """Number of conventions that differ from the plan's, for an order of another program."""
    exchanged: bool = False
    """Whether columns and rows change places."""
    moves_px: Mapping[Axis, tuple[float, ...]] = field(default_factory=dict, compare=False)
    """Shift of the image along the lines of an axis in every frame of the stack, camera px."""
    exposure: tuple[int, float] | None = None
    """A frame of the stack whose exposure is another, and how many times that of the others."""
    explained: float = field(default=0.0, compare=False)
    """Share that it explains of what contradicts the plan, of the votes that it changes."""
    band: Mapping[Axis, BoolMap] = field(default_factory=dict, compare=False)
    """Votes that see it along each axis; all of all axes where empty."""

    @classmethod
    def of(cls, plan: PatternPlan) -> Hypothesis:
        """The plan itself."""
        return cls(plan, tuple(range(plan.frames)))

    @property
    def lacks_one(self) -> bool:
        """Whether every frame has its place, but for one pattern that no frame shows."""
        shown = [k for k, place in enumerate(self.places) if place == k]
        return len(shown) == len(self.places) - 1 and None in self.places


def changed(plan: PatternPlan, others: Mapping[int, Block]) -> PatternPlan:
    """The plan with other blocks at the places of those that begin at some frames."""
    return replace(plan, blocks=tuple(others.get(first, block) for first, block in plan.placed))


def decoding_under(plan: PatternPlan, axis: Axis, planned: Decoding) -> Decoding | None:
    """The decoding of other patterns, with the cells that the camera resolves of the planned ones;
    None where the patterns do not determine a coordinate."""
    try:
        found = decoding_of(plan, axis, absolute=planned.absolute, response=None)
    except InputError:
        return None
    gray, seen = found.gray, planned.gray
    if gray is not None and seen is not None:
        finer = int(np.log2(max((seen.resolved_px or 0.0) / gray.step_px, 1.0)))
        if finer >= len(gray.bits):
            return None
        gray = replace(
            gray.without_finest(finer),
            blurred_px=seen.blurred_px,
            doubt_share=seen.doubt_share,
        )
    return replace(found, gray=gray)


def filled(plan: PatternPlan, frames: int, kind: str, words: str) -> Hypothesis:
    """Other patterns, shown by the frames of the stack one after another as far as they go."""
    places = tuple(k if k < frames else None for k in range(plan.frames))
    return Hypothesis(plan, places, kind, words)


def lagged(n: int, lag: int) -> tuple[Places, Places]:
    """Places of n frames that are late; the ends show the next scan, or no pattern."""
    within = tuple(k + lag if 0 <= k + lag < n else None for k in range(n))
    return tuple((k + lag) % n for k in range(n)), within


def moved_back(plane: NDArray[Any], moved_px: float) -> NDArray[Any]:
    """Lines of an image that moved along them by a distance, as they were before."""
    whole, share = int(np.floor(moved_px)), np.float32(moved_px % 1.0)
    if not share:
        return np.roll(plane, -whole, axis=1)
    near, far = (np.roll(plane.astype(np.float32), -whole - k, axis=1) for k in (0, 1))
    return np.asarray(near + share * (far - near))
