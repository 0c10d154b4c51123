"""What is projected: plans of shifted fringes and Gray code, and their pictures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.order_chain import TURN, OrderChain, order_chain, repeat_distance
from fringeworks.types import Axis, FloatMap, InputError

DEPTHS = (8, 10, 12, 16)
MAX_STEPS = 64
MAX_CODE_BITS = 24
DITHER_THRESHOLDS = 8
"""Thresholds of the dither."""


def step_design(shifts_rad: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
    """Design (N, 3) of I_n = A + c cos δ_n + s sin δ_n, the light under N shifted fringes."""
    shifts = np.asarray(shifts_rad, np.float64)
    return np.column_stack((np.ones(shifts.size), np.cos(shifts), np.sin(shifts)))


@dataclass(frozen=True)
class PhaseSteps:
    """N frames ½ + ½ cos(2π x / p − δ_n) along one axis."""

    axis: Axis
    """x: fringes that vary from column to column; y: from row to row."""
    period_px: float
    """p, projector px; ≥ 2."""
    shifts_rad: tuple[float, ...]
    """δ_n, rad; at least three that determine a phase."""

    def __post_init__(self) -> None:
        _check_axis(self.axis)
        if not (math.isfinite(self.period_px) and self.period_px >= 2.0):
            raise InputError(f"period: expected 2 px or more, got {self.period_px:g}")
        n = len(self.shifts_rad)
        if not 3 <= n <= MAX_STEPS:
            raise InputError(f"steps: expected 3 to {MAX_STEPS}, got {n}")
        shifts = np.asarray(self.shifts_rad, float)
        if not np.isfinite(shifts).all():
            raise InputError("shifts: expected finite values, got NaN or infinity")
        if np.linalg.cond(step_design(shifts)) > 20.0:
            degrees = ", ".join(f"{d:g}" for d in np.degrees(shifts))
            raise InputError(
                f"shifts: expected three or more that differ modulo 360°, got {degrees}°"
            )

    @property
    def frames(self) -> int:
        """Number of frames, N."""
        return len(self.shifts_rad)

    @property
    def precision(self) -> float:
        """Inverse variance of the phase over (B/σ)², mean over all phases; N/2 for equal steps."""
        design = step_design(self.shifts_rad)
        covariance = np.linalg.inv(design.T @ design)
        return float(2.0 / (covariance[1, 1] + covariance[2, 2]))

    def values(self, position: FloatMap, frame: int) -> FloatMap:
        """Light to send at projector positions, 0…1."""
        phase = TURN * position / self.period_px - self.shifts_rad[frame]
        return np.asarray(0.5 + 0.5 * np.cos(phase))

    def labels(self) -> list[str]:
        return [f"{self.axis}-phase-{self.period_px:g}px-{n}" for n in range(self.frames)]


@dataclass(frozen=True)
class GrayCode:
    """Gray code of cells along one axis, the most significant bit first."""

    axis: Axis
    step_px: float
    """Width of a cell, projector px; ≥ 1."""
    length_px: int
    """Projector px along the axis."""
    inverse: bool = False
    """Whether every bit is followed by its inverse."""

    def __post_init__(self) -> None:
        _check_axis(self.axis)
        if not (math.isfinite(self.step_px) and self.step_px >= 1.0):
            raise InputError(f"step of the Gray code: expected 1 px or more, got {self.step_px:g}")
        if self.cells < 2:
            raise InputError(
                f"step of the Gray code: expected less than the projector's {self.length_px} px, "
                f"got {self.step_px:g}"
            )
        if self.bits > MAX_CODE_BITS:
            raise InputError(f"Gray code: expected {MAX_CODE_BITS} bits or fewer, got {self.bits}")

    @property
    def cells(self) -> int:
        """Number of cells."""
        return math.ceil(self.length_px / self.step_px - 1e-9)

    @property
    def bits(self) -> int:
        """Number of bits."""
        return max(1, (self.cells - 1).bit_length())

    @property
    def frames(self) -> int:
        """Number of frames."""
        return self.bits * (2 if self.inverse else 1)

    def values(self, position: FloatMap, frame: int) -> FloatMap:
        """Light to send at projector positions, 0 or 1."""
        bit = frame // 2 if self.inverse else frame
        cell = np.floor((position + 0.5) / self.step_px).astype(np.int64)
        lit = (((cell ^ (cell >> 1)) >> (self.bits - 1 - bit)) & 1).astype(float)
        return np.asarray(1.0 - lit if self.inverse and frame % 2 else lit)

    def labels(self) -> list[str]:
        if not self.inverse:
            return [f"{self.axis}-gray-{b}" for b in range(self.bits)]
        return [f"{self.axis}-gray-{b}{i}" for b in range(self.bits) for i in ("", "-inverse")]


@dataclass(frozen=True)
class Uniform:
    """One frame of one brightness."""

    kind: Literal["white", "black"]

    def __post_init__(self) -> None:
        if self.kind not in ("white", "black"):
            raise InputError(f"level: expected white or black, got {self.kind!r}")

    @property
    def frames(self) -> int:
        """One."""
        return 1

    def values(self, position: FloatMap, frame: int) -> FloatMap:
        """Light to send, 0 or 1."""
        del frame
        return np.full(position.shape, 1.0 if self.kind == "white" else 0.0)

    def labels(self) -> list[str]:
        return [self.kind]


Block = PhaseSteps | GrayCode | Uniform


def _check_axis(axis: str) -> None:
    if axis not in ("x", "y"):
        raise InputError(f"axis: expected x or y, got {axis!r}")


def equal_steps(n: int) -> tuple[float, ...]:
    """Shifts 2π k / n, k = 0 … n − 1, rad."""
    if not 3 <= n <= MAX_STEPS:
        raise InputError(f"steps: expected 3 to {MAX_STEPS}, got {n}")
    return tuple(TURN * k / n for k in range(n))


@dataclass(frozen=True)
class PatternPlan:
    """A sequence of patterns for a projector, in the order in which they are sent and taken."""

    width_px: int
    """Projector columns."""
    height_px: int
    """Projector rows."""
    blocks: tuple[Block, ...]
    """What is sent, one after the other."""
    bits: int = 8
    """Depth of the pictures, 8, 10, 12 or 16; values go from 0 to 2^bits − 1."""
    gamma: float = 1.0
    """Exponent of the response that the patterns are pre-distorted for: v^(1/γ) is sent."""
    dither: bool = False
    """Whether rounding to the depth is spread over 8 pixels either way (ordered dither)."""

    def __post_init__(self) -> None:
        if self.width_px < 2 or self.height_px < 2:
            raise InputError(
                f"projector: expected 2 × 2 px or more, got {self.width_px} × {self.height_px}"
            )
        if self.bits not in DEPTHS:
            raise InputError(f"bits: expected one of {DEPTHS}, got {self.bits}")
        if not (math.isfinite(self.gamma) and self.gamma > 0):
            raise InputError(f"gamma: expected > 0, got {self.gamma}")
        if not any(isinstance(block, PhaseSteps | GrayCode) for block in self.blocks):
            raise InputError("plan: expected fringes or Gray code, got neither")
        for block in self.blocks:
            if isinstance(block, GrayCode) and block.length_px != self.length_px(block.axis):
                raise InputError(
                    f"Gray code: expected a length of {self.length_px(block.axis)} px along "
                    f"{block.axis}, got {block.length_px}"
                )
        for axis in self.axes:
            if sum(isinstance(b, GrayCode) for b in self.blocks if _along(b, axis)) > 1:
                raise InputError(f"plan: expected one Gray code along {axis}, got several")

    def length_px(self, axis: Axis) -> int:
        """Projector px along an axis."""
        return self.width_px if axis == "x" else self.height_px

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Axes along which something is decoded."""
        every: tuple[Axis, ...] = ("x", "y")
        return tuple(a for a in every if any(_along(block, a) for block in self.blocks))

    @property
    def frames(self) -> int:
        """Number of frames."""
        return sum(block.frames for block in self.blocks)

    @cached_property
    def placed(self) -> tuple[tuple[int, Block], ...]:
        """Every block with the index of its first frame."""
        firsts = np.cumsum([0, *(block.frames for block in self.blocks)])
        return tuple((int(first), block) for first, block in zip(firsts, self.blocks, strict=False))

    def phase_sets(self, axis: Axis) -> list[tuple[int, PhaseSteps]]:
        """Sets of steps along an axis, with the index of their first frame."""
        return [(k, b) for k, b in self.placed if isinstance(b, PhaseSteps) and b.axis == axis]

    def gray_code(self, axis: Axis) -> tuple[int, GrayCode] | None:
        """The Gray code along an axis, with the index of its first frame."""
        found = [(k, b) for k, b in self.placed if isinstance(b, GrayCode) and b.axis == axis]
        return found[0] if found else None

    def uniform(self, kind: Literal["white", "black"]) -> int | None:
        """Index of the white or black frame; None where there is none."""
        found = [k for k, b in self.placed if isinstance(b, Uniform) and b.kind == kind]
        return found[0] if found else None

    def labels(self) -> list[str]:
        """A name for every frame."""
        return [label for block in self.blocks for label in block.labels()]

    def chain(self, axis: Axis, *, absolute: bool = True) -> OrderChain:
        """How the fringe orders along an axis are found.

        Parameters
        ----------
        axis : "x" or "y"
        absolute : bool
            False for coordinates modulo the distance after which all phases repeat.

        Raises
        ------
        InputError where the periods cannot be resolved.
        """
        sets = [block for _, block in self.phase_sets(axis)]
        periods = [block.period_px for block in sets]
        code = self.gray_code(axis)
        weights = [block.precision for block in sets]
        length = float(self.length_px(axis)) if absolute else _repeats(periods)
        bounds = (-0.5, length - 0.5)
        step = None if code is None or not absolute else code[1].step_px
        try:
            return _chain(tuple(periods), bounds, tuple(weights), step)
        except InputError as error:
            raise InputError(f"plan, {axis}: {error}") from error


