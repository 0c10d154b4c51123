"""A model as the target of a registration, and the search for a start where none is known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from fringeworks.rig.pinhole import pose
from fringeworks.surface.closest import MeshDistance, sampled
from fringeworks.types import FloatMap, InputError
from fringeworks.views.poses import apart, distinct
from fringeworks.views.registration import Registration, register
from fringeworks.views.surface_points import SurfacePoints

ROTATIONS = 700
"""Number of rotations that are tried: neighbours are about 26° apart, and a fit finds its way from
half of that."""
PART_POINTS = 160
"""Number of points of the part in the search: enough to tell poses apart, few enough to try
hundreds."""
MODEL_POINTS = 3000
"""Number of points of the model in the search."""
ROUGH_STEPS = 10
"""Steps of each rough fit."""
FIRST_REACH, LAST_REACH = 0.3, 0.04
"""How far apart matched points may be at the first and last rough step, in sizes of the model."""
AGREEING = 0.7
"""Least cosine between normals of matched points: 45°."""
REFINED = 10
"""Number of poses that are refined."""
REFINED_POINTS = 2000
"""Number of points of the part by which they are refined and compared."""
ALIKE_DEG, ALIKE_SHARE = 8.0, 0.05
"""Rotation, degrees, and displacement, in sizes of the model, up to which two rough poses lead to
the same fit."""
OTHER_DEG, OTHER_SHARE = 1.0, 0.01
"""The same, above which two refined poses are different."""
EQUALLY_GOOD = 1.15
"""Largest ratio of the misfits of two poses that the points do not tell apart. Empirical: noise
changes the misfit by far less, and wrong poses of parts that have no symmetry raise it twofold."""
DAMPING = 1e-3
"""Added to the normal equations of rough fits, per match: directions that are not determined then
stay where they are."""


class ModelTarget:
    """A model that points are registered to.

    Parameters
    ----------
    mesh : MeshDistance
    edge_mm : float ≥ 0
        Points that are nearer to a sharp edge are not matched, mm: they are mixtures of its sides.
    """

    exact = True

    def __init__(self, mesh: MeshDistance, edge_mm: float = 0.0) -> None:
        self.mesh = mesh
        self._edge_mm = edge_mm

    def matched(self, xyz_mm: FloatMap, reach_mm: float) -> tuple[FloatMap, SurfacePoints]:
        found = self.mesh.nearest(xyz_mm, reach_mm)
        has = found.face >= 0
        if self._edge_mm > 0:
            has[has] = ~self.mesh.beside_edges(found.point_mm[has], self._edge_mm)
            found = replace(found, face=np.where(has, found.face, -1))
        none = np.zeros(int(has.sum()))
        points = SurfacePoints(
            found.point_mm[has], self.mesh.smooth_normals(found), none, none, none, None
        )
        return np.where(has, np.abs(found.distance_mm), np.inf), points


@dataclass(frozen=True)
class Searched:
    """The best pose by shape."""

    found: Registration
    others: int
    """Number of other poses that fit equally well: symmetries, or too little shape."""


def search_pose(
    part: SurfacePoints, target: ModelTarget, *, one_view: bool, seed: int = 0
) -> Searched:
    """Find how a part lies to its model, from its shape alone.

    Parameters
    ----------
    part : SurfacePoints
    target : ModelTarget
    one_view : bool
        Whether the part was seen from the origin of its coordinates. It then shows only faces of
        the model that are turned to the camera.
    seed : int
        Seed of the choice of points.

    Returns
    -------
    Searched

    Raises
    ------
    InputError where no pose is found.

    Notes
    -----
    Rotations are spread evenly (super-Fibonacci spirals, M. Alexa, CVPR 2022). From each one, a few
    points are fitted roughly. The best poses are refined by ``register``, and compared by their
    misfit.
    """
    rng = np.random.default_rng(seed)
    size = target.mesh.size_mm
    model = sampled(target.mesh, MODEL_POINTS, rng)
    starts = rough_poses(part, model, size, one_view=one_view, most=REFINED, rng=rng)
    fewer = rng.choice(len(part.xyz_mm), min(REFINED_POINTS, len(part.xyz_mm)), replace=False)
    refined: list[Registration] = []
    for T in starts:
        try:
            refined.append(register(part.at(fewer), target, T, reach_mm=LAST_REACH * size))
        except InputError:
            continue
    if not refined:
        raise InputError(
            "alignment: expected a pose in which the points lie on the model, found none; give "
            "datum points to start from, and crop what does not belong to the part"
        )
    refined.sort(key=_misfit)
    best = refined[0]
    middle = part.xyz_mm.mean(axis=0)
    others: list[Registration] = []
    for one in refined[1:]:
        apart = [_differs(one, known, middle, size) for known in (best, *others)]
        if all(apart) and _misfit(one) < EQUALLY_GOOD * _misfit(best):
            others.append(one)
    return Searched(best, len(others))


def rough_poses(
    part: SurfacePoints,
    model: tuple[FloatMap, FloatMap],
    size_mm: float,
    *,
    one_view: bool,
    most: int,
    rng: np.random.Generator,
) -> list[FloatMap]:
    """Fit a part roughly to points and normals of a model, from rotations all around.

    Returns
    -------
    list of (4, 4) arrays, T_model_part: different poses, the best one first.
    """
    some = part.at(rng.choice(len(part.xyz_mm), min(PART_POINTS, len(part.xyz_mm)), replace=False))
    R = _rotations(ROTATIONS)
    t = _translations(R, part, *model, one_view=one_view)
    R, t, score = _rough(R, t, some, model, size_mm)
    ranked = (pose(R[k], t[k]) for k in np.argsort(score))
    return distinct(ranked, some.xyz_mm.mean(axis=0), (ALIKE_DEG, ALIKE_SHARE * size_mm), most)


def _misfit(found: Registration) -> float:
    """Distance of the points that match, enlarged for those that do not."""
    return found.rms_mm / max(found.overlap, 1e-3) ** 2


def _rotations(count: int) -> FloatMap:
    """Rotations that are spread evenly, (count, 3, 3)."""
    s = np.arange(count) + 0.5
    # Constants of the paper: its spiral turns by √2 and by the real root of ψ⁴ = ψ + 4.
    one, other = s / np.sqrt(2.0), s / 1.533751168755204288118041
    r, q = np.sqrt(s / count), np.sqrt(1.0 - s / count)
    a, b = 2.0 * np.pi * one, 2.0 * np.pi * other
    quaternions = np.stack((r * np.sin(a), r * np.cos(a), q * np.sin(b), q * np.cos(b)), axis=1)
    found: FloatMap = scipy.spatial.transform.Rotation.from_quat(quaternions).as_matrix()
    return found


def _translations(
    R: FloatMap, part: SurfacePoints, points: FloatMap, normals: FloatMap, *, one_view: bool
) -> FloatMap:
    """Translations that put the middle of the part on that of the model's faces that it shows."""
    middle = part.xyz_mm.mean(axis=0)
    if not one_view:
        return np.asarray(points.mean(axis=0) - R @ middle)
    toward = R @ (-middle / np.linalg.norm(middle))
    seen = np.maximum(normals @ toward.T, 0.0)
    centre = seen.T @ points / np.maximum(seen.sum(axis=0), 1e-12)[:, None]
    return np.asarray(centre - R @ middle)


