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
"""Largest number of cells: 4·10⁷ need 1 GB."""
AT_ONCE = 20_000
"""Number of vertices that are laid onto their points together; they take 40 MB."""
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
    # In the order of the tree, searches that follow one another read the same branches.
    distance = np.empty((len(xyz), 2))
    distance[tree.indices] = tree.query(xyz[tree.indices], k=[2, AREA_NEIGHBOURS + 1], workers=-1)[
        0
    ]
    spacing = float(np.median(distance[:, 0]))
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
    corners = _Corners(at, size)
    field = _potential(corners, normals * area[:, None])
    field -= np.float32(np.average(corners.interpolated(field), weights=area))
    # A slope of the field per cell tells how near a vertex would be to a node.
    slope = float(np.median(_slopes(field, np.rint(at).astype(np.intp))))
    # Few views leave the contour so open that it would end at the border of the grid.
    for axis in range(3):
        for end in (slice(1), slice(-1, None)):
            face = np.moveaxis(field, axis, 0)[end]
            np.maximum(face, np.float32(slope), out=face)
    least = NODE_SHARE * slope
    near = np.flatnonzero(np.abs(field) < least)
    flat = field.ravel()
    flat[near] = np.where(flat[near] < 0, -least, least)
    del corners, near
    contour: Any = marching_cubes
    vertices, faces, _, _ = contour(field, 0.0)
    of_faces = vertices[faces]
    volume = np.sum(of_faces[:, 0] * np.cross(of_faces[:, 1], of_faces[:, 2]))
    return vertices.astype(np.float64) * cell + low, faces if volume > 0 else faces[:, ::-1]


class _Corners:
    """The eight nodes around each of n points (in cells), and the points' shares of them.

    Parameters
    ----------
    at : (n, 3) array
        Points, in cells.
    size : (nx, ny, nz)
        Nodes of the grid.
    """

    def __init__(self, at: FloatMap, size: tuple[int, ...]) -> None:
        self.size = size
        base = np.floor(at).astype(np.intp)
        ends = np.stack((1.0 - (at - base), at - base))
        self._node: NDArray[np.intp] = np.concatenate(
            [np.ravel_multi_index(tuple((base + c).T), size) for c in np.ndindex(2, 2, 2)]
        )
        self._share: NDArray[np.float32] = np.concatenate(
            [ends[x, :, 0] * ends[y, :, 1] * ends[z, :, 2] for x, y, z in np.ndindex(2, 2, 2)],
            dtype=np.float32,
        )

    def spread(self, values: FloatMap) -> FloatMap:
        """Spread values (n,) over the nodes; the grid, single precision."""
        grid = np.zeros(self.size, np.float32)
        weights = self._share.reshape(8, -1) * values.astype(np.float32)
        np.add.at(grid.ravel(), self._node, weights.ravel())
        return grid

    def interpolated(self, field: FloatMap) -> FloatMap:
        """Return the values of a field at the points, (n,)."""
        found = field.ravel()[self._node] * self._share
        return np.asarray(found.reshape(8, -1).sum(axis=0, dtype=np.float64))


def _slopes(field: FloatMap, node: NDArray[np.intp]) -> FloatMap:
    """Slopes of a field per cell at some nodes (n, 3), which are not on its border, (n,)."""
    flat, here = field.ravel(), np.ravel_multi_index(tuple(node.T), field.shape)
    steps = np.array([field.shape[1] * field.shape[2], field.shape[2], 1])
    along = [0.5 * (flat[here + step] - flat[here - step]).astype(np.float64) for step in steps]
    return np.asarray(np.sqrt(sum(one**2 for one in along)))


def _potential(corners: _Corners, vectors: FloatMap) -> FloatMap:
    """The function on the grid whose gradient is nearest to vectors at points.

    Single precision: contours of it, which the points then correct, are single precision too.
    """
    size = corners.size
    waves = np.meshgrid(
        *(2.0 * np.pi * np.fft.fftfreq(n) for n in size[:-1]),
        2.0 * np.pi * np.fft.rfftfreq(size[-1]),
        indexing="ij",
        sparse=True,
    )

    def derived(axis: int) -> Any:
        transform = scipy.fft.rfftn(corners.spread(vectors[:, axis]), workers=-1, overwrite_x=True)
        transform *= (-1j * waves[axis]).astype(np.complex64)
        return transform

    # No more than two transforms at a time: each takes as much memory as the grid.
    total = derived(0)
    total += derived(1)
    total += derived(2)
    square = (waves[0] ** 2 + waves[1] ** 2).astype(np.float32) + (waves[2] ** 2).astype(np.float32)
    total /= np.maximum(square, np.float32(1e-12))
    for wave in waves:
        total *= np.exp(-0.5 * SMOOTHING_CELLS**2 * wave**2).astype(np.float32)
    total[0, 0, 0] = 0.0
    return np.ascontiguousarray(scipy.fft.irfftn(total, size, workers=-1, overwrite_x=True))


def _laid(
    vertices: FloatMap, points: Points, tree: scipy.spatial.cKDTree, spacing: float
) -> tuple[FloatMap, FloatMap, FloatMap | None]:
    """Vertices moved onto the points around them, σ (NaN without points) and brightness."""
    parts = [
        _laid_some(vertices[k : k + AT_ONCE], points, tree, spacing)
        for k in range(0, len(vertices), AT_ONCE)
    ]
    placed, sigma, colour = zip(*parts, strict=True)
    seen = None if points.colour is None else np.concatenate(colour)
    return np.concatenate(placed), np.concatenate(sigma), seen


def _laid_some(
    vertices: FloatMap, points: Points, tree: scipy.spatial.cKDTree, spacing: float
) -> tuple[FloatMap, FloatMap, FloatMap | None]:
    """As ``_laid``, for some of the vertices."""
    reach = REACH_SPACINGS * spacing
    distance, index = tree.query(vertices, k=NEIGHBOURS, distance_upper_bound=reach, workers=-1)
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
        colour = _coloured(vertices, np.asarray(points.colour, np.float64), tree, index, weight)
    placed = vertices + move[:, None] * main
    return placed, np.where(measured, np.sqrt(alone + shared**2), np.nan), colour


def _coloured(
    vertices: FloatMap,
    colour: FloatMap,
    tree: scipy.spatial.cKDTree,
    index: NDArray[np.intp],
    weight: FloatMap,
) -> FloatMap:
    """Brightness or colour of vertices: the mean of the points around them, or of the nearest one
    where there are none, as in filled holes."""
    total = weight.sum(axis=1)
    seen = np.einsum("nk,nk...->n...", weight, colour[index])
    found = np.divide(seen.T, total, where=total > 0, out=np.zeros_like(seen.T)).T
    lacking = ~(total > 0)
    if lacking.any():
        found[lacking] = colour[tree.query(vertices[lacking], workers=-1)[1]]
    return np.asarray(found)


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
