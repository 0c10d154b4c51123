"""Ripple: phase errors that depend on the phase itself, measured along lines across the fringes.

A smooth surface changes the phase smoothly. Errors that repeat with every fringe are left over:
once and twice per fringe where steps, gains or the background of the frames are not as planned, N
times per fringe where the response of projector and camera is not linear (theory §6).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringeworks.types import MAD_TO_SIGMA, BoolMap, FloatMap

WINDOW_FRINGES = 3.0
"""Length of a window along a line, fringes.

A polynomial of third degree, which takes out the surface, follows a ripple of one per fringe over
three fringes hardly at all. Longer windows demand longer smooth stretches of surface.
"""

MIN_WINDOW = 16
"""Smallest number of pixels in a window; a polynomial of third degree has four coefficients."""

MAX_WINDOW = 64
"""Largest number of pixels in a window; wider windows take every second or a later pixel."""

MAX_WINDOWS = 120
"""Largest number of windows; more only take time."""

MIN_WINDOWS = 12
"""Smallest number of windows for a statement. The error of a ripple is measured by the scatter from
window to window, and from twelve it is known to 20 %."""

JUMP_TURNS = 0.2
"""Change of the phase's slope from pixel to pixel above which a window holds an edge, turns."""

SMOOTH_SHARE = 0.7
"""Share of the windows that is used: the smoothest ones. The rest may hold edges or relief."""

LINES_NOISE_ALONE = 1.4
"""Variance of the phase along smooth lines, over that of the noise, from which on noise of the
camera is not its only cause. It scatters by 5 % in simulations; the rest of the margin allows for
surfaces that are rough everywhere. Empirical."""

MAX_RESIDUAL_RAD = 0.5
"""Largest standard deviation of residuals that a ripple is measured from, rad. Residuals are known
modulo a turn; beyond, too many of them are a turn off. Empirical."""

MAX_CONDITION = 1e3
"""Largest condition number of the normal equations of a ripple: phases must cover most of a
fringe."""

OUTLIER_SIGMAS = 4.0
"""Residuals beyond this many standard deviations do not take part, for example wrong orders."""

USUAL_WINDOW = 0.9
"""Quantile of the smooth windows whose errors count where noise is not their only cause. Errors by
compression or vibration differ from place to place; most pixels must be covered. Empirical."""

LOWEST_THIRD = 1.06
"""Mean of the lowest 35 % of a normal distribution below its mean, in standard deviations."""

SIGNIFICANT_AMPLITUDE = 5.0
"""Amplitude of a ripple in standard errors from which on it counts as seen."""


@dataclass(frozen=True)
class Ripple:
    """Harmonics of the phase error over the phase."""

    orders: tuple[int, ...]
    """Numbers of periods per fringe."""
    phasors_rad: NDArray[np.complex128]
    """z_k of the error Σ Re(z_k e^{−ikφ}), rad: a_k + i b_k of a_k cos kφ + b_k sin kφ."""
    errors_rad: NDArray[np.float64]
    """Standard error of every amplitude, rad."""
    excess: float
    """Variance of the phase about a smooth surface, without the ripple and in the smoother windows,
    over that by noise of the camera."""
    noise_rad: float = 0.0
    """Standard deviation of the phase by noise of the camera, rms over the windows, rad."""
    background_ratio: float = 1.0
    """Background over modulation of the pixels, median."""

    def significant(self, order: int) -> complex:
        """The harmonic of an order; 0 where it is not significant."""
        if order not in self.orders:
            return 0.0
        k = self.orders.index(order)
        z = complex(self.phasors_rad[k])
        return z if abs(z) > SIGNIFICANT_AMPLITUDE * self.errors_rad[k] else 0.0


