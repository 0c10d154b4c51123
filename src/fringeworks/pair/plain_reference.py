"""Reference for a single frame: the plain fringes that fit its plane background."""

from __future__ import annotations

import numpy as np

from fringeworks.pair.bandpass import band_pass
from fringeworks.pair.carrier import Carrier, find_carrier
from fringeworks.pair.unwrap import unwrap
from fringeworks.types import BoolMap, FloatMap, InputError, Pair

MIN_BACKGROUND = 0.02
"""Smallest share of the frame that can serve as background, 0…1.

A smaller patch determines the plane's perspective poorly at the far end of the frame. An empirical
choice.
"""
OFF_PLANE_RAD = 0.5
"""Smallest limit on a background pixel's phase residual from the fitted plane, rad.

About a twelfth of a period; a smaller limit would exclude noisy background. An empirical choice.
"""
OFF_PLANE_MEDIANS = 2.0
"""The same limit as a multiple of the median residual of the present background.

It lets the background grow while the plane, fitted to the rim only, is still inaccurate. An
empirical choice.
"""
STRONG_PERCENTILE = 90.0
"""Percentile of the fringe amplitude that represents the frame's strong fringes, %."""
MIN_STRENGTH = 0.3
"""Smallest fringe amplitude of the background, as a share of that of the strong fringes.

It excludes shadows and dark objects, whose phase is unreliable. An empirical choice.
"""
MAX_FIT_PIXELS = 100_000
"""Approximate number of pixels that the plane is fitted to; more only cost time."""
MIN_BOTTOM = 0.1
"""Smallest denominator of the plane's projective phase, with 1 in the middle of the frame.

The denominator is proportional to the distance of the plane, so no part of the frame may be more
than ten times closer than the middle. It also keeps the phase finite. An empirical choice.
"""
MIN_PERSPECTIVE_SIDE = 16
"""Smallest side of a frame for which perspective is fitted, px.

In a frame of a few rows, noise would determine the perspective. An empirical choice.
"""
MAX_FIT_STEPS = 30
"""Largest number of steps in which the background grows from the rim; it usually takes few."""
RIM_SHARE = 0.1
"""Width of the rim in which the search for the background starts, as a share of each side.

The object is usually in the middle of the frame. An empirical choice.
"""
MIN_RISING = 0.99
"""Smallest share of the frame on which the plane's phase must rise along the carrier, 0…1.

A phase that falls belongs to no carrier, so the fit has failed there. An empirical choice.
"""
RANK_TOLERANCE = 1e-6
"""Singular values below this share of the largest are ignored in the fit of the plane.

Perspective terms that a small background does not determine then stay near 0.
"""


def plain_reference(frame: FloatMap, finite: BoolMap, pair: Pair) -> tuple[Carrier, FloatMap, bool]:
    """Compute the fringes of a frame's plane background over the whole frame.

    Parameters
    ----------
    frame : (h, w) float array
        Object frame of ``pair``, counts, gaps filled.
    finite : (h, w) bool array
        False where a gap was filled.
    pair : Pair
        ``axis`` is the direction of the fringes or None. ``background`` is True where the reference
        plane is visible; without it the plane is searched for from the rim of the frame.

    Returns
    -------
    carrier : Carrier
        Its period and cross frequency are the medians over the plane.
    reference : (h, w) float64 array
        A + B cos(phase of the plane), counts.
    converged : bool
        False where the background still changed, or had shrunk below its least size, when the
        search ended.

    Raises
    ------
    InputError
        If the frame has no carrier, or no background whose fringes fit a plane.

    Notes
    -----
    Theory §5, "Single frames".
    """
    carrier = find_carrier(frame, pair.axis, name="object")
    turned = frame if carrier.axis == "x" else frame.T
    analytic, _ = band_pass(turned, (1.0 / carrier.period_px, carrier.cross_frequency))
    amplitude = np.abs(analytic)
    usable = _usable_background(amplitude, finite, pair.background, carrier)
    h, w = turned.shape
    x, y = np.arange(w)[None, :], np.arange(h)[:, None]
    carrier_phase: FloatMap = 2.0 * np.pi * (x / carrier.period_px + y * carrier.cross_frequency)
    slow = unwrap(np.angle(analytic * np.exp(-1j * carrier_phase)), usable)
    plane, background, converged = _fit_plane_phase(
        slow.phase, slow.region == 1, carrier_phase, search=pair.background is None
    )
    if not (np.diff(plane, axis=1) > 0).mean() > MIN_RISING:
        raise InputError("background: expected the fringes of a plane, got none that fit one")
    mean_brightness = float(turned[background].mean(dtype=np.float64))
    modulation = 2.0 * float(np.median(amplitude[background]))
    reference = mean_brightness + modulation * np.cos(plane)
    fx = float(np.median(np.diff(plane, axis=1))) / (2.0 * np.pi)
    fy = float(np.median(np.diff(plane, axis=0))) / (2.0 * np.pi) if h > 1 else 0.0
    fitted = Carrier(carrier.axis, 1.0 / fx, carrier.share, fy)
    turned_back = reference if carrier.axis == "x" else reference.T
    return fitted, np.ascontiguousarray(turned_back), converged


