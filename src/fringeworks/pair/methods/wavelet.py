"""Wavelet analysis: ridge of the continuous transform with complex Morlet wavelets (theory §5)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.pair.bandpass import Analytic
from fringeworks.pair.demodulation import Demodulated, compared, to_displacement
from fringeworks.pair.lattice import lattice_samples, samples_inside, shift_wave
from fringeworks.pair.prepared import PreparedPair
from fringeworks.pair.registry import Smoothing, Solution, method
from fringeworks.pair.ridge import CURVATURE_SMOOTHING, blend, curvature, strongest, window_factor
from fringeworks.types import LARGEST, FloatMap, InputError, finite, positive, unmasked, whole

OMEGA = 6.0
"""Default ω₀ of the Morlet wavelet; its envelope is ω₀/ω px wide at the frequency ω rad/px.

The usual choice: the wavelet's mean, exp(−ω₀²/2), is then negligible, and its envelope is about one
period wide.
"""
OMEGA_LIMITS = (4.0, 60.0)
"""Smallest and largest ω₀.

Below 4 the wavelet's mean is above 3e-4 and the background disturbs the phase; above 60 its
envelope is about ten periods wide and resolves little. Empirical choices.
"""
ROW_CURVATURE_SMOOTHING = 2.0
"""Width of the Gaussian that is as wide as the mean of a row's curvature, envelopes.

The ridge measures the frequency over an envelope and averages the curvature over two to either
side. Measured: the remaining errors on simulated curved surfaces are 0.9 to 1.2 of those that this
width predicts.
"""
ROW_SCALES = 32
"""Number of scales of the wavelets along rows.

Over ``SPAN`` neighbouring frequencies then differ by 4.6 %, against a relative bandwidth of 1/ω₀ of
17 %. An empirical choice.
"""
SPAN = 2.0
"""Ratio of the largest, and of the smallest, frequency of the wavelets to the carrier's.

A surface may stretch or compress fringes by this factor. A wider span lets shading and harmonics
win. An empirical choice.
"""
MAX_FREQUENCY = 0.45
"""Largest frequency of a wavelet, cycles/px; a tenth below the Nyquist frequency."""
SMOOTHNESS = 0.1
"""Cost of a change of scale on a smooth path, as a share of the ridge's mean square.

A larger cost bridges noise; a smaller one follows the fringe. An empirical choice.
"""
DIRECTIONS = 9
"""Number of directions of the two-dimensional wavelets; they are 15° apart.

The spectrum of a wavelet is 22° wide (ω₀ = 6, full width at half maximum), and peaks are
interpolated. An empirical choice.
"""
DIRECTION_SPAN = np.pi / 3.0
"""Largest angle between a wavelet's direction and the carrier's, rad. An empirical choice."""
PLANAR_SCALES = 12
"""Number of scales of the two-dimensional wavelets.

Fewer than along rows, because every scale is computed in every direction; peaks are interpolated.
An empirical choice.
"""
MOST_SCALES = 1000
"""Largest number of frequencies of wavelets; memory and time grow with it, and 32 are usual."""
PLANAR_MARGIN = 2.0
"""Width of the border of zeros around a frame, in envelopes at the carrier's frequency.

