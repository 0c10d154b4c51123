"""Smooth surfaces through noisy distances: as fine as the noise supports, with their posterior."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.evaluate.tolerances.likely import Likely, likely
from fringeworks.evaluate.tolerances.neighbours import Neighbours
from fringeworks.evaluate.tolerances.splines import FINE, LADDER, ORDER, design_of
from fringeworks.types import FloatMap

VALUES_PER_COEFFICIENT = 4
"""Smallest number of values for each coefficient: the residuals then still tell the noise."""
SURE = 3.0
"""Standard deviations of χ² by which a finer spline must fit better: a chance of 0.1 %."""
STIFFNESS = 1e-3
"""Weight of second differences of the coefficients, relative to a coefficient's own data. It holds
coefficients without data, and changes others by less than a thousandth."""


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
        return np.asarray(design_of(places, self.intervals).toarray())

    def at(self, places: FloatMap) -> FloatMap:
        """Return the likely values at places (m, 2), (m,), mm."""
        return np.asarray(design_of(places, self.intervals) @ self.likely.mean)


def smooth(
    places: FloatMap,
    values: FloatMap,
    variance: FloatMap,
    *,
    stated: bool,
    moves: FloatMap | None = None,
    shared: Neighbours | None = None,
    pixel: NDArray[np.intp] | None = None,
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
    shared : Neighbours, optional
        Noise that neighbours share; independent noise otherwise.
    pixel : (n, 2) array, optional
        Rows and columns of the values that share it. None for means of pixels, which are wider
        than the noise.

    Notes
    -----
    Tensor products of uniform cubic B-splines (Eilers & Marx, Flexible smoothing with B-splines and
    penalties, 1996). The finest spline tells the noise, so that a wrong stated noise does not turn
    noise into form. A coarser one is enough if no finer one lowers χ² by more than its further
    coefficients do on average, plus three standard deviations. One that is at least one step finer
    than that holds the surfaces, see ``likely``.

    The coefficients of least squares have the covariance N⁻¹ S N⁻¹, with S that of the sums on the
    right side. Independent noise has S = N times its variance. Noise that neighbours share has
    more.
    """
    rungs, left = _ladder(places, values, 1.0 / variance)
    sizes = [(k + ORDER - 1) ** 2 for k in rungs]
    squares = [float(one @ one) for one in left]
    level = squares[-1] / max(len(values) - sizes[-1], 1)
    if shared is not None:
        # A mean over many pixels has this variance: the largest that a coefficient may have.
        level = shared.factor * shared.total

    def improved(one: int) -> bool:
        more = np.subtract(sizes[one + 1 :], sizes[one])
        gain = squares[one] - np.array(squares[one + 1 :])
        return bool(np.any(gain > level * (more + SURE * np.sqrt(2.0 * more))))

    last = len(rungs) - 1
    enough = next(i for i in range(len(rungs)) if not improved(i))
    used = max(min(enough + 1, last), min(FINE, last))
    design, normal, right = _equations(places, values, 1.0 / variance, rungs[used])
    rigid = np.zeros((len(right), 0))
    if moves is not None:
        sums = np.asarray(design.T @ (moves / variance[:, None]))
        rigid = np.linalg.solve(normal + _stiff(normal, rungs[used]), sums)
    if shared is not None and pixel is not None:
        weighted = scipy.sparse.csr_matrix(design.multiply(variance[:, None] ** -0.5))
        among = shared.factor * shared.between(weighted, pixel)
        freed = np.linalg.solve(among + _stiff(among, rungs[used]), normal)
        normal, right = normal @ freed, freed.T @ right
    else:
        level = max(level, 1.0) if stated else level
        normal, right = normal / level, right / level
    found = likely(normal, right, rungs[used] + ORDER - 1, rigid)
    known = shared is not None or _independent(left[min(enough + 1, last)])
    return Smooth(rungs[used], found, resolved=known)


def _ladder(
    places: FloatMap, values: FloatMap, weights: FloatMap
) -> tuple[list[int], list[FloatMap]]:
    """The intervals of the splines that the values support, and what each spline leaves."""
    most = len(values) / VALUES_PER_COEFFICIENT
    rungs = [k for k in LADDER if k == 1 or (k + ORDER - 1) ** 2 <= most]
    return rungs, [_left(places, values, weights, k) for k in rungs]


def _equations(
    places: FloatMap, values: FloatMap, weights: FloatMap, intervals: int
) -> tuple[scipy.sparse.csr_matrix, FloatMap, FloatMap]:
    """The tensor products at places, and both sides of the equations of least squares."""
    design = design_of(places, intervals)
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
