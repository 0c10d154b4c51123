"""Windowed Fourier analysis: filtering by threshold (WFF) and the ridge (WFR) (theory §5).

A windowed spectrum varies slowly in space: with a window of σ px its bandwidth is a few times
1/σ, so that it is fully known on a lattice some σ/2 apart. All coefficients are therefore
computed, thresholded and summed on that lattice, by transforms of a few per cent of the frame's
size; nothing is lost but single precision's rounding.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from fringeworks.analysis.bandpass import WIDTH, Analytic, band_pass
from fringeworks.analysis.demodulation import Demodulated, to_displacement
from fringeworks.analysis.pair import FringePair, noise_variance
from fringeworks.analysis.registry import Solution, method
from fringeworks.types import FloatMap, InputError

SIGMA_PX = 10.0
"""Classic width of the window, px."""
LIMIT = 0.5
"""Largest local frequency, rad/px."""
STEP = 0.1
"""Spacing of the frequencies, rad/px; 1/σ loses nothing."""
THRESHOLD = 4.0
"""Coefficients below this many standard deviations of their noise are noise."""
BANDWIDTH = 4.5
"""Half the band that a window needs, 1/σ: beyond, its spectrum is below 10⁻⁴."""
MARGIN = 3.0
"""Width of the border that is added around the field, σ."""
WIDER = 1.0
"""How much further the frequencies of the border reach, 1/σ."""
RIM = 2.0
"""Width of the border whose curvature is not believed, σ."""
CURVATURE_SMOOTHING = 3.0
"""Width over which the ridge's curvature is averaged, σ."""


@dataclass(frozen=True)
class _Axis:
    """One axis of the lattice: its length, its samples, and the window at each frequency."""

    length: int
    samples: int
    frequencies: FloatMap  # rad/px
    first: NDArray[np.intp]  # (frequencies,) signed bin of the first sample
    bins: NDArray[np.intp]  # (frequencies, samples) places in the spectrum
    windows: NDArray[np.float32]  # (frequencies, samples)


def _axis(length: int, sigma_px: float, limit: float, step: float) -> _Axis:
    """The lattice of one axis; the window has unit energy."""
    steps = max(1, int(np.ceil(limit / step - 1e-9)))
    frequencies = np.linspace(-limit, limit, 2 * steps + 1)
    wanted = int(np.ceil(BANDWIDTH / sigma_px * length / np.pi))
    samples = min(fft.next_fast_len(wanted), length)
    first = np.round(frequencies * length / (2.0 * np.pi)).astype(np.intp) - samples // 2
    bins = first[:, None] + np.arange(samples)
    distance = 2.0 * np.pi * bins / length - frequencies[:, None]
    windows = np.sqrt(2.0 * sigma_px * np.sqrt(np.pi)) * np.exp(-0.5 * (sigma_px * distance) ** 2)
    return _Axis(length, samples, frequencies, first, bins % length, windows.astype(np.float32))


