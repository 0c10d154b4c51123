"""What the frames of a set really show: real phase steps, gains and harmonics, from the frames.

Every frame of a set shows I_n = α_n A + k_n c + q_n s, with A, c = B cos φ and s = B sin φ of the
pixel. As planned, α_n = 1, k_n = cos δ_n and q_n = sin δ_n. Wrong steps, flicker, light that
changes and motion change these three numbers of a frame alike in all pixels. A response that is not
linear adds harmonics, B cos kφ and B sin kφ, with the same shares in all pixels. What the fit of A,
c and s leaves of four or more frames shows both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.stack.fits import (
    DesignRows,
    fit_matrices,
    gram,
    harmonic_parts,
    samples_at,
    times,
)
from fringeworks.stack.kernel_settings import PhaseFrames
from fringeworks.stack.shifts import step_errors
from fringeworks.statistics.quantiles import median
from fringeworks.types import BoolMap, FloatMap

SIGNIFICANT_DECREASE = 6.0
"""Decrease of the residuals that counts as significant, in standard deviations of its value under
noise alone. Noise alone reaches six in far less than one stack of a million."""

USEFUL = 0.01
"""Smallest share of the residuals' variance that the real frames, or the harmonics, must explain.

Below, the phase errors are less than about a tenth of the noise. An empirical choice.
"""

SEPARABLE = 10.0
"""Smallest squared modulation over the variance of the noise: below, noise turns the fringes. An
empirical choice."""

MAX_ALIGNED = 0.9
"""Largest magnitude of the mean of e^{iφ} over the pixels: at 0.9 they hold a quarter of a fringe.

With less of a fringe, background and fringe cannot be distinguished.
"""

OUTLIERS = 16.0
"""Squared residual of a pixel over the median, above which it is left out, for example at edges
that move. Empirical; noise alone exceeds it in fewer than 0.3 % of the pixels."""

MAX_CONDITION = 1e4
"""Largest condition number of the regression, beyond which harmonics look like A, c and s."""

PASSES = 3
"""Linear fits after one another; errors of the steps of 10° leave less than 0.01° after three."""


@dataclass(frozen=True)
class RealFrames:
    """What the frames of a set show of A, c and s."""

    design: NDArray[np.float64]
    """(N, 3): α_n, k_n and q_n."""

    @property
    def shifts_rad(self) -> NDArray[np.float64]:
        """Phase steps δ_n, rad, up to a common one."""
        k, q = self._circle()
        return np.asarray(np.arctan2(q, k))

    @property
    def shifts_under_other_light_rad(self) -> NDArray[np.float64]:
        """Phase steps δ_n, rad, if light that does not come from the projector changed.

        It changes α_n alone: (k_n, q_n) − α_n (β, γ) lie on a circle about zero, with unknown
        shares β and γ of c and s in A.
        """
        light, k, q = self.design.T
        share = np.zeros(2)
        for _ in range(PASSES):
            k, q = k - light * share[0], q - light * share[1]
            conic = np.column_stack((2.0 * light * k, 2.0 * light * q, np.ones_like(k)))
            share = np.linalg.lstsq(conic, k**2 + q**2, rcond=None)[0]
        return np.asarray(np.arctan2(q, k))

    @property
    def fringe_gains(self) -> NDArray[np.float64]:
        """Modulation over background of every frame, relative to the mean of all."""
        gains = np.hypot(*self._circle())
        return np.asarray(gains / gains.mean())

    def _circle(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(k_n, q_n) / α_n about the centre of the circle through them.

        Adding shares of c and s to A does not change the phase, but moves these points. Where all
        frames have the same modulation over background, the points lie on a circle about zero.
        """
        k, q = (self.design[:, 1:] / self.design[:, :1]).T
        conic = np.column_stack((2.0 * k, 2.0 * q, np.ones_like(k)))
        centre = np.linalg.lstsq(conic, k**2 + q**2, rcond=None)[0]
        return k - centre[0], q - centre[1]

    @property
    def light_gains(self) -> NDArray[np.float64]:
        """Background of every frame over the mean of all."""
        return np.asarray(self.design[:, 0] / self.design[:, 0].mean())


