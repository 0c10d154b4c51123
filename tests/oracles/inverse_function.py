"""Readable twin of the row-wise inverse function analysis, in SciPy.

It covers rows whose extrema correspond one to one. The matching of unequal numbers of extrema is
tested beside the kernel.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq


def row_spline(row: np.ndarray) -> CubicSpline:
    """Cubic spline through the row, with the slopes of the outermost cubics at its ends."""
    weights = np.array([-11.0, 18.0, -9.0, 2.0]) / 6.0
    ends = (float(weights @ row[:4]), -float(weights @ row[::-1][:4]))
    return CubicSpline(np.arange(row.size), row, bc_type=((1, ends[0]), (1, ends[1])))


def extrema(row: np.ndarray, period: float, prominence: float = 0.3) -> list[tuple[float, float]]:
    """Alternating extrema (position, value) by hysteresis, for rows without plateaus."""
    spline = row_spline(row)
    roots = spline.derivative().roots(extrapolate=False)
    half = int(np.ceil(0.75 * period))
    samples, direction = [], 0
    high = low = 0
    for i, value in enumerate(row):
        window = row[max(0, i - half) : i + half + 1]
        threshold = prominence * np.ptp(window)
        if value > row[high]:
            high = i
        if value < row[low]:
            low = i
        if direction >= 0 and row[high] - value > threshold:
            samples.append(high)
            direction, high, low = -1, i, i
        elif direction <= 0 and value - row[low] > threshold:
            samples.append(low)
            direction, high, low = 1, i, i
        if direction < 0:
            high = i
        elif direction > 0:
            low = i
    positions = [float(roots[np.argmin(np.abs(roots - i))]) for i in samples if i > 0]
    return [(p, float(spline(p))) for p in positions]


def invert_row(
    reference: np.ndarray, object_: np.ndarray, period: float, method: str, n_resample: int = 10
) -> np.ndarray:
    """u(x) = x − s⁻¹(d(x)) for one row, by ``sifa``, ``gsifa`` or ``exact``."""
    spline = row_spline(reference)
    s_extrema, d_extrema = extrema(reference, period), extrema(object_, period)
    assert len(s_extrema) == len(d_extrema)
    last = reference.size - 1
    s_bounds = [0.0, *(p for p, _ in s_extrema), float(last)]
    d_bounds = [0.0, *(p for p, _ in d_extrema), float(last)]
    u = np.full(reference.size, np.nan)
    for k in range(len(s_bounds) - 1):
        a, b = s_bounds[k], s_bounds[k + 1]
        ia, ib = float(spline(a)), float(spline(b))
        inverse = _inverse(spline, reference, a, b, method, n_resample)
        for x in range(int(np.ceil(d_bounds[k])), int(np.floor(d_bounds[k + 1])) + 1):
            low, high = min(ia, ib), max(ia, ib)
            slack = 0.05 * (high - low)
            if low - slack <= object_[x] <= high + slack:
                u[x] = x - inverse(float(np.clip(object_[x], low, high)))
    return u


def _inverse(spline, row, a, b, method, n_resample):
    """Function that maps an intensity to its position between the extrema at a and b."""
    if method == "exact":

        def root(intensity: float) -> float:
            fa, fb = float(spline(a)) - intensity, float(spline(b)) - intensity
            if fa == 0.0 or fa * fb > 0:
                return a if abs(fa) <= abs(fb) else b
            return float(brentq(lambda x: float(spline(x)) - intensity, a, b, xtol=1e-13))

        return root
    if method == "sifa":
        inside = np.arange(int(np.floor(a + 0.02)) + 1, int(np.ceil(b - 0.02)))
        x = np.concatenate(([a], inside, [b]))
    else:
        count = max(3, int(np.ceil((b - a) * n_resample)))
        x = np.linspace(a, b, count + 1)
    intensity = spline(x)
    if method == "sifa":
        intensity[1:-1] = row[inside]
    if intensity[-1] < intensity[0]:
        x, intensity = x[::-1], intensity[::-1]
    fit = CubicSpline(intensity, x, bc_type=((1, 0.0), (1, 0.0)))
    return lambda value: float(fit(value))
