"""Meshes from point clouds and height maps: triangles, filled holes, fewer triangles."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.surface.cloud import cloud_triangles
from fringeworks.surface.height_map import (
    height_map_points,
    height_map_triangles,
    lateral_findings,
)
from fringeworks.types import (
    LARGEST,
    BoolMap,
    FloatMap,
    HeightMap,
    InputError,
    MissingPackage,
    PointCloud,
    Reason,
    TriangleMesh,
    finite,
)

MAX_RELIEF = 0.5
"""Largest distance of a hole's rim from the plane through it, over the hole's width. A rim with
more relief belongs to several surfaces, as beside a step in depth, and nothing may be filled in."""
RIM_PX = 2
"""Width of the rim around a hole, px: noise of two pixels averages a little."""
MIN_FACES = 4
"""Smallest number of triangles to ask for: a tetrahedron's."""


def cloud_mesh(cloud: PointCloud, *, fill_px: int = 0) -> TriangleMesh:
    """Connect the points of a cloud by triangles, and fill small holes.

    Parameters
    ----------
    cloud : PointCloud
    fill_px : int ≥ 0
        Largest number of pixels of a hole that is filled; 0 fills none. A hole is surrounded by
        points, and its rim is one surface.

    Returns
    -------
    TriangleMesh in the coordinates of the cloud. Triangles do not bridge steps in depth, and points
    without a triangle are left out. ``filled`` marks the vertices in holes; their σ is NaN, because
    nothing was measured there.

    Raises
    ------
    InputError for a negative size, and for a cloud without neighbouring points.

    Notes
    -----
    In a hole, x/z, y/z and 1/z solve Laplace's equation with the values on its rim. On a plane all
    three are linear in the camera's rays, so that a hole in a plane is filled by the plane.
    """
    if not finite(fill_px) or fill_px < 0:
        raise InputError(f"fill_px: expected 0 or more, got {fill_px}")
    filled = np.zeros(cloud.shape, bool)
    if fill_px:
        cloud, filled = fill_holes(cloud, fill_px)
    faces = cloud_triangles(cloud)
    if not len(faces):
        raise InputError("cloud: expected neighbouring points, got none", findings=cloud.findings)
    marked = np.zeros(cloud.reason.size, bool)
    marked[faces] = True
    used = np.flatnonzero(marked)
    number = np.cumsum(marked, dtype=np.uint32) - np.uint32(1)
    colour = cloud.colour
    if colour is not None:
        colour = colour.reshape(-1, *colour.shape[2:])[used]
    return TriangleMesh(
        cloud.xyz_mm.reshape(-1, 3)[used],
        number[faces],
        sigma_mm=cloud.sigma_mm.reshape(-1)[used],
        colour=colour,
        filled=filled.reshape(-1)[used] if filled.any() else None,
        findings=cloud.findings,
        provenance=cloud.provenance,
        **_texture(cloud.colour, used, cloud.shape),
    )


def _texture(
    colour: FloatMap | None, used: NDArray[np.intp], shape: tuple[int, int]
) -> dict[str, Any]:
    """The colour of all pixels as a texture, and where vertices lie in it, by their pixels."""
    if colour is None:
        return {}
    rows, columns = np.divmod(used, shape[1])
    return {"texture": colour, "texture_px": np.column_stack((columns, rows)).astype(np.float32)}


