"""The part of an error that is the same in every exposure of a scene, measured by differences."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from fringeworks.statistics.groups import ordered_groups
from fringeworks.statistics.quantiles import NORMAL_MEDIAN
from fringeworks.types import FloatMap

GROUPS = 12
"""Number of groups of similar variance in which the common part is measured. Errors at edges and in
dim regions have other causes than those of bright, smooth regions. Empirical."""
MIN_GROUP = 400
"""Smallest number of differences in a group: their median square then scatters by 8 %."""
LARGEST_RATIO = 4.0
"""Largest sum of two variances, over the smaller one, from which a common part is measured. Where
one exposure is much noisier than the other, its noise hides the common part, and the fused σ is
within 13 % of the better one's anyway."""
SMOOTHING = 0.5
"""Standard deviation over which the groups' shares are averaged, in the logarithm of the variance,
so that groups of nearly equal variance do not scatter."""
SIGNIFICANT = 0.1
"""Share of a variance from which on it counts as common. Noise alone scatters by a few hundredths,
and to neglect a tenth makes σ too small by 3 % at most."""


def differences(one: FloatMap, other: FloatMap) -> FloatMap:
    """Return the differences of two coordinates, 0 where one is unknown."""
    return np.nan_to_num(one - other, nan=0.0)


def common_variance(x: FloatMap, variance: FloatMap) -> FloatMap:
    """Measure the variance that all exposures have in common.

    Parameters
    ----------
    x : (n, h, w) array, px
        Coordinates of n exposures; NaN where one does not measure.
    variance : (n, h, w) array, px²
        Squares of their σ.

    Returns
    -------
    (h, w) array, px²; at most the smallest variance of the pixel, 0 where it has none.

    Notes
    -----
    The difference of two coordinates has the variance σ₁² + σ₂² − 2 c. The pixels of every pair of
    exposures are divided into groups of similar smaller variance m. The squared differences over
    σ₁² + σ₂² have the median 0.455 (1 − 2 c / (σ₁² + σ₂²)), which gives the share c/m of the group.
    Medians are insensitive to wrong orders.
    """
    best = np.min(np.where(np.isfinite(variance), variance, np.inf), axis=0)
    best[np.isinf(best)] = 0.0
    parts = []
    for one, other in combinations(range(len(x)), 2):
        both = np.isfinite(x[one]) & np.isfinite(x[other])
        square = (x[one][both] - x[other][both]) ** 2
        total = variance[one][both] + variance[other][both]
        smaller = np.minimum(variance[one][both], variance[other][both])
        near = total < LARGEST_RATIO * smaller
        parts.append(np.stack((smaller, total, square))[:, near])
    places, shares = _shares(*np.concatenate(parts, axis=1))
    if not places.size:
        return np.zeros(best.shape)
    with np.errstate(divide="ignore"):
        share = np.interp(np.log(best), places, shares)
    return np.asarray(best * share)


def _shares(smaller: FloatMap, total: FloatMap, square: FloatMap) -> tuple[FloatMap, FloatMap]:
    """Logarithm of the smaller variance and its common share, 0…1, of groups of differences."""
    places, shares = [], []
    for part in ordered_groups(smaller, GROUPS, MIN_GROUP):
        seen = float(np.median(square[part] / total[part])) / NORMAL_MEDIAN**2
        shares.append(0.5 * (1.0 - seen) * float(np.median(total[part] / smaller[part])))
        places.append(float(np.log(np.median(smaller[part]))))
    at, found = np.array(places), np.array(shares)
    near = np.exp(-0.5 * ((at[:, None] - at) / SMOOTHING) ** 2)
    smooth = near @ found / near.sum(axis=1)
    return at, np.where(smooth > SIGNIFICANT, np.minimum(smooth, 1.0), 0.0)
