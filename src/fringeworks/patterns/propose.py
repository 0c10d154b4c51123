"""Which plan gives the smallest error for a number of frames: proposals with their predicted σ."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fringeworks.patterns.order_chain import TURN, separation
from fringeworks.patterns.plan import Block, GrayCode, PatternPlan, PhaseSteps, equal_steps
from fringeworks.types import Axis, InputError

SAFETY = 6.0
"""Standard deviations of room that every rounding of an order has in a proposal."""
END_PX = 2.0
"""By how much phases repeat later than the projector ends, px: its two ends stay apart."""
MAX_SETS = 4
COARSER = 0.94
"""Factor by which the number of fringes goes down until a plan is safe."""


@dataclass(frozen=True)
class Proposal:
    """A plan, and what to expect of it."""

    kind: str
    """hierarchical, heterodyne, number-theoretic, or gray (phase with Gray code)."""
    plan: PatternPlan
    sigma_px: float
    """Predicted standard deviation of the coordinate, projector px; the larger of the axes."""
    margin: float
    """Least room of a rounding of a fringe order, in standard deviations."""

    @property
    def summary(self) -> str:
        """Periods and steps in one line."""
        parts = []
        for block in self.plan.blocks:
            if isinstance(block, PhaseSteps):
                parts.append(f"{block.axis}: {block.period_px:.4g} px × {block.frames}")
            elif isinstance(block, GrayCode):
                parts.append(f"{block.axis}: Gray, {block.bits} bits of {block.step_px:.4g} px")
        return ", ".join(parts)


def propose(
    width_px: int,
    height_px: int,
    frames: int,
    *,
    axes: Sequence[Axis] = ("x",),
    noise: float = 2.0,
    modulation: float = 100.0,
    min_period_px: float = 16.0,
) -> list[Proposal]:
    """The best plan of every kind, the smallest predicted error first.

    Parameters
    ----------
    width_px, height_px : int
        Projector.
    frames : int
        Frames to spend, shared evenly by the axes; ≥ 3 per axis.
    axes : "x", "y" or both
    noise : float > 0
        Standard deviation of a camera count.
    modulation : float > 0
        B of the fringes, counts; take that of the darkest surface that matters.
    min_period_px : float ≥ 2
        Shortest period that projector and camera still resolve, projector px.

    Returns
    -------
    Proposals that leave every fringe order six standard deviations of room.

    Raises
    ------
    InputError where no plan does.

    Notes
    -----
    σ = (Σ (N_m / 2) (2π B / (p_m σ_I))²)^−½, the inverse-variance mean of all sets (theory §5).
    """
    if not axes or any(axis not in ("x", "y") for axis in axes):
        raise InputError(f"axes: expected x, y or both, got {axes}")
    for name, value in (("noise", noise), ("modulation", modulation)):
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"{name}: expected > 0 counts, got {value}")
    if not min_period_px >= 2:
        raise InputError(f"min_period: expected 2 px or more, got {min_period_px}")
    share = frames // len(axes)
    if share < 3:
        raise InputError(f"frames: expected 3 or more for each axis, got {frames}")
    ratio = noise / modulation
    found: dict[str, Proposal] = {}
    for kind in ("hierarchical", "heterodyne", "number-theoretic", "gray"):
        per_axis = [
            _best(kind, axis, width_px if axis == "x" else height_px, share, ratio, min_period_px)
            for axis in axes
        ]
        blocks: list[Block] = []
        for best in per_axis:
            if best is None:
                break
            blocks += best
        else:
            plan = PatternPlan(width_px, height_px, tuple(blocks))
            margin = min(plan.chain(axis).margin(_sigmas(plan, axis, ratio)) for axis in axes)
            sigma = max(_predicted(plan, axis, ratio) for axis in axes)
            found[kind] = Proposal(kind, plan, sigma, margin)
    if not found:
        raise InputError(
            f"plan: no choice of {frames} frames resolves the projector with six standard "
            f"deviations of room at noise {noise:g} and modulation {modulation:g}: expected more "
            "frames or light"
        )
    return sorted(found.values(), key=lambda proposal: proposal.sigma_px)


def _sigmas(plan: PatternPlan, axis: Axis, ratio: float) -> list[float]:
    """Standard deviation of every phase, rad."""
    return [ratio / math.sqrt(block.precision) for _, block in plan.phase_sets(axis)]


def _predicted(plan: PatternPlan, axis: Axis, ratio: float) -> float:
    return _sigma([b.period_px for _, b in plan.phase_sets(axis)], _sigmas(plan, axis, ratio))


def _sigma(periods: Sequence[float], sigmas: Sequence[float]) -> float:
    pairs = zip(periods, sigmas, strict=True)
    return 1.0 / math.sqrt(sum((TURN / (period * sigma)) ** 2 for period, sigma in pairs))


def _best(
    kind: str, axis: Axis, length: int, frames: int, ratio: float, least: float
) -> list[Block] | None:
    """Blocks of the kind with the smallest error; None where none is safe."""
    if kind == "gray":
        options = _gray(axis, length, frames, least)
    else:
        options = _phases(kind, axis, length, frames, ratio, least)
    best, smallest = None, math.inf
    for blocks in options:
        sets = [b for b in blocks if isinstance(b, PhaseSteps)]
        sigmas = [ratio / math.sqrt(b.precision) for b in sets]
        sigma = _sigma([b.period_px for b in sets], sigmas)
        if sigma >= smallest:
            continue
        size = (length, 2) if axis == "x" else (2, length)
        try:
            margin = PatternPlan(*size, tuple(blocks)).chain(axis).margin(sigmas)
        except InputError:
            continue
        if margin >= SAFETY:
            best, smallest = blocks, sigma
    return best


def _gray(axis: Axis, length: int, frames: int, least: float) -> Iterator[list[Block]]:
    """Code cells of half a period: the border of a cell is never that of a period."""
    for steps in range(3, frames):
        bits = frames - steps
        step = max(length / 2**bits, 0.5 * least)
        if bits > math.ceil(math.log2(length / step)):
            continue
        yield [
            PhaseSteps(axis, 2.0 * step, equal_steps(steps)),
            GrayCode(axis, step, length),
        ]


def _shares(frames: int, sets: int) -> list[list[int]]:
    """Steps of every set, the finest first: evenly, and as many as possible for the finest."""
    if frames < 3 * sets:
        return []
    even = [frames // sets + (1 if k < frames % sets else 0) for k in range(sets)]
    steep = [frames - 3 * (sets - 1)] + [3] * (sets - 1)
    return [even] if even == steep else [even, steep]


def _phases(
    kind: str, axis: Axis, length: int, frames: int, ratio: float, least: float
) -> Iterator[list[Block]]:
    span = length + END_PX
    for sets in range(2, MAX_SETS + 1):
        for steps in _shares(frames, sets):
            weights = [0.5 * n * (TURN / ratio) ** 2 for n in steps]
            count = span / least
            while count > sets:
                periods = _periods(kind, span, count, sets, weights)
                if periods and 0.5 * separation(periods, length, weights) >= SAFETY:
                    yield [
                        PhaseSteps(axis, p, equal_steps(n))
                        for p, n in zip(periods, steps, strict=True)
                    ]
                    break
                count *= COARSER


def _periods(
    kind: str, span: float, count: float, sets: int, weights: Sequence[float]
) -> list[float] | None:
    """Periods of a kind with about ``count`` fringes in the finest, the finest first."""
    if kind == "hierarchical":
        # Whole numbers of fringes: all phases repeat where the longest does.
        step = int(count) ** (1.0 / (sets - 1))
        return [span / max(1, round(step ** (sets - 1 - k))) for k in range(sets)]
    if kind == "heterodyne":
        return _heterodyne(span, int(count), sets, weights)
    return _whole_periods(span, math.ceil(span / count), sets)


def _heterodyne(span: float, count: int, sets: int, weights: Sequence[float]) -> list[float] | None:
    """Numbers of fringes close to each other whose phases differ most over the range."""
    if sets > 3 or count < 3:
        return None
    reach = range(1, max(2, count // 3))
    choices: list[tuple[int, ...]] = [(count, count - 1)]
    if sets == 3:
        choices = [(count, count - a, count - b) for a in reach for b in reach if b > a]
    whole = [c for c in choices if c[-1] >= 1 and math.gcd(*c) == 1]
    if not whole:
        return None
    best = max(whole, key=lambda c: separation([span / n for n in c], span - END_PX, weights))
    return [span / n for n in best]


def _whole_periods(span: float, shortest: int, sets: int) -> list[float] | None:
    """Whole periods of a few pixels without a common divisor (Chinese remainder theorem)."""
    periods = [shortest]
    while len(periods) < sets:
        following = periods[-1] + 1
        while any(math.gcd(following, p) > 1 for p in periods):
            following += 1
        periods.append(following)
    return [float(p) for p in periods] if np.prod(periods) >= span else None
