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
    the mean differs from place to place.
    """
    size = np.abs(wave)
    lit = np.nan_to_num(size) > 0.0
    double = np.where(lit, (wave / np.where(lit, size, 1.0)) ** 2, 0.0)
    count = np.maximum(_smooth(lit.astype(np.float32)), np.float32(LEAST_WEIGHT))
    parts = [_smooth(one.astype(np.float32)) / count for one in (double.real, double.imag)]
    rows, columns = max(1, wave.shape[0] // block), max(1, wave.shape[1] // block)
    whole = [one[: rows * block, : columns * block] for one in parts]
    real, imag = (
        np.asarray(cv2.resize(one, (columns, rows), interpolation=cv2.INTER_AREA), np.float32)
        for one in whole
    )
    found: list[FloatMap] = [-imag, real]
    off = [one - _mean_around(one) for one in found]
    square = _mean_around(off[0] ** 2 + off[1] ** 2)
    variance = np.where(np.hypot(real, imag) > LARGEST, np.float32(UNKNOWN), square)
    kept = np.linalg.norm(_both_weights(shifts_rad), axis=1) > LEAST_WEIGHT
    return [one for one, keep in zip(found, kept, strict=True) if keep], variance


def _mean_around(blocks: FloatMap) -> FloatMap:
    """Mean of blocks and those around them."""
    size = (AROUND, AROUND)
    return np.asarray(cv2.blur(blocks, size, borderType=cv2.BORDER_REFLECT_101))


def _smooth(values: FloatMap) -> FloatMap:
    border = cv2.BORDER_REFLECT_101
    return np.asarray(cv2.GaussianBlur(values, (0, 0), WINDOW_PX, borderType=border))
