"""The smallest largest value of many linear functions: the fits of Chebyshev and their kin."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.types import FloatMap, InputError

BOUND = 1e6
"""Bound of all unknowns, in units of the largest value: far beyond any solution, and near enough
that sums with it keep ten digits."""
SETTLED = 1e-9
"""Violation of a row, relative to the largest value, up to which a solution is taken."""
TINY = 1e-11
"""Size of a pivot, relative to 1, below which it is rounding."""
MOST_PIVOTS = 300
"""Largest number of pivots. Ten to thirty are usual; a row that ties with others may repeat."""


def smallest_largest(values: FloatMap, slopes: FloatMap, *, within: float = np.inf) -> FloatMap:
    """Return the x that makes the largest of values + slopes · x smallest.

    Parameters
    ----------
    values : (m,) array
    slopes : (m, k) array
        Columns of about the same size, that determine x.
    within : float > 0
        Largest size of each of x.

    Returns
    -------
    (k,) array

    Raises
    ------
    InputError where no x is found, such as for values that are not finite.

    Notes
    -----
    The linear programme min t with t ≥ values + slopes · x, by the dual simplex method (C. Lemke,
    The dual method of solving the linear programming problem, 1954): k + 1 rows are held, the row
    that is broken most comes in for the one whose multiplier reaches 0 first. It solves systems of
    at most eight unknowns, whatever the number of rows.
    """
    size = float(np.abs(values).max(initial=0.0)) or 1.0
    rows = np.column_stack((-slopes, np.ones(len(values))))
    k = rows.shape[1]
    bound = np.append(np.full(k - 1, min(within / size, BOUND)), BOUND)
    A = np.vstack((np.eye(k), rows, -np.eye(k)))
    b = np.concatenate((-bound, values / size, -bound))
    basis: NDArray[np.intp] = np.arange(k)
    for _ in range(MOST_PIVOTS):
        inverse = np.linalg.inv(A[basis])
        x = inverse @ b[basis]
        slack = A @ x - b
        worst = int(np.argmin(slack))
        if slack[worst] >= -SETTLED:
            return np.asarray(x[:-1] * size)
        change = A[worst] @ inverse
        able = change > TINY
        if not able.any():
            break
        ratio = np.where(able, np.maximum(inverse[-1], 0.0) / np.where(able, change, 1.0), np.inf)
        # Of rows that tie, the largest pivot.
        tied = ratio <= ratio.min() + TINY
        basis[int(np.argmax(np.where(tied, change, -np.inf)))] = worst
    return np.asarray(_by_library(values / size, slopes, bound) * size)


def _by_library(values: FloatMap, slopes: FloatMap, bound: FloatMap) -> FloatMap:
    """The same by the library's solver, which is slower and never repeats a set of rows."""
    k = slopes.shape[1]
    found = None
    if np.isfinite(values).all() and np.isfinite(slopes).all():
        found = scipy.optimize.linprog(
            np.append(np.zeros(k), 1.0),
            A_ub=np.column_stack((slopes, -np.ones(len(values)))),
            b_ub=-values,
            bounds=np.column_stack((-bound, bound)),
            method="highs",
        ).x
    if found is None:
        raise InputError("zone: expected points that determine it, got ones that do not")
    return np.asarray(found[:-1])
