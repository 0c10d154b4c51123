"""Which frames a scan takes next, so that every tolerance of a part is decided soon."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist
from typing import Literal

import numpy as np

from fringeworks.types import CameraNoise, Frozen
from fringeworks.types.numbers import percent, sigma_text
from fringeworks.types.recipe import USUAL_RISK

LOOKS = 4
"""Times that the tolerances are judged in one scan, at most. The risk is divided by it: each look
may err with a fourth of the stated risk, so that all together err with no more than it."""
GROWTH = 4.0
"""Largest factor by which one step multiplies the information. With ``LOOKS`` it reaches 64
captures; a larger step would rest on one uncertain value."""
RESERVE = 1.25
"""Factor by which more information is taken than is needed if the value stays where it is: it moves
by about its noise."""
LUCKY_SIGMAS = 2.0
"""Standard deviations of the noise by which the value may still move away from the limit. Where
even that decides nothing, more frames are of no use."""
HEADROOM = 0.85
"""Share of the headroom below saturation that a longer exposure uses: brightness scatters."""
LEAST_LONGER = 1.3
"""Smallest factor of an exposure that is worth a setting of its own."""
COVERAGE_FACTOR = 4.0
"""Factor of the exposure that reaches pixels which are too dark or saturated: two stops."""
MISSING = 0.02
"""Share of an area's pixels that are too dark, or saturated, from which on another exposure is
taken for an area that could not be measured."""


@dataclass(frozen=True)
class OpenCheck:
    """A tolerance that is not decided yet."""

    name: str
    gap: float
    """Distance of the value to the nearest limit, in its unit; NaN where it was not measured."""
    noise: float
    """Standard deviation by what frames average."""
    common: float
    """Standard deviation by what they do not."""
    saturated: float = 0.0
    """Share of its area's pixels that are saturated."""
    dark: float = 0.0
    """Share of its area's pixels that are too dark."""


@dataclass(frozen=True)
class ScanState:
    """What a scan knows before its next step."""

    open_checks: tuple[OpenCheck, ...]
    factors: tuple[float, ...]
    """Exposures of the captures so far, over that of the first."""
    noise: CameraNoise
    brightness: float
    """Typical brightness of the areas in the first exposure, counts."""
    headroom: float
    """Factor of the first exposure at which the brightest pixels of the areas saturate."""
    looks: int = 1
    """Times that the tolerances were judged."""
    most_captures: int = 8
    risk: float = USUAL_RISK
    """Of a wrong decision in the whole scan."""
    exposures: tuple[float, float] = (1.0, 1.0)
    """Smallest and largest exposure of the camera, over the first."""
    overhead: float = 1.0
    """Time of a frame without its exposure, over the first exposure."""


@dataclass(frozen=True, eq=False, repr=False)
class ScanStep(Frozen):
    """What a scan does next."""

    kind: Literal["first", "repeat", "longer", "shorter", "stop"]
    captures: int
    """Captures of all frames of the plan; 0 to stop."""
    factor: float
    """Their exposure, over that of the first."""
    why: str
    """For which tolerance, or why nothing more can be decided."""


def guard_factor(risk: float) -> float:
    """Standard deviations of the guard band at one look of a scan."""
    return NormalDist().inv_cdf(1.0 - risk / LOOKS)


