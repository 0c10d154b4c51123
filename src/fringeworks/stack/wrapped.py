"""Wrapped phase of one set of phase steps, where neither period nor projector is known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.order_chain import TURN
from fringeworks.patterns.plan import PatternPlan, PhaseSteps
from fringeworks.signal.response import Response
from fringeworks.stack.decode import decode
from fringeworks.types import (
    ByteMap,
    CameraNoise,
    Finding,
    FloatMap,
    Frozen,
    InputError,
    Noted,
    Plotted,
    Provenance,
    Reason,
    sealed,
)

DEGREES_TOLERANCE = 1e-3
"""Relative deviation up to which equal steps fill whole turns of 360: shifts in degrees are written
with four digits or more. Steps in radians that do so would be 57 times those that are used."""


@dataclass(frozen=True, eq=False, repr=False)
class WrappedPhase(Noted, Plotted, Frozen):
    """The phase of shifted fringes at every camera pixel, modulo 2π."""

    layout = {  # noqa: RUF012
        "phase_rad": "fiu hw",
        "sigma_rad": "fiu hw",
        "modulation": "fiu hw",
        "background": "fiu hw",
        "reason": "ui hw",
    }

    phase_rad: FloatMap
    """φ of I_n = A + B cos(φ − δ_n), (h, w), −π…π rad; NaN where it cannot be measured."""
    sigma_rad: FloatMap
    """Standard deviation of the phase, (h, w), rad; NaN where the phase is."""
    modulation: FloatMap
    """B, (h, w), counts; NaN where undetermined."""
    background: FloatMap
    """A, (h, w), counts."""
    reason: ByteMap
    """``Reason`` per pixel, (h, w)."""
    shifts_rad: tuple[float, ...]
    """Shifts δ_n, rad."""
    noise: CameraNoise
    """Noise of the camera, from which the standard deviations come."""
    findings: tuple[Finding, ...] = ()
    """What was found in the frames, and what was decided because of it."""
    provenance: Provenance | None = None
    """How it was made; None where the caller gave arrays."""

    @property
    def failed_fraction(self) -> float:
        """Share of pixels without a phase, 0…1."""
        return float(np.mean(self.reason != Reason.OK))


class _Steps(PhaseSteps):
    """Phase steps of an unknown period, with the shifts as names of the frames."""

    def labels(self) -> list[str]:
        return [f"of {math.degrees(shift):g}°" for shift in self.shifts_rad]


def steps_plan(shifts_rad: Sequence[float], *, gamma: float = 1.0) -> PatternPlan:
    """A plan of one set of steps alone, for functions that check frames against a plan.

    It describes no projector. Its period is 2π "px", so that its relative coordinates are phases.
    """
    shifts = tuple(float(shift) for shift in shifts_rad)
    _refuse_degrees(shifts)
    return PatternPlan(2, 2, (_Steps("x", TURN, shifts),), gamma=gamma)


def _refuse_degrees(shifts: tuple[float, ...]) -> None:
    """Refuse shifts beyond a turn that are whole numbers, or equal steps of 360/N.

    In radians, steps that fill turns are multiples of π, which are never whole.
    """
    if not all(math.isfinite(shift) for shift in shifts):
        return  # the plan refuses them
    steps = [b - a for a, b in pairwise(shifts)]
    turns = [len(shifts) * step / 360.0 for step in steps]
    fills = bool(steps) and all(
        round(turn) != 0 and math.isclose(turn, round(turn), rel_tol=DEGREES_TOLERANCE)
        for turn in turns
    )
    whole = all(shift.is_integer() for shift in shifts)
    if max(map(abs, shifts), default=0.0) > TURN and (whole or fills):
        told = ", ".join(f"{shift:g}" for shift in shifts)
        raise InputError(
            f"shifts: expected radians, got {told}, which look like degrees; convert them with "
            "numpy.radians"
        )


def wrapped_phase(
    frames: NDArray[Any] | Sequence[NDArray[Any]],
    shifts_rad: Sequence[float],
    *,
    noise: CameraNoise | None = None,
    saturation: float | None = None,
    min_modulation: float = 0.0,
    response: Response | None = None,
    estimate_steps: bool = True,
) -> WrappedPhase:
    """Compute the wrapped phase of shifted fringes that are arrays; the public
    ``fringeworks.stack.wrapped_phase`` describes the parameters and the method."""
    gamma = 1.0 if response is None else 1.0 / response.pattern_exponent
    decoded = decode(
        frames,
        steps_plan(shifts_rad, gamma=gamma),
        noise=noise,
        saturation=saturation,
        min_modulation=min_modulation,
        absolute=False,
        response=response,
        estimate_steps=estimate_steps,
        keep_phases=True,
    )
    found = decoded.x
    assert found is not None
    assert found.phase_rad is not None
    # The period is 2π: a coordinate and its standard deviation in "px" are those of the phase.
    return WrappedPhase(
        phase_rad=sealed(np.where(found.reason == Reason.OK, found.phase_rad[0], np.nan)),
        sigma_rad=found.sigma_px,
        modulation=found.modulation,
        background=found.background,
        reason=found.reason,
        shifts_rad=tuple(float(shift) for shift in shifts_rad),
        noise=decoded.noise,
        findings=decoded.findings,
    )