def _usable_background(
    amplitude: FloatMap, finite: BoolMap, background: BoolMap | None, carrier: Carrier
) -> BoolMap:
    """Pixels with strong fringes, inside the given background, turned so that fringes vary along x.

    ``amplitude`` is turned already; ``finite`` and ``background`` are as captured.
    """
    usable = finite if carrier.axis == "x" else finite.T
    usable = usable & (amplitude > MIN_STRENGTH * np.percentile(amplitude, STRONG_PERCENTILE))
    if background is not None:
        if background.shape != finite.shape:
            raise InputError(f"background: expected shape {finite.shape}, got {background.shape}")
        usable = usable & (background if carrier.axis == "x" else background.T)
    if usable.mean() < MIN_BACKGROUND:
        raise InputError(
            f"background: expected fringes over at least {MIN_BACKGROUND:.0%} of the frame, "
            f"got {usable.mean():.1%}"
        )
    return usable


def _fit_plane_phase(
    slow: FloatMap, inside: BoolMap, carrier_phase: FloatMap, *, search: bool
) -> tuple[FloatMap, BoolMap, bool]:
    """Fit the phase of a plane; return it over the whole frame, the background's pixels, and
    whether their search converged.

    Parameters
    ----------
    slow : (h, w) float array
        Unwrapped phase of the frame minus ``carrier_phase``, rad.
    inside : (h, w) bool array
        Pixels that may belong to the background.
    carrier_phase : (h, w) float array, rad
    search : bool
        Whether to start from the rim and then alternate between fitting the plane and selecting
        the pixels that agree with it; otherwise all pixels of ``inside`` are background.

    Notes
    -----
    A pinhole camera sees the phase that a pinhole projector draws on a plane as a projective
    function of the pixel, (a + bx + cy) / (1 + dx + ey) (theory §5). Multiplied by its
    denominator, it is linear in a … e.
    """
    h, w = slow.shape
    y, x = np.nonzero(inside)
    thinned = slice(None, None, max(1, x.size // MAX_FIT_PIXELS))
    y, x = y[thinned], x[thinned]
    phase = slow[y, x] + carrier_phase[y, x]
    centre, scale = float(phase.mean()), float(np.ptp(phase)) or 1.0
    value = (phase - centre) / scale
    u, v = 2.0 * x / max(w - 1, 1) - 1.0, 2.0 * y / max(h - 1, 1) - 1.0
    design = np.column_stack((np.ones(x.size), u, v, -u * value, -v * value))
    member = np.ones(x.size, bool)
    if search:
        rim = (np.abs(u) > 1.0 - 2.0 * RIM_SHARE) | (np.abs(v) > 1.0 - 2.0 * RIM_SHARE)
        member = rim if rim.mean() > MIN_BACKGROUND else member
    a = np.zeros(5)
    terms = 5 if min(h, w) >= MIN_PERSPECTIVE_SIDE else 3
    converged = not search
    for _ in range(MAX_FIT_STEPS):
        solved = np.linalg.lstsq(design[member, :terms], value[member], rcond=RANK_TOLERANCE)[0]
        a[:terms] = solved
        bottom = np.maximum(1.0 + a[3] * u + a[4] * v, MIN_BOTTOM)
        residual = np.abs(value - (a[0] + a[1] * u + a[2] * v) / bottom) * scale
        limit = max(OFF_PLANE_RAD, OFF_PLANE_MEDIANS * float(np.median(residual[member])))
        agrees = residual < limit
        converged = converged or bool((agrees == member).all())
        if converged or agrees.mean() < MIN_BACKGROUND:
            break
        member = agrees
    plane = centre + _projective(a, scale, (h, w))
    background = np.zeros(slow.shape, bool)
    background[y[member], x[member]] = True
    return plane, background, converged


def _projective(a: FloatMap, scale: float, shape: tuple[int, int]) -> FloatMap:
    """Scaled projective function of coefficients a … e over a frame, sides from −1 to 1, (h, w)."""
    h, w = shape
    u, v = np.linspace(-1.0, 1.0, w)[None, :], np.linspace(-1.0, 1.0, h)[:, None]
    bottom = 1.0 + a[3] * u + a[4] * v
    if not bottom.min() > MIN_BOTTOM:
        raise InputError("background: expected the fringes of a plane, got none that fit one")
    return np.asarray(scale * (a[0] + a[1] * u + a[2] * v) / bottom)