def measure_ripple(
    turns: FloatMap, usable: BoolMap, sigma_rad: FloatMap, orders: tuple[int, ...]
) -> Ripple | None:
    """Measure the ripple of a wrapped phase along lines.

    Parameters
    ----------
    turns : (r, l) float array
        Wrapped phase along r lines, turns.
    usable : (r, l) bool array
    sigma_rad : (r, l) float array
        Standard deviation of the phase that camera noise alone would cause, rad.
    orders : tuple of int
        Numbers of periods per fringe.

    Returns
    -------
    Ripple; None where the lines hold too few whole fringes.
    """
    windows = _windows(turns, usable, sigma_rad)
    if windows is None:
        return None
    phase, sigma = windows
    length = phase.shape[1]
    place = np.linspace(-1.0, 1.0, length)
    basis, _ = np.linalg.qr(np.vander(place, 4))

    def rough(values: FloatMap) -> FloatMap:
        """What a smooth surface does not explain."""
        return np.asarray(values - (values @ basis) @ basis.T)

    errors = rough(phase)
    shapes = []
    for wave in harmonics(np.exp(1j * phase), orders):
        shapes += [rough(wave.real), rough(wave.imag)]
    design = np.stack(shapes, axis=-1)
    expected = np.mean(sigma**2, axis=1)
    scatter = np.mean(errors**2, axis=1) / expected
    kept = scatter <= np.quantile(scatter, SMOOTH_SHARE)
    coefficients, covariance = _pooled(design[kept], errors[kept])
    residual = np.mean((errors[kept] - design[kept] @ coefficients) ** 2, axis=1) / expected[kept]
    smooth = np.sort(residual)[: max(1, residual.size // 2)]
    freedom = length - 4.0
    # The smoothest windows are so by chance, too: their mean is that of the lower part of χ².
    by_chance = 1.0 - LOWEST_THIRD * np.sqrt(2.0 / freedom)
    excess = float(smooth.mean() * length / freedom / by_chance)
    if excess > LINES_NOISE_ALONE:
        # Errors that vary over the scene count with their usual size, not with their smallest.
        excess = float(np.quantile(residual, USUAL_WINDOW) * length / freedom)
    pairs = coefficients.reshape(-1, 2)
    return Ripple(
        orders,
        pairs[:, 0] + 1j * pairs[:, 1],
        np.sqrt(np.diag(covariance).reshape(-1, 2).max(axis=1)),
        excess,
        float(np.sqrt(expected.mean())),
    )


def ripple_of_residuals(
    phase_rad: FloatMap, residual_rad: FloatMap, orders: tuple[int, ...]
) -> Ripple | None:
    """Ripple of a set of long fringes, from its differences to the other sets.

    Parameters
    ----------
    phase_rad : (n,) float array
        Wrapped phase of the set, rad.
    residual_rad : (n,) float array
        Phase of the set less that of the coordinate, rad.
    orders : tuple of int

    Returns
    -------
    Ripple; None where the phases do not cover a fringe.
    """
    if np.std(residual_rad) > MAX_RESIDUAL_RAD:
        return None
    waves = [np.ones_like(phase_rad)]
    for wave in harmonics(np.exp(1j * phase_rad), orders):
        waves += [wave.real, wave.imag]
    design = np.stack(waves, axis=1)
    normal = design.T @ design
    if np.linalg.cond(normal) > MAX_CONDITION:
        return None
    inverse = np.linalg.inv(normal)
    coefficients = inverse @ (design.T @ residual_rad)
    left = residual_rad - design @ coefficients
    kept = np.abs(left) <= OUTLIER_SIGMAS * MAD_TO_SIGMA * np.median(np.abs(left))
    inverse = np.linalg.inv(design[kept].T @ design[kept])
    coefficients = inverse @ (design[kept].T @ residual_rad[kept])
    variance = float(np.var(residual_rad[kept] - design[kept] @ coefficients))
    pairs = coefficients[1:].reshape(-1, 2)
    errors = np.sqrt(variance * np.diag(inverse)[1:].reshape(-1, 2).max(axis=1))
    return Ripple(orders, pairs[:, 0] + 1j * pairs[:, 1], errors, 1.0)


def harmonics(
    wave: NDArray[np.complex128], orders: tuple[int, ...]
) -> Iterator[NDArray[np.complex128]]:
    """Powers of a wave, in rising order; products take a tenth of the time of powers."""
    power, reached = wave, 1
    for order in orders:
        for _ in range(order - reached):
            power = power * wave
        reached = order
        yield power


def _windows(turns: FloatMap, usable: BoolMap, sigma: FloatMap) -> tuple[FloatMap, FloatMap] | None:
    """Unwrapped phases of windows without edges, rad, and their standard deviations by noise."""
    slope = np.diff(turns, axis=1)
    slope -= np.rint(slope)
    good = usable[:, 1:] & usable[:, :-1]
    if good.sum() < MIN_WINDOW * MIN_WINDOWS:
        return None
    # Signed: noise would make up for a slope that is hardly there.
    per_pixel = abs(float(np.median(slope[good])))
    lines, length = turns.shape
    if per_pixel * length < WINDOW_FRINGES:
        return None
    span = max(MIN_WINDOW, int(np.ceil(WINDOW_FRINGES / per_pixel)))
    stride = -(-span // MAX_WINDOW)
    count = -(-span // stride)
    starts = np.arange(0, length - span + 1, max(1, span // 2))
    if starts.size == 0:
        return None
    bend = np.abs(np.diff(slope, axis=1))
    broken = np.zeros((lines, length + 1))
    fault = ~usable
    fault[:, 1:-1] |= bend > JUMP_TURNS
    np.cumsum(fault, axis=1, out=broken[:, 1:])
    whole = (broken[:, np.minimum(starts + span, length)] - broken[:, starts]) == 0
    row, which = np.nonzero(whole)
    if row.size < MIN_WINDOWS:
        return None
    chosen = np.linspace(0, row.size - 1, min(row.size, MAX_WINDOWS)).astype(np.intp)
    columns = starts[which[chosen]][:, None] + stride * np.arange(count)
    columns = np.minimum(columns, length - 1)
    rows = row[chosen][:, None]
    unwrapped = np.zeros((lines, length))
    np.cumsum(np.where(np.isfinite(slope), slope, 0.0), axis=1, out=unwrapped[:, 1:])
    start = turns[rows[:, 0], columns[:, 0]] - unwrapped[rows[:, 0], columns[:, 0]]
    phase = 2.0 * np.pi * (unwrapped[rows, columns] + start[:, None])
    return np.asarray(phase), sigma[rows, columns]


def _pooled(design: FloatMap, errors: FloatMap) -> tuple[FloatMap, FloatMap]:
    """Least squares over all windows, and the covariance from the scatter between windows."""
    normal = np.einsum("wlp,wlq->pq", design, design, optimize=True)
    projected = np.einsum("wlp,wl->wp", design, errors)
    inverse = np.linalg.pinv(normal, hermitian=True)
    coefficients = inverse @ projected.sum(axis=0)
    scores = projected - np.einsum("wlp,wl->wp", design, design @ coefficients)
    covariance = inverse @ (scores.T @ scores) @ inverse
    return np.asarray(coefficients), np.asarray(covariance)
