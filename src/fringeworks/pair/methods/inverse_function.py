"""Inverse function analysis (IFA) and its family: u(x) = x − s⁻¹(d(x)), row by row (theory §4).

Extrema split each row into monotone parts; parts of the object are matched with parts of the
reference by counting fringes, so that a connected surface needs no unwrapping. The four methods
differ in how a part is inverted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks import _core
from fringeworks.pair.counting import NOISE_SWINGS, PROMINENCE, Name
from fringeworks.pair.methods.fourier import fourier
from fringeworks.pair.orders import guided_count
from fringeworks.pair.prepared import PreparedPair
from fringeworks.pair.registry import Solution, method
from fringeworks.types import BoolMap, FloatMap, InputError


@dataclass(frozen=True)
class Extrema:
    """Turning points of one fringe row, alternating."""

    position_px: FloatMap
    value: FloatMap
    is_maximum: BoolMap


def find_extrema(row: FloatMap, period_px: float, *, noise: float = 0.0) -> Extrema:
    """Extrema of a fringe row, by prominence against its local modulation.

    Parameters
    ----------
    row : (n,) float array, n ≥ 8, counts.
    period_px : float ≥ 2
        Mean fringe period.
    noise : float ≥ 0
        Standard deviation of the row's noise, counts; swings below five of it are none.

    Returns
    -------
    Extrema at sub-pixel positions: roots of the row's spline derivative, or the middle of a
    plateau where quantisation or saturation made one.

    Examples
    --------
    >>> x = np.arange(100.0)
    >>> find_extrema(np.cos(2 * np.pi * (x - 3.25) / 40), 40.0).position_px.round(2)
    array([ 3.25, 23.25, 43.25, 63.25, 83.25])
    """
    values = np.ascontiguousarray(row, dtype=np.float64)
    position, value, is_maximum = _core.row_extrema(
        values, period=period_px, prominence=PROMINENCE, floor=NOISE_SWINGS * noise
    )
    return Extrema(position, value, is_maximum.astype(bool))


def _invert(
    pair: PreparedPair,
    name: Name,
    max_displacement_px: float | None,
    *,
    degree: int = 9,
    n_resample: int = 5,
) -> Solution:
    """Count and invert; where counting slipped, with the band-pass as a guide."""
    return guided_count(
        pair,
        lambda: fourier(pair).displacement_px,
        name,
        max_displacement_px=max_displacement_px,
        degree=degree,
        n_resample=n_resample,
    )


@method("ifa")
def ifa(
    pair: PreparedPair, *, degree: int = 9, max_displacement_px: float | None = None
) -> Solution:
    """Inverse function analysis: a polynomial x = P(I) per monotone part.

    Parameters
    ----------
    pair : PreparedPair
    degree : int, 1 … 30
        Largest degree; each part takes the degree up to it with the smallest generalised
        cross-validation score RSS/(n − degree − 1)².
    max_displacement_px : float > 0, optional
        Largest |u| considered in matching the fringe orders; four periods by default.

    Notes
    -----
    Hu et al., IEEE TIM; theory §4. High degrees oscillate (Runge), low ones do not bend enough:
    the error is systematic even on ideal frames.
    """
    if not 1 <= degree <= 30:
        raise InputError(f"degree: expected 1 to 30, got {degree}")
    return _invert(pair, "ifa", max_displacement_px, degree=degree)


@method("sifa")
def sifa(pair: PreparedPair, *, max_displacement_px: float | None = None) -> Solution:
    """Spline IFA: an interpolating cubic spline x = S(I) through the samples of each part.

    Parameters
    ----------
    pair : PreparedPair
    max_displacement_px : float > 0, optional
        Largest |u| considered in matching the fringe orders; four periods by default.

    Notes
    -----
    Hani et al.; the dissertation, part 5; theory §4. The spline runs through the samples of the
    part and its two extrema, its ends clamped to slope 0. Samples out of order (noise,
    quantisation) are pooled, and such parts are joined by straight lines.
    """
    return _invert(pair, "sifa", max_displacement_px)


@method("gsifa")
def gsifa(
    pair: PreparedPair, *, n_resample: int = 5, max_displacement_px: float | None = None
) -> Solution:
    """Global spline IFA: one spline through the row, re-sampled densely, inverted by splines.

    Parameters
    ----------
    pair : PreparedPair
    n_resample : int, 1 … 1000
        Samples of the global spline per pixel.
    max_displacement_px : float > 0, optional
        Largest |u| considered in matching the fringe orders; four periods by default.

    Notes
    -----
    The dissertation, part 6; theory §4. Extrema are the roots of the global spline's derivative.
    """
    if not 1 <= n_resample <= 1000:
        raise InputError(f"n_resample: expected 1 to 1000, got {n_resample}")
    return _invert(pair, "gsifa", max_displacement_px, n_resample=n_resample)


@method("exact")
def exact(pair: PreparedPair, *, max_displacement_px: float | None = None) -> Solution:
    """Exact inversion: the root of the global spline itself, without a second fit.

    Parameters
    ----------
    pair : PreparedPair
    max_displacement_px : float > 0, optional
        Largest |u| considered in matching the fringe orders; four periods by default.

    Notes
    -----
    Solves spline(x) = d on the monotone part by bracketed Newton steps (theory §4). On ideal
    frames only rounding and the sampling of the row are left; noise is passed on undamped, as by
    all methods that look at one pixel at a time.
    """
    return _invert(pair, "exact", max_displacement_px)
