"""Errors against a known truth, and tables that compare methods."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from fringeworks.types import (
    LARGEST,
    NUMBERS,
    BoolMap,
    FloatMap,
    HeightMap,
    InputError,
    Reason,
    unmasked,
)

EDGE_BAND_PX = 5
"""Pixels to either side of a cliff whose errors are stated separately."""
EDGE_SLOPE = 2.0
"""Neighbours that differ by more than this (mm per mm) make a cliff."""


@dataclass(frozen=True)
class Errors:
    """Errors of a surface, mm; over measured pixels only, with the share that failed."""

    mean_abs_error_mm: float
    mean_error_mm: float
    std_error_mm: float
    max_abs_error_mm: float
    failed_fraction: float
    edge_mean_abs_error_mm: float
    """Mean absolute error within 5 px of a cliff; NaN where there is none."""
    inner_mean_abs_error_mm: float
    """Mean absolute error of the other pixels; NaN where there are none."""
    within_1_sigma: float
    """Share of errors no larger than the stated σ; 0.683 where σ is right and errors are normal."""
    within_2_sigma: float


def error_map(surface: HeightMap, truth_mm: FloatMap) -> FloatMap:
    """Measured minus true height, (h, w), mm; NaN where not measured."""
    if surface.unit != "mm":
        raise InputError("errors: expected heights in mm, got displacements in px")
    if surface.values.shape != truth_mm.shape:
        raise InputError(f"truth: expected shape {surface.values.shape}, got {truth_mm.shape}")
    if truth_mm.dtype.kind not in NUMBERS:
        raise InputError(f"truth: expected real numbers, got {truth_mm.dtype}")
    with np.errstate(all="ignore"):
        return np.asarray(surface.values - truth_mm.astype(np.float64))


def edge_band(truth_mm: FloatMap, pitch: float) -> BoolMap:
    """True within ``EDGE_BAND_PX`` of a cliff of the true surface, (h, w)."""
    with np.errstate(all="ignore"):  # where the truth is not known, no cliff is
        truth = truth_mm.astype(np.float64)
        high = scipy.ndimage.maximum_filter(truth, 2) - scipy.ndimage.minimum_filter(truth, 2)
    cliff = high > EDGE_SLOPE * pitch
    if not cliff.any():
        return np.zeros(truth_mm.shape, bool)
    return np.asarray(scipy.ndimage.distance_transform_cdt(~cliff, "chessboard") <= EDGE_BAND_PX)


def errors(surface: HeightMap, truth_mm: FloatMap) -> Errors:
    """Errors of a surface against the truth: means, deviation, share within σ.

    Parameters
    ----------
    surface : HeightMap in mm
    truth_mm : (h, w) float array

    Raises
    ------
    InputError where the surface is in px, shapes differ or no pixel was measured.
    """
    truth_mm = unmasked(truth_mm, "truth")
    difference = error_map(surface, truth_mm)
    valid = np.isfinite(difference)
    if not valid.any():
        raise InputError("errors: expected at least one measured pixel, got none")
    # Without a pitch, slopes are unknown, and so are the cliffs.
    band = None if surface.pitch is None else edge_band(truth_mm, surface.pitch)
    e = difference[valid]
    if np.abs(e).max() > LARGEST:
        raise InputError(f"errors: expected errors up to {LARGEST:g} mm, got more")
    with np.errstate(all="ignore"):  # without a σ, no error is within it
        ratio = np.abs(e) / surface.sigma[valid]

    def mean_abs(*, edge: bool) -> float:
        chosen = difference[valid & (band == edge)] if band is not None else difference[:0]
        return float(np.abs(chosen).mean()) if chosen.size else float("nan")

    return Errors(
        mean_abs_error_mm=float(np.abs(e).mean()),
        mean_error_mm=float(e.mean()),
        std_error_mm=float(e.std()),
        max_abs_error_mm=float(np.abs(e).max()),
        failed_fraction=float(np.mean(~valid[surface.reason != Reason.MASKED])),
        edge_mean_abs_error_mm=mean_abs(edge=True),
        inner_mean_abs_error_mm=mean_abs(edge=False),
        within_1_sigma=float(np.mean(ratio <= 1.0)),
        within_2_sigma=float(np.mean(ratio <= 2.0)),
    )