def real_step_errors(phases: PhaseFrames) -> NDArray[np.float64]:
    """Differences of the steps that a set's frames show from those of the plan, rad; see
    ``step_errors``."""
    return step_errors(RealFrames(np.array(phases.rows)).shifts_rad, phases.shifts_rad)


@dataclass(frozen=True)
class FrameFit:
    """What frames show beyond their plan; None where they show nothing significant."""

    design: NDArray[np.float64] | None = None
    """(N, 3): α_n, k_n and q_n of every frame."""
    harmonics: NDArray[np.float64] | None = None
    """(N, 6): what the fit of A, c and s leaves of every frame, as shares of the harmonics."""


@dataclass(frozen=True)
class _Terms:
    """What the residuals of a set are regressed on, pixel by pixel."""

    across: FloatMap
    """(N, N − 3): orthonormal directions that the design does not reach."""
    parts: FloatMap
    """(9, n): A, c, s and the harmonics, counts."""
    residual: FloatMap
    """(N − 3, n): the samples in these directions, counts."""

    def at(self, kept: BoolMap) -> _Terms:
        """The same at some of the pixels."""
        parts = self.parts.compress(kept, axis=1)
        return replace(self, parts=parts, residual=self.residual.compress(kept, axis=1))


@dataclass(frozen=True)
class _Solved:
    """Shares that explain the most of the residuals, and the sums that they follow from."""

    shares: FloatMap
    """(9, N − 3)."""
    normal: FloatMap
    """(9, 9)."""
    projected: FloatMap
    """(9, N − 3)."""
    total: float
    """Sum of the squared residuals before."""
    square: FloatMap
    """(n,) squared residuals of every pixel after."""


@dataclass(frozen=True)
class _Regression:
    """Least squares of the residuals of a set over A, c, s and the harmonics."""

    across: FloatMap
    """(N, N − 3): orthonormal directions that the design does not reach."""
    shares: FloatMap
    """(9, N − 3): of A, c, s and the harmonics in these directions."""
    left: tuple[float, float, float]
    """Sums of squared residuals: with all terms, without A, c and s, without the harmonics."""
    usual_power: float
    """Median of the squared modulations, counts²."""
    aligned: float
    """Magnitude of the mean of e^{iφ}."""


def fit_frames(
    planes: list[NDArray[Any]],
    pixels: NDArray[np.intp],
    planned: NDArray[np.float64],
    response: NDArray[np.float64] | None = None,
) -> FrameFit:
    """Estimate what the frames of a set show, from many pixels.

    Parameters
    ----------
    planes : (1, n) arrays, one per frame, counts
    pixels : (m,) integer array
        Pixels with fringes, none of them saturated.
    planned : (N, 3) array
        What the frames should show: 1, cos δ_n and sin δ_n.
    response : (N, 6) array, optional
        The harmonics that another set of the same steps shows: of one projector, they are the same.
        They are used where the pixels see too little of a fringe to show their own.

    Returns
    -------
    FrameFit; empty where three frames, noise, or too little of a fringe determine nothing.

    Notes
    -----
    The residuals of the planned fit are regressed on A, c, s and the harmonics together, so that
    neither is taken for the other where phases are spread unevenly. The noise of the residuals is
    independent of that of A, c and s. Errors of the design that leave no residuals stay unknown:
    they shift the phase by a function of the phase itself (``stack.ripple``).
    """
    steps = len(planned)
    if steps < 4 or pixels.size < 10 * steps:
        return FrameFit()
    values = samples_at(planes, pixels)
    terms = _terms(values, planned)
    square = _solved(terms, response).square
    kept = square <= OUTLIERS * median(square)
    values, terms = values.compress(kept, axis=1), terms.at(kept)
    start = _regression(terms, response)
    noise = start.left[0] / (values.shape[1] * (steps - 3))
    if start.aligned > MAX_ALIGNED or not start.usual_power > SEPARABLE * noise > 0.0:
        return FrameFit()

    def significant(found: _Regression, without: float, terms: int) -> bool:
        if not without > found.left[0]:
            return False  # rounding errors of frames without noise
        free = float(terms * (steps - 3))
        variance = found.left[0] / (values.shape[1] * (steps - 3) - found.shares.size)
        decrease = (without - found.left[0]) / variance
        explained = 1.0 - found.left[0] / without
        return (decrease - free) > SIGNIFICANT_DECREASE * (2.0 * free) ** 0.5 and explained > USEFUL

    design, found = planned, start
    # Where nothing of the first fit is significant, others after it show no more.
    if significant(start, start.left[1], 3):
        for _ in range(PASSES):
            design = design + found.across @ found.shares[:3].T
            found = _regression(_terms(values, design), response)
    moved = significant(found, start.left[1], 3)
    best = found if moved else start
    bent = significant(best, best.left[2], len(best.shares) - 3)
    harmonics = best.across @ best.shares[3:].T
    return FrameFit(design if moved else None, harmonics if bent else None)


