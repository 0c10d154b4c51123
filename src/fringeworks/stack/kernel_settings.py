"""Settings of the decoding kernel for one axis of a plan, and the arrays of its results."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from fringeworks import _core
from fringeworks.patterns.chain_search import ALTERNATIVE_SIGMAS, ORDER_SIGMAS
from fringeworks.patterns.order_chain import TURN, OrderChain
from fringeworks.patterns.plan import PatternPlan, PhaseSteps, step_design
from fringeworks.signal.phase_table import TABLE_BINS
from fringeworks.signal.response import Response
from fringeworks.stack.gray_frames import GrayFrames, gray_frames
from fringeworks.statistics.chi_square import chi_square_quantile
from fringeworks.types import (
    Axis,
    BoolMap,
    CameraNoise,
    Decoded,
    InputError,
    Reason,
    check_reusable,
    unsealed,
)

HARMONICS = (2, 3, 4)
"""Harmonics of the fringe that a response which is not linear adds; higher ones are weak."""

MIN_SNR = 4.0
"""Smallest modulation of a fringe, in standard deviations of the modulation.

Noise alone has a modulation of one to two standard deviations, and exceeds four in 0.03 % of the
pixels (Rayleigh distribution). A larger value would discard weak fringes that can still be used.
"""

LEAST_SNR = 2.0
"""The same against all that scatters along smooth lines, too. At three, phase errors are 4 % larger
than their σ, at two a fifth; below, they are no longer those of a normal distribution."""

SEAM_SIGMAS = 3.0
"""Largest distance of a coordinate beyond the range or its Gray-code cell, in standard deviations.

Noise moves one pixel in a thousand next to the end of the range by more than three. A larger value
accepts more of what lies beyond. An empirical choice.
"""

LOST_SHARE = 1e-7
"""Share of pixels with right fringe orders that the test of the sets' disagreement may discard.

It sets the quantile of χ². A frame of two megapixels loses a fifth of a pixel on average, so the
test discards hardly any good pixel, and wrong orders exceed the quantile by far. An empirical
choice.
"""

EXPONENT_TOLERANCE = 1e-3
"""Largest relative difference between the exponents of the response's and the plan's patterns.

Larger than the rounding of numbers in files, smaller than any deliberate change of γ.
"""

UNEQUAL_STEPS = 0.1
"""Largest |e^{iNδ_n} − e^{iNδ_0}| up to which N steps count as equal.

It allows errors of 0.1/N rad per step, such as shifts given in rounded degrees. An empirical
choice.
"""


@dataclass(frozen=True)
class Limits:
    """Limits that a pixel's samples, modulation and disagreement must keep."""

    saturation: float
    """Counts from which on a sample is left out of the fit; infinity for none."""
    min_modulation: float = 0.0
    """Modulation below which a pixel is not used, counts; ≥ 0."""
    max_disagreement: float | None = None
    """Largest χ² of the sets' disagreement; None for the quantile that ``LOST_SHARE`` sets."""
    given: bool = True
    """Whether the caller gave the saturation. Otherwise it applies only if light exceeds it."""
    darkest: float = 0.0
    """Counts below which the sensor cuts off; minus infinity for samples that may be negative."""

    @property
    def open(self) -> Limits:
        """The limits without that of the sets' disagreement."""
        return replace(self, max_disagreement=float("inf"))

    @property
    def threshold(self) -> float:
        """The saturation for the kernels, counts. NaN disables it: ``v >= NaN`` is always false."""
        return self.saturation if np.isfinite(self.saturation) else float("nan")


