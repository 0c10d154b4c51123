"""Light that one surface throws on another: one diffuse bounce, from the scene's geometry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.rig.pinhole import inverse, transform
from fringeworks.simulate.bodies import Body
from fringeworks.simulate.exposure import Transport
from fringeworks.simulate.virtual_rig import View
from fringeworks.types import FloatMap, Frozen, InputError

PATCH_PX = 8
"""Side of a patch, camera px: half a fine fringe. Patches as long as a fringe alias with it, and
near a crease their light has steps that a decoder sees. 640 × 512 px have 5,120 patches."""
LEAST_FACTOR = 1e-7
"""Form factors below this are not tested for shadow: a thousand of them are 1e-4 of the light."""
AT_THE_FAR_END = 1e-3
"""A body that a line of sight hits within this share of its length before its end is the surface at
the end: patches are not exactly on their bodies."""
NEAR_SIDES = 8.0
"""Distance up to which a patch is a rectangle and not a point, in its sides. At this distance the
two differ by less than 1 % of the form factor."""
IN_PLANE_MM = 1e-6
"""Height over a patch's plane up to which a point is in the plane, mm: rounding of coordinates."""
ROWS_AT_A_TIME = 128
"""Number of receivers whose form factors are computed together, which bounds the memory."""
MOMENT_OF_SIDE = 12.0
"""Squared side of a rectangle over its variance along that side."""


@dataclass(frozen=True, eq=False, repr=False)
class Patches(Frozen):
    """Small flat rectangles that stand for the surface that the camera sees; n of them."""

    middle_mm: FloatMap
    """(n, 3), camera coordinates, mm."""
    normal: FloatMap
    """(n, 3), unit normals towards the camera."""
    corners_mm: FloatMap
    """(n, 4, 3), corners in turn, mm: a rectangle of the same area and the same second moments."""
    area_mm2: FloatMap
    """(n,), mm²."""


def form_factors(receivers: tuple[FloatMap, FloatMap], patches: Patches) -> FloatMap:
    """Compute the share of each receiver's view that each patch fills, without shadows.

    Parameters
    ----------
    receivers : ((m, 3) array, (m, 3) array)
        Points, mm, and their unit normals.
    patches : Patches

    Returns
    -------
    (m, n) array, 0…1: the irradiance of a receiver per radiosity of a patch.

    Notes
    -----
    F = |Σ β_k n · Γ_k| / 2π over the edges of a rectangle, with the angle β_k under which an edge
    is seen and the unit normal Γ_k of the plane through it (Lambert 1760; Baum, Rushmeier and
    Winget 1989, doi:10.1145/74334.74367). It is exact for a rectangle above the receiver's horizon.
    For patches that are far away for their size, cos θ₁ cos θ₂ A / (π r²) serves. A patch whose
    middle is below the horizon, or that faces away, counts as 0.
    """
    parts = []
    for k in range(0, len(receivers[0]), ROWS_AT_A_TIME):
        points, normals = (part[k : k + ROWS_AT_A_TIME] for part in receivers)
        parts.append(_factors(points, normals, patches))
    return np.concatenate(parts)


def _factors(points: FloatMap, normals: FloatMap, patches: Patches) -> FloatMap:
    """Form factors of receivers (m, 3), (m, n)."""
    middle, area = patches.middle_mm, patches.area_mm2
    # Heights over the receiver's plane and over the patch's: cos θ times the distance.
    here = normals @ middle.T - np.sum(normals * points, axis=1)[:, None]
    there = points @ patches.normal.T - np.sum(patches.normal * middle, axis=1)
    square = np.sum((middle - points[:, None]) ** 2, axis=-1)
    facing = (here > IN_PLANE_MM) & (there > IN_PLANE_MM)
    factors = np.zeros(square.shape)
    factors[facing] = (here * there * area)[facing] / (np.pi * square[facing] ** 2)
    to, source = np.nonzero(facing & (square < NEAR_SIDES**2 * area))
    corners = patches.corners_mm[source] - points[to, None]
    factors[to, source] = _of_rectangles(corners, normals[to])
    return factors


