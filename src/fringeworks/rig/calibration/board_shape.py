"""Where the points of a real board are: bow, print and flatness errors with their own priors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fringeworks.types import FloatMap, Frozen

HIGHEST_DEGREE = 4
"""Highest degree of smooth errors of a board along its sides together."""
BOW_SIZE = 3
"""Number of bow coefficients: of x², x y and y²."""
SMOOTH_DEGREES = tuple((k - j, j) for k in range(2, HIGHEST_DEGREE + 1) for j in range(k + 1))
"""Degrees of smooth errors along both sides of the board."""
SMOOTH_KINDS = tuple(
    (axis, i, j) for axis in range(3) for i, j in SMOOTH_DEGREES if axis < 2 or i + j > 2
)
"""Axis and degrees of every smooth error beside the bow, which is that of degree 2 across."""
SMOOTH_SIZE = len(SMOOTH_KINDS)
"""Number of their coefficients."""
SMOOTH_GROUPS = tuple(
    np.array([(axis == 2) == across and i + j == degree for axis, i, j in SMOOTH_KINDS])
    for across in (False, True)
    for degree in range(3 if across else 2, HIGHEST_DEGREE + 1)
)
"""Those of a degree, within the board's plane and across it, have one standard deviation."""
SHAPE_SIZE = BOW_SIZE + SMOOTH_SIZE
"""Number of coefficients of smooth errors of all kinds."""
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
LEAST_REST = 1e-6
"""Root mean square below which what lower degrees leave of a polynomial, ±1 over the board, is
rounding."""
TINY_MM = 1e-9
"""Extent of a board along a side where it has one row of points only."""
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
    smooth_mm: tuple[float, ...]
    """Of every coefficient of each of ``SMOOTH_GROUPS``."""

    def precision(self, points: int) -> FloatMap:
        """1/σ² of all coefficients and of all offsets, (k + 3 points,), 1/mm²."""
        of_point = np.array([self.print_mm, self.print_mm, self.flat_mm]) ** -2.0
        smooth = np.transpose(SMOOTH_GROUPS) @ self.smooth_mm
        of_shape = np.concatenate((np.full(BOW_SIZE, self.bow_mm), smooth)) ** -2.0
        return np.concatenate((of_shape, np.tile(of_point, points)))


@dataclass(frozen=True, eq=False, repr=False)
class BoardShape(Frozen):
    """By how much the points of a board are off their nominal places."""

    bow_mm: FloatMap
    """Coefficients of x², x y, y², (3,), mm, with x and y from the board's middle, scaled to ±1 at
    half the board's longer side."""
    smooth_mm: FloatMap
    """Coefficients of the other smooth errors, mm; see ``smooth_modes``."""
    offset_mm: FloatMap
    """Of every point of the board, (points, 3), mm; 0 where it was never seen."""


def first_prior(points_mm: FloatMap) -> BoardPrior:
    """Return a prior to start from, for corners (n, 3) of a board in mm."""
    pitch = _pitch_mm(points_mm)
    first = FIRST_SHARE * pitch
    return BoardPrior(first, first, BOW_SHARE * _half_mm(points_mm), (first,) * len(SMOOTH_GROUPS))


def estimated_prior(
    before: BoardPrior,
    shape: BoardShape,
    variance: FloatMap,
    smooth_variance: FloatMap | None,
    points_mm: FloatMap,
) -> BoardPrior:
    """Estimate the standard deviations of print and flatness from the errors that were found.

    Parameters
    ----------
    before : BoardPrior
        With which the shape was estimated.
    shape : BoardShape
    variance : (points, 3) array
        Variances of the estimated offsets, mm².
    smooth_variance : array or None
        The same of the smooth errors; None where these were not estimated.
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

    def sigma(errors: FloatMap, variance: FloatMap, was: float) -> float:
        x2 = float(np.sum(errors**2))
        share = float(np.mean(1.0 - variance / was**2))
        if share < MIN_DETERMINED or x2 == 0.0:
            return max(was * float(np.exp(-MAX_LOG_STEP)), least)
        ratio = x2 / (share * variance.size * was**2)
        step = 0.5 * np.log(ratio) / share
        return max(was * float(np.exp(np.clip(step, -MAX_LOG_STEP, MAX_LOG_STEP))), least)

    offset = shape.offset_mm
    found = replace(
        before,
        print_mm=sigma(offset[:, :2], variance[:, :2], before.print_mm),
        flat_mm=sigma(offset[:, 2], variance[:, 2], before.flat_mm),
    )
    if smooth_variance is None:
        return found
    smooth = (
        sigma(shape.smooth_mm[group], smooth_variance[group], was)
        for group, was in zip(SMOOTH_GROUPS, before.smooth_mm, strict=True)
    )
    return replace(found, smooth_mm=tuple(smooth))


def heights_of(points_mm: FloatMap, all_points_mm: FloatMap) -> FloatMap:
    """Return x², x y and y² of points (n, 3) in scaled coordinates, (n, 3); see ``BoardShape``."""
    low, high = all_points_mm.min(axis=0), all_points_mm.max(axis=0)
    x, y = ((points_mm - 0.5 * (low + high)) / _half_mm(all_points_mm))[:, :2].T
    return np.stack((x * x, x * y, y * y), axis=1)


def smooth_modes(points_mm: FloatMap) -> FloatMap:
    """Displacements of all corners (n, 3) by each of ``SMOOTH_KINDS``, (n, 3, s).

    They are polynomials with a mean square of 1 that are orthogonal over the points of the board:
    together they neither move nor turn, stretch or shear it. Those that the points cannot tell from
    lower degrees are 0.
    """
    places, of_corner = np.unique(points_mm, axis=0, return_inverse=True)
    low, high = places[:, :2].min(axis=0), places[:, :2].max(axis=0)
    x, y = ((2.0 * places[:, :2] - low - high) / np.maximum(high - low, TINY_MM)).T
    known: list[FloatMap] = []
    for i, j in ((0, 0), (1, 0), (0, 1), *SMOOTH_DEGREES):
        rest = x**i * y**j
        for _ in range(2):  # once more for rounding
            rest = rest - sum((np.mean(one * rest) * one for one in known), np.zeros_like(rest))
        size = float(np.sqrt(np.mean(rest**2)))
        known.append(rest / size if size > LEAST_REST else np.zeros_like(rest))
    by_degrees = dict(zip(SMOOTH_DEGREES, known[3:], strict=True))
    found = np.zeros((len(places), 3, SMOOTH_SIZE))
    for k, (axis, i, j) in enumerate(SMOOTH_KINDS):
        found[:, axis, k] = by_degrees[i, j]
    return found[of_corner.ravel()]


def _half_mm(points_mm: FloatMap) -> float:
    return 0.5 * float(np.max(np.ptp(points_mm, axis=0)))


def _pitch_mm(points_mm: FloatMap) -> float:
    """Usual distance of neighbouring points: from the area that they span."""
    places = np.unique(points_mm, axis=0)
    return 2.0 * _half_mm(points_mm) / max(float(np.sqrt(len(places))) - 1.0, 1.0)