It keeps opposite sides of the frame apart, because the transform is periodic. An empirical choice.
"""


def wavelet_frequencies(frequency: float, scales: int = ROW_SCALES, span: float = SPAN) -> FloatMap:
    """Centre frequencies of wavelets in equal ratios around a carrier.

    Parameters
    ----------
    frequency : float > 0
        Carrier, cycles/px.
    scales : int
        Number of frequencies, 3 to 1000.
    span : float > 1
        They reach from frequency / span to frequency · span, at most 0.45 cycles/px.

    Returns
    -------
    (scales,) float array, rising, cycles/px

    Raises
    ------
    InputError for values that make no three rising frequencies.

    Examples
    --------
    >>> wavelet_frequencies(0.1, 3)
    array([0.05, 0.1 , 0.2 ])
    """
    if not (positive(frequency) and whole(scales, 3, MOST_SCALES) and finite(span) and span > 1):
        raise InputError(
            f"frequencies: expected a frequency > 0, 3 to {MOST_SCALES} scales and a span > 1, got "
            f"{frequency}, {scales} and {span}"
        )
    if not frequency / span < MAX_FREQUENCY:
        raise InputError(
            f"frequencies: expected some below {MAX_FREQUENCY} cycles/px, got {frequency / span:g}"
        )
    frequency = float(frequency)
    return np.geomspace(frequency / span, min(frequency * span, MAX_FREQUENCY), scales)


def _few(values: FloatMap) -> str:
    """The first values, for messages."""
    more = " …" if values.size > 4 else ""
    return f"{values.ravel()[:4].tolist()}{more}"


def _check_omega(omega: float) -> None:
    """Raise ``InputError`` where ω₀ is out of its range."""
    smallest, largest = OMEGA_LIMITS
    if not smallest <= omega <= largest:
        raise InputError(f"omega: expected {smallest:g} to {largest:g}, got {omega}")


def wavelet_ridge(
    frame: NDArray[np.generic],
    *,
    frequencies: FloatMap,
    omega: float = OMEGA,
    smooth_path: bool = False,
) -> tuple[Analytic, NDArray[np.float32]]:
    """Find the ridge of the wavelet transform along the rows of a fringe frame.

    Parameters
    ----------
    frame : (h, w) real array
        Finite values.
    frequencies : (n,) float array, n ≥ 3
        Centre frequencies of the wavelets, rising in equal ratios, at most 0.5 cycles/px.
    omega : float, 4 … 60
        ω₀ of the complex Morlet wavelet, whose spectrum is exp(−½(aω − ω₀)²).
    smooth_path : bool
        Follow the path along each row with the largest coefficients and the smallest changes of
        scale together, instead of the largest coefficient of every sample.

    Returns
    -------
    phasor : (h, w) complex64 array
        B exp(iφ) of fringes A + B cos φ.
    frequency : (h, w) float32 array
        Local frequency along the row, rad/px.

    Raises
    ------
    InputError
        If the frame or an option cannot be used.

    Notes
    -----
    Zhong & Weng, Applied Optics 43(26):4993, 2004, doi:10.1364/AO.43.004993; Watkins, Tan, Barnes,
    Optics Letters 24(13):905, 1999, doi:10.1364/OL.24.000905; theory §5. Wavelets are centred in
    the frequency domain, so they have no sub-sample bias. A phase of curvature c is biased by
    ½·atan(a²c) on the ridge of an envelope a px wide; frequency and curvature are measured, and
    their effect is divided out. Rows are extended at their ends.

    Examples
    --------
    >>> row = 3.0 * np.cos(2 * np.pi * np.arange(200) / 12.5)[None]
    >>> phasor, frequency = wavelet_ridge(row, frequencies=wavelet_frequencies(1 / 12.5))
    >>> bool(abs(np.angle(phasor[0, 100])) < 1e-3), round(float(abs(phasor[0, 100])), 2)
    (True, 3.0)
    """
    values = unmasked(frame, "frame")
    if values.ndim != 2 or values.size == 0:
        raise InputError(
            f"frame: expected shape (h, w) with at least one pixel, got {values.shape}"
        )
    if values.dtype.kind not in "fiu":
        raise InputError(f"frame: expected real numbers, got {values.dtype}")
    if not (values.min() >= -LARGEST and values.max() <= LARGEST):
        raise InputError(f"frame: expected finite values up to {LARGEST:g}, got others")
    _check_omega(omega)
    f = unmasked(frequencies, "frequencies").astype(np.float64)
    known = f.ndim == 1 and f.size >= 3 and bool(np.isfinite(f).all())
    if not known or not (np.diff(f) > 0).all() or not 0 < f[0] <= f[-1] <= 0.5:
        raise InputError(
            "frequencies: expected at least three rising values above 0 and up to 0.5 cycles/px, "
            f"got {_few(f)}"
        )
    if not np.allclose(np.diff(np.log(f), 2), 0.0, atol=1e-6):
        raise InputError(f"frequencies: expected equal ratios between neighbours, got {_few(f)}")
    return _core.wavelet_ridge_rows(
        np.ascontiguousarray(values, dtype=np.float32),
        frequencies=f.tolist(),
        omega=omega,
        smoothness=SMOOTHNESS if smooth_path else 0.0,
    )


def planar_ridge(frame: FloatMap, frequency: tuple[float, float], *, omega: float) -> Analytic:
    """Find the ridge over scales and directions of two-dimensional Morlet wavelets.

    Parameters
    ----------
    frame : (h, w) float array
        Finite values.
    frequency : (fx, fy)
        Carrier, cycles/px.
    omega : float, 4 … 60
        ω₀ of the wavelet; its envelope is round and ω₀/|ω| px wide.

    Returns
    -------
    (h, w) complex64 array
        B exp(iφ) of fringes A + B cos φ.

    Notes
    -----
    As ``wavelet_ridge``, on a lattice (``lattice``) that is interpolated to all pixels (``ridge``).
    """
    h, w = frame.shape
    carrier = float(np.hypot(*frequency))
    sizes = 2.0 * np.pi * wavelet_frequencies(carrier, PLANAR_SCALES)
    towards = float(np.arctan2(frequency[1], frequency[0]))
    angles = towards + np.linspace(-DIRECTION_SPAN, DIRECTION_SPAN, DIRECTIONS)
    typical = omega / (2.0 * np.pi * carrier)
    coefficients, pitch = _planar_coefficients(frame, sizes, angles, omega, typical)
    value, j, i, turn, zoom = strongest(coefficients)
    size = sizes[i] * (sizes[1] / sizes[0]) ** zoom
    angle = angles[j] + turn * (angles[1] - angles[0])
    wy, wx = size * np.sin(angle), size * np.cos(angle)
    offsets = (wy - sizes[i] * np.sin(angles[j]), wx - sizes[i] * np.cos(angles[j]))
    hessian = curvature((wy, wx), pitch, typical)
    local = value / window_factor(offsets, hessian, omega / sizes[i])
    return blend(local.astype(np.complex64), (wy, wx), hessian, pitch, (h, w))[0]


def _planar_coefficients(
    frame: FloatMap, sizes: FloatMap, angles: FloatMap, omega: float, typical_px: float
) -> tuple[Analytic, tuple[float, float]]:
    """Coefficients of all two-dimensional wavelets on the lattice points of the frame.

    Parameters
    ----------
    sizes : (n,) float array
        |ω| of the wavelets, rad/px.
    angles : (m,) float array
        Directions of the wavelets, rad.
    typical_px : float
        Width of the envelope at the carrier's frequency, px.

    Returns
    -------
    coefficients : (m, n, rows, columns) complex64 array
    pitch : (float, float)
        Distance of the lattice points along y and x, px.
    """
    h, w = frame.shape
    margin = int(np.ceil(PLANAR_MARGIN * typical_px))
    lengths = [scipy.fft.next_fast_len(side + min(2 * margin, side)) for side in (h, w)]
    # The wavelet of the highest frequency has the widest band and needs the most samples.
    samples = [lattice_samples(n, omega / sizes[-1]) for n in lengths]
    padded = np.zeros(lengths, np.float32)
    padded[:h, :w] = frame - frame.mean(dtype=np.float64)
    spectrum = scipy.fft.fft2(padded, workers=-1)
    pitch = (lengths[0] / samples[0], lengths[1] / samples[1])
    inside = [samples_inside(m, side, p) for m, side, p in zip(samples, (h, w), pitch, strict=True)]
    coefficients = np.empty((len(angles), len(sizes), *inside), np.complex64)
    for row, angle in enumerate(angles):
        for column, size in enumerate(sizes):
            wave = (size * np.sin(angle), size * np.cos(angle))
            everywhere = _coefficients(spectrum, wave, omega / size, samples)
            coefficients[row, column] = everywhere[: inside[0], : inside[1]]
    return coefficients, pitch


def _coefficients(
    spectrum: Analytic, wave: tuple[float, float], envelope_px: float, samples: list[int]
) -> Analytic:
    """Coefficients of one wavelet on the lattice, scaled to the amplitude of the fringes.

    ``wave`` is its frequency along y and x, rad/px; ``samples`` the lattice's size along y and x.
    """
    bins, responses, shifts = [], [], []
    for length, count, frequency in zip(spectrum.shape, samples, wave, strict=True):
        first = round(frequency * length / (2.0 * np.pi)) - count // 2
        at = first + np.arange(count)
        off = envelope_px * (2.0 * np.pi * at / length - frequency)
        bins.append(at % length)
        responses.append(np.exp(-0.5 * off**2).astype(np.float32))
        shifts.append(shift_wave(first, count))
    part = spectrum[np.ix_(*bins)] * (responses[0][:, None] * responses[1])
    scale = 2.0 * np.prod(samples) / spectrum.size
    coefficients = scipy.fft.ifft2(part, overwrite_x=True, workers=-1) * np.float32(scale)
    return np.asarray(coefficients * (shifts[0][:, None] * shifts[1]))


def _signals(
    pair: PreparedPair, dimensions: int, omega: float, path: str
) -> Callable[[slice], tuple[Analytic, Analytic]]:
    """Function that returns the ridges of reference and object in some rows."""
    frames = (pair.reference, pair.object)
    if dimensions == 2:
        one, other = (planar_ridge(frame, pair.frequency, omega=omega) for frame in frames)
        return lambda rows: (one[rows], other[rows])
    frequencies, smooth = wavelet_frequencies(pair.frequency[0]), path == "smooth"

    def along_rows(rows: slice) -> tuple[Analytic, Analytic]:
        one, other = (
            wavelet_ridge(frame[rows], frequencies=frequencies, omega=omega, smooth_path=smooth)[0]
            for frame in frames
        )
        return one, other

    return along_rows


@method("wavelet")
def wavelet(
    pair: PreparedPair,
    *,
    dimensions: Literal[1, 2] = 1,
    omega: float = OMEGA,
    path: Literal["largest", "smooth"] = "largest",
) -> Solution:
    """Takes the phase from the ridge of a wavelet transform, whose window follows the local period.

    Parameters
    ----------
    pair : PreparedPair
    dimensions : 1 or 2
        Transform along the rows, or over scales and directions.
    omega : float, 4 … 60
        ω₀ of the complex Morlet wavelet; its envelope is ω₀/2π periods wide.
    path : "largest" or "smooth"
        Scale of the largest coefficient at every sample, or the smoothest path of scales along each
        row (in one dimension only).

    Returns
    -------
    Solution

    Raises
    ------
    InputError
        If an option is out of its range.

    Notes
    -----
    Zhong & Weng 2004, Watkins et al. 1999 (see ``wavelet_ridge``); theory §5. φ is the difference
    between the phases of the two frames.
    """
    if dimensions not in (1, 2):
        raise InputError(f"dimensions: expected 1 or 2, got {dimensions}")
    if path not in ("largest", "smooth"):
        raise InputError(f"path: expected largest or smooth, got {path!r}")
    _check_omega(omega)
    envelope = omega * pair.period / (2.0 * np.pi)
    share = 1.0 / (4.0 * np.pi * envelope**2)
    if dimensions == 1:
        share = 1.0 / (2.0 * np.sqrt(np.pi) * envelope)
    length = (envelope if dimensions == 2 else 0.0, envelope)
    mean = ROW_CURVATURE_SMOOTHING if dimensions == 1 else CURVATURE_SMOOTHING
    return to_displacement(
        pair,
        Demodulated(
            **compared(pair.object.shape, _signals(pair, dimensions, omega, path)),
            noise_share=share,
            noise_length_px=length,
            smoothing=(Smoothing(length, (mean * length[0], mean * length[1])),),
            details={"envelope_px": envelope},
        ),
    )
