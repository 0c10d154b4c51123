"""Where a projector's columns light space, found from points that cameras measured without it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from fringeworks.statistics.quantiles import robust_sigma
from fringeworks.types import BoolMap, FloatMap

SAMPLES = 4000
"""Approximate number of points that are fitted: 16 parameters are then known to a hundredth of the
scatter of a point wherever there are points."""
ROUNDS = 4
"""Rounds of the fit. The first weights are those of a projector far away; later ones do not change
in the third digit. Each leaves out what the one before found far off."""
OUTLIER_SIGMAS = 5.0
"""Points that are further off, in robust standard deviations, are left out of the next round."""
RIDGE = 1e-9
"""Squared length, in normalised units, that parameters hold which the points do not determine, as
on a plane: below rounding of the coordinates, above that of the sums."""
MIN_POINTS = 200
"""Smallest number of points for a fit: with fewer, nothing is said."""


@dataclass(frozen=True, eq=False)
class LightSheets:
    """A projector's coordinate as a function of the place, along one axis.

    A pinhole has q = (a · X + b) / (c · X + 1); a quadratic polynomial of X beside it holds what a
    lens adds.
    """

    middle: FloatMap
    """Of the points, (3,), mm."""
    size: float
    """Half of their extent, mm."""
    ratio: FloatMap
    """a, b and c in normalised coordinates, (7,)."""
    bend: FloatMap
    """Coefficients of the polynomial, (10,)."""
    scatter_px: float
    """Robust standard deviation of coordinates less these, px: noise, and what the model lacks."""
    unknown: FloatMap
    """Inverse of the normal matrix of all parameters, (17, 17): with ``scatter_px`` squared their
    covariance."""

    @classmethod
    def fit(cls, points_mm: FloatMap, coordinate_px: FloatMap) -> Self | None:
        """Fit to points (n, 3) and their coordinates (n,); None for too few."""
        if len(points_mm) < MIN_POINTS:
            return None
        part = slice(None, None, max(1, len(points_mm) // SAMPLES))
        points, goal = points_mm[part], coordinate_px[part]
        middle = np.median(points, axis=0)
        size = float(np.quantile(np.abs(points - middle), 0.9)) or 1.0
        found = None
        kept: BoolMap = np.ones(len(goal), bool)
        ratio: FloatMap = np.zeros(7)
        for _ in range(ROUNDS):
            x = (points[kept] - middle) / size
            ratio = _ratio(x, goal[kept], ratio[4:])
            design, q = _design(x, ratio)
            unknown = _inverse(design)
            bent = design[:, len(ratio) :]
            bend = _inverse(bent) @ (bent.T @ (goal[kept] - q))
            found = cls(middle, size, ratio, bend, 0.0, unknown)
            off = goal - found.at(points)
            scatter = robust_sigma(off[kept])
            found = cls(middle, size, ratio, bend, scatter, unknown)
            kept = np.asarray(np.abs(off) <= OUTLIER_SIGMAS * max(scatter, np.finfo(float).tiny))
            if kept.sum() < MIN_POINTS:
                return None
        return found

    def at(self, points_mm: FloatMap) -> FloatMap:
        """The coordinate that lights points (n, 3), (n,), px."""
        x = (points_mm - self.middle) / self.size
        design, q = _design(x, self.ratio)
        return np.asarray(q + design[:, len(self.ratio) :] @ self.bend)

    def sigma_px(self, points_mm: FloatMap) -> FloatMap:
        """Standard deviation of a coordinate less that of ``at``, (n,), px."""
        design, _ = _design((points_mm - self.middle) / self.size, self.ratio)
        leverage = np.einsum("ni,ij,nj->n", design, self.unknown, design)
        return np.asarray(self.scatter_px * np.sqrt(1.0 + np.maximum(leverage, 0.0)))


def _inverse(design: FloatMap) -> FloatMap:
    """Inverse of the normal matrix, with what the points do not determine held."""
    return np.linalg.inv(design.T @ design + RIDGE * len(design) * np.eye(design.shape[1]))


def _ratio(x: FloatMap, goal: FloatMap, before: FloatMap) -> FloatMap:
    """a, b, c of q (c · x + 1) = a · x + b, with the weights of the round before."""
    weight = 1.0 / np.maximum(1.0 + x @ before, 0.1)
    design = np.column_stack((x, np.ones(len(x)), -goal[:, None] * x)) * weight[:, None]
    scale = np.linalg.norm(design, axis=0)
    scale[scale == 0] = 1.0
    scaled = design / scale
    normal = scaled.T @ scaled + RIDGE * np.eye(7)
    return np.asarray(np.linalg.solve(normal, scaled.T @ (goal * weight)) / scale)


def _design(x: FloatMap, ratio: FloatMap) -> tuple[FloatMap, FloatMap]:
    """Derivative of the coordinate by all parameters (n, 17), and that of the pinhole (n,)."""
    below = np.maximum(1.0 + x @ ratio[4:], 0.1)
    q = (x @ ratio[:3] + ratio[3]) / below
    ones = np.ones((len(x), 1))
    by_ratio = np.concatenate((x, ones, -q[:, None] * x), axis=1) / below[:, None]
    squares = np.stack([x[:, i] * x[:, j] for i in range(3) for j in range(i + 1)], axis=1)
    return np.concatenate((by_ratio, ones, x, squares), axis=1), q
