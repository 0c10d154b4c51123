"""Surfaces from point clouds: normals, triangles, and heights over a plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks._lazy import scipy
from fringeworks.types import (
    MOST_PX,
    BoolMap,
    FloatMap,
    HeightMap,
    InputError,
    PointCloud,
    Reason,
    finite,
    positive,
    whole,
)

MIN_NORMAL_POINTS = 6
"""Smallest number of points in a window for a normal: a plane has three parameters, and twice as
many points average the noise a little."""
FLAT_DETERMINANT = 1e-12
"""Smallest determinant of the normal equations over the product of their diagonal. Below it, the
points lie on a line to rounding and have no normal."""
GRAZING_COSINE = 0.08
"""Smallest |cosine| between a triangle's normal and the camera's ray. A triangle seen at less than
5° is taken to bridge a step in depth, where no surface was seen. Empirical: a steeper surface is
hardly ever measured, because fringes on it are weak."""
LONG_SIDE = 4.0
"""Largest side of a triangle, relative to the median of all triangles at the same depth. A longer
one is taken to bridge a step in depth. Empirical: surfaces tilted by up to 75° stay."""
CORNERS = (((0, 0), (1, 0), (0, 1)), ((0, 1), (1, 0), (1, 1)))
"""Corners of the two triangles between four neighbouring pixels: (row, column), so that they face
the camera."""
BAND_ROWS = 32
"""Rows of triangles that are judged at a time, so that their sides stay in the caches."""
MIN_RIGHT_SINE = 1e-6
"""Smallest sine of the angle between ``right`` and the plane's normal: below it, rounding would
determine the direction of the grid."""
MAX_NODES = 1e8
"""Largest number of nodes of a height grid: 10⁸ nodes need several GB."""


def normals(cloud: PointCloud, *, window: int = 5) -> FloatMap:
    """Compute the unit normals of a point cloud's surface, pointing towards the camera.

    They are in the coordinates of the points.

    Parameters
    ----------
    cloud : PointCloud
    window : int
        Side of the square window in which a plane is fitted, px; odd, ≥ 3.

    Returns
    -------
    (h, w, 3) float32 array; NaN where there is no point, or fewer than six around it.

    Raises
    ------
    InputError for an even or too small window.

    Notes
    -----
    A plane n·P = 1 is linear in the inverse depth over image coordinates: 1/z = n·(x/z, y/z, 1).
    It is fitted by least squares, with sums that slide along with the window.
    """
    if not whole(window, 3, MOST_PX) or window % 2 == 0:
        raise InputError(f"window: expected an odd number of 3 to {MOST_PX}, got {window}")
    if cloud.placement is not None:
        return normals(cloud.in_camera(), window=window) @ np.asarray(
            cloud.placement.T_frame_camera[:3, :3].T, np.float32
        )
    ok = cloud.reason == Reason.OK
    xyz = np.where(ok[..., None], cloud.xyz_mm, 1.0).astype(np.float64)
    with np.errstate(all="ignore"):
        w = 1.0 / xyz[..., 2]
        u, v = xyz[..., 0] * w, xyz[..., 1] * w
        # Sums of squares lose small differences of large numbers: the mean is subtracted first.
        mean = [float(a[ok].mean()) if ok.any() else 0.0 for a in (u, v, w)]
        u, v, w = (np.where(ok, a - m, 0.0) for a, m in zip((u, v, w), mean, strict=True))

    def total(values: FloatMap) -> FloatMap:
        return np.asarray(scipy.ndimage.uniform_filter(values, window, mode="constant") * window**2)

    n = total(ok.astype(np.float64))
    su, sv, sw = total(u), total(v), total(w)
    with np.errstate(all="ignore"):
        uu, uv, vv = (
            total(a * b) - sa * sb / n
            for a, b, sa, sb in ((u, u, su, su), (u, v, su, sv), (v, v, sv, sv))
        )
        uw, vw = total(u * w) - su * sw / n, total(v * w) - sv * sw / n
        determinant = uu * vv - uv * uv
        a, b = (vv * uw - uv * vw) / determinant, (uu * vw - uv * uw) / determinant
        # 1/z = a u + b v + c, with the means added again.
        c = sw / n + mean[2] - a * (su / n + mean[0]) - b * (sv / n + mean[1])
        # (a, b, c)·P = 1 in front of the camera, so (a, b, c) points away from it.
        normal = -np.stack((a, b, c), axis=-1)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        determined = determinant > FLAT_DETERMINANT * uu * vv
    normal[~(ok & determined & (np.rint(n) >= MIN_NORMAL_POINTS))] = np.nan
    return normal.astype(np.float32)


def cloud_triangles(cloud: PointCloud) -> NDArray[np.uint32]:
    """Connect neighbouring points of a point cloud by triangles that face the camera.

    Parameters
    ----------
    cloud : PointCloud

    Returns
    -------
    (m, 3) uint32 array of flat pixel indices, rows of ``cloud.xyz_mm.reshape(-1, 3)``. A triangle
    is missing where a corner is, and where it would bridge a step in depth: it is steep to the
    camera's ray, or far longer than usual for its depth.
    """
    cloud, (h, w) = cloud.in_camera(), cloud.shape
    ok = (cloud.reason == Reason.OK) & np.isfinite(cloud.xyz_mm).all(axis=-1)
    shape = (2, max(h - 1, 0), max(w - 1, 0))
    valid, steep, per_depth = np.zeros(shape, bool), np.zeros(shape, bool), np.empty(shape)
    for top in range(0, shape[1], BAND_ROWS):
        rows = slice(top, min(top + BAND_ROWS, shape[1]))
        below = slice(top, rows.stop + 1)
        xyz = np.ascontiguousarray(np.moveaxis(cloud.xyz_mm[below], -1, 0), np.float64)
        for kind, corners in enumerate(CORNERS):
            seen = [ok[below][_from_corner(corner)] for corner in corners]
            valid[kind, rows] = seen[0] & seen[1] & seen[2]
            p, q, r = (xyz[:, *_from_corner(corner)] for corner in corners)
            steep[kind, rows], per_depth[kind, rows] = _shape_of(p, q, r)
    if not valid.any():
        return np.empty((0, 3), np.uint32)
    with np.errstate(invalid="ignore"):
        kept = valid & ~steep & (per_depth < LONG_SIDE * np.median(per_depth[valid]))
    faces = []
    for kind, corners in enumerate(CORNERS):
        row, column = np.nonzero(kept[kind])
        first = row * w + column
        faces.append(np.stack([first + y * w + x for y, x in corners], axis=1).astype(np.uint32))
    return np.concatenate(faces)


def _from_corner(corner: tuple[int, int]) -> tuple[slice, slice]:
    """Where the corner (row, column) of every square of four neighbours is in a band of rows."""
    y, x = corner
    return slice(y, -1 if y == 0 else None), slice(x, -1 if x == 0 else None)


def _shape_of(p: FloatMap, q: FloatMap, r: FloatMap) -> tuple[BoolMap, FloatMap]:
    """Whether triangles are too steep to the camera's ray, and their longest sides over their
    depths, from their corners (3, h, w); a pixel sees a length in proportion to its depth."""
    pq, pr, qr = q - p, r - p, r - q
    with np.errstate(all="ignore"):
        normal = np.cross(pq, pr, axis=0)
        product = np.sqrt(_dot(normal, normal)) * np.sqrt(_dot(p, p))
        steep = np.abs(_dot(normal, p)) < GRAZING_COSINE * product
        longest = np.maximum(np.maximum(_dot(pq, pq), _dot(qr, qr)), _dot(pr, pr))
        return steep, np.sqrt(longest) / p[2]


def _dot(a: FloatMap, b: FloatMap) -> FloatMap:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def height_over_plane(
    cloud: PointCloud,
    point_mm: FloatMap,
    normal: FloatMap,
    *,
    pitch_mm: float,
    right: FloatMap | None = None,
) -> HeightMap:
    """Resample a point cloud to heights over a plane, on a regular grid.

    Parameters
    ----------
    cloud : PointCloud
    point_mm : (3,) array
        A point of the plane in the cloud's coordinates, mm.
    normal : (3,) array
        Normal of the plane in these coordinates, of any length and either sign: heights count
        towards the camera.
    pitch_mm : float > 0
        Distance of the grid's nodes, mm.
    right : (3,) array, optional
        Direction in which the grid's columns count, projected into the plane; x by default.

    Returns
    -------
    HeightMap in mm. The height at a node is that of the topmost triangle of ``cloud_triangles``.
    Its σ is the mean of the triangle's corners, converted from along the camera's ray to along
    the normal. Nodes without a triangle are NaN, ``OUTSIDE``.

    Raises
    ------
    InputError for a plane, direction or pitch that defines no grid, a grid of more than 10⁸ nodes,
    and a cloud without triangles.
    """
    if not positive(pitch_mm):
        raise InputError(f"pitch_mm: expected > 0, got {pitch_mm}")
    origin = np.asarray(point_mm, np.float64)
    placement = cloud.placement
    eye = np.zeros(3) if placement is None else placement.T_frame_camera[:3, 3]
    x, y, up = _plane_axes(origin, np.asarray(normal, np.float64), right, eye)
    faces = cloud_triangles(cloud)
    if not len(faces):
        raise InputError("cloud: expected neighbouring points, got none", findings=cloud.findings)
    height, face = _topmost(cloud, faces, origin, np.stack((x, y, up)), pitch_mm)
    hit = face >= 0
    corners = faces[np.maximum(face.ravel(), 0)]
    points = cloud.xyz_mm.reshape(-1, 3)[corners[:, 0]].astype(np.float64) - eye
    ray_to_normal = np.abs(points @ up) / np.linalg.norm(points, axis=1)
    sigma = cloud.sigma_mm.reshape(-1)[corners].mean(axis=1) * ray_to_normal
    return HeightMap(
        values=height,
        sigma=np.where(hit, sigma.reshape(hit.shape), np.nan),
        reason=np.where(hit, Reason.OK, Reason.OUTSIDE).astype(np.uint8),
        quantity="height",
        unit="mm",
        pitch=pitch_mm,
        method="triangulation",
    )


def _plane_axes(
    origin: FloatMap, normal: FloatMap, right: FloatMap | None, eye: FloatMap
) -> tuple[FloatMap, FloatMap, FloatMap]:
    """Unit vectors of a grid on a plane: columns, rows, and up towards the camera."""
    known = normal.shape == origin.shape == (3,) and finite(*normal, *origin)
    if not known or not positive(np.linalg.norm(normal)):
        raise InputError(
            "plane: expected a finite point and a normal > 0 of 3 values each, got shapes "
            f"{origin.shape} and {normal.shape}"
        )
    up = normal / np.linalg.norm(normal) * (1.0 if normal @ (eye - origin) > 0 else -1.0)
    x = np.array([1.0, 0.0, 0.0]) if right is None else np.asarray(right, np.float64)
    if x.shape != (3,) or not finite(*x):
        raise InputError(f"right: expected a direction of 3 finite values, got shape {x.shape}")
    x = x - (x @ up) * up
    if not np.linalg.norm(x) > MIN_RIGHT_SINE:
        raise InputError("right: expected a direction that is not along the normal, got one")
    x = x / np.linalg.norm(x)
    # Rows go down in the image: x to the right, y down, up towards the viewer.
    return x, np.cross(x, up), up


def _topmost(
    cloud: PointCloud, faces: NDArray[np.uint32], origin: FloatMap, axes: FloatMap, pitch_mm: float
) -> tuple[FloatMap, NDArray[np.int32]]:
    """Height and number of the topmost triangle at every node, (rows, columns); NaN and −1."""
    used, local_faces = np.unique(faces, return_inverse=True)
    local = (cloud.xyz_mm.reshape(-1, 3)[used].astype(np.float64) - origin) @ axes.T
    low, high = local.min(axis=0), local.max(axis=0)
    with np.errstate(all="ignore"):
        lengths = np.floor((high[:2] - low[:2]) / pitch_mm) + 1
    columns, rows = (int(min(n, 2.0 * MAX_NODES)) for n in lengths)
    if rows * columns > MAX_NODES:
        raise InputError(
            f"pitch_mm: expected a grid below {MAX_NODES:.0e} nodes, got {columns} × {rows} nodes "
            f"for a pitch of {pitch_mm:g} mm"
        )
    tree = _core.Triangles(
        np.ascontiguousarray(local),
        np.ascontiguousarray(local_faces.reshape(faces.shape), np.uint32),
    )
    v, u = np.mgrid[:rows, :columns] * pitch_mm
    above = high[2] + 1.0
    start = np.column_stack((u.ravel() + low[0], v.ravel() + low[1], np.full(u.size, above)))
    down = np.broadcast_to([0.0, 0.0, -1.0], start.shape)
    distance, face = tree.hit(start, np.ascontiguousarray(down), 0.0)
    hit = face >= 0
    height = np.where(hit, above - np.where(hit, distance, 0.0), np.nan)
    return height.reshape(rows, columns), face.reshape(rows, columns)
