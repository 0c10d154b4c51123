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


def smoothed(row: np.ndarray, period: float) -> tuple[np.ndarray, int]:
    """The row in the band of the carrier, and the number of its pixels per sample."""
    step = max(1, int(period / 24))
    samples = np.array([row[i : i + step].mean() for i in range(0, row.size, step)])
    sigma = 0.1 * period / step
    reach = int(np.ceil(3 * sigma))
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    continued = np.pad(samples, reach, mode="reflect", reflect_type="odd")
    return np.convolve(continued, weights / weights.sum(), mode="valid"), step


def prominent(y: np.ndarray, period: float, prominence: float) -> list[tuple[int, int]]:
    """Samples of alternating extrema by hysteresis, with 1 for maxima and −1 for minima."""
    half = int(np.ceil(0.75 * period))
    block = -(-half // 8)
    ranges = []
    for i in range(0, y.size, block):
        ranges.append(np.ptp(y[max(0, i - 8 * block) : i + 9 * block]))
    samples, direction = [], 0
    high = low = 0
    for i, value in enumerate(y):
        threshold = prominence * ranges[i // block]
        if value > y[high]:
            high = i
        if value < y[low]:
            low = i
        if direction >= 0 and y[high] - value > threshold:
            samples.append((high, 1))
            direction, high, low = -1, i, i
        elif direction <= 0 and value - y[low] > threshold:
            samples.append((low, -1))
            direction, high, low = 1, i, i
        if direction < 0:
            high = i
        elif direction > 0:
            low = i
    return [(i, sign) for i, sign in samples if i > 0]


def extrema(row: np.ndarray, period: float, prominence: float = 0.3) -> list[tuple[float, float]]:
    """Alternating extrema (position, value) of the fringes, for rows without plateaus."""
    spline = row_spline(row)
    roots = spline.derivative().roots(extrapolate=False)
    smooth, step = smoothed(row, period)
    chosen = prominent(smooth, period / step, prominence)
    middles = [(2 * i * step + step - 1) // 2 for i, _ in chosen]
    reach = int(np.ceil(0.25 * period))
    found = []
    for k, (i, sign) in enumerate(chosen):
        start = max(i * step - reach, 0)
        stop = min(i * step + step - 1 + reach, row.size - 1)
        if k > 0:
            start = max(start, -(-(middles[k - 1] + middles[k]) // 2))
        if k + 1 < len(chosen):
            stop = min(stop, (middles[k] + middles[k + 1]) // 2)
        sample = start + int(np.argmax(sign * row[start : stop + 1]))
        if 0 < sample < row.size - 1:
            position = float(roots[np.argmin(np.abs(roots - sample))])
            found.append((position, float(spline(position))))
    return found


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