@dataclass(frozen=True)
class PhaseFrames:
    """One set of steps: the indices of its frames in the plan, and their shifts."""

    frames: tuple[int, ...]
    """Index of every frame in the plan."""
    shifts_rad: tuple[float, ...]
    """Shift of every frame, rad."""
    period_px: float
    """Period of the fringes, projector px."""
    line_px: float | None = None
    """Width of a bright line in every period, projector px; None for a cosine."""
    design: tuple[tuple[float, float, float], ...] = ()
    """What every frame really shows of A, c and s (real steps and gains); that of the shifts where
    empty."""
    unsure: bool = False
    """Whether the design contains corrections that may be chance: they are no reason to report
    other steps than those of the plan."""
    harmonics: tuple[tuple[float, ...], ...] = ()
    """What the fit of A, c and s leaves of every frame, as shares of the harmonics of the fringe;
    nothing where empty."""
    offsets: tuple[float, ...] = ()
    """Light of every frame that is the same at all pixels, counts, as far as it looks like A, c and
    s; nothing where empty."""
    floor_rad: float = 0.0
    """Standard deviation of the phase error that does not shrink with the modulation, rad."""
    table_turns: tuple[float, ...] = ()
    """Phase errors of the response, turns: a row of 256 per brightness, or nothing."""
    brightness: tuple[float, ...] = ()
    """Brightness of every row, counts, rising."""

    @property
    def rows(self) -> tuple[tuple[float, float, float], ...]:
        """The design matrix of the fit: what every frame shows of A, c and s."""
        return self.design or planned_rows(self.shifts_rad)

    def kernel(self, place: dict[int, int]) -> _core._PhaseSet:
        """The set for the kernel; ``place`` is that of every frame in the kernel's order."""
        return {
            "frames": [place[k] for k in self.frames],
            "shifts": list(self.shifts_rad),
            "design": list(self.design),
            "offsets": list(self.offsets),
            "period": self.period_px,
            "floor": self.floor_rad**2,
            "whole": self.line_px is not None,
            "harmonics": {
                "orders": HARMONICS if self.harmonics else (),
                "shares": [share for row in self.harmonics for share in row],
            },
            "table": {"turns": list(self.table_turns), "brightness": list(self.brightness)},
        }


@lru_cache(maxsize=256)
def planned_rows(shifts_rad: tuple[float, ...]) -> tuple[tuple[float, float, float], ...]:
    """What frames of these shifts show of A, c and s: (1, cos δ, sin δ)."""
    return tuple((float(a), float(c), float(s)) for a, c, s in step_design(shifts_rad))


