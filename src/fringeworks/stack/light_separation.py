"""Direct and indirect light of a scene, from the frames that measure its shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import PatternPlan, PhaseSteps
from fringeworks.signal.response import Response
from fringeworks.stack.frames import check_frames
from fringeworks.stack.wrapped import wrapped_phase
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
    positive,
    sealed,
)

NO_BLACK = Finding(
    "room light",
    "the plan has no black frame, so indirect light contains twice the light of the room and the "
    "black level",
    advice="darken the room, or add a black frame to the plan",
    severity="note",
)
"""What separated light says of itself where no black frame was subtracted."""


@dataclass(frozen=True, eq=False, repr=False)
class LightSeparation(Noted, Plotted, Frozen):
    """What a camera would see under a white projector: light that came straight, and all other."""

    layout = {  # noqa: RUF012
        "direct": "fiu hw",
        "direct_sigma": "fiu hw",
        "indirect": "fiu hw",
        "indirect_sigma": "fiu hw",
        "reason": "ui hw",
    }

    direct: FloatMap
    """Light that came straight from the projector, (h, w), counts; NaN where undetermined."""
    direct_sigma: FloatMap
    """Its standard deviation from the camera's noise, (h, w), counts."""
    indirect: FloatMap
    """Light by way of other surfaces or from within the material, (h, w), counts. Without a black
    frame it contains twice the light of the room and the black level."""
    indirect_sigma: FloatMap
    """Its standard deviation from the camera's noise, (h, w), counts."""
    reason: ByteMap
    """``Reason`` per pixel, (h, w)."""
    period_px: float
    """Period of the fringes that were used, projector px."""
    has_black: bool
    """Whether a black frame was subtracted."""
    contrast: float = 1.0
    """Contrast of the fringes on a surface without indirect light, as it was given."""
    findings: tuple[Finding, ...] = ()
    """What was found in the frames."""
    provenance: Provenance | None = None

    @property
    def failed_fraction(self) -> float:
        """Share of the pixels that could not be measured."""
        return float(np.mean(self.reason != Reason.OK))

    @property
    def indirect_share(self) -> float:
        """Indirect light over all light, of the pixels that were measured together, 0…1."""
        ok = self.reason == Reason.OK
        direct, indirect = float(self.direct[ok].sum()), float(self.indirect[ok].sum())
        return max(indirect, 0.0) / max(direct + max(indirect, 0.0), np.finfo(float).tiny)


def separate_light(
    frames: NDArray[Any] | Sequence[NDArray[Any]],
    plan: PatternPlan,
    *,
    contrast: float = 1.0,
    noise: CameraNoise | None = None,
    saturation: float | None = None,
    response: Response | None = None,
) -> LightSeparation:
    """Separate direct from indirect light of frames in the order of a plan; the public
    ``fringeworks.stack.separate_light`` describes the parameters and the method."""
    if not (positive(contrast) and contrast <= 1.0):
        raise InputError(f"contrast: expected above 0 and up to 1, got {contrast:g}")
    frames = check_frames(frames, plan)
    sets = [(k, b) for k, b in plan.placed if isinstance(b, PhaseSteps) and b.line_px is None]
    if not sets:
        raise InputError("plan: expected a set of phase steps with a cosine, got none")
    first, steps = min(sets, key=lambda placed: placed[1].period_px)
    found = wrapped_phase(
        frames[first : first + steps.frames],
        steps.shifts_rad,
        noise=noise,
        saturation=saturation,
        response=response,
    )
    at = plan.uniform("black")
    black = np.zeros(()) if at is None else np.asarray(frames[at], np.float64)
    direct = found.modulation * (2.0 / contrast)
    indirect = 2.0 * (found.background - black) - direct
    variance = np.asarray(found.noise.variance(np.maximum(found.background, 0.0)))
    of_black = np.asarray(found.noise.variance(np.maximum(black, 0.0))) if black.ndim else 0.0
    # Least squares over N equal steps: var A = σ²/N and var B = 2 σ²/N, uncorrelated.
    of_direct = variance * (8.0 / (steps.frames * contrast**2))
    of_indirect = of_direct + 4.0 * (variance / steps.frames + of_black)
    ok = found.reason == Reason.OK

    def known(values: FloatMap) -> FloatMap:
        return sealed(np.where(ok, values, np.nan).astype(np.float32))

    return LightSeparation(
        known(direct),
        known(np.sqrt(of_direct)),
        known(indirect),
        known(np.sqrt(of_indirect)),
        found.reason,
        steps.period_px,
        has_black=at is not None,
        contrast=contrast,
        findings=found.findings if black.ndim else (*found.findings, NO_BLACK),
    )
