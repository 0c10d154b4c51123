"""Readable twin of windowed Fourier analysis: all coefficients at every pixel."""

from __future__ import annotations

import numpy as np
from scipy.signal import fftconvolve


def atoms(sigma: float, limit: float, step: float):
    """Yield (frequency y, frequency x, window of unit energy at that frequency)."""
    reach = int(np.ceil(6 * sigma))
    k = np.arange(-reach, reach + 1)
    g = np.exp(-(k**2) / (2 * sigma**2))
    g /= np.sqrt((g**2).sum())
    frequencies = np.arange(-limit, limit + step / 2, step)
    for wy in frequencies:
        for wx in frequencies:
            yield wy, wx, np.outer(g * np.exp(1j * wy * k), g * np.exp(1j * wx * k))


def wff(field, sigma, limit, step, threshold):
    """Sum of the soft-thresholded coefficients; the field is surrounded by zeros."""
    total = np.zeros(field.shape, complex)
    for _, _, atom in atoms(sigma, limit, step):
        s = fftconvolve(field, atom, mode="full")
        s = s * np.maximum(0, 1 - threshold / np.maximum(np.abs(s), 1e-30))
        total += fftconvolve(s, atom, mode="valid")
    return total * (step / (2 * np.pi)) ** 2


def wfr(field, sigma, limit, step):
    """Largest coefficient of every pixel, without correction of its phase, and its frequencies."""
    best = np.zeros(field.shape)
    value = np.zeros(field.shape, complex)
    frequency = np.zeros((2, *field.shape))
    for wy, wx, atom in atoms(sigma, limit, step):
        s = fftconvolve(field, atom, mode="same")
        larger = np.abs(s) > best
        best[larger], value[larger] = np.abs(s)[larger], s[larger]
        frequency[0][larger], frequency[1][larger] = wy, wx
    return value, frequency