def _terms(values: FloatMap, design: NDArray[np.float64]) -> _Terms:
    """What a design makes of (N, n) samples."""
    _, solver = fit_matrices(design_rows(design))
    assert solver is not None
    fitted = times(solver, values)
    parts = np.concatenate((fitted, harmonic_parts(fitted)))
    across = np.linalg.qr(design, mode="complete")[0][:, 3:]
    return _Terms(across, parts, times(np.ascontiguousarray(across.T), values))


def _solved(terms: _Terms, response: NDArray[np.float64] | None) -> _Solved:
    """Regress what the design leaves of the samples on A, c, s and the harmonics."""
    parts, residual = terms.parts, terms.residual
    count = len(parts)
    products = gram(np.concatenate((parts, residual)))
    normal = products[:count, :count]
    size = np.sqrt(np.diag(normal))
    if np.linalg.cond(normal / np.outer(size, size)) > MAX_CONDITION:
        # Too little of a fringe to tell harmonics from A, c and s.
        if response is not None:
            residual = residual - terms.across.T @ response @ parts[3:]
        parts = np.concatenate((parts[:3], np.zeros_like(parts[3:])))
        products = gram(np.concatenate((parts, residual)))
        normal = products[:count, :count]
    projected = products[:count, count:]
    shares = np.linalg.lstsq(normal, projected, rcond=None)[0]
    square = np.sum((residual - times(np.ascontiguousarray(shares.T), parts)) ** 2, axis=0)
    total = float(np.trace(products[count:, count:]))
    return _Solved(shares, normal, projected, total, np.asarray(square))


def _regression(terms: _Terms, response: NDArray[np.float64] | None) -> _Regression:
    """The regression with what it leaves, also without some of the terms."""
    found = _solved(terms, response)

    def left(kept: slice) -> float:
        part = found.projected[kept]
        shares = np.linalg.lstsq(found.normal[kept, kept], part, rcond=None)[0]
        return max(found.total - float(np.sum(shares * part)), 0.0)

    _, c, s = terms.parts[:3]
    power = c**2 + s**2
    phasor = (c + 1j * s) / np.maximum(np.sqrt(power), np.finfo(float).tiny)
    return _Regression(
        terms.across,
        found.shares,
        (float(np.sum(found.square)), left(slice(3, None)), left(slice(3))),
        median(power),
        float(abs(np.mean(phasor))),
    )


def design_rows(design: NDArray[np.float64]) -> DesignRows:
    """A design matrix as tuples, one per frame."""
    return tuple((float(a), float(c), float(s)) for a, c, s in design)
