"""Fourier transform profilometry: phase difference after a band-pass (theory §5)."""

from __future__ import annotations

from typing import Literal

from fringeworks.pair.bandpass import (
    HALF_WIDTH,
    Analytic,
    Shape,
    band_kernel,
    check_band,
    pass_band,
)
from fringeworks.pair.demodulation import Demodulated, compared, to_displacement
from fringeworks.pair.prepared import PreparedPair
from fringeworks.pair.registry import Smoothing, Solution, method


@method("fourier")
def fourier(
    pair: PreparedPair,
    *,
    dimensions: Literal[1, 2] = 2,
    width: float = HALF_WIDTH,
    window: Shape = "hann",
) -> Solution:
    """Filters the band around the carrier and compares the phase with the reference's.

    Parameters
    ----------
    pair : PreparedPair
    dimensions : 1 or 2
        Filter row by row, or the whole frame, which also averages noise along the fringes.
    width : float in (0, 1)
        Half-width of the pass band, as a share of the carrier frequency.
    window : "hann", "gaussian", "tukey" or "rectangular"
        Shape of the pass band, see ``band_response``.

    Returns
    -------
    Solution

    Raises
    ------
    InputError
        If an option is out of its range.

    Notes
    -----
    Fourier transform profilometry: Takeda & Mutoh, Applied Optics 22(24):3977, 1983,
    doi:10.1364/AO.22.003977; theory §5. φ = arg(reference · conj(object)), then unwrapped
    (``to_displacement``). Edges and steps spread over about a period.
    """
    check_band(dimensions, width, window)
    return to_displacement(pair, _demodulated(pair, dimensions, width, window))


def _demodulated(
    pair: PreparedPair, dimensions: Literal[1, 2], width: float, window: Shape
) -> Demodulated:
    """Phase difference and amplitudes in the band."""
    reference, object_ = (
        pass_band(frame, pair.frequency, width=width, dimensions=dimensions, window=window)
        for frame in (pair.reference, pair.object)
    )
    kernel = band_kernel(pair.frequency, width, dimensions)

    def signals(rows: slice) -> tuple[Analytic, Analytic]:
        # B exp(iφ) from B/2 exp(iφ): a power of two does not round.
        return 2.0 * reference.rows(rows), 2.0 * object_.rows(rows)

    return Demodulated(
        **compared(pair.object.shape, signals),
        noise_share=reference.share,
        noise_length_px=kernel,
        smoothing=(Smoothing(kernel),),
    )
