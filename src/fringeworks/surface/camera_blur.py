"""Points without the error that the camera's blur causes on curved and on unevenly lit surfaces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from fringeworks.rig.pinhole import project, transform
from fringeworks.surface.clean import inside_surface
from fringeworks.types import Axis, FloatMap, InputError, PointCloud, Rig

WINDOWS_PX = (5, 3)
"""Sides of the windows in which slopes and curvatures are fitted, px. With 5 px the correction
hardly adds to the noise of a point, with 3 px some 5 %, so that the smaller one is taken only where
the larger one does not fit inside the surface, or crosses a crease."""
CREASE_SIGMAS = 4.0
"""Difference of the corrections by both windows, in standard deviations of its noise, from which on
a crease is taken to cross the larger one."""
MAX_BLUR_PX = 3.0
"""Largest blur that is corrected, px. The correction is that of the first order in the variance of
the blur; at 3 px the next order is no longer small."""
BLUR_SHARE = 0.15
"""Standard deviation of the correction, as a share of it. The blur of a board's corners differs by
a few per cent over the image, and higher orders of the blur are left out."""
REACH_PX = 3.0
"""Distance up to which points without a correction take over the nearest one, px: the margin of the
smallest window inside a surface, and its diagonal."""
STEP = 1e-3
"""Step for the derivative of the projector's coordinate by the distance, relative: small against
the perspective, large against rounding."""


def remove_blur(
    cloud: PointCloud,
    rig: Rig,
    blur_px: float,
    *,
    axis: Axis | None = None,
    period_px: float | None = None,
    removed_px: float = 0.0,
) -> PointCloud:
    """Move points to where the camera would see them without blur.

    Parameters
    ----------
    cloud : PointCloud
        With brightness.
    rig : Rig
        The one that the points were measured with.
    blur_px : float, 0…3
        Standard deviation of the camera's blur, with that of the pixels themselves, px; as
        ``board_pose`` measures it. 0.3 px is a perfect lens.
    axis : "x" or "y", optional
        Axis of the fringes, where they ran along one only; by default the direction that depends on
        depth.
    period_px : float > 0, optional
        Shortest period of the fringes, projector px. Where the camera sees it with few pixels, blur
        changes curved fringes less; by default it is taken to be long.
    removed_px : float ≥ 0
        Blur whose shift at edges of brightness ``decode`` has already removed, px:
        ``details[axis]["removed_blur_px"]`` of its result.

    Returns
    -------
    PointCloud. Where the surface ends within 2 px, points take over the nearest correction. σ grows
    by 0.15 of the correction. On creases, σ and noise also grow by half of the difference between
    the two windows; where a correction is taken over, by the whole correction.

    Raises
    ------
    InputError for a cloud without brightness, and a blur out of range.

    Notes
    -----
    Blur of variance v turns the fringes' wave B exp(iku) into B exp(iku) + v ∇²(B exp(iku)) / 2, so
    the coordinate u is shifted by v (∇ln B · ∇u + ∇²u / 2 − v k² ∇uᵀ H ∇u / 2) with H the second
    derivatives of u: towards the brighter side, and against the curvature. The last term follows
    from the integral of a Gaussian and a wave of quadratic phase. A ball of 50 mm that is seen with
    0.5 mm/px and a blur of 0.5 px becomes 0.01 mm too small.

    Examples
    --------
    >>> from fringeworks.simulate import standard_rig
    >>> x, y = np.meshgrid(np.arange(-6.0, 7.0), np.arange(-6.0, 7.0))
    >>> xyz = np.stack((x, y, 475.0 + (x**2 + y**2) / 50.0), axis=-1)
    >>> flat = np.zeros(x.shape)
    >>> ball = PointCloud(xyz, flat, flat, flat.astype(np.uint8), colour=flat + 100.0)
    >>> found = remove_blur(ball, standard_rig(), 0.5)
    >>> round(float((ball.xyz_mm - found.xyz_mm)[6, 6, 2]), 3)
    0.01
    """
    if cloud.colour is None:
        raise InputError("cloud: expected brightness to remove the blur by, got none")
    if not 0 <= blur_px <= MAX_BLUR_PX:
        raise InputError(f"blur_px: expected 0 to {MAX_BLUR_PX:g} px, got {blur_px:g}")
    xyz = np.where(cloud.reason[..., None] == 0, cloud.xyz_mm, 1.0).astype(np.float64)
    pixel = _projected(rig, xyz)
    length = np.linalg.norm(xyz, axis=-1)
    rate = (_projected(rig, xyz * (1.0 + STEP)) - pixel) / (STEP * length[..., None])
    colour = cloud.colour if cloud.colour.ndim == 2 else cloud.colour.mean(axis=2)
    light = np.log(np.maximum(np.nan_to_num(colour, nan=1.0), 1.0)).astype(np.float64)
    inside = inside_surface(cloud)
    variances = (blur_px**2, blur_px**2 - removed_px**2)
    wave = 0.0 if period_px is None else 2.0 * np.pi / period_px
    found = []
    for window in WINDOWS_PX:
        shift = _shift(pixel, light, variances, wave, window)
        if axis is None:
            along = np.sum(shift * rate, axis=-1) / np.sum(rate * rate, axis=-1)
        else:
            column = "xy".index(axis)
            along = shift[..., column] / rate[..., column]
        whole = scipy.ndimage.minimum_filter(inside, window, mode="constant", cval=False)
        found.append(np.where(whole & np.isfinite(along), along, np.nan))
    along, local = _chosen(found[0], found[1], blur_px**2 * cloud.noise_mm)
    moved = cloud.xyz_mm * (1.0 - along / length)[..., None]
    shared = np.hypot(local, BLUR_SHARE * along)
    return replace(
        cloud,
        xyz_mm=moved.astype(np.float32),
        sigma_mm=np.hypot(cloud.sigma_mm, shared).astype(np.float32),
        noise_mm=np.hypot(cloud.noise_mm, local).astype(np.float32),
    )


def _chosen(large: FloatMap, small: FloatMap, noise: FloatMap) -> tuple[FloatMap, FloatMap]:
    """The correction by one of two windows, and the doubt of the choice, (h, w), mm.

    ``noise`` is that of the correction by the small window: half the variance of the blur times the
    noise of a Laplacian over 3 × 3 px, which is twice that of a pixel.
    """
    with np.errstate(invalid="ignore"):
        crease = np.abs(large - small) > CREASE_SIGMAS * noise
    along = np.where(np.isfinite(large) & ~crease, large, small)
    doubt = np.where(crease, 0.5 * np.abs(large - small), 0.0)
    known = np.isfinite(along)
    if not known.any():
        return np.zeros(along.shape), np.zeros(along.shape)
    usual = float(np.sqrt(np.mean(along[known] ** 2)))
    distance, nearest = scipy.ndimage.distance_transform_edt(~known, return_indices=True)
    beside = np.where(distance <= REACH_PX, np.abs(along[tuple(nearest)]), 0.0)
    return np.where(known, along, 0.0), np.where(known, doubt, np.maximum(beside, usual))


def _projected(rig: Rig, xyz: FloatMap) -> FloatMap:
    return project(rig.projector, transform(rig.T_projector_camera, xyz))


def _shift(
    pixel: FloatMap, light: FloatMap, variances: tuple[float, float], wave: float, window: int
) -> FloatMap:
    """Shift of both projector coordinates by the blur, (h, w, 2), px; ``variances`` are those of
    the whole blur and of what is left of it at edges of brightness, ``wave`` is k, rad/px."""
    variance, left = variances
    bx, by = _derivatives(light, window)[:2]
    shift = np.empty(pixel.shape)
    for k in range(2):
        ux, uy, uxx, uyy, uxy = _derivatives(pixel[..., k], window)
        along = ux**2 * uxx + 2.0 * ux * uy * uxy + uy**2 * uyy
        bend = uxx + uyy - variance * wave**2 * along
        shift[..., k] = left * (bx * ux + by * uy) + 0.5 * variance * bend
    return shift


def _derivatives(values: FloatMap, window: int) -> tuple[FloatMap, ...]:
    """Derivatives of parabolas fitted in square windows: by x, y, xx, yy, xy, per px and px²."""
    at = np.arange(window) - window // 2
    flat = np.full(window, 1.0 / window)
    slope = at / np.sum(at**2)
    square = at**2 - np.mean(at**2)
    bend = 2.0 * square / np.sum(square**2)

    def by(down: FloatMap, across: FloatMap) -> FloatMap:
        rows = scipy.ndimage.correlate1d(values, down, axis=0, mode="nearest")
        return np.asarray(scipy.ndimage.correlate1d(rows, across, axis=1, mode="nearest"))

    first = (by(flat, slope), by(slope, flat))
    return (*first, by(flat, bend), by(bend, flat), by(slope, slope))
