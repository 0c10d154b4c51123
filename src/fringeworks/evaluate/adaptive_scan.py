"""A scan that takes frames until every tolerance of a part is decided."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fringeworks.evaluate.inspect import Check, Inspection, inspect, rig_of
from fringeworks.evaluate.scan_step import LOOKS, OpenCheck, ScanState, ScanStep, next_step
from fringeworks.files.atomic import StrPath
from fringeworks.files.recipe import read_recipe
from fringeworks.pipeline.stacks import Measurement, measure
from fringeworks.rig.triangulate import Triangulator
from fringeworks.stack.frames import Stack
from fringeworks.types import (
    BoolMap,
    Finding,
    Frozen,
    InputError,
    Noted,
    Reason,
    Recipe,
    whole,
)

MOST_CAPTURES = 8
"""Largest number of captures by default. Noise falls to 35 %; errors that all captures share, and
of which σ holds a part only, then begin to matter."""
AVERAGED = ("noise",)
"""Parts of a budget that more frames average. Those of neighbours, blur, calibration and
temperature are the same in every frame."""
TOO_DARK = (Reason.LOW_MODULATION, Reason.SHADOW)
"""Reasons of pixels that a longer exposure may measure."""
BRIGHTEST = 0.999
"""Quantile of the brightness of an area that must stay below saturation."""


@dataclass(frozen=True, eq=False, repr=False)
class ScanUntil(Noted, Frozen):
    """A part that was scanned until its tolerances were decided."""

    inspection: Inspection
    """The verdicts from all captures together, at a risk that all looks of the scan share."""
    measurement: Measurement
    """The points of all captures together."""
    steps: tuple[ScanStep, ...]
    """What was taken, and at the end why no more."""
    captures: int
    """Number of captures of the plan."""
    frames: int
    """Number of frames."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was found in the frames, and what could not be decided."""
        if self.inspection.verdict != "undecided":
            return self.inspection.findings
        open_ones = [
            one.tolerance.name for one in self.inspection.checks if one.verdict == "undecided"
        ]
        told = Finding(
            "undecided",
            f"after {self.captures} captures: {self.steps[-1].why}",
            advice="calibrate with more poses, go nearer, or widen the limits",
            figures={"open": float(len(open_ones)), "captures": float(self.captures)},
        )
        return (told, *self.inspection.findings)


def scan_until(
    take: Callable[[float], Stack],
    recipe: Recipe | StrPath,
    *,
    most_captures: int = MOST_CAPTURES,
    exposures: tuple[float, float] = (1.0, 1.0),
    overhead: float = 1.0,
    progress: Callable[[ScanStep], None] = lambda _: None,
) -> ScanUntil:
    """Take captures of a part until every tolerance of a recipe is decided.

    Parameters
    ----------
    take : callable
        Takes one capture with an exposure, over that of the first capture, and returns its stack.
    recipe : Recipe or path
        With a rig, areas and tolerances.
    most_captures : int
        Largest number of captures.
    exposures : (float, float)
        Smallest and largest exposure that ``take`` can be asked for; (1, 1) for a fixed one.
    overhead : float
        Time of a frame without its exposure, over the first exposure.
    progress : callable
        Called with every step before it is taken.

    Returns
    -------
    ScanUntil

    Raises
    ------
    InputError for a recipe without a rig or tolerances, and as ``inspect``.

    Notes
    -----
    Captures are fused by the information of their own parts of σ; the part that they have in common
    is measured from their differences and stays (``fuse``). The tolerances are judged after each
    step, at most four times, each time with a quarter of the recipe's risk, so that looking several
    times does not raise it.
    """
    recipe = recipe if isinstance(recipe, Recipe) else read_recipe(recipe)
    _check(recipe, most_captures)
    strict = replace(recipe, risk=recipe.risk / LOOKS)
    prepared = Triangulator(rig_of(recipe))
    stacks: list[Stack] = []
    factors: list[float] = []
    steps = [ScanStep("first", 1, 1.0, "nothing is known yet")]
    while True:
        step = steps[-1]
        progress(step)
        for _ in range(step.captures):
            stacks.append(take(step.factor))
            factors.append(step.factor)
        measured = measure(stacks, prepared, **recipe.options)
        found = inspect(measured.points, strict)
        state = _state(found, measured, stacks[0], tuple(factors))
        state = replace(
            state,
            looks=len(steps),
            most_captures=most_captures,
            risk=recipe.risk,
            exposures=exposures,
            overhead=overhead,
        )
        steps.append(next_step(state))
        if steps[-1].kind == "stop":
            progress(steps[-1])
            frames = sum(len(one.frames) for one in stacks)
            return ScanUntil(found, measured, tuple(steps), len(stacks), frames)


def _check(recipe: Recipe, most_captures: int) -> None:
    if recipe.rig is None or not recipe.tolerances:
        raise InputError("recipe: expected a rig and tolerances, got a recipe without them")
    if not whole(most_captures, 1, 64):
        raise InputError(f"most_captures: expected 1 to 64, got {most_captures}")


def _state(
    found: Inspection,
    measured: Measurement,
    first: Stack,
    factors: tuple[float, ...],
) -> ScanState:
    """What the frames tell after some captures."""
    open_checks = [one for one in found.checks if one.verdict == "undecided"]
    reason = found.surface.reason
    inside = np.zeros(reason.shape, bool)
    opened = []
    for one in open_checks:
        where = _pixels(found, one)
        inside |= where
        opened.append(_open(one, reason[where]))
    typical, headroom = _light(measured, first, inside)
    noise = measured.decoded.noise
    return ScanState(tuple(opened), factors, noise, typical, headroom)


def _pixels(found: Inspection, check: Check) -> BoolMap:
    """Pixels of the areas of a tolerance; all where a face was not found."""
    known = [found.pixels(name) for name in check.tolerance.areas]
    parts = [one for one in known if one is not None]
    if not parts:
        return np.ones(found.surface.reason.shape, bool)
    return np.asarray(np.logical_or.reduce(parts))


def _open(check: Check, reason: Any) -> OpenCheck:
    """What keeps a tolerance open."""
    limits = [one for one in (check.tolerance.low, check.tolerance.high) if one is not None]
    gap = min(abs(check.value - one) for one in limits)
    lines = () if check.budget is None else check.budget.lines
    noise = float(np.sqrt(sum(one.sigma**2 for one in lines if one.source in AVERAGED)))
    common = float(np.sqrt(sum(one.sigma**2 for one in lines if one.source not in AVERAGED)))
    saturated = float(np.mean(reason == Reason.SATURATED)) if reason.size else 0.0
    dark = float(np.mean(np.isin(reason, TOO_DARK))) if reason.size else 0.0
    return OpenCheck(check.tolerance.name, gap, noise, common, saturated, dark)


def _light(measured: Measurement, first: Stack, inside: BoolMap) -> tuple[float, float]:
    """Typical brightness of some pixels, counts, and the factor at which they saturate."""
    maps: Sequence[Any] = list(measured.decoded.maps.values())
    peak = np.max([one.background + one.modulation for one in maps], axis=0)
    known = inside & np.isfinite(peak)
    if not known.any():
        return 1.0, 1.0
    kind = first.frames[0].dtype
    top = first.saturation
    if top is None:
        top = float(np.iinfo(kind).max) if kind.kind == "u" else float("inf")
    typical = float(np.median(maps[0].background[known]))
    brightest = float(np.quantile(peak[known], BRIGHTEST))
    return max(typical, 1e-6), max(top / max(brightest, 1e-6), 1.0) if np.isfinite(top) else 1.0
