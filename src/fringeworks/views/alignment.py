"""A part brought to its model: by datum points, by datum planes (3-2-1), or by best fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringeworks.rig.pinhole import pose, skew, transform
from fringeworks.surface.form import fit_form
from fringeworks.types import (
    Alignment,
    DatumPoints,
    Finding,
    FloatMap,
    InputError,
)
from fringeworks.views.board_views import rigid
from fringeworks.views.model_target import ModelTarget, search_pose
from fringeworks.views.poses import from_twist
from fringeworks.views.registration import SAMPLES, Registration, register
from fringeworks.views.surface_points import SurfacePoints

REACH_SHARE = 0.05
"""How far from the model points may lie at the start of a best fit, in sizes of the model."""
DATUM_HOLDS = (3, 2, 1)
"""Numbers of directions that the primary, secondary and tertiary datum plane hold."""
MOST_DATUM_POINTS = 20_000
"""Largest number of points of a datum plane; more only cost time."""
MIN_HOLD = 0.02
"""Smallest change of the distances from a datum plane by a direction that the plane holds, with
rotations measured by the displacement at the size of all datums. Below it, the three planes are
nearly parallel, or a plane is too small."""
MIN_SPREAD = 1e-3
"""Smallest extent of datum points across their longest direction, over that direction: points on a
line leave a rotation free."""
SETTLED_MM = 1e-9
"""Step, as a displacement, below which a fit of datum planes has converged, mm: rounding."""
MAX_STEPS = 20
"""Largest number of steps of that fit; planes are linear, so that it takes three or four."""
PATCHES = 3
"""Patches along each side of a surface. Where the errors of the calibration are not known, they
are taken to be alike within a patch and independent between patches."""
MIN_SHARE = 0.5
"""Share of the fitted points that must lie on the model; with less, it is a finding."""


def patches(points_mm: FloatMap) -> NDArray[np.int64]:
    """Return the patch of every point, (n,): 3 × 3 along the two longest axes of the points."""
    middle = points_mm.mean(axis=0)
    sample = (points_mm - middle)[:: max(1, len(points_mm) // 10_000)]
    axes = np.linalg.svd(sample, full_matrices=False)[2][:2]
    at = (points_mm - middle) @ axes.T
    low, high = at.min(axis=0), at.max(axis=0)
    part = np.clip((PATCHES * (at - low) / np.maximum(high - low, 1e-12)).astype(int), 0, 2)
    return np.asarray(PATCHES * part[:, 0] + part[:, 1], np.int64)


def align_points(
    datum: DatumPoints, errors: FloatMap | None, common_mm: FloatMap | None
) -> Alignment:
    """Bring a part to its model by pairs of points.

    Parameters
    ----------
    datum : DatumPoints
    errors : (n, 3, k) array, optional
        Errors of the part's points that the rig's covariance stands for, mm.
    common_mm : (n,) array, optional
        Standard deviation of the calibration's error at the points, mm, where ``errors`` are not
        known.

    Returns
    -------
    Alignment

    Raises
    ------
    InputError for points on a line.

    Notes
    -----
    Least squares of the distances of the pairs (W. Kabsch, Acta Crystallographica A 32, 1976). The
    scatter of a coordinate is that of the 3 n − 6 redundant ones, unless it is given.
    """
    part, model = np.asarray(datum.part_mm), np.asarray(datum.model_mm)
    extent = np.linalg.svd(part - part.mean(axis=0), compute_uv=False)
    if not extent[1] > MIN_SPREAD * extent[0]:
        raise InputError("datum points: expected points that span a plane, got points on a line")
    T = rigid(part, model)
    placed = transform(T, part)
    rows: FloatMap = np.concatenate([np.column_stack((-skew(p), np.eye(3))) for p in placed])
    left = (placed - model).ravel()
    sigma = datum.sigma_mm or float(np.sqrt(left @ left / (left.size - 6)))
    gain = np.linalg.pinv(rows)
    common = np.zeros((6, 6))
    response = None
    if errors is not None:
        response = -gain @ np.einsum("ij,njk->nik", T[:3, :3], errors).reshape(left.size, -1)
        common = response @ response.T
    elif common_mm is not None:
        common = (gain * np.repeat(common_mm, 3) ** 2) @ gain.T
    return Alignment(
        "datum points",
        T,
        sigma**2 * gain @ gain.T,
        common,
        np.eye(6),
        len(part),
        1.0,
        float(np.sqrt(np.mean(np.sum((placed - model) ** 2, axis=1)))),
        converged=True,
        response=response,
    )


@dataclass(frozen=True)
class _Datum:
    """The points of a datum plane of the part, and the model's plane."""

    points: SurfacePoints
    normal: FloatMap
    offset: float


