"""Inverse function analysis (IFA) and its variants: u(x) = x − s⁻¹(d(x)), row by row (theory §4).

Extrema split each row into monotone parts. Parts of the object are matched with parts of the
reference by counting fringes, so a connected surface needs no unwrapping. The four methods differ
in how a part is inverted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks import _core
from fringeworks.pair.counting import (
    DEGREE,
    MIN_SWING_SIGMAS,
    PROMINENCE,
    RESAMPLES_PER_PX,
    RowMethod,
)
from fringeworks.pair.methods.fourier import fourier
from fringeworks.pair.orders import guided_count
from fringeworks.pair.prepared import PreparedPair
from fringeworks.pair.registry import Solution, method
from fringeworks.types import BoolMap, FloatMap, Frozen, InputError

MAX_DEGREE = 30
"""Largest degree of a polynomial that ``ifa`` accepts; higher ones are numerically singular."""
MAX_RESAMPLES_PER_PX = 1000
"""Largest number of samples per pixel that ``gsifa`` accepts, 1/px; it bounds time and memory."""


@dataclass(frozen=True, eq=False, repr=False)
class Extrema(Frozen):
    """Extrema of one fringe row, (n,) each; maxima and minima alternate."""

    position_px: FloatMap
    """Column, px, sub-pixel."""
    value: FloatMap
    """Intensity, counts."""
    is_maximum: BoolMap
    """True for maxima."""


def find_extrema(row: FloatMap, period_px: float, *, noise: float = 0.0) -> Extrema:
    """Find the extrema of the fringes of a row, in the band of the carrier.

    Parameters
    ----------
    row : (n,) float array, n ≥ 8
        Counts.
    period_px : float ≥ 2
        Mean fringe period, px.
    noise : float ≥ 0
        Standard deviation of the row's white noise, counts; extrema of the smoothed row need a
        swing above five times what remains of it.

    Returns
    -------
    Extrema
        At sub-pixel positions: roots of the derivative of the row's spline, or the middle of a
        plateau that quantisation or saturation made.

    Notes
    -----
    Extrema are chosen on the row smoothed over 0.1 periods, by their prominence against the local
    range, and then placed on the row itself. Ripples finer than a third of the period, such as the
    projector's pixel grid, do not count. Theory §4.

    Examples
    --------
    >>> x = np.arange(100.0)
    >>> find_extrema(np.cos(2 * np.pi * (x - 3.25) / 40), 40.0).position_px.round(2)
    array([ 3.25, 23.25, 43.25, 63.25, 83.25])
    """
    values = np.ascontiguousarray(row, dtype=np.float64)
    position, value, is_maximum = _core.row_extrema(
        values, period=period_px, prominence=PROMINENCE, floor=MIN_SWING_SIGMAS * noise
    )
    return Extrema(position, value, is_maximum.astype(bool))


def _invert(
    prepared: PreparedPair,
    name: RowMethod,
    max_displacement_px: float | None,
    *,
    degree: int = DEGREE,
    n_resample: int = RESAMPLES_PER_PX,
    straighten: bool = True,
) -> Solution:
    """Count fringes and invert; where counting slipped, with the band-pass as a guide."""
    return guided_count(
        prepared,
        lambda: fourier(prepared).displacement_px,
        name,
        max_displacement_px=max_displacement_px,
        degree=degree,
        n_resample=n_resample,
        straighten=straighten,
    )


@method("ifa")
def ifa(
    pair: PreparedPair,
    *,
    degree: int = DEGREE,
    max_displacement_px: float | None = None,
    straighten: bool = True,
) -> Solution:
    """Inverts each monotone part of a row with a polynomial x = P(I).

    Parameters
    ----------
    pair : PreparedPair
    degree : int, 1 … 30
        Largest degree. Each part takes the degree with the smallest generalised cross-validation
        score RSS/(n − degree − 1)².
    max_displacement_px : float > 0, optional
        Largest |u| considered in matching the fringe orders, px; six periods by default.
    straighten : bool
        Whether the response γ of frames without noise is removed first. The dissertation does not.

    Returns
    -------
    Solution

    Raises
    ------
    InputError
        If an option is out of its range.

    Notes
    -----
    Inverse function analysis: Hu et al., IEEE TIM; theory §4. High degrees oscillate (Runge), low
    ones do not follow the fringe, so the error is systematic even on ideal frames.
    """
    if not 1 <= degree <= MAX_DEGREE:
        raise InputError(f"degree: expected 1 to {MAX_DEGREE}, got {degree}")
    return _invert(pair, "ifa", max_displacement_px, degree=degree, straighten=straighten)


@method("sifa")
def sifa(
    pair: PreparedPair, *, max_displacement_px: float | None = None, straighten: bool = True
) -> Solution:
    """Inverts each monotone part of a row with a cubic spline x = S(I) through its samples.

    Parameters
    ----------
    pair : PreparedPair
    max_displacement_px : float > 0, optional
        Largest |u| considered in matching the fringe orders, px; six periods by default.
    straighten : bool
        Whether the response γ of frames without noise is removed first. The dissertation does not.

    Returns
    -------
    Solution

    Raises
    ------
    InputError
        If the option is out of its range.

    Notes
    -----
    Spline IFA: Hani et al.; the dissertation, part 5; theory §4. The spline runs
    through the samples of the part and its two extrema, with slope 0 at the ends. Samples that are
    not monotone (noise, quantisation) are pooled, and such parts are interpolated linearly.
    """
    return _invert(pair, "sifa", max_displacement_px, straighten=straighten)


@method("gsifa")
def gsifa(
    pair: PreparedPair,
    *,
    n_resample: int = RESAMPLES_PER_PX,
    max_displacement_px: float | None = None,
    straighten: bool = True,
) -> Solution:
    """Re-samples the spline through each row densely and inverts its monotone parts with splines.

    Parameters
    ----------
    pair : PreparedPair
    n_resample : int, 1 … 1000
        Samples of the row's spline per pixel.
    max_displacement_px : float > 0, optional
        Largest |u| considered in matching the fringe orders, px; six periods by default.
    straighten : bool
        Whether the response γ of frames without noise is removed first. The dissertation does not.

    Returns
    -------
    Solution

    Raises
    ------
    InputError
        If an option is out of its range.

    Notes
    -----
    Global spline IFA: the dissertation, part 6; theory §4. Extrema are the roots of the derivative
    of the row's spline.
    """
    if not 1 <= n_resample <= MAX_RESAMPLES_PER_PX:
        raise InputError(f"n_resample: expected 1 to {MAX_RESAMPLES_PER_PX}, got {n_resample}")
    return _invert(pair, "gsifa", max_displacement_px, n_resample=n_resample, straighten=straighten)


@method("exact")
def exact(pair: PreparedPair, *, max_displacement_px: float | None = None) -> Solution:
    """Solves for the roots of the spline through each row, without a second fit.

    Parameters
    ----------
    pair : PreparedPair
    max_displacement_px : float > 0, optional
        Largest |u| considered in matching the fringe orders, px; six periods by default.

    Returns
    -------
    Solution

    Raises
    ------
    InputError
        If the option is out of its range.

    Notes
    -----
    Solves spline(x) = d on the monotone part by bracketed Newton steps (theory §4). On ideal frames
    only rounding and the sampling of the row limit the accuracy. Noise is not averaged: this holds
    for all methods that use one pixel at a time.
    """
    return _invert(pair, "exact", max_displacement_px)
