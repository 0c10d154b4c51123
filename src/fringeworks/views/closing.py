"""A closed mesh of a merged part: the surface that the points suggest, laid onto the points."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.types import FloatMap, InputError, MissingPackage, Points, TriangleMesh

CELLS_PER_SPACING = 1.5
"""Side of a grid cell over the distance of neighbouring points. Smaller cells leave holes between
the points, larger ones round edges. Empirical."""
MARGIN_CELLS = 12
"""Empty cells around the part: the surface of parts that were not seen bulges out."""
MAX_CELLS = 4e7
"""Largest number of cells: 4·10⁷ need 2 GB."""
SMOOTHING_CELLS = 1.0
"""Standard deviation by which the normals are spread, cells: gaps of two cells are bridged."""
AREA_NEIGHBOURS = 8
"""Number of neighbours from which the area of a point is estimated."""
NEIGHBOURS = 16
"""Largest number of points that determine a vertex."""
REACH_SPACINGS = 2.0
"""How far a point may be from a vertex that it determines, in distances of neighbouring points;
beyond, the vertex is not measured."""
MAX_ASIDE = 0.3
"""Largest distance of a measured vertex from the middle of its points, in distances of neighbouring
points: farther away, the points lie on one side."""
MIN_COSINE = 0.8
"""Smallest cosine between the normal of a vertex and of a point that determines it: points across a
crease belong to another surface."""
MIN_POINTS = 3
"""Smallest number of points that determine a vertex."""
NODE_SHARE = 0.03
"""Smallest distance of a vertex from a grid node, in cells: nearer ones make slivers that merge in
single precision."""
MIN_MEASURED = 50
"""Smallest number of measured vertices of a separate surface that is kept."""


def closed_mesh(points: Points, *, cell_mm: float | None = None) -> TriangleMesh:
    """Make a watertight mesh of points from all sides.

    Parameters
    ----------
    points : Points
        With normals and σ, as ``merge`` returns them.
    cell_mm : float > 0, optional
        Side of the cells of the grid, mm; by default 1.5 distances of neighbouring points.

    Returns
    -------
    TriangleMesh, watertight. Vertices without points around them are marked in ``filled``; their σ
    is NaN, because nothing was measured there.

    Raises
    ------
    InputError for points without normals or σ, and for cells that are too small; MissingPackage
    where the package ``scikit-image`` (the extra "mesh") is not installed.

    Notes
    -----
    The normals, weighted by the area of their points and spread over the grid, are the gradient of
    a function that is constant on the surface (Poisson's equation; M. Kazhdan, Symposium on
    Geometry Processing 2005). A Fourier transform solves it. Each vertex of its contour is then
    moved along the mean normal n by the weighted mean of (p − x)·(n + n_p)/2 over the points p
    around it, which is exact to second order on curved surfaces.
    """
    if points.normals is None or points.sigma_mm is None or len(points.xyz_mm) <= NEIGHBOURS:
        raise InputError(f"points: expected more than {NEIGHBOURS} points with normals and σ")
    xyz, normals = (np.asarray(a, np.float64) for a in (points.xyz_mm, points.normals))
    tree = scipy.spatial.cKDTree(xyz)
    distance = tree.query(xyz, k=AREA_NEIGHBOURS + 1)[0]
    spacing = float(np.median(distance[:, 1]))
    cell = CELLS_PER_SPACING * spacing if cell_mm is None else cell_mm
    if not cell > 0:
        raise InputError(f"cell_mm: expected > 0, got {cell_mm}")
    vertices, faces = _contour(xyz, normals, distance[:, -1] ** 2, cell)
    placed, sigma, colour = _laid(vertices, points, tree, spacing)
    kept = _components(faces, np.isfinite(sigma))
    used, faces = np.unique(faces[kept], return_inverse=True)
    return TriangleMesh(
        placed[used],
        faces.reshape(-1, 3).astype(np.uint32),
        sigma_mm=sigma[used],
        colour=None if colour is None else colour[used],
        filled=~np.isfinite(sigma[used]),
        findings=points.findings,
        provenance=points.provenance,
    )


def _contour(
    xyz: FloatMap, normals: FloatMap, area: FloatMap, cell: float
) -> tuple[FloatMap, NDArray[Any]]:
    """Vertices, mm, and triangles of the surface that has these normals, facing outwards."""
    try:
        from skimage.measure import marching_cubes
    except ImportError as error:
        raise MissingPackage(
            "closed meshes: expected the package scikit-image, got none; "
            "pip install 'fringeworks[mesh]'"
        ) from error
    low = xyz.min(axis=0) - MARGIN_CELLS * cell
    shape = np.ceil(np.ptp(xyz, axis=0) / cell).astype(int) + 2 * MARGIN_CELLS + 1
    if np.prod(shape.astype(float)) > MAX_CELLS:
        raise InputError(f"cell_mm: expected at most {MAX_CELLS:.0e} cells, got {shape.tolist()}")
    size = tuple(scipy.fft.next_fast_len(int(n), real=True) for n in shape)
    at = (xyz - low) / cell
    field = _potential(at, normals * area[:, None], size)
    field = field - np.average(scipy.ndimage.map_coordinates(field, at.T, order=1), weights=area)
    # A slope of the field per cell tells how near a vertex would be to a node.
    there = tuple(np.rint(at).T.astype(int))
    slope = float(np.median(np.linalg.norm([g[there] for g in np.gradient(field)], axis=0)))
    near = np.abs(field) < NODE_SHARE * slope
    field = np.where(near, np.where(field < 0, -1.0, 1.0) * NODE_SHARE * slope, field)
    contour: Any = marching_cubes
    vertices, faces, _, _ = contour(field, 0.0)
    corners = vertices[faces]
    volume = np.sum(corners[:, 0] * np.cross(corners[:, 1], corners[:, 2]))
    return vertices.astype(np.float64) * cell + low, faces if volume > 0 else faces[:, ::-1]


def _potential(at: FloatMap, vectors: FloatMap, size: tuple[int, ...]) -> FloatMap:
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


def _laid(
    vertices: FloatMap, points: Points, tree: scipy.spatial.cKDTree, spacing: float
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


def _components(faces: NDArray[Any], measured: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Triangles of surfaces that have enough measured vertices."""
    size = len(measured)
    start, end = faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel()
    links = scipy.sparse.coo_array((np.ones(len(start), bool), (start, end)), shape=(size, size))
    part = scipy.sparse.csgraph.connected_components(links, directed=False)[1]
    kept = np.bincount(part, measured) >= MIN_MEASURED
    if not kept.any():
        raise InputError("points: expected a surface, got points that are too far apart")
    return np.asarray(kept[part[faces[:, 0]]])
