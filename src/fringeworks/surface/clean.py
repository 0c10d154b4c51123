"""Where a point cloud ends, and its cleaning: isolated points, mixed pixels, islands, cropping."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fringeworks._lazy import scipy
from fringeworks.surface.cloud import cloud_triangles
from fringeworks.types import (
    NUMBERS,
    BoolMap,
    FloatMap,
    InputError,
    PointCloud,
    Reason,
    finite,
    positive,
    unmasked,
)

MIN_ISLAND_PX = 50
"""Smallest number of connected pixels that is kept. Empirical: dust and reflections give a few."""


def inside_surface(cloud: PointCloud, distance_px: int = 1) -> BoolMap:
    """Find the pixels whose neighbours all continue the same surface.

    Parameters
    ----------
    cloud : PointCloud
    distance_px : int ≥ 1
        How far the surface goes on around a pixel, px.

    Returns
    -------
    (h, w) bool array. False beside pixels without a point, and beside steps in depth as
    ``cloud_triangles`` finds them. Blur mixes the light of two surfaces there, or of a surface and
    its shadow.

    Examples
    --------
    >>> from fringeworks.types import PointCloud
    >>> z = np.full((5, 5), 500.0)
    >>> z[:, 3:] = 540.0
    >>> y, x = np.mgrid[:5, :5] * 1.0
    >>> flat = np.zeros((5, 5))
    >>> cloud = PointCloud(np.stack((x, y, z), -1), flat, flat, flat.astype(np.uint8))
    >>> inside_surface(cloud)[2].tolist()
    [False, True, False, False, False]
    """
    h, w = cloud.shape
    faces = cloud_triangles(cloud).astype(np.int64)
    # A square of four pixels has two triangles: one begins at its first pixel, one at its second.
    square = np.where(faces[:, 1] - faces[:, 0] == w, faces[:, 0], faces[:, 0] - 1)
    whole = np.bincount(square, minlength=h * w).reshape(h, w) == 2
    inner = np.zeros((h, w), bool)
    inner[1:, 1:] = whole[1:, 1:] & whole[:-1, 1:] & whole[1:, :-1] & whole[:-1, :-1]
    if distance_px > 1:
        side = 2 * distance_px - 1
        inner = scipy.ndimage.minimum_filter(inner, side, mode="constant", cval=False)
    return np.asarray(inner)


def clean_cloud(
    cloud: PointCloud,
    *,
    min_island_px: int = MIN_ISLAND_PX,
    max_sigma_mm: float | None = None,
) -> PointCloud:
    """Remove points that no surface supports: single ones, mixtures on edges, small islands.

    Parameters
    ----------
    cloud : PointCloud
    min_island_px : int ≥ 1
        Smallest number of pixels of a connected surface that is kept. Pixels are connected by the
        triangles of ``cloud_triangles``, which are not nearly parallel to the camera's ray and not
        far longer than usual: a point between front and back of an edge has none.
    max_sigma_mm : float > 0, optional
        Largest σ of a point that is kept, mm; by default any.

    Returns
    -------
    PointCloud, the removed points NaN with the reason ``Reason.ISOLATED``.

    Raises
    ------
    InputError for limits out of range.
    """
    if not finite(min_island_px) or min_island_px < 1:
        raise InputError(f"min_island_px: expected 1 or more, got {min_island_px}")
    if max_sigma_mm is not None and not positive(max_sigma_mm):
        raise InputError(f"max_sigma_mm: expected > 0, got {max_sigma_mm}")
    kept = cloud.reason == Reason.OK
    if max_sigma_mm is not None:
        kept &= cloud.sigma_mm <= max_sigma_mm
    kept &= _large_islands(_without(cloud, ~kept, Reason.ISOLATED), min_island_px)
    return _without(cloud, ~kept, Reason.ISOLATED)


def crop_cloud(
    cloud: PointCloud,
    *,
    box_mm: FloatMap | None = None,
    plane: tuple[FloatMap, FloatMap] | None = None,
    mask: BoolMap | None = None,
) -> PointCloud:
    """Keep the points inside a box, on one side of a plane, and in a mask.

    Parameters
    ----------
    cloud : PointCloud
    box_mm : (2, 3) array, optional
        Smallest and largest x, y, z in camera coordinates, mm; ±∞ for no limit.
    plane : (point, normal), optional
        A point (3,), mm, and a normal (3,) of any length. Points on the side that the normal points
        to are kept.
    mask : (h, w) bool array, optional
        True where points are kept.

    Returns
    -------
    PointCloud, the other points NaN with the reason ``Reason.MASKED``.

    Raises
    ------
    InputError for a box, plane or mask of another shape, and for a box without content.
    """
    kept = np.ones(cloud.shape, bool)
    with np.errstate(invalid="ignore"):
        if box_mm is not None:
            box = unmasked(box_mm, "box_mm")
            if box.dtype.kind not in NUMBERS or box.shape != (2, 3) or not (box[0] < box[1]).all():
                raise InputError(
                    f"box_mm: expected smallest and largest x, y, z, got {box.tolist()}"
                )
            kept &= ((cloud.xyz_mm >= box[0]) & (cloud.xyz_mm <= box[1])).all(axis=-1)
        if plane is not None:
            if len(plane) != 2:
                raise InputError(f"plane: expected a point and a normal, got {len(plane)} values")
            point, normal = (np.asarray(part, np.float64) for part in plane)
            if (
                point.shape != (3,)
                or not finite(*point, *normal.ravel())
                or normal.shape != (3,)
                or not np.linalg.norm(normal) > 0
            ):
                raise InputError(
                    f"plane: expected a point and a normal of 3 values, got {point.shape} "
                    f"and {normal.shape}"
                )
            kept &= (cloud.xyz_mm - point) @ normal >= 0
    if mask is not None:
        mask = unmasked(mask, "mask")
        if mask.shape != cloud.shape or mask.dtype != bool:
            raise InputError(f"mask: expected bool {cloud.shape}, got {mask.dtype} {mask.shape}")
        kept &= mask
    return _without(cloud, ~kept, Reason.MASKED)


def _without(cloud: PointCloud, removed: BoolMap, reason: Reason) -> PointCloud:
    """The cloud with points removed for a reason; what had no point keeps its own reason."""
    gone = removed & (cloud.reason == Reason.OK)

    def kept(values: FloatMap) -> FloatMap:
        return np.where(gone, np.float32(np.nan), values)

    return replace(
        cloud,
        xyz_mm=np.where(gone[..., None], np.float32(np.nan), cloud.xyz_mm),
        sigma_mm=kept(cloud.sigma_mm),
        noise_mm=kept(cloud.noise_mm),
        residual_px=None if cloud.residual_px is None else kept(cloud.residual_px),
        reason=np.where(gone, np.uint8(reason), cloud.reason),
        blur_mm=None if cloud.blur_mm is None else kept(cloud.blur_mm),
    )


def _large_islands(cloud: PointCloud, min_island_px: int) -> BoolMap:
    """Pixels of connected surfaces with enough of them."""
    size = cloud.reason.size
    faces = cloud_triangles(cloud).astype(np.int64)
    start = np.concatenate((faces[:, 0], faces[:, 1]))
    end = np.concatenate((faces[:, 1], faces[:, 2]))
    links = scipy.sparse.coo_array((np.ones(len(start), bool), (start, end)), shape=(size, size))
    island = scipy.sparse.csgraph.connected_components(links, directed=False)[1]
    return np.asarray((np.bincount(island)[island] >= min_island_px).reshape(cloud.shape))
