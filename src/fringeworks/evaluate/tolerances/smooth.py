"""Smooth surfaces through noisy distances: as fine as the noise supports, with their posterior."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from fringeworks.evaluate.tolerances.likely import Likely, likely
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
FINE = 7
"""Number of the spline in ``LADDER`` that holds the surfaces where the area has points enough: 16
intervals, of which the likely lengths of form take what they need."""
ORDER = 4
"""Cubic splines: four of them overlap in each interval."""


@dataclass(frozen=True)
class Smooth:
    """A cubic spline over the unit square, with its posterior."""

    intervals: int
    likely: Likely
    """Of the coefficients, mm."""
    resolved: bool
    """False where what is left by the finest spline is alike in neighbours: the surface has edges,
    or its noise is not independent."""

    def design(self, places: FloatMap) -> FloatMap:
        """Return the derivative of the values at places (m, 2) by the coefficients, (m, p)."""
        return np.asarray(_design(places, self.intervals).toarray())

    def at(self, places: FloatMap) -> FloatMap:
        """Return the likely values at places (m, 2), (m,), mm."""
        return np.asarray(_design(places, self.intervals) @ self.likely.mean)


def smooth(
    places: FloatMap,
    values: FloatMap,
    variance: FloatMap,
    *,
    stated: bool,
    moves: FloatMap | None = None,
) -> Smooth:
    """Return the surfaces that are likely behind noisy values.

    Parameters
    ----------
    places : (n, 2) array
        In the unit square.
    values : (n,) array, mm
    variance : (n,) array
        Of the values' independent noise, up to a factor that is estimated, mm².
    stated : bool
        Whether the factor is known to be 1 or more.
    moves : (n, j) array, optional
        What motions and the size of the body do to the values: nothing is known of them before.

    Notes
    -----
    Tensor products of uniform cubic B-splines (Eilers & Marx, Flexible smoothing with B-splines and
    penalties, 1996). The finest spline tells the noise, so that a wrong stated noise does not turn
    noise into form. A coarser one is enough if no finer one lowers χ² by more than its further
    coefficients do on average, plus three standard deviations. One that is at least one step finer
    than that holds the surfaces, see ``likely``.
    """
    most = len(values) / VALUES_PER_COEFFICIENT
    rungs = [k for k in LADDER if k == 1 or (k + ORDER - 1) ** 2 <= most]
    sizes = [(k + ORDER - 1) ** 2 for k in rungs]
    left = [_left(places, values, 1.0 / variance, k) for k in rungs]
    squares = [float(one @ one) for one in left]
    level = squares[-1] / max(len(values) - sizes[-1], 1)

    def improved(one: int) -> bool:
        more = np.subtract(sizes[one + 1 :], sizes[one])
        gain = squares[one] - np.array(squares[one + 1 :])
        return bool(np.any(gain > level * (more + SURE * np.sqrt(2.0 * more))))

    last = len(rungs) - 1
    enough = next(i for i in range(len(rungs)) if not improved(i))
    used = max(min(enough + 1, last), min(FINE, last))
    level = max(level, 1.0) if stated else level
    design, normal, right = _equations(places, values, 1.0 / variance, rungs[used])
    rigid = np.zeros((len(right), 0))
    if moves is not None:
        sums = np.asarray(design.T @ (moves / variance[:, None]))
        rigid = np.linalg.solve(normal + _stiff(normal, rungs[used]), sums)
    found = likely(normal / level, right / level, rungs[used] + ORDER - 1, rigid)
    return Smooth(rungs[used], found, resolved=_independent(left[min(enough + 1, last)]))


def _equations(
    places: FloatMap, values: FloatMap, weights: FloatMap, intervals: int
) -> tuple[scipy.sparse.csr_matrix, FloatMap, FloatMap]:
    """The tensor products at places, and both sides of the equations of least squares."""
    design = _design(places, intervals)
    normal = (design.T @ design.multiply(weights[:, None])).toarray()
    return design, normal, np.asarray(design.T @ (weights * values))


def _stiff(normal: FloatMap, intervals: int) -> FloatMap:
    """What holds coefficients without data, beside the equations."""
    side = intervals + ORDER - 1
    bend = np.diff(np.eye(side), 2, axis=0)
    bend = bend.T @ bend
    found = np.kron(bend, np.eye(side)) + np.kron(np.eye(side), bend)
    found *= STIFFNESS * np.trace(normal) / len(normal)
    found[np.diag_indices_from(found)] += np.finfo(float).eps * len(normal) * np.diag(normal)
    return np.asarray(found)


def _left(places: FloatMap, values: FloatMap, weights: FloatMap, intervals: int) -> FloatMap:
    """What the spline of least squares leaves of the values, over their noise."""
    design, normal, right = _equations(places, values, weights, intervals)
    normal += _stiff(normal, intervals)
    return np.asarray(np.sqrt(weights) * (values - design @ np.linalg.solve(normal, right)))


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
