"""What a sequence cannot tell of its motion, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fringeworks.stack.examine import Judgement
from fringeworks.stack.kernel_settings import PhaseFrames
from fringeworks.stack.motion_path import LIKELY
from fringeworks.stack.real_frames import real_step_errors
from fringeworks.stack.unmeasured import LARGE_SHARE
from fringeworks.types import BoolMap, CoordinateMap, Finding, FloatMap
from fringeworks.types.numbers import number, percent, sigma_text
from fringeworks.types.packages import cv2

ALIAS = 0.05
"""Probability of a period from which on it is named beside the likeliest one."""
SAME_PERIOD = 0.2
"""Relative difference of periods up to which they are one: a few cycles do not tell them apart."""
CYCLES_PER_PERIOD = 4
"""Cycles of the plan per period of a vibration that follow it surely."""
OTHER_STEPS = 0.5
"""Change of the errors of phase steps from one cycle to another, over the largest of them, from
which on they come from motion. The steps of a projector are the same in every cycle."""
FASTER = 2
"""Factor on the frame rate that is advised where motion is slow: it halves the way in a cycle."""


def unsteady(
    found: CoordinateMap,
    path_sigma_px: FloatMap,
    vibrations: Mapping[float, FloatMap],
    cycle: int,
) -> Finding | None:
    """Name motion between the frames that adds more to σ than everything else does.

    Parameters
    ----------
    found : CoordinateMap
        With σ that contains ``path_sigma_px``.
    path_sigma_px : (h, w) array, projector px
    vibrations : arrays of blocks by period in frames
        Probability of a vibration of that period.
    cycle : int
        Frames of the plan.

    Returns
    -------
    Finding, or None where it concerns less than a tenth of the measured pixels.
    """
    measured = np.isfinite(found.coordinate_px)
    with np.errstate(invalid="ignore"):
        unsure = measured & (path_sigma_px > 0.5**0.5 * found.sigma_px)
    share = float(unsure.sum() / max(measured.sum(), 1))
    if share <= LARGE_SHARE:
        return None
    sigma = float(np.median(path_sigma_px[unsure]))
    periods = _periods(vibrations, unsure)
    figures = {"share": share, "sigma_px": sigma}
    if not periods:
        cause = f"motion that starts, stops or turns within a cycle of {cycle} frames"
        rate, aim = CYCLES_PER_PERIOD, "so that a change of the motion takes several cycles"
    elif min(periods) >= CYCLES_PER_PERIOD * cycle:
        # The cycles follow so slow a vibration; what they do not tell comes from edges and paint.
        cause = "a velocity that changes slowly, or edges and paint that move across the image"
        rate, aim = FASTER, "so that the scene moves less from one cycle to the next"
    else:
        # A period that is likelier than others may be one of several that look alike.
        named = " or ".join(number(period, digits=2) for period in periods)
        alike = ", which look alike at this frame rate" if len(periods) > 1 else ""
        cause = f"a vibration with a period of {named} frames{alike}"
        rate = int(np.ceil(CYCLES_PER_PERIOD * cycle / min(periods)))
        aim = f"so that a period of the vibration takes {CYCLES_PER_PERIOD} cycles"
        figures["period_frames"] = periods[0]
    figures["rate_factor"] = float(rate)
    return Finding(
        "motion between frames",
        f"the frames do not tell how {percent(share)} of the measured pixels move along "
        f"{found.axis}; their standard deviations contain {sigma_text(sigma, 'px')} for it",
        (cause,),
        f"take {rate} times as many frames per second, or a plan of fewer frames, {aim}",
        axis=found.axis,
        figures=figures,
    )


def of_motion(
    judged: Judgement, others: Sequence[Judgement], labels: Sequence[str]
) -> tuple[Finding, ...]:
    """The findings of a judgement, with motion as the cause of steps that differ between cycles.

    Parameters
    ----------
    judged : Judgement
    others : Judgement
        Those of frames of other cycles.
    labels : str
        Labels of the frames of the plan.
    """
    found = []
    for one in judged.findings:
        axis = one.axis
        if one.kind == "steps" and axis is not None:
            sets = judged.axes[axis].decoding.sets
            named = [tuple(labels[k] for k in phases.frames) for phases in sets]
            number = named.index(one.frames)
            own = _step_errors(sets[number])
            there = [_step_errors(other.axes[axis].decoding.sets[number]) for other in others]
            if any(np.abs(off - own).max() > OTHER_STEPS * np.abs(own).max() for off in there):
                one = _moving(one)
        found.append(one)
    return tuple(found)


def _moving(finding: Finding) -> Finding:
    return replace(
        finding,
        kind="motion",
        seen=f"{finding.seen}; they are others in another cycle",
        causes=("motion or vibration while the frames of a set are taken", "wrong steps besides"),
        advice="keep the scene at rest or take the frames faster",
    )


def _step_errors(phases: PhaseFrames) -> NDArray[np.float64]:
    """Errors of the steps of a set, rad; 0 where none are reported."""
    if not phases.design or phases.unsure:
        return np.zeros(len(phases.shifts_rad))
    return real_step_errors(phases)


def _periods(vibrations: Mapping[float, FloatMap], unsure: BoolMap) -> list[float]:
    """Periods of the vibrations that pixels may have, the likeliest first; none where they rather
    move otherwise."""
    if not vibrations:
        return []
    rows, columns = next(iter(vibrations.values())).shape
    size = (columns, rows)
    share = cv2.resize(unsure.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    chances = {p: float(np.average(v, weights=share + 1e-9)) for p, v in vibrations.items()}
    if sum(chances.values()) < LIKELY:
        return []
    named: dict[float, float] = {}
    for period, chance in sorted(chances.items(), key=lambda one: -one[1]):
        near = [p for p in named if abs(p - period) < SAME_PERIOD * p]
        place = near[0] if near else period
        named[place] = named.get(place, 0.0) + chance
    return [period for period, chance in named.items() if chance >= ALIAS]
