"""Parts measured by a recipe, and judged by its tolerances."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import lru_cache
from statistics import NormalDist
from typing import Any, Literal

import numpy as np

from fringeworks.evaluate.budget import Budget, budget_of
from fringeworks.evaluate.deviation import Deviation
from fringeworks.evaluate.monte_carlo import LEAST_DRAWS, MonteCarlo
from fringeworks.evaluate.part_areas import PartAreas, kept
from fringeworks.evaluate.quantified import Quantified
from fringeworks.evaluate.quantities import area_deviation, deviation_max
from fringeworks.evaluate.spots import find_spots
from fringeworks.files.atomic import StrPath
from fringeworks.files.provenance import source_of
from fringeworks.files.recipe import read_recipe
from fringeworks.files.rig import read_rig
from fringeworks.pipeline.inputs import capture_of
from fringeworks.pipeline.pairs import reconstruct
from fringeworks.pipeline.stacks import Measurement, measure
from fringeworks.rig.triangulate import Triangulator
from fringeworks.stack.frames import Stack
from fringeworks.types import (
    Area,
    BoolMap,
    Finding,
    FloatMap,
    Frozen,
    HeightMap,
    InputError,
    Noted,
    Pair,
    PartTolerance,
    Plotted,
    PointCloud,
    Provenance,
    Reason,
    Recipe,
    Rig,
    TriangleMesh,
    fingerprint,
    found_before,
    sealed,
    whole,
)
from fringeworks.types.numbers import SHARE, estimate, limit, number
from fringeworks.types.recipe import USUAL_RISK

Verdict = Literal["pass", "fail", "undecided"]
SPOT_PLACE_MM = 0.1
"""Standard deviation that places of spots are said with, mm: a spot covers some pixels."""
MANY_FREEDOM_K = 2.0
"""Coverage factor of 95 % for many degrees of freedom."""
QUANTITIES_AT_ONCE = 4
"""Largest number of quantities that are computed at the same time. Each takes some arrays of its
area, 100 bytes a point, and parts have few areas that are large."""

MOST_DRAWS = 1_000_000
"""Largest number of draws of a Monte Carlo: those that JCGM 101:2008, 7.2.2 takes as sufficient."""


@dataclass(frozen=True, eq=False, repr=False)
class Check(Frozen):
    """A quantity of a part, and whether it keeps to its tolerance."""

    tolerance: PartTolerance
    value: float
    """NaN where it could not be measured."""
    sigma: float
    """Standard deviation of the value; NaN where it could not be measured."""
    unit: str
    verdict: Verdict
    why: str = ""
    """Why it fails or is undecided; empty where it passes."""
    budget: Budget | None = None
    """The parts of ``sigma``; None where it was not measured, or read from a table."""
    monte_carlo: MonteCarlo | None = None
    """What Monte Carlo makes of the same; None where it was not asked for."""

    @property
    def expanded(self) -> float:
        """Expanded uncertainty U of 95 %: k σ, with k = 2 where no budget is known."""
        return MANY_FREEDOM_K * self.sigma if self.budget is None else self.budget.expanded

    def __str__(self) -> str:
        low, high = self.tolerance.low, self.tolerance.high
        limits = "…".join("" if one is None else limit(one) for one in (low, high))
        value = estimate(self.value, self.sigma, self.unit)
        return f"{self.tolerance.name}: {value} ({limits}): {self.verdict}"


@dataclass(frozen=True, eq=False, repr=False)
class Inspection(Noted, Plotted, Frozen):
    """A part that was measured and judged."""

    checks: tuple[Check, ...]
    surface: HeightMap | PointCloud
    """What was measured, within the recipe's area."""
    findings: tuple[Finding, ...]
    """What was found in the capture."""
    seconds: float
    """Time that it took."""
    recipe: Recipe = field(default_factory=Recipe)
    """The recipe: its areas, tolerances and risk."""
    faces: Mapping[str, Area] = field(default_factory=dict)
    """Pixels of the areas that are faces of the model, by name, where they were found."""

    def pixels(self, name: str) -> BoolMap | None:
        """Return the pixels of an area, (h, w); None for a face that was not found."""
        area = self.faces.get(name, self.recipe.areas[name])
        return None if area.face is not None else area.pixels(self.surface.reason.shape)

    @property
    def provenance(self) -> Provenance | None:
        """How the surface was made."""
        return self.surface.provenance

    @property
    def verdict(self) -> Verdict:
        """Fail where a check fails; undecided where none fails and one is; pass otherwise."""
        found = {check.verdict for check in self.checks}
        return "fail" if "fail" in found else "undecided" if "undecided" in found else "pass"


