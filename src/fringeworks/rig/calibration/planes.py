"""Calibration of the two-frame path from a plane at known heights (theory §2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fringeworks.statistics.quantiles import MAD_TO_SIGMA
from fringeworks.types import (
    DisplacementMap,
    FloatMap,
    Frozen,
    HeightMap,
    InputError,
    Provenance,
    Reason,
    ReferencePlaneGeometry,
    finite,
    positive,
)

MAX_MISFIT = 0.1
"""Largest error of a plane's height, as a share of the largest height.

With a larger error no geometry explains the planes: an order or a height is usually wrong. An
empirical choice.
"""
MIN_PLANE_PIXELS = 100
"""Smallest number of measured pixels at each height.

The median displacement of fewer pixels is not robust against outliers. An empirical choice.
"""


@dataclass(frozen=True, eq=False, repr=False)
class PlaneCalibration(Frozen):
    """Distance and baseline from planes at known heights."""

    geometry: ReferencePlaneGeometry
    distance_sigma_mm: float
    """Standard deviation of l from the scatter of the planes, mm; with two planes 0."""
    baseline_sigma_mm: float
    """Standard deviation of d₀ from the scatter of the planes, mm; with two planes 0."""
    residual_mm: tuple[float, ...]
    """Deviation of each plane's pixels from its height, mm: robust standard deviation."""
    provenance: Provenance | None = None
    """How it was made; None where the caller built it."""


@dataclass(frozen=True, eq=False, repr=False)
class PixelCalibration(Frozen):
    """Height from displacement at every pixel: h = α u / (1 + β u).

    Within the calibrated heights it also corrects for lens distortion and for pupils at different
    distances. With pupils at equal distances α = l/d₀ and β = 1/d₀.
    """

    layout = {  # noqa: RUF012
        "slope": "fiu hw",
        "bend": "fiu hw",
    }

    slope: FloatMap
    """α, (h, w), mm/px; NaN where not calibrated."""
    bend: FloatMap
    """β, (h, w), 1/px; NaN where not calibrated."""
    heights_mm: tuple[float, float]
    """Lowest and highest plane, mm; heights beyond are extrapolated."""
    provenance: Provenance | None = None
    """How it was made; None where the caller built it."""
    pitch_mm_per_px: float | None = None
    """Size of a camera pixel on the reference plane, mm/px; None where unknown. Heights do not need
    it, only the distances between pixels."""

    def __post_init__(self) -> None:
        super().__post_init__()
        pitch = self.pitch_mm_per_px
        if pitch is not None and not positive(pitch):
            raise InputError(f"calibration: expected a pitch > 0, got {pitch}")


