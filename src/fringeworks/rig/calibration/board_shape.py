"""Where the points of a real board are: bow, print and flatness errors with their own priors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fringeworks.types import FloatMap, Frozen

BOW_SIZE = 3
"""Number of bow coefficients: of x², x y and y²."""
OFFSET_SIZE = 3
"""Number of coordinates by which a point of the board is off."""
BOW_SHARE = 0.03
"""Standard deviation of the bow's prior, over half the board's size. Sheets of paper on cardboard
bend by 1 % or less, so the prior hardly restricts the bow; it keeps it finite where the poses do
not determine it."""
FIRST_SHARE = 1e-3
"""Standard deviation of print and flatness to start from, over the board's pitch: 0.01 mm on
squares of 10 mm. It is estimated from the residuals afterwards."""
MIN_SHARE = 1e-6
"""Lower bound on these standard deviations, over the board's pitch: below any real board, far above
rounding."""
MIN_DETERMINED = 1e-3
"""Share of the offsets that the data determine below which no offsets are seen: the standard
deviation then falls towards its lower bound."""
MAX_LOG_STEP = 1.5
"""Largest change of a standard deviation's logarithm in one round, a factor of 4.5, so that a first
estimate far from the minimum does not throw it away."""


@dataclass(frozen=True)
class BoardPrior:
    """Standard deviations by which a board's points are off their nominal places, mm."""

    print_mm: float
    """Of every point within the board's plane, per coordinate."""
    flat_mm: float
    """Of every point across the board's plane, beside the bow."""
    bow_mm: float
    """Of every bow coefficient."""

    def precision(self, points: int) -> FloatMap:
        """1/σ² of the bow coefficients and of all offsets, (3 + 3 points,), 1/mm²."""
        of_point = np.array([self.print_mm, self.print_mm, self.flat_mm]) ** -2.0
        return np.concatenate((np.full(BOW_SIZE, self.bow_mm**-2.0), np.tile(of_point, points)))


@dataclass(frozen=True, eq=False, repr=False)
class BoardShape(Frozen):
    """By how much the points of a board are off their nominal places."""

    bow_mm: FloatMap
    """Coefficients of x², x y, y², (3,), mm, with x and y from the board's middle, scaled to ±1 at
    half the board's longer side."""
    offset_mm: FloatMap
    """Of every point of the board, (points, 3), mm; 0 where it was never seen."""


def first_prior(points_mm: FloatMap) -> BoardPrior:
    """Return a prior to start from, for corners (n, 3) of a board in mm."""
    pitch = _pitch_mm(points_mm)
    return BoardPrior(FIRST_SHARE * pitch, FIRST_SHARE * pitch, BOW_SHARE * _half_mm(points_mm))


def estimated_prior(
    before: BoardPrior, offset_mm: FloatMap, variance: FloatMap, points_mm: FloatMap
) -> BoardPrior:
    """Estimate the standard deviations of print and flatness from the estimated offsets.

    Parameters
    ----------
    before : BoardPrior
        With which the offsets were estimated.
    offset_mm : (points, 3) array, mm
    variance : (points, 3) array
        Variances of the estimated offsets, mm².
    points_mm : (n, 3) array
        Corners of the board, mm.

    Notes
    -----
    The fixed point is σ² = Σ x² / γ with γ = Σ (1 − v/σ₀²), the number of offsets that the data
    determine rather than the prior σ₀ (MacKay, Neural Computation 4, 1992,
    doi:10.1162/neco.1992.4.3.415). With a = γ/n, the logarithm of Σ x² / (γ σ₀²) falls by a when
    that of σ₀² rises by one, so a Newton step divides it by a; the plain iteration would hardly
    move where noise is larger than the offsets.
    """
    least = MIN_SHARE * _pitch_mm(points_mm)

    def sigma(columns: slice, was: float) -> float:
        x2 = float(np.sum(offset_mm[:, columns] ** 2))
        share = float(np.mean(1.0 - variance[:, columns] / was**2))
        if share < MIN_DETERMINED or x2 == 0.0:
            return max(was * float(np.exp(-MAX_LOG_STEP)), least)
        ratio = x2 / (share * variance[:, columns].size * was**2)
        step = 0.5 * np.log(ratio) / share
        return max(was * float(np.exp(np.clip(step, -MAX_LOG_STEP, MAX_LOG_STEP))), least)

    return BoardPrior(
        sigma(slice(0, 2), before.print_mm), sigma(slice(2, 3), before.flat_mm), before.bow_mm
    )


def heights_of(points_mm: FloatMap, all_points_mm: FloatMap) -> FloatMap:
    """Return x², x y and y² of points (n, 3) in scaled coordinates, (n, 3); see ``BoardShape``."""
    low, high = all_points_mm.min(axis=0), all_points_mm.max(axis=0)
    x, y = ((points_mm - 0.5 * (low + high)) / _half_mm(all_points_mm))[:, :2].T
    return np.stack((x * x, x * y, y * y), axis=1)


def _half_mm(points_mm: FloatMap) -> float:
    return 0.5 * float(np.max(np.ptp(points_mm, axis=0)))


def _pitch_mm(points_mm: FloatMap) -> float:
    """Usual distance of neighbouring points: from the area that they span."""
    places = np.unique(points_mm, axis=0)
    return 2.0 * _half_mm(points_mm) / max(float(np.sqrt(len(places))) - 1.0, 1.0)
