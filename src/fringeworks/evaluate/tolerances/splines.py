"""Cubic splines over the unit square: their sizes, their values, and how alike their parts are."""

from __future__ import annotations

import numpy as np
import scipy

from fringeworks.types import FloatMap

LADDER = (1, 2, 3, 4, 6, 8, 11, 16, 22, 32)
"""Intervals of the splines along each side of an area, from the coarsest to the finest."""
FINE = 7
"""Number of the spline in ``LADDER`` that holds the surfaces where the area has points enough: 16
intervals, of which the likely lengths of form take what they need."""
ORDER = 4
"""Cubic splines: four of them overlap in each interval."""


def design_of(places: FloatMap, intervals: int) -> scipy.sparse.csr_matrix:
    """Return the tensor products of splines at places of the unit square, (n, p)."""
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
