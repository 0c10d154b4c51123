"""A closed mesh as ``fringeworks.views.closing`` makes it, in double precision and all at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.types import FloatMap
from fringeworks.views.closing import (
    AREA_NEIGHBOURS,
    MARGIN_CELLS,
    MAX_ASIDE,
    MIN_COSINE,
    MIN_POINTS,
    NEIGHBOURS,
    NODE_SHARE,
    REACH_SPACINGS,
    SMOOTHING_CELLS,
)


def mesh_of(points: Any, cell: float) -> tuple[FloatMap, FloatMap, NDArray[Any]]:
    """Vertices, their σ, and triangles, before small surfaces are left out."""
    xyz, normals = (np.asarray(a, np.float64) for a in (points.xyz_mm, points.normals))
    tree = scipy.spatial.cKDTree(xyz)
    distance = tree.query(xyz, k=AREA_NEIGHBOURS + 1)[0]
    vertices, faces = contour(xyz, normals, distance[:, -1] ** 2, cell)
    placed, sigma, _ = laid(vertices, points, tree, float(np.median(distance[:, 1])))
    return placed, sigma, faces


def contour(
    xyz: FloatMap, normals: FloatMap, area: FloatMap, cell: float
) -> tuple[FloatMap, NDArray[Any]]:
    from skimage.measure import marching_cubes

    low = xyz.min(axis=0) - MARGIN_CELLS * cell
    shape = np.ceil(np.ptp(xyz, axis=0) / cell).astype(int) + 2 * MARGIN_CELLS + 1
    size = tuple(scipy.fft.next_fast_len(int(n), real=True) for n in shape)
    at = (xyz - low) / cell
    field = potential(at, normals * area[:, None], size)
    field = field - np.average(scipy.ndimage.map_coordinates(field, at.T, order=1), weights=area)
    # A slope of the field per cell tells how near a vertex would be to a node.
    there = tuple(np.rint(at).T.astype(int))
    slope = float(np.median(np.linalg.norm([g[there] for g in np.gradient(field)], axis=0)))
    near = np.abs(field) < NODE_SHARE * slope
    field = np.where(near, np.where(field < 0, -1.0, 1.0) * NODE_SHARE * slope, field)
    vertices, faces, _, _ = marching_cubes(field, 0.0)
    corners = vertices[faces]
    volume = np.sum(corners[:, 0] * np.cross(corners[:, 1], corners[:, 2]))
    return vertices.astype(np.float64) * cell + low, faces if volume > 0 else faces[:, ::-1]


def potential(at: FloatMap, vectors: FloatMap, size: tuple[int, ...]) -> FloatMap:
    """The function on the grid whose gradient is nearest to vectors at points (in cells)."""
    base = np.floor(at).astype(int)
    share = at - base
    waves = np.meshgrid(
        *(2.0 * np.pi * np.fft.fftfreq(n) for n in size[:-1]),
        2.0 * np.pi * np.fft.rfftfreq(size[-1]),
        indexing="ij",
        sparse=True,
    )
    square = waves[0] ** 2 + waves[1] ** 2 + waves[2] ** 2
    total: Any = 0.0
    for axis in range(3):
        grid = np.zeros(size)
        for corner in np.ndindex(2, 2, 2):
            weight = np.prod(np.where(np.array(corner), share, 1.0 - share), axis=1)
            np.add.at(grid, tuple((base + corner).T), weight * vectors[:, axis])
        total = total + 1j * waves[axis] * scipy.fft.rfftn(grid)
    total *= -np.exp(-0.5 * SMOOTHING_CELLS**2 * square) / np.maximum(square, 1e-12)
    total[0, 0, 0] = 0.0
    return np.asarray(scipy.fft.irfftn(total, size))


def laid(
    vertices: FloatMap, points: Any, tree: scipy.spatial.cKDTree, spacing: float
) -> tuple[FloatMap, FloatMap, FloatMap | None]:
    """Vertices moved onto the points around them, σ (NaN without points) and brightness."""
    reach = REACH_SPACINGS * spacing
    distance, index = tree.query(vertices, k=NEIGHBOURS, distance_upper_bound=reach)
    has = np.isfinite(distance)
    index = np.where(has, index, 0)
    xyz, normals = (np.asarray(a, np.float64) for a in (points.xyz_mm, points.normals))
    sigma = np.asarray(points.sigma_mm, np.float64)[index]
    noise = sigma if points.noise_mm is None else np.asarray(points.noise_mm, np.float64)[index]
    weight = np.exp(-((np.where(has, distance, np.inf) / spacing) ** 2)) / sigma**2
    main = np.einsum("nk,nki->ni", weight, normals[index])
    main /= np.linalg.norm(main, axis=1, keepdims=True) + 1e-300
    weight *= np.einsum("ni,nki->nk", main, normals[index]) > MIN_COSINE
    total = weight.sum(axis=1)
    measured = np.count_nonzero(weight, axis=1) >= MIN_POINTS
    total[~measured] = 1.0
    away = xyz[index] - vertices[:, None]
    off = np.einsum("nki,nki->nk", away, 0.5 * (main[:, None] + normals[index]))
    move = np.where(measured, np.sum(weight * off, axis=1) / total, 0.0)
    # Points on one side only would determine the vertex by extrapolation.
    centre = np.einsum("nk,nki->ni", weight, away) / total[:, None]
    aside = np.linalg.norm(centre - np.sum(centre * main, axis=1)[:, None] * main, axis=1)
    measured &= aside < MAX_ASIDE * spacing
    alone = np.sum((weight * noise) ** 2, axis=1) / total**2
    shared = np.sum(weight * np.sqrt(np.maximum(sigma**2 - noise**2, 0.0)), axis=1) / total
    colour = None
    if points.colour is not None:
        seen = np.asarray(points.colour, np.float64)[index]
        seen = seen[..., None] if seen.ndim == 2 else seen
        colour = np.einsum("nk,nkc->nc", weight, seen) / total[:, None]
        colour = colour[:, 0] if points.colour.ndim == 1 else colour
    placed = vertices + move[:, None] * main
    return placed, np.where(measured, np.sqrt(alone + shared**2), np.nan), colour
