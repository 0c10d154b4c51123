"""Ripple: phase errors that depend on the phase itself, measured along lines across the fringes.

A smooth surface changes the phase smoothly. Errors that repeat with every fringe are left over:
once and twice per fringe where steps, gains or the background of the frames are not as planned, N
times per fringe where the response of projector and camera is not linear (theory §6).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.statistics.groups import equal_groups
from fringeworks.statistics.quantiles import quantile
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

RESPONSE_RIPPLE_RAD = 0.2
"""Amplitude that ripple of three per fringe usually has in three steps, where the response is not
known, rad: that of γ = 1.8. Ripple of mN per fringe falls about with m²."""

PER_STEP = 4.0
"""Factor by which it falls with every further step: γ of 2.8 makes 0.05 rad in four steps and less
than 0.01 in five; saturation makes more."""

MOST_USUAL = 4.0
"""Amplitude over the usual one up to which a response is the cause."""

STEP_RIPPLE_RAD = 0.03
"""Amplitude that ripple of one and two per fringe usually has, rad: that of gains which differ by 3
%, or steps by 2°."""

OTHER_RIPPLE_RAD = 0.01
"""The same of all other orders, which neither steps nor a response make by themselves, rad."""

LINES_NOISE_ALONE = 1.4
"""Variance of the phase along smooth lines, over that of the noise, from which on noise of the
camera is not its only cause. It scatters by 5 % in simulations; the rest of the margin allows for
surfaces that are rough everywhere. Empirical."""

USUAL_WINDOW = 0.9
"""Quantile of the smooth windows whose errors count where noise is not their only cause. Errors by
compression or vibration differ from place to place; most pixels must be covered. Empirical."""

LOWEST_THIRD = 1.06
"""Mean of the lowest 35 % of a normal distribution below its mean, in standard deviations."""

RESPONSE_ORDER = 3
"""Lowest order that a response makes, periods per fringe; lower ones come from steps and gains."""

MIN_PLACES = 4
"""Smallest number of places along the lines at which a ripple is seen, so that it belongs to the
fringes. A crease that crosses all lines at the same place looks like a ripple there; at four places
its scatter is known to 40 %."""

SIGNIFICANT_AMPLITUDE = 5.0
"""Amplitude of a ripple in standard errors from which on it counts as seen, where the errors are
known: noise exceeds it in one of 270,000 stacks."""

SURE = 2.0
"""Errors of a ripple, rms over the phases, that it must exceed to be taken out or to count."""

NEGLIGIBLE_RAD = 0.005
"""Ripple that is left as a part of σ rather than taken out, rad rms: half the noise of a phase of
four steps by a camera at its best, of 0.7 counts at a modulation of 50."""

SETTLED = 0.3
"""The same where the brightness of the fringes tells it as well: less hardly adds to its error."""


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
    error_rad: float = 0.0
    """Error of its sum over all orders, rms over the phases that were seen, rad."""
    all_rad: float | None = None
    """The sum itself, rms, rad; None where only significant orders count."""
    by_brightness: tuple[tuple[float, NDArray[np.complex128]], ...] = ()
    """The same at pixels of rising brightness A + B, counts; none where all are alike."""
    places: int = MIN_PLACES
    """Number of places along the lines that it was seen at."""
    told_rad: float | None = None
    """Error of what the brightness of the fringes tells, rms, rad: the part of a response or of
    wrong frames, whichever may be large."""
    unknown_rad: float = 0.0
    """What a response usually makes, rms, rad, where frames should show it but nothing does."""
    freedom: float = float("inf")
    """Degrees of freedom of the errors: two for every place but one."""

    @property
    def told(self) -> bool:
        """Whether the brightness of the fringes tells what may be large."""
        return self.told_rad is not None

    @property
    def rms_rad(self) -> float:
        """Its sum over all orders that count, rms, rad."""
        if self.all_rad is not None:
            return self.all_rad
        return float(np.sqrt(0.5 * sum(abs(self.significant(k)) ** 2 for k in self.orders)))

    @property
    def low_rad(self) -> float:
        """Largest amplitude of the orders that steps and gains make, rad."""
        return max(abs(self.significant(k)) for k in self.orders if k < RESPONSE_ORDER)

    @property
    def repeated(self) -> bool:
        """Whether it belongs to the fringes, not the surface: it was seen at many places, or
        changes their brightness."""
        return self.told or self.places >= MIN_PLACES

    @property
    def smooth(self) -> bool:
        """Whether many places of a smooth surface show it."""
        return self.places >= MIN_PLACES and self.excess <= LINES_NOISE_ALONE

    @property
    def sure(self) -> bool:
        """Whether it is more than its error, over all orders."""
        if self.told:
            return self.rms_rad > max(SETTLED * self.error_rad, NEGLIGIBLE_RAD)
        return self.rms_rad > SURE * self.error_rad

    def with_response_of(self, other: Ripple, steps: int) -> Ripple:
        """The ripple with the orders of a response, and their error, from another one."""
        ours = np.array([order % steps != 0 for order in self.orders])
        return replace(
            self,
            phasors_rad=np.where(ours, self.phasors_rad, other.phasors_rad),
            errors_rad=np.where(ours, self.errors_rad, other.errors_rad),
            error_rad=float(np.hypot.reduce([*self.errors_rad[ours], other.error_rad])),
            excess=other.excess,
            noise_rad=other.noise_rad,
            all_rad=None,
            by_brightness=(),
            told_rad=other.told_rad,
        )

    def significant(self, order: int) -> complex:
        """The harmonic of an order; 0 where it is not significant."""
        if order not in self.orders:
            return 0.0
        k = self.orders.index(order)
        z = complex(self.phasors_rad[k])
        # Relief makes low orders. Those of a response are too fine for it, and usual in all stacks.
        freedom = self.freedom if order < RESPONSE_ORDER else float("inf")
        return z if abs(z) > significant_amplitude(freedom) * self.errors_rad[k] else 0.0


def unknown_ripple(orders: tuple[int, ...], steps: int) -> Ripple:
    """Ripple of which no more is known than how large it usually is."""
    usual = np.array([usual_rad(order, steps) for order in orders])
    size = float(np.hypot.reduce(usual))
    return Ripple(orders, np.zeros(len(orders), complex), usual, 1.0, error_rad=size, places=0)


def significant_amplitude(freedom: float) -> float:
    """Amplitude, in standard errors, that noise exceeds as rarely as ``SIGNIFICANT_AMPLITUDE``
    where the errors themselves have a few degrees of freedom ν only.

    The squared amplitude is F-distributed with 2 and ν degrees of freedom: noise exceeds a standard
    errors with a probability of (1 + a²/ν)^(-ν/2).
    """
    log_chance = -0.5 * SIGNIFICANT_AMPLITUDE**2
    if np.isinf(freedom):
        return SIGNIFICANT_AMPLITUDE
    return float(np.sqrt(freedom * np.expm1(-2.0 * log_chance / freedom)))


def measure_ripple(
    turns: NDArray[np.float32],
    usable: BoolMap,
    sigma_rad: NDArray[np.float32],
    orders: tuple[int, ...],
    steps: int,
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
    steps : int
        Number of steps of the set.

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
    sums = _core.window_sums(phase, smooth_shapes(length), list(orders))
    expected = np.mean(sigma**2, axis=1)
    scatter = sums[2] / length / expected
    kept = scatter <= quantile(scatter, SMOOTH_SHARE)
    normal, projected, power = (part[kept] for part in sums)
    # Lines next to each other cross the same surface: windows count once per place along the lines.
    first = pixels[kept, 0] % turns.shape[1]
    _, place = equal_groups(first // max(1, int(np.ptp(pixels[0])) + 1))
    usual = np.repeat([usual_rad(order, steps) for order in orders], 2)
    known = float(expected.mean()) / usual**2
    coefficients, covariance = pooled(normal, projected, known, place)
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
        # Orders that look alike at the phases of the pixels are known together only.
        error_rad=float(np.sum(covariance * normal.sum(axis=0)) / normal.shape[0] / length) ** 0.5,
        places=int(place.max()) + 1,
        freedom=2.0 * max(int(place.max()), MIN_PLACES - 1),
    )


@lru_cache(maxsize=64)
def smooth_shapes(length: int) -> FloatMap:
    """Orthonormal polynomials up to the third degree over a window, (4, length)."""
    basis, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, length), 4))
    return np.ascontiguousarray(basis.T)


def usual_rad(order: int, steps: int) -> float:
    """Amplitude that ripple of an order usually has, rad."""
    if order % steps == 0:
        return RESPONSE_RIPPLE_RAD / (order / steps) ** 2 / PER_STEP ** max(0, steps - 3)
    return STEP_RIPPLE_RAD if order <= 2 else OTHER_RIPPLE_RAD


def pooled(
    normal: FloatMap, projected: FloatMap, known: FloatMap, place: NDArray[np.intp]
) -> tuple[FloatMap, FloatMap]:
    """Expected coefficients over all windows, and their covariance: the larger one of the scatter
    between windows and that between places. ``known`` is what is known of them before: the variance
    of the phases over that of the coefficients."""
    inverse = np.linalg.inv(normal.sum(axis=0) + np.diag(known))
    coefficients = inverse @ projected.sum(axis=0)
    scores = projected - np.einsum("wpq,q->wp", normal, coefficients)
    spread = scores.T @ scores
    places = int(place.max()) + 1
    if places > 1:
        sums = np.stack([scores[place == k].sum(axis=0) for k in range(places)])
        between = sums.T @ sums * (places / (places - 1.0))
        spread *= max(1.0, float(np.trace(between) / max(np.trace(spread), TINY)))
    return np.asarray(coefficients), np.asarray(inverse @ spread @ inverse)
