"""Waveform of the fringes in blocks of a frame: the harmonics of a projector whose response is not
linear, relative to the fundamental."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringeworks.statistics.quantiles import NORMAL_MEDIAN
from fringeworks.types import FloatMap, Frozen

MOST_HARMONICS = 5
"""Highest harmonic that is estimated. With a response of γ = 2.2, the fifth one has 0.1 % of the
fundamental."""
SAMPLES_PER_PERIOD = 2.5
"""Smallest number of samples in a period of a harmonic that is estimated, px: below two, it cannot
be distinguished from a slower wave."""
TINY = 1e-12
"""Share of the largest singular value below which a direction counts as undetermined, and smallest
weight of a block."""
BLOCKS_PER_SIGMA = 8
"""Fewest blocks from whose scatter the error of their mean is estimated."""


@dataclass(frozen=True, eq=False, repr=False)
class Waveform(Frozen):
    """Shape of the fringes, Re Σ cₖ exp(ikφ) with c₁ = 1, as a function of their phase φ."""

    harmonics: NDArray[np.complex128]
    """c₂, c₃, …"""

    def at(self, phase: FloatMap) -> FloatMap:
        """Brightness of fringes of amplitude 1 and mean 0 at a phase, rad."""
        return np.cos(phase) + self.beyond(phase)

    def beyond(self, phase: FloatMap) -> FloatMap:
        """The part of the harmonics in this."""
        value = np.zeros(phase.shape)
        wave = np.exp(1j * phase) if self.harmonics.size else value
        power = wave
        for c in self.harmonics:
            power = power * wave
            value += c.real * power.real - c.imag * power.imag
        return value


SINE = Waveform(np.zeros(0, np.complex128))
"""Fringes without harmonics."""


def harmonic_count(period_px: float) -> int:
    """Number of harmonics beyond the fundamental that the pixels resolve, 0 …"""
    return max(min(MOST_HARMONICS, int(period_px / SAMPLES_PER_PERIOD)) - 1, 0)


def block_harmonics(
    counts: FloatMap, weight: FloatMap, linear: list[FloatMap], phase: FloatMap, count: int
) -> NDArray[np.complex128]:
    """Harmonics of every block over its fundamental, (n, count).

    Parameters
    ----------
    counts, weight, phase : (n, pixels) arrays
        Counts of the blocks, the weight of each pixel, and the phase of the fringes there, rad.
    linear : list of (n, pixels) arrays
        Other columns of the model: the mean and the slopes of the brightness.
    count : int
        Harmonics beyond the fundamental.

    Notes
    -----
    The phase is that of the filtered frame, and may differ by ε from that of the fringes. It is
    the phase of the fundamental, by which the k-th harmonic is turned back k times.
    """
    waves = [part for k in range(1, count + 2) for part in (np.cos(k * phase), np.sin(k * phase))]
    design = np.stack([*linear, *waves], axis=2)
    weighted = (design * weight[:, :, None]).transpose(0, 2, 1)
    fitted = np.linalg.pinv(weighted @ design, rcond=TINY) @ (weighted @ counts[:, :, None])
    parts = fitted[:, len(linear) :, 0].reshape(len(counts), count + 1, 2)
    c = parts[:, :, 0] - 1j * parts[:, :, 1]
    turn = np.exp(-1j * np.angle(c[:, :1]) * np.arange(2, count + 2))
    return np.asarray(c[:, 1:] * turn / np.maximum(np.abs(c[:, :1]), TINY))


def common_waveform(harmonics: NDArray[np.complex128]) -> Waveform:
    """The waveform that blocks share.

    Parameters
    ----------
    harmonics : (n, k) complex array
        Harmonics of every block.

    Notes
    -----
    The median of the blocks, times the share of its square that their scatter does not explain.
    Harmonics that are only noise thereby become zero.
    """
    n, k = harmonics.shape
    if n < BLOCKS_PER_SIGMA or not k:
        return SINE
    middle = np.median(harmonics.real, axis=0) + 1j * np.median(harmonics.imag, axis=0)
    apart = np.median(np.abs(harmonics - middle), axis=0) / NORMAL_MEDIAN
    # The median of n normal values has π/2 of the variance of their mean.
    variance = 0.5 * np.pi * apart**2 / n
    return Waveform(
        middle * np.maximum(1.0 - variance / np.maximum(np.abs(middle) ** 2, TINY), 0.0)
    )
