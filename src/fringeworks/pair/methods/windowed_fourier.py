"""Windowed Fourier analysis: filtering by a threshold (WFF) and the ridge (WFR) (theory §5)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringeworks.pair.bandpass import HALF_WIDTH, Analytic, band_kernel, pass_band
from fringeworks.pair.demodulation import Demodulated, to_displacement
from fringeworks.pair.lattice import Lattice, shift_wave
from fringeworks.pair.prepared import PreparedPair
from fringeworks.pair.registry import Smoothing, Solution, method
from fringeworks.pair.ridge import (
    CURVATURE_SMOOTHING,
    Hessian,
    MapsYX,
    blend,
    curvature,
    strongest,
    window_factor,
)
from fringeworks.signal.bands import row_bands
from fringeworks.signal.noise import noise_variance
from fringeworks.types import LARGEST, FloatMap, InputError, finite, positive, unmasked

CONTINUATION_DEPTH = 2.0
"""Distance from the field's end of the waves that continue it into the border, σ.

Waves closer to the end are measured with windows that reach into the border. An empirical choice.
"""
SIGMA_PX = 10.0
"""Default width σ of the Gaussian window, px; a usual value (Qian Kemao 2007)."""
NOISE_LENGTH = 0.95
"""Width of the kernel that correlates the noise, widths of the window.

The correction for the curvature makes it narrower than the window. Measured on planes.
"""
SIGMA_LIMITS_PX = (1.0, 1e3)
"""Smallest and largest width of the window, px.

Below 1 px a window holds hardly more than one pixel; above 1000 px it is as wide as a frame.
"""
MAX_FREQUENCY_RAD = 0.5
"""Default for the largest local frequency along each axis, rad/px.

It allows a local period of the phase down to 12.6 px. A wider range costs time and lets more noise
through. An empirical choice.
"""
FREQUENCY_STEP_RAD = 0.1
"""Default for the distance of the frequencies, rad/px.

It is 1/σ of the default window: the spectra of neighbouring windows overlap, and nothing between
them is lost.
"""
THRESHOLD_SIGMAS = 4.0
"""Smallest coefficient that is kept, in standard deviations of its noise (theory §5).

Complex noise alone exceeds it with a probability of exp(−16), about 10⁻⁷.
"""
MIN_REFERENCE_SHARE = 0.02
"""Smallest amplitude that the reference's analytic signal is divided by, share of the modulation.

It limits the noise where the reference is dark. An empirical choice.
"""


@dataclass(frozen=True)
class LocalWaves:
    """The strongest wave at every lattice point on the field."""

    phasor: Analytic
    """Phase and amplitude."""
    frequencies: MapsYX
    """Along y and x, rad/px."""
    hessian: Hessian
    """Second derivatives of the phase (yy, xx, xy), rad/px²."""

    def at(self, lattice: Lattice, rows: slice) -> tuple[Analytic, FloatMap, FloatMap]:
        """Phasor and frequencies along y and x at the pixels of some rows, (r, w)."""
        return blend(
            self.phasor, self.frequencies, self.hessian, lattice.pitch, lattice.shape, rows
        )


def measured_waves(lattice: Lattice, values: Analytic, threshold: float) -> LocalWaves:
    """The strongest waves of a field, measured twice.

    ``threshold`` is that of the coefficients which continue the field beyond its border, in units
    of a coefficient of a window of unit energy.
    """
    waves = _local_waves(lattice, lattice.extended(values, threshold))
    # With frequency and curvature known, the border can be continued more accurately.
    return _local_waves(lattice, _continued(lattice, values, waves))


def _local_waves(lattice: Lattice, padded: Analytic) -> LocalWaves:
    """Find the strongest waves and remove the window's factor from their coefficients."""
    coefficient, frequencies, offsets = _strongest_waves(lattice, padded)
    hessian = curvature(frequencies, lattice.pitch, lattice.sigma_px)
    # A window of unit energy turns an amplitude of 1 into 2σ√π.
    scale = 2.0 * lattice.sigma_px * np.sqrt(np.pi) * lattice.density
    factor = window_factor(offsets, hessian, lattice.sigma_px)
    return LocalWaves((coefficient / (scale * factor)).astype(np.complex64), frequencies, hessian)


