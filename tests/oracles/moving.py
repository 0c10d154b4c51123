"""Fits of phase steps whose phase turns, and χ² of residuals, with NumPy."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from fringeworks.stack.fits import parts_of_orders

DEGENERATE = 1e-2


def fit_moving(samples, shifts_rad, turned_rad):
    """A, c, s and the sum of the squared residuals at every pixel, float64."""
    n = len(samples)
    samples = np.asarray(samples, float)
    angles = np.asarray(shifts_rad)[:, None, None] - np.asarray(turned_rad, float)
    cosine, sine = np.cos(angles), np.sin(angles)
    mean, c1, s1 = samples.mean(axis=0), cosine.mean(axis=0), sine.mean(axis=0)
    cosine, sine, rest = cosine - c1, sine - s1, samples - mean
    cc, cs, ss = (cosine**2).sum(axis=0), (cosine * sine).sum(axis=0), (sine**2).sum(axis=0)
    p, q = (cosine * rest).sum(axis=0), (sine * rest).sum(axis=0)
    determinant = cc * ss - cs * cs
    determinant[determinant < DEGENERATE * (0.5 * n) ** 2] = np.nan
    c, s = (p * ss - q * cs) / determinant, (q * cc - p * cs) / determinant
    return mean - c1 * c - s1 * s, c, s, (rest**2).sum(axis=0) - c * p - s * q


def turned_back(samples, shifts_rad, turned_rad, c, s, kept):
    """The samples as without the turns; those of marked pixels as they are."""
    shifts = np.asarray(shifts_rad)[:, None, None]
    angles = shifts - np.asarray(turned_rad, float)
    moved = c * (np.cos(shifts) - np.cos(angles)) + s * (np.sin(shifts) - np.sin(angles))
    return np.asarray(samples, float) + np.where(kept, 0.0, moved)


def warped(values, flow_px, time):
    """The map some frames earlier by cubic splines, float32; NaN from outside and what is NaN."""
    values = values.copy()
    rows, columns = np.nonzero(flow_px.any(axis=-1))
    unknown = ~np.isfinite(values)
    spline = ndimage.spline_filter(np.where(unknown, 0.0, values), order=3, output=np.float32)
    off = np.float32(time) * flow_px[rows, columns]
    places = rows + off[:, 1], columns + off[:, 0]
    moved = ndimage.map_coordinates(spline, places, order=3, prefilter=False, mode="mirror")
    height, width = values.shape
    outside = (places[0] < 0) | (places[0] > height - 1) | (places[1] < 0) | (places[1] > width - 1)
    near = unknown.astype(np.float32)
    outside |= ndimage.map_coordinates(near, places, order=1, mode="nearest") > 0
    values[rows, columns] = np.where(outside, np.float32(np.nan), moved)
    return values


def residual_chi(planes, shown, scatter, lit):
    """χ² of the residuals of a set at every pixel, and its degrees of freedom."""
    values = np.stack(planes).astype(float)
    design = np.asarray(shown["design"], float)
    fitted = np.tensordot(shown["solver"], values, axes=1)
    residual = values - np.tensordot(design, fitted, axes=1)
    if shown["orders"]:
        parts = parts_of_orders(fitted[1] + 1j * fitted[2], shown["orders"])
        residual -= np.tensordot(shown["harmonics"], parts, axes=1)
    variance = scatter["dark"] + scatter["gain"] * np.maximum(fitted[0], 0.0)
    variance += scatter["floor"] * (fitted[1] ** 2 + fitted[2] ** 2)
    with np.errstate(invalid="ignore"):
        chi = np.sum(residual**2, axis=0) / variance
    freedom = len(values) - 3
    usable = lit & ~(values >= scatter["saturation"]).any(axis=0) & np.isfinite(chi)
    return np.where(usable, np.minimum(chi, scatter["most"] * freedom), 0.0), freedom * usable
