"""Proposals of plans: the smallest predicted error for a given number of frames."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from fringeworks.patterns.gray_code import FRAME_MINUS_MEAN, finest_cell
from fringeworks.patterns.order_chain import TURN, separation
from fringeworks.patterns.plan import (
    COLOURS,
    SOLID,
    Block,
    GrayCode,
    PatternPlan,
    PhaseSteps,
    Uniform,
    check_projector,
    equal_steps,
)
from fringeworks.types import Axis, Frozen, InputError

MIN_MARGIN = 6.0
"""Margin that every rounding of a fringe order has in a proposal, in standard deviations.

One more than decoding demands (``ORDER_SIGMAS``), so that a surface a sixth darker than expected
still decodes. At this margin, less than 1 % of the projector is lost because noise could wrap the
first combination from one end to the other.
"""

COLOUR_NOISE = (1.0 + 1.125 + 0.25) ** 0.5
"""Noise of steps in colours over that of grey ones, for channels of equal light without crosstalk.

The solid pictures are as noisy as the others. Each counts with the share of its light, whose mean
square is 3/8 for a step, and black with ½. Crosstalk and coloured objects make more.
"""

MAX_TRIALS = 12
"""Largest number of choices of periods per number of sets and steps whose chain is searched.

A search takes up to 0.3 s. Most choices with the required separation also have the required margin;
those whose first combination spans little more than the projector have not. An empirical choice.
"""

END_PX = 2.0
"""Distance by which the phases of a proposal repeat beyond the projector, px.

It keeps the two ends of the projector apart: noise of a coordinate at one end does not reach the
other end. Two pixels are many standard deviations of a coordinate.
"""

MAX_SETS = 4
"""Largest number of periods per axis in a proposal.

Every set needs three frames or more. Four sets span any common projector with good margins, and
more only take frames from the finest set. An empirical choice.
"""

MAX_HETERODYNE_SETS = 3
"""Largest number of periods of a heterodyne proposal.

All choices of two beats are tried; those of three would take too long. An empirical choice.
"""

MAX_BEAT_SHARE = 3
"""The coarsest set of a heterodyne plan lacks at most 1/3 of the finest set's fringes.

With fewer fringes it would contribute little to the coordinate's precision. An empirical choice.
"""

ROBUST_BAND = 1.5
"""Longest period of a robust plan, over the shortest that projector and camera resolve.

Blur and indirect light hardly differ within so narrow a band. Narrower ones leave heterodyne plans
no margin. An empirical choice.
"""

COARSENING = 0.94
"""Factor by which the number of fringes falls from one trial to the next.

