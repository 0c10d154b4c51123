"""A solid to print from the points of one view: closed by a plate behind the part, z up."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fringeworks.surface.cloud import CORNERS
from fringeworks.surface.mesh import fill_holes
from fringeworks.types import (
    BoolMap,
    FloatMap,
    InputError,
    PointCloud,
    Reason,
    TriangleMesh,
    finite,
    sealed,
)

RAY_DEGREE = 3
"""Degree of the polynomial over the frame that gives the rays of pixels without a point. A lens
bends rays by cubic terms."""
MIN_POINTS = 100
"""Smallest number of points of a solid: ten for each of the ten terms of the rays."""


def solid_relief(cloud: PointCloud, *, plate_mm: float = 2.0, fill_px: int = 0) -> TriangleMesh:
    """Make a closed solid of one view, which lies on its back, for a printer.

    Parameters
    ----------
    cloud : PointCloud
        Cropped and cleaned before, because its farthest point decides where the plate is.
    plate_mm : float > 0
        Thickness of the plate behind the farthest point, mm.
    fill_px : int ≥ 0
        Largest number of pixels of a hole that is filled as ``cloud_mesh`` fills it; larger ones
        reach down to the plate.

    Returns
    -------
    TriangleMesh, watertight, in coordinates of its own: z is up, towards the camera; the bottom has
    z = 0, and its middle x = y = 0. ``filled`` marks the vertices that were not measured: the
    plate, and pixels without a point, which lie on it. Their σ is NaN.

    Raises
    ------
    InputError for a thickness that is not positive, a negative size, fewer than 100 points, and
    points behind the camera.

    Notes
    -----
    The top is a height over the camera's rays, so that it cannot intersect itself. A step in depth
    becomes a wall of one pixel's width, and what the camera did not see behind an edge is solid.

    Examples
    --------
    >>> row, column = np.mgrid[-20:21, -20:21]
    >>> xyz = np.stack([column, row, 300.0 - np.hypot(row, column)], axis=-1)
    >>> sigma, ok = np.full(row.shape, 0.01), np.zeros(row.shape, np.uint8)
    >>> solid = solid_relief(PointCloud(xyz, sigma, sigma, ok), plate_mm=3)
    >>> round(float(solid.vertices_mm[:, 2].max()), 1)
    31.3
    """
    if not finite(plate_mm) or not plate_mm > 0:
        raise InputError(f"plate_mm: expected a thickness above 0, got {plate_mm}")
    if not finite(fill_px) or fill_px < 0:
        raise InputError(f"fill_px: expected 0 or more, got {fill_px}")
    cloud = cloud if cloud.placement is None else cloud.in_camera()
    filled = np.zeros(cloud.shape, bool)
    if fill_px:
        cloud, filled = fill_holes(cloud, fill_px)
    known = cloud.reason == Reason.OK
    if known.sum() < MIN_POINTS:
        raise InputError(
            f"cloud: expected {MIN_POINTS} points or more, got {known.sum()}",
            findings=cloud.findings,
        )
    if not (np.asarray(cloud.xyz_mm)[known, 2] > 0).all():
        raise InputError("cloud: expected points before the camera (z > 0), got others")
    box = _box(known)
    xyz = np.asarray(cloud.xyz_mm, np.float64)[box]
    top, back = _top(xyz, known[box])
    vertices, faces = _closed(top, back + plate_mm)
    measured = (known & ~filled)[box].ravel()
    beside = len(vertices) - measured.size
    sigma = np.where(measured, cloud.sigma_mm[box].ravel(), np.nan)
    return TriangleMesh(
        sealed(_stood(vertices).astype(np.float32)),
        faces,
        sigma_mm=np.append(sigma, np.full(beside, np.nan)).astype(np.float32),
        colour=_colours(cloud, box, beside),
        filled=np.append(~measured, np.ones(beside, bool)),
        findings=cloud.findings,
        provenance=cloud.provenance,
    )


def _box(known: BoolMap) -> tuple[slice, slice]:
    """Rows and columns of all points."""
    rows, columns = (np.flatnonzero(known.any(axis=k)) for k in (1, 0))
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    if min(rows[-1] - rows[0], columns[-1] - columns[0]) < 1:
        raise InputError("cloud: expected points in two rows and two columns, got a line")
    return box


def _top(xyz: FloatMap, known: BoolMap) -> tuple[FloatMap, float]:
    """The points of all pixels, those without one at the depth of the farthest; and this depth."""
    back = float(xyz[..., 2][known].max())
    row, column = (np.linspace(-1.0, 1.0, size) for size in known.shape)
    terms = np.stack(
        [
            np.multiply.outer(row**a, column**b)
            for a in range(RAY_DEGREE + 1)
            for b in range(RAY_DEGREE + 1 - a)
        ],
        axis=-1,
    )
    rays = xyz[..., :2][known] / xyz[..., 2:][known]
    weights = np.linalg.lstsq(terms[known], rays, rcond=None)[0]
    behind = np.concatenate((terms @ weights, np.ones((*known.shape, 1))), axis=-1) * back
    return np.where(known[..., None], xyz, behind), back


def _closed(top: FloatMap, depth: float) -> tuple[FloatMap, NDArray[np.uint32]]:
    """Vertices and triangles: the grid, its border at the depth of the bottom, and a middle."""
    rows, columns = top.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    ends = slice(None, -1), slice(1, None)
    faces = [
        np.stack([index[ends[r], ends[c]].ravel() for r, c in corners], axis=-1)
        for corners in CORNERS
    ]
    border = np.concatenate((index[:-1, 0], index[-1, :-1], index[:0:-1, -1], index[0, :0:-1]))
    grid = top.reshape(-1, 3)
    below = grid[border] * (depth / grid[border][:, 2:])
    low = len(grid) + np.arange(len(border))
    a, b, a_low, b_low = border, np.roll(border, -1), low, np.roll(low, -1)
    middle = np.full(len(border), len(grid) + len(border))
    for corners in ((b, a, a_low), (b, a_low, b_low), (b_low, a_low, middle)):
        faces.append(np.stack(corners, axis=-1))
    vertices = np.concatenate((grid, below, below.mean(axis=0, keepdims=True)))
    return vertices, np.concatenate(faces).astype(np.uint32)


def _stood(vertices: FloatMap) -> FloatMap:
    """Camera coordinates turned half about x: z up, the lowest at 0, the middle at x = y = 0."""
    turned = vertices * [1.0, -1.0, -1.0]
    low, high = turned.min(axis=0), turned.max(axis=0)
    return np.asarray(turned - [*(0.5 * (low + high))[:2], low[2]])


def _colours(cloud: PointCloud, box: tuple[slice, slice], beside: int) -> FloatMap | None:
    """Colours of the pixels, and their mean for the bottom."""
    if cloud.colour is None:
        return None
    colour = np.asarray(cloud.colour)[box]
    pixels = colour.reshape(-1, *colour.shape[2:])
    below = np.broadcast_to(pixels.mean(axis=0), (beside, *pixels.shape[1:]))
    return np.concatenate((pixels, below)).astype(np.float32)
