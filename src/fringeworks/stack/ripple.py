"""Ripple: phase errors that depend on the phase itself, measured along lines across the fringes.

A smooth surface changes the phase smoothly. Errors that repeat with every fringe are left over:
once and twice per fringe where steps, gains or the background of the frames are not as planned, N
times per fringe where the response of projector and camera is not linear (theory §6).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.stack.fits import times
from fringeworks.statistics.quantiles import MAD_TO_SIGMA, median, quantile
from fringeworks.types import BoolMap, FloatMap

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

TINY = float(np.finfo(float).tiny)
"""Divides instead of a zero."""

LINES_NOISE_ALONE = 1.4
"""Variance of the phase along smooth lines, over that of the noise, from which on noise of the
camera is not its only cause. It scatters by 5 % in simulations; the rest of the margin allows for
surfaces that are rough everywhere. Empirical."""

MAX_RESIDUAL_RAD = 0.5
"""Largest standard deviation of residuals that a ripple is measured from, rad. Residuals are known
modulo a turn; beyond, too many of them are a turn off. Empirical."""

RESPONSE_RIPPLE_RAD = 0.2
"""Amplitude that ripple of N per fringe usually has, where the response is not known, rad: γ of 1.8
makes it with three steps. Ripple of mN per fringe falls about with m²."""

STEP_RIPPLE_RAD = 0.03
"""Amplitude that ripple of one and two per fringe usually has, rad: that of gains which differ by 3
%, or steps by 2°."""

OTHER_RIPPLE_RAD = 0.01
"""The same of all other orders, which neither steps nor a response make by themselves, rad."""

OUTLIER_SIGMAS = 4.0
"""Residuals beyond this many standard deviations do not take part, for example wrong orders."""

USUAL_WINDOW = 0.9
"""Quantile of the smooth windows whose errors count where noise is not their only cause. Errors by
compression or vibration differ from place to place; most pixels must be covered. Empirical."""

LOWEST_THIRD = 1.06
"""Mean of the lowest 35 % of a normal distribution below its mean, in standard deviations."""

MIN_PLACES = 4
"""Smallest number of places along the lines at which a ripple is seen, so that it belongs to the
fringes. A crease that crosses all lines at the same place looks like a ripple there; at four places
its scatter is known to 40 %."""

SIGNIFICANT_AMPLITUDE = 5.0
"""Amplitude of a ripple in standard errors from which on it counts as seen."""


WINDOWS: _core._Wanted = {
    "fringes": WINDOW_FRINGES,
    "least": MIN_WINDOW,
    "most": MAX_WINDOW,
    "windows": (MIN_WINDOWS, MAX_WINDOWS),
    "jump": JUMP_TURNS,
}
"""The windows of smooth surface that ripple is measured in, as the kernel takes them."""


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
    seen_rad: tuple[float, float] | None = None
    """Sum over all orders at the phases that were seen, and its error, rms, rad; None where phases
    are spread evenly, so that the amplitudes tell both."""
    places: int = MIN_PLACES
    """Number of places along the lines that it was seen at."""

    @property
    def rms_rad(self) -> float:
        """Sum over its significant orders, rms, rad."""
        if self.seen_rad is not None:
            return self.seen_rad[0]
        return float(np.sqrt(0.5 * sum(abs(self.significant(k)) ** 2 for k in self.orders)))

    @property
    def error_rad(self) -> float:
        """Error of this sum, rms, rad."""
        if self.seen_rad is not None:
            return self.seen_rad[1]
        return float(np.sqrt(0.5 * np.sum(self.errors_rad**2)))

    @property
    def repeated(self) -> bool:
        """Whether it was seen at so many places that it belongs to the fringes, not the surface."""
        return self.places >= MIN_PLACES

    def significant(self, order: int) -> complex:
        """The harmonic of an order; 0 where it is not significant."""
        if order not in self.orders:
            return 0.0
        k = self.orders.index(order)
        z = complex(self.phasors_rad[k])
        return z if abs(z) > SIGNIFICANT_AMPLITUDE * self.errors_rad[k] else 0.0


def measure_ripple(
    turns: NDArray[np.float32],
    usable: BoolMap,
    sigma_rad: NDArray[np.float32],
    orders: tuple[int, ...],
) -> Ripple | None:
    """Measure the ripple of a wrapped phase along lines.

    Parameters
    ----------
    turns : (r, l) float32 array
        Wrapped phase along r lines, turns.
    usable : (r, l) bool array
    sigma_rad : (r, l) float32 array
        Standard deviation of the phase that camera noise alone would cause, rad.
    orders : tuple of int
        Numbers of periods per fringe.

    Returns
    -------
    Ripple; None where the lines hold too few whole fringes.
    """
    windows = _core.smooth_windows(turns, usable, WINDOWS)
    if windows is None:
        return None
    phase, pixels = windows
    length = phase.shape[1]
    sigma = sigma_rad.ravel()[pixels].astype(np.float64)
    sums = _core.window_sums(phase, _smooth_shapes(length), list(orders))
    expected = np.mean(sigma**2, axis=1)
    scatter = sums[2] / length / expected
    kept = scatter <= quantile(scatter, SMOOTH_SHARE)
    normal, projected, power = (part[kept] for part in sums)
    # Lines next to each other cross the same surface: windows count once per place along the lines.
    first = pixels[kept, 0] % turns.shape[1]
    _, place = np.unique(first // max(1, int(np.ptp(pixels[0])) + 1), return_inverse=True)
    coefficients, covariance = _pooled(normal, projected, place)
    # Σ (e - D c)², from the sums of e², D e and D D.
    explained = 2.0 * projected - np.einsum("wpq,q->wp", normal, coefficients)
    residual = np.maximum(power - explained @ coefficients, 0.0) / length / expected[kept]
    smooth = np.sort(residual)[: max(1, residual.size // 2)]
    freedom = length - 4.0
    # The smoothest windows are so by chance, too: their mean is that of the lower part of χ².
    by_chance = 1.0 - LOWEST_THIRD * np.sqrt(2.0 / freedom)
    excess = float(smooth.mean() * length / freedom / by_chance)
    if excess > LINES_NOISE_ALONE:
        # Errors that vary over the scene count with their usual size, not with their smallest.
        excess = quantile(residual, USUAL_WINDOW) * length / freedom
    pairs = coefficients.reshape(-1, 2)
    return Ripple(
        orders,
        pairs[:, 0] + 1j * pairs[:, 1],
        np.sqrt(np.maximum(np.diag(covariance), 0.0).reshape(-1, 2).max(axis=1)),
        excess,
        float(np.sqrt(expected.mean())),
        places=int(place.max()) + 1,
    )


@dataclass(frozen=True)
class SetPhases:
    """Phases of the sets of a sample, and what they leave of each other."""

    phase_rad: FloatMap
    """(M, n): phases of the coordinate."""
    residual_rad: FloatMap
    """(M, n): phases less those of the coordinate."""
    variance: FloatMap
    """(M,): usual variances of the phases by noise, rad²."""
    frequency: FloatMap
    """(M,): 1 / period of the sets, 1/px."""
    steps: tuple[int, ...]
    """Number of steps of the sets."""
    group: NDArray[np.intp]
    """(n,): number of the group of neighbouring pixels, rising."""

    def seen(self) -> FloatMap:
        """(M, M) matrix: what residual m shows of an error of set j, whose share in the coordinate
        is taken from all residuals."""
        share = self.frequency / self.variance
        return np.eye(len(share)) - np.outer(self.frequency, share) / (share @ self.frequency)


def ripples_of_sets(phases: SetPhases, orders: Sequence[tuple[int, ...]]) -> list[Ripple | None]:
    """Ripple of every set from the differences of the sets, whatever the surface.

    Parameters
    ----------
    phases : SetPhases
    orders : sequence of tuples of int
        Numbers of periods per fringe that each set may have.

    Returns
    -------
    list of Ripple, one per set; None where residuals are so large that they may be a turn off.

    Notes
    -----
    Least squares over all sets at once, because the coordinate contains the ripple of all. Orders
    may look alike: several of one set where it shows a part of a fringe, or those of two sets whose
    periods have a common multiple. What the residuals do not tell stays near zero, as far as ripple
    of that order usually goes, and in the error.
    """
    if np.std(phases.residual_rad, axis=1).max() > MAX_RESIDUAL_RAD:
        return [None] * len(orders)
    places = [(j, k) for j, of_set in enumerate(orders) for k in of_set]
    waves = _waves(phases.phase_rad, places)
    first, _ = _expected(waves, phases, places)
    left = np.abs(phases.residual_rad - _explained(waves, phases, places, first))
    limit = OUTLIER_SIGMAS * MAD_TO_SIGMA * np.array([[median(row)] for row in left])
    kept = np.all(left <= limit, axis=0)
    waves = waves[:, kept]
    phases = replace(
        phases,
        phase_rad=phases.phase_rad[:, kept],
        residual_rad=phases.residual_rad[:, kept],
        group=phases.group[kept],
    )
    expected, covariance = _expected(waves, phases, places)
    found: list[Ripple | None] = []
    for j, of_set in enumerate(orders):
        at = np.flatnonzero(np.repeat([place[0] == j for place in places], 2))
        # Over the phases that were seen.
        alike = times(waves[at], waves[at].T) / waves.shape[1]
        pairs = expected[at].reshape(-1, 2)
        unsure = float(np.sum(covariance[np.ix_(at, at)] * alike))
        found.append(
            Ripple(
                of_set,
                pairs[:, 0] + 1j * pairs[:, 1],
                np.zeros(len(pairs)),
                1.0,
                seen_rad=(float(expected[at] @ alike @ expected[at]) ** 0.5, unsure**0.5),
            )
        )
    return found


def _explained(
    waves: FloatMap, phases: SetPhases, places: list[tuple[int, int]], coefficients: FloatMap
) -> FloatMap:
    """Residuals of the sets that ripple makes, (M, n), rad."""
    own = np.zeros_like(phases.residual_rad)
    for k, (j, _) in enumerate(places):
        own[j] += coefficients[2 * k] * waves[2 * k] + coefficients[2 * k + 1] * waves[2 * k + 1]
    return np.asarray(times(phases.seen(), own))


def _waves(phase_rad: FloatMap, places: list[tuple[int, int]]) -> FloatMap:
    """cos kφ and sin kφ of the sets, (2P, n), for pairs of a set and an order k."""
    rows = []
    for j, k in places:
        turned = np.exp(1j * k * phase_rad[j])
        rows += [turned.real, turned.imag]
    return np.stack(rows)


def _expected(
    waves: FloatMap, phases: SetPhases, places: list[tuple[int, int]]
) -> tuple[FloatMap, FloatMap]:
    """Expected coefficients of the waves and their covariance, given the residuals."""
    seen, set_of = phases.seen(), np.repeat([j for j, _ in places], 2)
    weight = 1.0 / phases.variance
    waves = waves - waves.mean(axis=1, keepdims=True)
    residual = phases.residual_rad - phases.residual_rad.mean(axis=1, keepdims=True)
    normal = times(waves, waves.T) * (seen.T * weight @ seen)[np.ix_(set_of, set_of)]
    pulls = times(seen.T * weight, residual)
    projected = np.einsum("pn,pn->p", waves, pulls[set_of])
    inverse = np.linalg.pinv(normal, hermitian=True)
    left = residual - _explained(waves, phases, places, times(inverse, projected[:, None])[:, 0])
    scores = waves * times(seen.T * weight, left)[set_of]
    # Errors of neighbouring pixels belong together: sums over groups scatter accordingly.
    starts = np.flatnonzero(np.diff(phases.group, prepend=-1))
    sums = np.add.reduceat(scores, starts, axis=1)
    unit = max(1.0, float(np.sum(inverse * times(sums, sums.T))) / len(projected))
    usual = np.repeat([_usual_rad(k, phases.steps[j]) for j, k in places], 2)
    covariance = np.linalg.inv(normal / unit + np.diag(usual**-2.0))
    return times(covariance, projected[:, None])[:, 0] / unit, covariance


def _usual_rad(order: int, steps: int) -> float:
    """Amplitude that ripple of an order usually has, rad."""
    if order % steps == 0:
        return RESPONSE_RIPPLE_RAD / (order / steps) ** 2
    return STEP_RIPPLE_RAD if order <= 2 else OTHER_RIPPLE_RAD


@lru_cache(maxsize=64)
def _smooth_shapes(length: int) -> FloatMap:
    """Orthonormal polynomials up to the third degree over a window, (4, length)."""
    basis, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, length), 4))
    return np.ascontiguousarray(basis.T)


def _pooled(
    normal: FloatMap, projected: FloatMap, place: NDArray[np.intp]
) -> tuple[FloatMap, FloatMap]:
    """Least squares over all windows, and the covariance: the larger one of the scatter between
    windows and that between places."""
    inverse = np.linalg.pinv(normal.sum(axis=0), hermitian=True)
    coefficients = inverse @ projected.sum(axis=0)
    scores = projected - np.einsum("wpq,q->wp", normal, coefficients)
    spread = scores.T @ scores
    places = int(place.max()) + 1
    if places >= MIN_PLACES:
        sums = np.stack([scores[place == k].sum(axis=0) for k in range(places)])
        between = sums.T @ sums * (places / (places - 1.0))
        spread *= max(1.0, float(np.trace(between) / max(np.trace(spread), TINY)))
    return np.asarray(coefficients), np.asarray(inverse @ spread @ inverse)