@dataclass(frozen=True)
class Decoding:
    """Everything that decides how one axis is decoded, except for noise and limits."""

    axis: Axis
    """x: projector columns are decoded; y: projector rows."""
    sets: tuple[PhaseFrames, ...]
    """Sets of steps along the axis, in the plan's order; empty for a Gray code alone."""
    gray: GrayFrames | None
    """The Gray code along the axis; None where there is none or it is not needed."""
    chain: OrderChain | None
    """How fringe orders are resolved; None for a Gray code alone."""
    length_px: float
    """Length of the range of coordinates, projector px."""
    absolute: bool = True
    """False for coordinates modulo ``length_px``."""
    noise_factor: float = 1.0
    """Variance of the noise along the axis over that of the camera, ≥ 1."""
    order_errors: tuple[float, ...] = ()
    """Errors of every rounding of the chain that are no noise, turns; none where empty."""
    largest_remainders: tuple[float, ...] = ()
    """Largest remainder of every rounding, plus six standard deviations of its noise, by the errors
    of all pixels that are no noise, turns; none where empty."""
    reach_px: float | None = None
    """Largest distance of a coordinate from the middle of its Gray-code cell, projector px.

    None for ``GRAY_REACH`` cells.
    """

    @property
    def longest_px(self) -> float:
        """Range over which the phases alone determine the coordinate, projector px."""
        return float("inf") if self.chain is None else 1.0 / float(self.chain.frequencies[0])

    @property
    def repeats_px(self) -> float:
        """Distance after which coordinates repeat, projector px; infinite for absolute ones."""
        return float("inf") if self.absolute else self.length_px

    @property
    def finest_px(self) -> float:
        """Shortest period, projector px; 0 for a Gray code alone."""
        return min((phases.period_px for phases in self.sets), default=0.0)

    @property
    def most_scatter_px(self) -> float:
        """Half the shortest period, projector px: neighbours that differ by more are at different
        depths, because errors of a phase stay below."""
        return 0.5 * self.finest_px

    @property
    def _start_error_px(self) -> float:
        """Error that is no noise of the rounding from a Gray-code cell, projector px."""
        if self.chain is None or not self.order_errors or self.chain.remainder[0] != 0:
            return 0.0
        return self.order_errors[0] * self.longest_px

    @property
    def free(self) -> Decoding:
        """The decoding with coordinates at any distance from their Gray-code cell."""
        return replace(self, reach_px=float("inf"))

    @property
    def nearest(self) -> Decoding:
        """The decoding with the nearest orders wherever the noise allows, whatever the remainders:
        errors of all sizes are seen."""
        if self.chain is None:
            return self.free
        chain = replace(self.chain, largest_sigma=self.chain.tolerance / ORDER_SIGMAS)
        if self.gray is not None:
            return replace(self.free, chain=chain)
        chain = replace(chain, alternative=np.where(chain.wraps, chain.alternative, np.inf))
        return replace(self.free, chain=chain, order_errors=(), largest_remainders=())

    @property
    def frames(self) -> list[int]:
        """Indices of the frames in the kernel's order: phase frames, then the Gray code's."""
        return self.phase_frames + self.gray_frames

    @property
    def phase_frames(self) -> list[int]:
        """Indices of the phase frames, set after set."""
        return [k for phases in self.sets for k in phases.frames]

    @property
    def gray_frames(self) -> list[int]:
        """Indices of the Gray code's frames: bits, inverse bits, white and black frame."""
        if self.gray is None:
            return []
        return [*self.gray.bits, *self.gray.inverse, *(self.gray.white_black or ())]

    def kernel(
        self, noise: CameraNoise, limits: Limits, usual_inflation: float = 1.0
    ) -> _core.DecodeSettings:
        """Settings for the kernel; ``usual_inflation`` is that of ``local_errors.inflation``."""
        place = {frame: k for k, frame in enumerate(self.frames)}
        largest = limits.max_disagreement
        if largest is None:
            freedom = max(1, len(self.sets) - 1)
            largest = chi_square_quantile(1.0 - LOST_SHARE, freedom)
        return _core.DecodeSettings(
            sets=[phases.kernel(place) for phases in self.sets],
            gray_code=None
            if self.gray is None
            else self.gray.kernel(place, self.longest_px, self.reach_px, self._start_error_px),
            chain=self._kernel_chain(),
            noise={
                "read_variance": noise.read_counts**2 * self.noise_factor,
                "gain": noise.gain * self.noise_factor,
            },
            limits={
                "saturation": limits.threshold,
                # Fringes are seen against the noise of the camera alone.
                "min_snr": max(MIN_SNR / self.noise_factor**0.5, LEAST_SNR),
                "min_modulation": limits.min_modulation,
                "max_disagreement": largest,
                "usual_inflation": usual_inflation,
                "confidence": SEAM_SIGMAS,
                "order_confidence": ALTERNATIVE_SIGMAS,
            },
        )

    def _kernel_chain(self) -> _core._Chain:
        """The kernel's chain of roundings; one without combinations for a Gray code alone."""
        chain, half, empty = self.chain, 0.5 * self.length_px, np.empty(0, np.float32)
        found: _core._Chain = {
            "combinations": empty.reshape(0, 0),
            "frequencies": empty,
            "amplification": empty.reshape(0, 0),
            "margin": empty,
            "remainder": [],
            "alternative": empty,
            "order_variance": (0.0, 0.0),
            "repeats": float("inf"),
            "middle": half - 0.5,
            "half": half,
            "circular": not self.absolute,
        }
        if chain is None:
            return found
        lost = np.array(self.order_errors or 0.0)
        left = np.maximum(1.0 - lost / chain.tolerance, 0.0)
        # Where the first combination can wrap, or starts from a Gray code, the estimate of every
        # pixel decides alone.
        alone = chain.wraps | ((chain.remainder == 0) & (self.gray is not None))
        largest = np.where(left > 0.0, chain.largest_sigma, 0.0) * left
        margin = np.where(alone, np.inf, largest)
        away = np.minimum(chain.alternative, self.largest_remainders or np.inf)
        alternative = np.maximum(away - lost, 0.0)
        return {
            **found,
            "combinations": np.ascontiguousarray(chain.combinations, np.float32),
            "frequencies": np.ascontiguousarray(chain.frequencies, np.float32),
            "amplification": np.ascontiguousarray(chain.amplification**2, np.float32),
            "margin": np.ascontiguousarray(margin**2, np.float32),
            "remainder": [int(k) for k in chain.remainder],
            "alternative": np.ascontiguousarray(alternative, np.float32),
            "order_variance": chain.order_variance,
            "repeats": chain.repeats_px,
        }


def decoding_of(
    plan: PatternPlan, axis: Axis, *, absolute: bool, response: Response | None
) -> Decoding:
    """The decoding of one axis of a plan.

    Raises
    ------
    InputError
        If the periods do not determine the coordinate, the bits of a Gray code cannot be decided,
        or the response does not fit the patterns.
    """
    sets = tuple(
        PhaseFrames(
            tuple(range(first, first + block.frames)),
            block.shifts_rad,
            block.period_px,
            block.line_px,
            table_turns=_table(plan, block, response),
            brightness=() if response is None else response.brightness,
        )
        for first, block in plan.phase_sets(axis)
    )
    if not absolute and not sets:
        raise InputError("relative coordinates: expected fringes, got Gray code only")
    placed = plan.gray_code(axis)
    gray = None
    if placed is not None and absolute:
        gray = gray_frames(plan, *placed, phases=bool(sets))
    chain = plan.chain(axis, absolute=absolute) if sets else None
    length = float(plan.length_px(axis)) if absolute or chain is None else chain.high_px + 0.5
    return Decoding(axis, sets, gray, chain, length, absolute)