def _of_rectangles(corners: FloatMap, normals: FloatMap) -> FloatMap:
    """Form factors of rectangles (k, 4, 3), seen from the origin along normals (k, 3)."""
    total = np.zeros(len(corners))
    for j in range(4):
        a, b = corners[:, j], corners[:, (j + 1) % 4]
        across = np.cross(a, b)
        length = np.linalg.norm(across, axis=1)
        angle = np.arctan2(length, np.sum(a * b, axis=1))
        share = angle * np.sum(across * normals, axis=1)
        # A receiver in line with an edge sees no angle of it.
        total += np.divide(share, length, out=np.zeros_like(share), where=length > 0)
    return np.asarray(np.abs(total) / (2.0 * np.pi))


def interreflection(
    view: View,
    bodies: Sequence[Body],
    *,
    T_camera_world: FloatMap | None = None,
    patch_px: int = PATCH_PX,
) -> Transport:
    """Compute how the scene lights itself: one diffuse bounce between the surfaces in view.

    Parameters
    ----------
    view : View
        Of ``bodies``.
    bodies : sequence of Body
        For shadows between the surfaces. A body with a crease should be several bodies, because a
        patch belongs to one body and is flat.
    T_camera_world : (4, 4) array, optional
        As given to ``look``.
    patch_px : int ≥ 2
        Side of a patch, camera px.

    Returns
    -------
    Transport: E + F (ρ E) for the irradiance E and the albedo ρ, with the form factors F between
    patches of the surface. Between the middles of patches of a body, the light is interpolated.

    Raises
    ------
    InputError for patches that are smaller than 2 px.

    Notes
    -----
    Surfaces that the camera does not see throw no light. Time and memory grow with the square of
    the number of patches: 8 bytes for each pair. The light within a patch is uniform: near
    a crease, where patches are as large as their distance, fringes within a patch are averaged.
    """
    if patch_px < 2:
        raise InputError(f"patch_px: expected at least 2 px, got {patch_px}")
    seen = view.body >= 0
    number, blocks = _numbered(view, patch_px)
    area = view.area_mm2[seen]
    mean = _means(number, area)
    patches = _patches(mean, area, number, view.points_mm[seen], view.normals[seen])
    factors = form_factors((patches.middle_mm, patches.normal), patches)
    T_world_camera = np.eye(4) if T_camera_world is None else inverse(T_camera_world)
    start = _nearest_pixels(number, view.points_mm[seen], patches.middle_mm)
    _remove_hidden(factors, bodies, transform(T_world_camera, start))
    spread = _interpolation(view, blocks, patch_px)
    albedo = view.albedo[seen]

    def bounce(direct: FloatMap) -> FloatMap:
        light = direct.copy()
        light[seen] += spread @ (factors @ (mean @ (albedo * direct[seen])))
        return light

    return bounce


