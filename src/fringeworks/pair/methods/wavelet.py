"""Wavelet analysis: the ridge of the continuous transform with a complex Morlet (theory §5)."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from fringeworks import _core
from fringeworks.pair.bandpass import Analytic
from fringeworks.pair.demodulation import Demodulated, to_displacement
from fringeworks.pair.lattice import lattice_samples, samples_inside, shift_wave
from fringeworks.pair.prepared import PreparedPair
from fringeworks.pair.registry import Solution, method
from fringeworks.pair.ridge import blend, curvature, strongest, window_factor
from fringeworks.types import FloatMap, InputError

OMEGA = 6.0
"""ω₀ of the Morlet: the envelope is ω₀/ω px wide."""
SCALES = 32
SPAN = 2.0
"""The scales reach from the carrier's frequency divided by this to that times this."""
HIGHEST = 0.45
"""Largest frequency of a wavelet, cycles/px."""
SMOOTHNESS = 0.1
"""Cost of a change of scale on a smooth path, share of the ridge's mean square."""
DIRECTIONS = 9
"""Directions of the two-dimensional wavelets …"""
DIRECTION_SPAN = np.pi / 3.0
"""… up to this far to either side of the carrier's, rad."""
PLANAR_SCALES = 12
"""Scales of the two-dimensional wavelets."""


def wavelet_frequencies(frequency: float, scales: int = SCALES, span: float = SPAN) -> FloatMap:
    """Centre frequencies in equal ratios around a carrier, cycles/px."""
    return np.geomspace(frequency / span, min(frequency * span, HIGHEST), scales)


def wavelet_ridge(
    frame: NDArray[np.generic],
    *,
    frequencies: FloatMap,
    omega: float = OMEGA,
    smooth_path: bool = False,
) -> tuple[Analytic, NDArray[np.float32]]:
    """Ridge of the wavelet transform along the rows of a fringe frame.

    Parameters
    ----------
    frame : (h, w) real array of finite values
    frequencies : (n ≥ 3,) array, cycles/px, rising in equal ratios, at most 0.5
    omega : float, 4 … 60
        ω₀ of the complex Morlet, whose spectrum is exp(−½(aω − ω₀)²).
    smooth_path : bool
        Follow the path along each row that changes scale least for what it collects, instead of
        the largest coefficient of every sample.

    Returns
    -------
    phasor : (h, w) complex64 array, B exp(iφ) of A + B cos φ
    frequency : (h, w) float32 array, local frequency along the row, rad/px

    Raises
    ------
    InputError for a frame or option that cannot be used.

    Notes
    -----
    Zhong & Weng, Applied Optics 43(26):4993, 2004; Watkins, Tan, Barnes, Optics Letters
    24(13):905, 1999. Wavelets are centred in the frequency domain and have no sub-sample bias. A
    phase of curvature c is biased by ½·atan(a²c) on the ridge of an envelope of a px: frequency
    and curvature are measured, and their effect divided out. Rows are continued at their ends.

    Examples
    --------
    >>> row = 3.0 * np.cos(2 * np.pi * np.arange(200) / 12.5)[None]
    >>> phasor, frequency = wavelet_ridge(row, frequencies=wavelet_frequencies(1 / 12.5))
    >>> bool(abs(np.angle(phasor[0, 100])) < 1e-3), round(float(abs(phasor[0, 100])), 2)
    (True, 3.0)
    """
    values = np.asarray(frame)
    if values.ndim != 2 or values.size == 0:
        raise InputError(f"frame: expected shape (h, w), got {values.shape}")
    if values.dtype.kind not in "fiu" or not np.isfinite(values).all():
        raise InputError("frame: expected finite real values")
    if not 4.0 <= omega <= 60.0:
        raise InputError(f"omega: expected 4 to 60, got {omega}")
    f = np.asarray(frequencies, dtype=np.float64)
    if f.ndim != 1 or f.size < 3 or not (np.diff(f) > 0).all() or not 0 < f[0] <= f[-1] <= 0.5:
        raise InputError("frequencies: expected three or more, rising, above 0 and up to 0.5")
    if not np.allclose(np.diff(np.log(f), 2), 0.0, atol=1e-6):
        raise InputError("frequencies: expected equal ratios between neighbours")
    return _core.wavelet_ridge_rows(
        np.ascontiguousarray(values, dtype=np.float32),
        frequencies=f.tolist(),
        omega=omega,
        smoothness=SMOOTHNESS if smooth_path else 0.0,
    )


