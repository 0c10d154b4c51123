"""Phase steps as they really were: the shifts of N frames from the frames themselves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import step_design
from fringeworks.types import FloatMap, InputError

MAX_ITERATIONS = 500
CONVERGED_RAD = 1e-7
MIN_PIXELS = 500
MAX_UNEVEN = 0.2
"""Largest |mean e^{2iφ}| at which phases count as evenly spread over a turn."""


def estimate_shifts(samples: FloatMap, shifts_rad: Sequence[float]) -> NDArray[np.float64]:
    """Real phase shifts of the N frames of one period.

    Parameters
    ----------
    samples : (N, n) float array, counts
        Pixels with fringes, none saturated; n ≥ 500.
    shifts_rad : (N,) floats
        The shifts that were meant.

    Returns
    -------
    (N,) shifts, rad; their mean difference to those meant is zero, because a common shift is the
    origin of the phase and not seen in the frames.

    Raises
    ------
    InputError for too few pixels, or for three or four frames whose phases are not evenly spread.

    Notes
    -----
    I_n = A + c cos δ_n + s sin δ_n with A, c, s free at every pixel has three unknowns per pixel.
    Five or more frames determine the shifts (advanced iterative algorithm, Wang & Han, Optics
    Letters 29:1671, 2004: least squares over pixels and frames in turn). Three or four do not:
    they are taken from the principal components of the samples, right where phases are spread
    evenly and brightness does not follow them (Vargas, Quiroga & Belenguer, Optics Letters
    36:1326, 2011).
    """
    values = np.asarray(samples, np.float64)
    meant = np.asarray(shifts_rad, np.float64)
    if values.ndim != 2 or values.shape[0] != meant.size:
        raise InputError(f"samples: expected shape ({meant.size}, n), got {values.shape}")
    if values.shape[1] < MIN_PIXELS:
        raise InputError(
            f"steps: expected {MIN_PIXELS} pixels with fringes or more, got {values.shape[1]}"
        )
    if meant.size < 5:
        return _aligned(_by_components(values, meant), meant)
    found = _aligned(_by_components(values, meant, strict=False), meant)
    best = min((meant, found), key=lambda shifts: _misfit(values, shifts))
    return _iterated(values, best, meant)


def _misfit(values: FloatMap, shifts: NDArray[np.float64]) -> float:
    design = step_design(shifts)
    left = values - design @ (np.linalg.pinv(design) @ values)
    return float(np.mean(left**2))


def _aligned(shifts: NDArray[np.float64], meant: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shifts turned by their mean difference, and mirrored where that is nearer to those meant."""

    def turned(s: NDArray[np.float64]) -> NDArray[np.float64]:
        off = np.angle(np.exp(1j * (s - meant)) * np.conj(np.mean(np.exp(1j * (s - meant)))))
        return np.asarray(meant + off - off.mean())

    both = (turned(shifts), turned(-shifts))
    return min(both, key=lambda s: float(np.abs(s - meant).max()))


def _iterated(
    values: FloatMap, shifts: NDArray[np.float64], meant: NDArray[np.float64]
) -> NDArray[np.float64]:
    for _ in range(MAX_ITERATIONS):
        background, c, s = np.linalg.pinv(step_design(shifts)) @ values
        normal = np.array([[c @ c, c @ s], [c @ s, s @ s]])
        rest = values - background
        k, q = np.linalg.solve(normal, np.stack((rest @ c, rest @ s)))
        new = _aligned(np.arctan2(q, k), meant)
        change = float(np.abs(new - shifts).max())
        shifts = new
        if change < CONVERGED_RAD:
            break
    return shifts


def _by_components(
    values: FloatMap, meant: NDArray[np.float64], *, strict: bool = True
) -> NDArray[np.float64]:
    """Shifts from the two principal components of the samples about each pixel's mean.

    With phases spread evenly, the samples less A have the covariance
    ½ B² (cos δ_n cos δ_m + sin δ_n sin δ_m): its two eigenvectors, times the root of their
    eigenvalues, are the columns cos δ and sin δ but for a rotation.
    """
    shifts = meant.copy()
    for _ in range(MAX_ITERATIONS):
        design = step_design(shifts)
        background, c, s = np.linalg.pinv(design) @ values
        rest = values - background
        rest = rest - rest.mean(axis=1, keepdims=True)
        size, vectors = np.linalg.eigh(rest @ rest.T / rest.shape[1])
        plane = vectors[:, -2:] * np.sqrt(np.maximum(size[-2:], 0.0))
        new = _aligned(np.arctan2(plane[:, 1], plane[:, 0]), meant)
        change = float(np.abs(new - shifts).max())
        shifts = new
        if change < CONVERGED_RAD:
            break
    if strict:
        phasor = (c + 1j * s) / np.maximum(np.hypot(c, s), 1e-12)
        uneven = max(abs(np.mean(phasor)), abs(np.mean(phasor**2)))
        if uneven > MAX_UNEVEN:
            raise InputError(
                f"steps: {meant.size} frames tell their shifts only where several fringes cross "
                f"the image; expected phases evenly spread, got an unevenness of {uneven:.2f}"
            )
    return shifts