def _numbered(view: View, patch_px: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Number of the patch of every pixel that sees a body, and numbers by body and block.

    The second has the shape (bodies, rows of blocks, columns of blocks), −1 where there is none.
    """
    h, w = view.body.shape
    shape = (int(view.body.max()) + 1, -(-h // patch_px), -(-w // patch_px))
    rows, columns = np.nonzero(view.body >= 0)
    key = (view.body[rows, columns], rows // patch_px, columns // patch_px)
    used, number = np.unique(np.ravel_multi_index(key, shape), return_inverse=True)
    blocks = np.full(shape, -1)
    blocks.reshape(-1)[used] = np.arange(used.size)
    return number, blocks


def _means(number: NDArray[np.intp], area: FloatMap) -> scipy.sparse.csr_array:
    """Matrix (patches, pixels) of means over patches, weighted by the area that pixels see."""
    total = np.bincount(number, area)
    entries = (area / total[number], (number, np.arange(number.size)))
    return scipy.sparse.csr_array(entries, shape=(total.size, number.size))


def _patches(
    mean: scipy.sparse.csr_array,
    area: FloatMap,
    number: NDArray[np.intp],
    points: FloatMap,
    normals: FloatMap,
) -> Patches:
    """Rectangles of the same area, middle and second moments as the pixels' surface."""
    middle, normal = mean @ points, mean @ normals
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    off = points - middle[number]
    off -= np.sum(off * normal[number], axis=1, keepdims=True) * normal[number]
    products = (off[:, :, None] * off[:, None, :]).reshape(-1, 9)
    moments, axes = np.linalg.eigh((mean @ products).reshape(-1, 3, 3))
    total = np.bincount(number, area).astype(np.float64)
    # Pixels are not points: each adds its own extent. Without it a single pixel had no area.
    own = (area / np.bincount(number)[number])[:, None] / MOMENT_OF_SIDE
    extent = np.bincount(number, own[:, 0])[:, None]
    sides = np.sqrt(MOMENT_OF_SIDE * (np.maximum(moments[:, 1:], 0.0) + extent))
    sides *= np.sqrt(total / np.prod(sides, axis=1))[:, None]
    first, second = (0.5 * sides[:, k, None] * axes[:, :, k + 1] for k in (0, 1))
    corners = [middle + a * first + b * second for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
    return Patches(middle, normal, np.stack(corners, axis=1), total)


def _nearest_pixels(number: NDArray[np.intp], points: FloatMap, middle: FloatMap) -> FloatMap:
    """The pixel's point nearest to the middle of every patch, which lies on the body, (n, 3)."""
    distance = np.linalg.norm(points - middle[number], axis=1)
    order = np.lexsort((distance, number))
    first = np.searchsorted(number[order], np.arange(len(middle)))
    return np.asarray(points[order[first]])


def _remove_hidden(factors: FloatMap, bodies: Sequence[Body], world: FloatMap) -> None:
    """Set form factors to 0 where a body is between two patches at points (n, 3), mm."""
    for k in range(0, len(world), ROWS_AT_A_TIME):
        rows = factors[k : k + ROWS_AT_A_TIME]
        to, source = np.nonzero(rows > LEAST_FACTOR)
        start = world[k + to]
        way = world[source] - start
        free = np.ones(to.size, bool)
        for body in bodies:
            free &= body.hit(start, way) > 1.0 - AT_THE_FAR_END
        rows[to[~free], source[~free]] = 0.0


def _interpolation(view: View, blocks: NDArray[np.intp], patch_px: int) -> scipy.sparse.csr_array:
    """Matrix (pixels, patches) of bilinear interpolation between blocks of the same body."""
    rows, columns = np.nonzero(view.body >= 0)
    body = view.body[rows, columns]
    place = [(k + 0.5) / patch_px - 0.5 for k in (rows, columns)]
    low = [np.floor(p).astype(np.intp) for p in place]
    pixels, patches, shares = [], [], []
    for down in (0, 1):
        for right in (0, 1):
            at = [low[0] + down, low[1] + right]
            share = (1.0 - np.abs(place[0] - at[0])) * (1.0 - np.abs(place[1] - at[1]))
            inside = (at[0] >= 0) & (at[0] < blocks.shape[1])
            inside &= (at[1] >= 0) & (at[1] < blocks.shape[2])
            patch = np.full(body.size, -1)
            patch[inside] = blocks[body[inside], at[0][inside], at[1][inside]]
            exists = np.flatnonzero(patch >= 0)
            pixels.append(exists)
            patches.append(patch[exists])
            shares.append(share[exists])
    where, share = np.concatenate(pixels), np.concatenate(shares)
    # A pixel lies in a block of its own, so that the sum of its shares is at least a quarter.
    share /= np.bincount(where, share)[where]
    entries = (share, (where, np.concatenate(patches)))
    return scipy.sparse.csr_array(entries, shape=(body.size, int(blocks.max()) + 1))
