"""The band around the carrier: from a real fringe frame to its analytic signal."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from fringeworks.types import FloatMap, InputError

Shape = Literal["hann", "gaussian", "tukey", "rectangular"]
SHAPES = ("hann", "gaussian", "tukey", "rectangular")
Analytic = NDArray[np.complex64]
WIDTH = 0.9
"""Usual half-width of the band, share of the carrier frequency."""


def profile(distance: FloatMap, shape: Shape) -> FloatMap:
    """Height of the band at a distance from its centre, 0 from a distance of 1 on.

    "hann": cos²; "gaussian": down to 1 % at the edge; "tukey": flat over the inner half, then
    cos²; "rectangular": 1 throughout.
    """
    inside = distance < 1.0
    r = np.minimum(distance, 1.0)
    if shape == "hann":
        height = 0.5 + 0.5 * np.cos(np.pi * r)
    elif shape == "gaussian":
        height = np.exp(-np.log(100.0) * r**2)
    elif shape == "tukey":
        height = 0.5 + 0.5 * np.cos(2.0 * np.pi * np.maximum(r - 0.5, 0.0))
    else:
        height = np.ones_like(r)
    return np.where(inside, height, 0.0)


def check_band(dimensions: int, width: float, shape: str) -> None:
    """Refuse options that make no band."""
    if dimensions not in (1, 2):
        raise InputError(f"dimensions: expected 1 or 2, got {dimensions}")
    if not 0 < width < 1:
        raise InputError(f"width: expected between 0 and 1, got {width}")
    if shape not in SHAPES:
        raise InputError(f"window: expected one of {', '.join(SHAPES)}, got {shape!r}")


def band_pass(
    frame: FloatMap,
    frequency: tuple[float, float],
    *,
    width: float = WIDTH,
    dimensions: Literal[1, 2] = 2,
    window: Shape = "hann",
) -> tuple[Analytic, float]:
    """The frame's positive-frequency part around the carrier.

    Parameters
    ----------
    frame : (h, w) float array
    frequency : (fx, fy), cycles/px, fx > 0
    width : float in (0, 1)
        Half-width of the band, as a share of the carrier frequency.
    dimensions : 1 or 2
        Row by row around fx, or the whole frame around (fx, fy).
    window : "hann", "gaussian", "tukey" or "rectangular"

    Returns
    -------
    analytic : (h, w) complex64 array, A + B cos φ becomes B/2 · exp(iφ)
    share : float
        White noise of variance σ² leaves the band with a complex variance of share · σ².

    Notes
    -----
    Takeda & Mutoh, Applied Optics 22(24):3977, 1983. Only the columns of the spectrum that lie in
    the band are transformed along the other axis: the second dimension costs next to nothing.
    """
    h, w = frame.shape
    fx, fy = frequency
    radius = width * (fx if dimensions == 1 else float(np.hypot(fx, fy)))
    first = max(0, int(np.ceil((fx - radius) * w)))
    last = min(w // 2, int(np.floor((fx + radius) * w)))
    along_x = (np.arange(first, last + 1) / w - fx) / radius
    values = np.ascontiguousarray(frame, dtype=np.float32)
    if dimensions == 1:
        level = values.mean(axis=1, keepdims=True)
        height = profile(np.abs(along_x), window)[None, :]
    else:
        level = values.mean()
        along_y = (fft.fftfreq(h) - fy) / radius
        height = profile(np.hypot(along_x[None, :], along_y[:, None]), window)
    part = fft.rfft(values - level, axis=1, workers=-1)[:, first : last + 1]
    gain = height.astype(np.float32)
    if dimensions == 1:
        part = part * gain
    else:
        part = fft.fft(part, axis=0, workers=-1) * gain
        part = fft.ifft(part, axis=0, overwrite_x=True, workers=-1)
    spectrum = np.zeros((h, w), np.complex64)
    spectrum[:, first : last + 1] = part
    analytic = fft.ifft(spectrum, axis=1, overwrite_x=True, workers=-1)
    return np.asarray(analytic), float(np.sum(height**2)) / (w * height.shape[0])
