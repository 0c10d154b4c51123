"""What is read off a point cloud: normals, triangles, and heights over a plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringeworks import _core
from fringeworks.types import FloatMap, HeightMap, InputError, PointCloud, Reason

LEAST_NORMAL = 6
"""Points in a window below which it has no normal."""
GRAZING = 0.08
"""Cosine between a triangle's normal and the camera's ray below which it bridges a cliff."""
CLIFF = 4.0
"""Longest side of a triangle over the usual one beyond which it bridges a cliff."""


def normals(cloud: PointCloud, *, window: int = 5) -> FloatMap:
    """Unit normals of the surface, towards the camera.

    Parameters
    ----------
    cloud : PointCloud
    window : int
        Side of the square of pixels that a plane is fitted to; odd, ≥ 3.

    Returns
    -------
    (h, w, 3) float32 array; NaN where there is no point or too few around it.

    Notes
    -----
    A plane n·P = 1 is linear in 1/z over image coordinates, 1/z = n·(x/z, y/z, 1): least squares
    over the window by sums that slide along.
    """
    if window < 3 or window % 2 == 0:
        raise InputError(f"window: expected an odd number of 3 or more, got {window}")
    ok = cloud.reason == Reason.OK
    xyz = np.where(ok[..., None], cloud.xyz_mm, 1.0).astype(np.float64)
    w = 1.0 / xyz[..., 2]
    u, v = xyz[..., 0] * w, xyz[..., 1] * w
    # About a middle, so that sums of squares do not lose the differences.
    centre = [float(a[ok].mean()) if ok.any() else 0.0 for a in (u, v, w)]
    u, v, w = (np.where(ok, a - c, 0.0) for a, c in zip((u, v, w), centre, strict=True))

    def total(values: FloatMap) -> FloatMap:
        return np.asarray(ndimage.uniform_filter(values, window, mode="constant") * window**2)

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
        # 1/z = a u + b v + c in full coordinates.
        c = sw / n + centre[2] - a * (su / n + centre[0]) - b * (sv / n + centre[1])
        normal = -np.stack((a, b, c), axis=-1)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        flat = determinant > 1e-12 * uu * vv
    # n·P = 1 with P in front: n points away from the camera, so its opposite towards it.
    normal[~(ok & flat & (np.rint(n) >= LEAST_NORMAL))] = np.nan
    return normal.astype(np.float32)


def triangles(cloud: PointCloud) -> NDArray[np.uint32]:
    """Triangles between neighbouring pixels, facing the camera.

    Returns
    -------
    (m, 3) flat indices of pixels; none where a corner is missing, and none across cliffs: steep
    to the camera's ray, or far longer than usual for their depth.
    """
    h, w = cloud.shape
    index = np.arange(h * w, dtype=np.int64).reshape(h, w)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, c, b), (b, c, d))])
    points = cloud.xyz_mm.reshape(-1, 3)
    ok = (cloud.reason == Reason.OK).reshape(-1)
    faces = faces[ok[faces].all(axis=1)]
    if not len(faces):
        return np.empty((0, 3), np.uint32)
    p, q, r = (points[faces[:, k]].astype(np.float64) for k in range(3))
    normal = np.cross(q - p, r - p)
    size = np.linalg.norm(normal, axis=1) * np.linalg.norm(p, axis=1)
    steep = np.abs(np.einsum("nk,nk->n", normal, p)) < GRAZING * size
    longest = np.sqrt(
        np.max([np.sum((s - t) ** 2, axis=1) for s, t in ((p, q), (q, r), (r, p))], axis=0)
    )
    relative = longest / p[:, 2]
    faces = faces[~steep & (relative < CLIFF * np.median(relative))]
    return np.asarray(faces, np.uint32)


def height_over_plane(
    cloud: PointCloud,
    point_mm: FloatMap,
    normal: FloatMap,
    *,
    pitch_mm: float,
    right: FloatMap | None = None,
) -> HeightMap:
    """The surface as heights over a plane, on an even grid.

    Parameters
    ----------
    cloud : PointCloud
    point_mm, normal : (3,) arrays
        A point of the plane and its normal, in camera coordinates; the side that the camera is on
        is up.
    pitch_mm : float > 0
        Distance of the grid's nodes.
    right : (3,) array, optional
        Direction of the grid's columns, laid into the plane; by default the camera's x.

    Returns
    -------
    HeightMap in mm. Each node has the topmost triangle between neighbouring points; its σ is the
    mean of the corners', turned from along the ray to along the normal.

    Raises
    ------
    InputError for a plane or pitch that makes no grid, or one of more than 10⁸ nodes.
    """
    up = np.asarray(normal, np.float64)
    origin = np.asarray(point_mm, np.float64)
    if up.shape != (3,) or origin.shape != (3,) or not np.linalg.norm(up) > 0:
        raise InputError(f"plane: expected a point and a normal of 3 values, got {up}, {origin}")
    if not pitch_mm > 0:
        raise InputError(f"pitch_mm: expected > 0, got {pitch_mm}")
    up = up / np.linalg.norm(up) * (1.0 if up @ -origin > 0 else -1.0)
    x = np.array([1.0, 0.0, 0.0]) if right is None else np.asarray(right, np.float64)
    x = x - (x @ up) * up
    if not np.linalg.norm(x) > 1e-6:
        raise InputError("right: expected a direction that is not along the normal")
    x = x / np.linalg.norm(x)
    # Rows go down in the image: x, y and up as x right, y down, z towards the viewer.
    y = np.cross(x, up)
    faces = triangles(cloud)
    if not len(faces):
        raise InputError("cloud: expected neighbouring points, got none")
    used, inner = np.unique(faces, return_inverse=True)
    local = (cloud.xyz_mm.reshape(-1, 3)[used].astype(np.float64) - origin) @ np.stack((x, y, up)).T
    low, high = local.min(axis=0), local.max(axis=0)
    columns, rows = (int(n) for n in np.floor((high[:2] - low[:2]) / pitch_mm) + 1)
    if rows * columns > 1e8:
        raise InputError(f"pitch_mm: expected a grid below 1e8 nodes, got {columns} × {rows}")
    tree = _core.Triangles(
        np.ascontiguousarray(local), np.ascontiguousarray(inner.reshape(faces.shape), np.uint32)
    )
    v, u = np.mgrid[:rows, :columns] * pitch_mm
    top = high[2] + 1.0
    start = np.column_stack((u.ravel() + low[0], v.ravel() + low[1], np.full(u.size, top)))
    down = np.broadcast_to([0.0, 0.0, -1.0], start.shape)
    distance, face = tree.hit(start, np.ascontiguousarray(down), 0.0)
    hit = face >= 0
    height = np.where(hit, top - np.where(hit, distance, 0.0), np.nan).reshape(rows, columns)
    corners = faces[np.maximum(face, 0)]
    points = cloud.xyz_mm.reshape(-1, 3)[corners[:, 0]].astype(np.float64)
    slant = np.abs(points @ up) / np.linalg.norm(points, axis=1)
    sigma = np.where(hit, cloud.sigma_mm.reshape(-1)[corners].mean(axis=1) * slant, np.nan)
    return HeightMap(
        values=height,
        sigma=sigma.reshape(rows, columns),
        reason=np.where(hit, Reason.OK, Reason.OUTSIDE).astype(np.uint8).reshape(rows, columns),
        quantity="height",
        unit="mm",
        pitch=pitch_mm,
        method="triangulation",
    )
