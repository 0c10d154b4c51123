"""Band-pass around the carrier: from a real fringe frame to its analytic signal (theory §5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.signal.bands import row_bands
from fringeworks.types import FloatMap, InputError

Shape = Literal["hann", "gaussian", "tukey", "rectangular"]
SHAPES = ("hann", "gaussian", "tukey", "rectangular")
"""Names of the shapes that a pass band can have."""
Analytic = NDArray[np.complex64]
HALF_WIDTH = 0.9
"""Default half-width of the pass band, as a share of the carrier frequency.

Below 1 the band excludes the background at frequency 0; close to 1 it keeps the most of the
object's spectrum. It reaches almost to the second harmonic, which the Hann shape suppresses. An
empirical choice.
"""
GAUSSIAN_EDGE = 100.0
"""Ratio of a Gaussian band's response at the centre to that at the edge; 1 % remains there."""


def band_response(distance: FloatMap, shape: Shape) -> FloatMap:
    """Compute the response of the band at a distance from its centre, 0…1.

    Parameters
    ----------
    distance : float array of any shape, ≥ 0
        Distance from the centre as a share of the half-width; the response is 0 from 1 on.
    shape : "hann", "gaussian", "tukey" or "rectangular"
        cos²; a Gaussian that falls to 1 % at the edge; flat over the inner half, then cos²; or 1
        throughout.

    Examples
    --------
    >>> band_response(np.array([0.0, 0.5, 1.0]), "hann").round(3)
    array([1. , 0.5, 0. ])
    """
    inside = distance < 1.0
    r = np.minimum(distance, 1.0)
    if shape == "hann":
        response = 0.5 + 0.5 * np.cos(np.pi * r)
    elif shape == "gaussian":
        response = np.exp(-np.log(GAUSSIAN_EDGE) * r**2)
    elif shape == "tukey":
        response = 0.5 + 0.5 * np.cos(2.0 * np.pi * np.maximum(r - 0.5, 0.0))
    else:
        response = np.ones_like(r)
    return np.where(inside, response, 0.0)


def band_kernel(
    frequency: tuple[float, float], width: float, dimensions: int
) -> tuple[float, float]:
    """Width σ of the Gaussian kernel that is as wide as the band's, along y and x, px.

    The Hann band cos²(πf/2R) of half-width R is close to exp(−(πf/2R)²), which belongs to a kernel
    of σ = 1/(2√2 R). The other shapes are taken for it.
    """
    radius = width * (frequency[0] if dimensions == 1 else float(np.hypot(*frequency)))
    sigma = 1.0 / (2.0 * np.sqrt(2.0) * radius)
    return (0.0 if dimensions == 1 else sigma), sigma


def check_band(dimensions: int, width: float, shape: str) -> None:
    """Raise ``InputError`` for options that do not describe a pass band."""
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
    width: float = HALF_WIDTH,
    dimensions: Literal[1, 2] = 2,
    window: Shape = "hann",
) -> tuple[Analytic, float]:
    """Extract the analytic signal of the fringes: the positive frequencies around the carrier.

    Parameters
    ----------
    frame : (h, w) float array
        Finite counts.
    frequency : (fx, fy)
        Carrier, fx > 0, cycles/px.
    width : float in (0, 1)
        Half-width of the band, as a share of the carrier frequency.
    dimensions : 1 or 2
        Filter row by row around fx, or the whole frame around (fx, fy).
    window : "hann", "gaussian", "tukey" or "rectangular"
        Shape of the band, see ``band_response``.

    Returns
    -------
    analytic : (h, w) complex64 array
        B/2 · exp(iφ) of fringes A + B cos φ, counts.
    share : float
        Complex variance that white noise of variance 1 has after the filter.

    Notes
    -----
    Takeda & Mutoh, Applied Optics 22(24):3977, 1983, doi:10.1364/AO.22.003977; theory §5. In two
    dimensions, only the columns of the spectrum that lie in the band are transformed along y, so
    the second dimension costs little.

    Examples
    --------
    >>> x = np.arange(128.0)
    >>> fringes = np.tile(100 + 40 * np.cos(2 * np.pi * x / 16), (64, 1))
    >>> analytic, _ = band_pass(fringes, (1 / 16, 0.0))
    >>> round(2 * float(np.abs(analytic[32, 64])), 3)
    40.0
    """
    band = pass_band(frame, frequency, width=width, dimensions=dimensions, window=window)
    return band.rows(slice(None)), band.share


@dataclass(frozen=True, eq=False)
class PassBand:
    """The columns of a frame's spectrum, along its rows, that lie in the band of the fringes."""

    columns: NDArray[np.complex64]
    """(h, n) filtered spectra of the rows."""
    first: int
    """Bin of the first column."""
    width: int
    """Number of columns of the frame, px."""
    share: float
    """Complex variance that white noise of variance 1 has after the filter."""

    def rows(self, part: slice) -> Analytic:
        """Analytic signal of some rows, (r, w)."""
        columns = self.columns[part]
        spectrum = np.zeros((columns.shape[0], self.width), np.complex64)
        spectrum[:, self.first : self.first + columns.shape[1]] = columns
        return np.asarray(scipy.fft.ifft(spectrum, axis=1, overwrite_x=True, workers=-1))


def pass_band(
    frame: FloatMap,
    frequency: tuple[float, float],
    *,
    width: float = HALF_WIDTH,
    dimensions: Literal[1, 2] = 2,
    window: Shape = "hann",
) -> PassBand:
    """Filter the spectrum of a frame, as ``band_pass`` does, without the signal at every pixel.

    The columns in the band are a small part of the spectrum.
    """
    h, w = frame.shape
    fx, fy = frequency
    radius = width * (fx if dimensions == 1 else float(np.hypot(fx, fy)))
    first = max(0, int(np.ceil((fx - radius) * w)))
    last = min(w // 2, int(np.floor((fx + radius) * w)))
    along_x = (np.arange(first, last + 1) / w - fx) / radius
    if dimensions == 1:
        response = band_response(np.abs(along_x), window)[None, :]
    else:
        along_y = (scipy.fft.fftfreq(h) - fy) / radius
        response = band_response(np.hypot(along_x[None, :], along_y[:, None]), window)
    columns = np.empty((h, last + 1 - first), np.complex64)
    mean = None if dimensions == 1 else np.ascontiguousarray(frame, dtype=np.float32).mean()
    for band in row_bands((h, w), bytes_per_px=16):
        rows = np.ascontiguousarray(frame[band.rows], dtype=np.float32)
        rows = rows - (rows.mean(axis=1, keepdims=True) if mean is None else mean)
        columns[band.rows] = scipy.fft.rfft(rows, axis=1, workers=-1)[:, first : last + 1]
    if dimensions == 1:
        columns *= response.astype(np.float32)
    else:
        columns = scipy.fft.fft(columns, axis=0, overwrite_x=True, workers=-1)
        columns *= response.astype(np.float32)
        columns = scipy.fft.ifft(columns, axis=0, overwrite_x=True, workers=-1)
    share = float(np.sum(response**2)) / (w * response.shape[0])
    return PassBand(np.asarray(columns), first, w, share)
