"""Evaluation of the smooth correction that a device's pixels need beside its lens model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fringeworks.types import FloatMap, LensField

MAX_PASSES = 60
"""Largest number of passes of the fixed-point iteration that undoes a correction. Each multiplies
the error by the correction's slope, 0.01 for usual ones and below 0.5 for all."""
CONVERGED_PX = 1e-10
"""Change of a pixel below which a pass has changed nothing, px: rounding."""


def correction(field: LensField, pixels: FloatMap) -> FloatMap:
    """Return what is to be subtracted from measured pixels, (..., 2), px.

    Parameters
    ----------
    field : LensField
    pixels : (..., 2) array
        Column and row, px; NaN gives NaN.
    """
    return _between(field, field.control_px, pixels)


def correction_sigma(field: LensField, pixels: FloatMap) -> FloatMap:
    """Return the standard deviation of the correction at pixels, (..., 2), px."""
    return _between(field, field.sigma_px, pixels)


def correction_slope(field: LensField, pixels: FloatMap) -> FloatMap:
    """Return the derivative of the correction by the pixel, (..., 2, 2), px/px."""
    (i, u), (j, v) = _cells(field, pixels)
    across, down = (_weights(u), _weights(v))
    slopes = []
    for by_u, by_v, step in (
        (_weight_slopes(u), down, field.step_px[0]),
        (across, _weight_slopes(v), field.step_px[1]),
    ):
        slopes.append(_sum(field.control_px, (i, by_u), (j, by_v)) / step)
    inside = [(np.asarray(pixels)[..., k] - field.first_px[k]) / field.step_px[k] for k in range(2)]
    for k, n in enumerate((field.control_px.shape[1], field.control_px.shape[0])):
        slopes[k][(inside[k] < 1.0) | (inside[k] > n - 2.0)] = 0.0
    return np.stack(slopes, axis=-1)


def corrected(field: LensField | None, pixels: FloatMap) -> FloatMap:
    """Return measured pixels as the lens model has them, (..., 2), px."""
    pixels = np.asarray(pixels, np.float64)
    return pixels if field is None else pixels - correction(field, pixels)


def uncorrected(field: LensField | None, pixels: FloatMap) -> FloatMap:
    """Return the pixels that are measured where the lens model has these, (..., 2), px."""
    if field is None:
        return pixels
    measured = pixels
    for _ in range(MAX_PASSES):
        before, measured = measured, pixels + correction(field, measured)
        with np.errstate(invalid="ignore"):
            if not np.nanmax(np.abs(measured - before), initial=0.0) > CONVERGED_PX:
                break
    return measured


def basis(
    first_px: float, step_px: float, controls: int, places_px: FloatMap
) -> NDArray[np.float64]:
    """Weights of the control points along one axis at places (n,), (n, controls)."""
    cell, u = _cell(first_px, step_px, controls, places_px)
    found = np.zeros((len(places_px), controls))
    for k, weight in enumerate(_weights(u)):
        found[np.arange(len(places_px)), cell + k] = weight
    return found


def _between(field: LensField, values: FloatMap, pixels: FloatMap) -> FloatMap:
    """The spline surface with these control points at pixels."""
    (i, u), (j, v) = _cells(field, pixels)
    found = _sum(values, (i, _weights(u)), (j, _weights(v)))
    found[np.isnan(np.asarray(pixels)).any(axis=-1)] = np.nan
    return found


_Cells = tuple[NDArray[np.intp], FloatMap]


def _cells(field: LensField, pixels: FloatMap) -> tuple[_Cells, _Cells]:
    """First of four control points, and the place between the middle two, along both axes."""
    pixels = np.asarray(pixels, np.float64)
    rows, columns = field.control_px.shape[:2]
    return (
        _cell(field.first_px[0], field.step_px[0], columns, pixels[..., 0]),
        _cell(field.first_px[1], field.step_px[1], rows, pixels[..., 1]),
    )


def _cell(first_px: float, step_px: float, controls: int, places_px: FloatMap) -> _Cells:
    with np.errstate(all="ignore"):
        at = np.nan_to_num((places_px - first_px) / step_px).clip(1.0, controls - 2.0)
    cell = np.minimum(at.astype(np.intp), controls - 3)
    return cell - 1, at - cell


def _weights(u: FloatMap) -> tuple[FloatMap, ...]:
    """Weights of four control points at a place 0…1 between the middle two."""
    rest = 1.0 - u
    return (
        rest**3 / 6.0,
        2.0 / 3.0 - u**2 * (1.0 - 0.5 * u),
        2.0 / 3.0 - rest**2 * (1.0 - 0.5 * rest),
        u**3 / 6.0,
    )


def _weight_slopes(u: FloatMap) -> tuple[FloatMap, ...]:
    """Derivatives of these weights by the place."""
    rest = 1.0 - u
    return -0.5 * rest**2, u * (1.5 * u - 2.0), rest * (2.0 - 1.5 * rest), 0.5 * u**2


def _sum(
    values: FloatMap,
    across: tuple[NDArray[np.intp], tuple[FloatMap, ...]],
    down: tuple[NDArray[np.intp], tuple[FloatMap, ...]],
) -> FloatMap:
    """Weighted sums of 4 × 4 control points."""
    found = np.zeros((*across[0].shape, 2))
    for b, weight in enumerate(down[1]):
        for a, other in enumerate(across[1]):
            found += (weight * other)[..., None] * values[down[0] + b, across[0] + a]
    return found