@lru_cache(maxsize=64)
def _chain(
    periods_px: tuple[float, ...],
    bounds: tuple[float, float],
    weights: tuple[float, ...],
    code_step_px: float | None,
) -> OrderChain:
    return order_chain(periods_px, bounds, weights=weights, code_step_px=code_step_px)


def _repeats(periods_px: Sequence[float]) -> float:
    longest = max(periods_px)
    found = repeat_distance(periods_px, 64.0 * longest)
    return found if math.isfinite(found) else longest


def _along(block: Block, axis: Axis) -> bool:
    return not isinstance(block, Uniform) and block.axis == axis


def encode(plan: PatternPlan) -> Iterator[NDArray[np.unsignedinteger]]:
    """The pictures of a plan, one after the other.

    Parameters
    ----------
    plan : PatternPlan

    Yields
    ------
    (height, width) arrays, uint8, or uint16 for more than 8 bits; 0 … 2^bits − 1.

    Examples
    --------
    >>> plan = PatternPlan(64, 4, (PhaseSteps("x", 16.0, equal_steps(4)),))
    >>> [int(picture[0, 0]) for picture in encode(plan)]
    [255, 128, 0, 128]
    """
    top = 2**plan.bits - 1
    kind = np.uint8 if plan.bits == 8 else np.uint16
    shape = (plan.height_px, plan.width_px)
    for block in plan.blocks:
        down = not isinstance(block, Uniform) and block.axis == "y"
        position = np.arange(shape[0] if down else shape[1], dtype=np.float64)
        for n in range(block.frames):
            line = top * block.values(position, n) ** (1.0 / plan.gamma)
            across = line[:, None] if down else line[None, :]
            if plan.dither:
                picture = np.floor(np.broadcast_to(across, shape) + _thresholds(shape))
            else:
                picture = np.broadcast_to(np.floor(across + 0.5), shape)
            yield np.minimum(picture, top).astype(kind)


def _thresholds(shape: tuple[int, int]) -> FloatMap:
    """Ordered dither by a Latin square: eight thresholds, evenly spread in every row and column.

    Fringes do not change along one axis: that is where their mean has to be right.
    """
    y, x = np.ogrid[: shape[0], : shape[1]]
    return np.asarray(((5 * y + 3 * x) % DITHER_THRESHOLDS + 0.5) / DITHER_THRESHOLDS)
