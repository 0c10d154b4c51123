"""What a pair's frames and displacement reveal about faults of the capture, and what to do."""

from __future__ import annotations

from typing import get_args

import numpy as np

from fringeworks.pair.carrier import find_carrier
from fringeworks.pair.counting import RowMethod
from fringeworks.pair.rim import Rim
from fringeworks.pair.shadow_orders import MIN_LINES, ShadowOrders
from fringeworks.types import (
    Axis,
    DisplacementMap,
    Finding,
    InputError,
    Pair,
    Pixels,
    Reason,
    count_reasons,
    region_of,
)

TURNED_DEG = 60.0
"""Smallest angle between the fringes of the two frames that is reported, degrees.

A frame turned by 90° shows 90°. Steep objects bend fringes locally, but the strongest line of the
object's spectrum by far less than 45°. An empirical choice.
"""
FINITE_SIGMAS = 5.0
"""Smallest displacement that counts as the object's, in its standard deviations."""
MIN_OBJECT_PERIODS = 0.05
"""Smallest displacement that counts as the object's, periods; the reference plane bends less."""
ONE_SIDED = 0.95
"""Share of the object's pixels on one side of the reference from which the sign is judged."""
MIN_OBJECT_SHARE = 0.01
"""Smallest share of the frame that shows an object."""
NOISY_ROWS = 0.005
"""Median standard deviation from which row methods are advised against, periods."""
MIN_NOISE = 1e-3
"""Smallest noise of both frames that counts as such, as a share of the object frame's contrast.

On frames without noise, row methods have errors of sampling only, and no other method is better.
Rounding to 8 bit is 3e-3 of the largest contrast. An empirical choice.
"""
FEW_MEASURED = 0.5
"""Share of measured pixels below which a large loss is reported."""
MOSAIC_STEP = 0.1
"""Difference in mean brightness between pixels of even and odd rows and columns, over the mean,
from which a frame is a mosaic of colour filters. Raw frames under white light have 0.4 or more,
other frames less than 0.02."""

TEAR_PX = 3
"""Distance over which a tear along the fringes is looked for, px: windows smear one a little."""
TEAR_PERIODS = (0.8, 1.2)
"""Jump that counts as a whole period: the local period of a reference differs from the mean one.
Empirical, from two simulated scenes: steps of other heights are not told, torn or not."""
TEAR_LENGTH = 3.0
"""Shortest tear that is reported, periods: shorter ones are those of single windows. Empirical."""


def pair_findings(pair: Pair, found: DisplacementMap) -> tuple[Finding, ...]:
    """Find likely faults of a capture: what was seen, and what to do about it.

    Parameters
    ----------
    pair : Pair
    found : DisplacementMap
        The displacement of that pair.

    Returns
    -------
    tuple of Finding; empty where nothing was found.
    """
    seen = (
        *frame_findings(pair),
        _same(pair),
        _turned(pair, found),
        _swapped(pair, found),
        _row_method(pair, found),
        _lost_pixels(found),
        _not_converged(found),
        _torn(found),
    )
    return tuple(finding for finding in seen if finding is not None)


def _same(pair: Pair) -> Finding | None:
    """Reference and object are one photograph."""
    if pair.reference is None or not np.array_equal(pair.reference, pair.object):
        return None
    return Finding(
        "same frame",
        "reference and object are equal in every pixel",
        causes=("the same photograph was given twice",),
        advice="give the photograph without the object as the reference",
    )


def frame_findings(pair: Pair) -> tuple[Finding, ...]:
    """Return what the frames alone show: a colour camera's before the channels are separated."""
    counts = np.asarray(pair.object)
    if counts.ndim != 2 or counts.dtype.kind not in "uif" or min(counts.shape) < 2:
        return ()
    frame = np.nan_to_num(counts.astype(np.float64), posinf=0.0, neginf=0.0)
    means = np.array([frame[v::2, u::2].mean() for v in (0, 1) for u in (0, 1)])
    step = float(np.ptp(means) / max(means.mean(), np.finfo(float).tiny))
    if not np.isfinite(step) or step < MOSAIC_STEP:
        return ()
    return (
        Finding(
            "raw colours",
            f"pixels of even and odd rows and columns differ in brightness by {100 * step:.0f} %",
            causes=("the object frame is a raw frame of a colour camera",),
            advice="convert it to grey first; places without fringes cannot be recognised in it",
            figures={"step_share": step},
        ),
    )


def _turned(pair: Pair, found: DisplacementMap) -> Finding | None:
    """Fringes of the two frames that run in different directions."""
    if pair.reference is None:
        return None
    frame = np.nan_to_num(np.asarray(pair.object, dtype=np.float64), posinf=0.0, neginf=0.0)
    try:
        carrier = find_carrier(frame, name="object")
    except InputError:
        return None
    turn = _direction(carrier.axis, carrier.tilt_deg) - _direction(found.axis, found.tilt_deg)
    angle = abs((turn + 90.0) % 180.0 - 90.0)
    if angle < TURNED_DEG:
        return None
    return Finding(
        "turned frame",
        f"the fringes of the object frame are turned by {angle:.0f}° against those of the "
        f"reference, which vary along {found.axis}",
        causes=("one frame is turned by 90°", "the frames belong to different captures"),
        advice="turn one frame, or use frames of the same capture; these results are wrong",
        figures={"angle_deg": angle},
        severity="error",
    )