def _continued(lattice: Lattice, field: Analytic, waves: LocalWaves) -> Analytic:
    """Add a border that continues the field by the waves some distance inside it."""
    padded = lattice.pad(field)
    h, w = lattice.shape
    sides = []
    for axis, side, pitch in zip((lattice.y, lattice.x), (h, w), lattice.pitch, strict=True):
        # The lattice is periodic: the second half of the border precedes the field.
        at = np.arange(axis.length)
        at = np.where(at >= (side + axis.length) / 2, at - axis.length, at)
        depth = min(CONTINUATION_DEPTH * lattice.sigma_px, 0.5 * (side - 1))
        node = np.round(np.clip(at, depth, side - 1 - depth) / pitch).astype(np.intp)
        node = np.minimum(node, int((side - 1) / pitch))
        sides.append((node, (at - node * pitch).astype(np.float32)))
    (node_y, dy), (node_x, dx) = sides
    wy, wx = waves.frequencies
    cyy, cxx, cxy = waves.hessian
    for rows, columns in ((slice(h, None), slice(None)), (slice(0, h), slice(w, None))):
        nodes = np.ix_(node_y[rows], node_x[columns])
        y, x = dy[rows][:, None], dx[columns][None, :]
        phase = wy[nodes] * y + wx[nodes] * x
        phase = phase + 0.5 * (cyy[nodes] * y * y + cxx[nodes] * x * x) + cxy[nodes] * y * x
        padded[rows, columns] = waves.phasor[nodes] * np.exp(1j * phase)
    return padded


def _strongest_waves(lattice: Lattice, padded: Analytic) -> tuple[Analytic, MapsYX, MapsYX]:
    """Find the largest coefficient at every lattice point.

    Returns the coefficient, the frequency of the peak, and the distance of the peak from the
    coefficient's own frequency, both along (y, x), rad/px.
    """
    # Undo the demodulation by whole bins, so that the phase is that of the lattice point.
    columns = np.stack([shift_wave(first, lattice.x.samples) for first in lattice.x.first])
    inside = lattice.inside
    stacks = []
    for first, spectra in zip(lattice.y.first, lattice.spectra(padded), strict=True):
        rows = shift_wave(first, lattice.y.samples)
        shifted = spectra * rows[None, :, None] * columns[:, None, :]
        stacks.append(shifted[:, : inside[0], : inside[1]])
    value, j, i, dj, di = strongest(np.stack(stacks))
    steps = [float(np.diff(axis.frequencies[:2])[0]) for axis in (lattice.y, lattice.x)]
    offsets = (dj * steps[0], di * steps[1])
    frequencies = (
        lattice.y.frequencies[j] + offsets[0],
        lattice.x.frequencies[i] + offsets[1],
    )
    return value, frequencies, offsets


def _check(
    field: NDArray[np.generic], sigma_px: float, limit: float, step: float
) -> tuple[Analytic, tuple[int, int]]:
    """Check field and options; return the field as complex64, and its shape."""
    values = unmasked(field, "field")
    if values.ndim != 2 or values.size == 0:
        raise InputError(f"field: expected shape (h, w) with a pixel or more, got {values.shape}")
    if values.dtype.kind not in "cfiu":
        raise InputError(f"field: expected numbers, got {values.dtype}")
    if not (np.abs(values) <= LARGEST).all():
        raise InputError(f"field: expected finite values up to {LARGEST:g}, got others")
    smallest, largest = SIGMA_LIMITS_PX
    if not smallest <= sigma_px <= largest:
        raise InputError(f"sigma_px: expected {smallest:g} to {largest:g} px, got {sigma_px}")
    if not (finite(limit) and 0 < limit <= np.pi):
        raise InputError(f"limit: expected above 0 and up to π rad/px, got {limit}")
    if not positive(step):
        raise InputError(f"step: expected > 0 rad/px, got {step}")
    h, w = values.shape
    return values.astype(np.complex64, copy=False), (h, w)