def inspect(
    capture: StrPath | Pair | Stack | HeightMap | PointCloud | Measurement,
    recipe: Recipe | StrPath,
    *,
    draws: int = 0,
) -> Inspection:
    """Measure a part by a recipe, and judge its tolerances.

    Parameters
    ----------
    capture : path of a capture, Pair, Stack; or a HeightMap, PointCloud or Measurement made before
    recipe : Recipe or path
    draws : int
        Number of draws of a Monte Carlo beside the budget of each quantity; 0 for none. A draw
        takes 10 to 200 ms a quantity.

    Returns
    -------
    Inspection

    Raises
    ------
    InputError for a capture or a recipe that cannot be used. An area in which too little was
    measured makes its checks undecided instead.

    Notes
    -----
    Decisions keep a guard band to each limit (ISO 14253-1). With the standard deviation s of a
    value and the z that a normal number exceeds with the recipe's risk, a value passes if it is
    inside by z s or more, fails if it is outside by as much, and is undecided between. A part that
    breaks its limit therefore passes with a probability of at most the risk, and one that keeps it
    fails with at most the same.

    Examples
    --------
    >>> import numpy as np
    >>> import fringeworks as fw
    >>> height = np.tile(np.where(np.arange(80) < 40, 0.0, 10.0), (60, 1))
    >>> sigma, reason = np.full(height.shape, 0.01), np.zeros(height.shape, np.uint8)
    >>> part = fw.HeightMap(height, sigma, reason, "height", "mm", 1.0)
    >>> areas = {
    ...     "top": fw.evaluate.Area(box=(45, 5, 75, 55)),
    ...     "base": fw.evaluate.Area(box=(5, 5, 35, 55)),
    ... }
    >>> step = fw.evaluate.PartTolerance("step", "step_height", ("top", "base"), 9.9, 10.1)
    >>> inspect(part, fw.Recipe(areas=areas, tolerances=(step,))).verdict
    'pass'
    """
    recipe = recipe if isinstance(recipe, Recipe) else read_recipe(recipe)
    started = time.perf_counter()
    surface = _measured(capture, recipe)
    findings = surface.findings
    if recipe.within is not None:
        surface = masked(surface, Area(mask=_pixels(recipe, recipe.within, surface.shape)))
        findings = tuple(
            replace(finding, seen=f"in the whole frame: {finding.seen}") for finding in findings
        )
    with found_before(findings):
        checks, faces = _judged(surface, recipe, draws)
    return Inspection(checks, surface, findings, time.perf_counter() - started, recipe, faces)


def judge_part(
    surface: HeightMap | PointCloud, recipe: Recipe, *, draws: int = 0
) -> tuple[Check, ...]:
    """Judge the tolerances of a recipe on a surface; see ``inspect``."""
    return _judged(surface, recipe, draws)[0]


def _judged(
    surface: HeightMap | PointCloud, recipe: Recipe, draws: int
) -> tuple[tuple[Check, ...], dict[str, Area]]:
    """The checks, and the pixels of areas that are faces."""
    if draws and not whole(draws, LEAST_DRAWS, MOST_DRAWS):
        raise InputError(
            f"draws: expected {LEAST_DRAWS} to {MOST_DRAWS}, or 0 for no Monte Carlo, got {draws}"
        )
    part = PartAreas(surface, recipe, rig_of(recipe) if recipe.rig else None)

    def checked(one: PartTolerance) -> Check:
        def budget(found: Quantified) -> tuple[Budget, MonteCarlo | None]:
            parts = part.budget(one, found)
            if not draws or not parts.lines:
                return parts, None
            return parts, part.monte_carlo(one, found, parts, draws=draws)

        return _checked(one, lambda: part.measure(one), recipe.risk, budget)

    # Side by side: arrays are summed without the interpreter's lock.
    with ThreadPoolExecutor(min(QUANTITIES_AT_ONCE, os.cpu_count() or 1)) as pool:
        checks = tuple(pool.map(checked, recipe.tolerances))
    return checks, part.faces_found()


