"""Fringe counting: matches the extrema of object rows with those of the reference (theory §4)."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.pair.prepared import PreparedPair
from fringeworks.pair.registry import Solution
from fringeworks.signal.bands import row_bands
from fringeworks.signal.gamma import estimate_gamma
from fringeworks.types import ByteMap, FloatMap, InputError, Reason, sealed

Rows = FloatMap
RowMethod = Literal["ifa", "sifa", "gsifa", "exact"]

DEGREE = 9
"""Default for the largest degree of a polynomial of ``ifa``.

Lower degrees do not follow a half period of a cosine, higher ones oscillate (Runge); generalised
cross-validation chooses below this limit. An empirical choice.
"""
RESAMPLES_PER_PX = 5
"""Default for the samples of the row's spline that ``gsifa`` takes per pixel, 1/px.

More samples cost time and bring the result closer to that of ``exact``. An empirical choice.
"""
PROMINENCE = 0.3
"""Smallest swing of an extremum, as a share of the range of the smoothed row within 0.75 periods.

It must be above what the smoothing leaves of a pixel grid (0.14 for a pitch of a third of the
period that takes half the light) and of the ripple at a cliff, and below 1, so that weak fringes
beside strong ones still count. An empirical choice.
"""
MIN_SWING_SIGMAS = 5.0
"""Smallest swing of an extremum, in standard deviations of the smoothed noise (theory §4).

Swings of the noise within a period of some tens of pixels rarely exceed it. An empirical choice.
"""
RANGE_TOLERANCE = 0.05
"""Intensity beyond the end of its monotone part that counts as the end, as a share of the range.

Noise and interpolation put samples beyond the extremum. A larger tolerance would invert samples of
another albedo. An empirical choice.
"""
SAME_RANGE = 0.01
"""Largest difference between the extremes of two frames of the same albedo, share of the range.

Sampling alone makes the extremes differ slightly. An empirical choice.
"""
LINEARISED_NOISE = 3e-4
"""Largest noise at which the response is linearised, as a share of the reference's range.

The inverse response amplifies noise in dark fringes. The rounding of two frames to 8 bit is 1.6e-3
of the range and exceeds this limit; that to 12 bit, 1e-4, does not. An empirical choice.
"""
GAMMA_ROWS = 8
"""Approximate number of rows from which the response exponent γ is estimated.

All rows have the same γ, and a noise-free row determines it well; more rows only cost time.
"""
MIN_GAMMA_CHANGE = 0.02
"""Exponents closer to 1 than this are taken as 1: the fringes are cosines already.

The estimate of γ can be wrong by about this much. An empirical choice.
"""
ALBEDO_TOLERANCE = 0.02
"""Largest difference of a part's extrema from the reference's that is not normalised (theory §4).

A share of the part's range. A smaller difference can come from sampling, and normalising would add
an error. An empirical choice.
"""
MAX_DISPLACEMENT_PERIODS = 6.0
"""Default for the largest displacement considered, periods.

A wider search costs time and allows false matches. An empirical choice.
"""
SLIP_PERIODS = 0.6
"""Difference between neighbouring rows above which one of them may have a wrong order, periods.

