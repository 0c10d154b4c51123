"""The nearest point of a triangle mesh to any point, with the side that the point is on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks import _core
from fringeworks.surface.nominal import ROUND, nominal_distance
from fringeworks.types import BoolMap, FloatMap, InputError, TriangleMesh

ON_EDGE = 1e-9
"""Barycentric coordinate below which a point of a triangle lies on an edge, to rounding."""
SMOOTH_COSINE = 0.966
"""Least cosine between the normals of a vertex and of a triangle for a round surface: 15°. Between
triangles of a sharp edge the angle is larger."""
MOST_EDGE_POINTS = 1e6
"""Largest number of points by which sharp edges are represented; they take 100 MB."""
FLAT_SHARE = 1e-12
"""Smallest area of a triangle, over the square of its longest edge. A triangle below it has no
normal."""
EXACT_CHORDS = 2.0
"""Largest difference between the distances from triangles and from the nominal form of their face,
in chord errors of the drawing, up to which the latter is taken. Where it is larger, the nearest
point of the unlimited form lies off the face."""


@dataclass(frozen=True)
class Nearest:
    """The nearest points of a mesh."""

    distance_mm: FloatMap
    """Signed distance, positive outside, (n,), mm; NaN beyond the reach."""
    point_mm: FloatMap
    """The nearest point of the mesh or of the drawing's face, (n, 3), mm; NaN beyond the reach."""
    direction: FloatMap
    """Direction in which the signed distance grows fastest, (n, 3), of length 1."""
    face: NDArray[np.int64]
    """The face that the nearest point lies on, (n,); −1 beyond the reach."""


