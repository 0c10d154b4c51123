"""Ripple of lines that are shifted like phase steps, from how sharp the camera sees them.

N equal steps measure the fundamental of a line exactly, except for its harmonics k N ± 1, which
have the same samples. Blur lessens them, and also the harmonics between, which are in the residuals
of the fit: the residuals tell how sharp the lines are, and with it how much ripple there is.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fringeworks.patterns.order_chain import TURN
from fringeworks.stack.kernel_settings import PhaseFrames
from fringeworks.stack.noise import usable
from fringeworks.stack.sample import Sample
from fringeworks.stack.set_residuals import Known
from fringeworks.types import FloatMap

PERIODS_OF_STEPS = 6
"""Harmonics up to this number of steps are added up; those of a sharp line fall as 1/m."""

BLURS = np.linspace(0.0, 0.5, 501)
"""Standard deviations of a Gaussian blur that are tried, periods; 0.5 leaves one per cent."""


def with_line_floor(phases: PhaseFrames, sample: Sample, known: Known) -> PhaseFrames:
    """The set with the ripple of its lines in its floor; unchanged for a cosine."""
    if phases.line_px is None:
        return phases
    fit = sample.fits.of(replace(phases, design=(), harmonics=()))
    pixels = usable(fit, known.limits)
    if not pixels.any():
        return phases
    free = len(phases.frames) - 3
    noise = free * known.noise.variance(fit.mean[pixels])
    residual = max(float(np.mean(fit.square[pixels] - noise)), 0.0)
    ripple = line_ripple(
        phases.line_px / phases.period_px,
        len(phases.frames),
        residual / float(np.mean(fit.power[pixels])),
    )
    return replace(phases, floor_rad=float(np.hypot(phases.floor_rad, ripple)))


def line_ripple(share: float, steps: int, residual: float) -> float:
    """Ripple of the phase of lines, rad rms.

    Parameters
    ----------
    share : float
        Width of a line, as a share of the period.
    steps : int
        Number N of equal steps.
    residual : float
        Mean sum of squared residuals of the fits, over the mean squared modulation.

    Notes
    -----
    A line has harmonics a_m = sin(π m w) / m for a share w, and a blur of σ periods takes
    exp(−2π² m² σ²) of them. Those of m ≡ ±1 modulo N are seen as the fundamental, and shift the
    phase by up to a_m / a_1. Those of m ≡ 0 are seen as background. The others leave residuals of
    N a_m² / 2 in a pixel.
    """
    power, own, left = _harmonics(share, steps)
    at = int(np.argmin(np.abs(left - residual)))
    return float(np.sqrt(0.5 * power[at, own][1:].sum() / power[at, 0]))


def sharp_residual(share: float, steps: int) -> float:
    """Mean sum of squared residuals of the fits to sharp lines, over the squared modulation: the
    most that lines leave without any fault. The parameters are those of ``line_ripple``."""
    return float(_harmonics(share, steps)[2][0])


def _harmonics(share: float, steps: int) -> tuple[FloatMap, NDArray[np.bool_], FloatMap]:
    """Power of the harmonics of a line by blur and order, the orders that are seen as the
    fundamental, and by blur the squared residuals over the squared modulation."""
    order = np.arange(1, PERIODS_OF_STEPS * steps)
    sharp = np.sin(np.pi * order * share) / order
    power: FloatMap = (sharp * np.exp(-0.5 * (TURN * BLURS[:, None] * order) ** 2)) ** 2
    folded = order % steps
    own = (folded == 1) | (folded == steps - 1)
    between = ~own & (folded != 0)
    left = 0.5 * steps * power[:, between].sum(axis=1) / power[:, own].sum(axis=1)
    return power, own, left


@lru_cache(maxsize=64)
def sharpest(phases: PhaseFrames) -> tuple[float, float]:
    """What sharp lines make without any fault: ripple, rad rms, and squared residuals of the fit,
    over the squared modulation; nothing of a cosine."""
    if phases.line_px is None:
        return 0.0, 0.0
    share, steps = phases.line_px / phases.period_px, len(phases.frames)
    residual = sharp_residual(share, steps)
    return line_ripple(share, steps, residual), residual
