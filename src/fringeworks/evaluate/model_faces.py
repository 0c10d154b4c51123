"""Faces of a model: smooth regions of its triangles, and places spread over them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.surface.closest import SMOOTH_COSINE, numbered
from fringeworks.types import FloatMap, Frozen, InputError, TriangleMesh

SAMPLES = 400
"""Number of places on each face. The share of them that is seen then has a standard deviation of
at most 2.5 %, and less because they are spread evenly."""
PLASTIC = (0.7548776662466927, 0.5698402909980532)
"""Steps of a sequence that fills the unit square evenly: 1/ρ and 1/ρ² of the plastic number ρ, the
plane's counterpart of the golden section."""
INSIDE = 1e-6
"""How far samples are moved from the border of their triangle to its middle, as a share: rounding
would otherwise let rays pass between triangles."""


@dataclass(frozen=True, eq=False, repr=False)
class FaceSamples(Frozen):
    """Places spread evenly over each face of a model."""

    points_mm: FloatMap
    """(n, 3), model coordinates, mm."""
    face: NDArray[np.intp]
    """Number of the face of each place, (n,)."""


def smooth_faces(model: TriangleMesh) -> dict[str, NDArray[np.intp]]:
    """Divide a model into smooth regions: neighbouring triangles without a sharp edge between.

    Parameters
    ----------
    model : TriangleMesh

    Returns
    -------
    Triangles of each face, (k,) int arrays, by the names "face 1", "face 2" … from the largest area
    to the smallest.

    Raises
    ------
    InputError for a model without triangles that have an area.

    Notes
    -----
    An edge is sharp where the normals of its triangles differ by more than twice 15°, as where
    deviations are measured.

    Examples
    --------
    >>> roof = np.array([[0, 0, 0], [9, 0, 5], [0, 9, 0], [9, 9, 5], [18, 0, 0], [18, 9, 0.0]])
    >>> triangles = np.array([[0, 1, 2], [1, 3, 2], [1, 4, 3], [4, 5, 3]], np.uint32)
    >>> found = smooth_faces(TriangleMesh(roof, triangles))
    >>> {name: which.tolist() for name, which in found.items()}
    {'face 1': [0, 1], 'face 2': [2, 3]}
    """
    across, area = _normals(model)
    if not (area > 0).any():
        raise InputError("model: expected triangles with an area, got none")
    unit = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    vertex = numbered(np.asarray(model.vertices_mm, np.float64))[1][np.asarray(model.faces)]
    pair = np.sort(np.stack((vertex, np.roll(vertex, -1, axis=1)), axis=-1).reshape(-1, 2), axis=1)
    key = pair[:, 0] * (int(vertex.max()) + 1) + pair[:, 1]
    order = np.argsort(key, kind="stable")
    same = key[order][1:] == key[order][:-1]
    one, other = order[:-1][same] // 3, order[1:][same] // 3
    # Twice the angle of ``SMOOTH_COSINE``: that is between a triangle and the mean of the two.
    smooth = np.einsum("nk,nk->n", unit[one], unit[other]) > 2.0 * SMOOTH_COSINE**2 - 1.0
    count = len(area)
    graph = scipy.sparse.coo_array(
        (np.ones(int(smooth.sum())), (one[smooth], other[smooth])), shape=(count, count)
    )
    label = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    sizes = np.bincount(label, area)
    ranked = [k for k in np.argsort(-sizes, kind="stable") if sizes[k] > 0]
    return {f"face {n}": np.flatnonzero(label == k) for n, k in enumerate(ranked, 1)}


def face_samples(model: TriangleMesh, faces: Mapping[str, NDArray[Any]]) -> FaceSamples:
    """Places spread evenly over the faces of a model.

    Parameters
    ----------
    model : TriangleMesh
    faces : mapping of names to (k,) int arrays
        Triangles of each face.

    Returns
    -------
    FaceSamples, the same for equal models

    Raises
    ------
    InputError for no faces, and for triangles that the model lacks or that have no area.
    """
    if not faces:
        raise InputError("faces: expected one or more, got none")
    area = _normals(model)[1]
    corners = np.asarray(model.vertices_mm, np.float64)[np.asarray(model.faces)]
    step = np.arange(SAMPLES)
    a, b = (np.mod((step + 0.5) * share, 1.0) for share in PLASTIC)
    a, b = np.where(a + b > 1, 1 - a, a), np.where(a + b > 1, 1 - b, b)
    weights = np.stack((1 - a - b, a, b), axis=1) * (1 - INSIDE) + INSIDE / 3
    places = []
    for name, given in faces.items():
        triangles = np.asarray(given)
        whole = triangles.ndim == 1 and triangles.dtype.kind in "ui" and len(triangles) > 0
        if not whole or triangles.min() < 0 or triangles.max() >= len(area):
            raise InputError(f"{name}: expected numbers of triangles from 0 to {len(area) - 1}")
        total = np.cumsum(area[triangles])
        if not total[-1] > 0:
            raise InputError(f"{name}: expected triangles with an area, got none")
        chosen = np.searchsorted(total, (step + 0.5) / SAMPLES * total[-1])
        places.append(np.einsum("nk,nkc->nc", weights, corners[triangles[chosen]]))
    return FaceSamples(np.concatenate(places), np.repeat(np.arange(len(faces)), SAMPLES))


def _normals(model: TriangleMesh) -> tuple[FloatMap, FloatMap]:
    """Normals of the triangles, twice as long as their area, and the areas, mm²."""
    corners = np.asarray(model.vertices_mm, np.float64)[np.asarray(model.faces)]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return across, np.asarray(0.5 * np.linalg.norm(across, axis=1))
