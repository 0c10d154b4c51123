"""Windowed Fourier analysis: filtering by threshold (WFF) and the ridge (WFR) (theory §5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fringeworks.pair.bandpass import WIDTH, Analytic, band_pass
from fringeworks.pair.demodulation import Demodulated, to_displacement
from fringeworks.pair.lattice import Lattice, shift_wave
from fringeworks.pair.prepared import PreparedPair
from fringeworks.pair.registry import Solution, method
from fringeworks.pair.ridge import Pair, blend, curvature, strongest, window_factor
from fringeworks.signal.noise import noise_variance
from fringeworks.types import FloatMap, InputError

SIGMA_PX = 10.0
"""Classic width of the window, px."""
LIMIT = 0.5
"""Largest local frequency, rad/px."""
STEP = 0.1
"""Spacing of the frequencies, rad/px; 1/σ loses nothing."""
THRESHOLD = 4.0
"""Coefficients below this many standard deviations of their noise are noise."""
INSIDE = 2.0
"""How far inside the field the waves are taken that continue it, σ."""


def _check(
    field: NDArray[np.generic], sigma_px: float, limit: float, step: float
) -> tuple[Analytic, tuple[int, int]]:
    values = np.asarray(field)
    if values.ndim != 2:
        raise InputError(f"field: expected shape (h, w), got {values.shape}")
    if values.dtype.kind not in "cfiu":
        raise InputError(f"field: expected numbers, got {values.dtype}")
    if not np.isfinite(values).all():
        raise InputError("field: expected finite values, got NaN or infinity")
    if not 1.0 <= sigma_px <= 1e3:
        raise InputError(f"sigma_px: expected 1 to 1000 px, got {sigma_px}")
    if not 0 < limit <= np.pi:
        raise InputError(f"limit: expected 0 to π rad/px, got {limit}")
    if not step > 0:
        raise InputError(f"step: expected > 0 rad/px, got {step}")
    h, w = values.shape
    return values.astype(np.complex64), (h, w)


def _centred(
    values: Analytic, shape: tuple[int, int], centre: tuple[float, float]
) -> tuple[Analytic, Analytic]:
    """The field with frequencies counted from a centre (cycles/px), and the wave taken off."""
    if centre == (0.0, 0.0):
        return values, np.ones((1, 1), np.complex64)
    y, x = np.arange(shape[0])[:, None], np.arange(shape[1])[None, :]
    wave = np.exp(2j * np.pi * (centre[0] * x + centre[1] * y)).astype(np.complex64)
    return np.asarray(values * np.conj(wave)), wave


def _noise(values: Analytic) -> float:
    """Standard deviation of white complex noise in a field of smooth phase."""
    everywhere = np.ones(values.shape, bool)
    parts = (values.real, values.imag)
    variance = sum(noise_variance(part.astype(np.float64), everywhere) for part in parts)
    return float(np.sqrt(variance))


def windowed_fourier_filter(
    field: NDArray[np.generic],
    *,
    sigma_px: float = SIGMA_PX,
    limit: float = LIMIT,
    step: float = STEP,
    threshold: float | None = None,
    centre: tuple[float, float] = (0.0, 0.0),
) -> Analytic:
    """Windowed Fourier filtering (WFF): keep the local spectrum's coefficients that stand out.

    Parameters
    ----------
    field : (h, w) complex or real array
        A complex field, or fringes: then ``centre`` is their carrier, and the result the analytic
        signal. Real fringes need a mean near zero, and a carrier above ``limit``.
    sigma_px : float, 1 … 1000
        Width of the Gaussian window, px.
    limit, step : float, rad/px
        Local frequencies from −limit to limit around the centre, that far apart along each axis.
    threshold : float, optional
        In units of a coefficient with a window of unit energy, whose noise is that of a pixel;
        four standard deviations of the field's noise by default.
    centre : (fx, fy), cycles/px

    Returns
    -------
    (h, w) complex64 array, amplitude lessened by the threshold, phase kept.

    Raises
    ------
    InputError for a field or option that cannot be used.

    Notes
    -----
    Qian Kemao, Applied Optics 43(13):2695, 2004; Optics and Lasers in Engineering 45(2):304,
    2007. Soft threshold (Donoho), because coefficients that flicker around a hard one put their
    noise back; the border continues the field.

    Examples
    --------
    >>> y, x = np.mgrid[:100, :100]
    >>> smooth = windowed_fourier_filter(np.exp(0.003j * (x - 50.0) ** 2), threshold=1.0)
    >>> error = np.angle(smooth * np.exp(-0.003j * (x - 50.0) ** 2))
    >>> bool(np.abs(error[20:80, 20:80]).max() < 0.02)
    True
    """
    values, shape = _check(field, sigma_px, limit, step)
    values, wave = _centred(values, shape, centre)
    level = THRESHOLD * _noise(values) if threshold is None else float(threshold)
    lattice = Lattice(shape, sigma_px, limit, step)
    smooth = lattice.filtered(lattice.extended(values, level), level)
    return np.asarray(smooth[: shape[0], : shape[1]] * wave)


class Ridge(NamedTuple):
    """The strongest local wave of every pixel."""

    phasor: Analytic
    """(h, w) complex; argument and amplitude of the wave at the pixel."""
    frequency_x: NDArray[np.float32]
    """Local frequency along the columns, (h, w), rad/px."""
    frequency_y: NDArray[np.float32]
    """… and along the rows."""


def windowed_fourier_ridge(
    field: NDArray[np.generic],
    *,
    sigma_px: float = SIGMA_PX,
    limit: float = LIMIT,
    step: float = STEP,
    centre: tuple[float, float] = (0.0, 0.0),
) -> Ridge:
    """Windowed Fourier ridges (WFR): phase and frequency of the strongest local wave.

    Parameters
    ----------
    field, sigma_px, limit, step, centre : as in ``windowed_fourier_filter``

    Returns
    -------
    Ridge (phasor, frequency_x, frequency_y)

    Raises
    ------
    InputError for a field or option that cannot be used.

    Notes
    -----
    Qian Kemao (see ``windowed_fourier_filter``). The coefficient of a quadratic phase with Hessian
    C, taken at a frequency δ off, is

        A exp(iφ) · det(I − iσ²C)^(−1/2) · exp(−½σ² δᵀ(I − iσ²C)⁻¹δ):

    for a diagonal C on the ridge a bias of ½·atan(σ²c) per axis. δ comes from the parabola through
    the neighbouring frequencies' logarithms, C from the smoothed slope of the frequency, and the
    factor is divided out. The lattice's local waves, each extended by its frequency and
    curvature, are blended bilinearly.
    """
    values, shape = _check(field, sigma_px, limit, step)
    values, wave = _centred(values, shape, centre)
    lattice = Lattice(shape, sigma_px, limit, step)
    waves = _local_waves(lattice, lattice.extended(values, THRESHOLD * _noise(values)))
    # Now that frequency and curvature are known, the border can be continued by them.
    waves = _local_waves(lattice, _continued(lattice, values, waves))
    phasor, fy, fx = blend(waves.phasor, waves.frequencies, waves.bends, lattice.pitch, shape)
    turn = 2.0 * np.pi
    return Ridge(
        np.asarray(phasor * wave),
        (fx + turn * centre[0]).astype(np.float32),
        (fy + turn * centre[1]).astype(np.float32),
    )


@dataclass(frozen=True)
class _Waves:
    """The strongest wave at every point of the lattice that lies on the field."""

    phasor: Analytic
    frequencies: Pair  # rad/px along (y, x)
    bends: tuple[FloatMap, FloatMap, FloatMap]  # second derivatives (yy, xx, xy), rad/px²


def _local_waves(lattice: Lattice, padded: Analytic) -> _Waves:
    coefficient, frequencies, offsets = _strongest(lattice, padded)
    bends = curvature(frequencies, lattice.pitch, lattice.sigma_px)
    # A window of unit energy makes 2σ√π of an amplitude of 1.
    scale = 2.0 * lattice.sigma_px * np.sqrt(np.pi) * lattice.density
    factor = window_factor(offsets, bends, lattice.sigma_px)
    return _Waves((coefficient / (scale * factor)).astype(np.complex64), frequencies, bends)


def _continued(lattice: Lattice, field: Analytic, waves: _Waves) -> Analytic:
    """The field with a border of the waves that lie some way inside it."""
    padded = lattice.pad(field)
    h, w = lattice.shape
    sides = []
    for axis, side, pitch in zip((lattice.y, lattice.x), (h, w), lattice.pitch, strict=True):
        # The second half of the border lies before the field.
        at = np.arange(axis.length)
        at = np.where(at >= (side + axis.length) / 2, at - axis.length, at)
        depth = min(INSIDE * lattice.sigma_px, 0.5 * (side - 1))
        node = np.round(np.clip(at, depth, side - 1 - depth) / pitch).astype(np.intp)
        node = np.minimum(node, int((side - 1) / pitch))
        sides.append((node, (at - node * pitch).astype(np.float32)))
    (node_y, dy), (node_x, dx) = sides
    wy, wx = waves.frequencies
    cyy, cxx, cxy = waves.bends
    for rows, columns in ((slice(h, None), slice(None)), (slice(0, h), slice(w, None))):
        nodes = np.ix_(node_y[rows], node_x[columns])
        y, x = dy[rows][:, None], dx[columns][None, :]
        phase = wy[nodes] * y + wx[nodes] * x
        phase = phase + 0.5 * (cyy[nodes] * y * y + cxx[nodes] * x * x) + cxy[nodes] * y * x
        padded[rows, columns] = waves.phasor[nodes] * np.exp(1j * phase)
    return padded


def _strongest(lattice: Lattice, padded: Analytic) -> tuple[Analytic, Pair, Pair]:
    """On the lattice: the largest coefficient at its place, its frequency, and how far that lies
    from the coefficient's own, along (y, x)."""
    # Undo the shift by whole bins, so that the phase is that of the place.
    columns = np.stack([shift_wave(first, lattice.x.samples) for first in lattice.x.first])
    inside = lattice.inside
    stacks = []
    for first, spectra in zip(lattice.y.first, lattice.spectra(padded), strict=True):
        rows = shift_wave(first, lattice.y.samples)
        turned = spectra * rows[None, :, None] * columns[:, None, :]
        stacks.append(turned[:, : inside[0], : inside[1]])
    value, j, i, dj, di = strongest(np.stack(stacks))
    steps = [float(np.diff(axis.frequencies[:2])[0]) for axis in (lattice.y, lattice.x)]
    offsets = (dj * steps[0], di * steps[1])
    frequencies = (
        lattice.y.frequencies[j] + offsets[0],
        lattice.x.frequencies[i] + offsets[1],
    )
    return value, frequencies, offsets


