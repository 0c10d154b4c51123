"""Cases of the self-test: one scene, one way to measure it, and how its errors are distributed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from fringeworks.evaluate.selftest.scenes import (
    DISTURBANCES,
    optics_of,
    stack_rig,
    view_of,
)
from fringeworks.pair.analyse import analyse
from fringeworks.pair.bound import bound_px
from fringeworks.pipeline.stacks import measure
from fringeworks.rig.triangulate import triangulate
from fringeworks.simulate.exposure import photograph
from fringeworks.simulate.optics import Optics
from fringeworks.simulate.rig_pair import pair_displacement, photograph_pair
from fringeworks.simulate.standard import fringe_plan, truth_distance
from fringeworks.simulate.virtual_rig import View
from fringeworks.stack.frames import Stack
from fringeworks.statistics.quantiles import NORMAL_MEDIAN
from fringeworks.types import BoolMap, CoordinateMap, Decoded, FloatMap, InputError, Pair

PERIOD_PX = 20.0
"""Period of a pair's fringes, projector px: 15 camera px."""
STEP_PX = 0.01
"""Change of the projector coordinate from which the change of depth is taken, px: small against a
period, large against rounding."""
ROUNDING = 1.0 / 12.0
"""Variance of rounding to whole counts, counts²."""
BORDER_PERIODS = 2.0
"""Width of the border of pairs that is not judged, periods: as in docs/methods.md."""


@dataclass(frozen=True)
class CaseResult:
    """How the errors of one case are distributed. Lengths are mm for stacks, px for pairs."""

    way: str
    """stack, or the name of a method for two frames."""
    body: str
    """plane, sphere or step."""
    disturbance: str
    """What disturbs the frames."""
    unit: str
    """mm along the camera's ray, or px of displacement."""
    measured: float
    """Share of the lit pixels that are measured, 0…1."""
    bias: float
    """Mean error."""
    deviation: float
    """Standard deviation of the errors."""
    typical: float
    """1.48 times the median of the absolute errors: the standard deviation of normal errors, which
    the few pixels at a cliff do not move."""
    sigma: float
    """Median of the stated standard deviations."""
    bound: float
    """Median of the Cramér–Rao bounds of this acquisition."""
    within_1_sigma: float
    """Share of the errors within one stated standard deviation, 0…1."""
    within_2_sigma: float
    """Share of the errors within two, 0…1."""
    gross: float
    """Share of errors beyond half a fringe period, 0…1."""
    why: str = ""
    """Why nothing was measured; empty where something was."""

    @property
    def name(self) -> str:
        """Way, body and disturbance in one line."""
        return f"{self.way}, {self.body}, {self.disturbance}"


@dataclass(frozen=True)
class _Errors:
    """Errors of one case before they are condensed, as maps (h, w)."""

    error: FloatMap
    sigma: FloatMap
    bound: FloatMap
    expected: BoolMap
    """True where a value is expected."""
    gross: BoolMap
    """True where the error is beyond half a period."""


def stack_case(body: str, disturbance: str, *, seed: int = 0) -> CaseResult:
    """Measure a body by twelve frames and a rig that is known exactly.

    Parameters
    ----------
    body : str
        One of ``scenes.BODIES``.
    disturbance : str
        One of ``scenes.DISTURBANCES``.
    seed : int
        Seed of the noise.

    Returns
    -------
    CaseResult, mm along the camera's ray.

    Notes
    -----
    The bound of N equal steps is σ_φ² = (2/N) σ²/B² (theory §5), with the noise σ that was
    simulated and not the one that was measured. Sets are combined by their inverse variances, and
    depths follow by the derivative of triangulation, taken by a difference.
    """
    settings = DISTURBANCES[disturbance]
    view = view_of(body, "stack", settings.painted)
    rig = stack_rig()
    plan = fringe_plan(rig, both=False)
    optics = optics_of(settings, seed)
    stack = Stack(list(photograph(view, plan, optics)), plan)
    try:
        found = measure(stack, rig, keep_phases=True, **settings.decode)
    except InputError as error:
        return _nothing("stack", body, disturbance, "mm", str(error))
    assert found.decoded.x is not None
    slope = _depth_per_px(view, found.decoded)
    off_px = found.decoded.x.coordinate_px - view.projector_px[..., 0]
    errors = _Errors(
        truth_distance(view.points_mm, found.points.xyz_mm),
        found.points.sigma_mm,
        _stack_bound_px(found.decoded.x, optics) * slope,
        view.lit,
        np.abs(off_px) > 0.5 * min(found.decoded.x.periods_px),
    )
    return _condensed("stack", body, disturbance, "mm", errors)


