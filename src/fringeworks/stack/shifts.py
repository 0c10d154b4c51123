"""Measurement of the real phase shifts of N frames from the frames themselves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import step_design
from fringeworks.types import LARGEST, NUMBERS, FloatMap, InputError, finite, unmasked

MAX_ITERATIONS = 500
"""Largest number of iterations; most searches converge after tens of them. An empirical choice."""

CONVERGED_RAD = 1e-7
"""Change of all shifts in one iteration below which a search has converged, rad.

Far below the accuracy of about 1e-3 rad that noisy frames allow.
"""

MIN_SHIFT_PIXELS = 500
"""Smallest number of pixels that shifts are estimated from.

The pixels must spread their phases evenly over a turn; 500 do so where several fringes cross them.
An empirical choice.
"""

MAX_UNEVEN = 0.2
"""Largest magnitude of the mean of e^{iφ} and e^{2iφ} at which phases count as evenly spread.

The estimate from three or four frames assumes evenly spread phases, and errs in proportion to this
mean. An empirical choice.
"""

MIN_PHASOR = 1e-12
"""Smallest modulation that divides a phasor, counts; it only avoids the division by zero."""


def estimate_shifts(samples: FloatMap, shifts_rad: Sequence[float]) -> NDArray[np.float64]:
    """Estimate the real phase shifts of the N frames of one period.

    Parameters
    ----------
    samples : (N, n) float array, counts
        Pixels with fringes, none of them saturated; n ≥ 500.
    shifts_rad : (N,) floats
        Nominal shifts, rad.

    Returns
    -------
    (N,) float array, rad
        The real shifts. Their mean difference from the nominal ones is zero, because a common shift
        only moves the origin of the phase and cannot be seen in the frames.

    Raises
    ------
    InputError
        If there are too few pixels, or the phases of three or four frames are not evenly spread.

    Notes
    -----
    The model I_n = A + c cos δ_n + s sin δ_n has three unknowns A, c, s per pixel. Five or more
    frames determine the shifts: least squares over pixels and over frames in turn (advanced
    iterative algorithm, Wang & Han, Optics Letters 29:1671, 2004). Three or four frames do not;
    their shifts come from the principal components of the samples, which is right if the phases are
    evenly spread and the brightness does not depend on them (Vargas, Quiroga & Belenguer, Optics
    Letters 36:1326, 2011). Theory §5.

    Examples
    --------
    >>> phase = np.linspace(0.0, 20.0 * np.pi, 1000)
    >>> real = np.array([0.0, 1.3, 2.5, 3.7, 5.0])
    >>> samples = 100.0 + 50.0 * np.cos(phase - real[:, None])
    >>> shifts = estimate_shifts(samples, 2.0 * np.pi * np.arange(5) / 5)
    >>> bool(np.allclose(shifts - shifts[0], real, atol=1e-6))
    True
    """
    samples = unmasked(samples, "samples")
    if samples.dtype.kind not in NUMBERS:
        raise InputError(f"samples: expected real numbers, got {samples.dtype}")
    values = np.asarray(samples, np.float64)
    nominal = np.asarray(shifts_rad, np.float64)
    if nominal.ndim != 1 or nominal.size < 3:
        raise InputError(f"shifts: expected 3 or more, got shape {nominal.shape}")
    if values.ndim != 2 or values.shape[0] != nominal.size:
        raise InputError(f"samples: expected shape ({nominal.size}, n), got {values.shape}")
    if values.shape[1] < MIN_SHIFT_PIXELS:
        raise InputError(
            f"steps: expected {MIN_SHIFT_PIXELS} pixels with fringes or more, got {values.shape[1]}"
        )
    if not (np.isfinite(values).all() and np.abs(values).max() <= LARGEST and finite(*nominal)):
        raise InputError("samples: expected finite values and shifts, got NaN, infinity or more")
    if nominal.size < 5:
        return _aligned(_by_components(values, nominal), nominal)
    components = _aligned(_by_components(values, nominal, strict=False), nominal)
    start = min((nominal, components), key=lambda shifts: _misfit(values, shifts))
    return _iterated(values, start, nominal)


def _misfit(values: FloatMap, shifts: NDArray[np.float64]) -> float:
    """Mean squared residual of the fits with given shifts, counts²."""
    design = step_design(shifts)
    residual = values - design @ (np.linalg.pinv(design) @ values)
    return float(np.mean(residual**2))


def step_errors(
    shifts_rad: NDArray[np.float64], nominal_rad: Sequence[float] | NDArray[np.float64]
) -> NDArray[np.float64]:
    """Differences of shifts from the nominal ones, rad; their mean is zero, because a common shift
    cannot be seen in the frames."""
    off = np.exp(1j * (shifts_rad - np.asarray(nominal_rad)))
    errors = np.angle(off * np.conj(np.mean(off)))
    return np.asarray(errors - errors.mean())


def _aligned(shifts: NDArray[np.float64], nominal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shifts with zero mean difference from the nominal ones, mirrored if that is closer."""

    candidates = (nominal + step_errors(shifts, nominal), nominal + step_errors(-shifts, nominal))
    return min(candidates, key=lambda s: float(np.abs(s - nominal).max()))


def _iterated(
    values: FloatMap, shifts: NDArray[np.float64], nominal: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Shifts by least squares over pixels and over frames in turn (Wang & Han, 2004)."""
    for _ in range(MAX_ITERATIONS):
        background, c, s = np.linalg.pinv(step_design(shifts)) @ values
        normal = np.array([[c @ c, c @ s], [c @ s, s @ s]])
        fringes = values - background
        k, q = np.linalg.solve(normal, np.stack((fringes @ c, fringes @ s)))
        new = _aligned(np.arctan2(q, k), nominal)
        change = float(np.abs(new - shifts).max())
        shifts = new
        if change < CONVERGED_RAD:
            break
    return shifts


def _by_components(
    values: FloatMap, nominal: NDArray[np.float64], *, strict: bool = True
) -> NDArray[np.float64]:
    """Shifts from the two principal components of the samples (Vargas et al., 2011).

    If the phases are evenly spread, the samples minus A have the covariance ½ B² (cos δ_n cos δ_m +
    sin δ_n sin δ_m). Its two eigenvectors, times the roots of their eigenvalues, are the columns
    cos δ and sin δ up to a rotation. ``strict`` refuses phases that are not evenly spread.
    """
    shifts = nominal.copy()
    for _ in range(MAX_ITERATIONS):
        design = step_design(shifts)
        background, c, s = np.linalg.pinv(design) @ values
        fringes = values - background
        fringes = fringes - fringes.mean(axis=1, keepdims=True)
        power, vectors = np.linalg.eigh(fringes @ fringes.T / fringes.shape[1])
        plane = vectors[:, -2:] * np.sqrt(np.maximum(power[-2:], 0.0))
        new = _aligned(np.arctan2(plane[:, 1], plane[:, 0]), nominal)
        change = float(np.abs(new - shifts).max())
        shifts = new
        if change < CONVERGED_RAD:
            break
    if strict:
        phasor = (c + 1j * s) / np.maximum(np.hypot(c, s), MIN_PHASOR)
        uneven = max(abs(np.mean(phasor)), abs(np.mean(phasor**2)))
        if uneven > MAX_UNEVEN:
            raise InputError(
                f"steps: {nominal.size} frames determine their shifts only if several fringes "
                f"cross the image; expected phases with an unevenness of {MAX_UNEVEN:g} or less, "
                f"got {uneven:.2f}"
            )
    return shifts
