"""Fourier transform profilometry: a band-pass around the carrier, phase by phase (theory §5)."""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy import fft

from fringeworks.analysis.pair import FringePair
from fringeworks.analysis.registry import Solution, method
from fringeworks.types import ByteMap, FloatMap, InputError, Reason
from fringeworks.unwrap import unwrap

MIN_MODULATION = 0.05
"""Fringes weaker than this share of the reference's are not measured …"""
NOISE_FACTOR = 4.0
"""… nor those within this many standard deviations of the band-passed noise."""


def band(shape: tuple[int, int], frequency: float, width: float, dimensions: int) -> FloatMap:
    """Hann-shaped pass band around +frequency (cycles/px along x); zero on the negative side."""
    fx = fft.fftfreq(shape[1])
    distance = (fx - frequency) / (width * frequency)
    if dimensions == 1:
        squared = (distance**2)[None, :]
    else:
        fy = fft.fftfreq(shape[0]) / (width * frequency)
        squared = distance[None, :] ** 2 + fy[:, None] ** 2
    inside = squared < 1.0
    return np.where(inside, 0.5 + 0.5 * np.cos(np.pi * np.sqrt(np.minimum(squared, 1.0))), 0.0)


def analytic(frame: FloatMap, window: FloatMap) -> np.ndarray:
    """The frame's positive-frequency part within the band, complex, (h, w)."""
    if window.shape[0] == 1:
        spectrum = fft.fft(frame - frame.mean(axis=1, keepdims=True), axis=1, workers=-1)
        return np.asarray(fft.ifft(spectrum * window, axis=1, overwrite_x=True, workers=-1))
    spectrum = fft.fft2(frame - frame.mean(), workers=-1)
    return np.asarray(fft.ifft2(spectrum * window, overwrite_x=True, workers=-1))


def anchor(phase: FloatMap, region: np.ndarray) -> FloatMap:
    """Shift the orders so that the rim of the frame, where the reference plane shows, is near 0."""
    h, w = phase.shape
    rim = np.ones(phase.shape, bool)
    by, bx = max(1, h // 50), max(1, w // 50)
    rim[by : h - by, bx : w - bx] = False
    main = region == 1
    where = main & rim if (main & rim).any() else main
    offset = 2.0 * np.pi * np.round(np.median(phase[where]) / (2.0 * np.pi))
    return np.asarray(phase - offset)


@method("fourier")
def fourier(pair: FringePair, *, dimensions: Literal[1, 2] = 2, width: float = 0.9) -> Solution:
    """Fourier transform profilometry: band-pass around the carrier, phase against the reference.

    Parameters
    ----------
    pair : FringePair
    dimensions : 1 or 2
        Filter row by row, or the whole frame at once, which averages noise along the fringes too.
    width : float in (0, 1)
        Half-width of the Hann-shaped pass band, as a share of the carrier frequency.

    Notes
    -----
    Takeda & Mutoh, Applied Optics 22(24):3977, 1983; theory §5. φ = arg(reference · conj(object)),
    unwrapped by sorting by reliability, its order set so that the frame's rim lies on the
    reference plane. σ is that of white noise through the band: √(Σ W²/n) per frame against the
    local amplitude. Edges and steps leak over about a period.
    """
    if dimensions not in (1, 2):
        raise InputError(f"dimensions: expected 1 or 2, got {dimensions}")
    if not 0 < width < 1:
        raise InputError(f"width: expected between 0 and 1, got {width}")
    window = band(pair.reference.shape, 1.0 / pair.period, width, dimensions)
    reference = analytic(pair.reference, window)
    object_ = analytic(pair.object, window)
    amplitude = np.abs(object_)
    reference_amplitude = np.abs(reference)
    # White noise of variance σ² leaves the complex band with variance σ² ΣW²/n, half of it in
    # the direction that turns the phase.
    bandwidth = float(np.mean(np.broadcast_to(window, pair.reference.shape) ** 2))
    noise_reference, noise_object = (v * bandwidth for v in pair.noise)
    weak = (amplitude < MIN_MODULATION * 0.5 * pair.modulation) | (
        amplitude < NOISE_FACTOR * np.sqrt(noise_object)
    )
    reason: ByteMap = np.where(weak, Reason.LOW_MODULATION, Reason.OK).astype(np.uint8)
    usable = ~weak & pair.wanted
    nothing = np.full(pair.reference.shape, np.nan)
    if not usable.any():
        return Solution(nothing, nothing, nothing, reason)
    wrapped = np.angle(reference * np.conj(object_))
    phase, region, _, _ = unwrap(wrapped, usable)
    reason[usable & (region > 1)] = Reason.ORDER_AMBIGUOUS
    phase = np.where(region == 1, anchor(phase, region), np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma = np.sqrt(
            0.5 * noise_reference / reference_amplitude**2 + 0.5 * noise_object / amplitude**2
        )
        gain = amplitude / reference_amplitude
    to_px = pair.period / (2.0 * np.pi)
    return Solution(
        phase * to_px, sigma * to_px, gain, reason, details={"regions": int(region.max())}
    )
