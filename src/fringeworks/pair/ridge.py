"""Steps shared by all ridges of windowed spectra: sub-bin peaks, curvature, interpolation.

A ridge is found on a lattice that holds the spectrum (``lattice``). Every lattice point has a local
wave with its own frequency and curvature; a pixel is interpolated from the four points around it.
Theory §5, "Windowed Fourier".
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.pair.bandpass import Analytic
from fringeworks.types import FloatMap

BORDER = 2.0
"""Width of the border whose curvature is ignored, σ.

Windows there cover the continued field, whose curvature is not measured. An empirical choice.
"""
CURVATURE_SMOOTHING = 3.0
"""Width of the Gaussian that averages the ridge's curvature, σ.

The derivative of the frequency is noisy; a surface's curvature varies more slowly than its slope.
An empirical choice.
"""
MAX_SLOPE_MEDIANS = 6.0
"""Largest slope of the frequency, as a multiple of the median absolute slope.

Steeper slopes come from a ridge that jumps between two waves. An empirical choice.
"""
MIN_BEND = 1e-6
"""Smallest curvature of the parabola through three logarithms, so that its vertex stays finite."""
SMALLEST_COEFFICIENT = 1e-30
"""Added to a coefficient's modulus so that its logarithm stays finite."""
MIN_WEIGHT = 1e-12
"""Smallest sum of weights in a local mean, so that the quotient stays finite."""

MapsYX = tuple[FloatMap, FloatMap]
"""One map along y (rows) and one along x (columns)."""
Hessian = tuple[FloatMap, FloatMap, FloatMap]
"""Second derivatives (yy, xx, xy) of the phase, rad/px²."""
Indices = NDArray[np.intp]


def _vertex(before: FloatMap, here: FloatMap, after: FloatMap) -> FloatMap:
    """Vertex of the parabola through three equidistant values, in steps from the middle, −1…1."""
    bend = np.minimum(before - 2.0 * here + after, -MIN_BEND)
    return np.asarray(np.clip(0.5 * (before - after) / bend, -1.0, 1.0))


def strongest(coefficients: Analytic) -> tuple[Analytic, Indices, Indices, FloatMap, FloatMap]:
    """Find the largest coefficient of every lattice point over a grid of windows.

    Parameters
    ----------
    coefficients : (nj, ni, h, w) complex array, nj, ni ≥ 3

    Returns
    -------
    value : (h, w) complex array
        The largest coefficient.
    j, i : (h, w) integer arrays
        Indices of its window.
    dj, di : (h, w) float arrays
        Distance of the peak from that window, in windows: the vertex of the parabola through the
        logarithms of three neighbours; at the end of the grid, of the last three.
    """
    power = np.log(np.abs(coefficients) + np.float32(SMALLEST_COEFFICIENT))
    nj, ni, h, w = power.shape
    best = power.reshape(nj * ni, h, w).argmax(axis=0)
    j, i = best // ni, best % ni
    rows, columns = np.ogrid[:h, :w]
    jc, ic = np.clip(j, 1, nj - 2), np.clip(i, 1, ni - 2)
    dj = _vertex(*(power[jc + k, i, rows, columns] for k in (-1, 0, 1))) + jc - j
    di = _vertex(*(power[j, ic + k, rows, columns] for k in (-1, 0, 1))) + ic - i
    return np.asarray(coefficients[j, i, rows, columns]), j, i, dj, di


def curvature(frequencies: MapsYX, pitch: tuple[float, ...], sigma_px: float) -> Hessian:
    """Compute the smoothed second derivatives of the phase from the ridge's frequency.

    Parameters
    ----------
    frequencies : two (h, w) float arrays
        Frequency along y and x at the lattice points, rad/px.
    pitch : (float, float)
        Distance of the lattice points along y and x, px.
    sigma_px : float
        Width of the window that the frequency comes from, px.

    Returns
    -------
    (yy, xx, xy), three (h, w) float arrays, rad/px²
    """
    wy, wx = frequencies
    widths = [CURVATURE_SMOOTHING * sigma_px / p for p in pitch]
    weight = _inner_weight(wy.shape, pitch, sigma_px)
    total = scipy.ndimage.gaussian_filter(weight, widths, mode="nearest")

    def slope(values: FloatMap, axis: int) -> FloatMap:
        if values.shape[axis] < 3:
            return np.zeros(values.shape)
        raw = np.gradient(values, axis=axis) / pitch[axis]
        limit = MAX_SLOPE_MEDIANS * float(np.median(np.abs(raw)))
        raw = np.clip(raw, -limit, limit) * weight
        smooth = scipy.ndimage.gaussian_filter(raw, widths, mode="nearest")
        return np.asarray(smooth / np.maximum(total, MIN_WEIGHT))

    return slope(wy, 0), slope(wx, 1), 0.5 * (slope(wy, 1) + slope(wx, 0))


