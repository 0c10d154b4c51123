"""Calibration of the two-frame path: a plane at known heights over the reference (theory §2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fringeworks.types import (
    DisplacementMap,
    FloatMap,
    Frozen,
    HeightMap,
    InputError,
    Provenance,
    Reason,
    ReferencePlaneGeometry,
)

WORST = 0.1
"""Error of a plane's height, over the largest, beyond which no geometry explains the planes."""
LEAST = 100
"""Measured pixels that a height needs."""


@dataclass(frozen=True, eq=False, repr=False)
class PlaneCalibration(Frozen):
    """Distance and baseline, from planes at known heights."""

    geometry: ReferencePlaneGeometry
    distance_sigma_mm: float
    """Standard deviation of l by how the planes scatter."""
    baseline_sigma_mm: float
    residual_mm: tuple[float, ...]
    """How far each plane's pixels are off its height: robust standard deviation."""
    provenance: Provenance | None = None
    """How it was made; None where the caller built it."""


@dataclass(frozen=True, eq=False, repr=False)
class PixelCalibration(Frozen):
    """Height from displacement pixel by pixel: 1/h = β/α + 1 / (α u).

    It takes up lens distortion and pupils at different distances, within the calibrated heights.
    Between pupils at equal distances α = l/d₀ and β = 1/d₀.
    """

    slope: FloatMap
    """α, (h, w), mm/px; NaN where not calibrated."""
    bend: FloatMap
    """β, (h, w), 1/px."""
    heights_mm: tuple[float, float]
    """Lowest and highest plane; heights beyond are extrapolated."""
    provenance: Provenance | None = None
    """How it was made; None where the caller built it."""


def _checked(
    displacements_px: Sequence[FloatMap], heights_mm: Sequence[float], least: int
) -> tuple[FloatMap, FloatMap]:
    heights = np.asarray(heights_mm, np.float64)
    if len(displacements_px) != heights.size:
        raise InputError(
            f"planes: expected a height for each, got {len(displacements_px)} and {heights.size}"
        )
    if not np.isfinite(heights).all() or (heights == 0).any():
        raise InputError(
            f"heights: expected finite ones other than 0, the reference itself, got {heights_mm}"
        )
    if np.unique(heights).size < least:
        raise InputError(
            f"heights: expected {least} different ones or more, got {np.unique(heights).size}"
        )
    shapes = {np.shape(d) for d in displacements_px}
    if len(shapes) != 1:
        raise InputError(f"planes: expected maps of one shape, got {sorted(shapes)}")
    return np.stack([np.asarray(d, np.float64) for d in displacements_px]), heights


def calibrate_reference_plane(
    displacements_px: Sequence[FloatMap],
    heights_mm: Sequence[float],
    *,
    pitch_mm_per_px: float,
) -> PlaneCalibration:
    """l and d₀ from a plane at two known heights or more.

    Parameters
    ----------
    displacements_px : sequence of (h, w) arrays
        Displacement of the fringes on the plane at each height against the reference, px.
    heights_mm : sequence of float
        Heights over the reference plane, towards the camera, not 0.
    pitch_mm_per_px : float > 0
        Size of a camera pixel on the reference plane: displacements alone do not tell it. A board
        on the plane does (spacing of its corners).

    Raises
    ------
    InputError for fewer than two heights, maps that do not fit, and displacements that no geometry
    explains.

    Notes
    -----
    From (3), h/u = l/d₀ − h/d₀: linear in what is known exactly, the heights. Each plane counts
    by the median of its displacement.
    """
    maps, heights = _checked(displacements_px, heights_mm, 2)
    if not pitch_mm_per_px > 0:
        raise InputError(f"pitch: expected > 0 mm/px, got {pitch_mm_per_px}")
    count = np.isfinite(maps).sum(axis=(1, 2))
    if count.min() < LEAST:
        raise InputError(
            f"planes: expected {LEAST} measured pixels or more at each height, got {count.min()}"
        )
    # Neighbouring pixels err alike, so the planes, not their pixels, are what is counted.
    u = np.array([np.nanmedian(m) for m in maps]) * pitch_mm_per_px
    solution, covariance = _law(u[:, None], heights)
    slope, bend = (float(v) for v in solution[:, 0])
    distance, baseline = slope / bend if bend else np.inf, 1.0 / bend if bend else np.inf
    misfit = np.abs(slope * u / (1.0 + bend * u) - heights).max()
    lawful = np.isfinite(distance) and distance > heights.max()
    if not (lawful and misfit < WORST * np.abs(heights).max()):
        raise InputError(
            "planes: expected displacements that grow with height, got some that no geometry "
            f"explains (l = {distance:g} mm, d₀ = {baseline:g} mm)"
        )
    # l = α/β and d₀ = 1/β.
    by = np.array([[1.0 / bend, -slope / bend**2], [0.0, -1.0 / bend**2]])
    spread = np.sqrt(np.diag(by @ covariance[0] @ by.T))
    off = [
        slope * (p := m * pitch_mm_per_px) / (1.0 + bend * p) - h
        for m, h in zip(maps, heights, strict=True)
    ]
    geometry = ReferencePlaneGeometry(
        distance_mm=distance,
        baseline_mm=abs(baseline),
        pitch_mm_per_px=pitch_mm_per_px,
        sign=1 if baseline > 0 else -1,
    )
    return PlaneCalibration(
        geometry,
        float(spread[0]),
        float(spread[1]),
        tuple(1.4826 * float(np.nanmedian(np.abs(o))) for o in off),
    )


