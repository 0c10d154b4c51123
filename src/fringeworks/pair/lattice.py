"""Windowed spectra on the lattice that holds them.

A windowed spectrum varies slowly in space: with a window of σ px its bandwidth is a few times
1/σ, so that it is fully known on a lattice some σ/2 apart. All coefficients are therefore
computed, thresholded and summed on that lattice, by transforms of a few per cent of the frame's
size; what is lost is below 10⁻⁴ of the window's spectrum.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from fringeworks.pair.bandpass import Analytic
from fringeworks.types import FloatMap

BANDWIDTH = 4.5
"""Half the band that a window needs, 1/σ: beyond, its spectrum is below 10⁻⁴."""
MARGIN = 3.0
"""Width of the border that is added around the field, σ."""
STRONG = 0.2
"""Coefficients from this share of a plain wave's on continue the field."""
WIDER = 1.0
"""How much further the frequencies of the border reach, 1/σ."""


@dataclass(frozen=True)
class Axis:
    """One axis of the lattice: its length, its samples, and the window at each frequency."""

    length: int
    samples: int
    frequencies: FloatMap  # rad/px
    first: NDArray[np.intp]  # (frequencies,) signed bin of the first sample
    bins: NDArray[np.intp]  # (frequencies, samples) places in the spectrum
    windows: NDArray[np.float32]  # (frequencies, samples)


def lattice_samples(length: int, sigma_px: float) -> int:
    """Samples along an axis of that length that hold what a window of that width makes of it."""
    wanted = int(np.ceil(BANDWIDTH / sigma_px * length / np.pi))
    return min(int(fft.next_fast_len(wanted)), length)


def samples_inside(samples: int, side: int, pitch: float) -> int:
    """How many of them lie on a field of ``side`` px, and the next one."""
    return min(samples, int(np.ceil((side - 1) / pitch)) + 1)


def shift_wave(first: int, samples: int) -> Analytic:
    """Wave of the bin that samples were demodulated by when their spectrum starts at ``first``."""
    turns = first * np.arange(samples) / samples
    return np.asarray(np.exp(2j * np.pi * turns), dtype=np.complex64)


def _axis(length: int, sigma_px: float, limit: float, step: float) -> Axis:
    """The lattice of one axis; the window has unit energy."""
    steps = max(1, int(np.ceil(limit / step - 1e-9)))
    frequencies = np.linspace(-limit, limit, 2 * steps + 1)
    samples = lattice_samples(length, sigma_px)
    first = np.round(frequencies * length / (2.0 * np.pi)).astype(np.intp) - samples // 2
    bins = first[:, None] + np.arange(samples)
    distance = 2.0 * np.pi * bins / length - frequencies[:, None]
    windows = np.sqrt(2.0 * sigma_px * np.sqrt(np.pi)) * np.exp(-0.5 * (sigma_px * distance) ** 2)
    return Axis(length, samples, frequencies, first, bins % length, windows.astype(np.float32))


class Lattice:
    """Windowed spectra of a field of one shape."""

    def __init__(self, shape: tuple[int, int], sigma_px: float, limit: float, step: float) -> None:
        margin = int(np.ceil(MARGIN * sigma_px))
        self.shape = shape
        self.sigma_px, self.limit, self.step = sigma_px, limit, step
        self.y, self.x = (
            _axis(fft.next_fast_len(side + 2 * margin), sigma_px, limit, step) for side in shape
        )
        self.pitch = (self.y.length / self.y.samples, self.x.length / self.x.samples)
        # Lattice points on the field, and the next ones.
        self.inside = tuple(
            samples_inside(axis.samples, side, pitch)
            for axis, side, pitch in zip((self.y, self.x), shape, self.pitch, strict=True)
        )
        self.density = self.y.length * self.x.length / (self.y.samples * self.x.samples)

    def spectra(self, padded: Analytic) -> Iterator[Analytic]:
        """For every frequency along y, the coefficients (frequencies along x, samples, samples).

        They are demodulated by the bin of their first sample, and ``density`` times too large.
        """
        spectrum = fft.fft2(padded, workers=-1)
        for rows, window in zip(self.y.bins, self.y.windows, strict=True):
            part = spectrum[rows] * window[:, None]
            stack = part[:, self.x.bins].transpose(1, 0, 2) * self.x.windows[:, None, :]
            yield fft.ifft2(stack, axes=(1, 2), overwrite_x=True, workers=-1)

    def pad(self, field: Analytic) -> Analytic:
        """The field with a border of zeros, to the right and below (periodic)."""
        padded = np.zeros((self.y.length, self.x.length), np.complex64)
        padded[: self.shape[0], : self.shape[1]] = field
        return padded

    def filtered(self, padded: Analytic, threshold: float) -> Analytic:
        """Sum of the coefficients that stand out."""
        out = np.zeros_like(padded)
        limit = np.float32(max(threshold * self.density, 1e-15))
        for k, spectra in enumerate(self.spectra(padded)):
            power = spectra.real**2 + spectra.imag**2
            # What is noise in a coefficient that stands out is taken off it as well.
            shrink = 1 - limit / np.sqrt(np.maximum(power, limit**2), out=power)
            spectra = fft.fft2(spectra * shrink, axes=(1, 2), overwrite_x=True, workers=-1)
            rows = np.zeros((self.y.samples, self.x.length), np.complex64)
            for j, part in enumerate(spectra):
                rows[:, self.x.bins[j]] += part * self.x.windows[j]
            out[self.y.bins[k]] += rows * self.y.windows[k][:, None]
        steps = (float(np.diff(axis.frequencies[:2])[0]) for axis in (self.y, self.x))
        scale = np.float32(np.prod(list(steps)) / (2.0 * np.pi) ** 2)
        return np.asarray(fft.ifft2(out, overwrite_x=True, workers=-1) * scale)

    def extended(self, field: Analytic, threshold: float) -> Analytic:
        """The field with a border that continues it, as its own filtered version does.

        A window at the border then sees what it would see inside (Gerchberg's extrapolation, one
        step), where a border of zeros would pull the phase towards the inside.
        """
        # What continues a chirp has higher frequencies than the field itself.
        wider = min(self.limit + WIDER / self.sigma_px, np.pi)
        lattice = Lattice(self.shape, self.sigma_px, wider, self.step)
        # All coefficients together would give back the field's end; the strongest go on.
        usual = 2.0 * self.sigma_px * np.sqrt(np.pi) * float(np.median(np.abs(field)))
        smooth = lattice.filtered(self.pad(field), max(threshold, STRONG * usual))
        size = np.abs(smooth)
        h, w = self.shape
        usual = float(np.median(size[:h, :w]))
        if usual > 0:
            smooth *= usual / np.maximum(size, np.float32(0.02 * usual))
        smooth[:h, :w] = field
        return smooth
