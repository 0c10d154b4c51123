"""A smooth projector coordinate on a flat board, from the steps of a Gray code."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fringeworks._lazy import scipy
from fringeworks.statistics.quantiles import MAD_TO_SIGMA, robust_sigma
from fringeworks.types import BoolMap, FloatMap, InputError

SMOOTHING_PX = 15.0
"""Default standard deviation of the Gaussian smoothing, camera px.

It averages over several cells of a Gray code with cells of a few pixels. It is short enough to
follow the deviations of the coordinate from a cubic. An empirical choice.
"""

DEGREE = 3
"""Total degree of the polynomial surface.

Perspective and lens distortion of a flat board are smooth, and a cubic leaves little for the
smoothing. An empirical choice.
"""

MIN_VALID_PIXELS = 1_000
"""Smallest number of valid pixels, a hundred per coefficient of the surface. Empirical."""

SURFACE_PIXELS = 20_000
"""Approximate number of pixels in the fit of the surface.

More pixels make the fit slower and hardly more precise. An empirical choice.
"""

SURFACE_STEPS = 10
"""Number of fits, each without the outliers of the one before.

The set of outliers of a decoded Gray code changes little after a few fits. An empirical choice.
"""


OUTLIER_SIGMAS = 3.0
"""Distance from the surface from which on a pixel is left out of its fit, standard deviations.

The usual limit of three discards 0.3 % of Gaussian residuals.
"""

FAR_SIGMAS = 6.0
"""Distance from the surface from which on a pixel is not smoothed, standard deviations.

Twice ``OUTLIER_SIGMAS``, so that small deviations from a cubic are kept and wrongly decoded bits
are discarded. An empirical choice.
"""

NO_SPREAD_PX = 1e-9
"""Smallest limit of both distances, projector px; it serves coordinates that fit exactly."""


def smooth_coordinate(
    coordinate: FloatMap, valid: BoolMap, *, sigma_px: float = SMOOTHING_PX
) -> NDArray[np.float64]:
    """Smooth a projector coordinate on a flat board, so that it loses the steps of its Gray code.

    Parameters
    ----------
    coordinate : (h, w) float array, projector px
        Such as a decoded Gray code.
    valid : (h, w) bool array
    sigma_px : float > 0
        Standard deviation of the Gaussian that smooths the residuals of a cubic surface, camera px.

    Returns
    -------
    (h, w) float array, projector px; NaN where not valid or too far from the surface.

    Raises
    ------
    InputError
        If fewer than 1000 pixels are valid.
    """
    places = np.flatnonzero(valid)
    if places.size < MIN_VALID_PIXELS:
        raise InputError(
            f"coordinate: expected {MIN_VALID_PIXELS} valid pixels or more, got {places.size}"
        )
    surface, spread = _surface(coordinate, places)
    residual = np.where(valid, coordinate - surface, 0.0)
    near = valid & (np.abs(residual) <= max(FAR_SIGMAS * spread, NO_SPREAD_PX))
    weight = scipy.ndimage.gaussian_filter(near.astype(float), sigma_px)
    smooth = scipy.ndimage.gaussian_filter(np.where(near, residual, 0.0), sigma_px)
    # Every near pixel has a weight far above this bound, which keeps the other pixels finite.
    return np.where(near, surface + smooth / np.maximum(weight, 1e-6), np.nan)


def _surface(coordinate: FloatMap, places: NDArray[np.intp]) -> tuple[FloatMap, float]:
    """A cubic surface through a coordinate, insensitive to outliers, and the residuals' σ, px."""
    h, w = coordinate.shape
    y, x = np.mgrid[-1.0 : 1.0 : h * 1j, -1.0 : 1.0 : w * 1j]
    powers = [(i, j) for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)]
    sample = places[:: max(1, places.size // SURFACE_PIXELS)]
    design = np.column_stack([x.flat[sample] ** i * y.flat[sample] ** j for i, j in powers])
    values = coordinate.flat[sample].astype(np.float64)
    kept = np.ones(sample.size, bool)
    for _ in range(SURFACE_STEPS):
        coefficients = np.linalg.lstsq(design[kept], values[kept], rcond=None)[0]
        off = np.abs(values - design @ coefficients)
        limit = OUTLIER_SIGMAS * MAD_TO_SIGMA * float(np.median(off[kept]))
        kept = off <= max(limit, NO_SPREAD_PX)
    spread = robust_sigma(off[kept])
    terms = (c * x**i * y**j for c, (i, j) in zip(coefficients, powers, strict=True))
    return np.asarray(sum(terms)), spread