def _law(u: FloatMap, heights: FloatMap) -> tuple[FloatMap, FloatMap]:
    """α and β of h/u = α − β h, (2, n), for n pixels, and their covariances, (n, 2, 2).

    Displacements (planes, n) have the noise, so they must not be among the regressors; u grows
    with h, and with it the weight of h/u.
    """
    known = np.isfinite(u) & (u != 0)
    h = heights[:, None]
    weight = np.where(known, h * h, 0.0)
    ratio = np.where(known, h / np.where(known, u, 1.0), 0.0)
    s0, s1, s2 = (np.sum(weight * h**k, axis=0) for k in range(3))
    r0, r1 = np.sum(weight * ratio, axis=0), np.sum(weight * ratio * h, axis=0)
    with np.errstate(all="ignore"):
        determinant = s0 * s2 - s1 * s1
        slope = (s2 * r0 - s1 * r1) / determinant
        bend = -(s0 * r1 - s1 * r0) / determinant
        left = np.sum(weight * (ratio - slope + bend * h) ** 2, axis=0)
        freedom = np.maximum(known.sum(axis=0) - 2, 1)
        inverse = np.stack((np.stack((s2, s1), -1), np.stack((s1, s0), -1)), -2)
        covariance = inverse * (left / freedom / determinant)[:, None, None]
    return np.stack((slope, bend)), covariance


def calibrate_pixels(
    displacements_px: Sequence[FloatMap], heights_mm: Sequence[float]
) -> PixelCalibration:
    """The law of every pixel from a plane at three known heights or more.

    Parameters
    ----------
    displacements_px, heights_mm : as for ``calibrate_reference_plane``

    Returns
    -------
    PixelCalibration; NaN where fewer than three heights were measured.

    Notes
    -----
    The inverse-linear law of phase and height (Zhou and Su, Optics Communications 108, 1994), by
    u l − h d = u h at every pixel.
    """
    maps, heights = _checked(displacements_px, heights_mm, 3)
    (slope, bend), _ = _law(maps.reshape(len(maps), -1), heights)
    enough = np.isfinite(maps).sum(axis=0).ravel() >= 3
    with np.errstate(invalid="ignore"):
        grows = [1.0 + bend * m.ravel() > 0 for m in maps]
    good = enough & np.isfinite(slope) & np.isfinite(bend) & (slope != 0)
    good &= np.logical_or.reduce(grows)
    if not good.any():
        raise InputError("planes: expected displacements that grow with height, got none")
    shape = maps.shape[1:]
    return PixelCalibration(
        np.where(good, slope, np.nan).reshape(shape),
        np.where(good, bend, np.nan).reshape(shape),
        (float(heights.min()), float(heights.max())),
    )


def height_by_pixel(phase: DisplacementMap, calibration: PixelCalibration) -> HeightMap:
    """Heights in mm by a calibration of every pixel.

    h = α u / (1 + β u), σ_h = α / (1 + β u)² σ_u. Pixels that were not calibrated are NaN.
    """
    shape = phase.displacement_px.shape
    if calibration.slope.shape != shape:
        raise InputError(f"calibration: expected shape {shape}, got {calibration.slope.shape}")
    u = phase.displacement_px
    with np.errstate(all="ignore"):
        base = 1.0 + calibration.bend * u
        height = calibration.slope * u / base
        sigma = np.abs(calibration.slope) / base**2 * phase.sigma_px
        good = np.isfinite(height) & (base > 0)
    reason = phase.reason.copy()
    reason[(reason == Reason.OK) & ~np.isfinite(calibration.slope)] = Reason.UNDETERMINED
    reason[(reason == Reason.OK) & ~good] = Reason.BEYOND_GEOMETRY
    ok = reason == Reason.OK
    return HeightMap(
        values=np.where(ok, height, np.nan),
        sigma=np.where(ok, sigma, np.nan),
        reason=reason,
        quantity="height",
        unit="mm",
        pitch=1.0,
        method=phase.method,
    )