def _direction(axis: Axis, tilt_deg: float) -> float:
    """Direction in which fringes vary, from x towards y, degrees."""
    return tilt_deg if axis == "x" else 90.0 - tilt_deg


def _swapped(pair: Pair, found: DisplacementMap) -> Finding | None:
    """An object that lies behind the reference plane nearly everywhere."""
    if pair.geometry is None:
        return None
    u = found.displacement_px * pair.geometry.sign
    with np.errstate(invalid="ignore"):
        clear = np.abs(u) > np.maximum(
            FINITE_SIGMAS * found.sigma_px, MIN_OBJECT_PERIODS * found.period_px
        )
    if clear.mean() < MIN_OBJECT_SHARE:
        return None
    behind = float(np.mean(u[clear] < 0))
    if behind < ONE_SIDED:
        return None
    return Finding(
        "swapped frames",
        f"{100 * behind:.0f} % of the object lies behind the reference plane",
        causes=("the two frames are swapped", "the projector is on the other side (sign)"),
        advice="check both; nothing is to be done for a real hollow",
        figures={"share_behind": behind},
    )


def _row_method(pair: Pair, found: DisplacementMap) -> Finding | None:
    """A method of single pixels on frames with noise."""
    ok = np.isfinite(found.sigma_px)
    if found.method not in get_args(RowMethod) or not ok.any():
        return None
    counts = np.asarray(pair.object, dtype=np.float64)
    contrast = float(counts[np.isfinite(counts)].std())
    if found.details["noise_counts"] < MIN_NOISE * contrast:
        return None
    sigma = float(np.median(found.sigma_px[ok]))
    if sigma < NOISY_ROWS * found.period_px:
        return None
    return Finding(
        "row method",
        f"{found.method} uses single pixels and averages no noise: the median standard deviation "
        f"is {sigma:.2f} px",
        advice="use windowed or fourier, which reach a fraction of that on photographs",
        figures={"sigma_px": sigma},
    )


def _lost_pixels(found: DisplacementMap) -> Finding | None:
    """A result that most of the wanted pixels do not have."""
    wanted = found.reason != Reason.MASKED
    if not wanted.any():
        return None
    measured = float(np.isfinite(found.displacement_px[wanted]).mean())
    if measured >= FEW_MEASURED:
        return None
    reasons = count_reasons(found.reason[wanted])
    main = max((name for name in reasons if name != "ok"), key=lambda name: reasons[name])
    return Finding(
        "lost pixels",
        f"only {100 * measured:.0f} % of the pixels are measured; the most frequent reason is "
        f"{main.replace('_', ' ')}",
        advice="check that both frames show the same fringes, sharp and not saturated; the "
        "reason of every pixel is in the map of reasons",
        figures={"measured_share": measured},
    )


def _not_converged(found: DisplacementMap) -> Finding | None:
    """An iteration that ended at its largest number of steps."""
    if found.converged:
        return None
    return Finding(
        "convergence",
        "an iteration of the analysis ended before its result was steady",
        causes=("the frame shows too little plane background", "the fringes are too noisy"),
        advice="do not trust the result: give a reference frame or mark the background "
        "(background), or use another method",
        severity="error",
    )


def _torn(found: DisplacementMap) -> Finding | None:
    """Neighbours along the fringes that differ by about a whole period."""
    u = found.displacement_px if found.axis == "x" else found.displacement_px.T
    with np.errstate(invalid="ignore"):
        jump = np.abs(u[TEAR_PX:] - u[:-TEAR_PX]) / found.period_px
        torn = (jump > TEAR_PERIODS[0]) & (jump < TEAR_PERIODS[1])
    # A tear of one row is seen from so many rows.
    length_px = float(np.count_nonzero(torn)) / TEAR_PX
    if length_px < TEAR_LENGTH * found.period_px:
        return None
    return Finding(
        "torn orders",
        f"along {length_px:.0f} px, the displacement jumps by about a whole period between "
        "neighbours along the fringes",
        causes=(
            "the fringe orders on one side are wrong by one period",
            "the object has a step of that height",
        ),
        advice="do not trust the regions beside these jumps unless the object has such a step; "
        "use shifted fringes with Gray code, or a wider period",
        figures={"length_px": length_px},
    )


