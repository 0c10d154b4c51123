"""What the ripple of the phases of a set tells of the motion while its frames are taken."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.plan import step_design
from fringeworks.types import FloatMap
from fringeworks.types.packages import cv2

WINDOW_PX = 12.0
"""Standard deviation of the Gaussian window in which a ripple is averaged, px: it suppresses
fringes of up to 50 px across the image to 1 %."""
AROUND = 5
"""Blocks along each side whose ripples are compared: relief and paint make them differ from one
place to the next, and motion does not."""
LARGEST = 0.3
"""Largest ripple that is taken for one, rad: wide fringes and even surfaces, whose phases do not
take all values within the window, make larger means."""
UNKNOWN = 1.0
"""Variance of ripples that are larger, rad²."""
LIT_SHARE = 0.1
"""Smallest modulation that counts as light, as a share of its 95th percentile: phases in shadows
are noise. Half of what decoding judges by."""
SPARSE = 4
"""Distance of the pixels whose modulations are judged, px."""
LEAST_LEAK = 5e-4
"""Smallest leak of a window, rad: a quarter of the error that light which flickers makes."""
SPOILT = 16.0
"""Square of leaks, in least ones, from which on a ripple is taken from blocks around: they are as
large as that error."""
LEAST_WEIGHT = 1e-6
"""Norm of the weights of the frames below which the ripple does not depend on them."""
STEPS_SHARE = 6.0
"""Errors of phase steps that ripples allow for, over those of residuals, 1.7° instead of 0.3°:
decoding corrects such steps, and motion is only what changes from cycle to cycle."""


@lru_cache(maxsize=64)
def ripple_weights(shifts_rad: tuple[float, ...]) -> NDArray[np.float64]:
    """Weights of the turns of the phase at the frames of a set in its ripple, (0 to 2, N).

    Notes
    -----
    A set gives w = Σ p_n I_n, where p_n are the weights of c + i s in the fit. Turns θ_n of the
    phase in its frames add −i B D exp(−iφ) with D = ½ Σ p_n exp(i δ_n) θ_n to w = B exp(iφ).
    Steps of four have a real D, their alternating turn. Rows that are zero are left out.
    """
    rows = _both_weights(shifts_rad)
    return np.asarray(rows[np.linalg.norm(rows, axis=1) > LEAST_WEIGHT])


def _both_weights(shifts_rad: tuple[float, ...]) -> NDArray[np.float64]:
    """Weights of the real and of the imaginary part, (2, N)."""
    fit = np.linalg.pinv(step_design(shifts_rad))
    turned = 0.5 * (fit[1] + 1j * fit[2]) * np.exp(1j * np.asarray(shifts_rad))
    # Turns that are alike in all frames are no ripple.
    turned -= turned.mean()
    return np.stack([turned.real, turned.imag])


def ripples(
    wave: NDArray[np.complex64], shifts_rad: tuple[float, ...], block: int
) -> tuple[list[FloatMap], FloatMap]:
    """Return the ripples of a set at blocks of the image, and their variance, rad.

    Parameters
    ----------
    wave : (h, w) array
        Modulation and phase of the fit of a set, c + i s.
    shifts_rad : N floats
    block : int
        Side of a block, px.

    Notes
    -----
    Where phases take all values, exp(2 i φ) has the mean −i D. Phases that do not are told by how
    the mean differs from place to place. Windows that the border of the image or of the light cuts
    off do not average the phases out; their blocks take the ripple of those around them.
    """
    size = np.nan_to_num(np.abs(wave))
    lit = size > LIT_SHARE * np.percentile(size[::SPARSE, ::SPARSE], 95)
    phasor = np.where(lit, wave / np.where(lit, size, 1.0), 0.0)
    double = phasor**2
    count = np.maximum(_smooth(lit.astype(np.float32)), np.float32(LEAST_WEIGHT))
    leaked = _leaked(phasor, count, block)
    real, imag = (_reduced(_smooth(one) / count, block) for one in (double.real, double.imag))
    found = [_filled(one, leaked) for one in (-imag, real)]
    off = [one - _mean_around(one) for one in found]
    square = _mean_around(off[0] ** 2 + off[1] ** 2) + 1.0 / _mean_around(1.0 / leaked)
    variance = np.where(np.hypot(*found) > LARGEST, np.float32(UNKNOWN), square)
    kept = np.linalg.norm(_both_weights(shifts_rad), axis=1) > LEAST_WEIGHT
    return [one for one, keep in zip(found, kept, strict=True) if keep], variance


def _leaked(phasor: NDArray[np.complex64], count: FloatMap, block: int) -> FloatMap:
    """Square of the mean of exp(2 i φ) that windows leave which are cut off, at blocks, rad².

    Of the wave number k, a window whose weight ends at a line leaves g/k, where g is the relative
    slope of the count of its pixels: within 4 % for k of five radians per window and more.
    """
    lit = _reduced(count, block)
    slopes = [_reduced(np.asarray(one), block) / lit for one in np.gradient(count)]
    right, down = np.zeros_like(phasor), np.zeros_like(phasor)
    right[:, 1:] = phasor[:, 1:] * phasor[:, :-1].conj()
    down[1:] = phasor[1:] * phasor[:-1].conj()
    turns = [_turned(one, block) for one in (right, down)]
    number = np.maximum(2.0 * np.hypot(*turns), 1.0 / WINDOW_PX)
    return np.asarray(np.hypot(*slopes) ** 2 / number**2 + LEAST_LEAK**2, np.float32)


def _turned(turns: NDArray[np.complex64], block: int) -> FloatMap:
    """Mean turn of the phase from pixel to pixel at blocks, rad."""
    parts = [_mean_around(_reduced(one, block)) for one in (turns.imag, turns.real)]
    return np.asarray(np.arctan2(*parts))


def _filled(blocks: FloatMap, variance: FloatMap) -> FloatMap:
    """Blocks, those of a variance beyond the least one with the weighted mean around them."""
    mean = _mean_around(blocks / variance) / _mean_around(1.0 / variance)
    return np.where(variance > SPOILT * LEAST_LEAK**2, mean, blocks)


def _reduced(values: FloatMap, block: int) -> FloatMap:
    """Means over the blocks of an image."""
    rows, columns = max(1, values.shape[0] // block), max(1, values.shape[1] // block)
    inside = np.ascontiguousarray(values[: rows * block, : columns * block], np.float32)
    return np.asarray(cv2.resize(inside, (columns, rows), interpolation=cv2.INTER_AREA))


def _mean_around(blocks: FloatMap) -> FloatMap:
    """Mean of blocks and those around them."""
    size = (AROUND, AROUND)
    return np.asarray(cv2.blur(blocks, size, borderType=cv2.BORDER_REFLECT_101))


def _smooth(values: FloatMap) -> FloatMap:
    """Weighted sums over windows, in which nothing is outside of the image."""
    inside = np.ascontiguousarray(values, np.float32)
    border = cv2.BORDER_CONSTANT
    return np.asarray(cv2.GaussianBlur(inside, (0, 0), WINDOW_PX, borderType=border))