def _stack_bound_px(found: CoordinateMap, optics: Optics) -> FloatMap:
    """Cramér–Rao bound of the coordinate, (h, w), px, from the simulated noise."""
    assert found.modulations is not None
    steps = 4
    variance = optics.noise**2 + optics.gain * found.background + ROUNDING
    information = sum(
        0.5 * steps * (2.0 * np.pi / period) ** 2 * modulation**2 / variance
        for period, modulation in zip(found.periods_px, found.modulations, strict=True)
    )
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 / np.sqrt(information))


def _depth_per_px(view: View, decoded: Decoded) -> FloatMap:
    """Change of the distance along the ray with the projector's column, (h, w), mm/px."""
    assert decoded.x is not None
    known = np.isfinite(decoded.x.coordinate_px)
    points = []
    for step in (-STEP_PX, STEP_PX):
        there = np.where(known, view.projector_px[..., 0] + step, np.nan)
        moved = replace(decoded, x=replace(decoded.x, coordinate_px=there), y=None)
        points.append(triangulate(moved, view.rig).xyz_mm)
    return np.asarray(np.linalg.norm(points[1] - points[0], axis=-1) / (2.0 * STEP_PX))


def pair_cases(
    body: str, disturbance: str, methods: tuple[str, ...], *, seed: int = 0
) -> Iterator[CaseResult]:
    """Measure a body by two frames with several methods.

    Parameters
    ----------
    body : str
        One of ``scenes.BODIES``; the wall behind it is the reference plane.
    disturbance : str
        One of ``scenes.DISTURBANCES``.
    methods : tuple of str
        Names of methods.
    seed : int
        Seed of the noise.

    Yields
    ------
    CaseResult, px of displacement, for each method.

    Notes
    -----
    The bound is that of a window of a quarter of a period (``bound_px``). It is computed on the
    frames before compression: JPEG removes noise where it removes detail, and what is left of it
    says nothing about the error.
    """
    settings = DISTURBANCES[disturbance]
    wall = view_of("wall", "pair", False)
    view = view_of(body, "pair", settings.painted)
    optics = optics_of(settings, 2 * seed)
    pair = photograph_pair(wall, view, PERIOD_PX, optics)
    truth = pair_displacement(wall, view)
    raw = photograph_pair(wall, view, PERIOD_PX, replace(optics, jpeg=0)) if optics.jpeg else pair
    bound = bound_px(raw, truth)
    for method in methods:
        try:
            yield _pair_case(body, disturbance, method, pair, truth, bound)
        except InputError as error:
            yield _nothing(method, body, disturbance, "px", str(error))


def _pair_case(
    body: str, disturbance: str, method: str, pair: Pair, truth: FloatMap, bound: FloatMap
) -> CaseResult:
    found = analyse(pair, method)
    error = found.displacement_px - truth
    period = found.period_px
    border = round(BORDER_PERIODS * period)
    inner = np.zeros(truth.shape, bool)
    inner[border:-border, border:-border] = True
    errors = _Errors(
        error, found.sigma_px, bound, inner & np.isfinite(truth), np.abs(error) > 0.5 * period
    )
    return _condensed(method, body, disturbance, "px", errors)


def _condensed(way: str, body: str, disturbance: str, unit: str, maps: _Errors) -> CaseResult:
    """The figures of a case, over all pixels where a value is expected and measured."""
    ok = maps.expected & np.isfinite(maps.error)
    error, sigma, bound = maps.error[ok], maps.sigma[ok], maps.bound[ok]
    ratio = np.abs(error) / sigma
    return CaseResult(
        way,
        body,
        disturbance,
        unit,
        measured=float(ok.sum() / maps.expected.sum()),
        bias=float(error.mean()),
        deviation=float(error.std()),
        typical=float(np.median(np.abs(error)) / NORMAL_MEDIAN),
        sigma=float(np.median(sigma)),
        bound=float(np.nanmedian(bound)),
        within_1_sigma=float(np.mean(ratio <= 1.0)),
        within_2_sigma=float(np.mean(ratio <= 2.0)),
        gross=float(np.mean(maps.gross[ok])),
    )


def _nothing(way: str, body: str, disturbance: str, unit: str, why: str) -> CaseResult:
    """A case of which nothing was measured."""
    nan = float("nan")
    return CaseResult(
        way, body, disturbance, unit, 0.0, nan, nan, nan, nan, nan, nan, nan, nan, why
    )
