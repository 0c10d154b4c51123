"""Views brought together by their shape alone: features, and poses that many of them agree on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.rig.pinhole import transform
from fringeworks.types import FloatMap, InputError
from fringeworks.views.board_views import rigid
from fringeworks.views.registration import register
from fringeworks.views.surface_points import SurfacePoints

NODES = 1500
"""Approximate number of points of a view that get a feature."""
NEIGHBOURS = 60
"""Number of neighbours that a feature describes."""
BINS = 11
"""Bins of each of the three angles of a feature, as in the original."""
TRIALS = 30_000
"""Number of triples of matches that are tried."""
CHECKED = 60
"""Number of poses by triples whose overlap is counted."""
REFINED = 6
"""Number of the best poses that are refined by registration; the one with the best overlap wins."""
SIDE_TOLERANCE = 0.08
"""Largest relative difference of the sides of two matching triangles."""
NEAREST = 3
"""Number of most similar features of the other view that a point is matched with."""
MIN_SHARE = 0.3
"""Smallest share of a view's points that must lie on the other view, 0…1: neighbouring views of a
part in steps of 30° share two thirds or more."""


def align_by_shape(views: Sequence[SurfacePoints], *, seed: int = 0) -> list[FloatMap]:
    """Align every view with the one before it, without poses to start from.

    Parameters
    ----------
    views : sequence of SurfacePoints
        In camera coordinates; neighbours overlap.
    seed : int
        Seed of the random choice of matches.

    Returns
    -------
    list of (4, 4) arrays, T_first_view of each view, mm.

    Raises
    ------
    InputError where two neighbours cannot be aligned.
    """
    described = [_described(view) for view in views]
    found: list[FloatMap] = [np.eye(4)]
    for k in range(1, len(views)):
        try:
            T = _aligned(views[k], views[k - 1], described[k], described[k - 1], seed)
        except InputError as error:
            raise error.at(f"views {k} and {k + 1}") from error
        found.append(found[-1] @ T)
    return found


def _described(view: SurfacePoints) -> tuple[SurfacePoints, FloatMap]:
    """Points spread evenly over a view, and their features (n, 33).

    Fast point feature histograms (Rusu, ICRA 2009): the angles between the normals of a point and
    its neighbours and the line between them, averaged over the neighbours' own histograms.
    """
    area = np.ptp(view.xyz_mm, axis=0)
    side = float(np.sqrt(np.sort(area)[1] * np.sort(area)[2] / NODES))
    _, first = np.unique(np.floor(view.xyz_mm / side).astype(int), axis=0, return_index=True)
    nodes = view.at(np.sort(first))
    tree = scipy.spatial.cKDTree(nodes.xyz_mm)
    distance, near = tree.query(nodes.xyz_mm, k=min(NEIGHBOURS + 1, len(first)))
    distance, near = distance[:, 1:], near[:, 1:]
    simple = _histograms(nodes, near, distance)
    weight = 1.0 / distance
    feature = simple + np.einsum("nk,nkf->nf", weight, simple[near]) / weight.sum(1)[:, None]
    return nodes, feature / np.linalg.norm(feature, axis=1, keepdims=True)


def _histograms(nodes: SurfacePoints, near: NDArray[np.intp], distance: FloatMap) -> FloatMap:
    line = (nodes.xyz_mm[near] - nodes.xyz_mm[:, None]) / distance[..., None]
    u = np.broadcast_to(nodes.normals[:, None], line.shape)
    other = nodes.normals[near]
    v = np.cross(line, u)
    v /= np.linalg.norm(v, axis=-1, keepdims=True) + 1e-12
    w = np.cross(u, v)
    alpha = np.sum(v * other, axis=-1)
    phi = np.sum(u * line, axis=-1)
    theta = np.arctan2(np.sum(w * other, axis=-1), np.sum(u * other, axis=-1)) / np.pi
    parts = []
    for value in (alpha, phi, theta):
        at = np.clip(((value + 1.0) * 0.5 * BINS).astype(int), 0, BINS - 1)
        row = np.arange(len(at))[:, None] * BINS
        parts.append(np.bincount((row + at).ravel(), minlength=len(at) * BINS).reshape(-1, BINS))
    return np.concatenate(parts, axis=1).astype(np.float64)


def _aligned(
    source: SurfacePoints,
    target: SurfacePoints,
    one: tuple[SurfacePoints, FloatMap],
    other: tuple[SurfacePoints, FloatMap],
    seed: int,
) -> FloatMap:
    """T_target_source with the largest overlap."""
    rng = np.random.default_rng(seed)
    nodes, feature = one
    _, near = scipy.spatial.cKDTree(other[1]).query(feature, k=NEAREST)
    a = np.repeat(np.arange(len(nodes.xyz_mm)), NEAREST)
    b = near.ravel()
    triple = rng.integers(0, len(a), (TRIALS, 3))
    p, q = nodes.xyz_mm[a[triple]], other[0].xyz_mm[b[triple]]
    sides = [np.linalg.norm(x - np.roll(x, 1, axis=1), axis=2) for x in (p, q)]
    size = float(np.linalg.norm(np.ptp(nodes.xyz_mm, axis=0)))
    alike = (np.abs(sides[0] - sides[1]) < SIDE_TOLERANCE * sides[0]).all(axis=1)
    alike &= (sides[0] > 0.1 * size).all(axis=1)
    if not alike.any():
        raise InputError("expected features that match, got none; take more views")
    T = rigid(p[alike], q[alike])
    n_p, n_q = nodes.normals[a[triple[alike]]], other[0].normals[b[triple[alike]]]
    turned = np.einsum("tij,tkj->tki", T[:, :3, :3], n_p)
    agree = np.sum(turned * n_q, axis=2).min(axis=1)
    order = np.argsort(-agree)[: 10 * CHECKED]
    tree = scipy.spatial.cKDTree(other[0].xyz_mm)
    some = nodes.at(np.arange(0, len(nodes.xyz_mm), 4))
    scores = np.array([_share(some, other[0], tree, T[k], 0.02 * size) for k in order])
    best = order[np.argsort(-scores)[:REFINED]]
    refined = []
    for k in best:
        try:
            found = register(source, target, T[k], reach_mm=0.05 * size)
        except InputError:
            continue
        refined.append((found.overlap / max(found.chi, 1.0), found))
    if not refined:
        raise InputError("expected an overlap, got none; take more views, or use a board")
    found = max(refined, key=lambda item: item[0])[1]
    if found.overlap < MIN_SHARE:
        raise InputError(
            f"expected {MIN_SHARE:.0%} of the points to lie on the other view, got "
            f"{found.overlap:.0%}; take more views, or use a board"
        )
    return found.T_target_source


def _share(
    source: SurfacePoints,
    target: SurfacePoints,
    tree: scipy.spatial.cKDTree,
    T: FloatMap,
    reach: float,
) -> float:
    """Share of points that lie near a point of the other view with the same normal."""
    near, index = tree.query(transform(T, source.xyz_mm), distance_upper_bound=reach)
    has = np.isfinite(near)
    turned = source.normals[has] @ T[:3, :3].T
    return float(np.count_nonzero(np.sum(turned * target.normals[index[has]], axis=1) > 0.8)) / len(
        near
    )