def _inner_weight(shape: tuple[int, ...], pitch: tuple[float, ...], sigma_px: float) -> FloatMap:
    """1 inside and 0 within ``BORDER`` of the lattice's ends; 1 along sides too short for that."""
    weight = np.ones(shape)
    for axis, p in enumerate(pitch):
        border = int(np.ceil(BORDER * sigma_px / p))
        if 2 * border + 2 < shape[axis]:
            at = np.arange(shape[axis])
            outside = (at < border) | (at >= shape[axis] - border)
            weight[np.expand_dims(outside, 1 - axis) & np.ones(shape, bool)] = 0.0
    return weight


def window_factor(
    offsets: MapsYX, hessian: Hessian, sigma_px: float | FloatMap
) -> NDArray[np.complexfloating]:
    """Compute the factor by which a Gaussian window changes the coefficient of a quadratic phase.

    Parameters
    ----------
    offsets : two float arrays
        Distance δ of the wave's frequency from the window's, along y and x, rad/px.
    hessian : three float arrays
        Second derivatives C of the phase (yy, xx, xy), rad/px².
    sigma_px : float or float array
        Width σ of the window, px.

    Returns
    -------
    complex array
        det(I − iσ²C)^(−1/2) · exp(−½σ² δᵀ(I − iσ²C)⁻¹δ), relative to a plane wave at the window's
        frequency (theory §5).
    """
    s2 = sigma_px**2
    (dy, dx), (cyy, cxx, cxy) = offsets, hessian
    a, d, b = 1.0 - 1j * s2 * cyy, 1.0 - 1j * s2 * cxx, -1j * s2 * cxy
    det = a * d - b * b
    form = (d * dy * dy - 2.0 * b * dy * dx + a * dx * dx) / det
    return np.asarray(np.exp(-0.5 * s2 * form) / np.sqrt(det))


def blend(
    local: Analytic,
    frequencies: MapsYX,
    hessian: Hessian,
    pitch: tuple[float, ...],
    shape: tuple[int, int],
    part: slice = slice(None),
) -> tuple[Analytic, FloatMap, FloatMap]:
    """Interpolate every pixel from the local waves of the four lattice points around it.

    Parameters
    ----------
    local : (m, n) complex array
        Phasors at the lattice points.
    frequencies, hessian : float arrays, (m, n)
        First derivatives (y, x) of the phase, rad/px, and second ones (yy, xx, xy), rad/px².
    pitch : (float, float)
        Distance of the lattice points along y and x, px.
    shape : (h, w)
        Shape of the frame, px.
    part : slice
        Rows to interpolate, all by default.

    Returns
    -------
    phasor : (r, w) complex64 array
    frequency_y, frequency_x : (r, w) float32 arrays, rad/px
    """
    h, w = local.shape
    y, x = (np.arange(side) / p for side, p in zip(shape, pitch, strict=True))
    y = y[part]
    y0 = np.minimum(y.astype(np.intp), max(h - 2, 0))
    x0 = np.minimum(x.astype(np.intp), max(w - 2, 0))
    wy, wx = (f.astype(np.float32) for f in frequencies)
    cyy, cxx, cxy = (c.astype(np.float32) for c in hessian)
    size = (y.size, x.size)
    phasor = np.zeros(size, np.complex64)
    fy, fx = np.zeros(size, np.float32), np.zeros(size, np.float32)
    for j in (0, 1):
        for i in (0, 1):
            at = np.ix_(np.minimum(y0 + j, h - 1), np.minimum(x0 + i, w - 1))
            dy = ((y - y0 - j) * pitch[0])[:, None].astype(np.float32)
            dx = ((x - x0 - i) * pitch[1])[None, :].astype(np.float32)
            weight = (1.0 - np.abs(dy) / pitch[0]) * (1.0 - np.abs(dx) / pitch[1])
            weight = np.maximum(weight, 0.0).astype(np.float32)
            phase = wy[at] * dy + wx[at] * dx
            phase += 0.5 * (cyy[at] * dy * dy + cxx[at] * dx * dx) + cxy[at] * dy * dx
            phasor += weight * local[at] * np.exp(1j * phase)
            fy += weight * (wy[at] + cyy[at] * dy + cxy[at] * dx)
            fx += weight * (wx[at] + cxx[at] * dx + cxy[at] * dy)
    return phasor, fy, fx
