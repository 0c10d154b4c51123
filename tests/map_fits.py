"""Simple bodies fitted to a measured map: the residual is form error and noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize

from fringeworks.types import BoolMap, FloatMap, InputError


@dataclass(frozen=True)
class Fit:
    """A fitted body."""

    parameters: dict[str, float]
    residual: FloatMap
    """Measured minus fitted, (h, w); NaN outside the fitted pixels."""

    @property
    def rms(self) -> float:
        """Root mean square of the residual."""
        return float(np.sqrt(np.nanmean(self.residual**2)))


def _chosen(values: FloatMap, where: BoolMap | None, least: int) -> BoolMap:
    chosen = np.isfinite(values)
    if where is not None:
        if where.shape != values.shape:
            raise InputError(f"where: expected shape {values.shape}, got {where.shape}")
        chosen = chosen & where
    if chosen.sum() < least:
        raise InputError(f"fit: expected at least {least} measured pixels, got {chosen.sum()}")
    return chosen


def fit_plane(values: FloatMap, where: BoolMap | None = None) -> Fit:
    """Least-squares plane z = offset + slope_x·x + slope_y·y over pixel coordinates.

    Parameters
    ----------
    values : (h, w) float array
        NaN for pixels without a value.
    where : (h, w) bool array, optional
        Pixels to fit; all with a value by default.

    Examples
    --------
    >>> y, x = np.mgrid[:20, :30]
    >>> fit = fit_plane(1 + 0.5 * x - 0.25 * y)
    >>> round(fit.parameters["slope_y"], 6), fit.rms < 1e-9
    (-0.25, True)
    """
    chosen = _chosen(values, where, 3)
    y, x = np.nonzero(chosen)
    system = np.column_stack((np.ones(x.size), x, y))
    solution, *_ = np.linalg.lstsq(system, values[chosen], rcond=None)
    residual = np.full(values.shape, np.nan)
    residual[chosen] = values[chosen] - system @ solution
    offset, slope_x, slope_y = (float(v) for v in solution)
    return Fit({"offset": offset, "slope_x": slope_x, "slope_y": slope_y}, residual)


CONE_HARMONICS = 2
"""Number of harmonics of the slope around the apex: the flanks of a round cone that is seen and lit
obliquely vary once and twice per turn."""


def fit_cone(values: FloatMap, where: BoolMap) -> Fit:
    """Least-squares cone: straight flanks from a sharp apex, with a slope that depends on θ.

    z = apex − r·(c₀ + Σ aₘ cos mθ + bₘ sin mθ), m = 1, 2, with r and θ about (x₀, y₀). A round
    cone has this form if camera and projector are oblique.

    Parameters
    ----------
    values : (h, w) float array
        NaN for pixels without a value.
    where : (h, w) bool array
        Pixels on the cone, without its rim.

    Returns
    -------
    Fit with the parameters apex, x, y and slope (c₀), in the values' unit and px.
    """
    chosen = _chosen(values, where, 20)
    y, x = np.nonzero(chosen)
    z = values[chosen].astype(np.float64)
    low, top = np.percentile(z, (1, 99.8))
    high = z >= np.percentile(z, 95)
    slope = (top - low) / np.sqrt(chosen.sum() / np.pi)
    start = np.zeros(4 + 2 * CONE_HARMONICS)
    start[:4] = top, x[high].mean(), y[high].mean(), slope

    def misfit(p: np.ndarray) -> np.ndarray:
        dx, dy = x - p[1], y - p[2]
        angle = np.arctan2(dy, dx)
        steepness = np.full(angle.shape, p[3])
        for m in range(1, CONE_HARMONICS + 1):
            steepness += p[2 + 2 * m] * np.cos(m * angle) + p[3 + 2 * m] * np.sin(m * angle)
        return np.asarray(p[0] - np.hypot(dx, dy) * steepness - z)

    solved = optimize.least_squares(misfit, start)
    residual = np.full(values.shape, np.nan)
    residual[chosen] = -solved.fun
    names = ("apex", "x", "y", "slope")
    return Fit({name: float(v) for name, v in zip(names, solved.x[:4], strict=True)}, residual)
