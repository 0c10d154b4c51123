"""One analysis for all methods: load them, run one by its name, and hold what each one owes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

import fringeworks.pair.methods  # noqa: F401, registers the methods of the package
from fringeworks.pair.prepared import PreparedPair, prepare
from fringeworks.pair.registry import REGISTERED, Method, Solution
from fringeworks.types import BoolMap, DisplacementMap, FloatMap, InputError, Pair, Reason


def methods() -> dict[str, Method]:
    """All registered methods by name, in the order of registration.

    >>> "gsifa" in methods()
    True
    """
    return dict(REGISTERED)


def get_method(name: str) -> Method:
    """The method of that name; ``InputError`` lists the known ones otherwise."""
    known = methods()
    if name not in known:
        raise InputError(f"method: expected one of {', '.join(known)}, got {name!r}")
    return known[name]


def analyse(
    capture: Pair | PreparedPair, method: str = "windowed", **options: Any
) -> DisplacementMap:
    """Displacement of the fringes between the two frames of a capture.

    Parameters
    ----------
    capture : Pair or PreparedPair
        Reference and object frame; a pair that ``prepare`` made saves doing it again.
    method : str
        A name from ``methods()``.
    **options
        Keyword options of that method.

    Returns
    -------
    DisplacementMap in the orientation of the capture.

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
    pair = capture if isinstance(capture, PreparedPair) else prepare(capture)
    solution = _mark(pair, chosen.function(pair, **options))
    turn = pair.to_capture
    return DisplacementMap(
        displacement_px=turn(solution.displacement_px),
        sigma_px=turn(solution.sigma_px),
        modulation_ratio=turn(solution.modulation_ratio),
        reason=turn(solution.reason),
        period_px=pair.period,
        axis=pair.carrier.axis,
        tilt_deg=pair.carrier.tilt_deg,
        method=method,
        iterations=None if solution.iterations is None else turn(solution.iterations),
        details=solution.details,
    )


def _mark(pair: PreparedPair, solution: Solution) -> Solution:
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
        modulation_ratio=blank(solution.modulation_ratio),
        reason=reason,
    )


def _lands_on_gap(pair: PreparedPair, u: FloatMap) -> BoolMap:
    """True where the matching point of the reference was not measured."""
    if not pair.gap.any():
        return np.zeros(u.shape, bool)
    width = u.shape[1]
    with np.errstate(invalid="ignore"):
        column = np.arange(width) - np.where(np.isfinite(u), u, 0.0)
    column = np.clip(np.rint(column), 0, width - 1).astype(np.intp)
    hit: BoolMap = np.take_along_axis(pair.gap, column, axis=1)
    return hit & np.isfinite(u)