def _demodulated(
    values: Analytic, shape: tuple[int, int], centre: tuple[float, float]
) -> tuple[Analytic, Analytic]:
    """The field without the wave of frequency ``centre`` (x, y), cycles/px, and that wave."""
    if len(centre) != 2 or not finite(*centre):
        raise InputError(f"centre: expected two finite frequencies (x, y), got {centre}")
    if tuple(centre) == (0.0, 0.0):
        return values, np.ones((1, 1), np.complex64)
    y, x = np.arange(shape[0])[:, None], np.arange(shape[1])[None, :]
    wave = np.exp(2j * np.pi * (centre[0] * x + centre[1] * y)).astype(np.complex64)
    return np.asarray(values * np.conj(wave)), wave


def _noise(values: Analytic) -> float:
    """Standard deviation of the white complex noise in a field of smooth phase."""
    everywhere = np.ones(values.shape, bool)
    parts = (values.real, values.imag)
    variance = sum(noise_variance(part.astype(np.float64), everywhere) for part in parts)
    return float(np.sqrt(variance))


def windowed_fourier_filter(
    field: NDArray[np.generic],
    *,
    sigma_px: float = SIGMA_PX,
    limit: float = MAX_FREQUENCY_RAD,
    step: float = FREQUENCY_STEP_RAD,
    threshold: float | None = None,
    centre: tuple[float, float] = (0.0, 0.0),
) -> Analytic:
    """Filter a field (WFF): keep the coefficients of its windowed spectrum above a threshold.

    Parameters
    ----------
    field : (h, w) complex or real array
        Finite values. For real fringes ``centre`` is their carrier, and the result is the analytic
        signal; they need a mean near zero, and a carrier above ``limit``.
    sigma_px : float, 1 … 1000
        Width σ of the Gaussian window, px.
    limit : float, 0 … π
        Largest local frequency along each axis, relative to the centre, rad/px.
    step : float > 0
        Largest distance of the frequencies along each axis, rad/px.
    threshold : float, optional
        In units of a coefficient of a window of unit energy, whose noise equals that of a pixel; by
        default four standard deviations of the field's noise.
    centre : (fx, fy)
        Frequency at the centre of the band, cycles/px.

    Returns
    -------
    (h, w) complex64 array
        The phase is kept, the amplitude is reduced by the threshold.

    Raises
    ------
    InputError
        If the field or an option cannot be used.

    Notes
    -----
    Qian Kemao, Applied Optics 43(13):2695, 2004, doi:10.1364/AO.43.002695; Optics and Lasers in
    Engineering 45(2):304, 2007, doi:10.1016/j.optlaseng.2005.10.012; theory §5. The threshold is
    soft (Donoho): with a hard one, coefficients that flicker around it would add their noise again.
    The field is continued beyond its border (``Lattice.extended``).

    Examples
    --------
    >>> y, x = np.mgrid[:100, :100]
    >>> smooth = windowed_fourier_filter(np.exp(0.003j * (x - 50.0) ** 2), threshold=1.0)
    >>> error = np.angle(smooth * np.exp(-0.003j * (x - 50.0) ** 2))
    >>> bool(np.abs(error[20:80, 20:80]).max() < 0.02)
    True
    """
    values, shape = _check(field, sigma_px, limit, step)
    if threshold is not None and not (finite(threshold) and threshold >= 0):
        raise InputError(f"threshold: expected ≥ 0, got {threshold}")
    values, wave = _demodulated(values, shape, centre)
    cutoff = THRESHOLD_SIGMAS * _noise(values) if threshold is None else float(threshold)
    lattice = Lattice(shape, sigma_px, limit, step)
    smooth = lattice.filtered(lattice.extended(values, cutoff), cutoff)
    inside = smooth[: shape[0], : shape[1]]
    return np.ascontiguousarray(inside) if wave.size == 1 else np.asarray(inside * wave)


