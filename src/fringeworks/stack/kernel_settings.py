"""How one axis of a plan is handed to the decoding kernel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fringeworks import _core
from fringeworks.patterns.order_chain import CODE_REACH, TURN, OrderChain
from fringeworks.patterns.plan import GrayCode, PatternPlan
from fringeworks.signal.noise import chi_square_quantile
from fringeworks.signal.phase_table import BINS
from fringeworks.signal.response import Response
from fringeworks.types import Axis, CameraNoise, Decoded, InputError

MIN_SNR = 4.0
"""Modulation over its standard deviation below which there is no fringe."""
ORDER_SIGMAS = 5.0
"""Room that every rounding of a fringe order must have, in standard deviations."""
END_SIGMAS = 3.0
"""Distance from the seam of the range that a coordinate must have, where both ends look alike."""
DISAGREEING = 1e-7
"""Share of pixels with right orders that may be lost because their sets disagree by chance."""


@dataclass(frozen=True)
class Limits:
    """What a pixel must keep."""

    saturation: float
    """Counts from which on a sample is not trusted; infinite for none."""
    min_modulation: float = 0.0
    """Counts."""
    max_disagreement: float | None = None
    """χ² of the sets; None for the quantile that loses 1e-7 of the right ones."""
    given: bool = True
    """Whether the caller set the saturation; else it holds only where light exceeds it."""

    @property
    def threshold(self) -> float:
        """The saturation for the kernels: no count is beyond a limit that is no number."""
        return self.saturation if np.isfinite(self.saturation) else float("nan")


@dataclass(frozen=True)
class PhaseFrames:
    """One set of steps: where its frames are, and how they were shifted."""

    frames: tuple[int, ...]
    shifts_rad: tuple[float, ...]
    period_px: float
    table_turns: tuple[float, ...] = ()
    """Phase errors of the response, turns, a row per level of brightness; empty for none."""
    brightness: tuple[float, ...] = ()
    """Those levels, counts."""


@dataclass(frozen=True)
class CodeFrames:
    """A Gray code: where its frames are, and what they are compared with."""

    bits: tuple[int, ...]
    inverse: tuple[int, ...]
    levels: tuple[int, int] | None
    """White and black frame."""
    step_px: float
    cells: int


@dataclass(frozen=True)
class Decoding:
    """All that decides how one axis is decoded, but for noise and limits."""

    axis: Axis
    sets: tuple[PhaseFrames, ...]
    code: CodeFrames | None
    chain: OrderChain | None
    """None where there is nothing but a code."""
    length_px: float
    absolute: bool = True
    scale: float = 1.0
    """Disagreement of the sets, variance in units of the noise."""
    reach_px: float | None = None
    """Distance from the middle of its code cell that a coordinate may have; None for the usual."""

    @property
    def longest_px(self) -> float:
        """Range over which the phases by themselves tell the coordinate, px."""
        return float("inf") if self.chain is None else 1.0 / float(self.chain.frequencies[0])

    @property
    def frames(self) -> list[int]:
        """Indices of the frames that the kernel gets, in its order: phases, then the code."""
        return self.phase_frames + self.code_frames

    @property
    def phase_frames(self) -> list[int]:
        """Indices of the phase frames, a set after the other."""
        return [k for phases in self.sets for k in phases.frames]

    @property
    def code_frames(self) -> list[int]:
        """Indices of the frames of the code."""
        if self.code is None:
            return []
        return [*self.code.bits, *self.code.inverse, *(self.code.levels or ())]

    def kernel(
        self, noise: CameraNoise, limits: Limits, *, streamed: bool = False
    ) -> _core.DecodeSettings:
        """The kernel's plan; a stream's knows the frames of the code only."""
        order = self.code_frames if streamed else self.frames
        place = {frame: k for k, frame in enumerate(order)}
        sets = [
            (
                [place.get(k, 0) for k in phases.frames],
                list(phases.shifts_rad),
                phases.period_px,
                list(phases.table_turns),
                list(phases.brightness),
            )
            for phases in self.sets
        ]
        code = None
        if self.code is not None:
            levels = self.code.levels
            code = (
                [place[k] for k in self.code.bits],
                [place[k] for k in self.code.inverse],
                None if levels is None else (place[levels[0]], place[levels[1]]),
                self.code.step_px,
                self.code.cells,
            )
        largest = limits.max_disagreement
        if largest is None:
            freedom = max(1, len(self.sets) - 1)
            largest = chi_square_quantile(1.0 - DISAGREEING, freedom)
        return _core.DecodeSettings(
            sets=sets,
            code=code,
            read_variance=noise.read_counts**2,
            gain=noise.gain,
            scale=self.scale,
            saturation=limits.threshold,
            min_snr=MIN_SNR,
            min_modulation=limits.min_modulation,
            max_disagreement=largest,
            confidence=END_SIGMAS,
            **self._chain(),
        )

    def _chain(self) -> dict[str, Any]:
        half = 0.5 * self.length_px
        reach = 0.0 if self.code is None else CODE_REACH * self.code.step_px
        if self.reach_px is not None:
            reach = self.reach_px
        plain = {
            "middle": half - 0.5,
            "half": half,
            "circular": not self.absolute,
            "code_reach": reach,
        }
        chain = self.chain
        if chain is None:
            nothing = np.empty((0, 0), np.float32)
            flat = np.empty(0, np.float32)
            return plain | {
                "combinations": nothing,
                "frequencies": flat,
                "amplification": nothing,
                "room": flat,
                "repeats": float("inf"),
            }
        return plain | {
            "combinations": np.ascontiguousarray(chain.combinations, np.float32),
            "frequencies": np.ascontiguousarray(chain.frequencies, np.float32),
            "amplification": np.ascontiguousarray(chain.amplification**2, np.float32),
            "room": np.ascontiguousarray((chain.room / ORDER_SIGMAS) ** 2, np.float32),
            "repeats": chain.repeats_px,
        }


def decoding_of(
    plan: PatternPlan, axis: Axis, *, absolute: bool, response: Response | None
) -> Decoding:
    """How an axis of a plan is decoded.

    Raises
    ------
    InputError where periods cannot be resolved, a code has nothing to be compared with, or the
    response is for other patterns.
    """
    sets = tuple(
        PhaseFrames(
            tuple(range(first, first + block.frames)),
            block.shifts_rad,
            block.period_px,
            _table(plan, block.shifts_rad, response),
            () if response is None else response.brightness,
        )
        for first, block in plan.phase_sets(axis)
    )
    found = plan.gray_code(axis)
    code = None if found is None or (not absolute and sets) else _code(plan, *found, bool(sets))
    if not absolute and not sets:
        raise InputError("relative coordinates: expected fringes, got Gray code only")
    chain = plan.chain(axis, absolute=absolute) if sets else None
    length = float(plan.length_px(axis)) if absolute or chain is None else chain.high_px + 0.5
    return Decoding(axis, sets, code, chain, length, absolute)


def _code(plan: PatternPlan, first: int, block: GrayCode, phases: bool) -> CodeFrames:
    white, black = plan.uniform("white"), plan.uniform("black")
    levels = None if white is None or black is None else (white, black)
    frames = range(first, first + block.frames)
    if block.inverse:
        return CodeFrames(tuple(frames[::2]), tuple(frames[1::2]), None, block.step_px, block.cells)
    if levels is None and not phases:
        raise InputError(
            "Gray code: expected inverse bits, a white and a black frame, or fringes along the "
            "same axis to compare the bits with; got none"
        )
    return CodeFrames(tuple(frames), (), levels, block.step_px, block.cells)


def _table(
    plan: PatternPlan, shifts_rad: tuple[float, ...], response: Response | None
) -> tuple[float, ...]:
    """The response's phase errors for these shifts, in turns."""
    if response is None:
        return ()
    n = len(shifts_rad)
    if n != response.steps:
        raise InputError(f"response: made for {response.steps} steps, the plan has {n}")
    if abs(response.pattern_exponent * plan.gamma - 1.0) > 1e-3:
        raise InputError(
            f"response: made for patterns to the power {response.pattern_exponent:g}, the plan "
            f"sends them to the power {1.0 / plan.gamma:g}"
        )
    offsets = np.exp(1j * n * np.asarray(shifts_rad))
    if np.abs(offsets - offsets[0]).max() > 0.1:
        raise InputError("response: a table is right for equal steps only, the plan has others")
    # The error has N periods a turn, counted from the shifts; the table's count from its own.
    away = float(np.angle(offsets[0] * np.exp(-1j * n * response.offset_rad))) / n
    at = (np.arange(BINS) + 0.5 - away * BINS / TURN) % BINS - 0.5
    left = np.floor(at).astype(int)
    share = at - left
    table = response.table_rad
    rolled = table[:, left % BINS] * (1.0 - share) + table[:, (left + 1) % BINS] * share
    return tuple(float(v) for v in rolled.ravel() / TURN)