def align_planes(
    parts: Sequence[SurfacePoints], model_points: FloatMap, model_normals: FloatMap
) -> Alignment:
    """Bring a part to its model by three datum planes, in the order of their rank.

    Parameters
    ----------
    parts : three SurfacePoints
        Points of each plane of the part, with normals that point out of the part.
    model_points, model_normals : (3, 3) arrays
        A point on each plane of the model, mm, and its normal.

    Returns
    -------
    Alignment

    Raises
    ------
    InputError for points that show no plane, and planes that do not hold the part.

    Notes
    -----
    The distances from the primary plane determine three directions by least squares, those from the
    secondary one two of the remaining three, and those from the tertiary one the last one (3-2-1,
    ISO 5459). Points more than six robust standard deviations off their own plane do not count.
    """
    datums = []
    for k, (seen, p, n) in enumerate(zip(parts, model_points, model_normals, strict=True)):
        try:
            on_plane = fit_form(seen.xyz_mm, "plane").used
        except InputError as error:
            raise error.at(f"datum plane {k + 1}") from error
        index = np.flatnonzero(on_plane)
        datums.append(
            _Datum(seen.at(index[:: 1 + len(index) // MOST_DATUM_POINTS]), n, float(p @ n))
        )
    T = _planes_start(datums)
    converged = False
    for _ in range(MAX_STEPS):
        gains, distances, size = _planes_gains(T, datums)
        xi = np.sum([G @ d for G, d in zip(gains, distances, strict=True)], axis=0)
        T = from_twist(xi) @ T
        middle = np.mean([transform(T, d.points.xyz_mm).mean(axis=0) for d in datums], axis=0)
        if np.linalg.norm(xi[:3]) * size + np.linalg.norm(xi[3:] + np.cross(xi[:3], middle)) < (
            SETTLED_MM
        ):
            converged = True
            break
    return _planes_alignment(T, datums, converged=converged)


def _planes_start(datums: Sequence[_Datum]) -> FloatMap:
    """A pose from the normals and the middles of the planes."""
    own = []
    for datum in datums:
        form = fit_form(datum.points.xyz_mm, "plane")
        normal = np.asarray(form.parameters["normal"])
        own.append(normal if normal @ datum.points.normals[0] > 0 else -normal)
    wanted = np.stack([datum.normal for datum in datums])
    if abs(np.linalg.det(wanted)) < MIN_HOLD:
        raise InputError(
            "datum planes: expected three planes that hold all directions, got planes that are "
            "nearly parallel"
        )
    cross = wanted.T @ np.stack(own)
    U, _, Vt = np.linalg.svd(cross)
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    middles = np.stack([datum.points.xyz_mm.mean(axis=0) for datum in datums])
    reached = np.sum(wanted * (middles @ R.T), axis=1)
    offset = np.array([datum.offset for datum in datums]) - reached
    return pose(R, np.linalg.solve(wanted, offset))


def _planes_gains(
    T: FloatMap, datums: Sequence[_Datum]
) -> tuple[list[FloatMap], list[FloatMap], float]:
    """Derivatives of the step ξ by the distances of each plane's points, the distances, a size."""
    placed = [transform(T, datum.points.xyz_mm) for datum in datums]
    everything = np.concatenate(placed)
    size = float(np.sqrt(np.mean(np.sum((everything - everything.mean(axis=0)) ** 2, axis=1))))
    free = np.diag(np.append(np.full(3, 1.0 / size), np.ones(3)))
    # Rotations turn about the middle, so that the directions are of one kind.
    free = _about(everything.mean(axis=0)) @ free
    gains: list[FloatMap] = []
    distances: list[FloatMap] = []
    for k, (p, datum) in enumerate(zip(placed, datums, strict=True)):
        rows = np.column_stack((np.cross(p, datum.normal), np.broadcast_to(datum.normal, p.shape)))
        distances.append(p @ datum.normal - datum.offset)
        U, values, Vt = np.linalg.svd(rows @ free, full_matrices=False)
        held = DATUM_HOLDS[k]
        if not values[held - 1] > MIN_HOLD * np.sqrt(len(p)):
            raise InputError(
                f"datum plane {k + 1}: expected a plane that holds {held} more direction"
                f"{'s' * (held > 1)}, got one that does not: choose a larger area, or another plane"
            )
        step = free @ (Vt[:held].T / values[:held]) @ U[:, :held].T
        gains = [G - step @ (rows @ G) for G in gains]
        gains.append(-step)
        free = free @ Vt[held:].T
    return gains, distances, size


def _about(centre: FloatMap) -> FloatMap:
    """Converts ξ about a point to ξ about the origin, (6, 6)."""
    A = np.eye(6)
    A[3:, :3] = skew(centre)
    return A


def _planes_alignment(T: FloatMap, datums: Sequence[_Datum], *, converged: bool) -> Alignment:
    gains, distances, _ = _planes_gains(T, datums)
    noise, common = np.zeros((6, 6)), np.zeros((6, 6))
    response: FloatMap | None = None
    for G, d, datum in zip(gains, distances, datums, strict=True):
        seen = datum.points
        chi = max(1.0, float(np.std(d)) / float(np.sqrt(np.mean(seen.sigma_mm**2)) + 1e-300))
        noise += (G * (chi * seen.noise_mm) ** 2) @ G.T
        if seen.errors is not None:
            along = np.einsum("c,nck->nk", datum.normal @ T[:3, :3], seen.errors)
            response = G @ along + (0.0 if response is None else response)
            continue
        alike = G * np.sqrt(np.maximum(seen.sigma_mm**2 - seen.noise_mm**2, 0.0))
        patch = patches(seen.xyz_mm)
        sums = np.stack([np.bincount(patch, row, PATCHES**2) for row in alike])
        common += sums @ sums.T
    if response is not None:
        common = common + response @ response.T
    left = np.concatenate(distances)
    return Alignment(
        "datum planes",
        T,
        noise,
        common,
        np.eye(6),
        len(left),
        1.0,
        float(np.sqrt(np.mean(left**2))),
        converged,
        response,
        _unconverged(converged=converged),
    )


def align_by_fit(
    part: SurfacePoints,
    target: ModelTarget,
    start: FloatMap | None,
    *,
    one_view: bool,
    seed: int = 0,
) -> Alignment:
    """Bring a part to its model by the distances of its points.

    Parameters
    ----------
    part : SurfacePoints
    target : ModelTarget
    start : (4, 4) array, optional
        T_model_part to start from; by default it is searched for.
    one_view : bool
        Whether the part was seen from the origin of its coordinates.
    seed : int
        Seed of the choice of points.

    Returns
    -------
    Alignment

    Raises
    ------
    InputError where too few points lie near the model, and where no pose is found.
    """
    findings: list[Finding] = []
    if start is None:
        searched = search_pose(part, target, one_view=one_view, seed=seed)
        start = searched.found.T_target_source
        if searched.others:
            findings.append(_ambiguous(searched.others))
    found = register(part, target, start, reach_mm=REACH_SHARE * target.mesh.size_mm, seed=seed)
    findings += _findings(found)
    count = min(SAMPLES, len(part.xyz_mm))
    return Alignment(
        "best fit",
        found.T_target_source,
        found.noise,
        found.common,
        found.determined,
        round(found.overlap * count),
        found.overlap,
        found.rms_mm,
        found.converged,
        found.response,
        (*findings, *_unconverged(converged=found.converged)),
    )


def _ambiguous(others: int) -> Finding:
    return Finding(
        "alignment",
        f"the points fit the model in {others + 1} poses equally well; one of them was taken",
        ("a part that looks alike after a rotation", "too little of the part in view"),
        "give datum points to start from",
        figures={"poses": float(others + 1)},
    )


def _findings(found: Registration) -> list[Finding]:
    findings = []
    if found.slides:
        findings.append(
            Finding(
                "alignment",
                f"the surface slides on itself in {found.slides} of 6 directions, as a plane, "
                "sphere or cylinder does; the pose stays as it started in these directions",
                advice="show more of the part, or align by datum points or planes",
                figures={"directions": float(found.slides)},
            )
        )
    if found.overlap < MIN_SHARE:
        findings.append(
            Finding(
                "alignment",
                f"only {found.overlap:.0%} of the fitted points lie on the model",
                ("points that do not belong to the part", "a wrong pose"),
                "crop what does not belong to the part, or give datum points to start from",
                figures={"share": found.overlap},
            )
        )
    return findings


def _unconverged(*, converged: bool) -> tuple[Finding, ...]:
    if converged:
        return ()
    return (
        Finding(
            "alignment",
            "the alignment has not converged: its last step was above its limit",
            ("a start that is far off",),
            "give datum points to start from",
            severity="error",
        ),
    )
