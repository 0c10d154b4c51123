"""The pull of the projector's pixel grid: coordinates lean towards the middles of its pixels.

A projector pixel has one brightness. A camera pixel that sees parts of several of them measures the
centre of gravity of their numbers, weighted with their light in its footprint, and not its own
place. The fringes of all sets and steps carry the same error, so that neither residuals nor the
agreement of the sets show it. Along a line it repeats with every projector pixel, which the
coordinate itself counts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.patterns.order_chain import TURN
from fringeworks.stack.ripple import (
    MIN_WINDOWS,
    SIGNIFICANT_AMPLITUDE,
    TINY,
    pooled,
    smooth_shapes,
)
from fringeworks.statistics.groups import equal_groups
from fringeworks.statistics.quantiles import median
from fringeworks.types import FloatMap

HARMONICS = 3
"""Harmonics of the pull over a projector pixel that are measured. A sawtooth, which sharp pixels
without gaps make, has 94 % of its rms in them."""

ORDERS = tuple(range(1, HARMONICS + 1))
"""Their orders, periods per projector pixel."""

SHORT_WINDOW = 48
"""Length of short windows along a line, camera px. A polynomial of third degree follows curved
surfaces there, and beats of up to 48 px are seen."""

LONG_SHARE = 5
"""Long windows are this fraction of a line: they see slow beats, and five still tell a pull from
relief at single places."""

MOST_SAMPLES = 64
"""Samples of a window that are used; more only take time."""

USUAL_PULL_PX = 0.1
"""Pull that sharp grids usually have, projector px: half of that of a sawtooth. It holds harmonics
near zero that the lines hardly show."""


@dataclass(frozen=True)
class GridPull:
    """Coordinate error that repeats with every projector pixel: Σ b_k sin 2πkx."""

    amplitudes_px: FloatMap
    """b_1 to b_3; negative where coordinates are pulled to the middles of the pixels."""
    all_px: float
    """The pull, rms over the places on the grid that were seen, px."""
    error_px: float
    """Its standard error, px."""

    @property
    def significance(self) -> float:
        """The pull over its error."""
        return self.all_px / max(self.error_px, TINY)

    @property
    def rms_px(self) -> float:
        """The pull, rms; 0 where chance may have made it. Lines know it to a hundredth of the noise
        of a pixel, so that what is left out does not matter."""
        return self.all_px if self.significance > SIGNIFICANT_AMPLITUDE else 0.0

    def at(self, coordinate: FloatMap) -> FloatMap:
        """The error of coordinates, projector px, of their shape."""
        angle = TURN * coordinate
        waves = [b * np.sin(k * angle) for k, b in zip(ORDERS, self.amplitudes_px, strict=True)]
        return np.asarray(np.sum(waves, axis=0), coordinate.dtype)


def measure_pull(coordinate: FloatMap) -> GridPull | None:
    """Measure the pull from coordinates along lines.

    Parameters
    ----------
    coordinate : (r, l) array, projector px
        Along r lines across the fringes; NaN where it is unknown.

    Returns
    -------
    GridPull; None where the lines hold too few windows of smooth surface.

    Notes
    -----
    With footprint h of a camera pixel and light s of a projector pixel (both over one axis), the
    phase of any fringe is that of the coordinate Σ j (h*s)(x - j) / Σ (h*s)(x - j). Its distance
    from x is an odd function of x with period 1. Windows are fitted by a polynomial of third degree
    and the first harmonics; those of two lengths are tried, and the surer result counts.
    """
    sizes = {SHORT_WINDOW, coordinate.shape[1] // LONG_SHARE}
    found = [_of_windows(coordinate, size) for size in sizes]
    shown = [f for f in found if f is not None]
    return max(shown, key=lambda f: f.significance, default=None)


def _of_windows(coordinate: FloatMap, size: int) -> GridPull | None:
    """The pull from windows of one length; None where they are too few."""
    number = coordinate.shape[1] // max(size, 1)
    if size < SHORT_WINDOW or number * coordinate.shape[0] < MIN_WINDOWS:
        return None
    kept = np.arange(0, size, -(-size // MOST_SAMPLES))
    values = coordinate[:, : number * size].reshape(-1, size)[:, kept].astype(np.float64)
    place = np.tile(np.arange(number), coordinate.shape[0])
    usable = np.isfinite(values).all(axis=1)
    if np.count_nonzero(usable) < MIN_WINDOWS:
        return None
    return _fitted(values[usable], equal_groups(place[usable])[1])


def _fitted(values: FloatMap, place: NDArray[np.intp]) -> GridPull:
    """Least squares over all windows, each weighted with its own scatter."""
    phase, shapes = TURN * values, smooth_shapes(values.shape[1])
    sines = np.arange(1, 2 * HARMONICS, 2)
    # The smooth surface tells where on the grid a pixel looks: a pixel's own noise does not.
    normal, projected, power = _core.window_sums(phase, shapes, ORDERS)
    normal, projected = normal[:, sines[:, None], sines], projected[:, sines] / TURN
    scatter = power / (values.shape[1] * TURN**2)
    # Harmonics that look alike at the places that were seen count together.
    smooth = np.ascontiguousarray((phase @ shapes.T @ shapes).reshape(1, -1))
    waves: _core._SetWaves = {"phase": smooth, "orders": [ORDERS]}
    alike = _core.ripple_sums(waves, np.empty((0, values.size)))[np.ix_(sines, sines)] / values.size
    usual = median(scatter)
    # Depth steps and relief scatter more, and say less. None says more than the usual one.
    weight = usual / np.maximum(scatter, usual)
    normal, projected = weight[:, None, None] * normal, weight[:, None] * projected
    known = np.full(HARMONICS, usual / USUAL_PULL_PX**2)
    amplitudes, covariance = pooled(normal, projected, known, place)
    rms = float(np.sqrt(amplitudes @ alike @ amplitudes))
    return GridPull(amplitudes, rms, float(np.sqrt(np.sum(covariance * alike))))
