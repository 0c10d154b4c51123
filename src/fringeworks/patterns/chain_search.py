"""The search for a chain of roundings: integer combinations of the phases, and the widest path."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

ORDER_SIGMAS = 5.0
"""Margin that every rounding of a fringe order must have, in standard deviations of its error.

Gaussian errors exceed five standard deviations once in 1.7 million roundings, about once in a frame
of two megapixels. A larger margin would turn more noisy pixels into NaN.
"""

ALTERNATIVE_SIGMAS = 6.0
"""Distance of a decoded coordinate from any other one in the range, in standard deviations.

A pixel's noise shows how far it is from the next fringe order. Six standard deviations are exceeded
once in 500 million roundings. Five would leave one wrong order in two million pixels at the noise
limit. At the limit, the test discards one right pixel in 15,000.
"""

MAX_COMBINATIONS = 20_000
"""Largest number of integer combinations that the search for a chain tries.

It limits the time of the search to a fraction of a second. An empirical choice: it allows
coefficients up to 64 for two periods, 13 for three and 5 for four.
"""

MAX_COEFFICIENT = 64
"""Largest coefficient of a combination.

The error of a combination grows with its coefficients, so larger ones rarely lead to a better
chain. The limit only matters for one or two periods; with more, ``MAX_COMBINATIONS`` is reached
first. An empirical choice.
"""

COMMENSURATE = 1e-6
"""Relative tolerance within which a distance holds a period a whole number of times.

It lies far above the rounding of double precision (1e-16), so that periods such as 1920/59 px
count as exact, and far below any difference that can be measured: 0.002 px over 1920 px.
"""

ROUNDING = 1e-9
"""Relative tolerance for the rounding of double precision in comparisons.

The sums here err by less than 1e-13, and real differences between combinations are larger than
1e-6.
"""


def combinations(
    frequency: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Coefficients and frequencies of combinations with a positive frequency, none above the
    highest of the phases."""
    m = frequency.size
    sizes = range(MAX_COEFFICIENT, 0, -1)
    largest = next((r for r in sizes if (2 * r + 1) ** m <= MAX_COMBINATIONS), 0)
    if largest:
        c = np.array(list(product(range(-largest, largest + 1), repeat=m)), float)
    else:  # too many periods for a full search: only the phases and their differences
        unit = (*np.eye(m), np.zeros(m))
        c = np.array([a - b for a in unit for b in unit])
    g = c @ frequency
    wanted = (g > COMMENSURATE * frequency.max()) & (g <= frequency.max() * (1.0 + ROUNDING))
    return c[wanted], g[wanted]


def widest_path(
    c: NDArray[np.float64],
    g: NDArray[np.float64],
    sigma: NDArray[np.float64],
    starts: NDArray[np.bool_],
    start_tolerance: NDArray[np.float64],
    frequency: NDArray[np.float64],
) -> NDArray[np.intp]:
    """Indices of the combinations of the chain with the largest smallest margin."""
    spread = np.sqrt((c**2) @ sigma**2)
    nodes = undominated(g, spread)
    c, g = c[nodes], g[nodes]
    margin = np.where(starts[nodes], start_tolerance[nodes] / spread[nodes], 0.0)
    before = np.full(nodes.size, -1)
    # By rising frequency, so that all predecessors of a combination are final.
    for j in range(1, nodes.size):
        step = c[j] - (g[j] / g[:j])[:, None] * c[:j]
        with np.errstate(divide="ignore"):
            reached = np.minimum(margin[:j], 0.5 / np.sqrt((step**2) @ sigma**2))
        i = int(np.argmax(reached))
        if reached[i] > margin[j]:
            margin[j], before[j] = reached[i], i
    final = np.empty(nodes.size)
    for j in range(nodes.size):
        step = np.eye(frequency.size) - (frequency / g[j])[:, None] * c[j]
        with np.errstate(divide="ignore"):
            final[j] = min(margin[j], float(np.min(0.5 / np.sqrt((step**2) @ sigma**2))))
    path = [int(np.argmax(final))]
    while before[path[-1]] >= 0:
        path.append(int(before[path[-1]]))
    return nodes[path[::-1]]


def undominated(g: NDArray[np.float64], spread: NDArray[np.float64]) -> NDArray[np.intp]:
    """Indices of combinations that no longer one beats in accuracy, by rising frequency."""
    kept: list[int] = []
    least = np.inf
    for k in np.lexsort((spread, g)):
        if spread[k] / g[k] < least * (1.0 - ROUNDING):
            least = spread[k] / g[k]
            kept.append(int(k))
    return np.array(kept)


def roundings(
    c: NDArray[np.float64],
    g: NDArray[np.float64],
    start_tolerance: float,
    frequency: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Amplification of the phase errors by every rounding of a chain, and its tolerance."""
    rows, tolerance = [c[0]], [start_tolerance]
    for k in range(1, g.size):
        rows.append(c[k] - (g[k] / g[k - 1]) * c[k - 1])
        tolerance.append(0.5)
    for m in range(frequency.size):
        rows.append(np.eye(frequency.size)[m] - (frequency[m] / g[-1]) * c[-1])
        tolerance.append(0.5)
    amplification = np.array(rows)
    amplification[np.abs(amplification) < ROUNDING] = 0.0
    return amplification, np.array(tolerance)


def binding(
    rows: NDArray[np.float64], tolerance: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Mark the roundings that can fail while all other roundings are right.

    One that is left out has an error so much smaller than another's that ``ORDER_SIGMAS`` of that
    error are ``ALTERNATIVE_SIGMAS`` of its own.

    Returns
    -------
    kept : (R,) bool array
    largest : (R,) float array
        Largest standard deviation of the error of every rounding, turns, up to which those that it
        stands for are safe by ``ALTERNATIVE_SIGMAS``; infinite where it stands for none.
    """
    size = np.abs(rows)
    load = size / tolerance[:, None]
    safe = load * (ALTERNATIVE_SIGMAS / ORDER_SIGMAS)
    kept, largest = np.asarray(size.sum(axis=1) > 0), np.full(len(rows), np.inf)
    for k in np.flatnonzero(kept):
        others = kept.copy()
        others[k] = False
        others = np.flatnonzero(others & np.all(load >= safe[k], axis=1))
        if others.size and np.isfinite(tolerance[k]):
            used = size[k] > 0
            share = (size[k, used] / size[others][:, used]).max(axis=1)
            stands = others[np.argmin(share)]
            limit = min(largest[k], tolerance[k] / ALTERNATIVE_SIGMAS) / share.min()
            largest[stands] = min(largest[stands], limit)
        kept[k] = not others.size
    return kept, largest
