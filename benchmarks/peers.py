"""What a user would write today with SciPy: the yardsticks."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import argrelextrema


def gsifa_scipy_rows(
    reference: np.ndarray, object_: np.ndarray, period: float, n_resample: int = 5
) -> np.ndarray:
    """Global spline IFA as a row loop over SciPy's ``CubicSpline``; for ideal frames."""
    u = np.full(reference.shape, np.nan)
    for y in range(reference.shape[0]):
        u[y] = _row(reference[y], object_[y], period, n_resample)
    return u


def _bounds(spline: CubicSpline, row: np.ndarray, period: float) -> np.ndarray:
    order = max(1, int(period / 8))
    maxima = argrelextrema(row, np.greater_equal, order=order)[0]
    minima = argrelextrema(row, np.less_equal, order=order)[0]
    near = np.union1d(maxima, minima)
    near = near[(near > 1) & (near < row.size - 2)]
    roots = spline.derivative().roots(extrapolate=False)
    roots = roots[np.isfinite(roots)]
    inner = np.unique([roots[np.argmin(np.abs(roots - k))] for k in near])
    # Ties on a flat top give the same root twice to within rounding.
    inner = inner[np.diff(inner, prepend=-np.inf) > 0.25 * period]
    return np.concatenate(([0.0], inner, [row.size - 1.0]))


def _row(s: np.ndarray, d: np.ndarray, period: float, n_resample: int) -> np.ndarray:
    x = np.arange(s.size, dtype=float)
    s_spline, d_spline = CubicSpline(x, s), CubicSpline(x, d)
    s_bounds, d_bounds = _bounds(s_spline, s, period), _bounds(d_spline, d, period)
    found = np.full(s.size, np.nan)
    for k in range(min(s_bounds.size, d_bounds.size) - 1):
        a, b = s_bounds[k], s_bounds[k + 1]
        dense = np.linspace(a, b, int((b - a) * n_resample) + 1)
        intensity = s_spline(dense)
        if intensity[-1] < intensity[0]:
            dense, intensity = dense[::-1], intensity[::-1]
        rising = np.concatenate(([True], np.diff(np.maximum.accumulate(intensity)) > 0))
        inverse = CubicSpline(intensity[rising], dense[rising], bc_type="clamped")
        pixels = np.arange(int(np.ceil(d_bounds[k])), int(np.floor(d_bounds[k + 1])) + 1)
        inside = np.clip(d[pixels], intensity[rising][0], intensity[rising][-1])
        found[pixels] = pixels - inverse(inside)
    return found
