"""Smooth surfaces through noisy distances: as fine as the noise supports, with their covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from fringeworks.types import FloatMap

LADDER = (1, 2, 3, 4, 6, 8, 11, 16, 22, 32)
"""Intervals of the splines along each side of an area, from the coarsest to the finest."""
VALUES_PER_COEFFICIENT = 4
"""Smallest number of values for each coefficient: the residuals then still tell the noise."""
SURE = 3.0
"""Standard deviations of χ² by which a finer spline must fit better: a chance of 0.1 %."""
STIFFNESS = 1e-3
"""Weight of second differences of the coefficients, relative to a coefficient's own data. It holds
coefficients without data, and changes others by less than a thousandth."""
ORDER = 4
"""Cubic splines: four of them overlap in each interval."""


@dataclass(frozen=True)
class Smooth:
    """A cubic spline over the unit square."""

    intervals: int
    coefficients: FloatMap
    """(p,), mm."""
    root: FloatMap
    """Independent parts of their error, (p, p), mm: its product with its transpose is the
    covariance."""
    unseen: float
    """Largest variance of form that the choice of the intervals cannot see, over that of the
    noise of the values."""
    resolved: bool
    """False where what is left by the finest spline is alike in neighbours: the surface has edges,
    or its noise is not independent."""

    def design(self, places: FloatMap) -> FloatMap:
        """Return the derivative of the values at places (m, 2) by the coefficients, (m, p)."""
        return np.asarray(_design(places, self.intervals).toarray())

    def at(self, places: FloatMap) -> FloatMap:
        """Return the values at places (m, 2), (m,), mm."""
        return np.asarray(_design(places, self.intervals) @ self.coefficients)


def smooth(places: FloatMap, values: FloatMap, variance: FloatMap, *, stated: bool) -> Smooth:
    """Fit the coarsest spline that no finer one improves by more than noise explains.

    Parameters
    ----------
    places : (n, 2) array
        In the unit square.
    values : (n,) array, mm
    variance : (n,) array
        Of the values' independent noise, up to a factor that is estimated, mm².
    stated : bool
        Whether the factor is known to be 1 or more.

    Notes
    -----
    Tensor products of uniform cubic B-splines (Eilers & Marx, Flexible smoothing with B-splines and
    penalties, 1996). The finest spline tells the noise, so that a wrong stated noise does not turn
    noise into form. A coarser one is taken if each finer one lowers χ² by no more than its further
    coefficients do on average, plus three standard deviations. Its next finer one is used: what
    the choice cannot see is then small beside the noise that is left.
    """
    most = len(values) / VALUES_PER_COEFFICIENT
    rungs = [k for k in LADDER if k == 1 or (k + ORDER - 1) ** 2 <= most]
    fits = [_fit(places, values, 1.0 / variance, k) for k in rungs]
    freedom = len(values) - (rungs[-1] + ORDER - 1) ** 2
    level = float(fits[-1][1] @ fits[-1][1]) / max(freedom, 1)
    squares = [float(fit[1] @ fit[1]) for fit in fits]
    sizes = [(k + ORDER - 1) ** 2 for k in rungs]

    def improves(one: int, other: int) -> bool:
        more = sizes[other] - sizes[one]
        return bool(squares[one] - squares[other] > level * (more + SURE * np.sqrt(2.0 * more)))

    finer = range(len(rungs))
    chosen = next(i for i in finer if not any(improves(i, j) for j in finer[i + 1 :]))
    used = min(chosen + 1, len(rungs) - 1)
    coefficients, left, normal = fits[used]
    unseen = SURE * np.sqrt(2.0 * (sizes[-1] - sizes[used])) / sizes[used]
    noise = np.sqrt(max(level, 1.0) if stated else level)
    lower = np.linalg.cholesky(normal)
    root = noise * scipy.linalg.solve_triangular(lower, np.eye(len(normal)), lower=True).T
    return Smooth(rungs[used], coefficients, root, float(unseen), resolved=_independent(left))


def _fit(
    places: FloatMap, values: FloatMap, weights: FloatMap, intervals: int
) -> tuple[FloatMap, FloatMap, FloatMap]:
    """Coefficients, residuals over their noise, and the matrix of the equations."""
    design = _design(places, intervals)
    normal = (design.T @ design.multiply(weights[:, None])).toarray()
    side = intervals + ORDER - 1
    bend = np.diff(np.eye(side), 2, axis=0)
    bend = bend.T @ bend
    stiff = STIFFNESS * np.trace(normal) / len(normal)
    normal += stiff * (np.kron(bend, np.eye(side)) + np.kron(np.eye(side), bend))
    normal[np.diag_indices_from(normal)] *= 1.0 + np.finfo(float).eps * len(normal)
    coefficients = np.linalg.solve(normal, design.T @ (weights * values))
    return coefficients, np.sqrt(weights) * (values - design @ coefficients), normal


def _independent(left: FloatMap) -> bool:
    """Whether residuals are not like those of the next value in the order of the pixels."""
    size = float(left @ left)
    alike = float(left[1:] @ left[:-1]) / size if size > 0 else 0.0
    return bool(alike * np.sqrt(len(left)) < SURE)


def _design(places: FloatMap, intervals: int) -> scipy.sparse.csr_matrix:
    """The tensor products of splines at places of the unit square, (n, p)."""
    side = intervals + ORDER - 1
    (rows, first), (columns, second) = (_splines(places[:, k], intervals) for k in range(2))
    index = (rows[:, :, None] * side + columns[:, None, :]).reshape(len(places), -1)
    value = (first[:, :, None] * second[:, None, :]).reshape(len(places), -1)
    start = np.arange(len(places) + 1) * ORDER**2
    return scipy.sparse.csr_matrix((value.ravel(), index.ravel(), start), (len(places), side**2))


def _splines(x: FloatMap, intervals: int) -> tuple[FloatMap, FloatMap]:
    """Numbers and values of the four cubic splines that overlap at each place, (n, 4)."""
    at = np.clip(x, 0.0, 1.0) * intervals
    first = np.minimum(at.astype(int), intervals - 1)
    f = at - first
    g = 1.0 - f
    parts = (g**3, 3 * f**3 - 6 * f**2 + 4, 3 * g**3 - 6 * g**2 + 4, f**3)
    return first[:, None] + np.arange(ORDER), np.stack(parts, axis=-1) / 6.0
