"""Plans of what a projector shows: shifted fringes, Gray code, white and black frames."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain, pairwise, zip_longest
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.gray_code import GrayCode as GrayCode
from fringeworks.patterns.gray_code import check_axis
from fringeworks.patterns.order_chain import TURN, OrderChain, order_chain, repeat_distance
from fringeworks.types import (
    MOST_PX,
    Axis,
    FloatMap,
    Frozen,
    InputError,
    Plotted,
    finite,
    positive,
    whole,
)
from fringeworks.types.computed import cached_property

DEPTHS = (1, 8, 10, 12, 16)
"""Depths of pictures that can be drawn, bits: those of common projectors and displays, and of the
mirrors of a micromirror device, which are on or off."""

MAX_STEPS = 64
"""Largest number of steps in a set.

The decoding kernel marks the samples of a pixel in a 64-bit mask. More steps are hardly ever
useful, because the precision grows only with √N.
"""

COLOURS = 3
"""Colours of a picture: red, green and blue."""

LightColour = Literal["red", "green", "blue"]
"""One colour of a projector's light, and the channel of a colour camera that sees it."""

SOLID = ("red", "green", "blue", "black")
"""Solid pictures at the end of a plan with colours, in their order."""

LINE_STEPS = range(4, 9)
"""Numbers of steps of lines. Three leave no residuals, which show how sharp the lines are. With
nine, harmonics of sharp lines beyond the fourth are taken for so much noise that it hides them."""

MAX_SHIFT_CONDITION = 20.0
"""Largest condition number of the design matrix of a set of steps.

Equal steps have √2. At 20 the phase is up to 14 times as noisy as with equal steps, and such shifts
are more likely a mistake than intended. An empirical choice.
"""

SINGULAR_CONDITION = 1e3
"""Condition number from which on a design matrix counts as singular.

Computed values of a singular matrix of cosines exceed 1e14, and usable sets of steps stay below
``MAX_SHIFT_CONDITION``; the value lies between them. An empirical choice.
"""

REPEAT_SEARCH_PERIODS = 64.0
"""Range over which the repeat distance of a relative plan is searched, longest periods.

``repeat_distance`` searches up to four times this range. Periods that do not repeat over so many
fringes have no useful repeat distance. An empirical choice.
"""


def check_is_plan(plan: object) -> None:
    """Refuse what is no plan, such as a proposal, which has one."""
    if not isinstance(plan, PatternPlan):
        first = plan[0] if isinstance(plan, list) and plan else plan
        of = "; a Proposal has one as its .plan" if hasattr(first, "plan") else ""
        raise InputError(f"plan: expected a PatternPlan, got {type(plan).__name__}{of}")


def repeats(plan: PatternPlan) -> bool:
    """Whether the phases and Gray codes of a plan leave coordinates that repeat along an axis.

    Examples
    --------
    >>> from fringeworks.patterns.plan import PhaseSteps, equal_steps
    >>> repeats(PatternPlan(640, 480, (PhaseSteps("x", 80.0, equal_steps(4)),)))
    True
    """
    try:
        for axis in plan.axes:
            if plan.phase_sets(axis):
                plan.chain(axis)
    except InputError:
        return True
    return False


