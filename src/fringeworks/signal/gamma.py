"""The exponent γ of a response I ∝ v^γ, from one fringe frame or from N steps (theory §6)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fringeworks._lazy import scipy
from fringeworks.types import FloatMap, InputError, unmasked

GAMMA_RANGE = (0.4, 4.0)
"""Range of the exponents that a search considers.

Linear devices have 1, screens and projectors about 2.2. The range leaves a factor of about two on
both sides. An empirical choice.
"""

GAMMA_TRIALS = 25
"""Number of exponents tried before the search is refined, equally spaced in the logarithm.

Neighbours differ by 10 %, so that the best one is next to the minimum of the smooth misfit.
"""

DISTORTION_PRECISION = 1e-3
"""Absolute precision of the exponent with the least harmonic distortion; 0.1 % of γ = 1."""

MISFIT_PRECISION = 1e-4
"""Absolute precision of the exponent with the least misfit to N frames.

Ten times finer than for a single frame, because N frames determine it better.
"""

SINUSOIDAL = 1e-7
"""Harmonic distortion below which a frame counts as sinusoidal and needs no search.

Sinusoids of ten periods or more have at most 4e-8, from the side lobes of the window; γ = 1.01
makes 1e-5 (trials with 400 to 1000 px).
"""

MAX_GAMMA_PIXELS = 50_000
"""Approximate number of pixels from which the exponent of N frames is found.

More pixels only make the search slower: one parameter is fitted. An empirical choice.
"""


def harmonic_distortion(frame: FloatMap, period_px: float) -> float:
    """Energy of the second and third harmonic over that of the fringe, summed over the rows.

    Parameters
    ----------
    frame : (h, w) float array, fringes along x
    period_px : float > 0
        Period of the fringe, camera px.

    Returns
    -------
    float ≥ 0; infinity for a frame without fringes.
    """
    n = frame.shape[1]
    phase = 2.0j * np.pi * np.arange(n) / period_px
    lines = np.hanning(n) * np.exp(-np.arange(1, 4)[:, None] * phase)
    centred = frame - frame.mean(axis=1, keepdims=True)
    first, second, third = np.sum(np.abs(centred @ lines.T) ** 2, axis=0)
    return float((second + third) / first) if first > 0 else np.inf


def estimate_gamma(frame: FloatMap, period_px: float) -> float:
    """Find the exponent γ for which frame^(1/γ) is closest to a sinusoid.

    Parameters
    ----------
    frame : (h, w) float array, 0…1 with 0 for the darkest pixel, fringes along x
    period_px : float > 0
        Period of the fringe, camera px.

    Returns
    -------
    float
        γ, between 0.4 and 4; 1 for a sinusoidal frame.

    Examples
    --------
    >>> wave = 0.5 + 0.5 * np.cos(2 * np.pi * np.arange(400) / 40)
    >>> round(estimate_gamma(wave[None] ** 2.2, 40.0), 2)
    2.2
    """

    def distortion(gamma: float) -> float:
        return harmonic_distortion(frame ** (1.0 / gamma), period_px)

    if distortion(1.0) < SINUSOIDAL:
        return 1.0
    best = scipy.optimize.minimize_scalar(
        distortion, bounds=GAMMA_RANGE, method="bounded", options={"xatol": DISTORTION_PRECISION}
    )
    return float(best.x)


def gamma_of_frames(
    frames: NDArray[np.generic],
    ideal_rad: FloatMap,
    shifts_rad: Sequence[float] | None = None,
    pattern_exponent: float = 1.0,
) -> float:
    """Find the exponent γ that explains N frames of a white plane.

    Parameters
    ----------
    frames : (n ≥ 3, h, w) real array, counts
    ideal_rad : (h, w) float array
        Phase that was projected, rad; NaN where unknown.
    shifts_rad : (n,) floats, optional
        Shifts δ_n, rad; 2π k / n where not given.
    pattern_exponent : float > 0
        Exponent e of the patterns, (½ + ½ cos φ)^e.

    Returns
    -------
    float
        γ, between 0.4 / e and 4 / e.

    Raises
    ------
    InputError
        If no pixel has a known phase.

    Notes
    -----
    Least squares of I_n = a + b·(½ + ½ cos(φ − δ_n))^(eγ) with a and b free at every pixel, so that
    dark counts, ambient light and albedo do not matter.
    """
    n = len(frames)
    shifts = shifts_or_equal(n, shifts_rad)
    known = np.flatnonzero(np.isfinite(ideal_rad))
    if known.size == 0:
        raise InputError("ideal phase: expected known pixels, got none")
    sample = known[:: max(1, known.size // MAX_GAMMA_PIXELS)]
    seen = unmasked(frames, "frames").reshape(n, -1)[:, sample].astype(np.float64)
    seen = seen - seen.mean(axis=0)
    wave = 0.5 + 0.5 * np.cos(ideal_rad.ravel()[sample] - shifts[:, None])

    def misfit(exponent: float) -> float:
        light = wave**exponent
        light = light - light.mean(axis=0)
        factor = np.sum(light * seen, axis=0) / np.maximum(np.sum(light**2, axis=0), 1e-12)
        return float(np.sum((seen - factor * light) ** 2))

    trials = np.geomspace(*GAMMA_RANGE, GAMMA_TRIALS)
    k = int(np.argmin([misfit(exponent) for exponent in trials]))
    around = (trials[max(k - 1, 0)], trials[min(k + 1, trials.size - 1)])
    best = scipy.optimize.minimize_scalar(
        misfit, bounds=around, method="bounded", options={"xatol": MISFIT_PRECISION}
    )
    return float(best.x) / pattern_exponent


def shifts_or_equal(n: int, shifts_rad: Sequence[float] | None) -> NDArray[np.float64]:
    """The given shifts, or n equal ones, rad."""
    return 2.0 * np.pi * np.arange(n) / n if shifts_rad is None else np.asarray(shifts_rad)
