"""A single frame: the plain fringe of its background takes the place of a reference frame."""

from __future__ import annotations

import numpy as np

from fringeworks.pair.bandpass import band_pass
from fringeworks.pair.carrier import Carrier, find_carrier
from fringeworks.pair.unwrap import unwrap
from fringeworks.types import BoolMap, FloatMap, InputError, Pair

MIN_BACKGROUND = 0.02
"""Smallest share of the frame that makes a background."""
OFF_PLANE_RAD = 0.5
"""Phases further than this from the plane do not belong to the background."""
WEAK = 0.3
"""Fringes weaker than this share of the frame's strong ones are no background."""
MAX_POINTS = 100_000
NEAREST = 0.1
"""No corner of a plane is seen more than ten times closer than its middle."""
MIN_SIDE = 16
"""Narrower frames show no perspective."""
STEPS = 30
RIM = 0.1
"""Share of each side in which the background is looked for first."""


def plain_reference(frame: FloatMap, finite: BoolMap, capture: Pair) -> tuple[Carrier, FloatMap]:
    """The fringe that the frame's plane background would carry, over the whole frame.

    Parameters
    ----------
    frame : (h, w) float array, counts, gaps filled
    finite : (h, w) bool array
        False where a gap was filled.
    capture : Pair
        ``background`` says where the reference plane shows; without it the plane is found from
        the frame's rim and whatever continues it.

    Returns
    -------
    carrier : its period and tilt are the medians of the plane's
    reference : (h, w) float64 array, A + B cos(phase of the plane), counts

    Raises
    ------
    InputError where there is no carrier, or no plane background.
    """
    carrier = find_carrier(frame, capture.axis, name="object")
    turned = frame if carrier.axis == "x" else frame.T
    analytic, _ = band_pass(turned, (1.0 / carrier.period_px, carrier.across))
    amplitude = np.abs(analytic)
    usable = finite if carrier.axis == "x" else finite.T
    usable = usable & (amplitude > WEAK * np.percentile(amplitude, 90))
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
    slow = unwrap(np.angle(analytic * np.exp(-1j * steep)), usable)
    plane, background = _fit_plane_phase(slow.phase, slow.region == 1, steep, given is None)
    if not (np.diff(plane, axis=1) > 0).mean() > 0.99:
        raise InputError("background: expected the fringes of a plane, got none that fit one")
    level = float(turned[background].mean())
    modulation = 2.0 * float(np.median(amplitude[background]))
    reference = level + modulation * np.cos(plane)
    fx = float(np.median(np.diff(plane, axis=1))) / (2.0 * np.pi)
    fy = float(np.median(np.diff(plane, axis=0))) / (2.0 * np.pi) if h > 1 else 0.0
    found = Carrier(carrier.axis, 1.0 / fx, carrier.share, fy)
    return found, np.ascontiguousarray(reference if carrier.axis == "x" else reference.T)


def _fit_plane_phase(
    slow: FloatMap, inside: BoolMap, steep: FloatMap, search: bool
) -> tuple[FloatMap, BoolMap]:
    """Phase of a plane over the whole frame, and the pixels that lie on it.

    Seen by one pinhole and lit by another, a plane's phase is a projective function of the pixel,
    (a + bx + cy) / (1 + dx + ey): multiplied out, a linear problem. A plane that is searched for
    starts as the rim; pixels that it explains join, others leave, until nothing changes.
    """
    h, w = slow.shape
    y, x = np.nonzero(inside)
    some = slice(None, None, max(1, x.size // MAX_POINTS))
    y, x = y[some], x[some]
    phase = slow[y, x] + steep[y, x]
    centre, scale = float(phase.mean()), float(np.ptp(phase)) or 1.0
    value = (phase - centre) / scale
    u, v = 2.0 * x / max(w - 1, 1) - 1.0, 2.0 * y / max(h - 1, 1) - 1.0
    design = np.column_stack((np.ones(x.size), u, v, -u * value, -v * value))
    member = np.ones(x.size, bool)
    if search:
        rim = (np.abs(u) > 1.0 - 2.0 * RIM) | (np.abs(v) > 1.0 - 2.0 * RIM)
        member = rim if rim.mean() > MIN_BACKGROUND else member
    a = np.zeros(5)
    # A few rows of noise would make any perspective of it.
    terms = 5 if min(h, w) >= MIN_SIDE else 3
    for _ in range(STEPS):
        solved = np.linalg.lstsq(design[member, :terms], value[member], rcond=1e-6)[0]
        a[:terms] = solved
        bottom = np.maximum(1.0 + a[3] * u + a[4] * v, NEAREST)
        distance = np.abs(value - (a[0] + a[1] * u + a[2] * v) / bottom) * scale
        limit = max(OFF_PLANE_RAD, 2.0 * float(np.median(distance[member])))
        joined = distance < limit
        if not search or joined.mean() < MIN_BACKGROUND or (joined == member).all():
            break
        member = joined
    across, down = np.linspace(-1.0, 1.0, w)[None, :], np.linspace(-1.0, 1.0, h)[:, None]
    bottom = 1.0 + a[3] * across + a[4] * down
    if not bottom.min() > NEAREST:
        raise InputError("background: expected the fringes of a plane, got none that fit one")
    plane = centre + scale * (a[0] + a[1] * across + a[2] * down) / bottom
    background = np.zeros(slow.shape, bool)
    background[y[member], x[member]] = True
    return plane, background
