"""Simple bodies fitted to a measured map: what is left over is form error and noise."""

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
    values : (h, w) float array; NaN is left out.
    where : (h, w) bool array, optional
        Pixels to fit.

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


def fit_cone(values: FloatMap, where: BoolMap) -> Fit:
    """Least-squares upright cone with an elliptic base: straight flanks, a sharp apex.

    z = apex − √((a·(x − x₀))² + (b·(y − y₀))²). The camera's angle and the displacement itself
    make the image of a round cone slightly elliptic.

    Parameters
    ----------
    values : (h, w) float array; NaN is left out.
    where : (h, w) bool array
        Pixels on the cone, its rim left out.
    """
    chosen = _chosen(values, where, 10)
    y, x = np.nonzero(chosen)
    z = values[chosen].astype(np.float64)
    top = np.percentile(z, 99)
    radius = np.sqrt(chosen.sum() / np.pi)
    steep = (top - np.percentile(z, 1)) / radius
    high = z >= np.percentile(z, 95)
    start = np.array([top, steep, steep, x[high].mean(), y[high].mean()])

    def misfit(p: np.ndarray) -> np.ndarray:
        return np.asarray(p[0] - np.hypot(p[1] * (x - p[3]), p[2] * (y - p[4])) - z)

    found = optimize.least_squares(misfit, start)
    residual = np.full(values.shape, np.nan)
    residual[chosen] = -found.fun
    names = ("apex", "slope_x", "slope_y", "x", "y")
    return Fit({name: float(v) for name, v in zip(names, found.x, strict=True)}, residual)
