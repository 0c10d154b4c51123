"""Scatter of a map about smooth surfaces, against the standard deviation that it states."""

from __future__ import annotations

import numpy as np
import scipy

from fringeworks.statistics.groups import ordered_groups
from fringeworks.statistics.quantiles import NORMAL_MEDIAN
from fringeworks.types import FloatMap

HALF_PX = 3
"""Half side of the window in which a quadratic surface is fitted, px: 49 pixels for 6 coefficients.
A sphere of 25 mm that is seen with 0.3 mm per pixel deviates from it by less than 1 µm."""
GROUPS = 8
"""Number of groups of similar stated variance in which the scatter is measured. Noise, and errors
that the noise does not contain, have different shares in bright and dark regions."""
MIN_GROUP = 300
"""Smallest number of pixels in a group: the factor is then known to 5 %."""


def scatter_factor(values: FloatMap, sigma: FloatMap) -> FloatMap:
    """Factor on the stated standard deviations that makes them agree with the local scatter.

    Parameters
    ----------
    values : (h, w) array
        Smooth but for noise; NaN where unknown.
    sigma : (h, w) array
        Stated standard deviations, same unit.

    Returns
    -------
    (h, w) array, 1 where there are too few pixels. It depends only on the stated standard
    deviation.

    Notes
    -----
    The residual of the middle of a window from a quadratic surface has the variance
    σ² (1 − h) with h the leverage of the middle. Its median over pixels of similar σ gives the
    factor. Errors of long wavelength stay in the surface and are not seen.
    """
    known = np.isfinite(values)
    factor = np.ones(values.shape)
    if known.sum() < MIN_GROUP:
        return factor
    centre = float(np.median(values[known]))
    kernel = _residual_kernel()
    residual = scipy.ndimage.correlate(np.where(known, values - centre, 0.0), kernel)
    whole = scipy.ndimage.binary_erosion(known, np.ones(kernel.shape, bool))
    with np.errstate(all="ignore"):
        ratio = np.abs(residual[whole]) / sigma[whole] / np.sqrt(np.sum(kernel**2))
        level = np.log(sigma[whole])
    parts = ordered_groups(level, GROUPS, MIN_GROUP)
    if not parts:
        return factor
    places = np.array([np.median(level[part]) for part in parts])
    found = np.array([np.median(ratio[part]) for part in parts]) / NORMAL_MEDIAN
    # Groups of one σ are one group.
    places, group = np.unique(places, return_inverse=True)
    found = np.bincount(group, found) / np.bincount(group)
    factor[known] = np.interp(np.log(sigma[known]), places, found)
    return factor


def _residual_kernel() -> FloatMap:
    """Weights whose sum over a window is the middle less the fitted quadratic surface there."""
    line = np.arange(-HALF_PX, HALF_PX + 1.0)
    v, u = (a.ravel() for a in np.meshgrid(line, line, indexing="ij"))
    design = np.column_stack((np.ones_like(u), u, v, u * u, u * v, v * v))
    middle = len(u) // 2
    hat = design[middle] @ np.linalg.solve(design.T @ design, design.T)
    weight = -hat
    weight[middle] += 1.0
    return np.asarray(weight.reshape(len(line), len(line)))