def empty_maps(
    shape: tuple[int, int], *, sets: int = 0, disagreement: bool = False
) -> dict[str, Any]:
    """Arrays for the kernel to write to; ``sets`` > 0 for wrapped phases as well."""
    phases = np.empty((sets, *shape), np.float32)
    modulations = np.empty((sets, *shape), np.float32)
    # One block: the system hands out memory for several smaller ones half as fast.
    coordinate, sigma, modulation, background = np.empty((4, *shape), np.float32)
    return {
        "coordinate": coordinate,
        "sigma": sigma,
        "modulation": modulation,
        "background": background,
        "reason": np.empty(shape, np.uint8),
        "phases": list(phases),
        "modulations": list(modulations),
        "disagreement": np.empty(shape, np.float32) if disagreement else None,
    }


RESULTS = {
    "coordinate": "coordinate_px",
    "sigma": "sigma_px",
    "modulation": "modulation",
    "background": "background",
    "reason": "reason",
}
"""Arrays of the kernel by the fields of a ``CoordinateMap``."""


def check_reusable(
    earlier: Decoded, axes: tuple[Axis, ...], shape: tuple[int, ...], keep_phases: bool
) -> None:
    """Refuse an earlier result whose maps cannot be written to again."""
    if keep_phases:
        raise InputError("out: expected keep_phases=False, wrapped phases go to new memory only")
    if set(earlier.maps) != set(axes):
        had = ", ".join(earlier.maps)
        raise InputError(f"out: expected a result along {', '.join(axes)}, got one along {had}")
    for found in earlier.maps.values():
        for field in RESULTS.values():
            array = getattr(found, field)
            kind = np.uint8 if field == "reason" else np.float32
            if array.shape != shape or array.dtype != kind:
                raise InputError(
                    f"out: expected {field} as {np.dtype(kind)} {shape}, got {array.dtype} "
                    f"{array.shape}"
                )
            if not (array.flags.c_contiguous and array.flags.writeable):
                raise InputError(f"out: expected {field} as written by decode, got a view of it")


def reused_maps(earlier: Decoded, axis: Axis) -> dict[str, Any]:
    """The arrays of an earlier result for the kernel to write to."""
    found = earlier.maps[axis]
    maps: dict[str, Any] = {name: getattr(found, field) for name, field in RESULTS.items()}
    return maps | {"phases": [], "modulations": [], "disagreement": None}