class MeshDistance:
    """Distances from a triangle mesh, prepared for many points.

    Parameters
    ----------
    mesh : TriangleMesh
        Triangles without area are left out.

    Raises
    ------
    InputError for a mesh without a triangle that has an area.

    Notes
    -----
    The nearest triangle is found by a tree of boxes. The sign is that of the normal at the nearest
    point; on edges and vertices this is the normal weighted by angles (Bærentzen and Aanæs, IEEE
    Transactions on Visualization and Computer Graphics 11, 2005, doi:10.1109/TVCG.2005.49).
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        vertices = np.asarray(mesh.vertices_mm, np.float64)
        faces = mesh.faces.astype(np.int64)
        corners = vertices[faces]
        sides = [corners[:, (k + 1) % 3] - corners[:, k] for k in range(3)]
        cross = np.cross(sides[0], -sides[2])
        double_area = np.sqrt(_dot(cross, cross))
        longest = np.max([_dot(side, side) for side in sides], axis=0)
        good = double_area > FLAT_SHARE * longest
        if not good.any():
            raise InputError("model: expected triangles with an area, got none")
        if good.all():
            good = np.s_[:]
        self.corners: FloatMap = corners[good]
        """Corners of the triangles, (m, 3, 3), mm."""
        self.normals: FloatMap = cross[good] / double_area[good, None]
        """Unit normals of the triangles, (m, 3)."""
        self.areas_mm2: FloatMap = 0.5 * double_area[good]
        """Areas of the triangles, (m,), mm²."""
        self.nominal = mesh.nominal
        """Faces of the drawing; empty where it has none."""
        self.face_index = None if mesh.face_index is None else mesh.face_index[good]
        """Place in ``nominal`` of the face of every triangle, (m,); None where there are none."""
        self._chord_mm = mesh.chord_mm
        self.size_mm: float = float(np.linalg.norm(np.ptp(self.corners.reshape(-1, 3), axis=0)))
        """Diagonal of the box around the mesh, mm."""
        # STL files repeat vertices: those at one place count as one.
        number = numbered(vertices)[1][faces[good]]
        shared = _shared(self.corners, self.normals, number)
        self._edge_normals, self._vertex_normals, self._sharp = shared
        around = _unit(self._vertex_normals)
        cosine = np.einsum("mkc,mc->mk", around, self.normals)
        self._corner_normals = np.where(
            (cosine > SMOOTH_COSINE)[..., None], around, self.normals[:, None]
        )
        self._edge_trees: dict[float, tuple[scipy.spatial.cKDTree | None, float]] = {}
        separate = np.arange(3 * len(self.corners), dtype=np.uint32).reshape(-1, 3)
        self._tree = _core.Triangles(self.corners.reshape(-1, 3), separate)

    def beside_edges(self, points_mm: FloatMap, limit_mm: float) -> BoolMap:
        """Return which points lie near a sharp edge of the mesh, or near its border.

        Parameters
        ----------
        points_mm : (n, 3) array
            Finite, mm.
        limit_mm : float > 0
            Distance up to which a point counts as near, mm.
        """
        if limit_mm not in self._edge_trees:
            self._edge_trees[limit_mm] = self._edge_tree(limit_mm)
        tree, reach = self._edge_trees[limit_mm]
        if tree is None:
            return np.zeros(len(points_mm), bool)
        near = tree.query(points_mm, distance_upper_bound=reach, workers=-1)[0]
        return np.asarray(np.isfinite(near))

    def _edge_tree(self, limit_mm: float) -> tuple[scipy.spatial.cKDTree | None, float]:
        """Points along the sharp edges, and the distance from them that covers the limit."""
        ends = self._sharp
        if not len(ends):
            return None, limit_mm
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        step = max(0.5 * limit_mm, float(length.sum()) / MOST_EDGE_POINTS)
        count = np.ceil(length / step).astype(int) + 1
        edge = np.repeat(np.arange(len(ends)), count)
        first = np.repeat(np.cumsum(count) - count, count)
        at = (np.arange(len(edge)) - first) / np.maximum(count[edge] - 1, 1)
        samples = ends[edge, 0] + at[:, None] * (ends[edge, 1] - ends[edge, 0])
        # Half a step along the edge, and the limit across it.
        return scipy.spatial.cKDTree(samples), float(np.hypot(limit_mm, 0.5 * step))

    def smooth_normals(self, found: Nearest) -> FloatMap:
        """Return the normals at nearest points of the round surface that triangles stand for.

        They are interpolated between the corners, but not across sharp edges; (n, 3), for points
        within reach.
        """
        has = found.face >= 0
        face = found.face[has]
        share = _triangle_distance(found.point_mm[has], self.corners[face])[2]
        return _unit(np.einsum("nk,nkc->nc", share, self._corner_normals[face]))

    def nearest(self, points_mm: FloatMap, reach_mm: float) -> Nearest:
        """Find the nearest points of the mesh.

        Parameters
        ----------
        points_mm : (n, 3) array
            Finite, mm.
        reach_mm : float > 0
            Distance beyond which nothing is searched, mm.

        Returns
        -------
        Nearest
        """
        points = np.ascontiguousarray(points_mm, np.float64)
        found = self._signed(points, self._tree.nearest(points, reach_mm).astype(np.int64))
        self._exact(points, found)
        return found

    def face_of(self, found: Nearest) -> NDArray[np.int32]:
        """Return the number of the drawing's face that nearest points lie on, (n,), from 1; 0
        beyond the reach and where the model has no faces.
        """
        number = np.zeros(len(found.face), np.int32)
        if self.face_index is not None:
            has = found.face >= 0
            place = np.array([face.number for face in self.nominal], np.int32)
            number[has] = place[self.face_index[found.face[has]]]
        return number

    def _exact(self, points: FloatMap, found: Nearest) -> None:
        """Replace distances from triangles by those from the round faces they stand for."""
        if self.face_index is None or self._chord_mm is None:
            return
        has = np.flatnonzero(found.face >= 0)
        of_face = self.face_index[found.face[has]]
        for place in np.unique(of_face):
            face = self.nominal[place]
            at = has[of_face == place]
            known = nominal_distance(face, points[at]) if face.kind in ROUND else None
            if known is None:
                continue
            distance, outwards = known
            agree = np.einsum("nc,nc->n", outwards, self.normals[found.face[at]])
            side = np.where(agree < 0, -1.0, 1.0)
            exact = side * distance
            near = np.abs(exact - found.distance_mm[at]) <= EXACT_CHORDS * self._chord_mm
            at, turned = at[near], (side[:, None] * outwards)[near]
            found.distance_mm[at] = exact[near]
            found.direction[at] = turned
            found.point_mm[at] = points[at] - exact[near, None] * turned

    def _signed(self, points: FloatMap, face: NDArray[np.int64]) -> Nearest:
        n = len(points)
        signed, inside = np.full(n, np.nan), np.zeros(n, bool)
        foot, direction = np.full((n, 3), np.nan), np.full((n, 3), np.nan)
        has = np.flatnonzero(face >= 0)
        if has.size:
            at = face[has]
            distance, foot[has], share = _triangle_distance(points[has], self.corners[at])
            zero = share <= ON_EDGE
            inside[has] = ~zero.any(axis=1)
            normal = self.normals[at].copy()
            edge, vertex = zero.sum(axis=1) == 1, zero.sum(axis=1) == 2
            # Corner k has share 0 on the edge opposite to it.
            normal[edge] = self._edge_normals[at[edge], np.argmax(zero[edge], axis=1)]
            normal[vertex] = self._vertex_normals[at[vertex], np.argmax(share[vertex], axis=1)]
            way = points[has] - foot[has]
            sign = np.where(np.sum(way * normal, axis=1) < 0, -1.0, 1.0)
            signed[has] = sign * distance
            aside = ~inside[has] & (distance > 0)
            normal[aside] = sign[aside, None] * way[aside] / distance[aside, None]
            direction[has] = normal
        return Nearest(signed, foot, direction, face)


def sampled(mesh: MeshDistance, count: int, rng: np.random.Generator) -> tuple[FloatMap, FloatMap]:
    """Random points of a mesh, evenly over its area, with their normals; both (count, 3)."""
    share = mesh.areas_mm2 / mesh.areas_mm2.sum()
    face = rng.choice(len(share), count, p=share)
    u, v = rng.random((2, count))
    # Points beyond the diagonal of the parallelogram are turned back into the triangle.
    over = u + v > 1.0
    u, v = np.where(over, 1.0 - u, u), np.where(over, 1.0 - v, v)
    p, q, r = np.moveaxis(mesh.corners[face], 1, 0)
    return p + u[:, None] * (q - p) + v[:, None] * (r - p), mesh.normals[face]


def _triangle_distance(points: FloatMap, corners: FloatMap) -> tuple[FloatMap, FloatMap, FloatMap]:
    """Distance from a triangle each, its nearest point (n, 3), and barycentric shares (n, 3)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, ac, ap = b - a, c - a, points - a
    d00, d01, d11 = _dot(ab, ab), _dot(ab, ac), _dot(ac, ac)
    d20, d21 = _dot(ap, ab), _dot(ap, ac)
    scale = d00 * d11 - d01 * d01
    v, w = (d11 * d20 - d01 * d21) / scale, (d00 * d21 - d01 * d20) / scale
    share = np.stack((1.0 - v - w, v, w), axis=1)
    out = np.flatnonzero((share < 0).any(axis=1))
    if out.size:
        share[out] = _on_border(points[out], corners[out])
    foot = np.einsum("nk,nkc->nc", share, corners)
    off = points - foot
    return np.sqrt(_dot(off, off)), foot, share


