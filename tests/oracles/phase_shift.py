"""Readable twin of the decoder: least squares per set and the most likely fringe orders."""

from __future__ import annotations

import numpy as np

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
