"""The methods by name. A new method is one function with the ``method`` decorator on it."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from fringeworks.types import ByteMap, FloatMap


@dataclass(frozen=True)
class Solution:
    """What a method hands back, in the orientation of the ``PreparedPair``."""

    displacement_px: FloatMap
    sigma_px: FloatMap
    modulation_ratio: FloatMap
    reason: ByteMap
    iterations: ByteMap | None = None
    details: dict[str, Any] = field(default_factory=dict)


Analysis = Callable[..., Solution]


@dataclass(frozen=True)
class Method:
    """A fringe analysis: its name, one line about it, the function and its options."""

    name: str
    summary: str
    function: Analysis

    @property
    def options(self) -> dict[str, Any]:
        """Keyword options and their defaults."""
        parameters = inspect.signature(self.function).parameters.values()
        return {p.name: p.default for p in parameters if p.kind is p.KEYWORD_ONLY}


REGISTERED: dict[str, Method] = {}
"""What ``method`` registered so far; ``fringeworks.methods()`` loads all there are first."""


def method(name: str) -> Callable[[Analysis], Analysis]:
    """Register an analysis of two frames under a name; its docstring's first line describes it."""

    def register(function: Analysis) -> Analysis:
        summary = (inspect.getdoc(function) or "").split("\n", 1)[0]
        REGISTERED[name] = Method(name, summary, function)
        return function

    return register