A wrong order makes a whole period; half a period is the limit of two frames. An empirical choice.
"""


def _linearised(prepared: PreparedPair) -> tuple[Rows, Rows, float]:
    """Return both frames with a linear response, and the exponent γ that was removed (1 for none).

    A common monotone curve of both frames does not change the inverse function. But cubics
    interpolate the flat minima of a strong response (γ = 2.2) poorly, and those of a cosine well.
    The curve distorts noise and a different albedo, so frames with either are left as they are.
    """
    s, d = prepared.reference, prepared.object
    low, high = float(s.min()), float(s.max())
    slack = SAME_RANGE * (high - low)
    same_range = abs(float(d.min()) - low) <= slack and abs(float(d.max()) - high) <= slack
    quiet = np.sqrt(sum(prepared.noise)) <= LINEARISED_NOISE * (high - low)
    if not (same_range and quiet):
        return s, d, 1.0
    sampled_rows = s[:: max(1, s.shape[0] // GAMMA_ROWS)]
    gamma = estimate_gamma((sampled_rows.astype(np.float64) - low) / (high - low), prepared.period)
    if abs(gamma - 1.0) < MIN_GAMMA_CHANGE:
        return s, d, 1.0

    def linearise(frame: Rows) -> Rows:
        # The object's darkest sample may lie below the reference's by rounding.
        share = np.maximum((frame.astype(np.float64) - low) / (high - low), 0.0)
        return np.asarray(low + (high - low) * share ** (1.0 / gamma))

    return linearise(s), linearise(d), gamma


class Inverted(NamedTuple):
    """Result of row methods that may still be changed; (h, w) maps as in ``Solution``."""

    displacement_px: NDArray[np.float64]
    sigma_px: NDArray[np.float32]
    modulation_ratio: NDArray[np.float32]
    reason: ByteMap


class RowInversion:
    """A row method with its options, applied to some or all rows of a pair.

    Parameters
    ----------
    prepared : PreparedPair
    name : "ifa", "sifa", "gsifa" or "exact"
        How a monotone part is inverted.
    degree : int
        Largest degree of the polynomials ("ifa").
    n_resample : int
        Samples of the row's spline per pixel ("gsifa").
    straighten : bool
        Whether the response of ideal frames is linearised first (see ``details``).

    Notes
    -----
    Theory §4.
    """

    def __init__(
        self,
        prepared: PreparedPair,
        name: RowMethod,
        *,
        degree: int = DEGREE,
        n_resample: int = RESAMPLES_PER_PX,
        straighten: bool = True,
    ) -> None:
        self.wanted, self.period = prepared.wanted, prepared.period
        self.reference, self.object, self.gamma = prepared.reference, prepared.object, 1.0
        if straighten:
            self.reference, self.object, self.gamma = _linearised(prepared)
        if self.reference.dtype != self.object.dtype:
            self.reference = self.reference.astype(np.float64)
            self.object = self.object.astype(np.float64)
        self.noise = float(np.sqrt(sum(prepared.noise)))
        self._options: _core._InvertRowsOptions = {
            "method": name,
            "degree": degree,
            "n_resample": n_resample,
            "period": self.period,
            "prominence": PROMINENCE,
            "floor": MIN_SWING_SIGMAS * self.noise,
            "noise": self.noise,
            "max_displacement": self.limit_px(None),
            "tolerance": RANGE_TOLERANCE,
            # Noise alone moves the extrema by a few σ, without any change of albedo.
            "albedo_tolerance": max(
                ALBEDO_TOLERANCE, MIN_SWING_SIGMAS * self.noise / (2.0 * prepared.modulation)
            ),
        }

    def limit_px(self, max_displacement_px: float | None) -> float:
        """Largest |u| considered, px: the caller's, or six periods; InputError unless > 0."""
        if max_displacement_px is None:
            return MAX_DISPLACEMENT_PERIODS * self.period
        if not float(max_displacement_px) > 0:
            raise InputError(f"max_displacement_px: expected > 0, got {max_displacement_px}")
        return float(max_displacement_px)

    def rows(self, part: slice, limit_px: float, guide_px: FloatMap | None = None) -> Inverted:
        """Match the extrema of both frames row by row and invert the reference between them.

        Parameters
        ----------
        part : slice
            Rows; the orders of each are compared with those of the three on either side.
        limit_px : float > 0
            Largest |u| considered, px.
        guide_px : (h, w) float array, optional
            Expected displacement of the whole frame, px, NaN where unknown. It affects the fringe
            orders only, not the values.
        """
        return Inverted(
            *_core.invert_rows(
                self.reference[part],
                self.object[part],
                self.wanted[part].view(np.uint8),
                {**self._options, "max_displacement": limit_px},
                guide=None if guide_px is None else guide_px[part].astype(np.float32, copy=False),
            )
        )

    def solution(self, found: Inverted) -> Solution:
        """The result of the whole frame, which is not changed any more."""
        return Solution(
            displacement_px=sealed(found.displacement_px),
            sigma_px=sealed(found.sigma_px),
            modulation_ratio=sealed(found.modulation_ratio),
            reason=sealed(found.reason),
            details={"noise_counts": self.noise, "linearised_gamma": self.gamma},
        )


def count_fringes(prepared: PreparedPair) -> FloatMap:
    """Displacement by counting fringes, (h, w), px; only its fringe orders are meant to be used."""
    counting = RowInversion(prepared, "sifa")
    return counting.rows(slice(None), counting.limit_px(None)).displacement_px


def slips(found: Inverted, period_px: float) -> bool:
    """Whether neighbouring rows differ by about a period anywhere, or an order is ambiguous."""
    if bool((found.reason == Reason.ORDER_AMBIGUOUS).any()):
        return True
    u, limit = found.displacement_px, SLIP_PERIODS * period_px
    with np.errstate(invalid="ignore"):
        return any(
            bool((np.abs(np.diff(u[band.seen], axis=0)) > limit).any())
            for band in row_bands(u.shape, bytes_per_px=24, halo=1)
        )
