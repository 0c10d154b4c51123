"""Path shared by all demodulating methods: phasor → phase → unwrapped phase → displacement."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypedDict

import numpy as np

from fringeworks.pair.bandpass import Analytic
from fringeworks.pair.orders import settle_orders
from fringeworks.pair.prepared import PreparedPair
from fringeworks.pair.reference_phase import with_local_period
from fringeworks.pair.registry import Smoothing, Solution
from fringeworks.pair.unwrap import unwrap
from fringeworks.signal.bands import by_bands, row_bands
from fringeworks.types import BoolMap, ByteMap, FloatMap, Reason, sealed

MIN_MODULATION_RATIO = 0.05
"""Smallest modulation of the object that is measured, as a share of the reference's modulation.

Weaker signals are mostly leakage of the filter from neighbouring fringes. An empirical choice.
"""
MIN_AMPLITUDE_SIGMAS = 4.0
"""Smallest amplitude of the analytic signal, in standard deviations of its complex noise.

Noise alone exceeds it with a probability of exp(−16), about 10⁻⁷, a pixel.
"""
RIM_DIVISOR = 50
"""Side of the frame over the width of its rim, which is taken for the reference plane.

The rim is at least 1 px wide, and narrow, so that the object rarely reaches it. An empirical
choice.
"""


@dataclass(frozen=True, eq=False)
class Demodulated:
    """Result of a demodulating method, in the orientation of the prepared pair."""

    wrapped: FloatMap
    """Wrapped phase φ = 2π u / p, (h, w), rad."""
    reference_amplitude: FloatMap
    """Modulation of the reference after the filter, (h, w), counts."""
    object_amplitude: FloatMap
    """Modulation of the object after the filter, (h, w), counts."""
    noise_share: float
    """Complex variance of an analytic signal B/2 · exp(iφ), per variance of the frame's noise."""
    noise_length_px: tuple[float, float] = (0.0, 0.0)
    """Width σ of the Gaussian kernel that correlates the noise along y and x, px; 0 for none."""
    smoothing: tuple[Smoothing, ...] = ()
    """Kernels that the phase has passed, see ``Solution.smoothing``."""
    details: dict[str, Any] = field(default_factory=dict)
    """Further results of the method, for reports."""

    @property
    def modulation_ratio(self) -> FloatMap:
        """Modulation of the object over that of the reference, (h, w)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.object_amplitude / self.reference_amplitude


class Compared(TypedDict):
    """The phase difference of two analytic signals, and their amplitudes; fields of
    ``Demodulated``."""

    wrapped: FloatMap
    reference_amplitude: FloatMap
    object_amplitude: FloatMap


def compared(
    shape: tuple[int, ...],
    signals: Callable[[slice], tuple[Analytic, Analytic]],
    *,
    bytes_per_px: float = 48.0,
) -> Compared:
    """Compare the analytic signals of reference and object, a band of rows at a time.

    Parameters
    ----------
    shape : (h, w)
    signals : function
        Returns the signals B exp(iφ) of some rows, (r, w) complex64, which may be overwritten.
    bytes_per_px : float > 0
        Memory that a band of the signals and their computation take, bytes per pixel.
    """
    wrapped, of_reference, of_object = (np.empty(shape, np.float32) for _ in range(3))
    for band in row_bands(shape, bytes_per_px):
        reference, object_ = signals(band.rows)
        np.abs(reference, out=of_reference[band.rows])
        np.abs(object_, out=of_object[band.rows])
        np.conj(object_, out=object_)
        reference *= object_
        wrapped[band.rows] = np.angle(reference)
    return {
        "wrapped": wrapped,
        "reference_amplitude": of_reference,
        "object_amplitude": of_object,
    }


def to_displacement(prepared: PreparedPair, demodulated: Demodulated) -> Solution:
    """Unwrap the phase against the reference and convert it to a displacement.

    Parameters
    ----------
    prepared : PreparedPair
    demodulated : Demodulated

    Returns
    -------
    Solution
        NaN where the fringes are weak (``LOW_MODULATION``) or the order is open
        (``ORDER_AMBIGUOUS``).

    Notes
    -----
    Theory §5, "One path". The fringe order is set so that the rim of the frame lies on
    the reference plane, and is then checked against fringe counting (``settle_orders``). Phases
    become displacements by the local period (``with_local_period``). σ is that
    of white noise after the filter: half of its complex variance acts on the phase, relative to
    the amplitude B/2.
    """
    noise = [v * demodulated.noise_share for v in prepared.noise]
    least = MIN_MODULATION_RATIO * prepared.modulation
    weak = demodulated.object_amplitude < max(least, 2.0 * MIN_AMPLITUDE_SIGMAS * np.sqrt(noise[1]))
    # The filter carries fringes from the surroundings into holes, so its amplitude is not enough.
    weak |= prepared.object_empty
    reason: ByteMap = weak * np.uint8(Reason.LOW_MODULATION)
    usable = ~weak & prepared.wanted
    if not usable.any():
        return _unmeasured(reason, demodulated.details)
    unwrapped = unwrap(demodulated.wrapped, usable)
    main = unwrapped.region == 1
    reason[usable & ~main] = Reason.ORDER_AMBIGUOUS
    to_px = prepared.period / (2.0 * np.pi)
    start = unwrapped.phase - _offset(unwrapped.phase, main)
    details = {
        **demodulated.details,
        "regions": int(unwrapped.region.max()),
        "residues": unwrapped.residues,
        "unwrapping": unwrapped.algorithm,
    }
    converged, suspect = unwrapped.converged, unwrapped.residues > 0 or not main.all()
    del unwrapped
    start *= to_px
    start[~main] = np.nan
    displacement, undecided, moved = settle_orders(prepared, start, suspect=suspect)
    del start
    reason[undecided] = Reason.ORDER_AMBIGUOUS
    amplitudes = (demodulated.reference_amplitude, demodulated.object_amplitude)
    return Solution(
        displacement_px=sealed(with_local_period(prepared, displacement)),
        sigma_px=sealed(_sigma(amplitudes, noise, to_px)),
        modulation_ratio=sealed(demodulated.modulation_ratio),
        reason=sealed(reason),
        noise_length_px=demodulated.noise_length_px,
        smoothing=demodulated.smoothing,
        converged=converged,
        is_filter=True,
        details={**details, "pixels_moved_by_counting": moved},
    )


def _sigma(amplitudes: tuple[FloatMap, FloatMap], noise: list[float], to_px: float) -> FloatMap:
    """σ of the displacement from noise of the analytic signals, (h, w), px."""

    def variance(amplitude: FloatMap, of_signal: float) -> FloatMap:
        # The signal has half the amplitude, and half of its complex variance turns its phase.
        square = amplitude * amplitude
        return np.divide(2.0 * of_signal * to_px**2, square, out=square)

    def sigma(reference: FloatMap, object_: FloatMap) -> FloatMap:
        total = variance(reference, noise[0])
        total += variance(object_, noise[1])
        return np.asarray(np.sqrt(total, out=total))

    with np.errstate(divide="ignore", invalid="ignore"):
        return by_bands(sigma, *amplitudes, dtype=amplitudes[0].dtype)


def _unmeasured(reason: ByteMap, details: dict[str, Any]) -> Solution:
    """Solution without any value."""
    nothing = np.full(reason.shape, np.nan)
    return Solution(
        displacement_px=nothing,
        sigma_px=nothing,
        modulation_ratio=nothing,
        reason=reason,
        details=details,
    )


def _offset(phase: FloatMap, main: BoolMap) -> np.float64:
    """Whole periods by which the median of the phase over the frame's rim is off 0, rad.

    The rim is taken for the reference plane. Where it has no pixel of the main region, the median
    over the whole region is used.
    """
    h, w = phase.shape
    by, bx = max(1, h // RIM_DIVISOR), max(1, w // RIM_DIVISOR)
    sides = (np.s_[:by], np.s_[-by:], np.s_[by:-by, :bx], np.s_[by:-by, -bx:])
    rim = np.concatenate([phase[side][main[side]] for side in sides])
    values = rim if rim.size else phase[main]
    return np.float64(2.0 * np.pi * np.round(np.median(values) / (2.0 * np.pi)))
