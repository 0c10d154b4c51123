"""Features of a view's surface, and the poses of two views that many of them agree on."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from fringeworks.rig.pinhole import inverse, transform
from fringeworks.types import FloatMap, InputError
from fringeworks.views.board_views import rigid
from fringeworks.views.model_target import (
    ALIKE_DEG,
    ALIKE_SHARE,
    OTHER_DEG,
    OTHER_SHARE,
    REFINED_POINTS,
)
from fringeworks.views.poses import apart, distinct
from fringeworks.views.registration import Registration, ViewTarget, register
from fringeworks.views.sight import Sight
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
"""Number of different poses that are refined by registration."""
SIDE_TOLERANCE = 0.08
"""Largest relative difference of the sides of two matching triangles."""
NEAREST = 3
"""Number of most similar features of the other view that a point is matched with."""
MOST_POSES = 24
"""Largest number of poses of two views that are compared: as many as a cube has."""
MIN_SHARE = 0.3
"""Smallest share of a view's points that must lie on the other view, 0…1: neighbouring views of a
part in steps of 30° share two thirds or more."""
MOST_SLIDES = 1
"""Largest number of directions in which a surface may slide on itself in a pose: with two, a single
plane, cylinder or sphere lies on another one, which any two do."""
REFINE_SHARE = 0.05
"""How far apart matched points may be when a pose is refined, in sizes of the view."""


@dataclass(frozen=True)
class Described:
    """A view with what a search for its pose needs."""

    view: SurfacePoints
    sight: Sight
    nodes: SurfacePoints
    """Points spread evenly over the view."""
    feature: FloatMap
    """Their features, (n, 33)."""

    @property
    def size_mm(self) -> float:
        """Length of the diagonal of the view's box, mm."""
        return float(np.linalg.norm(np.ptp(self.nodes.xyz_mm, axis=0)))

    @property
    def middle_mm(self) -> FloatMap:
        return np.asarray(self.view.xyz_mm.mean(axis=0))

    @property
    def other_pose(self) -> tuple[float, float]:
        """Rotation, degrees, and displacement, mm, from which on two poses are different."""
        return OTHER_DEG, OTHER_SHARE * self.size_mm

    def differ(self, one: Registration, other: Registration) -> bool:
        """Whether two poses of the view differ beyond directions in which its surface slides."""
        turn, place = self.other_pose
        limits = turn, np.inf if one.slides or other.slides else place
        return apart(one.T_target_source, other.T_target_source, self.middle_mm, limits)


def described(view: SurfacePoints) -> Described:
    """Spread points over a view and compute their features.

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
    feature /= np.linalg.norm(feature, axis=1, keepdims=True)
    return Described(view, Sight(view), nodes, feature)


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


def candidates(source: Described, target: Described, *, seed: int = 0) -> list[FloatMap]:
    """Find poses in which a view may lie on another one.

    Parameters
    ----------
    source, target : Described
    seed : int
        Seed of the random choice of matches.

    Returns
    -------
    list of (4, 4) arrays, T_target_source, mm, the best one first: rough, and different from each
    other.

    Raises
    ------
    InputError where no features match.
    """
    rng = np.random.default_rng(seed)
    nodes, others, size = source.nodes, target.nodes, source.size_mm
    _, near = scipy.spatial.cKDTree(target.feature).query(source.feature, k=NEAREST)
    a = np.repeat(np.arange(len(nodes.xyz_mm)), NEAREST)
    b = near.ravel()
    triple = rng.integers(0, len(a), (TRIALS, 3))
    p, q = nodes.xyz_mm[a[triple]], others.xyz_mm[b[triple]]
    sides = [np.linalg.norm(x - np.roll(x, 1, axis=1), axis=2) for x in (p, q)]
    alike = (np.abs(sides[0] - sides[1]) < SIDE_TOLERANCE * sides[0]).all(axis=1)
    alike &= (sides[0] > 0.1 * size).all(axis=1)
    if not alike.any():
        raise InputError("expected features that match, got none; take more views")
    T = rigid(p[alike], q[alike])
    n_p, n_q = nodes.normals[a[triple[alike]]], others.normals[b[triple[alike]]]
    turned = np.einsum("tij,tkj->tki", T[:, :3, :3], n_p)
    agree = np.sum(turned * n_q, axis=2).min(axis=1)
    T = _different(T[np.argsort(-agree)], source.middle_mm, ALIKE_SHARE * size)[: 10 * CHECKED]
    tree, some = scipy.spatial.cKDTree(others.xyz_mm), nodes.at(np.arange(0, len(a) // NEAREST, 4))
    shares = np.array([_share(some, others, tree, one, 0.02 * size) for one in T])
    order = np.argsort(-shares)[: 4 * CHECKED]
    shares = shares[order] - [_hidden(source, target, T[k], 0.02 * size) for k in order]
    limits = ALIKE_DEG, ALIKE_SHARE * size
    return distinct(T[order[np.argsort(-shares)]], source.middle_mm, limits, REFINED)


def _different(poses: FloatMap, middle: FloatMap, side_mm: float) -> FloatMap:
    """The first pose in every cell of rotations and places of the middle, (n, 4, 4)."""
    turn = scipy.spatial.transform.Rotation.from_matrix(poses[:, :3, :3]).as_rotvec(degrees=True)
    place = poses[:, :3, :3] @ middle + poses[:, :3, 3]
    cell = np.rint(np.column_stack((turn / ALIKE_DEG, place / side_mm))).astype(np.int64)
    return poses[np.sort(np.unique(cell, axis=0, return_index=True)[1])]


def refined(
    source: Described, target: SurfacePoints, starts: Sequence[FloatMap], points: int
) -> list[Registration]:
    """Register a number of points of a view with another one from several starts.

    Returns
    -------
    list of Registration, the different ones that overlap enough, the largest overlap first.
    """
    found = [f for f in _registered(source, target, starts, points) if f.slides <= MOST_SLIDES]
    found.sort(key=lambda f: -f.overlap / max(f.chi, 1.0))
    kept: list[Registration] = []
    for f in found:
        if all(source.differ(f, one) for one in kept):
            kept.append(f)
    return kept[:MOST_POSES]


def fewest_slides(source: Described, target: SurfacePoints, starts: Sequence[FloatMap]) -> int:
    """Number of directions in which the shape slides on itself in every pose that overlaps enough;
    0 where there is no such pose."""
    found = _registered(source, target, starts, REFINED_POINTS)
    return min((f.slides for f in found), default=0)


def _registered(
    source: Described, target: SurfacePoints, starts: Sequence[FloatMap], points: int
) -> list[Registration]:
    """Registrations of a number of points from several starts that overlap enough."""
    view = source.view
    fewer = view.at(np.random.default_rng(0).permutation(len(view.xyz_mm))[:points])
    seen, found = ViewTarget(target), []
    for T in starts:
        with suppress(InputError):
            one = register(fewer, seen, T, reach_mm=REFINE_SHARE * source.size_mm)
            found += [one] * (one.overlap >= MIN_SHARE)
    return found


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


def _hidden(source: Described, target: Described, T: FloatMap, reach: float) -> float:
    """Share of points in front of what the other view sees, the larger one of both views."""
    pairs = (source, target, T), (target, source, inverse(T))
    found = [
        other.sight.in_front(one.nodes.moved(to), sigmas=0.0, reach_mm=reach)
        for one, other, to in pairs
    ]
    return max(len(index) / max(seen, 1) for index, seen in found)