def _checked(
    displacements_px: Sequence[FloatMap], heights_mm: Sequence[float], minimum: int
) -> tuple[FloatMap, FloatMap]:
    """Displacements as (planes, h, w) and heights as (planes,), at least ``minimum`` different."""
    heights = np.asarray(heights_mm, np.float64)
    if len(displacements_px) != heights.size:
        raise InputError(
            f"planes: expected a height for each, got {len(displacements_px)} planes and "
            f"{heights.size} heights"
        )
    if not finite(*heights) or not positive(*np.abs(heights)):
        raise InputError(
            f"heights: expected finite values other than 0 (the reference), got {heights_mm}"
        )
    if np.unique(heights).size < minimum:
        raise InputError(
            f"heights: expected at least {minimum} different ones, got {np.unique(heights).size}"
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
    """Determine distance l and baseline d₀ from a plane at two or more known heights.

    Parameters
    ----------
    displacements_px : sequence of (h, w) float arrays
        Displacement of the fringes on the plane at each height against the reference, px; NaN
        where not measured.
    heights_mm : sequence of float
        Heights over the reference plane, positive towards the camera, not 0, mm.
    pitch_mm_per_px : float > 0
        Size of a camera pixel on the reference plane, mm/px. Displacements do not determine it; the
        corner spacing of a board on the plane does.

    Returns
    -------
    PlaneCalibration

    Raises
    ------
    InputError
        If there are fewer than two different heights or too few measured pixels, if the maps do not
        fit together, or if no geometry explains the displacements.

    Notes
    -----
    Theory §2: from (3), h/u = l/d₀ − h/d₀, which is linear in h, and h is known exactly. Each plane
    is represented by its median displacement.

    Examples
    --------
    >>> planes = [np.full((10, 10), 2000.0 * h / (5000.0 - h)) for h in (20.0, 50.0)]
    >>> calibration = calibrate_reference_plane(planes, (20.0, 50.0), pitch_mm_per_px=1.0)
    >>> round(calibration.geometry.distance_mm, 3), round(calibration.geometry.baseline_mm, 3)
    (5000.0, 2000.0)
    """
    maps, heights = _checked(displacements_px, heights_mm, 2)
    if not positive(pitch_mm_per_px):
        raise InputError(f"pitch: expected > 0 mm/px, got {pitch_mm_per_px}")
    count = np.isfinite(maps).sum(axis=(1, 2))
    if count.min() < MIN_PLANE_PIXELS:
        raise InputError(
            f"planes: expected at least {MIN_PLANE_PIXELS} measured pixels at each height, "
            f"got {count.min()}"
        )
    # Errors of neighbouring pixels are correlated, so the planes count, not their pixels.
    u = np.array([np.nanmedian(m) for m in maps]) * pitch_mm_per_px
    solution, covariance = _fit_law(u[:, None], heights)
    slope, bend = (float(v) for v in solution[:, 0])
    distance, baseline = slope / bend if bend else np.inf, 1.0 / bend if bend else np.inf
    misfit = np.abs(slope * u / (1.0 + bend * u) - heights).max()
    possible = np.isfinite(distance) and distance > heights.max()
    if not (possible and misfit < MAX_MISFIT * np.abs(heights).max()):
        raise InputError(
            "planes: expected displacements that grow with height, got some that no geometry "
            f"explains (l = {distance:g} mm, d₀ = {baseline:g} mm)"
        )
    # Derivatives of l = α/β and d₀ = 1/β with respect to α and β.
    jacobian = np.array([[1.0 / bend, -slope / bend**2], [0.0, -1.0 / bend**2]])
    sigma = np.sqrt(np.diag(jacobian @ covariance[0] @ jacobian.T))
    residuals = [
        slope * (u_mm := m * pitch_mm_per_px) / (1.0 + bend * u_mm) - h
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
        distance_sigma_mm=float(sigma[0]),
        baseline_sigma_mm=float(sigma[1]),
        residual_mm=tuple(MAD_TO_SIGMA * float(np.nanmedian(np.abs(r))) for r in residuals),
    )


def _fit_law(u: FloatMap, heights: FloatMap) -> tuple[FloatMap, FloatMap]:
    """Fit h/u = α − β h by weighted least squares.

    Parameters
    ----------
    u : (planes, n) float array
        Displacements of n pixels, or of one plane each (n = 1); NaN where unknown.
    heights : (planes,) float array, mm

    Returns
    -------
    solution : (2, n) float array, α and β
    covariance : (n, 2, 2) float array, of α and β

    Notes
    -----
    Displacements have noise, so they are not used as regressors. Since u grows with h, the weight
    of h/u is proportional to h².
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
        residual = np.sum(weight * (ratio - slope + bend * h) ** 2, axis=0)
        freedom = np.maximum(known.sum(axis=0) - 2, 1)
        inverse = np.stack((np.stack((s2, s1), -1), np.stack((s1, s0), -1)), -2)
        covariance = inverse * (residual / freedom / determinant)[:, None, None]
    return np.stack((slope, bend)), covariance


def calibrate_pixels(
    displacements_px: Sequence[FloatMap],
    heights_mm: Sequence[float],
    *,
    pitch_mm_per_px: float | None = None,
) -> PixelCalibration:
    """Determine the law of height and displacement at every pixel from three or more known heights.

    Parameters
    ----------
    displacements_px : sequence of (h, w) float arrays
        Displacement of the fringes on the plane at each height against the reference, px; NaN
        where not measured.
    heights_mm : sequence of float
        Heights over the reference plane, positive towards the camera, not 0, mm.
    pitch_mm_per_px : float > 0, optional
        Size of a camera pixel on the reference plane, where it is known.

    Returns
    -------
    PixelCalibration
        NaN at pixels with fewer than three measured heights.

    Raises
    ------
    InputError
        If there are fewer than three different heights, if the maps do not fit together, or if no
        pixel can be calibrated.

    Notes
    -----
    The inverse-linear law 1/h = β/α + 1/(α u) of phase and height (Zhou and Su, Optics
    Communications 108, 1994), fitted as h/u = α − β h at every pixel.
    """
    maps, heights = _checked(displacements_px, heights_mm, 3)
    (slope, bend), _ = _fit_law(maps.reshape(len(maps), -1), heights)
    enough = np.isfinite(maps).sum(axis=0).ravel() >= 3
    with np.errstate(invalid="ignore"):
        grows = [1.0 + bend * m.ravel() > 0 for m in maps]
    good = enough & np.isfinite(slope) & np.isfinite(bend) & (slope != 0)
    good &= np.logical_or.reduce(grows)
    if not good.any():
        raise InputError("planes: expected displacements that grow with height, got none")
    shape = maps.shape[1:]
    return PixelCalibration(
        slope=np.where(good, slope, np.nan).reshape(shape),
        bend=np.where(good, bend, np.nan).reshape(shape),
        heights_mm=(float(heights.min()), float(heights.max())),
        pitch_mm_per_px=pitch_mm_per_px,
    )


def height_by_pixel(displacement: DisplacementMap, calibration: PixelCalibration) -> HeightMap:
    """Convert a displacement to heights in mm by a calibration of every pixel.

    Parameters
    ----------
    displacement : DisplacementMap
        (h, w), px.
    calibration : PixelCalibration
        Of the same shape.

    Returns
    -------
    HeightMap
        mm, positive towards the camera; NaN where the pixel was not calibrated (``UNDETERMINED``)
        or no height has its displacement (``BEYOND_GEOMETRY``).

    Raises
    ------
    InputError
        If the shapes differ.

    Notes
    -----
    h = α u / (1 + β u), σ_h = |α| / (1 + β u)² · σ_u.
    """
    shape = displacement.displacement_px.shape
    if calibration.slope.shape != shape:
        raise InputError(f"calibration: expected shape {shape}, got {calibration.slope.shape}")
    u = displacement.displacement_px
    with np.errstate(all="ignore"):
        base = 1.0 + calibration.bend * u
        height = calibration.slope * u / base
        sigma = np.abs(calibration.slope) / base**2 * displacement.sigma_px
        good = np.isfinite(height) & (base > 0)
    reason = displacement.reason.copy()
    reason[(reason == Reason.OK) & ~np.isfinite(calibration.slope)] = Reason.UNDETERMINED
    reason[(reason == Reason.OK) & ~good] = Reason.BEYOND_GEOMETRY
    ok = reason == Reason.OK
    return HeightMap(
        values=np.where(ok, height, np.nan),
        sigma=np.where(ok, sigma, np.nan),
        reason=reason,
        quantity="height",
        unit="mm",
        pitch=calibration.pitch_mm_per_px,
        method=displacement.method,
        converged=displacement.converged,
    )