def step_design(shifts_rad: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
    """Design matrix of I_n = A + c cos δ_n + s sin δ_n, the brightness under N shifted fringes.

    Parameters
    ----------
    shifts_rad : (N,) floats
        Shifts δ_n, rad.

    Returns
    -------
    (N, 3) array with the columns 1, cos δ_n and sin δ_n.
    """
    shifts = np.asarray(shifts_rad, np.float64)
    return np.column_stack((np.ones(shifts.size), np.cos(shifts), np.sin(shifts)))


@dataclass(frozen=True, eq=False, repr=False)
class PhaseSteps(Frozen):
    """One set of N shifted fringe patterns ½ + ½ cos(2π x / p − δ_n) along one axis.

    With ``line_px``, a bright line of that width lies where the cosine has its maxima.
    """

    axis: Axis
    """x: the fringes vary from column to column; y: from row to row."""
    period_px: float
    """Period p, projector px; ≥ 2."""
    shifts_rad: tuple[float, ...]
    """Shifts δ_n, rad; 3 to 64, at least three of them different modulo 2π."""
    line_px: float | None = None
    """Width of the bright line in every period, projector px; None for a cosine. Lines have 4
    to 8 equal steps."""

    def __post_init__(self) -> None:
        check_axis(self.axis)
        if not (finite(self.period_px) and self.period_px >= 2.0):
            raise InputError(f"period: expected 2 px or more, got {self.period_px:g}")
        if np.ndim(self.shifts_rad) == 0:
            raise InputError(
                f"shifts_rad: expected a sequence, as equal_steps(4) returns, got {self.shifts_rad}"
            )
        n = len(self.shifts_rad)
        if not 3 <= n <= MAX_STEPS:
            raise InputError(f"steps: expected 3 to {MAX_STEPS}, got {n}")
        if not finite(*self.shifts_rad):
            raise InputError(f"shifts: expected finite values, got {self.shifts_rad}")
        shifts = np.asarray(self.shifts_rad, float)
        if np.linalg.cond(step_design(shifts)) > MAX_SHIFT_CONDITION:
            degrees = ", ".join(f"{d:g}" for d in np.degrees(shifts))
            raise InputError(
                f"shifts: expected at least three that clearly differ modulo 360°, got {degrees}°"
            )
        if self.line_px is not None:
            self._check_line(self.line_px, shifts)

    def _check_line(self, line_px: float, shifts: NDArray[np.float64]) -> None:
        """Refuse lines whose harmonics the steps do not tell apart, or that are no lines."""
        if not (positive(line_px) and line_px < self.period_px):
            raise InputError(
                f"line_px: expected above 0 px and below the period of {self.period_px:g} px, got "
                f"{line_px:g} px"
            )
        n = self.frames
        turns = np.sort((shifts - shifts[0]) / TURN % 1.0)
        equal = np.allclose(np.exp(1j * n * shifts), np.exp(1j * n * shifts[0]), atol=1e-6)
        if n not in LINE_STEPS or not equal or np.diff(turns).min() < 0.5 / n:
            degrees = ", ".join(f"{d:g}" for d in np.degrees(shifts))
            raise InputError(
                f"line_px: expected {LINE_STEPS[0]} to {LINE_STEPS[-1]} equal steps over a period, "
                f"got {degrees}°"
            )

    @property
    def even_share(self) -> float:
        """Mean light of a frame, as a share of that under white."""
        return 0.5 if self.line_px is None else self.line_px / self.period_px

    @property
    def frames(self) -> int:
        """Number of frames, N."""
        return len(self.shifts_rad)

    @property
    def precision(self) -> float:
        """Inverse variance of the phase in units of (B/σ)², 1/rad²; N/2 for equal steps.

        The variance is the mean over all phases.
        """
        design = step_design(self.shifts_rad)
        covariance = np.linalg.inv(design.T @ design)
        return float(2.0 / (covariance[1, 1] + covariance[2, 2]))

    def mirrored(self, length_px: int) -> PhaseSteps:
        """The steps that a mirror makes of these on a projector of a length."""
        end = TURN * (length_px - 1) / self.period_px
        return replace(self, shifts_rad=tuple(end - shift for shift in self.shifts_rad))

    def values(self, position: FloatMap, frame: int) -> FloatMap:
        """Light that one frame sends to projector positions, 0…1.

        Parameters
        ----------
        position : float array of any shape, projector px
        frame : int, 0 … N − 1
        """
        phase = TURN * position / self.period_px - self.shifts_rad[frame]
        if self.line_px is None:
            return np.asarray(0.5 + 0.5 * np.cos(phase))
        # The share of a pixel that the line covers: its light then lies where it should. One of the
        # three nearest lines may cover a part.
        off = (phase / TURN + 0.5) % 1.0 * self.period_px - 0.5 * self.period_px
        half = 0.5 * self.line_px
        covered = sum(
            np.clip(np.minimum(off + 0.5, at + half) - np.maximum(off - 0.5, at - half), 0.0, None)
            for at in (-self.period_px, 0.0, self.period_px)
        )
        return np.asarray(covered)

    def labels(self) -> list[str]:
        """One name per frame."""
        return [f"{self.axis}-phase-{self.period_px:g}px-{n}" for n in range(self.frames)]


@dataclass(frozen=True, eq=False, repr=False)
class Uniform(Frozen):
    """One white or black frame, or one that is not decoded, whatever it shows."""

    kind: Literal["white", "black", "unused"]
    """Black is drawn for ``unused``."""

    def __post_init__(self) -> None:
        if self.kind not in ("white", "black", "unused"):
            raise InputError(
                f"uniform frame: expected white or black, or unused, got {self.kind!r}"
            )

    @property
    def frames(self) -> int:
        """Number of frames, 1."""
        return 1

    def values(self, position: FloatMap, frame: int) -> FloatMap:
        """Light that the frame sends to projector positions, 0 or 1."""
        del frame
        return np.full(position.shape, 1.0 if self.kind == "white" else 0.0)

    def labels(self) -> list[str]:
        """The name of the frame."""
        return [self.kind]


Block = PhaseSteps | GrayCode | Uniform


def equal_steps(n: int, *, start_rad: float = 0.0, sign: int = 1) -> tuple[float, ...]:
    """Shifts start ± 2π k / n for k = 0 … n − 1, rad.

    Parameters
    ----------
    n : int
        Number of steps, 3 to 64.
    start_rad : float
        Shift of the first frame, rad; π/2 for fringes that begin with a sine.
    sign : 1 or −1
        −1 for programs whose steps add to the phase, cos(φ + δ).

    Raises
    ------
    InputError
        If an argument is out of range.

    Examples
    --------
    >>> [round(shift, 2) for shift in equal_steps(4)]
    [0.0, 1.57, 3.14, 4.71]
    """
    if not 3 <= n <= MAX_STEPS:
        raise InputError(f"steps: expected 3 to {MAX_STEPS}, got {n}")
    if sign not in (1, -1):
        raise InputError(f"sign of the steps: expected 1 or -1, got {sign}")
    if not finite(start_rad):
        raise InputError(f"start of the steps: expected a finite angle, got {start_rad}")
    return tuple(start_rad + sign * TURN * k / n for k in range(n))


def check_projector(width_px: int, height_px: int) -> None:
    """Refuse sizes that no projector has."""
    if not (whole(width_px, 2, MOST_PX) and whole(height_px, 2, MOST_PX)):
        raise InputError(
            f"projector: expected 2 × 2 px to {MOST_PX} × {MOST_PX} px, got {width_px} × "
            f"{height_px} px"
        )


@dataclass(frozen=True, eq=False, repr=False)
class PatternPlan(Plotted, Frozen):
    """A sequence of patterns for a projector, in the order of projection and of the frames."""

    width_px: int
    """Number of projector columns; ≥ 2."""
    height_px: int
    """Number of projector rows; ≥ 2."""
    blocks: tuple[Block, ...]
    """Sets of steps, Gray codes and uniform frames in the order of projection."""
    bits: int = 8
    """Depth of the pictures, 1, 8, 10, 12 or 16; counts go from 0 to 2^bits − 1. With 1, grey
    levels are drawn by error diffusion."""
    gamma: float = 1.0
    """Exponent γ of the response that the patterns compensate: v^(1/γ) is sent; > 0."""
    dither: bool = False
    """Whether an ordered dither over 8 × 8 pixels replaces the rounding to whole counts."""
    mirrored: tuple[Axis, ...] = ()
    """Axes along which the projector mirrors the pictures that it is sent, as with projection from
    behind: x for columns from right to left. Coordinates count the projector's own pixels."""

    colours: bool = False
    """Whether red, green and blue of a picture show three frames, one after the other. Solid
    pictures of the colours and a black one follow the last."""
    bits_in_turn: bool = False
    """Whether the bits of the Gray codes along x and y alternate, from that of the first code on.
    The codes follow each other in ``blocks`` then."""
    channel: LightColour | None = None
    """Colour of the light that all pictures are shown in, and channel of colour images that is
    decoded; None for white light and luminance."""

    def __post_init__(self) -> None:
        check_projector(self.width_px, self.height_px)
        if self.colours:
            self._check_colours()
        if self.channel is not None:
            self._check_channel(self.channel)
        if self.bits not in DEPTHS:
            depths = ", ".join(str(depth) for depth in DEPTHS)
            raise InputError(f"bits: expected one of {depths}, got {self.bits}")
        if not positive(self.gamma):
            raise InputError(f"gamma: expected > 0, got {self.gamma}")
        if self.bits == 1 and (self.gamma != 1.0 or self.dither):
            raise InputError(
                "plan: expected gamma 1 and no dither for pictures of 1 bit, whose grey levels are "
                f"shares of lit mirrors, got gamma {self.gamma:g}"
                f"{' and a dither' if self.dither else ''}"
            )
        if not any(isinstance(block, PhaseSteps | GrayCode) for block in self.blocks):
            raise InputError("plan: expected fringes or Gray code, got uniform frames only")
        for block in self.blocks:
            if isinstance(block, GrayCode) and block.length_px != self.length_px(block.axis):
                raise InputError(
                    f"Gray code: expected a length of {self.length_px(block.axis)} px along "
                    f"{block.axis}, like the projector, got {block.length_px} px"
                )
        for axis in self.axes:
            if sum(isinstance(b, GrayCode) for b in self.blocks if _along(b, axis)) > 1:
                raise InputError(f"plan: expected at most one Gray code along {axis}, got several")
        for axis in self.mirrored:
            check_axis(axis)
        _ = self.placed  # refuses codes that cannot be mirrored
        if self.bits_in_turn:
            self._check_in_turn()

    def _check_in_turn(self) -> None:
        """Refuse Gray codes whose bits cannot alternate."""
        codes = [block for block in self.blocks if isinstance(block, GrayCode)]
        follow = any(a in codes and b in codes for a, b in pairwise(self.blocks))
        alike = {(code.inverse, code.inverses_last) for code in codes}
        if len(codes) != 2 or not follow or len(alike) > 1:
            raise InputError(
                "bits_in_turn: expected a Gray code along x and one along y, one right after the "
                "other and both with or both without inverse pictures"
            )

    def _check_channel(self, channel: str) -> None:
        """Refuse a colour that is none, and pictures that hold no single colour."""
        if channel not in get_args(LightColour):
            names = ", ".join(get_args(LightColour))
            raise InputError(f"channel: expected one of {names}, got {channel!r}")
        if self.colours or self.bits != 8:
            got = "frames in all three" if self.colours else f"{self.bits} bit"
            raise InputError(f"channel: expected pictures of 8 bit in one colour, got {got}")

    def _check_colours(self) -> None:
        """Refuse blocks that do not fit into the colours of pictures."""
        if self.bits != 8 or self.dither:
            raise InputError(
                f"plan: expected 8 bit without dither for colours, got {self.bits} bit"
                f"{' with a dither' if self.dither else ''}"
            )
        if self.frames % COLOURS:
            raise InputError(
                "plan: expected three frames for each colour picture, got "
                f"{self.frames} frames; add a block of the kind unused"
            )
        steps = [(k, b) for k, b in self.placed if isinstance(b, PhaseSteps)]
        if not steps:
            raise InputError("plan: expected sets of three steps for colours, got none")
        for first, block in steps:
            turns = np.sort(np.asarray(block.shifts_rad) / TURN % 1.0)
            equal = block.frames == COLOURS and np.allclose(np.diff(turns), 1.0 / COLOURS)
            if first % COLOURS or not equal:
                raise InputError(
                    "plan: expected sets of three equal steps in the colours of one picture, got "
                    f"{block.frames} steps from frame {first} on"
                )

    @property
    def pictures(self) -> int:
        """Number of pictures that are shown: of colours, one for three frames, and four solid."""
        return self.frames // COLOURS + len(SOLID) if self.colours else self.frames

    def picture_labels(self) -> list[str]:
        """One name for each picture."""
        if not self.colours:
            return self.labels()
        return [f"colours-{name}" for name in self.labels()[::COLOURS]] + list(SOLID)

    def seen(self, frame: NDArray[Any]) -> NDArray[Any]:
        """What is decoded of a frame: of colours (h, w, 3), the channel of a plan that has one."""
        if self.channel is None or frame.ndim != COLOURS or frame.shape[2] != COLOURS:
            return frame
        return frame[..., get_args(LightColour).index(self.channel)]

    def length_px(self, axis: Axis) -> int:
        """Length of the projector along an axis, px."""
        return self.width_px if axis == "x" else self.height_px

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Axes along which the plan has fringes or Gray code."""
        every: tuple[Axis, ...] = ("x", "y")
        return tuple(a for a in every if any(_along(block, a) for block in self.blocks))

    @property
    def frames(self) -> int:
        """Number of frames of all blocks."""
        return sum(block.frames for block in self.blocks)

    @cached_property
    def placed(self) -> tuple[tuple[int, Block], ...]:
        """Every block that is decoded, in the projector's own pixels, with the number of its first
        pattern.

        Patterns count from the first block on, the bits of a Gray code from the most significant
        one on and each followed by its inverse; see ``order``. Patterns that are not decoded are
        blocks of the kind ``unused``.
        """
        seen = [part for block in self.blocks for part in self._seen(block)]
        firsts = np.cumsum([0, *(block.frames for block in seen)])
        return tuple((int(first), block) for first, block in zip(firsts, seen, strict=False))

    @cached_property
    def order(self) -> tuple[int, ...]:
        """Number of the pattern that each frame shows: 0, 1, 2 …, unless a Gray code begins with
        its least significant bit, has its inverses last, or takes turns with another one."""
        shown: list[int] = []
        turns: list[list[tuple[int, ...]]] = []
        first = 0
        for block in self.blocks:
            numbers = block.shown if isinstance(block, GrayCode) else range(block.frames)
            numbers = tuple(first + n for n in numbers)
            first += block.frames
            if isinstance(block, GrayCode) and self.bits_in_turn:
                size = block.together
                turns.append([numbers[k : k + size] for k in range(0, len(numbers), size)])
                if len(turns) == 1:
                    continue
                numbers = tuple(
                    n for pair in zip_longest(*turns, fillvalue=()) for n in chain(*pair)
                )
            shown += numbers
        return tuple(shown)

    @cached_property
    def places(self) -> tuple[int, ...]:
        """Index of the frame that shows each pattern: the inverse of ``order``."""
        return tuple(sorted(range(self.frames), key=self.order.__getitem__))

    @cached_property
    def used(self) -> tuple[PatternPlan, tuple[int, ...]]:
        """The plan of the frames that are decoded, in the projector's own pixels; their indices."""
        kept = [(k, block) for k, block in self.placed if block != Uniform("unused")]
        frames = tuple(self.places[k + n] for k, block in kept for n in range(block.frames))
        plan = replace(
            self,
            blocks=tuple(block for _, block in kept),
            mirrored=(),
            colours=False,
            bits_in_turn=False,
            channel=None,
        )
        return plan, frames

    def _seen(self, block: Block) -> Iterator[Block]:
        """What is decoded of a block."""
        mirrored = any(_along(block, axis) for axis in self.mirrored)
        if isinstance(block, PhaseSteps):
            yield block.mirrored(self.length_px(block.axis)) if mirrored else block
        elif isinstance(block, GrayCode):
            code = replace(block.used, least_first=False, inverses_last=False)
            yield code.mirrored if mirrored else code
            for _ in range(block.frames - block.used.frames):
                yield Uniform("unused")
        else:
            yield block

    def phase_sets(self, axis: Axis) -> list[tuple[int, PhaseSteps]]:
        """Sets of steps along an axis, each with the number of its first pattern."""
        return [(k, b) for k, b in self.placed if isinstance(b, PhaseSteps) and b.axis == axis]

    def gray_code(self, axis: Axis) -> tuple[int, GrayCode] | None:
        """The Gray code along an axis, and the number of its first pattern; None without one."""
        codes = [(k, b) for k, b in self.placed if isinstance(b, GrayCode) and b.axis == axis]
        return codes[0] if codes else None

    def uniform(self, kind: Literal["white", "black"]) -> int | None:
        """Index of the first white or black frame; None where there is none."""
        frames = [k for k, b in self.placed if isinstance(b, Uniform) and b.kind == kind]
        return frames[0] if frames else None

    def labels(self) -> list[str]:
        """One name per frame of the plan."""
        labels = [label for block in self.blocks for label in block.labels()]
        return [labels[k] for k in self.order]

    def chain(self, axis: Axis, *, absolute: bool = True) -> OrderChain:
        """The chain of roundings that resolves the fringe orders along an axis.

        Parameters
        ----------
        axis : "x" or "y"
        absolute : bool
            False for coordinates modulo the distance after which all phases repeat.

        Returns
        -------
        OrderChain

        Raises
        ------
        InputError
            If the periods do not determine the coordinate on the whole projector.
        """
        sets = [block for _, block in self.phase_sets(axis)]
        periods = [block.period_px for block in sets]
        gray = self.gray_code(axis)
        weights = [block.precision for block in sets]
        length = float(self.length_px(axis)) if absolute else _relative_range(periods)
        bounds = (-0.5, length - 0.5)
        step = None if gray is None or not absolute else gray[1].step_px
        try:
            return _chain(tuple(periods), bounds, tuple(weights), step, not absolute)
        except InputError as error:
            raise error.at(f"plan along {axis}") from error


@lru_cache(maxsize=64)
def _chain(
    periods_px: tuple[float, ...],
    bounds: tuple[float, float],
    weights: tuple[float, ...],
    gray_step_px: float | None,
    circular: bool,
) -> OrderChain:
    return order_chain(
        periods_px, bounds, weights=weights, gray_step_px=gray_step_px, circular=circular
    )


def _relative_range(periods_px: Sequence[float]) -> float:
    """Range of relative coordinates: the repeat distance, or else the longest period, px."""
    longest = max(periods_px)
    repeats = repeat_distance(periods_px, REPEAT_SEARCH_PERIODS * longest)
    return repeats if math.isfinite(repeats) else longest


def _along(block: Block, axis: Axis) -> bool:
    return not isinstance(block, Uniform) and block.axis == axis
