"""Geometry of two pupils over a reference plane: height from displacement and back (theory §2)."""

from __future__ import annotations

import numpy as np

from fringeworks.types import (
    NUMBERS,
    DisplacementMap,
    FloatMap,
    HeightMap,
    InputError,
    Reason,
    ReferencePlaneGeometry,
    unmasked,
)


def displacement_from_height(height_mm: FloatMap, geometry: ReferencePlaneGeometry) -> FloatMap:
    """Compute the displacement of the fringes that a height causes.

    Parameters
    ----------
    height_mm : float array of any shape
        Height above the reference plane, positive towards the camera, below ``distance_mm``, mm;
        NaN where unknown.
    geometry : ReferencePlaneGeometry

    Returns
    -------
    float64 array of the same shape
        Displacement in px, with the geometry's sign; NaN where the height is NaN.

    Raises
    ------
    InputError
        If a height reaches the pupils (h ≥ l).

    Notes
    -----
    Theory §2, (3): u = d₀·h / (l − h).

    Examples
    --------
    >>> g = ReferencePlaneGeometry(distance_mm=5000, baseline_mm=2000, pitch_mm_per_px=0.5)
    >>> displacement_from_height(np.array([100.0]), g).round(3)
    array([81.633])
    """
    height = _real(height_mm, "height")
    distance = geometry.distance_mm
    if np.any(height >= distance):
        raise InputError(
            f"height: expected below the pupils at l = {distance:g} mm, got {np.nanmax(height):g}"
        )
    with np.errstate(all="ignore"):
        # Of a height that is not finite, or overflows, no displacement is known.
        u_mm = geometry.baseline_mm * height / (distance - height)
        u_mm = np.where(np.isfinite(u_mm), u_mm, np.nan)
    return geometry.sign * u_mm / geometry.pitch_mm_per_px


def height_from_displacement(
    displacement_px: FloatMap, geometry: ReferencePlaneGeometry
) -> FloatMap:
    """Compute the height above the reference plane that causes a displacement of the fringes.

    Parameters
    ----------
    displacement_px : float array of any shape
        px; NaN where unknown.
    geometry : ReferencePlaneGeometry

    Returns
    -------
    float64 array of the same shape
        Height in mm, positive towards the camera; NaN where u ≤ −d₀, because no height has that
        displacement.

    Notes
    -----
    Theory §2, (1): h = l·u / (d₀ + u).

    Examples
    --------
    >>> g = ReferencePlaneGeometry(distance_mm=5000, baseline_mm=2000)
    >>> height_from_displacement(np.array([0.0, 2000 / 49, -2000.0]), g).round(6)
    array([  0., 100.,  nan])
    """
    displacement = _real(displacement_px, "displacement")
    with np.errstate(all="ignore"):
        u_mm = geometry.sign * displacement * geometry.pitch_mm_per_px
        possible = (u_mm > -geometry.baseline_mm) & np.isfinite(u_mm)
        base = np.where(possible, geometry.baseline_mm + u_mm, np.nan)
        height = geometry.distance_mm * u_mm / base
    return np.where(np.isfinite(height), height, np.nan)


def _real(values: FloatMap, name: str) -> FloatMap:
    """Real numbers in double precision."""
    array = unmasked(values, name)
    if array.dtype.kind not in NUMBERS:
        raise InputError(f"{name}: expected real numbers, got {array.dtype}")
    return array.astype(np.float64)


def to_surface(displacement: DisplacementMap, geometry: ReferencePlaneGeometry | None) -> HeightMap:
    """Convert a displacement to heights in mm, or keep it in px where the geometry is unknown.

    Parameters
    ----------
    displacement : DisplacementMap
        (h, w), px.
    geometry : ReferencePlaneGeometry or None

    Returns
    -------
    HeightMap
        Heights in mm with their σ; NaN (``BEYOND_GEOMETRY``) where no height has the displacement.
        Without a geometry, ``quantity`` is "displacement" and ``unit`` is "px".

    Notes
    -----
    Theory §2, (1) and its derivative, σ_h = l·d₀ / (d₀ + u)² · σ_u.
    """
    if geometry is None:
        return HeightMap(
            values=displacement.displacement_px,
            sigma=displacement.sigma_px,
            reason=displacement.reason,
            quantity="displacement",
            unit="px",
            pitch=1.0,
            method=displacement.method,
            converged=displacement.converged,
        )
    height = height_from_displacement(displacement.displacement_px, geometry)
    u_px = np.asarray(displacement.displacement_px, np.float64)
    u_mm = geometry.sign * u_px * geometry.pitch_mm_per_px
    with np.errstate(all="ignore"):
        rate = geometry.distance_mm * geometry.baseline_mm / (geometry.baseline_mm + u_mm) ** 2
    ok = displacement.reason == Reason.OK
    beyond = (np.isfinite(displacement.displacement_px) | ok) & ~np.isfinite(height)
    reason = displacement.reason.copy()
    reason[beyond] = Reason.BEYOND_GEOMETRY
    sigma = np.where(beyond, np.nan, rate * displacement.sigma_px * geometry.pitch_mm_per_px)
    return HeightMap(
        values=height,
        sigma=sigma,
        reason=reason,
        quantity="height",
        unit="mm",
        pitch=geometry.pitch_mm_per_px,
        method=displacement.method,
        converged=displacement.converged,
        pupil=_pupil(height.shape, geometry),
    )


def _pupil(shape: tuple[int, ...], geometry: ReferencePlaneGeometry) -> tuple[float, float, float]:
    """The camera's pupil. One pitch for the whole plane means that the sensor is parallel to it:
    the foot is then the lens's principal point, near the middle of a frame that is not cropped."""
    rows, columns = shape
    return (0.5 * (columns - 1), 0.5 * (rows - 1), geometry.distance_mm)
