"""What a user would write today with SciPy: the yardsticks."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from scipy import fft
from scipy.interpolate import CubicSpline
from scipy.signal import argrelextrema

from benchmarks.harness import peer_module


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


def wff_scipy(
    field: np.ndarray,
    threshold: float,
    sigma: float = 10.0,
    limit: float = 0.5,
    step: float = 0.1,
) -> np.ndarray:
    """Windowed Fourier filter, every coefficient of every pixel, zeros around the field."""
    n = field.shape[0]
    reach = round(3 * sigma)
    size = fft.next_fast_len(n + 2 * reach)
    spectrum = fft.fft2(field, (size, size), workers=2)
    k = np.arange(-reach, reach + 1)
    window = np.exp(-(k**2) / 2 / sigma**2)
    window /= np.sqrt((window**2).sum())
    total = np.zeros((size, size), np.complex64)
    frequencies = np.arange(-limit, limit + step / 2, step)
    lines = [fft.fft((window * np.exp(1j * w * k)).astype(np.complex64), size) for w in frequencies]
    for line_y in lines:
        for line_x in lines:
            atom = line_y[:, None] * line_x[None]
            coefficients = fft.ifft2(spectrum * atom, overwrite_x=True, workers=2)
            coefficients[np.abs(coefficients) < threshold] = 0
            total += fft.fft2(coefficients, overwrite_x=True, workers=2) * atom
    found = fft.ifft2(total, overwrite_x=True, workers=2)
    return found[2 * reach : 2 * reach + n, 2 * reach : 2 * reach + n]


def cwt_scipy(frame: np.ndarray, frequencies: np.ndarray, omega: float = 6.0) -> np.ndarray:
    """Largest coefficient of the complex Morlet transform of every sample."""
    n = frame.shape[1]
    size = fft.next_fast_len(2 * n)
    spectrum = fft.fft(frame, size, axis=1, workers=2)
    w = 2 * np.pi * fft.fftfreq(size)
    a = omega / (2 * np.pi * frequencies)
    wavelets = (2 * np.exp(-0.5 * (a[:, None] * w - omega) ** 2) * (w > 0)).astype(np.float32)
    product = spectrum[:, None, :] * wavelets
    coefficients = fft.ifft(product, axis=2, workers=2, overwrite_x=True)[:, :, :n]
    best = np.abs(coefficients).argmax(axis=1)
    return np.take_along_axis(coefficients, best[:, None], axis=1)[:, 0]


def cwt_fcwt_rows(frame: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """The same with fCWT's own Morlet, row by row."""
    fcwt = peer_module("fcwt")

    def row(values: np.ndarray) -> np.ndarray:
        _, coefficients = fcwt.cwt(
            values, 1, float(frequencies[0]), float(frequencies[-1]), frequencies.size
        )
        return coefficients[np.abs(coefficients).argmax(axis=0), np.arange(values.size)]

    with ThreadPoolExecutor(2) as pool:
        return np.array(list(pool.map(row, frame)))


def fourier_scipy_rows(reference: np.ndarray, object_: np.ndarray, period: float) -> np.ndarray:
    """Takeda & Mutoh by rows: Hann band of ±0.9 carriers, as most scripts write it."""
    n = reference.shape[1]
    distance = np.abs(fft.fftfreq(n) - 1 / period) / (0.9 / period)
    band = np.where(distance < 1, 0.5 + 0.5 * np.cos(np.pi * np.minimum(distance, 1)), 0)

    def analytic(frame: np.ndarray) -> np.ndarray:
        return fft.ifft(fft.fft(frame, axis=1, workers=2) * band, axis=1, workers=2)

    return analytic(reference) * np.conj(analytic(object_))