def _table(plan: PatternPlan, block: PhaseSteps, response: Response | None) -> tuple[float, ...]:
    """The response's phase errors for these shifts, turns."""
    if response is None:
        return ()
    shifts_rad, n = block.shifts_rad, block.frames
    if block.line_px is not None:
        raise InputError("response: it was measured with cosines, got lines in the plan")
    if n != response.steps:
        raise InputError(f"response: made for {response.steps} steps, the plan has {n}")
    if abs(response.pattern_exponent * plan.gamma - 1.0) > EXPONENT_TOLERANCE:
        raise InputError(
            f"response: made for patterns with the exponent {response.pattern_exponent:g}, the "
            f"plan has the exponent {1.0 / plan.gamma:g}"
        )
    offsets = np.exp(1j * n * np.asarray(shifts_rad))
    if np.abs(offsets - offsets[0]).max() > UNEQUAL_STEPS:
        raise InputError("response: expected equal steps in the plan, got unequal ones")
    # The phase error moves with the first shift, modulo a period of 1/N turn. The table starts at
    # the response's first shift, the plan at its own.
    away = float(np.angle(offsets[0] * np.exp(-1j * n * response.offset_rad))) / n
    at = (np.arange(TABLE_BINS) + 0.5 - away * TABLE_BINS / TURN) % TABLE_BINS - 0.5
    below = np.floor(at).astype(int)
    share = at - below
    table = response.table_rad
    rolled = (
        table[:, below % TABLE_BINS] * (1.0 - share) + table[:, (below + 1) % TABLE_BINS] * share
    )
    return tuple(float(v) for v in rolled.ravel() / TURN)


def lit_pixels(maps: dict[str, Any]) -> BoolMap:
    """Mark pixels with fringes in all sets in the kernel's maps, whether or not their fringe orders
    are known."""
    reason = maps["reason"]
    return np.asarray((reason == Reason.OK) | (reason == Reason.ORDER_AMBIGUOUS))


def empty_maps(
    shape: tuple[int, int], *, sets: int = 0, disagreement: bool = False
) -> dict[str, Any]:
    """New arrays for the kernel to write to, with the wrapped phases of ``sets`` sets."""
    phases = np.empty((sets, *shape), np.float32)
    modulations = np.empty((sets, *shape), np.float32)
    # One block of memory: the system provides several smaller ones at half the speed.
    coordinate, sigma, modulation, background = np.empty((4, *shape), np.float32)
    return {
        "coordinate": coordinate,
        "sigma": sigma,
        "modulation": modulation,
        "background": background,
        "reason": np.empty(shape, np.uint8),
        "phases": list(phases),
        "modulations": list(modulations),
        "variances": [],
        "cells": [],
        "disagreement": np.empty(shape, np.float32) if disagreement else None,
        "inflation": None,
    }


RESULTS = {
    "coordinate": "coordinate_px",
    "sigma": "sigma_px",
    "modulation": "modulation",
    "background": "background",
    "reason": "reason",
}
"""Names of the kernel's arrays and the fields of a ``CoordinateMap`` that hold them."""


def check_reusable_result(
    earlier: Decoded, axes: tuple[Axis, ...], shape: tuple[int, ...], keep_phases: bool
) -> None:
    """Refuse an earlier result whose maps the kernel cannot write to again."""
    if keep_phases:
        raise InputError("out: expected keep_phases=False, because wrapped phases need new memory")
    if set(earlier.maps) != set(axes):
        got = ", ".join(earlier.maps)
        raise InputError(f"out: expected a result along {', '.join(axes)}, got one along {got}")
    expected = {
        field: (shape, np.uint8 if field == "reason" else np.float32) for field in RESULTS.values()
    }
    for coordinate_map in earlier.maps.values():
        check_reusable({field: getattr(coordinate_map, field) for field in expected}, expected)


def reused_maps(earlier: Decoded, axis: Axis) -> dict[str, Any]:
    """The arrays of an earlier result, writable again, for the kernel to write to."""
    earlier_map = earlier.maps[axis]
    maps: dict[str, Any] = {
        name: unsealed(getattr(earlier_map, field)) for name, field in RESULTS.items()
    }
    return maps | {
        "phases": [],
        "modulations": [],
        "variances": [],
        "cells": [],
        "disagreement": None,
        "inflation": None,
    }