def decide(found: Quantified, tolerance: PartTolerance, risk: float) -> Verdict:
    """Decide whether a value keeps to its tolerance, with a guard band to each limit.

    The range of what noise may or may not have added must lie on one side of a limit as a whole.
    """
    guards = NormalDist().inv_cdf(1.0 - risk)
    guard = guards * found.sigma
    seen_guard = guards * (found.sigma if found.seen_sigma is None else found.seen_sigma)
    low = -np.inf if tolerance.low is None else tolerance.low
    high = np.inf if tolerance.high is None else tolerance.high
    if low + guard <= found.value and found.seen <= high - seen_guard:
        return "pass"
    if found.seen < low - seen_guard or found.value > high + guard:
        return "fail"
    return "undecided"


def _checked(
    tolerance: PartTolerance,
    measure: Callable[[], Quantified],
    risk: float,
    budget: Callable[[Quantified], tuple[Budget, MonteCarlo | None]],
) -> Check:
    try:
        found = measure()
    except InputError as problem:
        return Check(tolerance, np.nan, np.nan, "", "undecided", str(problem))
    verdict = decide(found, tolerance, risk)
    why = ""
    if verdict == "fail":
        why = _why_failed(found, tolerance)
    elif verdict == "undecided":
        why = _why_undecided(found, tolerance, risk)
    return Check(tolerance, found.value, found.sigma, found.unit, verdict, why, *budget(found))


def _why_failed(found: Quantified, tolerance: PartTolerance) -> str:
    """Which limit is broken, and by how much."""
    low, high = tolerance.low, tolerance.high
    above = high is not None and found.value > high
    broken = high if above else low
    assert broken is not None
    value = found.value if above else found.seen
    unit = tolerance.unit(found.unit)
    # A share of 32 % is not "67 % below" one of 99 %.
    far = "" if unit == SHARE else f"{number(abs(value - broken), found.sigma, unit)} "
    return (
        f"{number(value, found.sigma, unit)} is {far}{'above' if above else 'below'} the "
        f"{'largest' if above else 'smallest'} allowed {limit(broken, unit)}"
    )


def _why_undecided(found: Quantified, tolerance: PartTolerance, risk: float) -> str:
    guard, unit = NormalDist().inv_cdf(1.0 - risk) * found.sigma, tolerance.unit(found.unit)
    keeps = tolerance.high is not None and found.value <= tolerance.high - guard
    if keeps and found.noise and (tolerance.low is None or found.value >= tolerance.low + guard):
        seen = number(found.seen, found.sigma, unit)
        return (
            f"{seen} is seen, noise of the points included, and it may explain all that is above "
            f"{limit(tolerance.high, unit)}: reduce the noise"
        )
    noise = (
        f", and {number(found.seen, found.sigma, unit)} with the noise of points"
        if found.noise
        else ""
    )
    return (
        f"{number(found.value, found.sigma, unit)} lies within "
        f"{number(guard, found.sigma, unit)} of a limit{noise}: reduce the uncertainty "
        "by the largest source of its budget"
    )


def _measured(
    capture: StrPath | Pair | Stack | HeightMap | PointCloud | Measurement, recipe: Recipe
) -> HeightMap | PointCloud:
    """The surface of a capture; one that was measured before as it is."""
    if isinstance(capture, Measurement):
        return capture.points
    if isinstance(capture, HeightMap | PointCloud):
        return capture
    found: Pair | Stack | tuple[Stack, ...]
    found = capture if isinstance(capture, Pair | Stack) else capture_of(capture)
    if isinstance(found, Pair):
        pair = found
        if recipe.within is not None:
            shape = _rows_and_columns(pair.object.shape)
            wanted = _pixels(recipe, recipe.within, shape)
            pair = replace(pair, mask=wanted if pair.mask is None else pair.mask & wanted)
        return reconstruct(pair, recipe.method, **recipe.options).surface
    if recipe.rig is None:
        told = "frames" if isinstance(capture, Stack) else capture
        raise InputError(
            f"{told}: expected a recipe with a rig for a stack of frames, got none: add "
            'rig = "rig.toml" to it'
        )
    return measure(found, _triangulator(rig_of(recipe)), **recipe.options).points