def _rough(
    R: FloatMap,
    t: FloatMap,
    some: SurfacePoints,
    model: tuple[FloatMap, FloatMap],
    size: float,
) -> tuple[FloatMap, FloatMap, FloatMap]:
    """Fit a few points from every rotation; poses, and the share of points that then match."""
    tree = scipy.spatial.cKDTree(model[0])
    for reach in np.geomspace(FIRST_REACH, LAST_REACH, ROUGH_STEPS) * size:
        p, n = some.xyz_mm @ np.swapaxes(R, 1, 2) + t[:, None], some.normals @ np.swapaxes(R, 1, 2)
        near, index = tree.query(p, distance_upper_bound=reach, workers=-1)
        has = np.isfinite(near)
        index = np.where(has, index, 0)
        q, m = model[0][index], model[1][index]
        weight = has * (np.einsum("kni,kni->kn", n, m) > AGREEING)
        centre = p.mean(axis=1, keepdims=True)
        rows = np.concatenate((np.cross(p - centre, m) / size, m), axis=2)
        distance = np.einsum("kni,kni->kn", p - q, m)
        A = np.einsum("kn,kni,knj->kij", weight, rows, rows)
        A += DAMPING * (1.0 + weight.sum(axis=1))[:, None, None] * np.eye(6)
        right = np.einsum("kn,kni,kn->ki", weight, rows, distance)
        xi = -np.linalg.solve(A, right[..., None])[..., 0]
        turn = scipy.spatial.transform.Rotation.from_rotvec(xi[:, :3] / size).as_matrix()
        t = np.einsum("kij,kj->ki", turn, t - centre[:, 0]) + centre[:, 0] + xi[:, 3:]
        R = turn @ R
    # Spread of the matched points and share of them, at the last reach.
    off = np.where(weight > 0, np.abs(distance), reach)
    return R, t, off.mean(axis=1)


def _differs(one: Registration, other: Registration, middle: FloatMap, size: float) -> bool:
    """Whether two refined poses differ, beyond directions in which the surface slides on itself."""
    limits = OTHER_DEG, OTHER_SHARE * size
    return not one.slides and apart(one.T_target_source, other.T_target_source, middle, limits)
