"""Points of a view with their normals: what registration, fusion and features work on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringeworks.rig.pinhole import transform
from fringeworks.surface.clean import inside_surface
from fringeworks.surface.cloud import normals
from fringeworks.types import FloatMap, Frozen, InputError, PointCloud

MIN_FACING = 0.17
"""Smallest cosine between a normal and the camera's ray. Points seen at less than 10° are left out:
pixels there cover a long stretch of the surface, and their normals are poor."""
USUAL_BLUR_PX = 0.5
"""Standard deviation of the blur of a camera in focus, px."""
SHIFT_PER_VARIANCE = 0.04
"""Standard deviation of the error that blur causes where it is not removed (``remove_blur``), as a
shift along the image, px per px² of its variance. On the virtual rig with a blur of 0.5 px, 0.01 px
explain the errors of pairs of views beyond their noise. The σ of such a cloud does not contain it,
because it is far below the noise of one pixel; averages of many pixels see it."""
MIN_POINTS = 200
"""Smallest number of points of a view: fewer determine no pose."""


@dataclass(frozen=True, eq=False, repr=False)
class SurfacePoints(Frozen):
    """Points of one view, in some coordinates, with normals that point out of the surface."""

    xyz_mm: FloatMap
    """(n, 3), mm."""
    normals: FloatMap
    """(n, 3)."""
    sigma_mm: FloatMap
    """Standard deviation along the normal, of noise and calibration, (n,), mm."""
    noise_mm: FloatMap
    """The part that is independent from point to point, (n,), mm."""
    blur_mm: FloatMap
    """The part that the camera's blur causes, (n,), mm: alike in neighbouring points, but different
    from view to view."""
    colour: FloatMap | None
    """Brightness (n,) or colour (n, 3), counts."""
    errors: FloatMap | None = None
    """Errors that the rig's covariance stands for, (n, 3, k), mm: k independent parts, which all
    points have in common. None where they are not known."""

    def moved(self, T: FloatMap) -> SurfacePoints:
        """The points in the coordinates that ``T`` (4, 4) maps to."""
        return SurfacePoints(
            transform(T, self.xyz_mm),
            self.normals @ T[:3, :3].T,
            self.sigma_mm,
            self.noise_mm,
            self.blur_mm,
            self.colour,
            None if self.errors is None else np.einsum("ij,njk->nik", T[:3, :3], self.errors),
        )

    def at(self, index: NDArray[Any]) -> SurfacePoints:
        """The points of an index or mask."""
        return SurfacePoints(
            self.xyz_mm[index],
            self.normals[index],
            self.sigma_mm[index],
            self.noise_mm[index],
            self.blur_mm[index],
            None if self.colour is None else self.colour[index],
            None if self.errors is None else self.errors[index],
        )


def together(views: Sequence[SurfacePoints]) -> SurfacePoints:
    """The points of several views in the same coordinates, without brightness and ``errors``."""
    return SurfacePoints(
        np.concatenate([v.xyz_mm for v in views]),
        np.concatenate([v.normals for v in views]),
        np.concatenate([v.sigma_mm for v in views]),
        np.concatenate([v.noise_mm for v in views]),
        np.concatenate([v.blur_mm for v in views]),
        None,
    )


def surface_points(cloud: PointCloud, *, blur_px: float = USUAL_BLUR_PX) -> SurfacePoints:
    """The points inside a cloud's surface that are not seen at a grazing angle.

    Parameters
    ----------
    cloud : PointCloud
    blur_px : float ≥ 0
        Standard deviation of the camera's blur, px, for clouds that it was not removed from.

    Returns
    -------
    SurfacePoints in the coordinates of the cloud. σ along the ray becomes σ along the normal by the
    cosine between the two. Where blur was not removed, the error by it is added. Points beside a
    missing pixel or a step in depth are left out: their light is mixed with that of another surface
    or of a shadow (``inside_surface``).

    Raises
    ------
    InputError for fewer than 200 such points.
    """
    if cloud.placement is not None:
        here = surface_points(cloud.in_camera(), blur_px=blur_px)
        return here.moved(cloud.placement.T_frame_camera)
    turned = normals(cloud)
    with np.errstate(invalid="ignore"):
        facing = -np.sum(turned * cloud.xyz_mm, axis=-1) / np.linalg.norm(cloud.xyz_mm, axis=-1)
        ok = inside_surface(cloud) & (facing > MIN_FACING)
    if np.count_nonzero(ok) < MIN_POINTS:
        raise InputError(
            f"view: expected {MIN_POINTS} points with normals or more, got {np.count_nonzero(ok)}"
        )
    cosine = facing[ok].astype(np.float64)
    sigma = cloud.sigma_mm[ok] * cosine
    if cloud.blur_mm is not None:
        blur = np.abs(cloud.blur_mm[ok]) * cosine
    else:
        with np.errstate(invalid="ignore"):
            slopes = np.diff(cloud.xyz_mm[..., 0] / cloud.xyz_mm[..., 2], axis=1)
            step = float(np.nanmedian(np.abs(slopes)))
        shift = SHIFT_PER_VARIANCE * blur_px**2 * step
        blur = shift * cloud.xyz_mm[ok][:, 2] * np.sqrt(1.0 - cosine**2)
        sigma = np.hypot(sigma, blur)
    return SurfacePoints(
        cloud.xyz_mm[ok].astype(np.float64),
        turned[ok].astype(np.float64),
        sigma,
        cloud.noise_mm[ok] * cosine,
        blur,
        None if cloud.colour is None else np.asarray(cloud.colour[ok], np.float64),
    )