@method("windowed_fourier")
def windowed_fourier(
    pair: PreparedPair,
    *,
    algorithm: Literal["ridge", "filter"] = "ridge",
    sigma_px: float = SIGMA_PX,
) -> Solution:
    """Windowed Fourier analysis of the phase difference: its ridge, or filtered by threshold.

    Parameters
    ----------
    pair : PreparedPair
    algorithm : "ridge" or "filter"
        WFR follows the strongest local wave and corrects for the phase's curvature; WFF keeps all
        that stands out, which also serves where the phase is no single wave.
    sigma_px : float, 1 … 1000
        Width of the Gaussian window, px.

    Notes
    -----
    Both frames pass the carrier's band (as in ``fourier``); what is analysed is the product
    reference · conj(object), whose phase is φ and whose frequencies lie around zero, whatever the
    period. Qian Kemao 2004, 2007; theory §5.
    """
    if algorithm not in ("ridge", "filter"):
        raise InputError(f"algorithm: expected ridge or filter, got {algorithm!r}")
    (reference, share), (object_, _) = (
        band_pass(frame, pair.frequency) for frame in (pair.reference, pair.object)
    )
    strength = np.abs(reference)
    floor = np.float32(0.02 * pair.modulation)
    field = reference * np.conj(object_) / np.maximum(strength, floor)
    # Beyond the band there is nothing to look for.
    limit = min(LIMIT, WIDTH * 2.0 * np.pi * float(np.hypot(*pair.frequency)))
    step = min(STEP, 1.0 / sigma_px)
    if algorithm == "ridge":
        phasor = windowed_fourier_ridge(field, sigma_px=sigma_px, limit=limit, step=step).phasor
    else:
        # Noise of both frames, of which the band lets pass what the frequencies can tell apart.
        noise = THRESHOLD * float(np.sqrt(sum(pair.noise)))
        phasor = windowed_fourier_filter(
            field, sigma_px=sigma_px, limit=limit, step=step, threshold=noise
        )
    return to_displacement(
        pair,
        Demodulated(
            phasor=phasor,
            reference_amplitude=2.0 * strength,
            object_amplitude=2.0 * np.abs(phasor),
            noise_share=min(share, 1.0 / (4.0 * np.pi * sigma_px**2)),
            details={"sigma_px": sigma_px, "algorithm": algorithm},
        ),
    )
