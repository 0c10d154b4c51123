"""Statistics of a sample of pixels, with NumPy and sorting: twins of the kernels of ``sample/``."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

TRIMMED = 0.9995


def solve(values, rows) -> tuple[np.ndarray, np.ndarray]:
    """Fit of a set of steps at every pixel, (3, n), and the sums of squared residuals, (n,)."""
    design = np.asarray(rows)
    fitted = np.linalg.pinv(design) @ values
    return fitted, np.sum((values - design @ fitted) ** 2, axis=0)


def residual_variance(square, freedom) -> float:
    """Variance of residuals: three steps of the mean below a quantile, from the median."""
    variance = np.median(square) / chi2.ppf(0.5, freedom)
    limit = chi2.ppf(TRIMMED, freedom)
    share = chi2.cdf(limit, freedom + 2) / TRIMMED
    for _ in range(3):
        if variance > 0:
            variance = np.mean(square[square <= variance * limit]) / (freedom * share)
    return float(variance)


def similar_groups(key, count) -> list[np.ndarray]:
    """Indices of groups of equal size, from the smallest keys to the largest."""
    return np.array_split(np.argsort(key, kind="stable"), count)


def gram(rows) -> np.ndarray:
    """Sums of the products of all pairs of rows."""
    return rows @ rows.T


def second_magnitudes(frame) -> np.ndarray:
    return np.abs(np.diff(np.diff(frame, 2, axis=0), 2, axis=1))


def third_chi_squares(coordinate, sigma, most) -> np.ndarray:
    """χ² of the third differences along rows that are known and not larger than ``most``."""
    variance = sigma**2
    x, v = (
        [values[:, k : coordinate.shape[1] - 3 + k] for k in range(4)]
        for values in (coordinate, variance)
    )
    difference = x[0] - 3.0 * x[1] + 3.0 * x[2] - x[3]
    expected = v[0] + 9.0 * v[1] + 9.0 * v[2] + v[3]
    with np.errstate(invalid="ignore"):
        known = np.abs(difference) < most
    return (difference**2 / expected)[known]


def phase_residuals(coordinate, background, used, phase, modulation, period, variance, noise):
    """Phases less those of the coordinate, turns, and their variances by noise, turns²."""
    rest = phase[used].astype(float) / (2.0 * np.pi) - coordinate[used].astype(float) / period
    by_noise = noise.variance(background[used].astype(float))
    return rest - np.rint(rest), variance * by_noise / modulation[used].astype(float) ** 2


def smooth_windows(turns, usable, fringes, least, most, windows, jump):
    """Unwrapped phases of windows without edges, rad, and the indices of their pixels; or None."""
    slope = np.diff(turns, axis=1)
    slope -= np.rint(slope)
    good = usable[:, 1:] & usable[:, :-1]
    if good.sum() < least * windows[0]:
        return None
    per_pixel = abs(float(np.median(slope[good])))
    lines, length = turns.shape
    if per_pixel * length < fringes:
        return None
    span = max(least, int(np.ceil(fringes / per_pixel)))
    stride = -(-span // most)
    starts = np.arange(0, length - span + 1, max(1, span // 2))
    fault = ~usable
    fault[:, 1:-1] |= np.abs(np.diff(slope, axis=1)) > jump
    before = np.zeros((lines, length + 1))
    np.cumsum(fault, axis=1, out=before[:, 1:])
    row, which = np.nonzero(before[:, starts + span] == before[:, starts])
    if row.size < windows[0]:
        return None
    chosen = np.linspace(0, row.size - 1, min(row.size, windows[1])).astype(int)
    columns = starts[which[chosen]][:, None] + stride * np.arange(-(-span // stride))
    columns = np.minimum(columns, length - 1)
    rows = row[chosen][:, None]
    unwrapped = np.zeros((lines, length))
    np.cumsum(slope, axis=1, out=unwrapped[:, 1:])
    start = turns[rows[:, 0], columns[:, 0]] - unwrapped[rows[:, 0], columns[:, 0]]
    return 2.0 * np.pi * (unwrapped[rows, columns] + start[:, None]), rows * length + columns


def shapes(phase, orders) -> np.ndarray:
    """Cosine and sine of the harmonics of phases, one pair per order along the last axis."""
    pairs = [(np.cos(k * phase), np.sin(k * phase)) for k in orders]
    return np.stack([wave for pair in pairs for wave in pair], axis=-1)


def window_sums(phase, orders):
    """Sums of the harmonics' products and the phases, without the cubic part of either."""
    basis, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, phase.shape[1]), 4))
    outside = np.eye(phase.shape[1]) - basis @ basis.T
    errors = phase @ outside
    design = np.einsum("lm,wmp->wlp", outside, shapes(phase - errors, orders))
    return (
        np.einsum("wlp,wlq->wpq", design, design),
        np.einsum("wlp,wl->wp", design, errors),
        np.sum(errors**2, axis=1),
    )


def set_waves(phase, orders) -> np.ndarray:
    """Cosine and sine of the orders of every set, a row each; ``phase`` has a row per set."""
    pairs = zip(phase, orders, strict=True)
    return np.concatenate([shapes(row, of_set).T for row, of_set in pairs])


def ripple_sums(phase, orders, values) -> np.ndarray:
    """Sums of the products of all pairs of the waves, of the values, and of ones."""
    return gram(np.vstack((set_waves(phase, orders), values, np.ones((1, phase.shape[1])))))


def ripple_values(phase, orders, coefficients) -> np.ndarray:
    """The ripple of every set."""
    waves = np.asarray(coefficients)[:, None] * set_waves(phase, orders)
    ends = np.cumsum([2 * len(of_set) for of_set in orders])[:-1]
    return np.stack([part.sum(axis=0) for part in np.split(waves, ends)])


def ripple_scores(phase, orders, factors, mean, group) -> np.ndarray:
    """Products of the scores: sums over groups of the waves less their mean times the factors."""
    own = np.repeat(factors, [2 * len(of_set) for of_set in orders], axis=0)
    scores = (set_waves(phase, orders) - mean[:, None]) * own
    return gram(np.stack([scores[:, group == k].sum(axis=1) for k in np.unique(group)], axis=1))


def column_harmonics(phase, used, orders) -> tuple[np.ndarray, np.ndarray]:
    """Sums of the waves of used pixels: by column, and those of the first order by row."""
    waves = np.moveaxis(shapes(phase.astype(float), orders), -1, 0) * used
    return waves.sum(axis=1), waves[:2].sum(axis=2)