def judge_deviation(found: Deviation, rig: Rig | None = None) -> Check | None:
    """Judge whether a part lies within its tolerance about the model, without the farthest 0.3 %.

    The risk of a wrong decision is the usual one.

    Parameters
    ----------
    found : Deviation
    rig : Rig, optional
        The rig that it was computed with.

    Returns
    -------
    Check of the largest deviation, or of a dent or bump that surely breaks the tolerance; None
    without a tolerance, and for points that no camera orders or that have no σ.
    """
    cloud, tolerance = found.part, found.tolerance_mm
    ok = found.reason == Reason.OK
    known = isinstance(cloud, PointCloud) and bool(np.isfinite(found.sigma_mm[ok]).all())
    if tolerance is None or not known:
        return None
    one = PartTolerance("deviation", "deviation_max", ("part",), None, tolerance, 0.0)
    guard = NormalDist().inv_cdf(1.0 - USUAL_RISK)
    for spot in find_spots(found):
        size = abs(spot.depth_mm)
        if size - guard * spot.sigma_mm > tolerance:
            where = ", ".join(number(float(v), SPOT_PLACE_MM) for v in spot.place_mm)
            kind = "dent" if spot.depth_mm < 0 else "bump"
            why = f"a {kind} of {number(size, spot.sigma_mm, 'mm')} at ({where}) mm of the model"
            return Check(one, size, spot.sigma_mm, "mm", "fail", why)
    area = Area(mask=sealed(ok))
    part = kept(lambda _: area_deviation(found, area, rig))

    def budget(value: Quantified) -> tuple[Budget, None]:
        return budget_of(value, [part("")]), None

    return _checked(one, lambda: deviation_max(part("")), USUAL_RISK, budget)


def recipe_hash(recipe: Recipe) -> str:
    """Return the hash of what a recipe asks for.

    Its model's content is included; its rig and the head of reports are left out.

    Raises
    ------
    FileProblem for a model's file that cannot be read.
    """
    model = recipe.model
    told: tuple[Any, ...] = ()
    if model is not None:
        mesh = model.mesh
        content = fingerprint(mesh) if isinstance(mesh, TriangleMesh) else source_of(mesh).sha256
        told = (content, model.align, model.reach_mm)
    return fingerprint((replace(recipe, rig=None, model=None, head={}), told))


def rig_of(recipe: Recipe) -> Rig:
    """Return the rig of a recipe, from its file where it names one."""
    assert recipe.rig is not None
    return recipe.rig if isinstance(recipe.rig, Rig) else read_rig(recipe.rig)


@lru_cache(maxsize=2)
def _triangulator(rig: Rig) -> Triangulator:
    """The prepared rig: parts that are measured one after the other have the same."""
    return Triangulator(rig)


def _rows_and_columns(shape: tuple[int, ...]) -> tuple[int, int]:
    return shape[0], shape[1]


def _pixels(recipe: Recipe, name: str, shape: tuple[int, int]) -> BoolMap:
    """Pixels of an area, which is named where it has none."""
    try:
        return recipe.areas[name].pixels(shape)
    except InputError as problem:
        raise problem.at(name) from problem


def masked(surface: HeightMap | PointCloud, area: Area) -> HeightMap | PointCloud:
    """Return a surface of which only an area is measured.

    Parameters
    ----------
    surface : HeightMap or PointCloud
    area : Area
        Pixels outside of it become unmeasured, with the reason ``MASKED``.
    """
    outside = ~area.pixels(surface.shape)
    reason = np.where(outside, np.uint8(Reason.MASKED), surface.reason)

    def cut(values: FloatMap) -> FloatMap:
        where = outside[..., None] if values.ndim == 3 else outside
        return sealed(np.where(where, values.dtype.type(np.nan), values))

    if isinstance(surface, HeightMap):
        return replace(
            surface, reason=sealed(reason), values=cut(surface.values), sigma=cut(surface.sigma)
        )
    return replace(
        surface,
        reason=sealed(reason),
        xyz_mm=cut(surface.xyz_mm),
        sigma_mm=cut(surface.sigma_mm),
        noise_mm=cut(surface.noise_mm),
    )
