"""The response of projector and camera: its exponent, from the harmonics of a fringe frame."""

from __future__ import annotations

import numpy as np
from scipy import optimize

from fringeworks.types import FloatMap

RANGE = (0.4, 4.0)
"""Exponents that are looked for."""


SINUSOIDAL = 1e-7
"""A frame with less harmonic distortion than this needs no search."""


def harmonic_distortion(frame: FloatMap, period_px: float) -> float:
    """Energy of the second and third harmonic over that of the fringe, mean over the rows.

    Parameters
    ----------
    frame : (h, w) float array, fringes along x.
    period_px : float > 0
    """
    n = frame.shape[1]
    phase = 2.0j * np.pi * np.arange(n) / period_px
    lines = np.hanning(n) * np.exp(-np.arange(1, 4)[:, None] * phase)
    centred = frame - frame.mean(axis=1, keepdims=True)
    first, second, third = np.sum(np.abs(centred @ lines.T) ** 2, axis=0)
    return float((second + third) / first) if first > 0 else np.inf


def estimate_gamma(frame: FloatMap, period_px: float) -> float:
    """Exponent γ for which frame^(1/γ) is most nearly sinusoidal.

    Parameters
    ----------
    frame : (h, w) float array in 0…1, darkest 0, fringes along x.
    period_px : float > 0
        Period of the fringe.

    Returns
    -------
    γ between 0.4 and 4; 1 for a sinusoidal frame.

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
    found = optimize.minimize_scalar(
        distortion, bounds=RANGE, method="bounded", options={"xatol": 1e-3}
    )
    return float(found.x)