A factor nearer to 1 finds slightly finer fringes but takes longer: at 0.94 the period is at most 6
% longer than necessary. An empirical choice.
"""

NOISE_SHARES = (1e-9, 1e9)
"""Smallest and largest noise, as a share of the modulation: far beyond all cameras on both sides.
Squares of numbers beyond do not fit into a number."""

PHASE_KINDS = ("single", "hierarchical", "heterodyne", "number-theoretic")
"""Kinds of plans without a Gray code."""

KINDS = (*PHASE_KINDS[1:], "gray")
"""Kinds of plans that span the projector. One period alone would be as long as the projector."""


def checked_share(
    frames: int,
    axes: Sequence[Axis],
    noise: float,
    modulation: float,
    band: tuple[float, float],
) -> int:
    """Frames for each axis; refuses arguments that are out of range."""
    if not axes or any(axis not in ("x", "y") for axis in axes):
        raise InputError(f"axes: expected x, y or both, got {', '.join(axes) or 'none'}")
    for name, value in (("noise", noise), ("modulation", modulation)):
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"{name}: expected > 0 counts, got {value}")
    if not NOISE_SHARES[0] <= noise / modulation <= NOISE_SHARES[1]:
        raise InputError(
            f"noise: expected {NOISE_SHARES[0]:g} to {NOISE_SHARES[1]:g} times the modulation of "
            f"{modulation:g} counts, got {noise:g} counts"
        )
    min_period_px, max_period_px = band
    if not 2 <= min_period_px < math.inf:
        raise InputError(f"min_period_px: expected a period of 2 px or more, got {min_period_px}")
    if not max_period_px >= min_period_px:
        raise InputError(
            f"max_period_px: expected {min_period_px:g} px or more, like min_period_px, got "
            f"{max_period_px:g}"
        )
    share = frames // len(axes)
    if share < 3:
        raise InputError(
            f"frames: expected 3 or more for each axis, got {frames} for {len(axes)} axes"
        )
    return share


@dataclass(frozen=True, eq=False, repr=False)
class Proposal(Frozen):
    """A plan with its predicted error."""

    kind: str
    """single (one period), hierarchical, heterodyne, number-theoretic, gray (with Gray code) or
    gray-alone (without fringes)."""
    plan: PatternPlan
    sigma_px: float
    """Predicted standard deviation of the coordinate, projector px; of two axes the larger one."""
    margin: float
    """Smallest margin of a fringe order, or of a bit, in standard deviations; ≥ 6."""
    reason: str = ""
    """Why the plan has such periods, where that is more than the smallest error."""

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
    max_period_px: float = math.inf,
    robust: bool = False,
    range_px: Mapping[Axis, float] | None = None,
    camera_pixel_px: float | None = None,
    blur_px: float = 0.0,
    colours: bool = False,
) -> list[Proposal]:
    """Propose the best plan of every kind, the smallest predicted error first.

    Parameters
    ----------
    width_px, height_px : int
        Columns and rows of the projector.
    frames : int
        Number of frames that the plan may use, shared evenly by the axes; ≥ 3 per axis.
    axes : sequence of "x", "y" or both
    noise : float > 0
        Standard deviation of a camera count.
    modulation : float > 0
        Modulation B of the fringes on the darkest surface that matters, counts.
    min_period_px : float ≥ 2
        Shortest period that projector and camera still resolve, projector px.
    max_period_px : float > 0
        Longest period of the fringes, projector px. Light that comes from other surfaces varies
        slowly over the scene. It adds hardly any modulation to short periods, and bends the phase
        of long ones. Gray codes, whose stripes are wide, are not proposed then.
    robust : bool
        Whether periods are at most one and a half times ``min_period_px`` (``ROBUST_BAND``).
    range_px : mapping of axes to floats > 0, optional
        Distances within which coordinates must be unambiguous, projector px; by default the whole
        projector. ``propose_for_depth`` finds them for a range of depths.
    camera_pixel_px : float > 0, optional
        Projector px that a camera pixel spans. Gray-code cells are then not finer than the camera
        resolves, and a Gray code without fringes of the finest such cells is proposed as well.
    blur_px : float ≥ 0
        Standard deviation of the blur of camera and projector, camera px.
    colours : bool
        Whether red, green and blue of each picture show three steps. ``frames`` then counts the
        pictures, four of which are solid and serve both axes.

    Returns
    -------
    list of Proposal
        At most one per kind, each with a margin of six standard deviations or more.

    Raises
    ------
    InputError
        If an argument is out of range, or no plan has the required margin.

    Notes
    -----
    The predicted error is that of the inverse-variance mean of all sets,
    σ = (Σ (N_m / 2) (2π B / (p_m σ_I))²)^−½ (theory §5). Without fringes it is at most that of a
    uniform distribution over a cell.

    Examples
    --------
    >>> best = propose(1920, 1080, 12)[0]
    >>> best.plan.frames
    12
    >>> best.margin >= 6.0
    True
    """
    if robust:
        max_period_px = min(max_period_px, ROBUST_BAND * min_period_px)
    band = min_period_px, max_period_px
    given = f"{frames} {'pictures' if colours else 'frames'}, noise {noise:g}"
    if colours:
        frames, noise = _in_colours(frames, axes), COLOUR_NOISE * noise
    share = checked_share(frames, axes, noise, modulation, band)
    check_projector(width_px, height_px)
    ratio, absolute = noise / modulation, range_px is None
    lengths = {"x": float(width_px), "y": float(height_px)} if range_px is None else range_px
    cell = _checked_cell(camera_pixel_px, blur_px, ratio)
    proposals: list[Proposal] = []
    if cell is not None and absolute and math.isinf(max_period_px) and not colours:
        proposals += _gray_alone(width_px, height_px, axes, frames, ratio, cell)
    for kind in KINDS if absolute else PHASE_KINDS:
        if kind == "gray" and math.isfinite(max_period_px):
            continue  # the stripes of a Gray code are as wide as half the projector
        blocks: list[Block] = []
        for axis in axes:
            best = _best_share(
                kind, axis, lengths[axis], share, ratio, band, cell or 1, colours=colours
            )
            if best is None:
                break
            blocks += best
        else:
            plan = PatternPlan(width_px, height_px, tuple(blocks), colours=colours)
            margin = min(_margin(plan, axis, ratio, absolute) for axis in axes)
            sigma = max(_predicted(plan, axis, ratio) for axis in axes)
            proposals.append(Proposal(kind, plan, sigma, margin, _reason(max_period_px)))
    if not proposals:
        raise _unresolved(f"{given} and modulation {modulation:g}", max_period_px)
    return sorted(proposals, key=lambda proposal: proposal.sigma_px)


def _in_colours(pictures: int, axes: Sequence[Axis]) -> int:
    """Frames in the colours of a number of pictures, without the solid ones."""
    if pictures < len(SOLID) + len(axes):
        raise InputError(
            f"frames: expected {len(SOLID) + len(axes)} pictures or more, of which {len(SOLID)} "
            f"are solid, got {pictures}"
        )
    return COLOURS * (pictures - len(SOLID))


def _unresolved(given: str, max_period_px: float) -> InputError:
    """The error where no plan has the required margin."""
    longer = "" if math.isinf(max_period_px) else ", or longer periods"
    return InputError(
        f"plan: with {given}, no plan resolves the fringe orders with a margin of {MIN_MARGIN:g} "
        f"standard deviations: expected more frames or light{longer}"
    )


def _best_share(
    kind: str,
    axis: Axis,
    length: float,
    share: int,
    ratio: float,
    band: tuple[float, float],
    cell: int,
    *,
    colours: bool,
) -> list[Block] | None:
    """Blocks of a kind along an axis; in colours of as many whole pictures as make the smallest
    error."""
    if not colours:
        return _best(kind, axis, length, share, ratio, band, cell)
    if kind == "single":
        share = COLOURS
    found = [
        _best(kind, axis, length, n, ratio, band, cell, COLOURS)
        for n in range(COLOURS, share + 1, COLOURS)
    ]

    def error(blocks: list[Block]) -> float:
        sets = [b for b in blocks if isinstance(b, PhaseSteps)]
        return _sigma([b.period_px for b in sets], [ratio / math.sqrt(b.precision) for b in sets])

    return min((blocks for blocks in found if blocks), key=error, default=None)


def _reason(max_period_px: float) -> str:
    """Why a plan has short periods only."""
    if math.isinf(max_period_px):
        return ""
    return (
        f"no period is longer than {max_period_px:g} px: light from other surfaces and blur hardly "
        "shift the phase of short fringes, but bend that of long ones"
    )


def _sigmas(plan: PatternPlan, axis: Axis, ratio: float) -> list[float]:
    """Standard deviations of the phases along an axis, rad; ``ratio`` is noise over modulation."""
    return [ratio / math.sqrt(block.precision) for _, block in plan.phase_sets(axis)]


def _margin(plan: PatternPlan, axis: Axis, ratio: float, absolute: bool = True) -> float:
    """Smallest margin of the roundings along an axis, as the decoder judges it."""
    chain = plan.chain(axis, absolute=absolute)
    return chain.margin(chain.judged_sigma(_sigmas(plan, axis, ratio)))


def _resolves(axis: Axis, length: float, blocks: Sequence[Block], ratio: float) -> bool:
    """Whether blocks resolve the fringe orders along an axis with the required margin."""
    size = (math.ceil(length), 2) if axis == "x" else (2, math.ceil(length))
    try:
        return _margin(PatternPlan(*size, tuple(blocks)), axis, ratio) >= MIN_MARGIN
    except InputError:
        return False


def _predicted(plan: PatternPlan, axis: Axis, ratio: float) -> float:
    """Predicted standard deviation of the coordinate along an axis, projector px."""
    return _sigma([b.period_px for _, b in plan.phase_sets(axis)], _sigmas(plan, axis, ratio))


def _sigma(periods: Sequence[float], sigmas: Sequence[float]) -> float:
    """Standard deviation of the inverse-variance mean of all sets, projector px."""
    pairs = zip(periods, sigmas, strict=True)
    return 1.0 / math.sqrt(sum((TURN / (period * sigma)) ** 2 for period, sigma in pairs))


def _best(
    kind: str,
    axis: Axis,
    length: float,
    frames: int,
    ratio: float,
    band: tuple[float, float],
    cell: int,
    steps: int | None = None,
) -> list[Block] | None:
    """Blocks of a kind with the smallest error; None where none has the required margin.

    ``steps`` is the number of steps of every set where it is fixed.
    """
    least, most = band
    options: Iterator[list[Block]]
    if kind == "gray":
        options = _gray(axis, math.ceil(length), frames, max(least, 2.0 * cell), steps)
    elif kind == "single":
        period = max(math.ceil(length) + END_PX, least)
        single: list[Block] = [PhaseSteps(axis, period, equal_steps(frames))]
        options = iter([single] if period <= most else [])
    else:
        options = _phases(kind, axis, math.ceil(length), frames, ratio, band, steps)
    best, smallest = None, math.inf
    for blocks in options:
        sets = [b for b in blocks if isinstance(b, PhaseSteps)]
        sigmas = [ratio / math.sqrt(b.precision) for b in sets]
        sigma = _sigma([b.period_px for b in sets], sigmas)
        if sigma >= smallest:
            continue
        if _resolves(axis, length, blocks, ratio):
            best, smallest = blocks, sigma
    return best


def _gray(
    axis: Axis, length: int, frames: int, least: float, fixed: int | None = None
) -> Iterator[list[Block]]:
    """Fringes and Gray code with cells of half a period.

    A pixel on a blurred border may be read as either cell; both lead to the same fringe order.
    """
    for steps in range(3, frames) if fixed is None else range(fixed, min(fixed + 1, frames)):
        bits = frames - steps
        step = max(length / 2**bits, 0.5 * least)
        if bits > math.ceil(math.log2(length / step)):
            continue  # a bit would be unused: the same cells with more steps are better
        yield [
            PhaseSteps(axis, 2.0 * step, equal_steps(steps)),
            GrayCode(axis, step, length),
        ]


def _checked_cell(camera_pixel_px: float | None, blur_px: float, ratio: float) -> int | None:
    """The finest cell that the camera resolves, projector px; None where unknown, or for none."""
    if not (math.isfinite(blur_px) and blur_px >= 0):
        raise InputError(f"blur_px: expected 0 camera px or more, got {blur_px}")
    if camera_pixel_px is None:
        if blur_px:
            raise InputError("blur_px: expected together with camera_pixel_px, got it alone")
        return None
    if not (math.isfinite(camera_pixel_px) and camera_pixel_px > 0):
        raise InputError(f"camera_pixel_px: expected > 0 projector px, got {camera_pixel_px}")
    return finest_cell(camera_pixel_px, blur_px, ratio)


def _gray_alone(
    width_px: int, height_px: int, axes: Sequence[Axis], frames: int, ratio: float, cell: int
) -> Iterator[Proposal]:
    """A Gray code along each axis with a white and a black frame, of the finest cells."""
    most = (frames - 2) // len(axes)
    margin = 1.0 / (ratio * FRAME_MINUS_MEAN**0.5)
    if most < 1 or margin < MIN_MARGIN:
        return
    lengths = {"x": width_px, "y": height_px}
    steps = {axis: max(cell, math.ceil(lengths[axis] / 2**most)) for axis in axes}
    if any(step >= lengths[axis] for axis, step in steps.items()):
        return
    codes = [GrayCode(axis, float(step), lengths[axis]) for axis, step in steps.items()]
    plan = PatternPlan(width_px, height_px, (*codes, Uniform("white"), Uniform("black")))
    yield Proposal("gray-alone", plan, max(steps.values()) / 12.0**0.5, margin)


def _shares(frames: int, sets: int) -> list[list[int]]:
    """Numbers of steps of the sets, the finest first: even shares, and most for the finest."""
    if frames < 3 * sets:
        return []
    even = [frames // sets + (1 if k < frames % sets else 0) for k in range(sets)]
    uneven = [frames - 3 * (sets - 1)] + [3] * (sets - 1)
    return [even] if even == uneven else [even, uneven]


def _phases(
    kind: str,
    axis: Axis,
    length: int,
    frames: int,
    ratio: float,
    band: tuple[float, float],
    fixed: int | None = None,
) -> Iterator[list[Block]]:
    """Blocks of fringes of a kind, for every number of sets the finest that have the margin."""
    span = length + END_PX
    for sets in range(2, MAX_SETS + 1):
        for steps in _shares(frames, sets):
            if fixed is not None and any(n != fixed for n in steps):
                continue
            weights = [0.5 * n * (TURN / ratio) ** 2 for n in steps]
            separated = _separated(kind, span, sets, weights, band)
            for periods in islice(separated, MAX_TRIALS):
                pairs = zip(periods, steps, strict=True)
                blocks: list[Block] = [PhaseSteps(axis, p, equal_steps(n)) for p, n in pairs]
                if _resolves(axis, length, blocks, ratio):
                    yield blocks
                    break


def _separated(
    kind: str, span: float, sets: int, weights: Sequence[float], band: tuple[float, float]
) -> Iterator[list[float]]:
    """Periods whose phases are far enough apart, with ever fewer fringes."""
    least, most = band
    count, before = span / least, None
    while count > sets and span / count <= most:
        periods = _periods(kind, span, count, sets, weights, most)
        if periods != before:
            before = periods
            if (
                periods
                and max(periods) <= most
                and 0.5 * separation(periods, span - END_PX, weights) >= MIN_MARGIN
            ):
                yield periods
        count *= COARSENING


def _periods(
    kind: str, span: float, count: float, sets: int, weights: Sequence[float], most: float
) -> list[float] | None:
    """Periods with about ``count`` fringes in the finest set, the finest first; None for none."""
    if kind == "hierarchical":
        # Whole numbers of fringes, so that all phases repeat together with the longest.
        ratio = int(count) ** (1.0 / (sets - 1))
        return [span / max(1, round(ratio ** (sets - 1 - k))) for k in range(sets)]
    if kind == "heterodyne":
        return _heterodyne(span, int(count), sets, weights, most)
    return _whole_periods(span, math.ceil(span / count), sets)


def _heterodyne(
    span: float, count: int, sets: int, weights: Sequence[float], most: float
) -> list[float] | None:
    """Periods with similar numbers of fringes whose phases have the largest separation."""
    if sets > MAX_HETERODYNE_SETS or count < 3:
        return None
    beats = range(1, max(2, count // MAX_BEAT_SHARE))
    choices: list[tuple[int, ...]] = [(count, count - 1)]
    if sets == 3:
        # Equal differences are left out: a patent covers them.
        choices = [
            (count, count - a, count - b) for a in beats for b in beats if b > a and b != 2 * a
        ]
    # Numbers with a common divisor would repeat within the range.
    coprime = [c for c in choices if span <= most * c[-1] and c[-1] >= 1 and math.gcd(*c) == 1]
    if not coprime:
        return None
    best = max(coprime, key=lambda c: separation([span / n for n in c], span - END_PX, weights))
    return [span / n for n in best]


def _whole_periods(span: float, shortest: int, sets: int) -> list[float] | None:
    """Pairwise coprime periods in whole pixels; None where their product is below ``span``.

    By the Chinese remainder theorem such periods repeat after their product.
    """
    periods = [shortest]
    while len(periods) < sets:
        following = periods[-1] + 1
        while any(math.gcd(following, p) > 1 for p in periods):
            following += 1
        periods.append(following)
    return [float(p) for p in periods] if np.prod(periods) >= span else None