class _Lattice:
    """Windowed spectra of a field of one shape."""

    def __init__(self, shape: tuple[int, int], sigma_px: float, limit: float, step: float) -> None:
        margin = int(np.ceil(MARGIN * sigma_px))
        self.shape = shape
        self.sigma_px, self.limit, self.step = sigma_px, limit, step
        self.y, self.x = (
            _axis(fft.next_fast_len(side + 2 * margin), sigma_px, limit, step) for side in shape
        )
        self.density = self.y.length * self.x.length / (self.y.samples * self.x.samples)

    def spectra(self, padded: Analytic) -> Iterator[tuple[int, Analytic]]:
        """For every frequency along y, the coefficients (frequencies along x, samples, samples).

        They are demodulated by the bin of their first sample, and ``density`` times too large.
        """
        spectrum = fft.fft2(padded, workers=-1)
        for k, (rows, window) in enumerate(zip(self.y.bins, self.y.windows, strict=True)):
            part = spectrum[rows] * window[:, None]
            stack = part[:, self.x.bins].transpose(1, 0, 2) * self.x.windows[:, None, :]
            yield k, fft.ifft2(stack, axes=(1, 2), overwrite_x=True, workers=-1)

    def pad(self, field: Analytic) -> Analytic:
        """The field with a border of zeros, to the right and below (periodic)."""
        padded = np.zeros((self.y.length, self.x.length), np.complex64)
        padded[: self.shape[0], : self.shape[1]] = field
        return padded

    def filtered(self, padded: Analytic, threshold: float) -> tuple[Analytic, float]:
        """Sum of the coefficients that stand out, and the mean number of them per sample."""
        out = np.zeros_like(padded)
        kept = 0
        limit = np.float32(max(threshold * self.density, 1e-15))
        for k, spectra in self.spectra(padded):
            power = spectra.real**2 + spectra.imag**2
            kept += int(np.count_nonzero(power > limit**2))
            # What is noise in a coefficient that stands out is taken off it as well.
            shrink = 1 - limit / np.sqrt(np.maximum(power, limit**2), out=power)
            spectra = fft.fft2(spectra * shrink, axes=(1, 2), overwrite_x=True, workers=-1)
            rows = np.zeros((self.y.samples, self.x.length), np.complex64)
            for j, part in enumerate(spectra):
                rows[:, self.x.bins[j]] += part * self.x.windows[j]
            out[self.y.bins[k]] += rows * self.y.windows[k][:, None]
        steps = (float(np.diff(axis.frequencies[:2])[0]) for axis in (self.y, self.x))
        scale = np.float32(np.prod(list(steps)) / (2.0 * np.pi) ** 2)
        result = fft.ifft2(out, overwrite_x=True, workers=-1) * scale
        return np.asarray(result), kept / (self.y.samples * self.x.samples)

    def extended(self, field: Analytic, threshold: float) -> Analytic:
        """The field with a border that continues it, as its own filtered version does.

        A window at the border then sees what it would see inside (Gerchberg's extrapolation, one
        step), where a border of zeros would pull the phase towards the inside.
        """
        # What continues a chirp has higher frequencies than the field itself.
        wider = min(self.limit + WIDER / self.sigma_px, np.pi)
        lattice = _Lattice(self.shape, self.sigma_px, wider, self.step)
        smooth, _ = lattice.filtered(self.pad(field), threshold)
        size = np.abs(smooth)
        h, w = self.shape
        usual = float(np.median(size[:h, :w]))
        if usual > 0:
            smooth *= usual / np.maximum(size, np.float32(0.02 * usual))
        smooth[:h, :w] = field
        return smooth


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
    parts = (noise_variance(part.astype(np.float64), everywhere) for part in _parts(values))
    return float(np.sqrt(sum(parts)))


def _parts(values: Analytic) -> tuple[FloatMap, FloatMap]:
    return values.real, values.imag


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
    lattice = _Lattice(shape, sigma_px, limit, step)
    smooth, _ = lattice.filtered(lattice.extended(values, level), level)
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
    lattice = _Lattice(shape, sigma_px, limit, step)
    padded = lattice.extended(values, THRESHOLD * _noise(values))
    coefficient, frequencies, offsets = _strongest(lattice, padded)
    pitch = (lattice.y.length / lattice.y.samples, lattice.x.length / lattice.x.samples)
    inside = tuple(
        min(samples, int(np.ceil((side - 1) / p)) + 1)
        for samples, side, p in zip(coefficient.shape, shape, pitch, strict=True)
    )
    window = (slice(inside[0]), slice(inside[1]))
    bends = _curvature(frequencies, pitch, window, CURVATURE_SMOOTHING * sigma_px, RIM * sigma_px)
    # A window of unit energy makes 2σ√π of an amplitude of 1.
    scale = 2.0 * sigma_px * np.sqrt(np.pi) * lattice.density
    factor = _window_factor(tuple(o[window] for o in offsets), bends, sigma_px)
    local = (coefficient[window] / (scale * factor)).astype(np.complex64)
    wy, wx = (f[window] for f in frequencies)
    phasor, fy, fx = _blend(local, (wy, wx), bends, pitch, shape)
    turn = 2.0 * np.pi
    return Ridge(
        np.asarray(phasor * wave),
        (fx + turn * centre[0]).astype(np.float32),
        (fy + turn * centre[1]).astype(np.float32),
    )


