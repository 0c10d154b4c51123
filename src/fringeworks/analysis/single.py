"""A single frame: the plain fringe of its background takes the place of a reference frame."""

from __future__ import annotations

import numpy as np

from fringeworks.analysis.bandpass import band_pass
from fringeworks.carrier import Carrier, find_carrier
from fringeworks.types import BoolMap, Capture, FloatMap, InputError
from fringeworks.unwrap import unwrap

MIN_BACKGROUND = 0.02
"""Smallest share of the frame that makes a background."""
OFF_PLANE_RAD = 0.5
"""Phases further than this from the plane do not belong to the background."""
STEPS = 30
RIM = 0.1
"""Share of each side in which the background is looked for first."""


def plain_reference(frame: FloatMap, finite: BoolMap, capture: Capture) -> tuple[Carrier, FloatMap]:
    """The fringe that the background of a frame continues, over the whole frame.

    Parameters
    ----------
    frame : (h, w) float array, counts, gaps filled
    finite : (h, w) bool array
        False where a gap was filled.
    capture : Capture
        ``background`` says where the reference plane shows; without it the plane is found from
        the frame's rim and whatever continues it.

    Returns
    -------
    carrier : its period and tilt are those of the fitted plane of phase
    reference : (h, w) float64 array, A + B cos(plane), counts

    Raises
    ------
    InputError where there is no carrier, or no background.
    """
    carrier = find_carrier(frame, capture.axis, name="object")
    turned = frame if carrier.axis == "x" else frame.T
    analytic, _ = band_pass(turned, (1.0 / carrier.period_px, carrier.across))
    amplitude = np.abs(analytic)
    usable = finite if carrier.axis == "x" else finite.T
    usable = usable & (amplitude > 0.1 * np.median(amplitude))
    given = capture.background
    if given is not None:
        if given.shape != frame.shape:
            raise InputError(f"background: expected shape {frame.shape}, got {given.shape}")
        usable = usable & (given if carrier.axis == "x" else given.T)
    if usable.mean() < MIN_BACKGROUND:
        raise InputError(
            f"background: expected fringes over at least {MIN_BACKGROUND:.0%} of the frame, "
            f"got {usable.mean():.1%}"
        )
    h, w = turned.shape
    x, y = np.arange(w)[None, :], np.arange(h)[:, None]
    steep: FloatMap = 2.0 * np.pi * (x / carrier.period_px + y * carrier.across)
    slow = np.angle(analytic * np.exp(-1j * steep))
    unwrapped = unwrap(slow, usable)
    inside = unwrapped.region == 1
    plane, background = _fit_background(unwrapped.phase, inside, found=given is None)
    phase = steep + plane[0] + plane[1] * x + plane[2] * y
    level = float(turned[background].mean())
    modulation = 2.0 * float(np.median(amplitude[background]))
    reference = level + modulation * np.cos(phase)
    fx = 1.0 / carrier.period_px + plane[1] / (2.0 * np.pi)
    fy = carrier.across + plane[2] / (2.0 * np.pi)
    found = Carrier(carrier.axis, 1.0 / fx, carrier.share, fy)
    return found, np.ascontiguousarray(reference if carrier.axis == "x" else reference.T)


def _fit_background(phase: FloatMap, inside: BoolMap, *, found: bool) -> tuple[FloatMap, BoolMap]:
    """Plane of phase through the background, and the background.

    A found background starts as the rim; pixels that the plane explains join, others leave, until
    nothing changes.
    """
    h, w = phase.shape
    y, x = np.nonzero(inside)
    values = phase[inside].astype(np.float64)
    design = np.column_stack((np.ones(values.size), x, y))
    member = np.ones(values.size, bool)
    if found:
        by, bx = RIM * h, RIM * w
        rim = (x < bx) | (x >= w - bx) | (y < by) | (y >= h - by)
        member = rim if rim.mean() > MIN_BACKGROUND else member
    plane: FloatMap = np.zeros(3)
    for _ in range(STEPS):
        solved = np.linalg.lstsq(design[member], values[member], rcond=None)[0]
        plane = np.asarray(solved, dtype=np.float64)
        distance = values - design @ plane
        limit = max(OFF_PLANE_RAD, 2.0 * float(np.median(np.abs(distance[member]))))
        joined = np.abs(distance) < limit
        if not found or joined.mean() < MIN_BACKGROUND or (joined == member).all():
            break
        member = joined
    background = np.zeros(phase.shape, bool)
    background[y[member], x[member]] = True
    return plane, background
