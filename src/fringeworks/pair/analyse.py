"""One analysis for all methods: load them, run one by its name, and hold what each one owes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

import fringeworks.pair.methods  # noqa: F401, registers the methods of the package
from fringeworks.pair import registry
from fringeworks.pair.plugins import load_installed
from fringeworks.pair.prepared import PreparedPair, prepare
from fringeworks.pair.projector_light import noise_factor
from fringeworks.pair.registry import Method, MethodOption, Solution
from fringeworks.pair.scatter import with_measured_sigma
from fringeworks.types import (
    BoolMap,
    DisplacementMap,
    FloatMap,
    InputError,
    Pair,
    Reason,
    UnknownMethod,
    sealed,
)


def methods() -> dict[str, Method]:
    """All registered methods by name, in the order of registration.

    Returns
    -------
    The package's own methods, those of installed plug-ins (entry points of the group
    ``fringeworks.methods``) and those that the caller registered.

    Raises
    ------
    InputError for a plug-in that cannot be loaded.

    Examples
    --------
    >>> "gsifa" in methods()
    True
    """
    load_installed()
    return dict(registry.REGISTERED)


def get_method(name: str) -> Method:
    """The method of that name; ``UnknownMethod`` lists the known ones otherwise."""
    known = methods()
    if name not in known:
        raise UnknownMethod(f"method: expected one of {', '.join(known)}, got {name!r}")
    return known[name]


def analyse(
    pair: Pair | PreparedPair, method: str = "windowed", **options: MethodOption
) -> DisplacementMap:
    """Displacement of the fringes between the two frames of a pair.

    Parameters
    ----------
    pair : Pair or PreparedPair
        Reference and object frame. A pair that ``prepare`` made is not prepared again.
    method : str
        A name from ``methods()``.
    **options
        Keyword options of that method.

    Returns
    -------
    DisplacementMap in the orientation of the frames.

    Raises
    ------
    UnknownMethod for an unknown method or option; InputError for frames that cannot be used, and
    for a method that returns something wrong.

    Examples
    --------
    >>> from fringeworks.simulate import standard_scene
    >>> found = analyse(standard_scene("parabola", size=64, fringes=4), "fourier", width=0.5)
    >>> found.displacement_px.shape
    (64, 64)
    """
    chosen = get_method(method)
    _check_options(chosen, options)
    prepared = pair if isinstance(pair, PreparedPair) else prepare(pair)
    solution = _painted(prepared, _run(chosen, prepared, options))
    solution = _mark(prepared, solution)
    solution = with_measured_sigma(solution, prepared.period)
    if prepared.plane_sigma_px is not None:
        sigma = np.hypot(solution.sigma_px, prepared.plane_sigma_px)
        solution = replace(solution, sigma_px=sigma.astype(solution.sigma_px.dtype, copy=False))
    turn = prepared.to_capture
    return DisplacementMap(
        displacement_px=turn(solution.displacement_px),
        sigma_px=turn(solution.sigma_px),
        modulation_ratio=turn(solution.modulation_ratio),
        reason=turn(solution.reason),
        period_px=prepared.period,
        axis=prepared.carrier.axis,
        tilt_deg=prepared.carrier.tilt_deg,
        method=method,
        iterations=None if solution.iterations is None else turn(solution.iterations),
        albedo=None if solution.albedo is None else turn(solution.albedo),
        walls=None if solution.walls is None else turn(solution.walls),
        converged=solution.converged and prepared.converged,
        details=solution.details,
    )


def _run(chosen: Method, prepared: PreparedPair, options: dict[str, MethodOption]) -> Solution:
    """Call a method and check what it returns; a fault in one from outside is told in a sentence
    that names it."""
    try:
        returned = chosen.function(prepared, **options)
    except InputError:
        raise
    except Exception as error:
        module = chosen.function.__module__
        if module.startswith("fringeworks."):
            raise
        raise InputError(
            f"method {chosen.name}, from outside ({module}): {type(error).__name__}: {error}"
        ) from error
    return _checked(chosen, returned, prepared.object.shape)


def _check_options(chosen: Method, options: dict[str, MethodOption]) -> None:
    known = chosen.options
    for name, value in options.items():
        if name not in known:
            raise UnknownMethod(
                f"method {chosen.name}: unknown option {name}; it has {', '.join(known) or 'none'}"
            )
        default = known[name]
        for kind, told in ((bool, "true or false"), (str, "a word"), ((int, float), "a number")):
            if isinstance(default, kind):
                if not isinstance(value, kind) or isinstance(value, bool) != (kind is bool):
                    raise InputError(
                        f"method {chosen.name}: {name}: expected {told}, got {value!r}"
                    )
                break


def _checked(chosen: Method, returned: Any, shape: tuple[int, ...]) -> Solution:
    """Refuse what a method must not return, in one sentence that names the method."""
    if not isinstance(returned, Solution):
        raise InputError(
            f"method {chosen.name}: expected a fringeworks.pair.Solution to be returned, got "
            f"{type(returned).__name__}"
        )
    floats = ("displacement_px", "sigma_px", "modulation_ratio", "albedo")
    optional = ("iterations", "albedo", "walls")
    for name in ("displacement_px", "sigma_px", "modulation_ratio", "reason", *optional):
        value = getattr(returned, name)
        if value is None and name in optional:
            continue
        kind = "f" if name in floats else "u"
        wanted = "floats" if kind == "f" else "uint8"
        if not isinstance(value, np.ndarray) or value.dtype.kind != kind or value.shape != shape:
            came = (
                f"{value.dtype} {value.shape}"
                if isinstance(value, np.ndarray)
                else type(value).__name__
            )
            raise InputError(
                f"method {chosen.name}: expected {name} as {wanted} of shape {shape}, got {came}"
            )
    return returned


def _painted(pair: PreparedPair, solution: Solution) -> Solution:
    """Scale σ and modulation of a method that saw the object divided by its albedo."""
    if pair.albedo is None or solution.albedo is not None:
        return solution
    factor = noise_factor(pair.albedo, pair.object_ok, 0.5 * pair.period)
    return replace(
        solution,
        sigma_px=solution.sigma_px * factor,
        modulation_ratio=solution.modulation_ratio * pair.albedo,
        albedo=pair.albedo,
    )


def _mark(pair: PreparedPair, solution: Solution) -> Solution:
    """Keep the contract of all methods: masked pixels stay masked, failed ones have a reason."""
    u = solution.displacement_px
    missing = np.isnan(u)
    reason = solution.reason.copy()
    if missing.any():
        reason[missing & (reason == Reason.OK)] = Reason.UNDETERMINED
        if pair.saturated.any():
            reason[pair.saturated & missing] = Reason.SATURATED
    empty = pair.object_empty | _lands_on(pair.reference_empty, u)
    reason[empty] = Reason.LOW_MODULATION
    unwanted = _lands_on(pair.gap, u) | ~pair.wanted
    if unwanted.any():
        reason[unwanted] = Reason.MASKED
    failed = reason != Reason.OK
    any_failed = bool(failed.any())

    def blank(values: FloatMap) -> FloatMap:
        if not any_failed:
            return values
        return sealed(np.where(failed, np.nan, values).astype(values.dtype, copy=False))

    return replace(
        solution,
        displacement_px=blank(u),
        sigma_px=blank(solution.sigma_px),
        modulation_ratio=blank(solution.modulation_ratio),
        reason=sealed(reason),
    )


def _lands_on(places: BoolMap, u: FloatMap) -> BoolMap:
    """True where the matching point of the reference lies on one of the marked places."""
    if not places.any():
        return np.zeros(u.shape, bool)
    width = u.shape[1]
    with np.errstate(invalid="ignore"):
        column = np.arange(width) - np.where(np.isfinite(u), u, 0.0)
    column = np.clip(np.rint(column), 0, width - 1).astype(np.intp)
    hit: BoolMap = np.take_along_axis(places, column, axis=1)
    return hit & np.isfinite(u)
