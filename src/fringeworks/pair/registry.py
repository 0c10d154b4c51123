"""The methods by name. A new method is one function with the ``method`` decorator on it."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from fringeworks.types import ByteMap, FloatMap, Frozen, InputError

MethodOption = str | float | int | bool | Sequence[float] | None
"""Value of a method's keyword option."""


@dataclass(frozen=True)
class Smoothing:
    """A Gaussian kernel that a method smooths a displacement with."""

    width_px: tuple[float, float]
    """Width σ along y and x, px; 0 for none."""
    corrected_over_px: tuple[float, float] | None = None
    """Width σ along y and x of the mean of the curvature, px, where the method corrects for the
    curvature that it has measured; None where it does not."""
    share: float = 1.0
    """Share of what the kernel removes that is missing in the result, 0…1."""


@dataclass(frozen=True, eq=False, repr=False)
class Solution(Frozen):
    """The result of a method, in the orientation of the ``PreparedPair`` that it was given."""

    displacement_px: FloatMap
    """u, (h, w), px; NaN where it cannot be measured."""
    sigma_px: FloatMap
    """Standard deviation of u, (h, w), px."""
    modulation_ratio: FloatMap
    """Modulation over that of the reference frame, (h, w)."""
    reason: ByteMap
    """``Reason`` per pixel, (h, w)."""
    iterations: ByteMap | None = None
    """Refinement steps of each pixel, (h, w), where the method iterates."""
    albedo: FloatMap | None = None
    """Albedo of the object over that of the reference, (h, w) > 0, where the method has found paint
    with hard edges."""
    walls: ByteMap | None = None
    """1 for the pixels on either side of a cliff, else 0, (h, w), where the method has found
    cliffs."""
    details: dict[str, Any] = field(default_factory=dict)
    """Figures for reports."""
    noise_length_px: tuple[float, float] = (0.0, 0.0)
    """Width σ of the Gaussian kernel along y and x that correlates the errors, px; 0 for none."""
    smoothing: tuple[Smoothing, ...] = ()
    """Kernels that smooth the displacement; σ is enlarged by what they remove from the surface. The
    reference's modulation has passed the first one only."""
    converged: bool = True
    """False where an iteration of the method reached its largest number of steps."""
    is_filter: bool = False
    """Whether the method is a linear filter: its σ is then that of white noise in the frames, which
    the scatter of the result replaces, and its modulation ratio shows the same noise."""


Analysis = Callable[..., Solution]


@dataclass(frozen=True)
class Method:
    """A fringe analysis of two frames."""

    name: str
    summary: str
    """First line of the function's docstring."""
    function: Analysis

    @property
    def options(self) -> dict[str, Any]:
        """Keyword options and their defaults."""
        parameters = inspect.signature(self.function).parameters.values()
        return {p.name: p.default for p in parameters if p.kind is p.KEYWORD_ONLY}


REGISTERED: dict[str, Method] = {}
"""The methods that ``method`` has registered so far. ``fringeworks.methods()`` loads the package's
own and those of installed plug-ins first."""


def method(name: str) -> Callable[[Analysis], Analysis]:
    """Register a fringe analysis under a name; users call ``fringeworks.method``."""

    def register(function: Analysis) -> Analysis:
        taken = REGISTERED.get(name)
        if taken is not None and not _same(taken.function, function):
            raise InputError(
                f"method {name!r}: expected a name that is free, got that of "
                f"{taken.function.__module__}.{taken.function.__qualname__}"
            )
        summary = (inspect.getdoc(function) or "").split("\n", 1)[0]
        entry = Method(name, summary, function)
        bare = [option for option, default in entry.options.items() if default is inspect._empty]
        if bare:
            raise InputError(f"method {name!r}: expected defaults for all options, got {bare[0]}")
        REGISTERED[name] = entry
        return function

    return register


def _same(one: Analysis, other: Analysis) -> bool:
    """Whether a function is registered again, as when its file is loaded twice."""
    return (one.__module__, one.__qualname__, inspect.getsourcefile(one)) == (
        other.__module__,
        other.__qualname__,
        inspect.getsourcefile(other),
    )
