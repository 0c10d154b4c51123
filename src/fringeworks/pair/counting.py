"""Fringe orders by counting: extrema of the object row matched with those of the reference's."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.pair.pair import PreparedPair
from fringeworks.pair.registry import Solution
from fringeworks.signal.gamma import estimate_gamma
from fringeworks.types import FloatMap, InputError, Reason

Rows = NDArray[np.float64]
Name = Literal["ifa", "sifa", "gsifa", "exact"]

PROMINENCE = 0.3
"""Least swing of an extremum, as a share of the local range of its row."""
NOISE_SWINGS = 5.0
"""… and in standard deviations of the noise."""
TOLERANCE = 0.05
"""How far (share of a part's range) an intensity may exceed its part and count as its end."""
SAME_RANGE = 0.01
"""Frames whose extremes differ by less than this share of their range have the same albedo."""
QUIET = 3e-4
"""Noise below this share of the range does not suffer from being bent."""
GAMMA_ROWS = 8
"""Rows from which the exponent is estimated."""
MIN_GAMMA_CHANGE = 0.02
"""Exponents nearer to 1 than this are 1."""
ALBEDO_TOLERANCE = 0.02
"""Parts whose extrema differ by more than this share are normalised to the reference's first."""
MAX_PERIODS = 6.0
"""Largest displacement considered where nothing is known of it."""
SLIP = 0.6
"""Rows whose neighbours differ by more than this share of a period may have slipped."""


def _linearised(pair: PreparedPair) -> tuple[Rows, Rows, float]:
    """Both frames, through the inverse of the response where that can only help, and γ.

    The inverse function does not change when both frames go through the same monotone curve, but
    a flat minimum (γ = 2.2) is poorly interpolated by cubics and a cosine is not. A curve also
    bends noise, and offset and gain of another albedo: frames with either are left alone.
    """
    s, d = pair.reference, pair.object
    low, high = float(s.min()), float(s.max())
    slack = SAME_RANGE * (high - low)
    same_range = abs(float(d.min()) - low) <= slack and abs(float(d.max()) - high) <= slack
    quiet = np.sqrt(sum(pair.noise)) <= QUIET * (high - low)
    if not (same_range and quiet):
        return s, d, 1.0
    some = s[:: max(1, s.shape[0] // GAMMA_ROWS)]
    gamma = estimate_gamma((some - low) / (high - low), pair.period)
    if abs(gamma - 1.0) < MIN_GAMMA_CHANGE:
        return s, d, 1.0

    def bend(frame: Rows) -> Rows:
        # The object's darkest sample may lie below the reference's by rounding.
        share = np.maximum((frame - low) / (high - low), 0.0)
        return np.asarray(low + (high - low) * share ** (1.0 / gamma))

    return bend(s), bend(d), gamma


def invert_rows(
    pair: PreparedPair,
    name: Name,
    *,
    max_displacement_px: float | None = None,
    degree: int = 9,
    n_resample: int = 5,
    guide_px: FloatMap | None = None,
) -> Solution:
    """Match the extrema of both frames row by row and invert between them.

    Parameters
    ----------
    pair : PreparedPair
    name : "ifa", "sifa", "gsifa" or "exact"
    max_displacement_px, degree, n_resample : as the methods have them
    guide_px : (h, w) float array, optional
        Expected displacement, NaN where unknown; decides orders, not values.
    """
    limit = MAX_PERIODS * pair.period if max_displacement_px is None else float(max_displacement_px)
    if not limit > 0:
        raise InputError(f"max_displacement_px: expected > 0, got {max_displacement_px}")
    noise = float(np.sqrt(sum(pair.noise)))
    reference, object_, gamma = _linearised(pair)
    displacement, sigma, gain, reason = _core.invert_rows(
        reference,
        object_,
        pair.wanted.astype(np.uint8),
        guide=None if guide_px is None else guide_px.astype(np.float32),
        method=name,
        degree=degree,
        n_resample=n_resample,
        period=pair.period,
        prominence=PROMINENCE,
        floor=NOISE_SWINGS * noise,
        noise=noise,
        max_displacement=limit,
        tolerance=TOLERANCE,
        # Under noise the extrema themselves scatter by a few σ without any change of albedo.
        albedo_tolerance=max(ALBEDO_TOLERANCE, NOISE_SWINGS * noise / (2.0 * pair.modulation)),
    )
    return Solution(
        displacement,
        sigma,
        gain,
        reason,
        details={"noise_counts": noise, "linearised_gamma": gamma},
    )


def count_fringes(pair: PreparedPair) -> Solution:
    """Displacement by counting alone: its orders are what matters, not its values."""
    return invert_rows(pair, "sifa")


def slips(found: Solution, period_px: float) -> bool:
    """Whether neighbouring rows differ by about a period anywhere, or a row was given up."""
    if bool((found.reason == Reason.ORDER_AMBIGUOUS).any()):
        return True
    with np.errstate(invalid="ignore"):
        return bool((np.abs(np.diff(found.displacement_px, axis=0)) > SLIP * period_px).any())
