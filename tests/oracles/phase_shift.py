"""Readable twin of the decoder: least squares per set and the most likely fringe orders."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from fringeworks import PatternPlan

STEP_PX = 0.02
"""Distance of the coordinates that are tried, px; small against the shortest period."""


def fit(samples: np.ndarray, shifts: np.ndarray, limit: float) -> tuple[float, float, float]:
    """Phase (rad), modulation (counts) and the phase's variance for noise of one count."""
    kept = samples < limit
    if kept.sum() < 3:
        return np.nan, np.nan, np.nan
    design = np.column_stack((np.ones(kept.sum()), np.cos(shifts[kept]), np.sin(shifts[kept])))
    _, c, s = np.linalg.lstsq(design, samples[kept], rcond=None)[0]
    covariance = np.linalg.inv(design.T @ design)[1:, 1:]
    across = np.array([-s, c]) / (c * c + s * s)
    return float(np.arctan2(s, c)), float(np.hypot(c, s)), float(across @ covariance @ across)


def fit_with_harmonics(
    samples: np.ndarray, shifts: np.ndarray, shares: np.ndarray, limit: float
) -> tuple[float, float]:
    """Phase (rad) and its variance for noise of one count, of fringes with harmonics 2, 3, 4.

    ``shares`` (N, 6) are those of B cos kφ and B sin kφ in every frame. A saturated sample was at
    least at the limit.
    """
    design = np.column_stack((np.ones(samples.size), np.cos(shifts), np.sin(shifts)))
    value, kept = np.minimum(samples, limit), samples < limit

    def left(found: np.ndarray) -> np.ndarray:
        phase, modulation = np.arctan2(found[2], found[1]), np.hypot(found[1], found[2])
        parts = [part(k * phase) for k in (2, 3, 4) for part in (np.cos, np.sin)]
        off = value - design @ found - modulation * (shares @ np.array(parts))
        return np.where(kept, off, np.maximum(off, 0.0))

    start = np.linalg.lstsq(design, value, rcond=None)[0]
    best = least_squares(left, start, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    _, c, s = best.x
    across = np.array([0.0, -s, c]) / (c * c + s * s)
    covariance = np.linalg.inv(best.jac.T @ best.jac)
    return float(np.arctan2(s, c)), float(across @ covariance @ across)


def decode_pixel(
    samples: np.ndarray, plan: PatternPlan, variance: float, limit: float
) -> tuple[float, float]:
    """Coordinate along x and its standard deviation, by trying all coordinates of the projector."""
    phases, precision, frequency = [], [], []
    for first, block in plan.phase_sets("x"):
        part = samples[first : first + block.frames].astype(float)
        phase, _, unit = fit(part, np.asarray(block.shifts_rad), limit)
        phases.append(phase)
        precision.append(1.0 / (unit * variance))
        frequency.append(2.0 * np.pi / block.period_px)
    if not np.isfinite(phases).all():
        return np.nan, np.nan
    phases, weight, frequency = np.array(phases), np.array(precision), np.array(frequency)
    places = np.arange(-0.5, plan.width_px - 0.5, STEP_PX)
    off = np.angle(np.exp(1j * (phases[:, None] - frequency[:, None] * places)))
    best = places[np.argmin(weight @ off**2)]
    rest = np.angle(np.exp(1j * (phases - frequency * best)))
    information = weight @ frequency**2
    return float(best + (weight * frequency) @ rest / information), float(information**-0.5)