class Ridge(NamedTuple):
    """The strongest local wave at every pixel."""

    phasor: Analytic
    """(h, w) complex; phase and amplitude of the wave."""
    frequency_x: NDArray[np.float32]
    """Local frequency along x, (h, w), rad/px."""
    frequency_y: NDArray[np.float32]
    """Local frequency along y, (h, w), rad/px."""


def windowed_fourier_ridge(
    field: NDArray[np.generic],
    *,
    sigma_px: float = SIGMA_PX,
    limit: float = MAX_FREQUENCY_RAD,
    step: float = FREQUENCY_STEP_RAD,
    centre: tuple[float, float] = (0.0, 0.0),
) -> Ridge:
    """Find the windowed Fourier ridge (WFR): phase and frequency of the strongest local wave.

    Parameters
    ----------
    field, sigma_px, limit, step, centre
        As in ``windowed_fourier_filter``.

    Returns
    -------
    Ridge
        Named tuple (phasor, frequency_x, frequency_y).

    Raises
    ------
    InputError
        If the field or an option cannot be used.

    Notes
    -----
    Qian Kemao (see ``windowed_fourier_filter``); theory §5. The coefficient of a quadratic phase
    with Hessian C, at a distance δ from its frequency, is

        A exp(iφ) · det(I − iσ²C)^(−1/2) · exp(−½σ² δᵀ(I − iσ²C)⁻¹δ).

    For a diagonal C on the ridge that is a bias of ½·atan(σ²c) per axis. δ is measured with a
    parabola through the logarithms of neighbouring frequencies, C from the smoothed slope of the
    frequency, and the factor is divided out. The local waves of the lattice are then interpolated
    to all pixels (``ridge.blend``).

    Examples
    --------
    >>> y, x = np.mgrid[:80, :80]
    >>> ridge = windowed_fourier_ridge(2.0 * np.exp(0.1j * x))
    >>> round(float(abs(ridge.phasor[40, 40])), 2), round(float(ridge.frequency_x[40, 40]), 3)
    (2.0, 0.1)
    """
    values, shape = _check(field, sigma_px, limit, step)
    values, wave = _demodulated(values, shape, centre)
    lattice = Lattice(shape, sigma_px, limit, step)
    waves = measured_waves(lattice, values, THRESHOLD_SIGMAS * _noise(values))
    phasor = np.empty(shape, np.complex64)
    frequency_x, frequency_y = np.empty(shape, np.float32), np.empty(shape, np.float32)
    turn = 2.0 * np.pi
    for band in row_bands(shape, bytes_per_px=64):
        rows = band.rows
        value, fy, fx = waves.at(lattice, rows)
        phasor[rows] = value * (wave if wave.size == 1 else wave[rows])
        frequency_x[rows] = fx + turn * centre[0]
        frequency_y[rows] = fy + turn * centre[1]
    return Ridge(phasor, frequency_x, frequency_y)


def _relative(pair: PreparedPair) -> tuple[Analytic, NDArray[np.float32], float]:
    """The object's analytic signal relative to the phase of the reference, the reference's
    amplitude B/2, and the share of the noise's variance in a signal."""
    reference, object_ = (
        pass_band(frame, pair.frequency) for frame in (pair.reference, pair.object)
    )
    smallest = np.float32(MIN_REFERENCE_SHARE * pair.modulation)
    field = np.empty(pair.object.shape, np.complex64)
    amplitude = np.empty(pair.object.shape, np.float32)
    for band in row_bands(field.shape, bytes_per_px=48):
        rows = reference.rows(band.rows)
        np.abs(rows, out=amplitude[band.rows])
        rows *= np.conj(object_.rows(band.rows))
        rows /= np.maximum(amplitude[band.rows], smallest)
        field[band.rows] = rows
    return field, amplitude, reference.share