def _on_border(points: FloatMap, corners: FloatMap) -> FloatMap:
    """Barycentric shares of the nearest point on a triangle's border, (n, 3)."""
    nearest = np.full(len(points), np.inf)
    share = np.zeros((len(points), 3))
    for k in range(3):
        p, q = corners[:, k], corners[:, (k + 1) % 3]
        along = q - p
        t = np.clip(_dot(points - p, along) / _dot(along, along), 0.0, 1.0)
        off = points - p - t[:, None] * along
        square = _dot(off, off)
        nearer = square < nearest
        nearest = np.where(nearer, square, nearest)
        here = np.zeros_like(share)
        here[:, k], here[:, (k + 1) % 3] = 1.0 - t, t
        share[nearer] = here[nearer]
    return share


def _unit(vectors: FloatMap) -> FloatMap:
    # NumPy's norm takes four times as long for rows of three.
    length = np.sqrt(np.einsum("...c,...c->...", vectors, vectors))[..., None]
    return np.asarray(vectors / np.maximum(length, np.finfo(np.float64).tiny))


def _dot(p: FloatMap, q: FloatMap) -> FloatMap:
    return np.asarray(np.einsum("nk,nk->n", p, q))


def numbered(places: FloatMap) -> tuple[FloatMap, NDArray[np.intp]]:
    """Return the distinct places of (n, 3), in their order by x, y and z, and the number of each of
    the n places among them, (n,).

    As ``numpy.unique(…, axis=0, return_inverse=True)``, which compares rows one by one and is slow.
    """
    order = np.lexsort(places.T[::-1])
    ordered = places[order]
    other = np.concatenate(([True], np.any(ordered[1:] != ordered[:-1], axis=1)))
    number = np.empty(len(places), np.intp)
    number[order] = np.cumsum(other) - 1
    return ordered[other], number


def _summed(index: NDArray[np.intp], vectors: FloatMap) -> FloatMap:
    """Sums of the vectors (n, 3) of each index, in their order."""
    return np.stack([np.bincount(index, vectors[:, k]) for k in range(3)], axis=1)


def _shared(
    corners: FloatMap, normals: FloatMap, vertex: NDArray[np.intp]
) -> tuple[FloatMap, FloatMap, FloatMap]:
    """What neighbouring triangles share; ``vertex`` numbers the places of corners, (m, 3).

    Returns
    -------
    normals of the edge opposite to each corner, and of the vertex there, both (m, 3, 3); ends of
    the sharp edges and of the border, (k, 2, 3)
    """
    m, count = len(corners), int(vertex.max()) + 1
    toward = [corners[:, (k + 1) % 3] - corners[:, k] for k in range(3)]
    weighted, sides = [], []
    for k in range(3):
        one, other = toward[k], -toward[(k + 2) % 3]
        across = np.cross(one, other)
        angle = np.arctan2(np.sqrt(_dot(across, across)), _dot(one, other))
        weighted.append(angle[:, None] * normals)
        p, q = vertex[:, (k + 1) % 3], vertex[:, (k + 2) % 3]
        sides.append(np.minimum(p, q) * count + np.maximum(p, q))
    at_vertex = _summed(vertex.T.ravel(), np.concatenate(weighted))
    keys = np.stack(sides, axis=1).ravel()
    _, place, edge = np.unique(keys, return_index=True, return_inverse=True)
    edge = edge.reshape(m, 3)
    at_edge = _summed(edge.T.ravel(), np.tile(normals, (3, 1)))
    # Two unit normals at an angle φ have a sum of 2 cos(φ/2); a single one, at a border, of 1.
    smooth = np.sqrt(_dot(at_edge, at_edge)) > 2.0 * np.sqrt(0.5 * (1.0 + SMOOTH_COSINE))
    face, k = np.divmod(place[~smooth], 3)
    ends_of = np.stack((corners[face, (k + 1) % 3], corners[face, (k + 2) % 3]), axis=1)
    return at_edge[edge], at_vertex[vertex], ends_of