def planar_ridge(frame: FloatMap, frequency: tuple[float, float], *, omega: float) -> Analytic:
    """Ridge over scales and directions of two-dimensional Morlet wavelets, B exp(iφ), (h, w).

    The envelope is round, ω₀/|ω| px wide; otherwise as ``wavelet_ridge``.
    """
    h, w = frame.shape
    steepest = float(np.hypot(*frequency))
    sizes = 2.0 * np.pi * wavelet_frequencies(steepest, PLANAR_SCALES)
    towards = float(np.arctan2(frequency[1], frequency[0]))
    angles = towards + np.linspace(-DIRECTION_SPAN, DIRECTION_SPAN, DIRECTIONS)
    typical = omega / (2.0 * np.pi * steepest)
    margin = int(np.ceil(2.0 * typical))
    lengths = [fft.next_fast_len(side + min(2 * margin, side)) for side in (h, w)]
    # The finest wavelet has the widest band.
    samples = [lattice_samples(n, omega / sizes[-1]) for n in lengths]
    padded = np.zeros(lengths, np.float32)
    padded[:h, :w] = frame - frame.mean()
    spectrum = fft.fft2(padded, workers=-1)
    pitch = (lengths[0] / samples[0], lengths[1] / samples[1])
    # Only the lattice points on the frame.
    inside = [samples_inside(m, side, p) for m, side, p in zip(samples, (h, w), pitch, strict=True)]
    coefficients = np.empty((len(angles), len(sizes), *inside), np.complex64)
    for row, angle in enumerate(angles):
        for column, size in enumerate(sizes):
            wave = (size * np.sin(angle), size * np.cos(angle))
            found = _coefficients(spectrum, wave, omega / size, samples)
            coefficients[row, column] = found[: inside[0], : inside[1]]
    value, j, i, turn, zoom = strongest(coefficients)
    size = sizes[i] * (sizes[1] / sizes[0]) ** zoom
    angle = angles[j] + turn * (angles[1] - angles[0])
    wy, wx = size * np.sin(angle), size * np.cos(angle)
    offsets = (wy - sizes[i] * np.sin(angles[j]), wx - sizes[i] * np.cos(angles[j]))
    bends = curvature((wy, wx), pitch, typical)
    local = value / window_factor(offsets, bends, omega / sizes[i])
    return blend(local.astype(np.complex64), (wy, wx), bends, pitch, (h, w))[0]


def _coefficients(
    spectrum: Analytic, wave: tuple[float, float], envelope_px: float, samples: list[int]
) -> Analytic:
    """One wavelet's coefficients on the lattice, normalised to the fringe's amplitude."""
    bins, gains, shifts = [], [], []
    for length, count, frequency in zip(spectrum.shape, samples, wave, strict=True):
        first = round(frequency * length / (2.0 * np.pi)) - count // 2
        at = first + np.arange(count)
        off = envelope_px * (2.0 * np.pi * at / length - frequency)
        bins.append(at % length)
        gains.append(np.exp(-0.5 * off**2).astype(np.float32))
        shifts.append(shift_wave(first, count))
    part = spectrum[np.ix_(*bins)] * (gains[0][:, None] * gains[1])
    scale = 2.0 * np.prod(samples) / spectrum.size
    found = fft.ifft2(part, overwrite_x=True, workers=-1) * np.float32(scale)
    return np.asarray(found * (shifts[0][:, None] * shifts[1]))


@method("wavelet")
def wavelet(
    pair: PreparedPair,
    *,
    dimensions: Literal[1, 2] = 1,
    omega: float = OMEGA,
    path: Literal["largest", "smooth"] = "largest",
) -> Solution:
    """Wavelet analysis: phase at the ridge of a complex Morlet, whose window follows the fringe.

    Parameters
    ----------
    pair : PreparedPair
    dimensions : 1 or 2
        Along the rows, or over scales and directions.
    omega : float, 4 … 60
        ω₀ of the wavelet: its envelope is ω₀/2π periods wide.
    path : "largest" or "smooth"
        Scale of the largest coefficient at every sample, or the smoothest path of scales along
        each row (one dimension).

    Notes
    -----
    Zhong & Weng 2004, Watkins et al. 1999; theory §5. φ is the difference of both frames' phases.
    """
    if dimensions not in (1, 2):
        raise InputError(f"dimensions: expected 1 or 2, got {dimensions}")
    if path not in ("largest", "smooth"):
        raise InputError(f"path: expected largest or smooth, got {path!r}")
    if not 4.0 <= omega <= 60.0:
        raise InputError(f"omega: expected 4 to 60, got {omega}")
    envelope = omega * pair.period / (2.0 * np.pi)
    if dimensions == 1:
        frequencies = wavelet_frequencies(pair.frequency[0])
        reference, object_ = (
            wavelet_ridge(
                frame, frequencies=frequencies, omega=omega, smooth_path=path == "smooth"
            )[0]
            for frame in (pair.reference, pair.object)
        )
        share = 1.0 / (2.0 * np.sqrt(np.pi) * envelope)
    else:
        reference, object_ = (
            planar_ridge(frame, pair.frequency, omega=omega)
            for frame in (pair.reference, pair.object)
        )
        share = 1.0 / (4.0 * np.pi * envelope**2)
    return to_displacement(
        pair,
        Demodulated(
            phasor=reference * np.conj(object_),
            reference_amplitude=np.abs(reference),
            object_amplitude=np.abs(object_),
            noise_share=share,
            details={"envelope_px": envelope},
        ),
    )