def height_map_mesh(surface: HeightMap, *, texture: FloatMap | None = None) -> TriangleMesh:
    """Connect the points of a height map by triangles.

    Parameters
    ----------
    surface : HeightMap
        In mm, with a known pitch.
    texture : (h, w) or (h, w, 3) array, optional
        What the camera saw of the surface under even light, counts in proportion to the light.

    Returns
    -------
    TriangleMesh with x to the right, y up and z towards the camera, as the points of a height map.
    Triangles do not bridge steps in height.

    Raises
    ------
    InputError for displacements in px, an unknown pitch, a texture of another size, and a map
    without neighbouring values.
    """
    if surface.unit != "mm":
        raise InputError("mesh: expected heights in mm, got displacements in px; give the geometry")
    if texture is not None and np.shape(texture) not in (surface.shape, (*surface.shape, 3)):
        raise InputError(
            f"texture: expected {surface.shape} or {(*surface.shape, 3)}, got {np.shape(texture)}"
        )
    xyz, sigma, index = height_map_points(surface)
    faces = height_map_triangles(surface, index)
    if not len(faces):
        raise InputError(
            "surface: expected neighbouring values, got none", findings=surface.findings
        )
    used, number = np.unique(faces, return_inverse=True)
    pixels = np.flatnonzero(index.ravel() >= 0)[used]
    known = sigma[used] if bool(np.isfinite(sigma[used]).all()) else None
    colour = None
    if texture is not None:
        colour = np.asarray(texture).reshape(-1, *np.shape(texture)[2:])[pixels]
    return TriangleMesh(
        xyz[used],
        number.reshape(faces.shape).astype(np.uint32),
        sigma_mm=known,
        colour=colour,
        findings=tuple(dict.fromkeys((*surface.findings, *lateral_findings(surface)))),
        provenance=surface.provenance,
        **_texture(texture, pixels, surface.shape),
    )


def decimate(mesh: TriangleMesh, faces: int) -> TriangleMesh:
    """Reduce the number of triangles, where the surface is flat first.

    Parameters
    ----------
    mesh : TriangleMesh
    faces : int ≥ 4
        Number of triangles to keep at most. The mesh is returned as it is if it has no more.

    Returns
    -------
    TriangleMesh. σ of a vertex is that of the nearest one before, and its distance from the surface
    there. Colour and ``filled`` are those of the nearest vertex.

    Raises
    ------
    InputError for fewer than four triangles; MissingPackage where the package
    ``fast-simplification`` (the extra "mesh") is not installed.

    Notes
    -----
    Edges are collapsed by the quadric error of M. Garland and P. Heckbert, SIGGRAPH 1997,
    doi:10.1145/258734.258849.
    """
    if not finite(faces) or faces < MIN_FACES:
        raise InputError(f"faces: expected {MIN_FACES} or more, got {faces}")
    if len(mesh.faces) <= faces:
        return mesh
    if mesh.vertices_mm.size and not np.abs(mesh.vertices_mm).max() <= LARGEST:
        raise InputError(f"mesh: expected vertices within {LARGEST:g} mm, got others")
    try:
        import fast_simplification
    except ImportError as error:
        raise MissingPackage(
            "decimation: expected the package fast-simplification, got none; "
            "pip install 'fringeworks[mesh]'"
        ) from error
    before = np.asarray(mesh.vertices_mm, np.float64)
    # The package computes in single precision, which coordinates far from 0 would lose.
    middle = before.mean(axis=0)
    vertices, left = fast_simplification.simplify(
        (before - middle).astype(np.float32), mesh.faces.astype(np.int32), target_count=int(faces)
    )
    after = np.asarray(vertices, np.float64) + middle
    near = scipy.spatial.cKDTree(before).query(after)[1]
    normals = vertex_normals(before, mesh.faces)
    off = np.abs(np.sum((after - before[near]) * normals[near], axis=1))
    sigma = None if mesh.sigma_mm is None else np.hypot(mesh.sigma_mm[near], off)
    return replace(
        mesh,
        vertices_mm=after,
        faces=np.asarray(left, np.uint32),
        sigma_mm=sigma,
        colour=None if mesh.colour is None else mesh.colour[near],
        filled=None if mesh.filled is None else mesh.filled[near],
        texture_px=None if mesh.texture_px is None else _moved(mesh, before, after, near),
    )


def _moved(
    mesh: TriangleMesh, before: FloatMap, after: FloatMap, near: NDArray[np.intp]
) -> FloatMap:
    """Where new vertices lie in the texture.

    Pixels are nearly linear in x/z and y/z, or in x and y where the camera is far away: the part
    that is not, the lens distortion, is that of the nearest vertex.
    """
    place = np.asarray(mesh.texture_px, np.float64)
    ahead = bool((before[:, 2] > 0).all() and (after[:, 2] > 0).all())

    def across(points: FloatMap) -> FloatMap:
        return points[:, :2] / points[:, 2:] if ahead else points[:, :2]

    seen = across(before)
    design = np.column_stack((seen, np.ones(len(seen))))
    slope = np.linalg.lstsq(design, place, rcond=None)[0][:2]
    found = place[near] + (across(after) - seen[near]) @ slope
    return np.asarray(found, np.float32)


