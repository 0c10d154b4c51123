"""The methods by name. A new method is one function with the ``method`` decorator on it."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fringeworks.analysis.pair import FringePair, prepare
from fringeworks.types import BoolMap, ByteMap, Capture, FloatMap, InputError, PhaseMap, Reason


@dataclass(frozen=True)
class Solution:
    """What a method hands back, in the orientation of the ``FringePair``."""

    displacement_px: FloatMap
    sigma_px: FloatMap
    gain: FloatMap
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


_METHODS: dict[str, Method] = {}


def method(name: str) -> Callable[[Analysis], Analysis]:
    """Register an analysis of two frames under a name; its docstring's first line describes it."""

    def register(function: Analysis) -> Analysis:
        summary = (inspect.getdoc(function) or "").split("\n", 1)[0]
        _METHODS[name] = Method(name, summary, function)
        return function

    return register


def methods() -> dict[str, Method]:
    """All registered methods by name, in the order of registration.

    >>> "gsifa" in methods()
    True
    """
    return dict(_METHODS)


def get_method(name: str) -> Method:
    """The method of that name; ``InputError`` lists the known ones otherwise."""
    if name not in _METHODS:
        raise InputError(f"method: expected one of {', '.join(_METHODS)}, got {name!r}")
    return _METHODS[name]


def analyse(capture: Capture | FringePair, method: str = "windowed", **options: Any) -> PhaseMap:
    """Displacement of the fringes between the two frames of a capture.

    Parameters
    ----------
    capture : Capture or FringePair
        Reference and object frame; a pair that ``prepare`` made saves doing it again.
    method : str
        A name from ``methods()``.
    **options
        Keyword options of that method.

    Returns
    -------
    PhaseMap in the orientation of the capture.

    Raises
    ------
    InputError for frames that cannot be used, an unknown method or an unknown option.
    """
    chosen = get_method(method)
    unknown = set(options) - set(chosen.options)
    if unknown:
        known = ", ".join(chosen.options) or "none"
        raise InputError(
            f"method {method}: unknown option {', '.join(sorted(unknown))}; it has {known}"
        )
    pair = capture if isinstance(capture, FringePair) else prepare(capture)
    solution = _mark(pair, chosen.function(pair, **options))
    turn = pair.to_capture
    return PhaseMap(
        displacement_px=turn(solution.displacement_px),
        sigma_px=turn(solution.sigma_px),
        gain=turn(solution.gain),
        reason=turn(solution.reason),
        period_px=pair.period,
        axis=pair.carrier.axis,
        tilt_deg=pair.carrier.tilt_deg,
        method=method,
        iterations=None if solution.iterations is None else turn(solution.iterations),
        details=solution.details,
    )


def _mark(pair: FringePair, solution: Solution) -> Solution:
    """What every method owes: masked pixels stay masked, and no value without its σ and reason."""
    u = solution.displacement_px
    missing = np.isnan(u)
    reason = solution.reason.copy()
    if missing.any():
        reason[missing & (reason == Reason.OK)] = Reason.UNDETERMINED
        if pair.saturated.any():
            reason[pair.saturated & missing] = Reason.SATURATED
    unwanted = _lands_on_gap(pair, u) | ~pair.wanted
    if unwanted.any():
        reason[unwanted] = Reason.MASKED
    failed = reason != Reason.OK
    any_failed = bool(failed.any())

    def blank(values: FloatMap) -> FloatMap:
        if not any_failed:
            return values
        return np.where(failed, np.nan, values).astype(values.dtype, copy=False)

    return replace(
        solution,
        displacement_px=blank(u),
        sigma_px=blank(solution.sigma_px),
        gain=blank(solution.gain),
        reason=reason,
    )


def _lands_on_gap(pair: FringePair, u: FloatMap) -> BoolMap:
    """True where the matching point of the reference was not measured."""
    if not pair.gap.any():
        return np.zeros(u.shape, bool)
    width = u.shape[1]
    with np.errstate(invalid="ignore"):
        column = np.arange(width) - np.where(np.isfinite(u), u, 0.0)
    column = np.clip(np.rint(column), 0, width - 1).astype(np.intp)
    hit: BoolMap = np.take_along_axis(pair.gap, column, axis=1)
    return hit & np.isfinite(u)
