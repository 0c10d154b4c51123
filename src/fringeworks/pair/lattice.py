"""Windowed Fourier spectra on a lattice that is coarser than the frame.

A windowed spectrum varies slowly in space: with a window of σ px its bandwidth is a few times 1/σ.
Samples about 0.7 σ apart therefore hold all of it, except for the part of the window's spectrum
that is below 10⁻⁴. All coefficients are computed, thresholded and summed on that lattice, with
transforms of a few per cent of the frame's size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.pair.bandpass import Analytic
from fringeworks.types import FloatMap

BANDWIDTH = 4.5
"""Half the bandwidth that is kept of a window's spectrum, 1/σ.

Beyond it the Gaussian spectrum exp(−½ (σω)²) is below 10⁻⁴ of its maximum.
"""
MARGIN = 3.0
"""Width of the border that is added around the field, σ.

A window at the field's end has 99.7 % of its weight within it.
"""
CONTINUED_SHARE = 0.2
"""Smallest coefficient that continues the field into the border, as a share of a plain wave's.

All coefficients together would reproduce the field's abrupt end; the strong ones continue its
waves. An empirical choice.
"""
EXTRA_BANDWIDTH = 1.0
"""How much further than those of the field the frequencies of the border reach, 1/σ.

The continuation of a chirp has higher frequencies than the field itself. An empirical choice.
"""
MIN_BORDER_SHARE = 0.02
"""Smallest amplitude in the border that is scaled up to the field's, as a share of its median.

