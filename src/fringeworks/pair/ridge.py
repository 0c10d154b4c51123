"""What the ridges of windowed spectra share: sub-bin peaks, curvature, and going to all pixels.

A ridge is found on a lattice that holds the spectrum; every point of it is a local wave with its
own frequency and curvature, and a pixel is blended from the four around it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringeworks.pair.bandpass import Analytic
from fringeworks.types import FloatMap

RIM = 2.0
"""Width of the border whose curvature is not believed, σ."""
CURVATURE_SMOOTHING = 3.0
"""Width over which the ridge's curvature is averaged, σ."""

Pair = tuple[FloatMap, FloatMap]
Places = NDArray[np.intp]


def _vertex(before: FloatMap, here: FloatMap, after: FloatMap) -> FloatMap:
    """Where the parabola through three equidistant values peaks, in steps from the middle one."""
    bend = np.minimum(before - 2.0 * here + after, -1e-6)
    return np.asarray(np.clip(0.5 * (before - after) / bend, -1.0, 1.0))


def strongest(coefficients: Analytic) -> tuple[Analytic, Places, Places, FloatMap, FloatMap]:
    """The largest coefficient of every place of a grid of windows (j, i, h, w).

    Returns
    -------
    value : (h, w) complex
    j, i : (h, w) which window it is of
    dj, di : (h, w) how far from it the peak lies, in windows: the vertex of the parabola through
        the logarithms of neighbours, at the end of the grid of the last three
    """
    power = np.log(np.abs(coefficients) + np.float32(1e-30))
    nj, ni, h, w = power.shape
    best = power.reshape(nj * ni, h, w).argmax(axis=0)
    j, i = best // ni, best % ni
    rows, columns = np.ogrid[:h, :w]
    jc, ic = np.clip(j, 1, nj - 2), np.clip(i, 1, ni - 2)
    dj = _vertex(*(power[jc + k, i, rows, columns] for k in (-1, 0, 1))) + jc - j
    di = _vertex(*(power[j, ic + k, rows, columns] for k in (-1, 0, 1))) + ic - i
    return np.asarray(coefficients[j, i, rows, columns]), j, i, dj, di


def curvature(
    frequencies: Pair,
    pitch: tuple[float, ...],
    sigma_px: float,
) -> tuple[FloatMap, FloatMap, FloatMap]:
    """Second derivatives (yy, xx, xy) of the phase, smoothed, on a lattice of frequencies (y, x)
    with that pitch; rad/px². ``sigma_px`` is the width of the window that saw them."""
    wy, wx = frequencies
    widths = [CURVATURE_SMOOTHING * sigma_px / p for p in pitch]
    # At the border the continued field bends as it likes: the inside speaks for it.
    weight = np.ones(wy.shape)
    for axis, p in enumerate(pitch):
        rim = int(np.ceil(RIM * sigma_px / p))
        if 2 * rim + 2 < weight.shape[axis]:
            at = np.arange(weight.shape[axis])
            outside = (at < rim) | (at >= weight.shape[axis] - rim)
            weight[np.expand_dims(outside, 1 - axis) & np.ones(weight.shape, bool)] = 0.0
    total = ndimage.gaussian_filter(weight, widths, mode="nearest")

    def slope(values: FloatMap, axis: int) -> FloatMap:
        if values.shape[axis] < 3:
            return np.zeros(values.shape)
        raw = np.gradient(values, axis=axis) / pitch[axis]
        # Where the ridge jumps from one wave to another there is no slope.
        usual = 6.0 * float(np.median(np.abs(raw)))
        raw = np.clip(raw, -usual, usual) * weight
        smooth = ndimage.gaussian_filter(raw, widths, mode="nearest")
        return np.asarray(smooth / np.maximum(total, 1e-12))

    return slope(wy, 0), slope(wx, 1), 0.5 * (slope(wy, 1) + slope(wx, 0))


def window_factor(
    offsets: tuple[FloatMap, ...], bends: tuple[FloatMap, ...], sigma_px: float | FloatMap
) -> NDArray[np.complexfloating]:
    """What a Gaussian window makes of a quadratic phase, relative to a straight one on frequency.

    For the Hessian C and a frequency δ off: det(I − iσ²C)^(−1/2) · exp(−½σ² δᵀ(I − iσ²C)⁻¹δ).
    """
    s2 = sigma_px**2
    (dy, dx), (cyy, cxx, cxy) = offsets, bends
    a, d, b = 1.0 - 1j * s2 * cyy, 1.0 - 1j * s2 * cxx, -1j * s2 * cxy
    det = a * d - b * b
    form = (d * dy * dy - 2.0 * b * dy * dx + a * dx * dx) / det
    return np.asarray(np.exp(-0.5 * s2 * form) / np.sqrt(det))


def blend(
    local: Analytic,
    frequencies: Pair,
    bends: tuple[FloatMap, FloatMap, FloatMap],
    pitch: tuple[float, ...],
    shape: tuple[int, int],
) -> tuple[Analytic, FloatMap, FloatMap]:
    """Every pixel from the four lattice points around it, each with its own quadratic phase."""
    h, w = local.shape
    y, x = (np.arange(side) / p for side, p in zip(shape, pitch, strict=True))
    y0 = np.minimum(y.astype(np.intp), max(h - 2, 0))
    x0 = np.minimum(x.astype(np.intp), max(w - 2, 0))
    wy, wx = (f.astype(np.float32) for f in frequencies)
    cyy, cxx, cxy = (c.astype(np.float32) for c in bends)
    phasor = np.zeros(shape, np.complex64)
    fy, fx = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
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