def vertex_normals(vertices: FloatMap, faces: NDArray[np.uint32]) -> FloatMap:
    """Unit normals of the vertices, weighted by the area of their triangles."""
    p, q, r = (vertices[faces[:, k]] for k in range(3))
    cross = np.cross(q - p, r - p)
    total = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(total, faces[:, k], cross)
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300))


def fill_holes(cloud: PointCloud, fill_px: int) -> tuple[PointCloud, BoolMap]:
    """The cloud with its small holes filled, and which pixels were."""
    if cloud.placement is not None:
        within, filled = fill_holes(cloud.in_camera(), fill_px)
        T = cloud.placement.T_frame_camera
        xyz = np.where(filled[..., None], within.xyz_mm @ T[:3, :3].T + T[:3, 3], cloud.xyz_mm)
        return replace(cloud, xyz_mm=xyz.astype(np.float32), reason=within.reason), filled
    ok = cloud.reason == Reason.OK
    label, count = scipy.ndimage.label(~ok)
    edge = np.unique(np.concatenate((label[0], label[-1], label[:, 0], label[:, -1])))
    small = np.bincount(label.ravel(), minlength=count + 1) <= fill_px
    small[0] = small[edge] = False
    xyz = cloud.xyz_mm.astype(np.float64)
    filled = np.zeros(cloud.shape, bool)
    places = scipy.ndimage.find_objects(label)
    for number in np.flatnonzero(small):
        where = places[number - 1]
        window = tuple(
            slice(max(0, s.start - RIM_PX), min(s.stop + RIM_PX, n))
            for s, n in zip(where, cloud.shape, strict=True)
        )
        hole = label[window] == number
        found = _harmonic(xyz[window], hole, ok[window])
        if found is not None:
            xyz[window][hole] = found
            filled[window] |= hole
    reason = np.where(filled, np.uint8(Reason.OK), cloud.reason)
    return replace(cloud, xyz_mm=xyz.astype(np.float32), reason=reason), filled


def _harmonic(xyz: FloatMap, hole: BoolMap, ok: BoolMap) -> FloatMap | None:
    """Points in a hole that continue its rim, (n, 3); None for a rim of several surfaces."""
    rim = scipy.ndimage.binary_dilation(hole, iterations=RIM_PX) & ok
    z = xyz[..., 2]
    with np.errstate(invalid="ignore", divide="ignore"):
        values = np.stack((xyz[..., 0] / z, xyz[..., 1] / z, 1.0 / z), axis=-1)
    u, v, w = values[rim].T
    if not np.isfinite(values[rim]).all():
        return None
    design = np.column_stack((u - u.mean(), v - v.mean(), np.ones_like(u)))
    relief = np.abs(w - design @ np.linalg.lstsq(design, w, rcond=None)[0]).max() / w.mean()
    if relief > MAX_RELIEF * max(np.ptp(u), np.ptp(v)):
        return None
    number = np.full(hole.shape, -1)
    number[hole] = np.arange(np.count_nonzero(hole))
    rows, columns = np.nonzero(hole)
    size = len(rows)
    matrix = scipy.sparse.lil_array((size, size))
    right = np.zeros((size, 3))
    matrix.setdiag(4.0)
    for down, across in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        y, x = rows + down, columns + across
        inside = number[y, x]
        matrix[np.flatnonzero(inside >= 0), inside[inside >= 0]] = -1.0
        right[inside < 0] += values[y, x][inside < 0]
    solved = scipy.sparse.linalg.splu(matrix.tocsc()).solve(right)
    points = np.column_stack((solved[:, 0], solved[:, 1], np.ones(size))) / solved[:, 2:]
    return np.asarray(points, np.float64)