Pair = tuple[FloatMap, FloatMap]


def _strongest(lattice: _Lattice, padded: Analytic) -> tuple[Analytic, Pair, Pair]:
    """On the lattice: the largest coefficient at its place, its frequency, and how far that lies
    from the coefficient's own, along (y, x)."""
    stacks = []
    for k, spectra in lattice.spectra(padded):
        # Undo the shift by whole bins, so that the phase is that of the place.
        rows = _shift(lattice.y, k)
        columns = np.stack([_shift(lattice.x, j) for j in range(len(lattice.x.frequencies))])
        stacks.append(spectra * rows[None, :, None] * columns[:, None, :])
    coefficients = np.stack(stacks)
    power = np.log(np.abs(coefficients) + np.float32(1e-30))
    ny, nx, h, w = power.shape
    best = power.reshape(ny * nx, h, w).argmax(axis=0)
    j, i = best // nx, best % nx
    rows, columns = np.ogrid[:h, :w]
    steps = [float(np.diff(axis.frequencies[:2])[0]) for axis in (lattice.y, lattice.x)]

    def vertex(before: FloatMap, here: FloatMap, after: FloatMap) -> FloatMap:
        bend = np.minimum(before - 2.0 * here + after, -1e-6)
        return np.asarray(np.clip(0.5 * (before - after) / bend, -1.0, 1.0))

    # At the end of the range the parabola is that of the last three frequencies.
    jc, ic = np.clip(j, 1, ny - 2), np.clip(i, 1, nx - 2)
    dy = vertex(*(power[jc + k, i, rows, columns] for k in (-1, 0, 1))) + jc - j
    dx = vertex(*(power[j, ic + k, rows, columns] for k in (-1, 0, 1))) + ic - i
    offsets = (dy * steps[0], dx * steps[1])
    frequencies = (
        lattice.y.frequencies[j] + offsets[0],
        lattice.x.frequencies[i] + offsets[1],
    )
    return np.asarray(coefficients[j, i, rows, columns]), frequencies, offsets


def _shift(axis: _Axis, k: int) -> Analytic:
    """Wave of the bin that the samples of frequency ``k`` were demodulated by."""
    turns = axis.first[k] * np.arange(axis.samples) / axis.samples
    return np.asarray(np.exp(2j * np.pi * turns), dtype=np.complex64)


def _curvature(
    frequencies: Pair,
    pitch: tuple[float, ...],
    window: tuple[slice, ...],
    width_px: float,
    rim_px: float,
) -> tuple[FloatMap, FloatMap, FloatMap]:
    """Second derivatives (yy, xx, xy) of the phase, smoothed; rad/px²."""
    wy, wx = (f[window] for f in frequencies)
    widths = [width_px / p for p in pitch]
    # At the border the continued field bends as it likes: the inside speaks for it.
    weight = np.ones(wy.shape)
    for axis, p in enumerate(pitch):
        rim = int(np.ceil(rim_px / p))
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


def _window_factor(
    offsets: tuple[FloatMap, ...], bends: tuple[FloatMap, ...], sigma_px: float
) -> NDArray[np.complexfloating]:
    """What the window makes of a quadratic phase of amplitude 1, relative to a straight one."""
    s2 = sigma_px**2
    (dy, dx), (cyy, cxx, cxy) = offsets, bends
    a, d, b = 1.0 - 1j * s2 * cyy, 1.0 - 1j * s2 * cxx, -1j * s2 * cxy
    det = a * d - b * b
    form = (d * dy * dy - 2.0 * b * dy * dx + a * dx * dx) / det
    return np.asarray(np.exp(-0.5 * s2 * form) / np.sqrt(det))


def _blend(
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


@method("windowed_fourier")
def windowed_fourier(
    pair: FringePair,
    *,
    algorithm: Literal["ridge", "filter"] = "ridge",
    sigma_px: float = SIGMA_PX,
) -> Solution:
    """Windowed Fourier analysis of the phase difference: its ridge, or filtered by threshold.

    Parameters
    ----------
    pair : FringePair
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