def next_step(state: ScanState) -> ScanStep:
    """Choose what a scan does next: the step that decides a tolerance at the least time.

    Parameters
    ----------
    state : ScanState

    Returns
    -------
    ScanStep; "stop" where all is decided, where frames are used up, and where no frames decide
    what is open.

    Notes
    -----
    A tolerance is decided where the gap to its limit exceeds z standard deviations, with z from a
    quarter of the risk. Noise falls with the root of the information, the common part of σ stays.
    A capture with f times the exposure has f² σ²(I) / σ²(f I) times the information of the first.

    Examples
    --------
    >>> wide = OpenCheck("width", gap=0.02, noise=0.02, common=0.002)
    >>> state = ScanState((wide,), (1.0,), CameraNoise(1.0, 0.0), 80.0, 1.0)
    >>> next_step(state).kind, next_step(state).captures
    ('repeat', 3)
    """
    left = state.most_captures - len(state.factors)
    if not state.factors:
        return ScanStep("first", 1, 1.0, "nothing is known yet")
    if not state.open_checks:
        return ScanStep("stop", 0, 1.0, "all tolerances are decided")
    if left <= 0 or state.looks >= LOOKS:
        names = ", ".join(one.name for one in state.open_checks)
        return ScanStep("stop", 0, 1.0, f"{names}: all frames that were allowed are taken")
    steps, reasons = [], []
    for one in state.open_checks:
        found = _for_coverage(one, state) or _for_noise(one, state, left)
        if found.kind == "stop":
            reasons.append(found.why)
        else:
            steps.append((_seconds(found, state), found))
    if not steps:
        return ScanStep("stop", 0, 1.0, "; ".join(reasons))
    return min(steps, key=lambda pair: pair[0])[1]


def _seconds(step: ScanStep, state: ScanState) -> float:
    """Time of a step, in first exposures for each frame of the plan."""
    return step.captures * (state.overhead + step.factor)


def _for_coverage(one: OpenCheck, state: ScanState) -> ScanStep | None:
    """Another exposure for an area that is too dark or saturated, or nothing.

    None for a value that was measured with noise, which further frames average.
    """
    if np.isfinite(one.gap) and one.noise > 0.0:
        return None
    low, high = state.exposures
    taken = state.factors
    if one.saturated > max(MISSING, one.dark):
        factor = max(min(taken) / COVERAGE_FACTOR, low)
        if factor < min(taken) / LEAST_LONGER:
            return ScanStep("shorter", 1, factor, f"{one.name}: {percent(one.saturated)} saturated")
    elif one.dark > MISSING:
        factor = min(max(taken) * COVERAGE_FACTOR, high)
        if factor > max(taken) * LEAST_LONGER:
            return ScanStep("longer", 1, factor, f"{one.name}: {percent(one.dark)} too dark")
    return ScanStep("stop", 0, 1.0, f"{one.name}: more frames from here change nothing")


def _for_noise(one: OpenCheck, state: ScanState, left: int) -> ScanStep:
    """Frames that average the noise until a value is away from its limit."""
    z = guard_factor(state.risk)
    lucky = one.gap + LUCKY_SIGMAS * one.noise
    if lucky <= z * one.common:
        return ScanStep(
            "stop",
            0,
            1.0,
            f"{one.name}: it lies so near to a limit that the part of σ which no frames average, "
            "such as that of the calibration, is too large",
        )
    known = sum(information(state, factor) for factor in state.factors)
    needed = known * _ratio(one, one.gap, z) * RESERVE
    factor = _longer(state)
    more = min(needed, GROWTH * known) - known
    found = []
    for size, kind in ((1.0, "repeat"), (factor, "longer")):
        if kind == "repeat" or size > LEAST_LONGER:
            count = int(np.clip(np.ceil(more / information(state, size)), 1, left))
            noise, gap = sigma_text(one.noise), sigma_text(one.gap)
            why = f"{one.name}: σ of {noise} by noise, {gap} from a limit"
            found.append(ScanStep(kind, count, size, why))  # type: ignore[arg-type]
    return min(found, key=lambda step: _seconds(step, state))


def _ratio(one: OpenCheck, gap: float, z: float) -> float:
    """Information that decides a value at a distance to its limit, over that which is there."""
    target = (gap / z) ** 2 - one.common**2
    return float("inf") if target <= 0.0 else one.noise**2 / target


def _longer(state: ScanState) -> float:
    """The longest exposure that saturates nothing in the areas, over the first."""
    return float(max(min(HEADROOM * state.headroom, state.exposures[1]), 1.0))


def information(state: ScanState, factor: float) -> float:
    """Information of a capture with an exposure, over that of the first exposure."""
    first = float(state.noise.variance(state.brightness))
    if not first > 0.0:
        return factor**2
    return float(factor**2 * first / float(state.noise.variance(factor * state.brightness)))