def _ridge(
    field: Analytic, sigma_px: float, limit: float, step: float
) -> Callable[[slice], Analytic]:
    """Function that returns the ridge's phasor in some rows."""
    values, shape = _check(field, sigma_px, limit, step)
    lattice = Lattice(shape, sigma_px, limit, step)
    waves = measured_waves(lattice, values, THRESHOLD_SIGMAS * _noise(values))
    return lambda rows: waves.at(lattice, rows)[0]


def _polar(
    shape: tuple[int, ...], rows_of: Callable[[slice], Analytic]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Phase, rad, and amplitude of a field, (h, w), a band of rows at a time."""
    phase, amplitude = np.empty(shape, np.float32), np.empty(shape, np.float32)
    for band in row_bands(shape, bytes_per_px=64):
        phasor = rows_of(band.rows)
        phase[band.rows] = np.angle(phasor)
        np.abs(phasor, out=amplitude[band.rows])
    return phase, amplitude


@method("windowed_fourier")
def windowed_fourier(
    pair: PreparedPair,
    *,
    algorithm: Literal["ridge", "filter"] = "ridge",
    sigma_px: float = SIGMA_PX,
) -> Solution:
    """Takes the phase difference from the ridge of its windowed Fourier spectrum, or filters it.

    Parameters
    ----------
    pair : PreparedPair
    algorithm : "ridge" or "filter"
        "ridge" (WFR) follows the strongest local wave and corrects for the phase's curvature;
        "filter" (WFF) keeps all coefficients above the noise, also where the phase is no single
        wave.
    sigma_px : float, 1 … 1000
        Width σ of the Gaussian window, px.

    Returns
    -------
    Solution

    Raises
    ------
    InputError
        If an option is out of its range.

    Notes
    -----
    Qian Kemao 2004, 2007 (see ``windowed_fourier_filter``); theory §5. Both frames pass the
    carrier's band (as in ``fourier``). The product reference · conj(object) has the phase φ, and
    its frequencies lie around zero for every period.
    """
    if algorithm not in ("ridge", "filter"):
        raise InputError(f"algorithm: expected ridge or filter, got {algorithm!r}")
    field, amplitude, share = _relative(pair)
    # The band-pass leaves no frequencies beyond its half-width.
    limit = min(MAX_FREQUENCY_RAD, HALF_WIDTH * 2.0 * np.pi * float(np.hypot(*pair.frequency)))
    step = min(FREQUENCY_STEP_RAD, 1.0 / sigma_px)
    if algorithm == "ridge":
        rows_of = _ridge(field, sigma_px, limit, step)
    else:
        noise = THRESHOLD_SIGMAS * float(np.sqrt(sum(pair.noise)))
        rows_of = windowed_fourier_filter(
            field, sigma_px=sigma_px, limit=limit, step=step, threshold=noise
        ).__getitem__
    del field
    wrapped, object_amplitude = _polar(pair.object.shape, rows_of)
    amplitude *= 2.0
    object_amplitude *= 2.0
    smoothing = [Smoothing(band_kernel(pair.frequency, HALF_WIDTH, 2))]
    if algorithm == "ridge":
        mean = CURVATURE_SMOOTHING * sigma_px
        smoothing.append(Smoothing((sigma_px, sigma_px), (mean, mean)))
    return to_displacement(
        pair,
        Demodulated(
            wrapped=wrapped,
            reference_amplitude=amplitude,
            object_amplitude=object_amplitude,
            noise_share=min(share, 1.0 / (4.0 * np.pi * sigma_px**2)),
            noise_length_px=(NOISE_LENGTH * sigma_px, NOISE_LENGTH * sigma_px),
            smoothing=tuple(smoothing),
            details={"sigma_px": sigma_px, "algorithm": algorithm},
        ),
    )