Weaker values are mostly noise; scaled in full, they would act like signal. An empirical choice.
"""
SMALLEST_THRESHOLD = 1e-15
"""Lower bound of a threshold, in units of a coefficient; it avoids 0 / 0 where there is none."""
ROUNDING = 1e-9
"""Excess over a whole number of frequency steps that is taken for rounding, steps."""


@dataclass(frozen=True, eq=False)
class LatticeAxis:
    """One axis of the lattice: its samples, its frequencies, and the window at each of them."""

    length: int
    """Side of the padded field, px."""
    samples: int
    """Samples of the lattice along that side."""
    frequencies: FloatMap
    """(n,), rad/px."""
    first: NDArray[np.intp]
    """(n,) signed bin of the padded field's spectrum at which each frequency's samples start."""
    bins: NDArray[np.intp]
    """(n, samples) bins of the spectrum, 0 … length − 1."""
    windows: NDArray[np.float32]
    """(n, samples) spectrum of the window, of unit energy, at these bins."""


def lattice_samples(length: int, sigma_px: float) -> int:
    """Number of samples along ``length`` px that hold what a window of σ = ``sigma_px`` yields."""
    required = int(np.ceil(BANDWIDTH / sigma_px * length / np.pi))
    return min(int(scipy.fft.next_fast_len(required)), length)


def samples_inside(samples: int, side: int, pitch: float) -> int:
    """Number of samples that lie on a field of ``side`` px, plus the next one.

    ``pitch`` is the distance of the samples in px, ``samples`` their number along the axis.
    """
    return min(samples, int(np.ceil((side - 1) / pitch)) + 1)


def shift_wave(first: int, samples: int) -> Analytic:
    """Wave by which samples are demodulated whose spectrum starts at bin ``first``; (samples,)."""
    turns = first * np.arange(samples) / samples
    return np.asarray(np.exp(2j * np.pi * turns), dtype=np.complex64)


def _axis(length: int, sigma_px: float, limit: float, step: float) -> LatticeAxis:
    """Build one axis with frequencies from −limit to limit, at most ``step`` apart, rad/px."""
    steps = max(1, int(np.ceil(limit / step - ROUNDING)))
    frequencies = np.linspace(-limit, limit, 2 * steps + 1)
    samples = lattice_samples(length, sigma_px)
    first = np.round(frequencies * length / (2.0 * np.pi)).astype(np.intp) - samples // 2
    bins = first[:, None] + np.arange(samples)
    distance = 2.0 * np.pi * bins / length - frequencies[:, None]
    windows = np.sqrt(2.0 * sigma_px * np.sqrt(np.pi)) * np.exp(-0.5 * (sigma_px * distance) ** 2)
    return LatticeAxis(
        length, samples, frequencies, first, bins % length, windows.astype(np.float32)
    )


class Lattice:
    """Windowed Fourier spectra of fields of one shape.

    Parameters
    ----------
    shape : (h, w)
        Shape of the field, px.
    sigma_px : float
        Width σ of the Gaussian window, px.
    limit, step : float
        Largest frequency, and largest distance of the frequencies along each axis, rad/px.
    """

    def __init__(self, shape: tuple[int, int], sigma_px: float, limit: float, step: float) -> None:
        margin = int(np.ceil(MARGIN * sigma_px))
        self.shape = shape
        self.sigma_px, self.limit, self.step = sigma_px, limit, step
        self.y, self.x = (
            _axis(scipy.fft.next_fast_len(side + 2 * margin), sigma_px, limit, step)
            for side in shape
        )
        self.pitch = (self.y.length / self.y.samples, self.x.length / self.x.samples)
        """Distance of the lattice points along y and x, px."""
        self.inside = tuple(
            samples_inside(axis.samples, side, pitch)
            for axis, side, pitch in zip((self.y, self.x), shape, self.pitch, strict=True)
        )
        """Number of lattice points on the field along y and x, plus the next ones."""
        self.density = self.y.length * self.x.length / (self.y.samples * self.x.samples)
        """Pixels per lattice point."""

    def spectra(self, padded: Analytic) -> Iterator[Analytic]:
        """Yield, for every frequency along y, the coefficients at all frequencies along x.

        Each item has the shape (frequencies along x, samples along y, samples along x). The
        coefficients are demodulated by the bin of their first sample (``shift_wave``), and are
        ``density`` times as large as those of a window of unit energy. The field is overwritten.
        """
        spectrum = scipy.fft.fft2(padded, overwrite_x=True, workers=-1)
        for rows, window in zip(self.y.bins, self.y.windows, strict=True):
            part = spectrum[rows] * window[:, None]
            stack = part[:, self.x.bins].transpose(1, 0, 2) * self.x.windows[:, None, :]
            yield scipy.fft.ifft2(stack, axes=(1, 2), overwrite_x=True, workers=-1)

    def pad(self, field: Analytic) -> Analytic:
        """Add a border of zeros to the right and below; the lattice is periodic."""
        padded = np.zeros((self.y.length, self.x.length), np.complex64)
        padded[: self.shape[0], : self.shape[1]] = field
        return padded

    def filtered(self, padded: Analytic, threshold: float) -> Analytic:
        """Sum of the coefficients above a threshold, each reduced by it (soft threshold).

        ``threshold`` is in units of a coefficient of a window of unit energy. The field is
        overwritten.
        """
        out = np.zeros_like(padded)
        limit = np.float32(max(threshold * self.density, SMALLEST_THRESHOLD))
        for k, spectra in enumerate(self.spectra(padded)):
            power = spectra.real**2 + spectra.imag**2
            shrink = 1 - limit / np.sqrt(np.maximum(power, limit**2), out=power)
            spectra = scipy.fft.fft2(spectra * shrink, axes=(1, 2), overwrite_x=True, workers=-1)
            rows = np.zeros((self.y.samples, self.x.length), np.complex64)
            for j, part in enumerate(spectra):
                rows[:, self.x.bins[j]] += part * self.x.windows[j]
            out[self.y.bins[k]] += rows * self.y.windows[k][:, None]
        steps = (float(np.diff(axis.frequencies[:2])[0]) for axis in (self.y, self.x))
        scale = np.float32(np.prod(list(steps)) / (2.0 * np.pi) ** 2)
        summed = scipy.fft.ifft2(out, overwrite_x=True, workers=-1)
        summed *= scale
        return np.asarray(summed)

    def extended(self, field: Analytic, threshold: float) -> Analytic:
        """Add a border that continues the field, taken from its own filtered version.

        A window at the field's end then covers the same waves as one inside. A border of zeros
        would bias the phase towards the inside. It is one step of Gerchberg's extrapolation
        (Optica Acta 21, 1974).
        """
        wider = min(self.limit + EXTRA_BANDWIDTH / self.sigma_px, np.pi)
        lattice = Lattice(self.shape, self.sigma_px, wider, self.step)
        plain_wave = 2.0 * self.sigma_px * np.sqrt(np.pi) * float(np.median(np.abs(field)))
        smooth = lattice.filtered(self.pad(field), max(threshold, CONTINUED_SHARE * plain_wave))
        h, w = self.shape
        usual = float(np.median(np.abs(smooth[:h, :w])))
        if usual > 0:
            for rows, columns in ((slice(h, None), slice(None)), (slice(0, h), slice(w, None))):
                border = smooth[rows, columns]
                border *= usual / np.maximum(np.abs(border), np.float32(MIN_BORDER_SHARE * usual))
        smooth[:h, :w] = field
        return smooth