def tear_findings(torn: float) -> tuple[Finding, ...]:
    """Return a finding about the share of pixels that were moved back, because they differed by
    whole periods from the surface around them; empty for none."""
    if not torn:
        return ()
    return (
        Finding(
            "torn surface",
            f"{100.0 * torn:.1f} % of the pixels differed by whole fringe "
            "periods from the surface around them, and were moved back",
            advice="check these regions where the object has steps of whole periods",
            figures={"moved_share": torn},
            severity="note",
        ),
    )


def free_findings(shadows: ShadowOrders, *, applied: bool) -> tuple[Finding, ...]:
    """Return a finding about surfaces whose whole periods nothing tells; empty for none.

    ``applied`` is False for a single frame, whose σ does not hold them.
    """
    share = float(shadows.free.mean())
    if share == 0.0:
        return ()
    held = "σ holds one period there" if applied else "σ does not hold that"
    return (
        Finding(
            "whole periods",
            f"{100 * share:.1f} % of the pixels belong to surfaces behind flanks that are "
            f"too steep for the fringes to be followed: the fringes on both sides fit another "
            f"number of whole periods as well, or better; {held}",
            causes=("flanks along which the fringes are compressed to a few pixels",),
            advice="use fringes of a longer period, a smaller angle, or shifted fringes with Gray "
            "code; with a rig, a depth range (depth_mm) tells the periods",
            figures={"free_share": share},
            pixels=Pixels(int(shadows.free.sum()), shadows.free.size, region_of(shadows.free)),
        ),
    )


def shadow_findings(shadows: ShadowOrders, *, applied: bool) -> tuple[Finding, ...]:
    """Return a finding about fringe orders that shadows contradict; empty for none.

    ``applied`` is False for a single frame, where a shadow may be dark paint: nothing is moved or
    removed.
    """
    moved, refused = float(np.mean(shadows.moved != 0)), float(shadows.refused.mean())
    if not (moved or refused or shadows.open_lines >= MIN_LINES):
        return ()
    if applied:
        told_as = "were moved by whole periods", "were removed"
    else:
        told_as = "may be off by whole periods", "may be off by an unknown number of periods"
    return (
        Finding(
            "shadows",
            "shadows contradict the steps beside them by whole fringe periods: "
            f"{100 * moved:.1f} % of the pixels {told_as[0]}, {100 * refused:.1f} % "
            f"{told_as[1]}, and beside {shadows.open_lines} lines, a surface whose border is not "
            "seen may be off by whole periods",
            causes=("a step of half a period or more", "dark paint that looks like a shadow"),
            advice="use fringes of a longer period, or shifted fringes with Gray code, where "
            "the object has such steps",
            figures={
                "moved_share": moved,
                "removed_share": refused,
                "open_lines": float(shadows.open_lines),
            },
        ),
    )


def rim_findings(rim: Rim | None, found: DisplacementMap) -> tuple[Finding, ...]:
    """What the rim of the frame tells of the zero of the displacement; empty where it is at 0.

    Parameters
    ----------
    rim : Rim or None
        None where the rim was not looked at.
    found : DisplacementMap
    """
    if rim is None or not np.isfinite(found.displacement_px).any():
        return ()
    if not rim.is_background:
        return (
            Finding(
                "no background",
                "the rim of the frame does not show the plane of the reference: the zero of the "
                f"displacement is unknown, and its whole periods too; σ has a part of "
                f"{rim.zero_sigma_px:.0f} px for them, which all pixels share",
                causes=("the object fills the frame", "something moved along with the object"),
                advice="leave background free on three sides, or mark it (background), or give a "
                "depth range with a rig; until then, use differences within the surface only",
                figures={"zero_sigma_px": rim.zero_sigma_px},
            ),
        )
    return (_moved_frame(rim),) if rim.significant else ()


def _moved_frame(rim: Rim) -> Finding:
    """Background that is displaced, or a plane that fills the frame."""
    figures = {"shift_px": rim.shift_px, "sigma_px": rim.shift_sigma_px, "turn_deg": rim.turn_deg}
    seen = (
        "the fringes at the rim are displaced by "
        f"{rim.shift_px:+.2f} ± {rim.shift_sigma_px:.2f} px in the middle and turned by "
        f"{rim.turn_deg:+.2f}°"
    )
    causes = ("the camera or the projector moved between the frames", "the pattern drifted")
    if rim.has_object:
        return Finding(
            "moved frame",
            f"{seen}: removed, the background is the zero",
            causes=(*causes, "the rim shows another plane than the reference's"),
            advice="fix camera and projector; zero='reference' keeps this displacement",
            figures=figures,
        )
    return Finding(
        "moved frame",
        f"{seen}, as is the rest of the frame: kept, for nothing else tells the zero; σ has a part "
        f"of {rim.zero_sigma_px:.0f} px for whole periods, which all pixels share",
        causes=("a plane at another height fills the frame", *causes),
        advice="leave background free around the object, or mark it (background); whole periods of "
        "this displacement are unknown",
        figures=figures | {"zero_sigma_px": rim.zero_sigma_px},
    )
